import type { Resource } from "./resource.js";

/** Values that were fetched ahead and are not decoded yet, as they came, within a budget of bytes. */
export class Stock {
  private readonly values = new Map<Resource, Uint8Array>();
  bytes = 0;

  constructor(public budget: number) {}

  /** How many there are. */
  get count(): number {
    return this.values.size;
  }

  get resources(): Iterable<Resource> {
    return this.values.keys();
  }

  put(resource: Resource, value: Uint8Array): void {
    // A copy: as a part of a batch's answer it would keep all of that.
    this.values.set(resource, value.slice());
    this.bytes += value.length;
    resource.state = "fetched";
  }

  /** Takes a value out, to be decoded. */
  take(resource: Resource): Uint8Array {
    const value = this.values.get(resource)!;
    this.values.delete(resource);
    this.bytes -= value.length;
    return value;
  }

  /** Drops what nobody `wants` any more, oldest first, until it fits. */
  trim(wants: (resource: Resource) => boolean): void {
    for (const resource of this.values.keys()) {
      if (this.bytes <= this.budget) return;
      if (wants(resource)) continue;
      this.drop(resource);
    }
  }

  drop(resource: Resource): void {
    if (!this.values.has(resource)) return;
    this.take(resource);
    resource.state = "absent";
  }

  clear(): void {
    for (const resource of this.values.keys()) resource.state = "absent";
    this.values.clear();
    this.bytes = 0;
  }
}
