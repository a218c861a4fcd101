import { corrupt } from "../errors.js";
import { inflate } from "../inflate.js";
import { unpackBits } from "./bits.js";

/** Contexts that share an alphabet; those of a plane's models are numbered one after the other. */
export interface Model {
  readonly contexts: number;
  /** Symbols, at most 64. */
  readonly alphabet: number;
}

const PRECISION = 10;
/** Places of a table, which its symbols share by their probabilities. */
const ONE = 1 << PRECISION;
/** The state is at least this; also where it ends. */
const LOWEST = 1 << 16;
/** Powers of 2 ** (1/4) in sixteenths. */
const POWERS = [16, 19, 23, 27];
/** (50,) weight of each frequency code. */
const WEIGHTS = Int32Array.from({ length: 50 }, (_, code) => (code === 0 ? 0 : POWERS[(code - 1) % 4]! << ((code - 1) >> 2)));

/**
 * A coded plane while it is read, symbol by symbol (spec/orthoview.md, Codec 3). Allocates at most 4 kB a context of its models, 1 MB,
 * and what `inflate` takes.
 */
export class SymbolReader {
  /** The symbol of every context, when there is only one; what is read then is always this, and changes nothing. */
  readonly only: number | null;
  /** (contexts,) where the table of each begins in `slots`. */
  private readonly tables: Int32Array;
  /** (tables, 1024) what is at each place, bits from the lowest: symbol 6, its width 13, how far into it the place is 13. */
  private readonly slots: Uint32Array;
  private readonly stream: Uint8Array;
  /** Bytes of the stream that have been read. */
  private at = 0;
  /** (1,) the state; a field that is a number like any other takes a quarter more time. */
  private readonly state: Uint32Array;

  /** Throws `corrupt` for tables that no writer makes. */
  constructor(models: readonly Model[], plane: Uint8Array, private readonly where: string) {
    const packed = plane.length < 4 ? 0 : plane[0]! | (plane[1]! << 8);
    this.stream = plane.subarray(4 + packed);
    if (this.stream.length < 4) throw corrupt("a coded plane without a whole stream", where);
    const told = inflate(plane.subarray(4, 4 + packed), plane[2]! | (plane[3]! << 8), where);
    ({ tables: this.tables, slots: this.slots } = readTables(models, told, where));
    this.state = Uint32Array.of(this.word() | (this.word() << 16));
    const slot = this.slots[0]!;
    const certain = this.slots.length === ONE && slot >>> 6 === ONE && this.state[0]! >= LOWEST;
    this.only = certain ? slot & 63 : null;
  }

  /** The next symbol, of a context. */
  symbol(context: number): number {
    const state = this.state[0]!;
    const slot = this.slots[this.tables[context]! + (state & (ONE - 1))]!;
    this.proceed(Math.imul((slot >>> 6) & 8191, state >>> PRECISION) + (slot >>> 19));
    return slot & 63;
  }

  /** The next plain bits, at most 7 of them. */
  bits(count: number): number {
    const rest = PRECISION - count;
    const state = this.state[0]!;
    const slot = state & (ONE - 1);
    this.proceed(((state >>> PRECISION) << rest) | (slot & ((1 << rest) - 1)));
    return slot >> rest;
  }

  /** Throws `corrupt` unless the stream has been read to its end and came out as a writer began it. */
  finish(): void {
    if (this.state[0] !== LOWEST || this.at !== this.stream.length) throw corrupt("a coded plane does not hold what it should", this.where);
  }

  /** A state below the least takes the next word. */
  private proceed(state: number): void {
    this.state[0] = state >>> 16 === 0 ? (state << 16) | this.word() : state;
  }

  /** Beyond the end of the stream there are zeros. */
  private word(): number {
    const low = this.stream[this.at++] ?? 0;
    return low | ((this.stream[this.at++] ?? 0) << 8);
  }
}

/** Tables and which one each context takes, from what a coded plane tells of them. */
function readTables(models: readonly Model[], told: Uint8Array, where: string): { tables: Int32Array; slots: Uint32Array } {
  const contexts = models.reduce((sum, model) => sum + model.contexts, 0);
  let at = (contexts + 7) >> 3;
  const other = unpackBits(told.subarray(0, at), contexts);
  if (!other || told.subarray(at).some((code) => code >= WEIGHTS.length)) throw corrupt("tables that no writer makes", where);
  const tables = new Int32Array(contexts);
  const slots = new Uint32Array(ONE * other.reduce((sum, bit) => sum + bit, 0));
  let context = 0;
  let next = 0;
  for (const model of models) {
    if (other[context] === 0) throw corrupt("a model without a table", where);
    for (const end = context + model.contexts; context < end; context++) {
      if (other[context] === 1) {
        if (at + model.alphabet > told.length) throw corrupt("fewer tables than it should have", where);
        fillTable(slots.subarray(next, next + ONE), told.subarray(at, at + model.alphabet));
        at += model.alphabet;
        next += ONE;
      }
      tables[context] = next - ONE;
    }
  }
  if (at !== told.length) throw corrupt("more tables than contexts", where);
  return { tables, slots };
}

/** Divides the places of a table by the frequency codes of its symbols. */
function fillTable(slots: Uint32Array, codes: Uint8Array): void {
  const whole = codes.reduce((sum, code) => sum + WEIGHTS[code]!, 0);
  const widths = Array.from(codes, (code) => (code === 0 ? 0 : Math.max(1, Math.floor((ONE * WEIGHTS[code]!) / whole))));
  // Of 64 symbols or less, the others never take so many that this leaves the commonest one none.
  const commonest = codes.indexOf(Math.max(...codes));
  widths[commonest]! += ONE - widths.reduce((sum, width) => sum + width, 0);
  for (let symbol = 0, first = 0; symbol < widths.length; symbol++) {
    const width = widths[symbol]!;
    for (let k = 0; k < width; k++) slots[first + k] = symbol | (width << 6) | (k << 19);
    first += width;
  }
}
