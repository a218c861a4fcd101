import { DataTexture, RedIntegerFormat, UnsignedIntType, Vector3 } from "three";
import type { Cell } from "../core/cell.js";
import type { Grid } from "../core/grid.js";
import { HOLE, HoleTable, type Holes } from "../core/holes.js";
import type { Vector3 as Triple } from "../core/vector.js";
import { relativeTo } from "./viewpoint.js";

/** As holes.glsl has it. */
const TABLE_WIDTH = 1024;

/** The holes of all cells that one kind of thing stands in for, as shaders look them up (shaders/holes.glsl). */
export class HoleTexture {
  /** What all draw calls share. */
  readonly uniforms;
  private table = new HoleTable();

  constructor(grid: Grid) {
    this.uniforms = { holes: { value: textureOf(new Uint32Array(TABLE_WIDTH)) }, axisLevels: { value: Int32Array.from(grid.axisLevels) } };
  }

  /** Forgets the holes added so far. */
  clear(): void {
    this.table = new HoleTable();
  }

  /** Adds the holes of a cell; returns what the shader finds them by. */
  add(holes: Holes): number {
    return this.table.add(holes);
  }

  /** Takes what has been added to the graphics card. */
  upload(): void {
    const { words } = this.table;
    const { holes } = this.uniforms;
    const rows = Math.ceil(words.length / TABLE_WIDTH);
    if (holes.value.image.height < rows) {
      holes.value.dispose();
      holes.value = textureOf(new Uint32Array(TABLE_WIDTH * rows * 2));
    }
    (holes.value.image.data as unknown as Uint32Array).set(words);
    if (words.length > 8) holes.value.needsUpdate = true;
  }

  dispose(): void {
    this.uniforms.holes.value.dispose();
  }
}

/** What one draw call looks its holes up by. */
export function holeUniforms() {
  return {
    holeNode: { value: HOLE as number },
    cellLower: { value: new Vector3() },
    cellSize: { value: new Vector3() },
    cellLevel: { value: 0 },
  };
}

/** Sets them for a cell, seen from an eye, whose holes were added so. */
export function setHoles(uniforms: ReturnType<typeof holeUniforms>, { box, level }: Cell, holeNode: number, eye: Triple): void {
  uniforms.holeNode.value = holeNode;
  if (holeNode === HOLE) return;
  const { lower, size } = relativeTo(eye, box);
  uniforms.cellLower.value.set(...lower);
  uniforms.cellSize.value.set(...size);
  uniforms.cellLevel.value = level;
}

function textureOf(words: Uint32Array): DataTexture {
  const texture = new DataTexture(words, TABLE_WIDTH, words.length / TABLE_WIDTH, RedIntegerFormat, UnsignedIntType);
  texture.internalFormat = "R32UI";
  texture.needsUpdate = true;
  return texture;
}
