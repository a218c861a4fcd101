"""Orthoviews of a leaf, drawn from its triangles (OV 4.1): one direction, one or two depth layers."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from farfield.errors import OptionError
from farfield.geometry.directions import Direction
from farfield.kernels.lanes import LANES
from farfield.kernels.project import lattice_bounds, project_orthographic
from farfield.kernels.quantise import quantise
from farfield.kernels.resolve import PLANES, resolve
from farfield.octree.grid import CellKey, Grid
from farfield.represent.chunk import Chunk
from farfield.represent.materials import MaterialTable
from farfield.represent.orthoview.layer import (
    COVERAGE_STEPS,
    DEPTH_STEPS_PER_PIXEL,
    LENGTH_STEPS,
    SEPARATION,
    OrthoLayer,
)
from farfield.represent.orthoview.visibility import floats, nearest_surface, scratched, surface_behind


@dataclass(frozen=True, slots=True)
class _Frame:
    """The rectangle of the lattice that the chunk covers, and the chunk in it."""

    x: int
    y: int
    width: int
    height: int
    depth: int
    """Whole pitches from the grid's corner that screen depths are measured from."""
    screen: NDArray[np.float32]
    """(n, 4) float32, as `rasterise` takes it; z in pitches."""
    axes: NDArray[np.float32]


def draw_leaf(
    chunk: Chunk,
    materials: MaterialTable,
    grid: Grid,
    key: CellKey,
    direction: Direction,
    samples: int = 2,
    layers: int = 2,
) -> list[OrthoLayer]:
    """The layers of one view of a cell, nearest first; empty when no sample is covered.

    chunk: triangles relative to the lower corner of the cell; its material numbers refer to `materials`.
    samples: 1 to 8 samples along each side of a pixel.
    layers: 1 or 2; the second holds a surface more than SEPARATION pitches behind the first, see `visibility`.
    `connected` is left 0 but for the unlit bit. Raises OptionError for other values of samples or layers.
    """
    if not 1 <= samples <= 8 or layers not in (1, 2):
        raise OptionError("samples must be 1 to 8 and layers 1 or 2", f"samples {samples}, layers {layers}")
    if len(chunk.triangles) == 0:
        return []
    if int(chunk.materials.max()) >= len(materials) or int(chunk.triangles.max()) >= len(chunk.positions):
        raise OptionError("a triangle refers to a material or corner that is not there", str(key))
    frame = _frame(chunk, grid, key, direction, samples)
    if frame is None:
        return []
    drawn: list[OrthoLayer] = []
    shape = (frame.height * samples, frame.width * samples)
    depth, ids = nearest_surface(frame.screen, chunk, materials, shape)
    for number in range(layers):
        wanted = number + 1 < layers
        behind = floats("behind", (shape[0], shape[1] + LANES) if wanted else (0, 0))
        pixels = floats("pixels", (frame.height, frame.width, PLANES))
        objects = scratched("objects", (frame.height, frame.width), np.dtype(np.uint32))
        valid = resolve(
            frame.screen, chunk.surface, materials.arrays, frame.axes, samples, SEPARATION, depth, ids, behind, pixels,
            objects,
        )  # fmt: skip
        if valid == 0:
            break
        drawn.append(_layer(frame, pixels, objects))
        if wanted:
            depth, ids = surface_behind(frame.screen, chunk, materials, shape, behind)
    return drawn


def _frame(chunk: Chunk, grid: Grid, key: CellKey, direction: Direction, samples: int) -> _Frame | None:
    """Corners on the lattice, in float64: far from the grid's corner single precision cannot tell pixels apart."""
    pitch = grid.pitch(key.level)
    lower = np.array(key[1:], dtype=np.float64) * (grid.cell_size(key.level) / pitch)
    matrix = np.concatenate([direction.axes / pitch, (direction.axes * lower).sum(1)[:, None]], axis=1)
    bounds = np.empty((2, 3))
    lattice_bounds(chunk.positions, matrix, bounds)
    if not np.isfinite(bounds).all():
        raise OptionError("a corner is not finite", str(key))
    first = np.floor(bounds[0])
    width, height, _ = (int(v) for v in np.ceil(bounds[1]) - first)
    if width == 0 or height == 0:
        return None
    screen = np.empty((len(chunk.positions), 4), dtype=np.float32)
    project_orthographic(chunk.positions, matrix, first, samples, screen)
    x, y, depth = (int(v) for v in first)
    return _Frame(x, y, width, height, depth, screen, direction.axes.astype(np.float32))


def _layer(frame: _Frame, pixels: NDArray[np.float32], objects: NDArray[np.uint32]) -> OrthoLayer:
    shape = pixels.shape[:2]
    steps = np.empty(shape, dtype=np.int32)
    color, normal = np.empty((*shape, 3), dtype=np.uint8), np.empty((*shape, 2), dtype=np.uint8)
    length, coverage, flags = (np.empty(shape, dtype=np.uint8) for _ in range(3))
    quantise(pixels, DEPTH_STEPS_PER_PIXEL, COVERAGE_STEPS, LENGTH_STEPS, steps, color, normal, length, coverage, flags)
    valid = coverage > 0
    rows, columns = np.flatnonzero(valid.any(1)), np.flatnonzero(valid.any(0))
    box = (slice(rows[0], rows[-1] + 1), slice(columns[0], columns[-1] + 1))
    inside = valid[box]
    base = int(steps[box][inside].min()) - 1
    return OrthoLayer(
        x=frame.x + int(columns[0]),
        y=frame.y + int(rows[0]),
        depth_base=frame.depth * DEPTH_STEPS_PER_PIXEL + base,
        depth=np.where(inside, steps[box] - base, 0).astype(np.uint16),
        color=color[box].copy(),
        normal=normal[box].copy(),
        length=length[box].copy(),
        coverage=coverage[box].copy(),
        connected=flags[box].copy(),
        objects=objects[box].copy(),
    )
