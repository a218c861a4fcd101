"""Other orders of sending a world over the same link, which walks are compared with (bench_walks.py)."""

from __future__ import annotations

import asyncio
from time import monotonic
from typing import Protocol

import numpy as np
from numpy.typing import NDArray

from farfield.stream.forms import CellValues
from farfield.stream.tree import NONE
from farfield.walk.link import SlowLink
from farfield.walk.loops import run_apart
from farfield.walk.measure import (
    HeldBoards,
    HeldGeometry,
    HeldMerged,
    HeldMeshes,
    HeldPictures,
    Look,
    Measure,
    mesh_accuracy,
    piece_meshes,
)
from farfield.walk.observer import Pose
from farfield.walk.session import Received, Values, Walker
from farfield.walk.walk import WalkedWorld
from farfield.world.keys import orthoview_key, texture_key

Floats = NDArray[np.float64]
REQUEST_BYTES = 100
"""That a value costs beside its own bytes, as a session's message before it does."""


class Order(Protocol):
    """What to send next."""

    def next(self, pose: Pose) -> tuple[str, ...]:
        """Keys of values that belong together; none when nothing is left. They count as sent."""
        ...


def fetched_walk(url: str, walker: Walker, link: SlowLink, order: Order) -> Received:
    """Goes the whole walk and asks for one value after the other, in real time."""
    return run_apart(lambda: _fetch(url, walker, link, order))


async def _fetch(url: str, walker: Walker, link: SlowLink, order: Order) -> Received:
    values = Values(url, link)

    async def fetch() -> None:
        while True:
            keys = await asyncio.to_thread(order.next, walker.poses.at(monotonic() - values.begun))
            if not keys:
                await asyncio.sleep(0.1)
            for key in keys:
                await link.carry(REQUEST_BYTES)
                values.take(key, len(await values.fetch(key)))

    fetching = asyncio.create_task(fetch())
    await asyncio.wait([fetching], timeout=walker.length)
    if fetching.done():
        fetching.result()
    fetching.cancel()
    await asyncio.gather(fetching, return_exceptions=True)
    return values.finish()


class ObjectByObject:
    """Meshes, the first object first: its own, or all leaves that it lies in. Those in view come before all others."""

    def __init__(self, walked: WalkedWorld, measure: Measure, largest: bool = False, levels: bool = False) -> None:
        """largest: by their size on the screen; else by how near they are. levels: all by their coarsest forms first,
        then by the next finer ones; else by the full ones alone.
        """
        self._objects, self._measure, self._largest = walked.objects.without_ground(), measure, largest
        self._leaves: list[list[tuple[CellValues, ...]]] = [[] for _ in self._objects.ids]
        pieces, listed = self._objects, walked.tree.instances
        for row, leaf, instance in zip(
            pieces.piece_object.tolist(), pieces.piece_leaf.tolist(), pieces.piece_instance.tolist(), strict=True
        ):
            forms = (walked.tree.forms(leaf) if instance == NONE else listed.forms[listed.mesh[instance]]).values
            self._leaves[row].append(forms[::-1] if levels else forms[:1])
        self._sent: set[str] = set()
        self._stage = np.zeros(len(self._leaves), np.int64)
        """How many forms of each have been sent."""
        self._stages = np.array([max(map(len, own), default=0) for own in self._leaves])

    def next(self, pose: Pose) -> tuple[str, ...]:
        """See Order."""
        boxes = self._objects.boxes
        gap = np.maximum(np.maximum(boxes[:, :3] - pose.eye, pose.eye - boxes[:, 3:]), 0.0)
        away, look = np.linalg.norm(gap, axis=1), self._measure.look(pose)
        hidden, rank = np.ones(len(boxes), bool), away
        hidden[look.objects] = False
        if self._largest:
            rank = away.copy()
            rank[look.objects] = -look.visible
        for row in np.lexsort((rank, self._stage, hidden)).tolist():
            while self._stage[row] < self._stages[row]:
                stage = int(self._stage[row])
                self._stage[row] += 1
                forms = (own[min(stage, len(own) - 1)] for own in self._leaves[row])
                keys = tuple(dict.fromkeys(key for form in forms for key in form.keys if key not in self._sent))
                if keys:
                    self._sent.update(keys)
                    return keys
        return ()


class BenefitOfObjects:
    """What adds most for its bytes to the very measure that walks are judged by, from where the viewer is now.

    No way to send that a server could take today: it tells how much of what is missing is the order's fault.
    """

    def __init__(self, walked: WalkedWorld, size: tuple[int, int], near_radius: float | None = None) -> None:
        """size: of the picture, pixels. near_radius: metres; None: r, as the cut defines it."""
        tree = self._tree = walked.tree
        directions = [(d.number, d.vector) for d in walked.world.manifest.directions]
        columns = {number: column for column, (number, _) in enumerate(directions)}
        self._pictures, self._geometry = HeldPictures(tree, directions), HeldGeometry(tree, near_radius)
        self._all = HeldGeometry(tree, near_radius)
        for leaf in np.flatnonzero(tree.has_geometry).tolist():
            for key in tree.forms(leaf).values[0].keys:
                self._all.hold(key)
        self._boards = HeldBoards(tree)
        kinds = [self._pictures, self._geometry, HeldMerged(tree), HeldMeshes(tree), self._boards]
        self._measure = Measure(walked.objects.without_ground(), kinds, size)
        self._sizes = np.full((len(tree.entries), len(directions)), np.inf)
        self._keys: dict[tuple[int, int], str] = {}
        for row, entry in enumerate(tree.entries):
            for direction, layer, count in entry.tiles:
                if layer == 0:
                    self._sizes[row, columns[direction]] = count + REQUEST_BYTES
                    self._keys[row, columns[direction]] = orthoview_key(entry.cell, direction, layer, entry.hash)
        self._sent: set[str] = set()

    def next(self, pose: Pose) -> tuple[str, ...]:
        """See Order."""
        look = self._measure.look(pose)
        lacks = look.visible[look.piece_object] * look.piece_share
        best = self._measure.piece_accuracy(look.sight)
        added = np.zeros(self._sizes.shape)
        for pieces, cells, accuracy in self._pictures.all_accuracies(look.sight):
            np.add.at(added, cells, lacks[pieces, None] * np.maximum(accuracy - best[pieces, None], 0.0))
        rates = added / self._sizes
        cell, column = divmod(int(np.argmax(rates)), rates.shape[1])
        leaf, of_leaf = self._best_leaf(look, lacks * (1 - best))
        keys, most = max(
            self._best_mesh(look, lacks, best),
            self._best_board(look, lacks, best),
            (self._lacking(leaf) if of_leaf else (), of_leaf),
            ((self._keys.get((cell, column), ""),), float(rates[cell, column])),
            key=lambda offer: offer[1],
        )
        if most <= 0:
            return ()
        self._sent.update(keys)
        self._measure.hold(keys)
        return keys

    def _best_leaf(self, look: Look, lacks: Floats) -> tuple[int, float]:
        """The leaf whose geometry adds most for its bytes, and how much."""
        added = np.zeros(len(self._tree.entries))
        np.add.at(added, look.sight.leaf, lacks * self._all.accuracy(look.sight))
        found, most = 0, 0.0
        for leaf in np.flatnonzero(added).tolist():
            full = self._tree.forms(leaf).values[0]
            sizes = dict(zip(full.keys, full.sizes, strict=True))
            size = sum(sizes[key] + REQUEST_BYTES for key in self._lacking(leaf))
            if size and added[leaf] / size > most:
                found, most = leaf, float(added[leaf] / size)
        return found, most

    def _best_mesh(self, look: Look, lacks: Floats, best: Floats) -> tuple[tuple[str, ...], float]:
        """What the level of a mesh lacks that adds most for its bytes, and how much."""
        instances, own = self._tree.instances, piece_meshes(self._tree, look.sight)
        found: tuple[str, ...] = ()
        most = 0.0
        for level in range(max(map(len, instances.triangles), default=0)):
            shares = np.array([of[level] / of[0] if level < len(of) else 0.0 for of in instances.triangles] + [0.0])
            gains = lacks * np.maximum(mesh_accuracy(look.sight, shares[own]) - best, 0.0)
            added = np.zeros(len(shares))
            np.add.at(added, own, gains)
            for mesh in np.flatnonzero(added[:-1]).tolist():
                value = instances.forms[mesh].values[level]
                sizes = {key: size for key, size in zip(value.keys, value.sizes, strict=True) if key not in self._sent}
                size = sum(sizes.values()) + REQUEST_BYTES * len(sizes)
                if sizes and added[mesh] / size > most:
                    found, most = tuple(sizes), float(added[mesh] / size)
        return found, most

    def _best_board(self, look: Look, lacks: Floats, best: Floats) -> tuple[tuple[str, ...], float]:
        """The image of a mesh that adds most for its bytes, and how much."""
        found: tuple[str, ...] = ()
        most = 0.0
        for mesh, number, pieces, accuracy in self._boards.all_accuracies(look.sight):
            images = self._tree.instances.impostors[mesh][number].images
            sizes = np.array([size + REQUEST_BYTES for _, size in images])
            rates = lacks[pieces] @ np.maximum(accuracy - best[pieces, None], 0.0) / sizes
            side = int(np.argmax(rates))
            if rates[side] > most:
                found, most = (texture_key(images[side][0]),), float(rates[side])
        return found, most

    def _lacking(self, leaf: int) -> tuple[str, ...]:
        return tuple(key for key in self._tree.forms(leaf).values[0].keys if key not in self._sent)
