const OF_A_CELL =
  /^([^/]+)\/(0|[1-9][0-9]?)\/(-?(?:0|[1-9][0-9]{0,8}))\/(-?(?:0|[1-9][0-9]{0,8}))\/(-?(?:0|[1-9][0-9]{0,8}))[-/]./;
/** Makes any index of up to nine digits positive. */
const OFFSET = 2 ** 30;

/** Where a key stands in an archive (spec/archive.md, Order). */
export interface Rank {
  /** 0: the manifest; 1: index tiles; 2: what else belongs to cells; 3: object ids; 4: the rest. */
  readonly kind: number;
  readonly level: number;
  readonly x: number;
  readonly y: number;
  readonly z: number;
  readonly key: string;
}

export function rankOf(key: string): Rank {
  const found = OF_A_CELL.exec(key);
  if (!found) return { kind: key === "world.json" ? 0 : 4, level: 0, x: 0, y: 0, z: 0, key };
  const [, name, level, x, y, z] = found;
  return {
    kind: name === "index" ? 1 : name === "objects" ? 3 : 2, level: Number(level), key,
    x: Number(x) + OFFSET, y: Number(y) + OFFSET, z: Number(z) + OFFSET,
  };
}

/** Below 0 when `a` comes before `b`: by kind, upper levels first, along a Morton curve, by name. */
export function compareRanks(a: Rank, b: Rank): number {
  return a.kind - b.kind || b.level - a.level || compareMorton(a, b) || (a.key < b.key ? -1 : Number(a.key > b.key));
}

/** Decided by the axis with the highest differing bit; of equals by z before y before x. */
function compareMorton(a: Rank, b: Rank): number {
  let most = a.z ^ b.z;
  let order = a.z - b.z;
  for (const axis of ["y", "x"] as const) {
    const differing = a[axis] ^ b[axis];
    if (most < differing && most < (most ^ differing)) {
      most = differing;
      order = a[axis] - b[axis];
    }
  }
  return order;
}
