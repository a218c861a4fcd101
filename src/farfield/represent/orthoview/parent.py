"""Compositing: the view of a parent cell from the decoded views of its children, one direction at a time (OV 4.1)."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from farfield.geometry.color import BYTE_OF_LINEAR, LINEAR_OF_BYTE
from farfield.geometry.normals import DECODED
from farfield.kernels import composite as kernel
from farfield.kernels.gather import CANDIDATE, PLACE, gather
from farfield.represent.orthoview.layer import DEPTH_STEPS_PER_PIXEL, SEPARATION, OrthoLayer

SEPARATION_STEPS = SEPARATION * 2 * DEPTH_STEPS_PER_PIXEL
"""Child depth steps in SEPARATION parent pitches."""
BAYER = np.array([[0]])
for _ in range(3):
    BAYER = np.block([[4 * BAYER, 4 * BAYER + 2], [4 * BAYER + 3, 4 * BAYER + 1]])
"""(8, 8) int64, 0..63: thresholds of the ordered dither, by row and column modulo 8."""
BAND_BYTES = 4 << 20
"""Candidates are gathered for a band of parent rows at a time, so that they stay in the cache and memory stays flat."""


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
    most_in_a_row = 2 * sum(s.shape[1] for _, _, s in sources)
    step = max(1, min(rows, BAND_BYTES // (most_in_a_row * CANDIDATE.itemsize)))
    candidates = np.empty(step * most_in_a_row, CANDIDATE)
    scratch = np.empty((2, 4 * len(sources)), np.int64)
    for top in range(0, rows, step):
        band = surfaces[top : top + step]
        heads = np.full(band.shape[:2], -1, np.int32)
        used = 0
        for cell, index, layer in sources:
            used = _gather(layer, (cell, index), (x, y + top), candidates, used, heads)
        thresholds = np.roll(BAYER, (-(y + top) % 8, -x % 8), (0, 1))
        kernel.resolve(
            candidates, heads, scratch, SEPARATION_STEPS, thresholds, DECODED, LINEAR_OF_BYTE,
            BYTE_OF_LINEAR, band,
        )  # fmt: skip
    keeps_objects = any(layer.objects is not None for _, _, layer in sources)
    made = (_cropped(surfaces, n, x, y, keeps_objects) for n in range(layers))
    return [layer for layer in made if layer is not None]


_NO_OBJECTS = np.zeros((0, 0), np.uint32)


def _gather(
    layer: OrthoLayer,
    identity: tuple[int, int],
    corner: tuple[int, int],
    candidates: NDArray[np.void],
    used: int,
    heads: NDArray[np.int32],
) -> int:
    """Add a layer (identity: cell, index) to the band of parent pixels whose first one is `corner`, x and y."""
    top = layer.y - 2 * corner[1]
    if top >= 2 * heads.shape[0] or top + layer.shape[0] <= 0:
        return used
    place = np.array([(layer.x - 2 * corner[0], top, layer.depth_base, *identity)], PLACE)
    return int(
        gather(
            np.ascontiguousarray(layer.depth),
            np.ascontiguousarray(layer.color),
            np.ascontiguousarray(layer.normal),
            np.ascontiguousarray(layer.length),
            np.ascontiguousarray(layer.coverage),
            np.ascontiguousarray(layer.connected),
            _NO_OBJECTS if layer.objects is None else np.ascontiguousarray(layer.objects),
            place,
            candidates,
            used,
            heads,
        )
    )


def _cropped(surfaces: NDArray[np.void], index: int, x: int, y: int, keeps_objects: bool) -> OrthoLayer | None:
    """(rows, columns, layers) SURFACE -> one layer inside the rectangle of what is there; None when nothing is."""
    found = np.empty(6, np.int64)
    kernel.extent(surfaces, index, found)
    top, bottom, left, right, lowest, highest = found.tolist()
    if bottom < 0:
        return None
    if highest - lowest >= np.iinfo(np.uint16).max:
        raise ValueError("the depths of a view span more than 65535 steps")
    shape = (bottom - top + 1, right - left + 1)
    layer = OrthoLayer(
        x=x + left,
        y=y + top,
        depth_base=lowest - 1,
        depth=np.zeros(shape, np.uint16),
        color=np.zeros((*shape, 3), np.uint8),
        normal=np.zeros((*shape, 2), np.uint8),
        length=np.full(shape, 8, np.uint8),
        coverage=np.zeros(shape, np.uint8),
        connected=np.zeros(shape, np.uint8),
        objects=np.zeros(shape, np.uint32) if keeps_objects else None,
    )
    kernel.separate(
        surfaces, index, top, left, layer.depth_base, layer.depth, layer.color, layer.normal, layer.length,
        layer.coverage, layer.connected, _NO_OBJECTS if layer.objects is None else layer.objects,
    )  # fmt: skip
    return layer
