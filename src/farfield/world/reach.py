"""What a world consists of: from the manifest by the index to every value that is named on the way."""

from __future__ import annotations

from farfield.octree.grid import CellKey
from farfield.represent.geometry.read import texture_hashes
from farfield.represent.geometry.write import MAGIC
from farfield.world import keys
from farfield.world.index import CellEntry, GeometryLevel, IndexTile, MeshLevel
from farfield.world.manifest import Manifest

IndexRoot = tuple[CellKey, str]
"""Cell and hash of an index tile."""


def first_index_tiles(manifest: Manifest) -> list[IndexRoot]:
    """The index tiles that the manifest names."""
    return [(CellKey.parse(root.key), root.hash) for root in manifest.roots]


def parted(tile: IndexTile) -> tuple[list[IndexRoot], list[CellEntry]]:
    """The index tiles below `tile`, and its cells without those that stand in these again, as their first."""
    below = [(entry.cell, entry.index) for entry in tile.cells if entry.index]
    return below, [entry for entry in tile.cells if not entry.index]


def tile_keys(entry: CellEntry) -> list[str]:
    """Keys of the orthoview tiles of a cell."""
    return [keys.orthoview_key(entry.cell, direction, layer, entry.hash) for direction, layer, _ in entry.tiles]


def object_keys(entry: CellEntry) -> list[str]:
    """Keys under which the object ids of those tiles are, where there are any."""
    return [keys.objects_key(entry.cell, direction, layer, entry.hash) for direction, layer, _ in entry.tiles]


def textures_of(data: bytes, where: str) -> tuple[str, ...]:
    """Hashes of the images that a GLB refers to; none for anything else. Raises CorruptTileError: a damaged GLB."""
    return texture_hashes(data, where) if data.startswith((b"glTF", MAGIC)) else ()


def geometry_keys(entry: CellEntry) -> list[tuple[str, int]]:
    """Key and bytes of all forms of a cell's geometry, the meshes they place apart."""
    forms = entry.geometry.forms if entry.geometry else ()
    return [(keys.geometry_key(entry.cell, form.hash), form.bytes) for form in forms]


def blockmap_keys(entry: CellEntry) -> list[tuple[str, int]]:
    """Key and bytes of its BlockMap, if it has one."""
    found = entry.blockmap
    return [(keys.blockmap_key(entry.cell, found.hash), found.bytes)] if found else []


def blockmap_object_keys(entry: CellEntry) -> list[str]:
    """Key under which the object ids of its BlockMap are, where there are any."""
    return [keys.blockmap_objects_key(entry.cell, entry.blockmap.hash)] if entry.blockmap else []


def form_values(cell: CellKey, form: GeometryLevel) -> list[tuple[str, int]]:
    """Key and bytes of all that a form of a leaf's geometry is drawn from; what refers to others comes after them."""
    return [
        *((keys.texture_key(name), size) for name, size in form.textures),
        *((keys.mesh_key(name), size) for name, size in form.meshes),
        (keys.geometry_key(cell, form.hash), form.bytes),
    ]


def level_values(level: MeshLevel) -> list[tuple[str, int]]:
    """Key and bytes of all that a form of a shared mesh is drawn from; what refers to others comes after them."""
    return [
        *((keys.texture_key(name), size) for name, size in level.textures),
        (keys.mesh_key(level.hash), level.bytes),
    ]


def meshes_of(entry: CellEntry) -> dict[str, int]:
    """Hash and bytes of the meshes that a leaf places: by all forms of its near geometry, and in the index."""
    placed = (mesh for form in (entry.geometry.forms if entry.geometry else ()) for mesh in form.meshes)
    listed = ((level.hash, level.bytes) for mesh in entry.instances for level in mesh.levels)
    return dict((*placed, *listed))


def images_of(entry: CellEntry) -> dict[str, int]:
    """Hash and bytes of the images by which a leaf's instances are shown as boards, those of meshes apart."""
    return dict(image for mesh in entry.instances for one in mesh.impostors for image in one.images)
