"""Images of instances from round about, as things to send (BEN 4.1; spec/world.md, Instances)."""

from __future__ import annotations

from collections.abc import Collection, Iterator

import numpy as np
from numpy.typing import NDArray

from farfield.represent.geometry.board import FULL_SINE, TILTS, TURNS, directions, squareness
from farfield.stream.forms import CellValues
from farfield.stream.outlook import Outlook
from farfield.stream.tree import SLOTS, Boards, CellTree
from farfield.world.index import MESH_FARTHEST, MOST_SIDES

Floats = NDArray[np.float64]
Codes = NDArray[np.int64]
MOST_DYNAMIC = 32
"""Dynamic impostors that a look offers, those of which most will be seen, and twice as many of those that are held:
each is compared with all instances of its mesh."""


def board_offers(
    tree: CellTree,
    instances: NDArray[np.int64],
    uses: NDArray[np.int64],
    outlook: Outlook,
    drawn: NDArray[np.bool_],
    widths: Floats,
    held: Collection[str],
    fine: float,
    dynamic: bool = False,
) -> Iterator[tuple[CellValues, list[int], Floats]]:
    """The sides that instances will be seen from, and those that are there; each with what it shows, and how well.

    As sharp as an image is, and seen as squarely (BEN 4.1); the rest is the error that the bake measured. instances:
    (n,) rows of the tree's, by mesh. uses: (n,) their rows in the outlook. drawn: (n, k) whether they may be in each
    interval. widths: (n, k) metres that a pixel is wide there. held: keys that are there. fine: how much the first
    counts for. dynamic: whether images may be made on demand; they are offered where no side is as good as head on. All
    at once: one by one a look at 216 instances took 55 ms, so 12, and 6 without any.
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
    sights = _sights(tree, instances, outlook)[row]
    visible, pixel = outlook.visible[uses[row]], widths[row]
    errors = tree.errors_at(table.told[which], pixel, MESH_FARTHEST)
    sharp = np.minimum(table.rows[which, None] / np.maximum(outlook.height[uses[row]], 1e-9), 1.0)
    shown = np.where(drawn[row], (1 - fine) * (1 - errors) + fine * sharp, 0.0)
    codes = _sides_from(which, table.sides[which, None], sights)
    present = set(which.tolist())
    there = np.array([code for key in held if (code := table.code_of(key)) is not None and code // SLOTS in present])
    there = there.astype(np.int64)
    wanted = _dynamic_from(which, codes, table, sights, np.where(drawn[row], visible, 0.0))
    is_baked = there % SLOTS < MOST_SIDES
    found = [codes[visible > 0], there[is_baked], _of_use(there[~is_baked], wanted)[: 2 * MOST_DYNAMIC]]
    if dynamic:
        found.append(wanted[~np.isin(wanted, there)][:MOST_DYNAMIC])
    codes = np.unique(np.concatenate(found))
    # Each image with all pairs of its impostor.
    begins, ends = (np.searchsorted(which, codes // SLOTS, side) for side in ("left", "right"))
    length = ends - begins
    place = np.repeat(begins - np.cumsum(length) + length, length) + np.arange(int(length.sum()))
    towards = np.repeat(_directions(codes, table), length, axis=0)
    accuracy = shown[place] * squareness(np.einsum("ukc,uc->uk", sights[place], towards))
    objects, stops = uses[row[place]].tolist(), np.cumsum(length).tolist()
    for code, begin, end in zip(codes.tolist(), [0, *stops], stops, strict=False):
        yield table.value(code), objects[begin:end], accuracy[begin:end]


def _sides_from(which: Codes, sides: NDArray[np.int64], sights: Floats) -> Codes:
    """(p, k) of pairs the baked image from the side that is nearest to each line of sight."""
    azimuth = np.arctan2(sights[..., 1], sights[..., 0])
    return np.asarray(which[:, None] * SLOTS + np.rint(azimuth * sides / (2 * np.pi)).astype(np.int64) % sides)


def _dynamic_from(which: Codes, codes: Codes, table: Boards, sights: Floats, visible: Floats) -> Codes:
    """Those that are nearest to lines of sight to which no side stands squarely, that of which most is seen first."""
    towards = _directions(codes.ravel(), table).reshape(sights.shape)
    row, interval = np.nonzero((visible > 0) & ((sights * towards).sum(axis=2) < FULL_SINE) & sights.any(axis=2))
    sight = sights[row, interval]
    turn = np.rint(np.arctan2(sight[:, 1], sight[:, 0]) * TURNS / (2 * np.pi)).astype(np.int64) % TURNS
    tilt = np.rint((np.arcsin(np.clip(sight[:, 2], -1.0, 1.0)) / np.pi + 0.5) * TILTS).astype(np.int64)
    # From straight above, or below, all are one.
    turn[(tilt == 0) | (tilt == TILTS)] = 0
    found, of = np.unique(which[row] * SLOTS + MOST_SIDES + tilt * TURNS + turn, return_inverse=True)
    seen = np.bincount(of, visible[row, interval], len(found))
    return np.asarray(found[np.argsort(-seen, kind="stable")])


def _of_use(held: Codes, wanted: Codes) -> Codes:
    """Of dynamic impostors those that are wanted, in that order, then their neighbours, for who goes on a little."""
    which, (tilt, turn) = wanted // SLOTS, np.divmod(wanted % SLOTS - MOST_SIDES, TURNS)
    beside = [
        which * SLOTS + MOST_SIDES + np.clip(tilt + up, 0, TILTS) * TURNS + (turn + along) % TURNS
        for up in (-1, 0, 1)
        for along in (-1, 0, 1)
    ]
    first = wanted[np.isin(wanted, held)]
    others = held[np.isin(held, np.concatenate([np.zeros(0, np.int64), *beside])) & ~np.isin(held, first)]
    return np.concatenate([first, others])


def _directions(codes: Codes, table: Boards) -> Floats:
    """(c, 3) unit vectors from the middle of a mesh to the eyes that images show it to."""
    which, slot = np.divmod(codes, SLOTS)
    tilt, turn = np.divmod(slot - MOST_SIDES, TURNS)
    is_baked = slot < MOST_SIDES
    azimuth = np.where(is_baked, slot / table.sides[which], turn / TURNS) * 2 * np.pi
    return directions(np.stack([azimuth, np.where(is_baked, 0.0, np.pi * (tilt / TILTS - 0.5))], axis=-1))


def _sights(tree: CellTree, instances: NDArray[np.int64], outlook: Outlook) -> Floats:
    """(n, k, 3) unit vectors to the eyes from the middles of instances, in their meshes' frames; zeros of flat ones."""
    listed = tree.instances
    inverse, middles = listed.inverse[instances], listed.boxes[listed.mesh[instances]].mean(axis=1)
    towards = np.einsum("nij,kj->nki", inverse[:, :, :3], outlook.eyes) + (inverse[:, :, 3] - middles)[:, None]
    towards /= np.maximum(np.linalg.norm(towards, axis=2, keepdims=True), 1e-12)
    towards[~inverse[:, :, :3].any(axis=(1, 2))] = 0.0
    return np.asarray(towards)
