"""City objects come back from a store as they were, and nothing but sound ones is read."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from farfield.errors import CorruptTileError
from farfield.scene.cityjson.appearance import Image
from farfield.scene.cityjson.chunk import CityChunk
from farfield.scene.stored.cities import StoredCity, encode_city
from farfield.scene.stored.sources import print_of, source_of, words_of
from farfield.store.memory import MemoryStore
from farfield.world.keys import chunk_key
from scene.cityjson.small_city import City, box, semantics


@pytest.fixture
def chunk(tmp_path: Path) -> CityChunk:
    city = City()
    city.add("a", city.cube(**semantics()))
    city.add("b", city.cube(corners=box(x=20)), kind="Road")
    (source,) = city.read(tmp_path).meshes
    assert isinstance(source, CityChunk)
    return replace(source, images=(Image("/somewhere/a.png", 12, 34),))


def test_they_come_back(chunk: CityChunk) -> None:
    store = MemoryStore()
    stored = StoredCity.of(replace(chunk, images=()), store)
    one, two = chunk_without_images(chunk).load(), stored.load()
    for name in ("positions", "triangles", "normals", "uvs", "colors", "triangle_material", "triangle_object"):
        np.testing.assert_array_equal(getattr(one, name), getattr(two, name))
    assert one.materials == two.materials


def chunk_without_images(chunk: CityChunk) -> CityChunk:
    return replace(chunk, images=())


def test_they_are_told_in_words(chunk: CityChunk) -> None:
    store = MemoryStore()
    stored = StoredCity.of(chunk, store)
    words = words_of(stored)
    assert words is not None
    assert source_of(words, store) == stored
    assert print_of(stored) == []


@pytest.mark.parametrize(
    ("name", "change"),
    [
        ("corner", lambda a: a + 1000),
        ("corner", lambda a: a - 1000),
        ("owner", lambda a: a + 7),
        ("owner", lambda a: a[::-1]),
        ("owner", lambda a: a[:-1]),
        ("ring_start", lambda a: a * 0),
        ("face_start", lambda a: a[:-1]),
        ("image", lambda a: a + 9),
        ("family", lambda a: a + 200),
        ("role", lambda a: a + 200),
        ("points", lambda a: a * np.nan),
        ("points", lambda a: a * 1e12),
        ("uv", lambda a: np.zeros((3, 2), np.float32)),
        ("color", lambda a: a[:, :3]),
        ("single", lambda a: a.astype(np.uint8)),
    ],
)
def test_damage_is_noticed(chunk: CityChunk, name: str, change: Any) -> None:
    store = MemoryStore()
    stored = StoredCity.of(chunk, store)
    spoilt = replace(chunk, faces=replace(chunk.faces, **{name: change(getattr(chunk.faces, name))}))
    store.put(chunk_key(stored.chunk), encode_city(spoilt))
    with pytest.raises(CorruptTileError, match="scene chunk is damaged"):
        stored.load()
