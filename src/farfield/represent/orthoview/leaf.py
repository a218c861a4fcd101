"""Orthoviews of a leaf, drawn from its triangles (OV 4.1): one direction, one or two depth layers."""

from __future__ import annotations

import threading
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from farfield.errors import OptionError
from farfield.geometry.directions import Direction
from farfield.kernels.lanes import LANES
from farfield.kernels.project import lattice_bounds, mean_area, project_orthographic
from farfield.kernels.quantise import quantise
from farfield.kernels.rasterise import TILE, rasterise
from farfield.kernels.rasterise_key import EMPTY, rasterise_key, unpack_keys
from farfield.kernels.resolve import PLANES, resolve
from farfield.kernels.surface import FAR, NOTHING
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

KEY_BELOW = 32.0
"""Mean area of a triangle in samples: below this the 64-bit-key rasteriser is the faster one. Measured, key against
visibility buffer: 55 to 84 ms for a million leaves of 4 samples, 9 to 11 ms for 82,000 triangles of a statue of 18,
12 to 10 ms for 20,000 faces of a city of 440."""

SORT_FROM = 20_000
"""Triangles: from here on sorting them pays. A pass over 1 M leaves of a forest took 620 ms without, 400 with."""

_scratch = threading.local()


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
    layers: 1 or 2; the second holds the nearest surface more than SEPARATION pitches behind the first.
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
    behind: NDArray[np.float32] = np.empty((0, 0), dtype=np.float32)
    order = _front_to_back(frame, chunk)
    for number in range(layers):
        depth, ids = _visible(frame, chunk, materials, behind, order, samples)
        wanted = number + 1 < layers
        behind = _floats("behind", (depth.shape[0], depth.shape[1] + LANES)) if wanted else behind[:0, :0]
        pixels = _floats("pixels", (frame.height, frame.width, PLANES))
        objects = _scratched("objects", (frame.height, frame.width), np.dtype(np.uint32))
        valid = resolve(
            frame.screen, chunk.surface, materials.arrays, frame.axes, samples, SEPARATION, depth, ids, behind, pixels,
            objects,
        )  # fmt: skip
        if valid == 0:
            break
        drawn.append(_layer(frame, pixels, objects))
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


def _visible(
    frame: _Frame,
    chunk: Chunk,
    materials: MaterialTable,
    behind: NDArray[np.float32],
    order: NDArray[np.uint32],
    samples: int,
) -> tuple[NDArray[np.float32], NDArray[np.uint32]]:
    shape = (frame.height * samples, frame.width * samples)
    depth, ids = _floats("depth", shape), _scratched("ids", shape, np.dtype(np.uint32))
    if mean_area(frame.screen, chunk.triangles, 1 + len(chunk.triangles) // 4096) < KEY_BELOW:
        keys = _scratched("keys", (shape[0], shape[1] + LANES), np.dtype(np.int64))
        keys.fill(EMPTY)
        rasterise_key(frame.screen, chunk.surface, materials.arrays, behind, keys)
        unpack_keys(keys, depth, ids)
    else:
        depth.fill(FAR)
        ids.fill(NOTHING)
        tiles = (-(-shape[0] // TILE), -(-shape[1] // TILE)) if len(order) else (0, 0)
        farthest = _floats("farthest", tiles)
        rasterise(frame.screen, chunk.surface, materials.arrays, behind, order, farthest, depth, ids)
    return depth, ids


def _front_to_back(frame: _Frame, chunk: Chunk) -> NDArray[np.uint32]:
    """(m,) uint32: the triangles by their nearest corner; (0,) where they are few."""
    if len(chunk.triangles) < SORT_FROM:
        return np.empty(0, dtype=np.uint32)
    z = frame.screen[:, 2]
    a, b, c = (z[chunk.triangles[:, k]] for k in range(3))
    nearest = np.minimum(np.minimum(a, b), c)
    low = nearest.min()
    # 16 bits are sorted by radix: 12 ms a million where floats take 100.
    steps = ((nearest - low) * (65535 / max(float(nearest.max() - low), 1e-9))).astype(np.uint16)
    return np.argsort(steps, kind="stable").astype(np.uint32)


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


def _floats(name: str, shape: tuple[int, ...]) -> NDArray[np.float32]:
    return _scratched(name, shape, np.dtype(np.float32))


def _scratched(name: str, shape: tuple[int, ...], dtype: np.dtype[Any]) -> NDArray[Any]:
    """A scratch array of this thread, contents undefined: fresh pages for every view would cost 5 ms of faults."""
    count = int(np.prod(shape))
    held: NDArray[Any] | None = getattr(_scratch, name, None)
    if held is None or held.size < count:
        held = np.empty(count, dtype=dtype)
        setattr(_scratch, name, held)
    return held[:count].reshape(shape)
