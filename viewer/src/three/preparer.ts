import type { WebGLRenderer } from "three";
import type { DecodePool } from "../core/decode/pool.js";
import { corrupt } from "../core/errors.js";
import type { Prepared, Preparer } from "../core/loader.js";
import type { Manifest } from "../core/manifest.js";
import type { Resource } from "../core/resource.js";
import { anisotropyOf } from "./card.js";
import type { BlockMapHandle, BlockMaps } from "./blockmaps.js";
import { boardModel } from "./near/board.js";
import type { NearModel } from "./near/model.js";
import { parseNearModel } from "./near/parse.js";
import { cutoutOf, type TextureShelf } from "./near/textures.js";
import { OrthoviewTile, tileBytes } from "./orthoviewtile.js";

export interface PreparerParts {
  readonly manifest: Manifest;
  readonly pool: DecodePool;
  readonly shelf: TextureShelf;
  /** The renderer that draws; asked for when something is uploaded. */
  readonly renderer: () => WebGLRenderer;
  /** Whether pixels in a plane are joined. */
  readonly patches: () => boolean;
  readonly blockmaps: BlockMaps;
  /** Told before a model of near geometry goes. */
  readonly forget: (model: NearModel) => void;
}

/** Turns the world's values into what the graphics card draws. */
export class ThreePreparer implements Preparer {
  /** Splats of all tiles on the graphics card. */
  splats = 0;

  constructor(private readonly parts: PreparerParts) {}

  prepare(resource: Resource, bytes: Uint8Array, signal: AbortSignal): Promise<Prepared> {
    if (resource.kind === "orthoview") return this.orthoview(resource, bytes, signal);
    if (resource.kind === "blockmap") return this.blockmap(resource, bytes, signal);
    const isBoard = resource.kind === "impostor";
    return this.prepared(isBoard ? this.board(resource, bytes, signal) : parseNearModel(bytes, resource.key, this.parts.shelf));
  }

  expects({ key, cell, images }: Resource): void {
    const form = cell?.forms.find(({ leaf }) => leaf.key === key);
    for (const [hash] of form?.entry.textures ?? images) this.parts.shelf.expect(hash);
  }

  dispose(resource: Resource, payload: unknown): void {
    if (resource.kind === "orthoview") {
      this.splats -= (payload as OrthoviewTile).count;
      (payload as OrthoviewTile).dispose(this.parts.renderer());
      return;
    }
    if (resource.kind === "blockmap") return this.parts.blockmaps.drop(payload as BlockMapHandle);
    this.parts.forget(payload as NearModel);
    (payload as NearModel).dispose();
  }

  private async orthoview(resource: Resource, bytes: Uint8Array, signal: AbortSignal): Promise<Prepared> {
    const tile = await this.parts.pool.decode(this.parts.patches() ? "orthoview" : "splats", bytes, resource.key, signal);
    const { manifest, renderer } = this.parts;
    const direction = manifest.directions.get(tile.direction);
    if (!direction || tile.level !== resource.cell?.level) throw corrupt("the tile belongs to another cell", resource.key);
    const install = (): OrthoviewTile => {
      this.splats += tile.count;
      return new OrthoviewTile(renderer(), tile, manifest.grid, direction);
    };
    return { size: tileBytes(tile), install };
  }

  private async blockmap({ key, cell }: Resource, bytes: Uint8Array, signal: AbortSignal): Promise<Prepared> {
    const { lower, upper } = cell!.box;
    const map = await this.parts.pool.decode("blockmap", bytes, key, signal, [upper[0] - lower[0], upper[1] - lower[1]]);
    return { size: this.parts.blockmaps.bytesOf(map), install: () => this.parts.blockmaps.upload(map) };
  }

  private async board({ key }: Resource, bytes: Uint8Array, signal: AbortSignal): Promise<NearModel> {
    const { pool, renderer } = this.parts;
    return boardModel(await cutoutOf(pool, bytes, key, signal), anisotropyOf(renderer()));
  }

  private async prepared(made: Promise<NearModel>): Promise<Prepared> {
    const model = await made;
    return { size: model.bytes, install: () => model, discard: () => model.dispose() };
  }
}
