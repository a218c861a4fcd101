import { Vector3, type Camera, type Matrix4 } from "three";
import { asFarfieldError } from "../core/errors.js";
import type { Vector3 as Triple } from "../core/vector.js";
import type { Picked } from "../three/picker.js";
import { PickedCard } from "./pickedcard.js";

/** An answer that takes longer is announced. */
const WAITING_MS = 300;

export interface PickingParts {
  readonly canvas: HTMLElement;
  readonly picked: HTMLElement;
  readonly marker: HTMLElement;
  /** What is at a place, CSS pixels of the canvas. */
  readonly pick: (x: number, y: number, signal: AbortSignal) => Promise<Picked | null>;
}

/** A click opens a card with what is there, and marks the place; Escape, or a click on nothing, closes it. */
export class Picking {
  private readonly card: PickedCard;
  private asked = new AbortController();
  /** The place that is marked, local metres. */
  private place: Triple | null = null;

  constructor(private readonly parts: PickingParts) {
    const { canvas, picked } = parts;
    this.card = new PickedCard(picked, () => this.leave());
    canvas.addEventListener("keydown", ({ key, repeat }) => {
      if (key === "Enter" && !repeat) void this.ofMiddle();
    });
    addEventListener("keydown", ({ key }) => {
      if (key === "Escape" && this.card.isOpen) this.leave();
    });
  }

  /** Shows what is at a place of the page, CSS pixels; the last place that was asked about counts. Whether it was something. */
  async at(x: number, y: number): Promise<boolean> {
    this.asked.abort();
    this.asked = new AbortController();
    const { signal } = this.asked;
    const { left, top } = this.parts.canvas.getBoundingClientRect();
    const waiting = setTimeout(() => signal.aborted || this.card.wait(), WAITING_MS);
    try {
      const found = await this.parts.pick(x - left, y - top, signal);
      if (signal.aborted) return false;
      if (found) this.card.show(found);
      else this.close();
      this.mark(found ? found.position : null, [x, y]);
      return found !== null;
    } catch (thrown) {
      const { tag, what } = asFarfieldError(thrown, "");
      if (!signal.aborted && tag !== "aborted") this.card.fail(what);
      return false;
    } finally {
      clearTimeout(waiting);
    }
  }

  /** Keeps the mark where it is in the world. */
  follow(camera: Camera, placement: Matrix4): void {
    if (!this.place) return;
    const { canvas, marker } = this.parts;
    const { left, top, width, height } = canvas.getBoundingClientRect();
    const { x, y, z } = new Vector3(...this.place).applyMatrix4(placement).project(camera);
    marker.hidden = Math.abs(z) > 1;
    this.moveMark([left + (width * (x + 1)) / 2, top + (height * (1 - y)) / 2]);
  }

  /** What is in the middle of the picture; the keyboard goes on in the card. */
  private async ofMiddle(): Promise<void> {
    const { canvas, picked } = this.parts;
    const { left, top, width, height } = canvas.getBoundingClientRect();
    if (await this.at(left + width / 2, top + height / 2)) picked.focus();
  }

  private mark(place: Triple | null, at: readonly [number, number]): void {
    this.place = place;
    this.parts.marker.hidden = place === null;
    this.moveMark(at);
  }

  private moveMark([x, y]: readonly [number, number]): void {
    this.parts.marker.style.transform = `translate(${x}px, ${y}px)`;
  }

  private close(): void {
    this.asked.abort();
    this.card.hide();
    this.mark(null, [0, 0]);
  }

  /** Closes the card; the keyboard is the picture's again. */
  private leave(): void {
    this.close();
    this.parts.canvas.focus();
  }
}
