import { PerspectiveCamera, Scene, WebGLRenderer } from "three";
import type { Manifest } from "../core/manifest.js";
import { FrameTimer } from "../three/frametimer.js";
import { FarfieldWorld } from "../three/world.js";
import type { OptionChanges } from "../three/options.js";
import type { Picked } from "../three/picker.js";
import type { PageStats } from "./api.js";
import { Balloons } from "./balloons.js";
import { Controls } from "./controls.js";
import { figuresOf, Rate } from "./figures.js";
import { airOf, readHash, writeHash } from "./hash.js";
import { Messages } from "./messages.js";
import { Panel } from "./panel.js";
import { controlsOf } from "./panelcontrols.js";
import { Picking } from "./picking.js";
import { DEFAULT_FOV, overview, type Pose } from "./pose.js";

const FIGURES_MS = 250;
const HASH_MS = 400;
/** Options that the address keeps. */
const KEPT = ["light", "sky", "haze", "shadows"] as const;
const MOST_PIXELS_A_POINT = 2;

/** The elements of the page. */
export interface PageElements {
  readonly canvas: HTMLCanvasElement;
  readonly panel: HTMLElement;
  readonly credits: HTMLElement;
  readonly banner: HTMLElement;
  /** The card of what was clicked, and the mark where that was. */
  readonly picked: HTMLElement;
  readonly marker: HTMLElement;
  readonly progress: HTMLElement;
  readonly message: HTMLElement;
  /** Everything over the picture. */
  readonly overlay: HTMLElement;
}

/** The page: one world, a camera that people move, and what is shown around the picture. */
export class Application {
  readonly world: FarfieldWorld;
  private readonly scene = new Scene();
  private readonly camera = new PerspectiveCamera(DEFAULT_FOV, 1, 1, 1e9);
  private readonly renderer: WebGLRenderer;
  private readonly controls: Controls;
  private readonly timer: FrameTimer;
  private readonly rate = new Rate();
  private readonly messages: Messages;
  private readonly picking: Picking;
  private panel: Panel | null = null;
  private balloons: Balloons | null = null;
  private frames = 0;
  private firstPicture: number | null = null;
  private most = 1;
  private last = performance.now();
  private nextFigures = 0;
  private restUntil = 0;
  private hashTimer: ReturnType<typeof setTimeout> | undefined;

  /** context: WebGL2, made by the caller, who has to say so when there is none. */
  constructor(
    address: URL,
    context: WebGL2RenderingContext,
    private readonly elements: PageElements,
    options: OptionChanges = {},
  ) {
    const { canvas } = elements;
    this.renderer = new WebGLRenderer({ canvas, context });
    this.world = new FarfieldWorld(address, options);
    this.scene.add(this.world);
    this.timer = new FrameTimer(context);
    this.controls = new Controls(this.camera, canvas, () => this.world.clearance);
    this.controls.onmove = () => this.rememberSoon();
    this.messages = new Messages(elements.message, elements.banner, () => this.world.retryNow());
    this.messages.opening(address.href);
    this.picking = new Picking({ ...elements, pick: (x, y, signal) => this.pick(x, y, signal) });
    this.controls.ontap = (x, y) => void this.picking.at(x, y);
    this.listen();
    requestAnimationFrame((now) => this.tick(now));
  }

  get pose(): Pose {
    return this.controls.pose;
  }

  setPose(pose: Pose): void {
    this.controls.set(pose);
    this.rememberSoon();
  }

  setOptions(changes: OptionChanges): void {
    this.world.setOptions(changes);
    this.panel?.refresh();
    if (KEPT.some((name) => name in changes)) this.rememberSoon();
  }

  hideInterface(): void {
    this.elements.overlay.hidden = true;
  }

  /** As `FarfieldWorld.pick`, in CSS pixels of the canvas. */
  pick(x: number, y: number, signal?: AbortSignal): Promise<Picked | null> {
    const { canvas } = this.elements;
    return this.world.pick((x * canvas.width) / canvas.clientWidth, (y * canvas.height) / canvas.clientHeight, signal);
  }

  get stats(): PageStats {
    return {
      ...this.world.stats,
      frame_ms: this.timer.milliseconds,
      frames: this.frames,
      first_picture_ms: this.firstPicture,
    };
  }

  private listen(): void {
    const { events } = this.world;
    events.on("ready", (manifest) => this.begin(manifest));
    events.on("generation", (manifest) => this.describe(manifest));
    events.on("failed", (error) => this.messages.fail(error));
    events.on("connection", (connection) => this.messages.connection(connection));
    addEventListener("online", () => this.world.retryNow());
    addEventListener("hashchange", () => this.readHash());
  }

  /** What the page says of a generation, and how near it can be seen. */
  private describe(manifest: Manifest): void {
    document.title = manifest.name ? `${manifest.name} · farfield` : "farfield";
    this.elements.credits.textContent = manifest.credits.join(" · ");
    this.camera.near = Math.max(0.01, manifest.grid.leafSize / 1000);
    this.camera.updateProjectionMatrix();
  }

  private begin(manifest: Manifest): void {
    this.describe(manifest);
    this.resize();
    const { view, bounds } = manifest;
    const home = (): Pose =>
      view ? { fov: DEFAULT_FOV, ...view } : overview(bounds.lower, bounds.upper, this.camera.aspect);
    // A camera that was set while the manifest was on its way stays.
    if (this.pose.eye[1] === -1 && this.pose.target[1] === 0) this.controls.set(home());
    this.readHash();
    const balloons = new Balloons(this.world, home());
    this.balloons = balloons;
    const { light, quality } = controlsOf(this);
    const flying = { label: "Balloons", on: () => balloons.visible, turn: (on: boolean) => void (balloons.visible = on) };
    this.panel = new Panel(this.elements.panel, {
      title: manifest.name || "farfield",
      light,
      quality: [...quality, flying],
      home: () => this.setPose(home()),
      share: () => void this.share(),
    });
    this.messages.opening(null);
    this.world.whenComplete().then(() => (this.firstPicture = performance.now()), () => undefined);
  }

  private tick(now: number): void {
    requestAnimationFrame((next) => this.tick(next));
    const start = performance.now();
    const seconds = Math.min(0.1, Math.max(0, now - this.last) / 1000);
    this.last = now;
    this.controls.step(seconds);
    this.balloons?.advance(start);
    this.resize();
    const rested = start >= this.restUntil && !this.timer.busy;
    if (this.world.update(this.camera, this.renderer, rested)) {
      this.renderer.render(this.scene, this.camera);
      this.frames++;
      this.timer.submitted(start);
      this.picking.follow(this.camera, this.world.matrixWorld);
      // While tiles come in, a slow card draws at most half of the time: decoding needs the machine too.
      this.restUntil = start + 2 * Math.max(this.timer.milliseconds, performance.now() - start);
    }
    if (start >= this.nextFigures) this.showFigures(start);
  }

  private resize(): void {
    const { canvas } = this.elements;
    const ratio = Math.min(devicePixelRatio, MOST_PIXELS_A_POINT);
    const [width, height] = [canvas.clientWidth, canvas.clientHeight];
    const known = canvas.width === Math.floor(width * ratio) && canvas.height === Math.floor(height * ratio);
    if (known || width === 0 || height === 0) return;
    this.renderer.setPixelRatio(ratio);
    this.renderer.setSize(width, height, false);
    this.camera.aspect = width / height;
    this.camera.updateProjectionMatrix();
  }

  private showFigures(now: number): void {
    this.nextFigures = now + FIGURES_MS;
    const { stats } = this;
    this.panel?.show(figuresOf(stats, stats.frame_ms, this.rate.at(now, stats.bytes)));
    const { progress } = this.elements;
    this.most = stats.tiles_pending === 0 ? 1 : Math.max(this.most, stats.tiles_pending);
    progress.hidden = stats.tiles_pending === 0 && this.firstPicture !== null;
    (progress.firstElementChild as HTMLElement).style.width = `${100 * (1 - stats.tiles_pending / this.most)}%`;
  }

  private rememberSoon(): void {
    clearTimeout(this.hashTimer);
    this.hashTimer = setTimeout(() => this.remember(), HASH_MS);
  }

  /** Keeps the view in the address. */
  private remember(): void {
    const { azimuth, elevation } = this.world.options.light;
    history.replaceState(null, "", writeHash({ pose: this.pose, sun: [azimuth, elevation], air: airOf(this.world.options) }));
  }

  private readHash(): void {
    const { pose, sun, air } = readHash(location.hash, DEFAULT_FOV);
    if (pose) this.controls.set(pose);
    this.world.setOptions(air);
    if (sun) this.world.setOptions({ light: { azimuth: sun[0], elevation: sun[1] } });
    this.panel?.refresh();
  }

  private async share(): Promise<void> {
    this.remember();
    await navigator.clipboard?.writeText(location.href).catch(() => undefined);
  }
}
