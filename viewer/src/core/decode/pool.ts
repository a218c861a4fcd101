import { asFarfieldError, FarfieldError } from "../errors.js";
import { decode } from "./decode.js";
import type { Decoded, DecodeAnswer, DecodeRequest, Extent } from "./messages.js";

/** Tiles a worker has at once: while the browser decodes the colour of one, the worker unpacks another. */
const TILES_A_WORKER = 3;

/** Makes one worker; throws where workers are not allowed. */
export type WorkerMaker = () => Worker;

interface Task extends DecodeRequest {
  readonly resolve: (decoded: Decoded[keyof Decoded]) => void;
  readonly reject: (error: FarfieldError) => void;
  readonly signal: AbortSignal;
}

/** Two to four, leaving the machine a core to draw with. */
export function defaultWorkers(): number {
  return Math.max(2, Math.min(4, (globalThis.navigator?.hardwareConcurrency ?? 2) - 1));
}

/** Decodes tiles and images in a few workers; on the calling thread where workers cannot be made. */
export class DecodePool {
  /** A worker stands here as often as it has room for tiles. */
  private readonly idle: Worker[] = [];
  private readonly all: Worker[] = [];
  private readonly waiting: Task[] = [];
  private readonly running = new Map<number, Task>();
  private nextId = 1;

  constructor(make: WorkerMaker | null, workers = defaultWorkers()) {
    for (let n = 0; make && n < workers; n++) {
      try {
        this.add(make());
      } catch {
        break;
      }
    }
  }

  /** Tiles that wait or are being decoded. */
  get pending(): number {
    return this.waiting.length + this.running.size;
  }

  /**
   * Decodes a tile, a BlockMap or an image. Rejects with `corrupt` or, when aborted before its turn, `aborted`.
   * extent: of a BlockMap's cell.
   */
  decode<Kind extends keyof Decoded>(
    kind: Kind, bytes: Uint8Array, where: string, signal: AbortSignal, ...extent: Kind extends "blockmap" ? [Extent] : []
  ): Promise<Decoded[Kind]> {
    const what = { kind, bytes, where, extent: extent[0] };
    if (this.all.length === 0) return decode(what) as Promise<Decoded[Kind]>;
    return new Promise((resolve, reject) => {
      const settled = resolve as Task["resolve"];
      this.waiting.push({ ...what, id: this.nextId++, resolve: settled, reject, signal });
      this.pump();
    });
  }

  dispose(): void {
    for (const worker of this.all) worker.terminate();
    for (const task of [...this.waiting.splice(0), ...this.running.values()]) {
      task.reject(new FarfieldError("aborted", "closed", task.where));
    }
    this.running.clear();
  }

  private add(worker: Worker): void {
    worker.onmessage = ({ data }: MessageEvent<DecodeAnswer>) => {
      this.settle(data);
      this.idle.push(worker);
      this.pump();
    };
    worker.onerror = (event) => {
      // A worker that cannot even start: its tiles are decoded here.
      event.preventDefault();
      this.all.splice(this.all.indexOf(worker), 1);
      while (this.idle.includes(worker)) this.idle.splice(this.idle.indexOf(worker), 1);
      if (this.all.length === 0) this.decodeHere();
    };
    this.all.push(worker);
    for (let n = 0; n < TILES_A_WORKER; n++) this.idle.unshift(worker);
  }

  private pump(): void {
    while (this.idle.length > 0 && this.waiting.length > 0) {
      const task = this.waiting.shift()!;
      if (task.signal.aborted) {
        task.reject(new FarfieldError("aborted", "no longer wanted", task.where));
        continue;
      }
      this.running.set(task.id, task);
      // A copy: the tiles of a batch share one buffer, and posting a part of it would send the whole.
      const bytes = task.bytes.slice();
      const request: DecodeRequest = { id: task.id, kind: task.kind, where: task.where, bytes, extent: task.extent };
      this.idle.pop()!.postMessage(request, [bytes.buffer]);
    }
  }

  private settle(answer: DecodeAnswer): void {
    const task = this.running.get(answer.id);
    if (!task) return;
    this.running.delete(answer.id);
    if ("decoded" in answer) task.resolve(answer.decoded);
    else task.reject(new FarfieldError(answer.tag, answer.what, task.where));
  }

  private decodeHere(): void {
    const tasks = [...this.running.values(), ...this.waiting.splice(0)];
    this.running.clear();
    for (const task of tasks) {
      decode(task).then(task.resolve, (error: unknown) => task.reject(asFarfieldError(error, task.where)));
    }
  }
}
