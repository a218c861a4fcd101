"""What the bytes of a walk were good for (bench_walks.py)."""

from __future__ import annotations

from collections import defaultdict

import numpy as np
from numpy.typing import NDArray

from farfield.walk.measure import (
    HeldBoards,
    HeldGeometry,
    HeldMerged,
    HeldMeshes,
    HeldPictures,
    Measure,
    Sight,
    piece_meshes,
)
from farfield.walk.session import Received, Walker
from farfield.walk.walk import WalkedWorld, WalkOptions
from farfield.world.keys import orthoview_key

Floats = NDArray[np.float64]


def of_use(known: WalkedWorld, walker: Walker, options: WalkOptions, received: Received) -> dict[str, int]:
    """Bytes by what they were good for, every half second, as the measure sees it.

    best: pictures and boards that were the best of something in view at least once, and geometry that was shown. top:
    pictures from above, in which who walks sees the ground alone. behind: second layers. ground: of cells in which
    nothing stands. beaten: others. unfinished: of values that had not come whole, and of messages.
    """
    uses = _Uses(known, walker, options)
    arrivals = iter(received.arrivals)
    pending = next(arrivals, None)
    for at in np.arange(0.0, walker.length, 0.5).tolist():
        while pending and pending[0] <= at:
            uses.hold(pending[1])
            pending = next(arrivals, None)
        uses.look(at)
    found: dict[str, int] = defaultdict(int)
    for _, key, size in received.arrivals:
        found[uses.kind(key)] += size
    found["unfinished"] = received.bytes - sum(found.values())
    return dict(found)


def superseded(known: WalkedWorld, received: Received) -> int:
    """Bytes of forms of meshes and cells that came before a finer form of the same, images apart.

    More than that no progressive mesh could save, not even one that costs nothing besides.
    """
    tree = known.tree
    cells = np.flatnonzero(tree.has_geometry | tree.has_merged).tolist()
    groups = [
        *tree.instances.forms,
        *(tree.merged(cell) if tree.has_merged[cell] else tree.forms(cell) for cell in cells),
    ]
    places: dict[str, tuple[int, int]] = {}
    for group, forms in enumerate(groups):
        for level, form in enumerate(forms.values):
            for key in form.keys:
                if not key.startswith("texture/"):
                    places.setdefault(key, (group, level))
    finest: dict[int, int] = {}
    lost = 0
    for _, key, size in reversed(received.arrivals):
        if key in places:
            group, level = places[key]
            lost += size if finest.get(group, level) < level else 0
            finest[group] = min(finest.get(group, level), level)
    return lost


class _Uses:
    """Follows which of the values held are the best of something in view."""

    def __init__(self, known: WalkedWorld, walker: Walker, options: WalkOptions) -> None:
        tree, self._tree, self._walker = known.tree, known.tree, walker
        directions = [(d.number, d.vector) for d in known.world.manifest.directions]
        columns = {number: column for column, (number, _) in enumerate(directions)}
        self._top = {number for number, vector in directions if vector[2] > 0.99}
        self._pictures, self._geometry = HeldPictures(tree, directions), HeldGeometry(tree, options.near_radius)
        objects = known.objects.without_ground()
        self._meshes, self._boards = HeldMeshes(tree), HeldBoards(tree)
        kinds = [self._pictures, self._geometry, HeldMerged(tree), self._meshes, self._boards]
        self._measure = Measure(objects, kinds, walker.size)
        self._places = {
            orthoview_key(entry.cell, direction, layer, entry.hash): (row, columns[direction], direction, layer)
            for row, entry in enumerate(tree.entries)
            for direction, layer, _ in entry.tiles
        }
        self._held = np.zeros((len(tree.entries), len(directions)), bool)
        self._best = np.zeros_like(self._held)
        self._keys: set[str] = set()
        """Of all that is held."""
        self._shown: set[str] = set()
        self._inhabited = np.zeros(len(tree.entries), bool)
        cells = np.unique(objects.piece_leaf)
        while len(cells):
            self._inhabited[cells] = True
            cells = np.unique(tree.parents[cells])
            cells = cells[cells >= 0]

    def hold(self, key: str) -> None:
        self._measure.hold([key])
        self._keys.add(key)
        if key in self._places and self._places[key][3] == 0:
            self._held[self._places[key][:2]] = True

    def look(self, at: float) -> None:
        """Takes note of what is the best of something at a time."""
        look = self._measure.look(self._walker.poses.at(at))
        leaves, meshes = self._geometry.accuracy(look.sight), self._meshes.accuracy(look.sight)
        for leaf in np.unique(look.sight.leaf[leaves > 0]).tolist():
            self._shown.update(key for form in self._tree.forms(leaf).values for key in form.keys)
        for mesh in np.unique(piece_meshes(self._tree, look.sight)[meshes > 0]).tolist():
            self._shown.update(key for value in self._tree.instances.forms[mesh].values for key in value.keys)
        most = self._measure.piece_accuracy(look.sight)
        self._look_at_boards(look.sight, most)
        for pieces, cells, accuracy in self._pictures.all_accuracies(look.sight):
            own = np.where(self._held[cells], accuracy, 0.0)
            first, column = own.max(axis=1), own.argmax(axis=1)
            used = (first > 0) & (first >= most[pieces])
            self._best[cells[used], column[used]] = True

    def _look_at_boards(self, sight: Sight, most: Floats) -> None:
        """most: (k,) accuracy of each piece by the best that is held."""
        for mesh, number, pieces, accuracy in self._boards.all_accuracies(sight):
            keys = self._boards.keys(mesh, number)
            used = (accuracy > 0) & (accuracy >= most[pieces, None])
            self._shown.update(
                keys[side] for side in np.flatnonzero(used.any(axis=0)).tolist() if keys[side] in self._keys
            )

    def kind(self, key: str) -> str:
        """What a value was good for."""
        if key not in self._places:
            return "best" if key in self._shown else "beaten"
        row, column, direction, layer = self._places[key]
        if layer:
            return "behind"
        if self._best[row, column]:
            return "best"
        if direction in self._top:
            return "top"
        return "beaten" if self._inhabited[row] else "ground"
