"""Names of a world's values in its store (spec/world.md)."""

from __future__ import annotations

import re
from dataclasses import dataclass
from hashlib import blake2b

from farfield.octree.grid import CellKey
from farfield.represent.geometry.board import TURNS

DYNAMIC = "impostor/"
"""What their keys begin with."""
_DYNAMIC = re.compile(r"impostor/([0-9a-f]{16})-([1-9][0-9]{0,3})-(0|[1-9][0-9]?)-([0-8])")


def content_hash(*parts: bytes) -> str:
    """16 hexadecimal digits of BLAKE2b-64 over the parts, each preceded by its length."""
    digest = blake2b(digest_size=8)
    for part in parts:
        digest.update(len(part).to_bytes(8, "little"))
        digest.update(part)
    return digest.hexdigest()


def orthoview_key(cell: CellKey, direction: int, layer: int, cell_hash: str) -> str:
    """Key of one layer of one orthoview."""
    return f"orthoview/{cell}/{direction}/{layer}-{cell_hash}"


def objects_key(cell: CellKey, direction: int, layer: int, cell_hash: str) -> str:
    """Key of the object ids of one layer of one orthoview."""
    return f"objects/{cell}/{direction}/{layer}-{cell_hash}"


def index_key(cell: CellKey, tile_hash: str) -> str:
    """Key of the index tile whose first cell is `cell`."""
    return f"index/{cell}-{tile_hash}"


def geometry_key(cell: CellKey, file_hash: str) -> str:
    """Key of the near geometry of a leaf."""
    return f"geometry/{cell}-{file_hash}"


def blockmap_key(cell: CellKey, file_hash: str) -> str:
    """Key of the BlockMap of a cell."""
    return f"blockmap/{cell}-{file_hash}"


def blockmap_objects_key(cell: CellKey, file_hash: str) -> str:
    """Key of the object ids of a BlockMap."""
    return f"objects/{cell}/blockmap-{file_hash}"


def mesh_key(file_hash: str) -> str:
    """Key of a mesh that instances share."""
    return f"mesh/{file_hash}"


def texture_key(file_hash: str) -> str:
    """Key of an image that GLBs refer to."""
    return f"texture/{file_hash}"


@dataclass(frozen=True, slots=True)
class DynamicImpostor:
    """An image of a shared mesh that a server makes on demand; no store has it (spec/stream.md)."""

    mesh: str
    """Hash of the full mesh."""
    rows: int
    """Pixels for the height of the mesh's box."""
    turn: int
    """Azimuth of the eye, TURNS-ths of a turn."""
    tilt: int
    """Its elevation, TILTS-ths of half a turn from straight below."""

    @property
    def key(self) -> str:
        """As it is named among the values of a world."""
        return f"{DYNAMIC}{self.mesh}-{self.rows}-{self.turn}-{self.tilt}"

    @classmethod
    def of(cls, key: str) -> DynamicImpostor | None:
        """What a key names; None: something else."""
        found = _DYNAMIC.fullmatch(key)
        if found is None or int(found[3]) >= TURNS:
            return None
        return cls(found[1], int(found[2]), int(found[3]), int(found[4]))


def record_key(cell: CellKey) -> str:
    """Key of the bake's note about a cell."""
    return f"record/{cell}"


def chunk_key(name: str) -> str:
    """Key of a part of the scene that the world was baked from (scene.stored); name: its content hash."""
    return f"record/chunk/{name}"


def attributes_key(name: str) -> str:
    """Key of attributes of objects, or of the index of such tables; name: its content hash."""
    return f"attributes/{name}"


def split_key(name: str) -> str:
    """Key of the note that tells which chunks a mesh became (world.chunks); name: hash of its file and place there."""
    return f"record/split/{name}"
