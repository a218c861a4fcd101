"""BlockMaps of a bake: of leaves from their triangles, of those above from their children's as they are stored (BLK 4).

They show all that is in a cell, instances too. Their errors are measured as those of merged geometry are.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field, replace

import numpy as np

from farfield.bake.cell import BakedCell, Record
from farfield.bake.context import BakeContext
from farfield.bake.likeness import FARTHER, FormErrors, PlacedMap, map_loss, sights_of
from farfield.octree.grid import CellKey
from farfield.represent.blockmap.blockmap import BlockMap, BlockMapSize
from farfield.represent.blockmap.build import Square, build_blockmap
from farfield.represent.blockmap.coding import decode_blockmap, encode_blockmap, encode_objects, with_objects
from farfield.represent.blockmap.parent import ChildMap, build_parent
from farfield.represent.chunk import Chunk
from farfield.represent.materials import MaterialTable
from farfield.view.blockmaps import CastableMap
from farfield.world.index import BlockMapEntry, Bounds
from farfield.world.keys import blockmap_key, blockmap_objects_key, content_hash

WEBP_QUALITY = {"compact": 60, "normal": 75, "high": 88}
"""Of colours, by preset: 75 takes two thirds of the bytes of 85 for .3 dB."""


@dataclass(frozen=True, slots=True)
class BakedMap:
    """What became of a cell's BlockMap."""

    entry: BlockMapEntry | None = None
    losses: tuple[int, ...] = ()
    """See CellEntry.losses; told where there are no orthoviews."""
    input: str = ""
    """Hash of what it was made from, above the leaves."""
    files: dict[str, bytes] = field(default_factory=dict)
    """It and its object ids by key, if they were made just now."""

    @property
    def hash(self) -> bytes:
        """Of the BlockMap, or empty."""
        return self.entry.hash.encode() if self.entry else b""


NO_MAP = BakedMap()
"""Of a cell of which nothing is seen from above, as of a mast that reaches into it. Those above do without it."""


def leaf_blockmap(
    context: BakeContext, key: CellKey, chunk: Chunk, materials: MaterialTable, bounds: Bounds
) -> BakedMap:
    """Stores the BlockMap of a leaf. chunk: all that is in it, metres from its lower corner."""
    if not context.job.options.blockmap:
        return NO_MAP
    made = build_blockmap(chunk, materials, _square(context, key), BlockMapSize.parse(context.job.options.blockmap))
    if made is None:
        return NO_MAP
    errors = FormErrors.against(sights_of(context.grid, key, bounds), chunk, materials, (0.0, 0.0))
    return _stored(context, key, made, errors)[0]


def parent_blockmap(
    context: BakeContext, key: CellKey, below: Sequence[BakedCell], bounds: Bounds, before: Record | None
) -> BakedMap:
    """Stores the BlockMap of a cell above; as it is noted where that was made from the same. below: its children."""
    with_one = [(cell, one) for cell in below if (one := cell.record.entry.blockmap) is not None]
    if not context.job.options.blockmap or not with_one:
        return NO_MAP
    named = (f"{cell.key} {one.hash} {one.errors}".encode() for cell, one in with_one)
    box = context.grid.bounds(key).tobytes()
    source = content_hash(context.job.signature.encode(), box, repr(bounds).encode(), *named)
    if before is not None and before.blockmap == source:
        return BakedMap(before.entry.blockmap, before.entry.losses, source)
    maps = [(cell, _read(context, cell, one)) for cell, one in with_one]
    children = [_child(context, key, *one) for one in maps]
    made = build_parent(children, _square(context, key), _merges(context, key))
    placed = {cell.key: _placed(context, cell.key, one) for cell, one in maps}
    told = np.mean([_errors(one) for _, one in with_one], axis=0).tolist()
    sights = sights_of(context.grid, key, bounds)
    stored, shown = _stored(
        context, key, made, FormErrors.against_maps(sights, list(placed.values()), (told[0], told[1]))
    )
    losses: tuple[int, ...] = ()
    if not context.job.options.orthoviews:
        losses = tuple(
            map_loss(sights[n % len(sights)], shown, placed[cell.key], cell.key, cell.record.entry.bounds)
            if cell.key in placed
            else 0
            for n, cell in enumerate(below)
        )
    return replace(stored, input=source, losses=losses)


def _errors(entry: BlockMapEntry) -> tuple[float, float]:
    """A child's own, in the first view that errors of the cell above are told for, and in the second."""
    first, second, *_ = (error / 255 for error in entry.errors)
    return FARTHER * first, (first + second) / 2


def _stored(context: BakeContext, key: CellKey, made: BlockMap, errors: FormErrors) -> tuple[BakedMap, PlacedMap]:
    """What became of it, and it as it is stored."""
    data = encode_blockmap(made, WEBP_QUALITY[context.job.options.quality])
    objects = made.objects if context.job.options.object_ids else None
    ids = [] if objects is None else [encode_objects(objects)]
    name = content_hash(data, *ids)
    files = {blockmap_key(key, name): data} | {blockmap_objects_key(key, name): value for value in ids}
    for one, value in files.items():
        context.store.put(one, value)
    shown = _placed(context, key, decode_blockmap(data, blockmap_key(key, name)))
    return BakedMap(BlockMapEntry(name, len(data), errors.of_map(shown)), files=files), shown


def _read(context: BakeContext, cell: BakedCell, entry: BlockMapEntry) -> BlockMap:
    """A child's, as it is stored."""
    key = blockmap_key(cell.key, entry.hash)
    found = decode_blockmap(cell.file_from(context.store, key), key)
    if not context.job.options.object_ids:
        return found
    ids = blockmap_objects_key(cell.key, entry.hash)
    return with_objects(found, cell.file_from(context.store, ids), ids)


def _child(context: BakeContext, key: CellKey, cell: BakedCell, blockmap: BlockMap) -> ChildMap:
    x, y, z = (index & 1 if merge else 0 for index, merge in zip(cell.key[1:], _merges(context, key), strict=True))
    rise = z * float(context.grid.cell_size(cell.key.level)[2])
    return ChildMap(blockmap, (x, y, z), rise)


def _merges(context: BakeContext, key: CellKey) -> tuple[int, int, int]:
    """1 along the axes that cells merge on into those of this level."""
    x, y, z = (int(key.level <= most) for most in context.grid.axis_levels)
    return x, y, z


def _square(context: BakeContext, key: CellKey) -> Square:
    return Square(*context.grid.cell_size(key.level).tolist())


def _placed(context: BakeContext, key: CellKey, blockmap: BlockMap) -> PlacedMap:
    return CastableMap.of(blockmap, context.grid.cell_size(key.level)), context.grid.bounds(key)[0]
