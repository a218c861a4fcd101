"""Decoders of what a world remembers of its scene."""

from __future__ import annotations

import struct
import zlib
from contextlib import suppress
from dataclasses import replace

import numpy as np

from farfield.bake.numbering import object_ids
from farfield.errors import InputError
from farfield.octree.grid import Grid
from farfield.scene.cityjson.chunk import CityChunk
from farfield.scene.cityjson.faces import Faces
from farfield.scene.footprints.details import Details
from farfield.scene.footprints.features import Features, chunk_at
from farfield.scene.footprints.order import Square
from farfield.scene.footprints.rings import Rings
from farfield.scene.model import Instances, Scene
from farfield.scene.procedural.ground import GroundPlane
from farfield.scene.stored.cities import StoredCity, decode_city, encode_city
from farfield.scene.stored.footprints import StoredFootprints, decode_features, encode_features
from farfield.scene.stored.scene import KEY, MeshSummary, StoredScene, decode_scene, write_scene
from farfield.store.memory import MemoryStore
from farfield.world.attributes import AttributeIndex, decode_attribute_index, encode_attribute_index
from fuzz.shells import BARE, BARE_JSON, Shell
from fuzz.table import Decoder

_ROOM = 256 << 10
_HEAD = 16


def _listing(chunk: bytes) -> bytes:
    return chunk[_HEAD : _HEAD + int.from_bytes(chunk[8:12], "little")]


def _closed(chunk: bytes, listing: bytes, body: bytes) -> bytes:
    sealed = listing + body
    return chunk[:8] + struct.pack("<II", len(listing), zlib.crc32(sealed)) + sealed


def _body(chunk: bytes) -> bytes:
    return chunk[_HEAD + len(_listing(chunk)) :]


LISTING = Shell("listing", _listing, lambda chunk, part: _closed(chunk, part, _body(chunk)), json=True)
ARRAYS = Shell("arrays", _body, lambda chunk, part: _closed(chunk, _listing(chunk), part))


def footprints() -> Decoder:
    """Buildings, one with a court, one of two parts."""
    box = np.array([(0.0, 0.0), (9.0, 0.0), (9.0, 7.0), (0.0, 7.0)])
    court = np.array([(2.0, 2.0), (2.0, 4.0), (5.0, 4.0), (5.0, 2.0)])
    xy = np.concatenate([box, court, box + 20, box + 40, box + (60, 0)]) - 7000.3
    rings = Rings(xy, np.arange(6) * 4, np.array([0, 2, 3, 4, 5]), np.array([0, 1, 1, 2]))
    features = Features(rings, np.array([0.0, 1.0, 2.5]), np.array([9.0, 12.0, 40.0]), np.arange(3, dtype=np.uint32))
    color = np.array([(200, 40, 30, 255), (0, 0, 0, 0), (9, 9, 9, 255)], np.uint8)
    detailed = replace(features, details=Details(np.array([0.0, 0.0, 2.5]), color, color[::-1]))
    corpus = tuple(encode_features(each) for each in (features, features.of(np.array([1])), detailed))
    return Decoder("footprints", decode_features, corpus, (BARE, LISTING, ARRAYS, ARRAYS), _bound, _use_features)


def _use_features(features: Features) -> None:
    """Extruded, as a bake does."""
    mesh = chunk_at(Square(20, 0), features, "", True).load()
    assert np.isfinite(mesh.positions).all()
    assert mesh.triangles.max(initial=0) < max(len(mesh.positions), 1)
    assert len(features.boxes) == len(features)


def city() -> Decoder:
    """City objects: a face with a hole and a plain one, of two objects."""
    points = (
        np.array([(0.0, 0, 0), (9, 0, 0), (9, 7, 0), (0, 7, 0), (2, 2, 0), (2, 4, 0), (5, 4, 0), (9, 7, 5)]) - 7000.3
    )
    faces = Faces(
        points,
        *(np.array(rows) for rows in ([0, 1, 2, 3, 4, 5, 6, 1, 2, 7], [0, 4, 7, 10], [0, 2, 3], [0, 1])),
        np.array([1, 5], np.uint8), np.array([0, 2], np.uint8), np.array([True, False]), np.array([-1, -1], np.int32),
        np.zeros((2, 4), np.uint8), np.zeros((10, 2), np.float32),
    )  # fmt: skip
    chunk = CityChunk("", faces, np.arange(2, dtype=np.uint32), np.array([1.0, 5.0]), (), True)
    stored = StoredCity(MemoryStore(), "", "", (), True)
    shells = (BARE, LISTING, ARRAYS, ARRAYS)
    return Decoder("city", lambda data: decode_city(data, stored), (encode_city(chunk),), shells, _bound, _use_city)


def _use_city(chunk: CityChunk) -> None:
    """Triangulated, as a bake does."""
    mesh = chunk.load()
    assert np.isfinite(mesh.positions).all()
    assert mesh.triangles.max(initial=0) < max(len(mesh.positions), 1)


def scene_note() -> Decoder:
    """A scene of ground and footprints."""
    store = MemoryStore()
    sources = (GroundPlane(50.0, 40.0), StoredFootprints(store, "0123456789abcdef", "a.fgb", 5, 1 << 29, 12, True))
    rows = Instances(np.array([0, 1], np.int32), np.eye(3, 4)[None].repeat(2, 0), np.array([1, 2]), np.array([1, 12]))
    boxes = np.array([[[0.0, 0, 0], [1, 1, 1]]])
    summaries = [MeshSummary(boxes, 2, "00" * 16), MeshSummary(boxes.repeat(3, 0), 300, "11" * 16, ("a note",))]
    scene = Scene(sources, rows, "town", "EPSG:6677", attribute_parts=("", "0123456789abcdef"), families=("a.fgb",))
    write_scene(store, scene, summaries, [[], []], 1)

    def use(stored: StoredScene | None) -> None:
        if stored is not None:
            assert len(stored.summaries) == len(stored.scene.meshes)
            contents = [summary.content for summary in stored.summaries]
            with suppress(InputError):  # More objects than there are ids.
                object_ids(stored.scene.instances, contents, Grid(8.0, 16, (0.0, 0.0, 0.0), (2, 2, 0)))

    corpus = (store.get(KEY),)
    shells = (BARE, LISTING, LISTING, ARRAYS)
    return Decoder("scene_note", lambda data: decode_scene(data, store, 1), corpus, shells, _bound, use)


def attributes() -> Decoder:
    """An index of two tables."""
    index = AttributeIndex(15, ((1, 12, "0123456789abcdef"), (4097, 3, "fedcba9876543210")))
    corpus = (encode_attribute_index(index),)
    return Decoder("attributes", decode_attribute_index, corpus, (BARE_JSON,), _bound)


def _bound(data: bytes) -> int:
    return 32 * len(data) + _ROOM
