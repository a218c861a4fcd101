/** Damage to bytes and to JSON, the same kinds as in tests/fuzz/mutate.py. */

/** Numbers from 0 to below 1, the same for the same seed (mulberry32). */
export class Random {
  constructor(private state: number) {}

  next(): number {
    this.state = (this.state + 0x6d2b79f5) | 0;
    let t = Math.imul(this.state ^ (this.state >>> 15), 1 | this.state);
    t = (t + Math.imul(t ^ (t >>> 7), 61 | t)) ^ t;
    return ((t ^ (t >>> 14)) >>> 0) / 2 ** 32;
  }

  /** A whole number from 0 to below `end`. */
  below(end: number): number {
    return Math.floor(this.next() * end);
  }

  choice<T>(items: readonly T[]): T {
    return items[this.below(items.length)]!;
  }

  bytes(length: number): Uint8Array {
    return Uint8Array.from({ length }, () => this.below(256));
  }
}

const EXTREMES = [0, 1, -1, 127, 128, 255, 256, 4096, 4097, 2 ** 15, 2 ** 16 - 1, 2 ** 31 - 1, 2 ** 31, 2 ** 32 - 1];
/** Bytes at the beginning that are hit more often than others. */
const HEADER = 64;

type Mutator = (data: Uint8Array, other: Uint8Array, random: Random) => Uint8Array;

function place(data: Uint8Array, random: Random): number {
  return random.below(random.next() < 0.5 ? Math.min(data.length, HEADER) : data.length);
}

export function joined(...parts: readonly Uint8Array[]): Uint8Array {
  const whole = new Uint8Array(parts.reduce((sum, part) => sum + part.length, 0));
  let at = 0;
  for (const part of parts) {
    whole.set(part, at);
    at += part.length;
  }
  return whole;
}

const flip: Mutator = (data, _, random) => {
  const changed = data.slice();
  for (let n = random.choice([1, 1, 2, 8]); n > 0; n--) changed[place(data, random)]! ^= 1 << random.below(8);
  return changed;
};

const overwrite: Mutator = (data, _, random) => {
  const changed = data.slice();
  const at = place(data, random);
  const length = Math.min(random.choice([1, 4, 16, 100]), data.length - at);
  changed.set(random.choice([new Uint8Array(length), new Uint8Array(length).fill(255), random.bytes(length)]), at);
  return changed;
};

const extreme: Mutator = (data, _, random) => {
  const changed = data.slice();
  const width = random.choice([1, 2, 4, 4]);
  const at = Math.floor(place(data, random) / width) * width;
  const number = random.choice(EXTREMES) >>> 0;
  for (let n = 0; n < width; n++) changed[at + n] = number >>> (8 * n);
  return changed;
};

const truncate: Mutator = (data, _, random) => data.slice(0, random.below(data.length + 1));
const extend: Mutator = (data, _, random) => joined(data, random.bytes(random.choice([1, 4, 300])));
const splice: Mutator = (data, other, random) => joined(data.slice(0, place(data, random)), other.slice(random.below(other.length + 1)));

const remove: Mutator = (data, _, random) => {
  const at = place(data, random);
  return joined(data.slice(0, at), data.slice(at + random.choice([1, 2, 4, 40])));
};

const double: Mutator = (data, _, random) => {
  const at = place(data, random);
  return joined(data.slice(0, at), data.slice(at, at + random.choice([1, 8, 40])), data.slice(at));
};

/** A megabyte of one byte: a kilobyte where it is deflated afterwards. */
const bomb: Mutator = (_data, _other, random) => new Uint8Array(1 << random.choice([0, 12, 20])).fill(random.choice([0, 32, 91, 255]));

const MUTATORS = [flip, flip, overwrite, extreme, extreme, truncate, extend, splice, remove, double];

/** `data` damaged one to three times, mostly once: what is damaged a little gets furthest. */
export function mutated(data: Uint8Array, other: Uint8Array, random: Random): Uint8Array {
  if (random.next() < 0.01) return bomb(data, other, random);
  let changed = data;
  for (let n = random.choice([1, 1, 1, 2, 3]); n > 0 && changed.length > 0; n--) changed = random.choice(MUTATORS)(changed, other, random);
  return changed;
}

const MARK = "@@here@@";
/** JSON that a node is replaced by; `JSON.stringify` would not write some of it. */
const RAW = [
  "1e999", "-1e999", "1e308", "NaN", "9".repeat(400), "-1", "0", "1e-320", "-0", "0.5", "null", "true", "[]", "{}", "[[]]",
  `${"[".repeat(500)}${"]".repeat(500)}`, "[".repeat(100_000), '{"a":'.repeat(50_000), '"\\ud800"', '""', '"../.."',
  '{"toString":1,"length":-1}', '"__proto__"', `"${"x".repeat(10_000)}"`, ...EXTREMES.map(String),
];

/** Of a document that is changed further, and characters that are put in the places of its nodes: copies of copies of lists would fill any memory. */
const MOST_NODES = 20_000;
const MOST_TEXT = 4 << 20;

/** JSON with one to three of its nodes replaced, removed, doubled or given another's value. */
export function mutatedJson(text: string, random: Random): string {
  const document: unknown = JSON.parse(text);
  const raw = random.choice(RAW);
  for (let n = random.choice([1, 1, 1, 2, 3]); n > 0; n--) {
    const places = [...nodes(document)];
    if (places.length > 0 && places.length < MOST_NODES) change(places, random);
  }
  const parts = JSON.stringify(document).split(`"${MARK}"`);
  return parts.join(parts.length * raw.length < MOST_TEXT ? raw : "null");
}

type Container = Record<string, unknown>;

function* nodes(value: unknown): Generator<[Container, string]> {
  if (value === null || typeof value !== "object") return;
  for (const key of Object.keys(value)) {
    yield [value as Container, key];
    yield* nodes((value as Container)[key]);
  }
}

function change(places: readonly [Container, string][], random: Random): void {
  const [container, key] = random.choice(places);
  const [other, name] = random.choice(places);
  const kind = random.below(6);
  if (kind < 3) container[key] = MARK;
  else if (kind === 3) {
    if (Array.isArray(container)) container.splice(Number(key), 1);
    else delete container[key];
  } else if (kind === 4 && Array.isArray(container)) {
    container.splice(Number(key), 0, ...new Array<unknown>(random.choice([1, 30, 1000])).fill(container[Number(key)]));
  } else container[key] = structuredClone(other[name]);
}
