"""The cells of a world as arrays, for looking at all that is near a viewer at once."""

from __future__ import annotations

from collections import deque
from collections.abc import Sequence
from dataclasses import dataclass
from functools import lru_cache

import numpy as np
from numpy.typing import NDArray

from farfield.errors import CorruptTileError
from farfield.octree.grid import MAXIMUM_LEVEL, CellKey, Grid
from farfield.represent.geometry.board import TILTS, TURNS
from farfield.stream.accuracy import UNTOLD, UNTOLD_LOSS
from farfield.stream.forms import (
    NO_FORMS,
    REACHES,
    CellForms,
    CellValues,
    own_forms,
    picture_errors,
    together,
    told_errors,
)
from farfield.stream.offers import SHARES
from farfield.world.index import (
    ERROR_SPACING,
    MOST_SIDES,
    BlockMapEntry,
    CellEntry,
    Impostor,
    InstancedMesh,
)
from farfield.world.keys import DYNAMIC, DynamicImpostor, mesh_key, orthoview_key, texture_key
from farfield.world.reach import blockmap_keys, form_values, level_values
from farfield.world.world import World

Floats = NDArray[np.float64]
NONE = -1
LAYERS = 2
"""Depth layers that are drawn of a view."""
MOST_LEAVES = 256
"""Below a cell that is shown as geometry, at most."""
TRIANGLES = 1.5
"""Triangles for each pixel of a view that a cell may have to be geometry from afar, at most. All of Tokyo has 1.3 from
16 r on, what reaches into several leaves counted in each, which take 130 ms in software where its points take 870
(docs/performance.md, Beside mesh levels of detail)."""
MESH_TRIANGLES = 1.0
"""The same of all instances in a cell, which are drawn while its pictures are on their way."""
FIRST_MERGED = 32
"""Number of the first form of a cell's own, beyond those of any leaf."""
REACH = 120.0
"""Leaf edges within which leaves are geometry: graphics cards hold boxes of 256 along an edge."""
SLOTS = MOST_SIDES + TURNS * (TILTS + 1)
"""Codes of the images of an impostor: its sides, then those that may be made on demand."""
_SINGULAR = 1e-12
REMEMBERED = 20_000
"""Cells seen from a side whose tiles are kept listed: some 30 MB."""


@dataclass(frozen=True, slots=True)
class Boards:
    """The impostors of some meshes, and their images."""

    first: NDArray[np.int64]
    """(meshes + 1,) number of the first of each mesh's."""
    rows: NDArray[np.int64]
    """(impostors,) pixels of their images along the height of the mesh's box."""
    sides: NDArray[np.int64]
    """(impostors,) images."""
    told: Floats
    """(impostors, 3) their errors, as CellForms has them."""
    values: tuple[tuple[CellValues, ...], ...]
    """Of each the images."""
    meshes: tuple[str, ...]
    """Of each the hash of its mesh."""
    codes: dict[str, int]
    """Key of a baked image -> its code, SLOTS times its impostor, and its side."""
    dynamic: dict[tuple[str, int], int]
    """Hash of a mesh, and rows -> its impostor."""
    known: dict[int, CellValues]
    """Dynamic impostors by their codes, as far as they have been asked for: behind the sides TURNS for each tilt."""

    @classmethod
    def of(cls, meshes: Sequence[InstancedMesh]) -> Boards:
        """Of meshes as the index lists them."""
        all_of = [(mesh, number, one) for mesh in meshes for number, one in enumerate(mesh.impostors)]
        values = tuple(_board_values(*one) for one in all_of)
        return cls(
            np.cumsum([0, *(len(mesh.impostors) for mesh in meshes)], dtype=np.int64),
            np.array([one.rows for _, _, one in all_of], np.int64),
            np.array([len(one.images) for _, _, one in all_of], np.int64),
            np.array([told_errors(one.errors) for _, _, one in all_of]).reshape(-1, REACHES),
            values,
            tuple(mesh.levels[0].hash for mesh, _, _ in all_of),
            {one.keys[0]: SLOTS * n + side for n, own in enumerate(values) for side, one in enumerate(own)},
            {(mesh.levels[0].hash, one.rows): n for n, (mesh, _, one) in enumerate(all_of)},
            {},
        )

    def of_mesh(self, mesh: int) -> tuple[tuple[CellValues, ...], ...]:
        """The images of each of its impostors."""
        return self.values[int(self.first[mesh]) : int(self.first[mesh + 1])]

    def value(self, code: int) -> CellValues:
        """What an image is sent as. A dynamic one is taken to be as large as those of its impostor that are baked."""
        which, slot = divmod(code, SLOTS)
        if slot < MOST_SIDES:
            return self.values[which][slot]
        found = self.known.get(code)
        if found is None:
            tilt, turn = divmod(slot - MOST_SIDES, TURNS)
            baked = self.values[which]
            key = DynamicImpostor(self.meshes[which], int(self.rows[which]), turn, tilt).key
            size, level = sum(one.sizes[0] for one in baked) // len(baked), baked[0].level + slot
            found = CellValues(self.meshes[which], True, (key,), (size,), (), (1,), 1, level, frozenset([key]))
            self.known[code] = found
        return found

    def code_of(self, key: str) -> int | None:
        """The code of an image; None: it is none of these."""
        if not key.startswith(DYNAMIC):
            return self.codes.get(key)
        named = DynamicImpostor.of(key)
        if named is None:
            return None
        slot = MOST_SIDES + TURNS * named.tilt + named.turn
        which = self.dynamic.get((named.mesh, named.rows))
        return None if which is None else SLOTS * which + slot


def _board_values(listed: InstancedMesh, number: int, impostor: Impostor) -> tuple[CellValues, ...]:
    """Of one of a mesh's impostors, numbered as levels behind all others of the mesh."""
    first, mesh = len(listed.levels) + SLOTS * number, listed.levels[0].hash
    named = [(texture_key(name), size) for name, size in impostor.images]
    return tuple(
        CellValues(mesh, True, (key,), (size,), (), (1,), 1, first + side, frozenset([key]))
        for side, (key, size) in enumerate(named)
    )


@dataclass(frozen=True, slots=True)
class Instances:
    """m instances of shared meshes that the index lists, those of a leaf in a row."""

    bounds: Floats
    """(m, 6) local metres."""
    transforms: Floats
    """(m, 3, 4) from the mesh's frame to local metres."""
    objects: NDArray[np.int64]
    """(m,) object id of the mesh's object 0."""
    leaf: NDArray[np.int32]
    """(m,) number of the leaf that each has its place in, ascending."""
    mesh: NDArray[np.int32]
    """(m,) into `forms`."""
    forms: tuple[CellForms, ...]
    """Of each mesh, its levels from fine to coarse."""
    triangles: tuple[tuple[int, ...], ...]
    """Of each mesh those of each level."""
    levels: NDArray[np.int64]
    """(meshes,) how many each has."""
    counts: Floats
    """(meshes, levels) triangles of each level; of those with fewer levels 1 behind their ends."""
    told: Floats
    """(meshes, levels, 3) their errors; the same."""
    boxes: Floats
    """(meshes, 2, 3) bounds of each mesh in its own frame."""
    impostors: tuple[tuple[Impostor, ...], ...]
    """Of each mesh."""
    boards: Boards
    """Those of all meshes, one after the other."""
    inverse: Floats
    """(m, 3, 4) from local metres to the mesh's frame; zeros of those that have no extent in some direction."""

    @classmethod
    def of(cls, grid: Grid, entries: Sequence[CellEntry]) -> Instances:
        """All that are listed."""
        numbers: dict[str, int] = {}
        meshes: list[InstancedMesh] = []
        bounds, turns = [np.zeros((0, 6))], [np.zeros((0, 3, 4))]
        objects: list[int] = []
        places: list[tuple[int, int]] = []
        for leaf, entry in enumerate(entries):
            for listed in entry.instances:
                number = numbers.setdefault(listed.levels[0].hash, len(meshes))
                if number == len(meshes):
                    meshes.append(listed)
                boxes, own = listed.placed(grid.bounds(entry.cell)[0])
                bounds.append(boxes)
                turns.append(own)
                objects += listed.objects
                places += [(leaf, number)] * len(own)
        of = np.array(places, np.int32).reshape(-1, 2)
        forms = tuple(_mesh_forms(mesh) for mesh in meshes)
        counts = tuple(tuple(level.triangles for level in mesh.levels) for mesh in meshes)
        every = np.concatenate(bounds), np.concatenate(turns), np.array(objects, np.int64)
        levels = np.array(list(map(len, counts)), np.int64)
        told = np.ones((len(meshes), int(levels.max(initial=0)), REACHES))
        for number, mesh_forms in enumerate(forms):
            told[number, : len(mesh_forms.errors)] = mesh_forms.errors
        table = np.ones(told.shape[:2])
        for number, count in enumerate(counts):
            table[number, : len(count)] = count
        boxes = np.array([mesh.bounds for mesh in meshes], np.float64).reshape(-1, 2, 3)
        return cls(
            *every, of[:, 0].copy(), of[:, 1].copy(), forms, counts, levels, table, told,
            boxes, tuple(mesh.impostors for mesh in meshes), Boards.of(meshes), _inverse(every[1]),
        )  # fmt: skip

    @property
    def sides(self) -> Floats:
        """(m,) square metres of the rectangle round each as it is seen from a side, at most."""
        across = self.bounds[:, 3:] - self.bounds[:, :3]
        return np.asarray(np.hypot(across[:, 0], across[:, 1]) * across[:, 2])


def _mesh_forms(listed: InstancedMesh) -> CellForms:
    values, errors = [], []
    for number, level in enumerate(listed.levels):
        keys, sizes = zip(*level_values(level), strict=True)
        values.append(
            CellValues(listed.levels[0].hash, True, keys, sizes, (), (len(keys),), 1, number, frozenset(keys))
        )
        errors.append(told_errors(level.errors))
    count = len(values)
    return CellForms(tuple(values), np.array(errors), np.ones(count, bool))


def _inverse(transforms: Floats) -> Floats:
    """(m, 3, 4) of (m, 3, 4); zeros where there is none."""
    turns = transforms[:, :, :3]
    # Of the product of its columns' lengths: how large it is does not matter.
    has_one = np.abs(np.linalg.det(turns)) > _SINGULAR * np.linalg.norm(turns, axis=1).prod(axis=1)
    found = np.zeros_like(transforms)
    found[has_one, :, :3] = np.linalg.inv(turns[has_one])
    found[:, :, 3] = -np.einsum("nij,nj->ni", found[:, :, :3], transforms[:, :, 3])
    return found


class CellTree:
    """Every cell of a world, parents before children and the children of each in a row, read from its index once.

    Shared by all viewers of one generation; takes about 3 kB a cell, nearly all of it the entries themselves.
    """

    def __init__(self, grid: Grid, entries: list[CellEntry], parents: list[int]) -> None:
        """entries: parents before children, children in a row. parents: number of each one's parent, NONE of roots."""
        self.grid = grid
        self.entries = entries
        self.parents = np.array(parents, np.int32)
        keys = [entry.cell for entry in entries]
        self.levels = np.array([key.level for key in keys], np.int32)
        self.boxes = np.array([grid.bounds(key).ravel() for key in keys], np.float64).reshape(-1, 6)
        """(n, 6) local metres: lower and upper corners of the cells."""
        self.bounds = np.array([np.ravel(entry.bounds) for entry in entries], np.float64).reshape(-1, 6)
        """(n, 6) the same of what is in them."""
        self.errors = np.array([entry.error for entry in entries], np.float64)
        """(n,) metres between the pixels of their pictures."""
        told = [told_errors(errors) if (errors := picture_errors(entry)) else np.array(UNTOLD) for entry in entries]
        self.told = np.array(told).reshape(-1, REACHES)
        """(n, 3) errors of their pictures, 0 to 1, for the views that CellEntry.errors tells them for."""
        self.losses = np.full(len(entries), UNTOLD_LOSS)
        """(n,) what is lost of each cell by the pictures of its parent in its place (CellEntry.losses)."""
        numbers = {entry.key: number for number, entry in enumerate(entries)}
        for entry in entries:
            for child, loss in zip(entry.children, entry.losses, strict=False):
                if child in numbers:
                    self.losses[numbers[child]] = loss / 255
        self.listed = np.array(
            [entry.geometry.listed / 255 if entry.geometry else 0.0 for entry in entries], np.float64
        )
        """(n,) of cells above leaves, what instances take of them that no form of their own shows, 0 to 1."""
        self.has_pictures = np.array([len(entry.tiles) > 0 or entry.blockmap is not None for entry in entries], bool)
        """(n,) cells with tiles, or a BlockMap in their place."""
        of_its_own = np.array([entry.geometry is not None for entry in entries], bool)
        self.index_apart = self.levels >= min(
            (entry.cell.level for entry in entries if entry.index), default=MAXIMUM_LEVEL + 1
        )
        """(n,) cells of which one may know without knowing the leaves below: these are told in other index tiles."""
        self.has_geometry = of_its_own & (self.levels == 0)
        """(n,) leaves that have geometry."""
        beside = np.array([len(entry.tiles) > 0 and entry.blockmap is not None for entry in entries], bool)
        self.has_merged = of_its_own & (self.levels > 0) | beside
        """(n,) cells above them that have geometry of their own, and cells with a BlockMap beside their tiles."""
        self.children = np.zeros((len(entries), 2), np.int32)
        """(n, 2) the first child and how many there are."""
        below = np.flatnonzero(self.parents >= 0)
        first = below[::-1]
        self.children[self.parents[first], 0] = first
        np.add.at(self.children[:, 1], self.parents[below], 1)
        self.roots = np.flatnonzero(self.parents == NONE).astype(np.int32)
        self.instances = Instances.of(grid, entries)
        self.instances_below = lru_cache(REMEMBERED)(self._instances_below)
        """Cell -> (k,) rows of `instances` in the leaves that it is geometry by."""
        self.finest_afar = lru_cache(REMEMBERED)(self._finest_afar)
        """Cell -> the finest level by which its instances may be drawn from farther than near, those of meshes that
        have no such level by their coarsest; NONE: they have too many triangles."""
        self.pictures = lru_cache(REMEMBERED)(self._pictures)
        """The tiles that a cell is drawn from; cell, view bin and least gain -> CellValues."""
        self.forms = lru_cache(REMEMBERED)(self._forms)
        """Cell -> CellForms, each of which is drawn whole or not at all."""
        self.merged = lru_cache(REMEMBERED)(self._merged)
        """Cell -> those of its own alone; none of a leaf."""

    @classmethod
    def of(cls, world: World) -> CellTree:
        """All cells of a world; below an index tile that is damaged there are none."""
        entries: list[CellEntry] = []
        parents: list[int] = []
        pending: deque[tuple[CellKey, int]] = deque((key, NONE) for key in world.roots)
        while pending:
            key, parent = pending.popleft()
            try:
                entries.append(world.entry(key))
                parents.append(parent)
                pending.extend((child, len(entries) - 1) for child in world.children(key))
            except (CorruptTileError, KeyError):
                continue
        return cls(world.grid, entries, parents)

    def leaves_below(self, cell: int) -> list[int]:
        """Numbers of the leaves that a cell is geometry by; none when one has no geometry, or there are too many."""
        found: list[int] = []
        waiting = [cell]
        while waiting:
            own = waiting.pop()
            first, count = self.children[own].tolist()
            if count:
                waiting.extend(range(first + count - 1, first - 1, -1))
            elif self.has_geometry[own] and len(found) < MOST_LEAVES:
                found.append(own)
            elif self.has_pictures[own]:
                return []
        return found

    def _instances_below(self, cell: int) -> NDArray[np.int64]:
        if not len(self.instances.leaf):
            return np.zeros(0, np.int64)
        first, last = (
            np.searchsorted(self.instances.leaf, self.leaves_below(cell), side) for side in ("left", "right")
        )
        return np.concatenate([np.zeros(0, np.int64), *(np.arange(*own) for own in zip(first, last, strict=True))])

    def _finest_afar(self, cell: int) -> int:
        listed = self.instances
        meshes, counts = np.unique(listed.mesh[self.instances_below(cell)], return_counts=True)
        own = [listed.triangles[mesh] for mesh in meshes.tolist()]
        for level in range(max(map(len, own), default=0)):
            each = [triangles[min(level, len(triangles) - 1)] for triangles in own]
            if int(np.dot(counts, each)) <= MESH_TRIANGLES * self.grid.resolution**2:
                return level
        return NONE

    def may_be_afar(self, cell: int, level: int, levels: int) -> bool:
        """Whether instances in it may be drawn from farther than near by a level of a mesh that has so many."""
        finest = self.finest_afar(cell)
        return finest != NONE and level >= min(finest, levels - 1)

    def _forms(self, cell: int) -> CellForms:
        return together(self._joined(cell), self.merged(cell))

    def _merged(self, cell: int) -> CellForms:
        if not self.has_merged[cell]:
            return NO_FORMS
        key = self.entries[cell].cell
        values, errors = [], []
        for number, form in enumerate(own_forms(self.entries[cell]), FIRST_MERGED):
            named = blockmap_keys(self.entries[cell]) if isinstance(form, BlockMapEntry) else form_values(key, form)
            keys, sizes = zip(*named, strict=True)
            refers = frozenset(keys[:-1])
            values.append(CellValues(str(key), True, keys, sizes, (), (len(keys),), 1, number, refers))
            errors.append(told_errors(form.errors))
        count = len(values)
        return CellForms(tuple(values), np.array(errors), np.ones(count, bool), count)

    def _joined(self, cell: int) -> CellForms:
        """The leaves below, together; none of a cell with a leaf that has no geometry."""
        leaves = [self.entries[leaf] for leaf in self.leaves_below(cell)]
        near = [(entry.cell, entry.geometry.forms) for entry in leaves if entry.geometry is not None]
        count = max((len(forms) for _, forms in near), default=0)
        if not count:
            return NO_FORMS
        name, most = self.entries[cell].key, TRIANGLES * self.grid.resolution**2
        listed = {mesh_key(level.hash) for entry in leaves for mesh in entry.instances for level in mesh.levels}
        values, errors, far = [], [], []
        for level in range(count):
            own = [(key, forms[min(level, len(forms) - 1)]) for key, forms in near]
            sizes = dict(value for one in own for value in form_values(*one))
            refers = frozenset(key for key in sizes if not key.startswith("geometry/"))
            own_sizes = tuple(sizes.values())
            steps, by_themselves = (len(sizes),), refers & listed
            values.append(CellValues(name, True, tuple(sizes), own_sizes, (), steps, 1, level, refers, by_themselves))
            errors.append(np.mean([told_errors(form.errors) for _, form in own], axis=0))
            drawn = [form.drawn or (0 if form.instances else form.triangles) for _, form in own]
            far.append(all(drawn) and sum(drawn) <= most)
        return CellForms(tuple(values), np.array(errors), np.array(far, bool))

    def _pictures(self, cell: int, from_bin: int, least_gain: float) -> CellValues:
        """The tiles that a cell is drawn from, best first (spec/drawing.md, Which tiles)."""
        entry = self.entries[cell]
        if not entry.tiles and entry.blockmap is not None:
            keys, sizes = zip(*blockmap_keys(entry), strict=True)
            return CellValues(entry.key, False, keys, sizes, (1.0,), (1,))
        picks = [(number, gain) for number, gain in entry.picks_from(from_bin) if entry.tiles[number][1] < LAYERS]
        picks = [pick for n, pick in enumerate(picks) if n == 0 or pick[1] >= least_gain]
        tiles = [entry.tiles[number] for number, _ in picks] or list(entry.tiles)
        shows = [gain * entry.tiles[number][2] for number, gain in picks] or [1.0] * len(tiles)
        keys = tuple(orthoview_key(entry.cell, direction, layer, entry.hash) for direction, layer, _ in tiles)
        shares = tuple(part / sum(shows) for part in shows)
        sizes = tuple(size for _, _, size in tiles)
        return CellValues(entry.key, False, keys, sizes, shares, _steps(shares))

    def errors_at(self, told: Floats, widths: Floats, farthest: float = 1.0) -> Floats:
        """(f, k) of forms with errors as CellForms tells them, (f, 3), where pixels are (f, k) metres wide.

        farthest: pixels of a leaf's pictures that one is wide in the first view that they are told for.
        """
        narrow = np.log(farthest * self.grid.pitch(0) / np.maximum(widths, 1e-9)) / np.log(ERROR_SPACING)
        at = np.clip(narrow, 0.0, REACHES - 1.0)
        below = np.minimum(at.astype(np.int64), REACHES - 2)
        rows = np.arange(len(told))[:, None]
        low, high = told[rows, below], told[rows, below + 1]
        return np.asarray(low + (high - low) * (at - below))


def _steps(shares: Sequence[float]) -> tuple[int, ...]:
    """How many tiles, best first, show each of SHARES of the whole."""
    reached = np.cumsum(shares)
    return tuple(sorted({int(np.argmax(reached >= share - 1e-6)) + 1 for share in SHARES}))
