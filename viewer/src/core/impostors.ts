import { errorAt } from "./cellforms.js";
import { MESH_FARTHEST, type Impostor, type InstancedMesh } from "./indextile.js";
import type { Instance, PlacedMesh } from "./instances.js";
import type { DynamicImpostor } from "./keys.js";
import type { Resource } from "./resource.js";
import { toldBy } from "./stream/accuracy.js";
import { cross, dot, type Vector3 } from "./vector.js";

/** Sine of 60 degrees: seen at that angle to its plane, or more squarely, a board is as good as head on. */
const FULL_SINE = Math.sqrt(0.75);
/** Of the product of its columns' lengths, up to which the determinant of a matrix is none. */
const SINGULAR = 1e-12;

/** A shared mesh by its images from round about. */
export interface ImpostorForm {
  readonly entry: Impostor;
  /** How unlike the full mesh it looks, 0 to 1, as Impostor.errors: `errorAt` tells it, with MESH_FARTHEST. */
  readonly told: readonly number[];
  /** One of each image, then those that a server has made on demand. */
  readonly boards: Board[];
}

/** An image of a mesh from a side, and where it stands. */
export interface Board {
  /** The image; drawn in the mesh's place. */
  readonly mesh: Resource;
  /** Unit vector from the middle of the mesh to the eyes that it is shown to, in the mesh's frame. */
  readonly towards: Vector3;
  /**
   * (16,) columns first, to the mesh's frame from that of a board that is 1 wide and 1 high: from its middle x to the right as the eye
   * sees it, y towards the eye, z up the image. It is left-handed.
   */
  readonly transform: Float64Array;
}

/** Boards of an impostor that are there. */
export interface HeldBoards {
  readonly told: readonly number[];
  readonly boards: readonly Board[];
}

/** Unit vector from the middle of an instance to an eye, in its mesh's frame; zeros where nothing is to be seen of it. */
export type Sight = Vector3;

/** The resource of an image. */
type Take = (hash: string, bytes: number) => Resource;

/** What the index tells of the images of a mesh with such bounds. */
export function impostorForm(entry: Impostor, bounds: InstancedMesh["bounds"], take: Take): ImpostorForm {
  const { errors, images } = entry;
  const boards = images.map(([hash, bytes], side) => boardOf(bounds, take(hash, bytes), (2 * Math.PI * side) / images.length, 0));
  return { entry, told: errors?.length ? toldBy(errors) : [0, 0, 0], boards };
}

/** An image of a mesh with such bounds, as it is seen from an azimuth and an elevation, radians. */
export function boardOf(bounds: InstancedMesh["bounds"], mesh: Resource, azimuth: number, elevation: number): Board {
  return { mesh, towards: directionOf(azimuth, elevation), transform: boardTransform(bounds, azimuth, elevation) };
}

function directionOf(azimuth: number, elevation: number): Vector3 {
  const level = Math.cos(elevation);
  return [level * Math.cos(azimuth), level * Math.sin(azimuth), Math.sin(elevation)];
}

/** See Board; a body that is lit like it is as deep as it is wide. The twin of `board_matrix`. */
export function boardTransform([lower, upper]: InstancedMesh["bounds"], azimuth: number, elevation: number): Float64Array {
  const size = [0, 1, 2].map((a) => upper[a]! - lower[a]!);
  const middle = [0, 1, 2].map((a) => (lower[a]! + upper[a]!) / 2);
  const towards = directionOf(azimuth, elevation);
  const right: Vector3 = [-Math.sin(azimuth), Math.cos(azimuth), 0];
  const up = cross(towards, right);
  const across = (axis: Vector3): number => axis.reduce((sum, part, a) => sum + Math.abs(part) * size[a]!, 0);
  const [width, height] = [across(right), across(up)];
  const column = (axis: Vector3, length: number): number[] => [...axis.map((part) => part * length), 0];
  return Float64Array.of(...column(right, width), ...column(towards, width), ...column(up, height), ...middle, 1);
}

/** Parts of a turn, and of half a turn from straight below to straight above, that images are made on demand for. */
const TURNS = 16;
const TILTS = 8;

/** The same of an image that a server has made on demand. */
export function dynamicBoard(bounds: InstancedMesh["bounds"], mesh: Resource, { turn, tilt }: DynamicImpostor): Board {
  return boardOf(bounds, mesh, (2 * Math.PI * turn) / TURNS, Math.PI * (tilt / TILTS - 0.5));
}

/** Of a mesh, as far as any board of theirs is there. */
export function heldBoards(impostors: readonly ImpostorForm[]): readonly HeldBoards[] {
  const held = impostors.map(({ told, boards }) => ({ told, boards: boards.filter(({ mesh }) => mesh.held) }));
  return held.filter(({ boards }) => boards.length > 0);
}

/** Those that are on their way. */
export function comingBoards(impostors: readonly ImpostorForm[]): readonly Board[] {
  return impostors.flatMap(({ boards }) => boards.filter(({ mesh }) => mesh.coming));
}

/** Sine of the angle between a board and the line of sight; below 0 from behind. */
function sineOf({ towards }: Board, sight: Sight): number {
  return dot(towards, sight);
}

/** How much of its mesh a board shows for the angle alone: the cube of its sine over that of 60 degrees, from 0 (behind it) to 1. */
export function squareness(board: Board, sight: Sight): number {
  const sine = Math.min(Math.max(sineOf(board, sight), 0), FULL_SINE) / FULL_SINE;
  return sine * sine * sine;
}

/**
 * The board by which most of an instance is seen, of those that show more of it than `least`, and how much that is; null, and `least`: none
 * does. pitch: metres between the pixels of a leaf's pictures. width: metres that a pixel is wide there.
 */
export function bestShown(held: readonly HeldBoards[], sight: Sight, pitch: number, width: number, least: number): readonly [Board | null, number] {
  let [best, most]: [Board | null, number] = [null, least];
  for (const form of held) {
    const like = 1 - errorAt(form, pitch, width, MESH_FARTHEST);
    if (like <= most) continue;
    // Of several that are as good as head on the one that is seen most squarely.
    const board = form.boards.reduce((one, other) => (sineOf(other, sight) > sineOf(one, sight) ? other : one));
    const shown = like * squareness(board, sight);
    if (shown > most) [best, most] = [board, shown];
  }
  return [best, most];
}

/** For each instance of a mesh with boards: where its middle is, local metres, and three rows of three from there to the mesh's frame. */
const views = new WeakMap<Instance, Float64Array | null>();

/** How an eye sees an instance of a mesh that has boards. */
export function sightOf(placed: PlacedMesh, instance: Instance, eye: Vector3): Sight {
  let view = views.get(instance);
  if (view === undefined) views.set(instance, (view = viewOf(placed, instance)));
  if (view === null) return [0, 0, 0];
  const [x, y, z] = [eye[0] - view[0]!, eye[1] - view[1]!, eye[2] - view[2]!];
  const toX = view[3]! * x + view[4]! * y + view[5]! * z;
  const toY = view[6]! * x + view[7]! * y + view[8]! * z;
  const toZ = view[9]! * x + view[10]! * y + view[11]! * z;
  const length = Math.sqrt(toX * toX + toY * toY + toZ * toZ);
  return length > 0 ? [toX / length, toY / length, toZ / length] : [0, 0, 0];
}

/** Null: the transform makes the mesh flat, so that nothing of it is seen from any side, or could be told. */
function viewOf({ corner, impostors }: PlacedMesh, { transform: m }: Instance): Float64Array | null {
  const [mx = 0, my = 0, mz = 0] = impostors[0]!.boards[0]!.transform.subarray(12);
  const [a, b, c] = [0, 4, 8].map((n) => [m[n]!, m[n + 1]!, m[n + 2]!] as Vector3) as [Vector3, Vector3, Vector3];
  const cofactors = [cross(b, c), cross(c, a), cross(a, b)] as const;
  const volume = dot(a, cofactors[0]);
  if (!(Math.abs(volume) > SINGULAR * Math.hypot(...a) * Math.hypot(...b) * Math.hypot(...c))) return null;
  const middle = [0, 1, 2].map((n) => corner[n]! + m[12 + n]! + a[n]! * mx + b[n]! * my + c[n]! * mz);
  return Float64Array.from([...middle, ...cofactors.flatMap((row) => row.map((part) => part / volume))]);
}

/** What is drawn of single instances, by a board or (null) as they are: the same from plan to plan. */
const alone = new WeakMap<Instance, Map<Board | null, PlacedMesh>>();

/** One of the instances that are placed, by itself: as a board stands in its place or, null, as it is. */
export function placedAlone(placed: PlacedMesh, instance: Instance, board: Board | null): PlacedMesh {
  const known = alone.get(instance) ?? new Map<Board | null, PlacedMesh>();
  alone.set(instance, known);
  const found = known.get(board) ?? { ...placed, instances: [board ? onBoard(instance, board) : instance], bounds: instance.bounds };
  known.set(board, found);
  return found;
}

function onBoard(instance: Instance, { transform: board }: Board): Instance {
  const { transform: own } = instance;
  const at = (row: number, column: number): number => [0, 1, 2, 3].reduce((sum, k) => sum + own[row + 4 * k]! * board[k + 4 * column]!, 0);
  return { ...instance, transform: Float32Array.from({ length: 16 }, (_, n) => at(n % 4, Math.floor(n / 4))) };
}
