import type { PerspectiveCamera } from "three";
import { aimOf, plus, reachOf, type Pose } from "./pose.js";
import { Keys } from "./keys.js";
import { Pointers, type Drag } from "./pointers.js";

const ORBIT_A_PIXEL = 0.005;
const WHEEL = 0.0012;
/** The target keeps at least this share of the scene's free room ahead, so that the wheel never stops dead. */
const NEAREST = 0.02;
/** Share of a glide that is left after a second. */
const GLIDE = 0.002;

/** Moves a pose with mouse, wheel, touch and keys, and holds the camera to it. */
export class Controls {
  pose: Pose = { eye: [0, -1, 0], target: [0, 0, 0], fov: 50 };
  /** Told after each move that a person made. */
  onmove: () => void = () => undefined;
  /** Told of each click or tap, pixels of the page. */
  ontap: (x: number, y: number) => void = () => undefined;
  private readonly keys: Keys;
  private readonly stop = new AbortController();
  private glide = { heading: 0, pitch: 0 };

  constructor(
    private readonly camera: PerspectiveCamera,
    private readonly canvas: HTMLElement,
    /** Metres to the nearest thing, or null. */
    private readonly clearance: () => number | null,
  ) {
    const { signal } = this.stop;
    this.keys = new Keys(signal);
    new Pointers(canvas, signal, {
      drag: (drag) => this.drag(drag),
      zoom: (factor) => this.zoom(factor),
      tap: (x, y) => this.ontap(x, y),
    });
    canvas.addEventListener("wheel", (event) => this.wheel(event), { passive: false, signal });
  }

  set(pose: Pose): void {
    this.pose = pose;
    this.glide = { heading: 0, pitch: 0 };
    this.apply();
  }

  /** Advances what keys and glides move by `seconds`; returns whether anything moved. */
  step(seconds: number): boolean {
    const { heading, pitch } = this.glide;
    const gliding = Math.hypot(heading, pitch) > 0.003;
    if (gliding) {
      this.orbit(heading * seconds, pitch * seconds);
      const left = GLIDE ** seconds;
      this.glide = { heading: heading * left, pitch: pitch * left };
    }
    const flying = this.fly(seconds);
    if (gliding || flying) this.moved();
    return gliding || flying;
  }

  dispose(): void {
    this.stop.abort();
  }

  private drag({ dx, dy, kind, seconds }: Drag): void {
    const [x, y] = [dx * ORBIT_A_PIXEL, dy * ORBIT_A_PIXEL];
    this.glide = { heading: 0, pitch: 0 };
    if (kind === "orbit") {
      this.orbit(x, -y);
      if (seconds > 0) this.glide = { heading: x / seconds, pitch: -y / seconds };
    } else if (kind === "look") this.look(x / 2, -y / 2);
    else this.pan(dx, dy);
    this.moved();
  }

  /** Turns round the target. */
  private orbit(heading: number, pitch: number): void {
    const aim = aimOf(this.pose);
    const reach = reachOf({ ...aim, heading: aim.heading + heading, pitch: aim.pitch + pitch });
    this.pose = { ...this.pose, eye: plus(this.pose.target, reach, -1) };
  }

  /** Turns the head. */
  private look(heading: number, pitch: number): void {
    const aim = aimOf(this.pose);
    const reach = reachOf({ ...aim, heading: aim.heading + heading, pitch: aim.pitch + pitch });
    this.pose = { ...this.pose, target: plus(this.pose.eye, reach) };
  }

  /** Shifts sideways and up, as far as the target appears to move. */
  private pan(dx: number, dy: number): void {
    const aim = aimOf(this.pose);
    const scale = (2 * aim.distance * Math.tan((this.pose.fov * Math.PI) / 360)) / this.canvas.clientHeight;
    const right = reachOf({ heading: aim.heading + Math.PI / 2, pitch: 0, distance: 1 });
    const up = reachOf({ heading: aim.heading, pitch: aim.pitch + Math.PI / 2, distance: 1 });
    this.shift(plus([-dx * scale * right[0], -dx * scale * right[1], 0], up, dy * scale));
  }

  private wheel(event: WheelEvent): void {
    event.preventDefault();
    const pixels = event.deltaY * (event.deltaMode === 1 ? 16 : event.deltaMode === 2 ? 400 : 1);
    this.zoom(Math.exp(Math.max(-400, Math.min(400, pixels)) * WHEEL));
  }

  /** Brings the eye nearer to the target or farther from it; close to it, both go on together. */
  private zoom(factor: number): void {
    const aim = aimOf(this.pose);
    const reach = reachOf({ ...aim, distance: 1 });
    const least = Math.max(0.05, NEAREST * (this.clearance() ?? 0));
    const distance = Math.max(least, aim.distance * factor);
    const eye = plus(this.pose.eye, reach, aim.distance * (1 - factor));
    this.pose = { ...this.pose, eye, target: plus(eye, reach, distance) };
    this.moved();
  }

  private fly(seconds: number): boolean {
    const { forward, right, up, turn, tilt, fast } = this.keys.state();
    if (turn || tilt) this.look(turn * seconds, tilt * seconds);
    if (!forward && !right && !up) return turn !== 0 || tilt !== 0;
    const aim = aimOf(this.pose);
    // As fast as things are far away: about a second to the nearest, never slower than a walk.
    const speed = Math.max(1.5, this.clearance() ?? 0, aim.distance * 0.15) * (fast ? 4 : 1) * seconds;
    const ahead = reachOf({ ...aim, distance: 1 });
    const aside = reachOf({ heading: aim.heading + Math.PI / 2, pitch: 0, distance: 1 });
    this.shift(plus(plus([0, 0, up * speed], ahead, forward * speed), aside, right * speed));
    return true;
  }

  private shift(by: readonly [number, number, number]): void {
    this.pose = { ...this.pose, eye: plus(this.pose.eye, by), target: plus(this.pose.target, by) };
  }

  private moved(): void {
    this.apply();
    this.onmove();
  }

  private apply(): void {
    const { eye, target, fov } = this.pose;
    const aim = aimOf(this.pose);
    // Looking straight up or down, the picture's upper edge is where the pose's heading says: north.
    const steep = Math.abs(aim.pitch) > 1.56;
    this.camera.up.set(...(steep ? reachOf({ heading: aim.heading, pitch: 0, distance: 1 }) : ([0, 0, 1] as const)));
    this.camera.position.set(...eye);
    this.camera.lookAt(...target);
    if (this.camera.fov !== fov) {
      this.camera.fov = fov;
      this.camera.updateProjectionMatrix();
    }
  }
}
