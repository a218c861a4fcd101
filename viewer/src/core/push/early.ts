import type { Resource } from "../resource.js";

/** Bytes that are kept. */
const MOST_BYTES = 8 << 20;

/** Values of cells that the index does not tell of yet; the oldest go first. */
export class EarlyValues {
  private readonly values = new Map<string, Uint8Array>();
  private bytes = 0;

  keep(key: string, value: Uint8Array): void {
    this.take(key);
    this.values.set(key, value);
    this.bytes += value.length;
    for (const oldest of this.values.keys()) {
      if (this.bytes <= MOST_BYTES) return;
      this.take(oldest);
    }
  }

  /** Those that are found by now; they are kept no longer. */
  taken(find: (key: string) => Resource | null): [Resource, Uint8Array][] {
    return [...this.values.keys()].flatMap((key) => {
      const resource = find(key);
      return resource ? [[resource, this.take(key)!] as [Resource, Uint8Array]] : [];
    });
  }

  private take(key: string): Uint8Array | undefined {
    const value = this.values.get(key);
    this.values.delete(key);
    this.bytes -= value?.length ?? 0;
    return value;
  }
}
