"""scene.toml: sources placed, repeated by instance tables, and ground; docs/scene-toml.md describes it."""

from __future__ import annotations

import re
import tomllib
from dataclasses import replace
from pathlib import Path
from typing import Literal

import msgspec
import numpy as np
from numpy.typing import NDArray

from farfield.errors import InputError
from farfield.scene.assembly import compose, place, scene_of
from farfield.scene.faults import reading
from farfield.scene.georeference import local_origin, to_common_frame
from farfield.scene.model import Scene
from farfield.scene.options import Facades, ReadOptions
from farfield.scene.procedural.ground import PATTERNS, GroundPlane
from farfield.scene.read import read_source
from farfield.scene.tables import read_table, turned

Triple = tuple[float, float, float]
Row = tuple[float, float, float, float]


class _Table(msgspec.Struct, forbid_unknown_fields=True, frozen=True):
    """What can be placed."""

    translate: Triple = (0.0, 0.0, 0.0)
    at: Triple | None = None
    rotate: float = 0.0
    scale: float | Triple = 1.0
    matrix: tuple[Row, Row, Row] | None = None


class SourceTable(_Table, kw_only=True, forbid_unknown_fields=True, frozen=True):
    """One [[source]]."""

    path: str
    instances: str | None = None
    up: Literal["y", "z"] | None = None
    height_attribute: str | None = None
    base_attribute: str | None = None
    top_attribute: str | None = None
    min_height_attribute: str | None = None
    wall_colour_attribute: str | None = None
    roof_colour_attribute: str | None = None
    default_height: float | None = None
    layer: str | None = None
    facades: Facades | None = None
    use_attribute: str | None = None
    lod: float | None = None


class GroundTable(_Table, kw_only=True, forbid_unknown_fields=True, frozen=True):
    """One [[ground]]."""

    size: float | tuple[float, float]
    texture: str = "plain"
    colour: str | None = None
    tile: float = 30.0


class SceneTable(msgspec.Struct, forbid_unknown_fields=True, frozen=True):
    """The whole file."""

    name: str = ""
    credits: tuple[str, ...] = ()
    crs: str | None = None
    origin: Triple | None = None
    source: tuple[SourceTable, ...] = ()
    ground: tuple[GroundTable, ...] = ()


def read_composition(path: Path, options: ReadOptions) -> Scene:
    """The scene a scene.toml describes. Raises InputError at a mistake in it, or when no source can be read."""
    path = path.resolve()
    if path in options.inside:
        raise InputError("includes itself", str(path), "take it out of its own sources")
    table = parse_composition(path)
    origin = table.origin or options.origin
    options = replace(options, inside=(*options.inside, path), crs=table.crs or options.crs, origin=None)
    scenes: list[Scene] = []
    failures: list[InputError] = []
    for entry in table.source:
        try:
            scenes.append(_source(entry, table, path, options))
        except InputError as error:
            failures.append(error)
    if failures and not scenes:
        raise failures[0]
    scenes += [_ground(entry, table, path) for entry in table.ground]
    if not scenes:
        raise InputError("names no source", str(path), "add a [[source]] with a path")
    scene = to_common_frame(scenes, origin)
    size = scene.source_bytes + path.stat().st_size
    warnings = tuple(f"left out: {error}" for error in failures) + scene.warnings
    lines = tuple(dict.fromkeys(table.credits + scene.credits))
    crs = scene.crs or table.crs
    return replace(scene, name=table.name, credits=lines, source_bytes=size, warnings=warnings, crs=crs)


def parse_composition(path: Path) -> SceneTable:
    """The tables of a scene.toml. Raises InputError naming the key and its table."""
    with reading(str(path)), path.open("rb") as file:
        try:
            return msgspec.convert(tomllib.load(file), SceneTable)
        except tomllib.TOMLDecodeError as error:
            raise InputError(f"is not TOML: {error}", str(path), "mend that line") from error
        except msgspec.ValidationError as error:
            raise InputError(_in_words(str(error)), str(path), "docs/scene-toml.md lists the keys") from error


def _in_words(message: str) -> str:
    """'Object contains unknown field `sise` - at `$.ground[0]`' -> 'unknown key `sise` in [[ground]] 1'."""
    text, _, place_ = message.partition(" - at ")
    text = text.replace("Object contains unknown field", "unknown key")
    text = text.replace("Object missing required field", "missing key")
    found = re.match(r"`\$\.?(\w+)?(?:\[(\d+|\.\.\.)\])?(?:\.(\w+))?", place_)
    if not found or not found[1]:
        return text
    if found[2] is None:
        return f"{text} in {found[1]}"
    table = f"[[{found[1]}]] {int(found[2]) + 1}" if found[2].isdigit() else f"[[{found[1]}]]"
    return f"{text} in {found[3]} of {table}" if found[3] else f"{text} in {table}"


_OPTIONS = (
    "up", "height_attribute", "base_attribute", "top_attribute", "min_height_attribute", "wall_colour_attribute",
    "roof_colour_attribute", "default_height", "layer", "facades", "use_attribute",
    "lod",
)  # fmt: skip
"""Keys of a [[source]] that are options of its reader."""


def _source(entry: SourceTable, table: SceneTable, path: Path, options: ReadOptions) -> Scene:
    given = {name.replace("colour", "color"): value for name in _OPTIONS if (value := getattr(entry, name)) is not None}
    scene = read_source(path.parent / entry.path, replace(options, **given))
    own = _transform(entry, path)[None]
    if entry.instances is not None:
        file = path.parent / entry.instances
        own = compose(read_table(file), own)
        scene = replace(scene, source_bytes=scene.source_bytes + file.stat().st_size)
    if not np.array_equal(own, np.eye(4)[None, :3]):
        scene = place(scene, own)
    return _located(scene, entry, table, path)


def _ground(entry: GroundTable, table: SceneTable, path: Path) -> Scene:
    if entry.texture not in PATTERNS:
        known = ", ".join(PATTERNS)
        raise InputError(f"unknown texture {entry.texture!r} in [[ground]]", str(path), f"one of {known}")
    width, depth = entry.size if isinstance(entry.size, tuple) else (entry.size, entry.size)
    if not (0 < width < np.inf and 0 < depth < np.inf and 0 < entry.tile < np.inf):
        raise InputError("size and tile of [[ground]] must be positive", str(path), "give metres")
    plane = GroundPlane(width, depth, entry.texture, _color(entry.colour, path), entry.tile)
    return _located(scene_of([plane], np.zeros(1, np.int32), _transform(entry, path)[None]), entry, table, path)


def _transform(entry: _Table, path: Path) -> NDArray[np.float64]:
    """(3, 4): scale, then turn, then move."""
    if entry.matrix is not None:
        if entry.translate != (0, 0, 0) or entry.rotate or entry.scale != 1.0:
            raise InputError("matrix stands beside translate, rotate or scale", str(path), "give one or the other")
        return np.array(entry.matrix, np.float64)
    linear = turned(np.array([entry.rotate]))[0] * np.broadcast_to(np.array(entry.scale, np.float64), 3)
    return np.concatenate([linear, np.array(entry.translate)[:, None]], 1)


def _located(scene: Scene, entry: _Table, table: SceneTable, path: Path) -> Scene:
    """With `at`: local zero of the scene at those CRS coordinates."""
    if entry.at is None:
        return scene
    if table.crs is None:
        raise InputError("at needs a crs", str(path), 'add e.g. crs = "EPSG:6677" at the top, or use translate')
    if scene.crs is not None:
        raise InputError(
            f"{entry.path if isinstance(entry, SourceTable) else 'it'} has coordinates of its own",
            str(path),
            "leave out its at",
        )
    origin = local_origin(entry.at)
    shift = np.eye(4)[:3]
    shift[:, 3] = np.subtract(entry.at, origin)
    return replace(place(scene, shift[None]), crs=table.crs, origin=origin)


def _color(text: str | None, path: Path) -> tuple[int, int, int] | None:
    if text is None:
        return None
    if not re.fullmatch(r"#[0-9a-fA-F]{6}", text):
        raise InputError(f"{text!r} is not a colour", str(path), 'write it like "#8a8a80"')
    return int(text[1:3], 16), int(text[3:5], 16), int(text[5:7], 16)
