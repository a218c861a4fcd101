"""Images of instances from round about, as things to send (BEN 4.1; spec/world.md, Instances)."""

from __future__ import annotations

from collections.abc import Collection, Iterator

import numpy as np
from numpy.typing import NDArray

from farfield.represent.geometry.board import squareness
from farfield.stream.outlook import Outlook
from farfield.stream.tree import CellTree, CellValues
from farfield.world.index import MESH_FARTHEST, MOST_SIDES

Floats = NDArray[np.float64]


def board_offers(
    tree: CellTree,
    instances: NDArray[np.int64],
    uses: NDArray[np.int64],
    outlook: Outlook,
    drawn: NDArray[np.bool_],
    widths: Floats,
    held: Collection[str],
    fine: float,
) -> Iterator[tuple[CellValues, list[int], Floats]]:
    """The sides that instances will be seen from, and those that are there; each with what it shows, and how well.

    As sharp as an image is, and seen as squarely (BEN 4.1); the rest is the error that the bake measured. instances:
    (n,) rows of the tree's, by mesh. uses: (n,) their rows in the outlook. drawn: (n, k) whether they may be in each
    interval. widths: (n, k) metres that a pixel is wide there. held: keys that are there. fine: how much the first
    counts for. All at once: one by one a look at 216 instances took 55 ms, so 12, and 6 without any.
    """
    listed, table = tree.instances, tree.instances.boards
    first, count = table.first[listed.mesh[instances]], np.diff(table.first)[listed.mesh[instances]]
    # Pairs of an instance and an impostor of its mesh, by impostor.
    row = np.repeat(np.arange(len(instances)), count)
    which = np.repeat(first - np.cumsum(count) + count, count) + np.arange(len(row))
    order = np.argsort(which, kind="stable")
    row, which = row[order], which[order]
    if not len(row):
        return
    azimuth, level = _sights(tree, instances, outlook)
    azimuth, level, pixel = azimuth[row], level[row], widths[row]
    errors = tree.errors_at(table.told[which], pixel, MESH_FARTHEST)
    sharp = np.minimum(table.rows[which, None] / np.maximum(outlook.height[uses[row]], 1e-9), 1.0)
    shown = np.where(drawn[row], (1 - fine) * (1 - errors) + fine * sharp, 0.0)
    sides = table.sides[which, None]
    nearest = np.rint(azimuth * sides / (2 * np.pi)).astype(np.int64) % sides
    codes = (which[:, None] * MOST_SIDES + nearest)[outlook.visible[uses[row]] > 0]
    there = [table.places[key] for key in held if key in table.places]
    present = set(which.tolist())
    codes = np.unique(np.append(codes, [code for code in there if code // MOST_SIDES in present]).astype(np.int64))
    # Each side with all pairs of its impostor.
    begins, ends = (np.searchsorted(which, codes // MOST_SIDES, side) for side in ("left", "right"))
    length = ends - begins
    place = np.repeat(begins - np.cumsum(length) + length, length) + np.arange(int(length.sum()))
    turned = azimuth[place] - np.repeat(codes % MOST_SIDES, length)[:, None] * (2 * np.pi / sides[place])
    accuracy = shown[place] * squareness(level[place] * np.cos(turned))
    objects, stops = uses[row[place]].tolist(), np.cumsum(length).tolist()
    for code, begin, end in zip(codes.tolist(), [0, *stops], stops, strict=False):
        value = table.values[code // MOST_SIDES][code % MOST_SIDES]
        yield value, objects[begin:end], accuracy[begin:end]


def _sights(tree: CellTree, instances: NDArray[np.int64], outlook: Outlook) -> tuple[Floats, Floats]:
    """(n, k) azimuth, and cosine of the elevation, of the eyes from the middles of instances, in their meshes' frames.

    The cosine is 0 where an instance is flat.
    """
    listed = tree.instances
    inverse, middles = listed.inverse[instances], listed.boxes[listed.mesh[instances]].mean(axis=1)
    towards = np.einsum("nij,kj->nki", inverse[:, :, :3], outlook.eyes) + (inverse[:, :, 3] - middles)[:, None]
    across = np.hypot(towards[..., 0], towards[..., 1])
    level = across / np.maximum(np.hypot(across, towards[..., 2]), 1e-12)
    level[~inverse[:, :, :3].any(axis=(1, 2))] = 0.0
    return np.arctan2(towards[..., 1], towards[..., 0]), level
