"""Reading scenes: one reader per format, chosen by the file's extension."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np

from farfield.errors import InputError, OptionError
from farfield.scene.assembly import place
from farfield.scene.faults import existing_file, reading
from farfield.scene.model import Scene
from farfield.scene.options import ReadOptions
from farfield.scene.sniff import expect, holds_city

_Y_TO_Z = np.array([[1.0, 0, 0, 0], [0, 0, -1.0, 0], [0, 1.0, 0, 0]])
_Z_TO_Y = np.array([[1.0, 0, 0, 0], [0, 0, 1.0, 0], [0, -1.0, 0, 0]])


def read_scene(sources: Sequence[Path | str], options: ReadOptions | None = None) -> Scene:
    """Everything the sources hold, in one frame. Only headers are read; meshes load when they are needed.

    sources: files of any readable format, scene.toml files, or folders holding a scene.toml.
    A source that cannot be read becomes a warning as long as another one can. Raises InputError when none can,
    and OptionError when there is nothing to read.
    """
    if not sources:
        raise OptionError("no source is given", hint="name a file or a folder that holds a scene.toml")
    options = options or ReadOptions()
    # Of several sources each has a local zero of its own, before they are brought together.
    each = options if len(sources) == 1 else replace(options, origin=None)
    found: list[Scene] = []
    failures: list[InputError] = []
    for source in sources:
        try:
            found.append(read_source(Path(source), each))
        except InputError as error:
            failures.append(error)
    if not found:
        raise failures[0] if len(failures) == 1 else _none_readable(failures)
    name = found[0].name or _name_of(Path(sources[0]))
    scene = gather(found, options.origin)
    return replace(scene, name=name, warnings=tuple(f"left out: {error}" for error in failures) + scene.warnings)


def _name_of(source: Path) -> str:
    """The file's name; of a scene.toml that of its folder."""
    source = source.resolve()
    return source.parent.name if source.name == "scene.toml" else source.stem.removesuffix(".city").removesuffix(".osm")


def read_source(path: Path, options: ReadOptions) -> Scene:
    """The scene of one file or folder. Raises InputError."""
    if path.is_dir() and (path / "scene.toml").is_file():
        path = path / "scene.toml"
    existing_file(path)
    extension = path.suffix.lower()
    if extension not in _READERS:
        known = " ".join(_READERS)
        raise InputError(f"{extension or 'a file without extension'} is not a format that is read", str(path),
                         f"one of {known}")  # fmt: skip
    kinds, up, reader = _READERS[extension]
    with reading(str(path)):
        expect(path, *kinds)
        scene = reader(path, options)
    return _upright(scene, up, options.up)


def _upright(scene: Scene, up: str, wanted: str | None) -> Scene:
    if not up or wanted is None or wanted == up:
        return scene
    return place(scene, (_Y_TO_Z if wanted == "y" else _Z_TO_Y)[None])


def _none_readable(failures: list[InputError]) -> InputError:
    first = failures[0]
    return InputError(f"{first.what}; and {len(failures) - 1} more sources cannot be read", first.where, first.hint)


def gather(scenes: list[Scene], origin: tuple[float, float, float] | None = None) -> Scene:
    """Scenes joined in the frame of the first that has a CRS, with the local zero of `ReadOptions`."""
    from farfield.scene.georeference import to_common_frame
    from farfield.scene.placements import without_absurd

    return without_absurd(to_common_frame(scenes, origin))


def _gltf(path: Path, options: ReadOptions) -> Scene:
    from farfield.scene.gltf import read_gltf

    return read_gltf(path)


def _obj(path: Path, options: ReadOptions) -> Scene:
    from farfield.scene.surfaces import read_obj

    return read_obj(path)


def _ply(path: Path, options: ReadOptions) -> Scene:
    from farfield.scene.surfaces import read_ply

    return read_ply(path)


def _stl(path: Path, options: ReadOptions) -> Scene:
    from farfield.scene.surfaces import read_stl

    return read_stl(path)


def _toml(path: Path, options: ReadOptions) -> Scene:
    from farfield.scene.composition import read_composition

    return read_composition(path, options)


def _footprints(path: Path, options: ReadOptions) -> Scene:
    from farfield.scene.footprints import read_footprints

    return read_footprints(path, options)


def _cityjson(path: Path, options: ReadOptions) -> Scene:
    from farfield.scene.cityjson import read_cityjson

    return read_cityjson(path, options)


def _json(path: Path, options: ReadOptions) -> Scene:
    return _cityjson(path, options) if holds_city(path) else _footprints(path, options)


_Reader = Callable[[Path, ReadOptions], Scene]
_READERS: dict[str, tuple[tuple[str, ...], str, _Reader]] = {
    ".glb": (("GLB",), "y", _gltf),
    ".gltf": (("glTF",), "y", _gltf),
    ".obj": (("OBJ",), "z", _obj),
    ".ply": (("PLY",), "z", _ply),
    ".stl": (("STL",), "z", _stl),
    ".geojson": (("GeoJSON",), "", _footprints),
    ".json": (("GeoJSON", "CityJSON"), "", _json),
    ".jsonl": (("CityJSON",), "", _cityjson),
    ".gpkg": (("GeoPackage",), "", _footprints),
    ".fgb": (("FlatGeobuf",), "", _footprints),
    ".parquet": (("Parquet",), "", _footprints),
    ".geoparquet": (("Parquet",), "", _footprints),
    ".pbf": (("OSM-PBF",), "", _footprints),
    ".osm": (("OSM-XML",), "", _footprints),
    ".toml": ((), "", _toml),
}
"""Extension -> kinds its content may be, the axis that is up (empty: fixed), and the reader."""
