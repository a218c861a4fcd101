"""Compositing: the view of a parent cell from the decoded views of its children, one direction at a time (OV 4.1)."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from farfield.geometry.color import BYTE_OF_LINEAR, LINEAR_OF_BYTE
from farfield.geometry.normals import DECODED
from farfield.kernels import composite as kernel
from farfield.represent.orthoview.layer import DEPTH_STEPS_PER_PIXEL, SEPARATION, OrthoLayer
from farfield.represent.orthoview.tile import UNLIT_BIT

SEPARATION_STEPS = SEPARATION * 2 * DEPTH_STEPS_PER_PIXEL
"""Child depth steps in SEPARATION parent pitches."""
BAYER = np.array([[0]])
for _ in range(3):
    BAYER = np.block([[4 * BAYER, 4 * BAYER + 2], [4 * BAYER + 3, 4 * BAYER + 1]])
"""(8, 8) int64, 0..63: thresholds of the ordered dither, by row and column modulo 8."""
BAND_BYTES = 8 << 20
"""Candidates are gathered for a band of parent rows at a time, so that they stay in the cache and memory stays flat."""


@dataclass(frozen=True, slots=True)
class _Band:
    """Rows of parent pixels worked on at once."""

    x: int
    y: int
    candidates: NDArray[np.void]
    counts: NDArray[np.int32]


def composite(children: Sequence[Sequence[OrthoLayer]], layers: int) -> list[OrthoLayer]:
    """The 0 to `layers` (1 or 2) layers of the parent, nearest first, cropped; connectivity is not yet marked.

    children: for each child cell, in ascending order of keys, its decoded layers of one direction, the nearer first,
    all on the lattice of the child level. Parent pixel (i, j) covers child pixels (2i..2i+1, 2j..2j+1), and the
    parent's depth step is twice the child's. When all child pixels of a parent pixel lie within SEPARATION parent
    pitches, they become one surface. Otherwise two layers divide them at the largest gap in depth; a single layer
    keeps those within SEPARATION of the nearest. Coverage is dithered, so that a surface of less than a sixteenth is
    left out here and there, and a view of nothing else may come out empty. Object ids are kept when any child has
    them. Raises ValueError when depths span more than 16 bits.
    """
    sources = [(cell, index, layer) for cell, stack in enumerate(children) for index, layer in enumerate(stack)]
    if not sources:
        return []
    x = min(s.x >> 1 for _, _, s in sources)
    y = min(s.y >> 1 for _, _, s in sources)
    columns = max((s.x + s.shape[1] + 1) >> 1 for _, _, s in sources) - x
    rows = max((s.y + s.shape[0] + 1) >> 1 for _, _, s in sources) - y
    surfaces = np.zeros((rows, columns, layers), kernel.SURFACE)
    capacity = 4 * len(sources)
    step = max(1, min(rows, BAND_BYTES // (columns * capacity * kernel.CANDIDATE.itemsize)))
    candidates = np.empty((step, columns, capacity), kernel.CANDIDATE)
    for top in range(0, rows, step):
        band = _Band(x, y + top, candidates[: rows - top], np.zeros((min(step, rows - top), columns), np.int32))
        for cell, index, layer in sources:
            _gather(band, cell, index, layer)
        kernel.resolve(
            band.candidates, band.counts, SEPARATION_STEPS, np.roll(BAYER, (-band.y % 8, -band.x % 8), (0, 1)),
            DECODED, LINEAR_OF_BYTE, BYTE_OF_LINEAR, surfaces[top : top + step],
        )  # fmt: skip
    keeps_objects = any(layer.objects is not None for _, _, layer in sources)
    made = (_cropped(surfaces[..., n], x, y, keeps_objects) for n in range(layers))
    return [layer for layer in made if layer is not None]


_NO_OBJECTS = np.zeros((0, 0), np.uint32)


def _gather(band: _Band, cell: int, index: int, layer: OrthoLayer) -> None:
    top = layer.y - 2 * band.y
    if top >= 2 * band.counts.shape[0] or top + layer.shape[0] <= 0:
        return
    place = np.array([(layer.x - 2 * band.x, top, layer.depth_base, cell, index)], kernel.PLACE)
    kernel.gather(
        np.ascontiguousarray(layer.depth),
        np.ascontiguousarray(layer.color),
        np.ascontiguousarray(layer.normal),
        np.ascontiguousarray(layer.length),
        np.ascontiguousarray(layer.coverage),
        np.ascontiguousarray(layer.connected),
        _NO_OBJECTS if layer.objects is None else np.ascontiguousarray(layer.objects),
        place,
        band.candidates,
        band.counts,
    )


def _cropped(surfaces: NDArray[np.void], x: int, y: int, keeps_objects: bool) -> OrthoLayer | None:
    """(rows, columns) SURFACE -> the layer inside the bounding rectangle of what is there; None when nothing is."""
    valid = surfaces["coverage"] > 0
    used_rows, used_columns = np.flatnonzero(valid.any(1)), np.flatnonzero(valid.any(0))
    if used_rows.size == 0:
        return None
    top, left = int(used_rows[0]), int(used_columns[0])
    cut = (slice(top, int(used_rows[-1]) + 1), slice(left, int(used_columns[-1]) + 1))
    surfaces, valid = surfaces[cut], valid[cut]
    depths = surfaces["depth"]
    base = int(depths[valid].min()) - 1
    if int(depths[valid].max()) - base > np.iinfo(np.uint16).max:
        raise ValueError("the depths of a view span more than 65535 steps")
    return OrthoLayer(
        x=x + left,
        y=y + top,
        depth_base=base,
        depth=np.where(valid, depths - base, 0).astype(np.uint16),
        color=np.stack([surfaces["r"], surfaces["g"], surfaces["b"]], -1),
        normal=np.stack([surfaces["normal0"], surfaces["normal1"]], -1),
        length=np.where(valid, surfaces["length"], 8).astype(np.uint8),
        coverage=np.ascontiguousarray(surfaces["coverage"]),
        connected=surfaces["unlit"] * np.uint8(UNLIT_BIT),
        objects=np.ascontiguousarray(surfaces["objects"]) if keeps_objects else None,
    )
