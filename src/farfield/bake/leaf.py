"""Baking a leaf: clip, draw every direction, encode, store; near geometry beside it (OV 4.1)."""

from __future__ import annotations

from dataclasses import replace

import msgspec
import numpy as np

from farfield.bake.blockmaps import leaf_blockmap
from farfield.bake.cell import BakedCell, Record, Standing, Tally, latest_record, read_record, write_record
from farfield.bake.context import BakeContext, LeafMaterials
from farfield.bake.index import close_index_tile
from farfield.bake.likeness import leaf_errors, places_of, sights_of
from farfield.bake.near import near_geometry
from farfield.bake.tiles import CellTiles, store_tiles
from farfield.geometry.directions import Direction
from farfield.octree.grid import CellKey
from farfield.represent.chunk import Chunk, fingerprint, merge, ordered
from farfield.represent.orthoview.layer import OrthoLayer
from farfield.represent.orthoview.leaf import draw_leaf
from farfield.world.index import Bounds, CellEntry
from farfield.world.keys import content_hash

Parts = dict[int, list[Chunk]]
"""Mesh -> its clipped pieces, in an order of the meshes that depends on their content alone."""


def bake_leaf(context: BakeContext, key: CellKey) -> BakedCell | None:
    """The leaf, baked or found finished; None when nothing lies in it after clipping."""
    position = context.leaf_of[key]
    source = _input_hash(context, position)
    record = read_record(context.store, key, source)
    if record is not None:
        return _finished(context, key, record, fresh=False) if record.triangles else None
    parts = _clip(context, key, position)
    if not parts:
        write_record(context.store, key, Record(source, _empty_entry(context, key)))
        return None
    materials = context.materials(tuple(parts))
    chunk = ordered(merge([piece for pieces in parts.values() for piece in pieces]))
    drawn = _drawn_hash(context, chunk, materials)
    near = near_geometry(context, key, position, parts, materials) if context.job.options.geometry else None
    before = latest_record(context.store, key)
    if before is not None and before.drawn == drawn:
        # A mesh that reaches into the leaf has changed elsewhere.
        tiles, pictures, object_bytes = None, before.entry, before.object_bytes
    elif not context.job.options.orthoviews:
        tiles, object_bytes = None, 0
        pictures = CellEntry(key=str(key), bounds=_bounds(context, key, chunk), error=context.grid.pitch(0))
    else:
        tiles = _draw(context, key, chunk, materials)
        pictures = CellEntry(
            key=str(key),
            bounds=_bounds(context, key, chunk),
            error=context.grid.pitch(0),
            hash=store_tiles(context, key, tiles),
            tiles=tiles.listing(),
            picked=tiles.picked(),
        )
        sights = sights_of(context.grid, key, pictures.bounds)
        layers = tiles.take_layers(places_of(sights, pictures))
        errors = leaf_errors(sights, chunk, materials.table, pictures, layers)
        pictures = msgspec.structs.replace(pictures, errors=errors)
        object_bytes = tiles.object_bytes
    cast = leaf_blockmap(context, key, chunk, materials.table, pictures.bounds)
    output = content_hash(pictures.hash.encode(), near.entry.hash.encode() if near else b"", cast.hash)
    entry = msgspec.structs.replace(
        pictures,
        geometry=near and near.entry,
        blockmap=cast.entry,
        instances=near.instances if near else (),
        output=output,
    )
    opaque = near is not None and near.opaque
    count = len(chunk.triangles)
    finished = Record(source, entry, count, object_bytes, drawn, opaque, blockmap=cast.input)
    write_record(context.store, key, finished)
    baked = _finished(context, key, finished, fresh=before is None or before.drawn != drawn, tiles=tiles)
    baked.files = (near.files if near else {}) | cast.files
    return baked


def _drawn_hash(context: BakeContext, chunk: Chunk, materials: LeafMaterials) -> str:
    """Over all that the pictures of the leaf show."""
    looks = b"".join(context.material_hash(material) for material in materials.materials)
    return content_hash(context.job.signature.encode(), looks, fingerprint(chunk))


def is_finished(context: BakeContext, key: CellKey) -> bool:
    """Whether an earlier bake of the same input has finished the leaf."""
    return read_record(context.store, key, _input_hash(context, context.leaf_of[key])) is not None


def _finished(
    context: BakeContext, key: CellKey, record: Record, fresh: bool, tiles: CellTiles | None = None
) -> BakedCell:
    # Told anew each time: whether a neighbour lists what reaches into this leaf does not depend on the leaf alone.
    is_solid = record.opaque and context.listing.has_all(context.leaf_of[key])
    corner = context.grid.bounds(key)[0]
    boxes = tuple(tuple(box) for listed in record.entry.instances for box in listed.placed(corner)[0].tolist())
    standing = Standing(is_solid, lists=bool(record.entry.instances), boxes=boxes)
    cell = BakedCell(key, record, Tally.of(record.entry, fresh), standing)
    if tiles is not None:
        cell.tiles, cell.objects = tiles.encoded, tiles.objects
    close_index_tile(context.store, context.grid, cell)
    return cell


def _input_hash(context: BakeContext, position: int) -> str:
    """Over the meshes and transforms that touch the leaf, whatever their order in the scene."""
    instances, _ = context.job.plan.rows(position)
    scene = context.job.scene.instances
    rows = [
        context.job.summaries[scene.mesh[i]].content.encode()
        + scene.transform[i].tobytes()
        + int(scene.first_object[i]).to_bytes(8, "little")
        + bytes([int(context.shared[scene.mesh[i]])])
        for i in np.unique(instances)
    ]
    return content_hash(context.job.signature.encode(), *sorted(rows))


def _clip(context: BakeContext, key: CellKey, position: int) -> Parts:
    """Pieces of every instance in the leaf, by mesh; instances in an order that depends on content alone."""
    instances, blocks = context.job.plan.rows(position)
    table, summaries = context.job.scene.instances, context.job.summaries
    starts = np.flatnonzero(np.append(True, instances[1:] != instances[:-1]))
    groups = [(int(instances[s]), b) for s, b in zip(starts, np.split(blocks, starts[1:]), strict=True)]
    groups.sort(
        key=lambda g: (summaries[table.mesh[g[0]]].content, table.transform[g[0]].tobytes(), table.first_object[g[0]])
    )
    meshes = tuple(dict.fromkeys(int(table.mesh[i]) for i, _ in groups))
    base = context.materials(meshes).base
    pieces: list[tuple[int, Chunk]] = []
    for instance, chosen in groups:
        mesh = int(table.mesh[instance])
        piece = context.meshes.get(mesh).blocks.cell_chunk(
            table.transform[instance],
            context.grid,
            (key.x, key.y, key.z),
            base[mesh],
            int(table.first_object[instance]),
            chosen.astype(np.int64),
        )
        if piece is not None:
            pieces.append((mesh, piece))
    return _rebased(context, pieces, base)


def _rebased(context: BakeContext, pieces: list[tuple[int, Chunk]], base: dict[int, int]) -> Parts:
    """Pieces by mesh, their materials numbered within the meshes that really are in the leaf."""
    present = tuple(dict.fromkeys(mesh for mesh, _ in pieces))
    parts: Parts = {}
    if not present:
        return parts
    final = context.materials(present).base
    for mesh, piece in pieces:
        number = piece.materials - np.uint32(base[mesh]) + np.uint32(final[mesh])
        parts.setdefault(mesh, []).append(replace(piece, materials=number))
    return parts


def _draw(context: BakeContext, key: CellKey, chunk: Chunk, materials: LeafMaterials) -> CellTiles:
    options = context.job.options
    tiles = CellTiles(context, key)

    def draw(direction: Direction) -> list[OrthoLayer]:
        return draw_leaf(chunk, materials.table, context.grid, key, direction, options.samples, options.depth_layers)

    tiles.make(draw)
    return tiles


def _bounds(context: BakeContext, key: CellKey, chunk: Chunk) -> Bounds:
    corner = context.grid.bounds(key)[0]
    lower, upper = chunk.bounds.astype(np.float64)
    return _triple(corner + lower), _triple(corner + upper)


def _triple(v: np.ndarray) -> tuple[float, float, float]:
    return float(v[0]), float(v[1]), float(v[2])


def _empty_entry(context: BakeContext, key: CellKey) -> CellEntry:
    nowhere = (0.0, 0.0, 0.0)
    return CellEntry(key=str(key), bounds=(nowhere, nowhere), error=context.grid.pitch(0))
