"""`world.json`: what a world is and where its index starts (spec/world.md)."""

from __future__ import annotations

import json

import msgspec

from farfield.errors import MissingKeyError, NotAWorldError, VersionError
from farfield.geometry.directions import Direction
from farfield.octree.grid import CellKey, Grid
from farfield.store.contract import Store

FORMAT = "farfield-world"
VERSION = 1
KEY = "world.json"

Vector = tuple[float, float, float]


class GridRecord(msgspec.Struct, frozen=True):
    """The grid as it is written."""

    leaf_size: float
    resolution: int
    corner: Vector
    axis_levels: tuple[int, int, int]


class DirectionRecord(msgspec.Struct, frozen=True):
    """A baked direction."""

    number: int
    vector: Vector


class RootRecord(msgspec.Struct, frozen=True):
    """A root cell and the hash of its index tile."""

    key: str
    hash: str


class ViewRecord(msgspec.Struct, frozen=True, omit_defaults=True):
    """The camera with which a viewer begins."""

    eye: Vector
    target: Vector
    fov: float = 50.0
    """Vertical field of view, degrees."""


class Statistics(msgspec.Struct, frozen=True):
    """What the bake counted."""

    triangles: int = 0
    objects: int = 0
    cells: int = 0
    orthoviews: int = 0
    tiles: int = 0
    bytes: int = 0
    source_bytes: int = 0


class Manifest(msgspec.Struct, frozen=True, kw_only=True):
    """The manifest of a world."""

    format: str = FORMAT
    version: int = VERSION
    generation: int = 1
    generator: str = ""
    name: str = ""
    crs: str | None = None
    origin: Vector = (0.0, 0.0, 0.0)
    bounds: tuple[Vector, Vector]
    grid: GridRecord
    directions: tuple[DirectionRecord, ...]
    depth_layers: int = 2
    index_depth: int = 4
    roots: tuple[RootRecord, ...] = ()
    credits: tuple[str, ...] = ()
    statistics: Statistics = msgspec.field(default_factory=Statistics)
    attributes: str | None = None
    view: ViewRecord | None = None
    """Camera to begin with; None: the viewer frames the bounds."""

    @property
    def octree(self) -> Grid:
        """The grid of the cells."""
        g = self.grid
        return Grid(g.leaf_size, g.resolution, g.corner, g.axis_levels)

    @property
    def root_keys(self) -> tuple[CellKey, ...]:
        """Keys of the root cells."""
        return tuple(CellKey.parse(r.key) for r in self.roots)

    @property
    def direction_by_number(self) -> dict[int, Direction]:
        """The baked directions by number."""
        return {d.number: Direction(d.number, d.vector) for d in self.directions}


def read_manifest(store: Store) -> Manifest:
    """The manifest of the world in a store. Raises NotAWorldError, VersionError or StoreError."""
    return decode_manifest(manifest_bytes(store), f"{store.location}/{KEY}")


def manifest_bytes(store: Store) -> bytes:
    """The same as it is written, not yet looked at. Raises NotAWorldError or StoreError."""
    try:
        return store.get(KEY)
    except MissingKeyError:
        raise NotAWorldError("no world here", store.location, "farfield bake SOURCE -o WORLD makes one") from None


def encode_manifest(manifest: Manifest) -> bytes:
    """JSON for people too: indented."""
    return msgspec.json.format(msgspec.json.encode(manifest), indent=2) + b"\n"


def decode_manifest(data: bytes, where: str = KEY) -> Manifest:
    """Reads a manifest.

    Raises NotAWorldError when it is not the manifest of a world and VersionError when a newer farfield wrote it.
    """
    hint = "is this the folder of a baked world?"
    try:
        head = json.loads(data)
    except ValueError:
        raise NotAWorldError("not a manifest: no JSON", where, hint) from None
    if not isinstance(head, dict) or head.get("format") != FORMAT:
        raise NotAWorldError("not the manifest of a farfield world", where, hint)
    version = head.get("version")
    if not isinstance(version, int) or version > VERSION:
        raise VersionError(
            f"world of version {version}, this farfield reads up to {VERSION}", where, "upgrade farfield"
        )
    try:
        manifest = msgspec.json.decode(data, type=Manifest)
    except msgspec.ValidationError as error:
        raise NotAWorldError(f"damaged manifest: {error}", where, "bake the world again") from None
    _check_sizes(manifest, where)
    return manifest


def _check_sizes(manifest: Manifest, where: str) -> None:
    grid = manifest.grid
    sane = (
        grid.leaf_size > 0
        and 1 <= grid.resolution <= 4096
        and all(0 <= n <= 40 for n in grid.axis_levels)
        and 1 <= manifest.index_depth <= 16
        and manifest.depth_layers in (1, 2)
    )
    if not sane:
        raise NotAWorldError("damaged manifest: values out of range", where, "bake the world again")
