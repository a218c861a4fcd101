"""`world.json`: what a world is and where its index starts (spec/world.md)."""

from __future__ import annotations

from math import hypot
from typing import Annotated, Any

import msgspec
from msgspec import Meta

from farfield.errors import MissingKeyError, NotAWorldError, OptionError, VersionError
from farfield.geometry.directions import Direction
from farfield.octree.grid import MAXIMUM_LEVEL, CellKey, Grid
from farfield.store.contract import Store
from farfield.world.limits import DAMAGE, Bounds, Count, DirectionNumber, Hash, Vector, is_box
from farfield.world.servers import RULE, ServersRecord

FORMAT = "farfield-world"
VERSION = 1
KEY = "world.json"

_Level = Annotated[int, Meta(ge=0, le=MAXIMUM_LEVEL)]


class GridRecord(msgspec.Struct, frozen=True):
    """The grid as it is written."""

    leaf_size: Annotated[float, Meta(ge=1e-6, le=1e9)]
    resolution: Annotated[int, Meta(ge=1, le=4096)]
    corner: Vector
    axis_levels: tuple[_Level, _Level, _Level]


class DirectionRecord(msgspec.Struct, frozen=True):
    """A baked direction."""

    number: DirectionNumber
    vector: Vector
    """Towards the camera, unit length."""


class RootRecord(msgspec.Struct, frozen=True):
    """A root cell and the hash of its index tile."""

    key: str
    hash: Hash


class ViewRecord(msgspec.Struct, frozen=True, omit_defaults=True):
    """The camera with which a viewer begins."""

    eye: Vector
    target: Vector
    fov: Annotated[float, Meta(gt=0, lt=180)] = 50.0
    """Vertical field of view, degrees."""


class Statistics(msgspec.Struct, frozen=True):
    """What the bake counted."""

    triangles: Count = 0
    objects: Count = 0
    cells: Count = 0
    orthoviews: Count = 0
    tiles: Count = 0
    bytes: Count = 0
    source_bytes: Count = 0


class Manifest(msgspec.Struct, frozen=True, kw_only=True):
    """The manifest of a world."""

    format: str = FORMAT
    version: int = VERSION
    generation: Count = 1
    generator: str = ""
    name: str = ""
    crs: str | None = None
    origin: Vector = (0.0, 0.0, 0.0)
    bounds: Bounds
    grid: GridRecord
    directions: Annotated[tuple[DirectionRecord, ...], Meta(max_length=256)]
    depth_layers: Annotated[int, Meta(ge=1, le=2)] = 2
    index_depth: Annotated[int, Meta(ge=2, le=16)] = 4
    """Levels of cells in one index tile; the lowest of them is the highest of the next tile, so one would not do."""
    near: Annotated[float, Meta(gt=0, le=1)] | msgspec.UnsetType = msgspec.UNSET
    """Leaves nearer than this times r are geometry, unless the viewer is told otherwise; UNSET, and not written: 1."""
    roots: Annotated[tuple[RootRecord, ...], Meta(max_length=8)] = ()
    credits: tuple[str, ...] = ()
    statistics: Statistics = msgspec.field(default_factory=Statistics)
    attributes: Hash | None = None
    view: ViewRecord | None = None
    """Camera to begin with; None: the viewer frames the bounds."""
    servers: ServersRecord | msgspec.UnsetType = msgspec.UNSET
    """Over which servers the world is split; UNSET, and not written: everything is where the manifest is."""

    @property
    def near_share(self) -> float:
        """Of r, within which leaves are geometry."""
        return 1.0 if self.near is msgspec.UNSET else self.near

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


def with_servers(data: bytes, servers: ServersRecord | None) -> bytes:
    """The manifest `data` of a world split so, or (None) of one that is all in one place; every other member stays as
    it is written, those that this version does not know among them."""
    members = msgspec.json.decode(data, type=dict[str, msgspec.Raw])
    members.pop("servers", None)
    if servers is not None:
        members["servers"] = msgspec.Raw(msgspec.json.encode(servers))
    return msgspec.json.format(msgspec.json.encode(members), indent=2) + b"\n"


class _Head(msgspec.Struct):
    """What is read of a manifest before its version is known."""

    format: Any = None
    version: Any = None
    servers: msgspec.Raw = msgspec.Raw(b"null")


class _RuleHead(msgspec.Struct):
    """What is read of `servers` before its rule is known."""

    rule: str = RULE


def decode_manifest(data: bytes, where: str = KEY) -> Manifest:
    """Reads a manifest; allocates at most 32 bytes for each byte of it.

    Raises NotAWorldError when it is not the manifest of a world and VersionError when a newer farfield wrote it, or
    split it by a rule of its own.
    """
    _check_head(data, where)
    try:
        manifest = msgspec.json.decode(data, type=Manifest)
        fault = _fault_of(manifest)
    except (*DAMAGE, OptionError) as error:
        fault = str(error)
    if fault:
        raise NotAWorldError(f"damaged manifest: {fault}", where, "bake the world again")
    return manifest


def _check_head(data: bytes, where: str) -> None:
    hint = "is this the folder of a baked world?"
    try:
        head = msgspec.json.decode(data, type=_Head)
    except msgspec.ValidationError:
        head = _Head()
    except DAMAGE:
        raise NotAWorldError("not a manifest: no JSON", where, hint) from None
    if head.format != FORMAT:
        raise NotAWorldError("not the manifest of a farfield world", where, hint)
    version = head.version
    if isinstance(version, int) and version > VERSION:
        raise VersionError(
            f"world of version {version}, this farfield reads up to {VERSION}", where, "upgrade farfield"
        )
    if type(version) is not int or version < 1:
        raise NotAWorldError("damaged manifest: without a version", where, "bake the world again")
    _check_rule(head.servers, where)


def _check_rule(servers: msgspec.Raw, where: str) -> None:
    """Raises VersionError for a rule of later versions; what else is wrong with it is found when it is read."""
    try:
        rule = msgspec.json.decode(servers, type=_RuleHead).rule
    except DAMAGE:
        return
    if rule != RULE:
        what = f"the world is split over servers by the rule {rule[:80]!r}, this farfield knows {RULE!r} only"
        raise VersionError(what, where, "upgrade farfield")


def _fault_of(manifest: Manifest) -> str:
    """What contradicts itself, or nothing. Raises OptionError for a root that is no cell."""
    top, roots = manifest.octree.top_level, manifest.root_keys
    if not is_box(manifest.bounds):
        return "bounds are upside down"
    if any(abs(hypot(*d.vector) - 1) > 1e-3 for d in manifest.directions):
        return "a direction is not of unit length"
    if len(set(roots)) < len(roots) or any(r.level != top or not {*r[1:]} <= {-1, 0} for r in roots):
        return f"roots are not among the 8 cells of level {top}"
    return manifest.servers.fault if manifest.servers else ""
