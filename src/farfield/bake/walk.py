"""Depth-first walk of a subtree: leaves are drawn, parents composited from their children (OV 4.1), and merged.

At any moment the tiles of one cell per level and its finished siblings are in memory, and each orthoview is written
once; none is read back but those of cells that an earlier bake made and this one has not changed.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import replace

import msgspec

from farfield.bake.blockmaps import parent_blockmap
from farfield.bake.cell import BakedCell, Record, Tally, Tiles, latest_record, write_record
from farfield.bake.context import BakeContext
from farfield.bake.hlod import merged_geometry, standing_of
from farfield.bake.index import close_index_tile
from farfield.bake.leaf import bake_leaf
from farfield.bake.likeness import Layers, Sight, parent_errors, places_of, sights_of
from farfield.bake.tiles import CellTiles, store_tiles
from farfield.geometry.directions import Direction
from farfield.octree.grid import CellKey
from farfield.represent.orthoview.layer import OrthoLayer
from farfield.represent.orthoview.object_tile import decode_object_tile
from farfield.represent.orthoview.parent import composite
from farfield.represent.orthoview.tile import decode_tile
from farfield.world.index import Bounds, CellEntry
from farfield.world.keys import content_hash, objects_key, orthoview_key

Children = dict[CellKey, tuple[CellKey, ...]]
"""Cells of the plan below each cell that is not a leaf."""


def bake_subtree(context: BakeContext, key: CellKey, children: Children, done: Callable[[], None]) -> BakedCell | None:
    """Bakes `key` and all below; None when nothing is there. `done` is called after every leaf."""
    if key.level == 0:
        leaf = bake_leaf(context, key)
        done()
        return leaf
    below = [bake_subtree(context, child, children, done) for child in children[key]]
    return bake_parent(context, key, [cell for cell in below if cell is not None])


def bake_parent(context: BakeContext, key: CellKey, below: Sequence[BakedCell]) -> BakedCell | None:
    """Composites a cell from its finished children, ascending by key; None when there are none."""
    if not below:
        return None
    # How far a cell reaches up and down depends on the world's height, and which views are chosen on that.
    box = context.grid.bounds(key).tobytes()
    pictures = (f"{c.key} {c.record.entry.hash}".encode() for c in below)
    source = content_hash(context.job.signature.encode(), box, *pictures)
    before = latest_record(context.store, key)
    bounds = _union([c.record.entry.bounds for c in below])
    merged = merged_geometry(context, key, below, bounds, before)
    cast = parent_blockmap(context, key, below, bounds, before)
    fresh = before is None or before.input != source
    tiles = objects = None
    if not context.job.options.orthoviews:
        pitch = context.grid.pitch(key.level)
        entry, object_bytes = CellEntry(key=str(key), bounds=bounds, error=pitch, losses=cast.losses), 0
        fresh = before is None or before.blockmap != cast.input
    elif before is None or fresh:
        sights = sights_of(context.grid, key, bounds)
        built, theirs = _composite(context, key, below, sights)
        entry = CellEntry(
            key=str(key),
            bounds=bounds,
            error=context.grid.pitch(key.level),
            hash=store_tiles(context, key, built),
            tiles=built.listing(),
            picked=built.picked(),
        )
        layers = built.take_layers(places_of(sights, entry))
        told = parent_errors(sights, entry, layers, theirs)
        entry = msgspec.structs.replace(entry, errors=told.errors, losses=told.losses)
        object_bytes = built.object_bytes
        tiles, objects = built.encoded, built.objects
    else:
        entry, object_bytes = before.entry, before.object_bytes
    entry = msgspec.structs.replace(entry, geometry=merged.geometry, blockmap=cast.entry)
    record = Record(source, _over(entry, below), 0, object_bytes, merged=merged.input, blockmap=cast.input)
    if record != before:
        write_record(context.store, key, record)
    tally = Tally.sum([Tally.of(record.entry, fresh), *(cell.tally for cell in below)])
    listed = tuple(entry for cell in below for entry in cell.entries)
    for cell in below:
        cell.release()
    baked = BakedCell(
        key,
        record,
        tally,
        standing_of(below, merged),
        listed=listed,
        tiles=tiles,
        objects=objects,
        files=merged.files | cast.files,
    )
    close_index_tile(context.store, context.grid, baked)
    return baked


def _composite(
    context: BakeContext, key: CellKey, below: Sequence[BakedCell], sights: Sequence[Sight]
) -> tuple[CellTiles, list[tuple[CellEntry, Layers]]]:
    """The cell's tiles, and the layers of its children by which these are drawn from there."""
    tiles = CellTiles(context, key)
    wanted = [places_of(sights, cell.record.entry) for cell in below]
    seen: list[dict[tuple[int, int], tuple[Direction, OrthoLayer]]] = [{} for _ in below]
    # Read before any thread asks for them.
    encoded = [(cell, cell.tiles_from(context.store), cell.objects_from(context.store)) for cell in below]

    def draw(direction: Direction) -> list[OrthoLayer]:
        children = [_decoded(context, *cell, direction.number) for cell in encoded]
        for layers, places, own in zip(children, wanted, seen, strict=True):
            for n, layer in enumerate(layers):
                if (direction.number, n) in places:
                    own[direction.number, n] = direction, layer
        return composite([c for c in children if c], context.job.options.depth_layers)

    tiles.make(draw)
    return tiles, [(cell.record.entry, own) for cell, own in zip(below, seen, strict=True)]


def _decoded(context: BakeContext, cell: BakedCell, encoded: Tiles, objects: Tiles, direction: int) -> list[OrthoLayer]:
    layers = []
    for index in range(context.job.options.depth_layers):
        if (direction, index) in encoded:
            where = orthoview_key(cell.key, direction, index, cell.record.entry.hash)
            layer = decode_tile(encoded[direction, index], where, flags=False).layer
            if (direction, index) in objects:
                where = objects_key(cell.key, direction, index, cell.record.entry.hash)
                layer = replace(layer, objects=decode_object_tile(objects[direction, index], layer, where))
            layers.append(layer)
    return layers


def _over(entry: CellEntry, below: Sequence[BakedCell]) -> CellEntry:
    """The entry of a cell above these children, whose near geometry may change without their pictures."""
    outputs = [cell.record.entry.output.encode() for cell in below]
    forms = [form.hash.encode() for form in (entry.geometry.forms if entry.geometry else ())]
    forms += [entry.blockmap.hash.encode()] if entry.blockmap else []
    return msgspec.structs.replace(
        entry,
        bounds=_union([cell.record.entry.bounds for cell in below]),
        children=tuple(str(cell.key) for cell in below),
        output=content_hash(entry.hash.encode(), *forms, *outputs),
    )


def _union(bounds: Sequence[Bounds]) -> Bounds:
    x0, y0, z0 = (min(b[0][a] for b in bounds) for a in range(3))
    x1, y1, z1 = (max(b[1][a] for b in bounds) for a in range(3))
    return (x0, y0, z0), (x1, y1, z1)
