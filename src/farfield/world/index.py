"""Index tiles: what each cell of a subtree holds, so that nobody has to probe (spec/world.md)."""

from __future__ import annotations

import itertools
import math
from collections.abc import Iterable, Sequence
from typing import Annotated

import msgspec
import numpy as np
from msgspec import Meta
from numpy.typing import NDArray

from farfield.errors import CorruptTileError, OptionError
from farfield.octree.grid import CellKey
from farfield.packed import pack, unpack
from farfield.world.limits import (
    DAMAGE,
    Count,
    DirectionNumber,
    Hash,
    HashOrNone,
    LayerNumber,
    Metres,
    PickNumber,
    is_box,
)
from farfield.world.limits import Bounds as Bounds

_MAGIC = b"FFIX"
MAXIMUM_BYTES = 64 << 20
"""An index tile never unpacks to more than this."""
MOST_GAIN = 65536.0
"""Pixels a kilobyte, from which the gains of picked tiles go down."""
STEPS = 4
"""By which a gain is halved: 16 or 32 in place of 4 make an index 5 and 10 % larger."""
WORST_STEPS = 255
"""From one gain to the next."""
_HINT = "run farfield verify"


ERROR_SPACING = 4.0
"""Errors of levels are told for views from where a pixel is as wide as one of a leaf's pictures, from where it is this
many times as narrow, and again."""
FARTHEST = 2.0
"""Pixels of a cell's pictures for one of the screen, in the first view that their errors are told for."""
MESH_FARTHEST = 4.0
"""Pixels of a leaf's pictures for one of the screen, in the first view that errors of shared meshes are told for."""
Error = Annotated[int, Meta(ge=0, le=255)]
MOST_INSTANCES = 16
"""Instances that a leaf lists: where there are more, they are known from its geometry alone."""
MOST_LISTING = 256
"""Leaves below a cell that has geometry, where any of them lists instances: readers place these one by one."""
MOST_SIDES = 32
"""Images of an impostor."""
VIEW_BINS = 26
_TEXTS = 3
"""Of CellEntry.picked: counts, places and steps."""
MOST_PICKED = VIEW_BINS * 512
"""Tiles picked for all view bins together, at most."""
ZERO = 35
"""Code of the character that stands for 0 where a text lists numbers (CellEntry.picked): of those from it on JSON
escapes one alone."""


Transform = Annotated[tuple[Metres, ...], Meta(min_length=12, max_length=12)]


class GeometryLevel(msgspec.Struct, frozen=True):
    """A form of a cell's geometry, which shows it without any of the others."""

    hash: Hash
    bytes: Count
    triangles: Count = 0
    instances: Count = 0
    meshes: tuple[tuple[Hash, Count], ...] = ()
    """Hash and bytes of each mesh its instances need."""
    textures: tuple[tuple[Hash, Count], ...] = ()
    """Hash and bytes of each image that it and those meshes need."""
    errors: Annotated[tuple[Error, ...], Meta(max_length=8)] = ()
    """How unlike the full geometry it looks, 255 = as nothing, see ERROR_SPACING; none: it is the full geometry. Above
    the leaves the first view is that of FARTHEST."""
    drawn: Count = 0
    """Triangles with those of its instances, which are drawn whole; 0: older worlds do not tell."""


class GeometryEntry(GeometryLevel, frozen=True):
    """Near geometry of a leaf, or what lies below a cell, merged and simplified (HLOD), without listed instances."""

    levels: Annotated[tuple[GeometryLevel, ...], Meta(max_length=16)] = ()
    """The same with fewer triangles and smaller images, from fine to coarse."""
    listed: Error = 0
    """Above the leaves: how much of what is to be seen of the cell instances take that leaves below list, which no form
    shows; 255 = all. By their boxes, on the mean of two sides."""

    @property
    def forms(self) -> tuple[GeometryLevel, ...]:
        """From fine to coarse."""
        return (self, *self.levels)


class BlockMapEntry(msgspec.Struct, frozen=True):
    """A BlockMap: all that is in a cell, instances too, from any side."""

    hash: Hash
    bytes: Count
    errors: Annotated[tuple[Error, ...], Meta(max_length=8)] = ()
    """As CellEntry.errors: how unlike the full geometry it looks."""


class MeshLevel(msgspec.Struct, frozen=True, omit_defaults=True):
    """A shared mesh in one of its forms."""

    hash: Hash
    bytes: Count
    triangles: Count
    textures: tuple[tuple[Hash, Count], ...] = ()
    """Hash and bytes of each image that it needs."""
    errors: Annotated[tuple[Error, ...], Meta(max_length=8)] = ()
    """How unlike the full mesh it looks, 255 = as nothing, from where a pixel is MESH_FARTHEST times as wide as one of
    the leaf's pictures, ERROR_SPACING times as narrow, and again; none: it is the full one."""


class Impostor(msgspec.Struct, frozen=True, omit_defaults=True):
    """Images of a shared mesh from round about, one board each (BEN 4.1)."""

    rows: Annotated[int, Meta(ge=1, le=4096)]
    """Pixels of the images along the height of the mesh's box."""
    images: Annotated[tuple[tuple[Hash, Count], ...], Meta(min_length=1, max_length=MOST_SIDES)]
    """Hash and bytes of each; number n of k is seen from an azimuth of n k-ths of a turn in the mesh's frame, 0 along
    x."""
    errors: Annotated[tuple[Error, ...], Meta(max_length=8)] = ()
    """As those of a MeshLevel, seen from between two of the sides."""


class InstancedMesh(msgspec.Struct, frozen=True, omit_defaults=True):
    """Instances of a shared mesh that have their place in a leaf, each in one alone."""

    bounds: Bounds
    """Of the mesh, in its own frame."""
    levels: Annotated[tuple[MeshLevel, ...], Meta(min_length=1, max_length=16)]
    """From fine to coarse, the full mesh first."""
    objects: Annotated[tuple[Count, ...], Meta(max_length=MOST_INSTANCES)]
    """For each instance the object id of the mesh's object 0."""
    transforms: Annotated[
        tuple[Annotated[tuple[Metres, ...], Meta(min_length=12, max_length=12)], ...], Meta(max_length=MOST_INSTANCES)
    ]
    """For each instance three rows of four, from the mesh's frame to that of the leaf's lower corner."""
    impostors: Annotated[tuple[Impostor, ...], Meta(max_length=4)] = ()
    """From fine to coarse."""

    def placed(self, corner: NDArray[np.float64]) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
        """(n, 6) boxes round the instances, and (n, 3, 4) from the mesh's frame to local metres.

        corner: (3,) the leaf's lower one, local metres.
        """
        transforms = np.array(self.transforms, np.float64).reshape(-1, 3, 4)
        transforms[:, :, 3] += corner
        bounds = np.array(self.bounds)
        middle, half = bounds.mean(axis=0), (bounds[1] - bounds[0]) / 2
        at = transforms[:, :, :3] @ middle + transforms[:, :, 3]
        reach = np.abs(transforms[:, :, :3]) @ half
        return np.concatenate([at - reach, at + reach], axis=1), transforms


class CellEntry(msgspec.Struct, frozen=True, omit_defaults=True):
    """One cell of the index."""

    key: str
    bounds: Bounds
    """Tight bounds of the content, local metres."""
    error: Annotated[float, Meta(ge=0, le=1e12)]
    """Geometric error, metres: the pitch of the orthoviews."""
    hash: HashOrNone = ""
    tiles: Annotated[tuple[tuple[DirectionNumber, LayerNumber, Count], ...], Meta(max_length=512)] = ()
    """(direction, layer, bytes) of each orthoview tile."""
    picked: Annotated[tuple[Annotated[str, Meta(max_length=MOST_PICKED)], ...], Meta(max_length=3)] = ()
    """For each of 26 view bins the tiles to draw, see `pack_picks`."""
    views: Annotated[tuple[Annotated[tuple[DirectionNumber, ...], Meta(max_length=256)], ...], Meta(max_length=26)] = ()
    """Of older worlds: for each of 26 view bins the directions to draw, best first."""
    picks: Annotated[tuple[Annotated[tuple[PickNumber, ...], Meta(max_length=1024)], ...], Meta(max_length=26)] = ()
    """Of older worlds: for each of 26 view bins the tiles to draw, place, steps, place, steps …."""
    children: Annotated[tuple[str, ...], Meta(max_length=8)] = ()
    index: HashOrNone = ""
    geometry: GeometryEntry | None = None
    blockmap: BlockMapEntry | None = None
    """Where there are no tiles it takes their place, its errors that of theirs."""
    instances: Annotated[tuple[InstancedMesh, ...], Meta(max_length=MOST_INSTANCES)] = ()
    """Of a leaf: what is placed in it, so that viewers can draw it before, and without, the leaf's geometry."""
    output: HashOrNone = ""
    errors: Annotated[tuple[Error, ...], Meta(max_length=8)] = ()
    """How unlike the full geometry the pictures look, 255 = as nothing, from where a pixel is twice as wide as one of
    theirs, ERROR_SPACING times as narrow, and again; none: older worlds do not tell."""
    losses: Annotated[tuple[Error, ...], Meta(max_length=8)] = ()
    """For each of `children` how unlike its own pictures these look in their place, from where a pixel is as wide as
    one of theirs; none: older worlds do not tell."""

    def picks_from(self, view_bin: int) -> list[tuple[int, float]]:
        """(place in `tiles`, gain) of each tile picked for a view bin, best first.

        Gain: pixels of a view that a kilobyte of it adds to the tiles before it.
        """
        places, steps = self._listed(view_bin)
        below = itertools.accumulate(steps)
        return [(place, MOST_GAIN * 2.0 ** (-under / STEPS)) for place, under in zip(places, below, strict=True)]

    def _listed(self, view_bin: int) -> tuple[Sequence[int], Sequence[int]]:
        """Places and steps of a view bin."""
        if view_bin >= _bins(self):
            return (), ()
        if not self.picked:
            flat = self.picks[view_bin]
            return flat[::2], flat[1::2]
        counts, places, steps = self.picked
        first = sum(_numbers(counts[:view_bin]))
        own = slice(first, first + ord(counts[view_bin]) - ZERO)
        return _numbers(places[own]), _numbers(steps[own])

    @property
    def has_picks(self) -> bool:
        """Whether tiles are picked."""
        return bool(self.picked or self.picks)

    def directions_from(self, view_bin: int) -> list[int]:
        """Numbers of the directions to draw for a view bin, best first; none: nothing is told of them."""
        if self.views:
            return list(self.views[view_bin])
        return list(dict.fromkeys(self.tiles[place][0] for place, _ in self.picks_from(view_bin)))

    @property
    def cell(self) -> CellKey:
        """The key, parsed."""
        return CellKey.parse(self.key)


class IndexTile(msgspec.Struct, frozen=True):
    """The cells of a few levels below a root cell."""

    root: str
    cells: tuple[CellEntry, ...]


def pack_picks(picks: Iterable[Iterable[tuple[int, float]]]) -> tuple[str, str, str]:
    """(place, gain) of the tiles picked for each view bin, best first, as CellEntry.picked lists them.

    How many there are for each bin; the places of all of them; and their steps. A number is a character, the code of
    which is ZERO more: as lists of numbers they and the directions took a quarter of an index more.
    """
    counts: list[int] = []
    places: list[int] = []
    steps: list[int] = []
    for own in picks:
        below, first = 0, len(places)
        for place, gain in own:
            wanted = round(STEPS * math.log2(MOST_GAIN / gain)) if gain > 0 else WORST_STEPS
            steps.append(min(max(wanted - below, 0), WORST_STEPS))
            below += steps[-1]
            places.append(place)
        counts.append(len(places) - first)
    return _text(counts), _text(places), _text(steps)


def _text(numbers: Iterable[int]) -> str:
    return "".join(chr(ZERO + number) for number in numbers)


def _numbers(text: str) -> list[int]:
    return [ord(letter) - ZERO for letter in text]


def encode_index(tile: IndexTile) -> bytes:
    """Header, then deflated JSON; the same input gives the same bytes."""
    return pack(_MAGIC, msgspec.json.encode(tile))


def decode_index(data: bytes, where: str) -> IndexTile:
    """Reads an index tile. Raises CorruptTileError for anything else.

    Allocates at most 16 bytes for each byte of JSON that the header declares, which is at most MAXIMUM_BYTES.
    """
    try:
        tile = msgspec.json.decode(unpack(data, _MAGIC, MAXIMUM_BYTES, "an index tile", where), type=IndexTile)
        _check_cells(tile, where)
    except (*DAMAGE, OptionError) as error:
        raise CorruptTileError(f"index tile is damaged: {error}", where, _HINT) from None
    return tile


def _check_cells(tile: IndexTile, where: str) -> None:
    """Raises CorruptTileError, or OptionError for what is no key, unless the cells form trees below the root.

    So whoever walks them comes to an end. That a cell has but one parent only the grid can tell (`world.World`).
    """
    root, names = CellKey.parse(tile.root), {entry.key for entry in tile.cells}
    if len(names) != len(tile.cells) or not tile.cells or tile.cells[0].key != tile.root:
        raise CorruptTileError("index tile does not list each of its cells once, the root first", where, _HINT)
    for entry in tile.cells:
        children = [CellKey.parse(child) for child in entry.children]
        sane = (
            entry.cell.level <= root.level
            and is_box(entry.bounds)
            and len(set(children)) == len(children)
            and all(_may_be_below(child, entry.cell) for child in children)
            and _are_packed(entry.picked)
            and all(_are_picks(*entry._listed(n), len(entry.tiles)) for n in range(_bins(entry)))
            and len(entry.losses) in (0, len(entry.children))
            and all(_are_instances(one) for one in entry.instances)
            and (entry.index or names.issuperset(entry.children))
        )
        if not sane:
            raise CorruptTileError(f"index tile tells what cannot be of cell {entry.key}", where, _HINT)


def _bins(entry: CellEntry) -> int:
    """View bins that something is picked for."""
    return len(entry.picked[0]) if entry.picked else len(entry.picks)


def _are_packed(picked: tuple[str, ...]) -> bool:
    """Whether they are as many as they say, for 26 bins at most."""
    if not picked:
        return True
    if len(picked) != _TEXTS or len(picked[0]) > VIEW_BINS:
        return False
    counts, places, steps = map(_numbers, picked)
    return min(counts, default=0) >= 0 and sum(counts) == len(places) == len(steps)


def _are_picks(places: Sequence[int], steps: Sequence[int], tiles: int) -> bool:
    """Whether they come in pairs, name tiles that exist, each once, and steps between gains."""
    each_once = len(set(places)) == len(places) == len(steps)
    return each_once and all(0 <= place < tiles for place in places) and all(0 <= step <= WORST_STEPS for step in steps)


def _are_instances(listed: InstancedMesh) -> bool:
    """Whether each has a place, and the mesh a size."""
    return len(listed.objects) == len(listed.transforms) and is_box(listed.bounds)


def _may_be_below(child: CellKey, cell: CellKey) -> bool:
    """Whether it is a child in some grid: one level below, its index along each axis halved or the same."""
    pairs = zip(child[1:], cell[1:], strict=True)
    return child.level == cell.level - 1 and all(index in (below, below >> 1) for below, index in pairs)
