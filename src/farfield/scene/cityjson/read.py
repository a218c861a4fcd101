"""A CityJSON file as a Scene: objects parted by place into chunks, templates as meshes placed many times."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterator
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from farfield.errors import InputError
from farfield.scene.cityjson.appearance import report
from farfield.scene.cityjson.chunk import CityChunk
from farfield.scene.cityjson.city import City, read_city
from farfield.scene.cityjson.faces import Faces
from farfield.scene.cityjson.objects import columns_of
from farfield.scene.cityjson.templates import of_family
from farfield.scene.faults import counted
from farfield.scene.footprints.features import by_place, centres_of
from farfield.scene.footprints.order import morton_codes, split
from farfield.scene.footprints.seeds import content_seeds
from farfield.scene.georeference import local_origin
from farfield.scene.model import Instances, Scene
from farfield.scene.options import ReadOptions

TRIANGLES_PER_MESH = 100_000
LEAST_TRIANGLES = 24
"""That an object counts as, so that a mesh has at most some 4,000 of them."""


@dataclass(frozen=True, slots=True, eq=False)
class _Part:
    """A mesh of the scene, placed once, or a template placed by each of its objects."""

    chunk: CityChunk
    transforms: NDArray[np.float64]
    """(k, 3, 4) to coordinates of the CRS."""
    objects: NDArray[np.int64]
    """Rows of the file's table: all of the chunk when it is placed once, else one a placement."""
    continued: bool = False
    """Whether it is a further piece of the one object of the part before."""


def read_cityjson(path: Path, options: ReadOptions, most: int = TRIANGLES_PER_MESH) -> Scene:
    """The objects of a CityJSON or CityJSONSeq file, one for each city object at the top, ordered by place.

    most: triangles of a mesh. Raises InputError when it holds none that can be drawn, and MissingExtraError.
    """
    where = str(path)
    faults: Counter[str] = Counter()
    warnings: list[str] = []
    city = read_city(path, options, faults, warnings)
    parts = [*_chunks(city, where, bool(options.facades), most), *_shared(city, where)]
    rows = np.concatenate([part.objects for part in parts if not part.continued] or [np.empty(0, np.int64)])
    if lost := len(city.rows) - len(rows):
        faults["object without geometry"] += lost
    columns = columns_of([city.rows[row] for row in rows.tolist()], faults)
    warnings += report(city.images, where, faults) + _lines(faults, where)
    if not parts:
        why = f"; {warnings[0].removeprefix(where + ': ')}" if warnings else ""
        raise InputError(f"holds no surfaces{why}", where, "check what was exported")
    scene = _scene(parts, city.crs)
    return replace(scene, source_bytes=path.stat().st_size, warnings=tuple(warnings), attributes=columns)


def _lines(faults: Counter[str], where: str) -> list[str]:
    """A line for each kind; a kind is a noun and what is wrong with it."""
    kinds = [(kind.split(" ", 1), count) for kind, count in faults.items() if count]
    return [f"{where}: left out {counted(count, noun)} {rest}" for (noun, rest), count in kinds]


def _chunks(city: City, where: str, facades: bool, most: int) -> Iterator[_Part]:
    """Objects by place; one that is too large for a mesh in pieces, by the place of its faces."""
    faces, count = city.faces, len(city.rows)
    triangles = np.maximum(faces.sizes - 2, 0)
    each = np.bincount(faces.owner, triangles, count).astype(np.int64)
    boxes = faces.boxes(count)
    there = np.flatnonzero(np.bincount(faces.owner, minlength=count))
    flat = boxes[:, :, :2].reshape(-1, 4)
    height = np.zeros(count)
    height[there] = np.ptp(boxes[there, :, 2], axis=1)
    seed = np.zeros(count, np.uint32)
    seed[there] = content_seeds(centres_of(flat[there]), height[there])
    images = tuple(city.images.found)
    codes, objects = by_place(flat, there[each[there] <= most])
    by_object = np.argsort(faces.owner, kind="stable")
    starts = np.searchsorted(faces.owner[by_object], np.arange(count + 1))
    ranges = split(codes, most, np.maximum(each[objects], LEAST_TRIANGLES))
    for square, low, high in ranges:
        own = objects[low:high]
        rows = np.concatenate([by_object[starts[k] : starts[k + 1]] for k in own])
        part = replace(faces.of(rows), owner=np.repeat(np.arange(len(own)), starts[own + 1] - starts[own]))
        name = f"{where}, {square}" if len(ranges) > 1 else where
        yield _part(CityChunk(name, part, seed[own], height[own], images, facades), own)
    for large in there[each[there] > most].tolist():
        rows = by_object[starts[large] : starts[large + 1]]
        own = np.array([large])
        for number, piece in enumerate(_pieces(faces.of(rows), most)):
            name = f"{where}, {city.rows[large]['id']}, piece {number}"
            chunk = CityChunk(name, piece, seed[own], height[own], images, facades)
            yield _part(chunk, own, number > 0)


def _pieces(faces: Faces, most: int) -> Iterator[Faces]:
    """The faces of one object, parted by where the middles of their corners are."""
    starts = faces.ring_start[faces.face_start[:-1]]
    middles = np.add.reduceat(faces.points[faces.corner, :2], starts, axis=0) / faces.sizes[:, None]
    codes = morton_codes(middles)
    order = np.argsort(codes, kind="stable")
    owner = np.zeros(len(faces), np.int64)
    weights = np.maximum(faces.sizes - 2, 0)[order]
    for _, low, high in split(codes[order], most, weights):
        rows = order[low:high]
        yield replace(faces.of(rows), owner=owner[rows])


def _part(chunk: CityChunk, objects: NDArray[np.int64], continued: bool = False) -> _Part:
    transform = np.eye(4)[None, :3].copy()
    transform[0, :, 3] = chunk.corner
    return _Part(chunk.of_own_images(), transform, objects, continued)


def _shared(city: City, where: str) -> Iterator[_Part]:
    """A mesh for each template and family of those that have it."""
    kinds = dict.fromkeys((one.template, one.family) for one in city.shared)
    for template, family in kinds:
        faces = of_family(city.templates.faces(template), family)
        height = np.array([np.ptp(faces.points[:, 2])])
        name = f"{where}, template {template} as {family.name.lower().replace('_', ' ')}"
        seed = content_seeds(np.zeros((1, 2)), height)
        chunk = CityChunk(name, faces, seed, height, tuple(city.images.found), False)
        placed = [one for one in city.shared if (one.template, one.family) == (template, family)]
        transforms = np.array([one.transform for one in placed])
        transforms[:, :, 3] += transforms[:, :, :3] @ chunk.corner
        yield _Part(chunk.of_own_images(), transforms, np.array([one.owner for one in placed], np.int64))


def _scene(parts: list[_Part], crs: str | None) -> Scene:
    """Objects are numbered in the order of the parts; pieces of one have the same numbers."""
    places = np.concatenate([part.transforms for part in parts])
    origin = (0.0, 0.0, 0.0) if crs is None else local_origin(tuple(places[:, :, 3].min(axis=0)))
    places[:, :, 3] -= origin
    mesh = np.repeat(np.arange(len(parts), dtype=np.int32), [len(part.transforms) for part in parts])
    objects = np.concatenate(
        [np.full(len(part.transforms), len(part.objects) // len(part.transforms), np.int64) for part in parts]
    )
    continued = np.array([part.continued for part in parts], bool)[mesh]
    ends = np.cumsum(np.where(continued, 0, objects))
    first = ends - objects + 1
    instances = Instances(mesh, np.ascontiguousarray(places), first, objects)
    return Scene(tuple(part.chunk for part in parts), instances, crs=crs, origin=origin, object_count=int(ends[-1]))
