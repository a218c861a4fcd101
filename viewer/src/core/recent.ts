/** What was asked for last, by key, as much of it as has room. */
export class Recent<T> {
  private readonly entries = new Map<string, { readonly value: T; readonly bytes: number }>();
  private bytes = 0;

  /** most: bytes of all of it; the one that was added last stays whatever it takes. */
  constructor(private readonly most: number) {}

  get(key: string): T | undefined {
    const found = this.entries.get(key);
    if (!found) return undefined;
    this.entries.delete(key);
    this.entries.set(key, found);
    return found.value;
  }

  /** Keeps a value, which is not there yet, and lets go of those that nobody has asked for the longest. */
  add(key: string, value: T, bytes: number): T {
    this.entries.set(key, { value, bytes });
    this.bytes += bytes;
    for (const [name, entry] of this.entries) {
      if (this.bytes <= this.most || name === key) break;
      this.entries.delete(name);
      this.bytes -= entry.bytes;
    }
    return value;
  }
}
