import type { Resource } from "./resource.js";

/** What is ready or held, least recently used first, within a budget of bytes. */
export class Cache {
  private readonly entries = new Set<Resource>();
  /** Bytes of everything in it. */
  bytes = 0;

  constructor(
    /** Bytes it may hold; what is in use stays even so. */
    public budget: number,
    private readonly drop: (resource: Resource) => void,
  ) {}

  get count(): number {
    return this.entries.size;
  }

  get resources(): Iterable<Resource> {
    return this.entries;
  }

  has(key: string): boolean {
    for (const resource of this.entries) if (resource.key === key) return true;
    return false;
  }

  add(resource: Resource): void {
    this.entries.add(resource);
    this.bytes += resource.size;
  }

  /** Marks as used by plan `number`. */
  use(resource: Resource, number: number): void {
    resource.used = number;
    if (this.entries.delete(resource)) this.entries.add(resource);
  }

  remove(resource: Resource): void {
    if (!this.entries.delete(resource)) return;
    this.bytes -= resource.size;
    this.drop(resource);
  }

  /** Bytes of what plan `number` has a use for. */
  inUse(number: number): number {
    let bytes = 0;
    for (const { used, size } of this.entries) if (used >= number) bytes += size;
    return bytes;
  }

  /** Drops what plan `number` has no use for until `room` more bytes fit, the longest unused first. */
  trim(number: number, room = 0): void {
    for (const resource of this.entries) {
      if (this.bytes + room <= this.budget) return;
      if (resource.used < number) this.remove(resource);
    }
  }

  /** Drops what the newest generation does not have. */
  dropGone(): void {
    for (const resource of [...this.entries]) if (resource.gone) this.remove(resource);
  }

  clear(): void {
    for (const resource of [...this.entries]) this.remove(resource);
  }
}
