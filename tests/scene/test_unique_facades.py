"""Façades of which no two are the same: whole, upright, told by the seed alone, in chunks that are small."""

from __future__ import annotations

from hashlib import blake2b
from pathlib import Path
from typing import Any

import numpy as np
import pyogrio
import pytest
import shapely
from hypothesis import given, settings
from hypothesis import strategies as st

from farfield.errors import InputError
from farfield.scene.footprints.order import UNIQUE_PER_MESH
from farfield.scene.footprints.unique import FACADE_SIDE, HELD, KINDS, PIER, Layout, Styles
from farfield.scene.footprints.use import INDUSTRIAL, OFFICE, RESIDENTIAL, RETAIL, UNKNOWN, use_of, uses_of, with_use
from farfield.scene.model import Mesh, Scene
from farfield.scene.options import ReadOptions
from farfield.scene.read import read_scene
from farfield.scene.stored.sources import source_of, words_of
from farfield.store.memory import MemoryStore

UNIQUE = ReadOptions(facades="unique")


def write(path: Path, shapes: list[Any], **columns: list[Any]) -> Path:
    arrays = [np.array(column, object if isinstance(column[0], str) else None) for column in columns.values()]
    pyogrio.raw.write(path, shapely.to_wkb(np.array(shapes, object)), arrays, list(columns), driver="FlatGeobuf",
                      crs="EPSG:6677", geometry_type="Polygon", SPATIAL_INDEX="NO")  # fmt: skip
    return path


def load(scene: Scene) -> Mesh:
    (source,) = scene.meshes
    return source.load()


def styles(count: int, low: float = 4.0, high: float = 80.0) -> Styles:
    random = np.random.default_rng(5)
    seeds = random.integers(0, 1 << 32, count, dtype=np.uint64).astype(np.uint32)
    return Styles.of(with_use(seeds, np.zeros(count, np.uint32)), random.uniform(low, high, count))


def test_no_two_look_the_same() -> None:
    some = styles(60)
    pictures = np.array([some.pixels(row, 8, 64)[..., :3] for row in range(60)]).astype(np.int16)
    apart = np.abs(pictures[:, None] - pictures[None]).mean(axis=(2, 3, 4)) + 255 * np.eye(60)
    assert apart.min() > 4


def test_the_seed_tells_all() -> None:
    many, one = styles(9), styles(1)
    alone = Styles.of(many.seed[4:5], np.array([33.0]))
    among = Styles.of(many.seed, np.full(9, 33.0))
    np.testing.assert_array_equal(alone.pixels(0, 7), among.pixels(4, 7))
    assert one.pixels(0, 5).shape == (FACADE_SIDE, FACADE_SIDE, 4)
    assert one.pixels(0, 5, 512).shape == (512, 512, 4)


def test_the_same_bytes_on_every_machine() -> None:
    some = Styles.of(np.array([8, 123456 << 3, 0xFFFFFFF8], np.uint32), np.array([7.0, 25.0, 90.0]))
    digest = blake2b(b"".join(some.pixels(row, 11, 128).tobytes() for row in range(3)), digest_size=8)
    assert digest.hexdigest() == "4304258f5fb1a509"


def test_sizes_are_one_picture() -> None:
    some = styles(6, 4.0, 12.0)
    for row in range(6):
        fine = some.pixels(row, 6, 512)[..., :3].astype(np.float64)
        halved = fine.reshape(256, 2, 256, 2, 3).mean(axis=(1, 3))
        assert np.abs(halved - some.pixels(row, 6, 256)[..., :3]).mean() < 6


def test_floors_bays_and_ground(tmp_path: Path) -> None:
    scene = read_scene([write(tmp_path / "a.fgb", [shapely.box(0, 0, 14, 9)], height=[21.0])], UNIQUE)
    mesh = load(scene)
    assert mesh.uvs is not None
    assert mesh.colors is not None
    walls = mesh.triangle_material == 1
    corners = mesh.triangles[walls]
    uvs, z = mesh.uvs[corners], mesh.positions[corners][..., 2]
    inset = np.float32(0.5 / FACADE_SIDE)
    assert ((uvs >= 0) & (uvs <= 1)).all()
    # The whole façade from the ground to the roof, once.
    np.testing.assert_array_equal(uvs[..., 1], np.where(z == 0, np.float32(1) - inset, inset))
    assert (mesh.colors[corners] == 255).all()
    u = np.ptp(uvs[..., 0], axis=1).reshape(4, 2)
    np.testing.assert_allclose(u[:, 0], u[:, 1])
    texture = mesh.materials[1].texture
    assert texture is not None
    assert texture.pixels.shape == (FACADE_SIDE, FACADE_SIDE, 4)


def test_long_walls_are_cut_and_nothing_is_lost(tmp_path: Path) -> None:
    shape = shapely.box(0, 0, 230, 1.2).union(shapely.box(0, 0, 20, 40))
    scene = [read_scene([write(tmp_path / "a.fgb", [shape], height=[9.0])], ReadOptions(facades=kind))
             for kind in ("unique", True)]  # fmt: skip
    unique, shared = (load(one) for one in scene)

    def area(mesh: Mesh) -> float:
        a, b, c = (mesh.positions[mesh.triangles[:, k]] for k in range(3))
        return float(np.linalg.norm(np.cross(b - a, c - a), axis=1).sum() / 2)

    assert len(unique.triangles) > len(shared.triangles)
    assert area(unique) == pytest.approx(area(shared), rel=1e-9)
    # Corners of walls are the very same.
    assert {tuple(p) for p in shared.positions.tolist()} <= {tuple(p) for p in unique.positions.tolist()}


@settings(deadline=None, max_examples=60)
@given(st.lists(st.lists(st.floats(0.01, 400.0), min_size=3, max_size=12), min_size=1, max_size=6))
def test_walls_lie_within_their_facades(buildings: list[list[float]]) -> None:
    length = np.array([wall for walls in buildings for wall in walls])
    owner = np.repeat(np.arange(len(buildings)), [len(walls) for walls in buildings])
    some = styles(len(buildings))
    layout = Layout.of(length, owner, some)
    assert (layout.bays >= 1).all()
    assert (layout.bays <= HELD).all()
    held = layout.bays[owner[layout.wall]]
    assert (layout.u >= 0).all()
    assert (layout.u <= 1 + 1e-12).all()
    bays = (layout.u * held[:, None]).round(9)
    short = length[layout.wall] < 1.5
    np.testing.assert_allclose(bays[:, 0], np.round(bays[:, 0]), atol=1e-9)
    np.testing.assert_allclose(np.diff(bays[short])[:, 0], PIER, atol=1e-9)
    whole = np.diff(bays[~short])[:, 0]
    assert (whole >= 1).all()
    np.testing.assert_allclose(whole, np.round(whole), atol=1e-9)
    for wall in range(len(length)):
        own = layout.share[layout.wall == wall]
        np.testing.assert_allclose(own[:, 0], np.concatenate([[0], own[:-1, 1]]))
        assert own[-1, 1] == 1
        count = np.diff(bays[layout.wall == wall]).sum()
        if length[wall] >= 1.5:
            assert count == pytest.approx(max(round(length[wall] / some.bay[owner[wall]]), 1))


def test_chunks_are_small_and_a_building_has_a_material(tmp_path: Path) -> None:
    shapes = [shapely.box(30 * i, 30 * j, 30 * i + 9, 30 * j + 11) for i in range(15) for j in range(15)]
    scene = read_scene([write(tmp_path / "a.fgb", shapes, height=list(np.arange(225) % 40 + 4.0))], UNIQUE)
    assert scene.object_count == 225
    for source in scene.meshes:
        mesh = source.load()
        assert mesh.object_count <= UNIQUE_PER_MESH
        assert len(mesh.materials) == mesh.object_count + 1
        walls = mesh.triangle_material > 0
        assert mesh.triangle_object is not None
        np.testing.assert_array_equal(mesh.triangle_material[walls], mesh.triangle_object[walls] + 1)


def test_words_of_use() -> None:
    words = ["Residential", "共同住宅", "Wohngebäude", "warehouse", "工場", "Bureaux", "OFFICE",
             "Commercial et services", "店舗", "supermarket", "church", None, 3]  # fmt: skip
    expected = [RESIDENTIAL] * 3 + [INDUSTRIAL] * 2 + [OFFICE] * 2 + [RETAIL] * 3 + [UNKNOWN] * 3
    assert uses_of(np.array(words, object)).tolist() == expected


@pytest.mark.parametrize(("word", "use"), [
    ("business", OFFICE), ("usine", INDUSTRIAL), ("ancienne-usine", INDUSTRIAL), ("restored", UNKNOWN),
    ("bishop", UNKNOWN), ("semidetached_house", RESIDENTIAL), ("d'habitation", RESIDENTIAL),
    ("2apartments", RESIDENTIAL), ("Mehrfamilienwohnhaus", RESIDENTIAL), ("Kühllager", INDUSTRIAL),
    ("Einzelhandel", RETAIL), ("大型商業施設", RETAIL),
])  # fmt: skip
def test_words_are_known_by_their_beginnings(word: str, use: int) -> None:
    assert uses_of(np.array([word], object)).tolist() == [use]


def test_each_word_is_understood_once(monkeypatch: pytest.MonkeyPatch) -> None:
    asked: list[Any] = []

    def meaning(value: Any) -> int:
        asked.append(value)
        return OFFICE

    monkeypatch.setattr("farfield.scene.footprints.use._use", meaning)
    assert uses_of(np.array(["office", "school", "office"], object)).tolist() == [OFFICE] * 3
    assert sorted(asked) == ["office", "school"]


def test_a_use_decides(tmp_path: Path) -> None:
    shapes = [shapely.box(30 * i, 0, 30 * i + 9, 11) for i in range(8)]
    path = write(tmp_path / "a.fgb", shapes, height=[8.0] * 8, what=["Industrie", "Retail"] * 4)
    scene = read_scene([path], ReadOptions(facades="unique", use_attribute="what"))
    names = {mesh.materials[1:][k].name for mesh in [load(scene)] for k in range(8)}
    assert names == {"industrial", "retail"}
    with pytest.raises(InputError, match="has no attribute 'usage'"):
        read_scene([path], ReadOptions(facades="unique", use_attribute="usage"))


def test_heights_decide_without_a_use() -> None:
    seeds = with_use(np.arange(0, 80_000, 8, dtype=np.uint32), np.zeros(10_000, np.uint32))
    assert (use_of(seeds) == UNKNOWN).all()
    kinds = [np.bincount(Styles.of(seeds, np.full(10_000, h)).kind, minlength=len(KINDS)) for h in (6.0, 20.0, 90.0)]
    assert kinds[0].argmax() == KINDS.index("house")
    assert kinds[1].argmax() == KINDS.index("apartments")
    assert kinds[2].argmax() == KINDS.index("tower")
    assert kinds[2][KINDS.index("house")] == 0


def test_scene_toml(tmp_path: Path) -> None:
    write(tmp_path / "a.fgb", [shapely.box(0, 0, 14, 9)], height=[21.0], use=["office"])
    toml = tmp_path / "scene.toml"
    toml.write_text('[[source]]\npath = "a.fgb"\nfacades = "unique"\nuse_attribute = "use"\n')
    assert load(read_scene([toml])).materials[1].name == "office"
    toml.write_text('[[source]]\npath = "a.fgb"\nfacades = "same"\n')
    with pytest.raises(InputError, match="facades"):
        read_scene([toml])


def test_a_world_remembers_them(tmp_path: Path) -> None:
    from farfield.scene.stored.footprints import StoredFootprints

    scene = read_scene([write(tmp_path / "a.fgb", [shapely.box(0, 0, 14, 9)], height=[21.0])], UNIQUE)
    store = MemoryStore()
    stored = StoredFootprints.of(scene.meshes[0], store)  # type: ignore[arg-type]
    words = words_of(stored)
    assert words is not None
    again = source_of(words, store).load()
    assert again.materials[1].texture is not None
    first = load(scene).materials[1].texture
    assert first is not None
    np.testing.assert_array_equal(again.materials[1].texture.pixels, first.pixels)
