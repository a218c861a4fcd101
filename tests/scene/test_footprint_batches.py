"""Footprints read in batches and parts: the scene is the same whatever their size."""

from __future__ import annotations

import json
import pickle
import tempfile
from pathlib import Path
from typing import Any

import numpy as np
import pyarrow
import pyarrow.parquet
import pyogrio
import pytest
import shapely
from hypothesis import example, given, settings
from hypothesis import strategies as st

from farfield.errors import InputError
from farfield.scene.footprints import ogr, read_footprints
from farfield.scene.footprints.features import FootprintChunk
from farfield.scene.footprints.rings import Rings, flat_rings
from farfield.scene.footprints.table import with_shared_text
from farfield.scene.model import Scene
from farfield.scene.options import ReadOptions

CORNER = st.tuples(st.integers(-40, 40), st.integers(-40, 40))
METRES = np.array([-6500.0, -35500.0])
DEGREES = np.array([139.7, 35.6])
KINDS = ["house", "shop", "", None]


def box(corner: tuple[int, int], width: int = 9) -> shapely.Polygon:
    return shapely.box(*corner, corner[0] + width, corner[1] + 6)


def court(corner: tuple[int, int]) -> shapely.Polygon:
    """With two holes, the outer ring clockwise, as no reader should mind."""
    outer = [(0, 0), (0, 20), (30, 20), (30, 0)]
    holes = [[(2, 2), (12, 2), (12, 18), (2, 18)], [(15, 2), (15, 18), (28, 18), (28, 2)]]
    return shapely.transform(shapely.Polygon(outer, holes), lambda points: points + corner)


POLYGONS = st.one_of(CORNER.map(box), CORNER.map(court), st.lists(CORNER, min_size=3, max_size=7).map(shapely.Polygon))
"""Rings of random corners cross themselves, or have no area."""
AREAS = st.one_of(
    POLYGONS,
    st.lists(POLYGONS, min_size=1, max_size=3).map(shapely.MultiPolygon),
    st.lists(POLYGONS, min_size=1, max_size=2).map(
        lambda parts: shapely.GeometryCollection([*parts, parts[0].centroid])
    ),
)
SHAPES = st.one_of(
    AREAS, st.none(), st.just(shapely.Polygon()), CORNER.map(shapely.Point),
    st.just(shapely.MultiPolygon([box((0, 0)), shapely.Polygon()])),
    st.tuples(CORNER, CORNER).map(shapely.LineString),
)  # fmt: skip
FEATURES = st.lists(
    st.tuples(SHAPES, st.sampled_from([np.nan, -1.0, 5.0, 12.5]), st.sampled_from(KINDS)), min_size=1, max_size=24
)


def placed(shapes: list[Any], degrees: bool) -> Any:
    scale, shift = (1e-5, DEGREES) if degrees else (1.0, METRES)
    moved = [shape and shapely.transform(shape, lambda points: points * scale + shift) for shape in shapes]
    return shapely.to_wkb(np.array(moved, object))


def write(path: Path, features: list[Any], degrees: bool = False) -> Path:
    """Columns: height, kind, number (with gaps in integers), and a ground that lacks where the height does."""
    shapes, heights, kinds = zip(*features, strict=True)
    wkb, height = placed(list(shapes), degrees), np.array(heights)
    if path.suffix == ".parquet":
        crs = {"id": {"authority": "EPSG", "code": 4326 if degrees else 6677}}
        header = {"primary_column": "shape", "columns": {"shape": {"encoding": "WKB", "crs": crs}}}
        number = [None if k % 3 == 1 else k for k in range(len(wkb))]
        table = pyarrow.table({"shape": pyarrow.array(wkb, pyarrow.binary()), "height": height, "kind": kinds,
                               "number": pyarrow.array(number, pyarrow.int64())})  # fmt: skip
        pyarrow.parquet.write_table(table.replace_schema_metadata({"geo": json.dumps(header)}), path, row_group_size=5)
        return path
    number, mask = np.arange(len(wkb)), np.arange(len(wkb)) % 3 == 1
    driver = {".gpkg": "GPKG", ".fgb": "FlatGeobuf"}[path.suffix]
    options = {"SPATIAL_INDEX": "NO"} if path.suffix == ".fgb" else {}
    pyogrio.raw.write(path, wkb, [height, np.array(kinds, object), number], ["height", "kind", "number"],
                      field_mask=[None, None, mask], driver=driver, crs="EPSG:4326" if degrees else "EPSG:6677",
                      geometry_type="Unknown", **options)  # fmt: skip
    return path


def outcome(path: Path, options: ReadOptions, batch: int) -> Scene | str:
    try:
        return read_footprints(path, options, batch)
    except InputError as error:
        return str(error)


def arrays(chunk: FootprintChunk) -> list[np.ndarray]:
    own = chunk.features
    return [own.rings.xy, own.rings.ring_start, own.rings.polygon_start, own.rings.polygon_feature, own.bottom,
            own.top, own.seed]  # fmt: skip


def assert_same(one: Scene | str, other: Scene | str) -> None:
    if isinstance(one, str) or isinstance(other, str):
        assert one == other
        return
    assert (one.crs, one.origin, one.warnings) == (other.crs, other.origin, other.warnings)
    assert one.object_count == other.object_count
    np.testing.assert_array_equal(one.instances.transform, other.instances.transform)
    np.testing.assert_array_equal(one.instances.first_object, other.instances.first_object)
    assert list(one.attributes) == list(other.attributes)
    for name, column in one.attributes.items():
        assert column.dtype == other.attributes[name].dtype
        np.testing.assert_array_equal(column, other.attributes[name])
    for mine, its in zip(one.meshes, other.meshes, strict=True):
        assert mine.name == its.name
        for a, b in zip(arrays(mine), arrays(its), strict=True):  # type: ignore[arg-type]
            assert a.dtype == b.dtype
            np.testing.assert_array_equal(a, b)


LEFT_OUT = [(shapely.LineString([(0, 0), (5, 5)]), 5.0, "shop"), (None, 5.0, None)]


@settings(max_examples=60, deadline=None)
@given(FEATURES, st.booleans(), st.sampled_from([1, 2, 5]), st.sampled_from([None, 4.0]), st.sampled_from([None, 3]))
@example([*LEFT_OUT, (box((0, 0)), 5.0, "house"), *LEFT_OUT], False, 2, None, None)
@example([*LEFT_OUT, *LEFT_OUT], True, 1, None, None)
def test_batches_make_the_same_scene(
    features: list[Any], degrees: bool, batch: int, default: float | None, per_mesh: int | None
) -> None:
    options = ReadOptions(default_height=default, buildings_per_mesh=per_mesh or 4096, base_attribute="number")
    with tempfile.TemporaryDirectory() as folder:
        path = write(Path(folder) / "a.fgb", features, degrees)
        assert_same(outcome(path, options, batch), outcome(path, options, 1000))


@settings(max_examples=40, deadline=None)
@given(st.lists(AREAS, min_size=1, max_size=12), st.randoms(use_true_random=False))
def test_rings_of_features_are_those_of_their_shapes(areas: list[Any], random: Any) -> None:
    shapes = np.array([shapely.make_valid(area) for area in areas], object)
    chosen = np.array(random.sample(range(len(areas)), random.randint(1, len(areas))))
    chosen = chosen[shapely.area(shapes[chosen]) > 0]
    shapes[shapely.area(shapes) == 0] = box((0, 0))
    selected, drawn = flat_rings(shapes).of_features(chosen), flat_rings(shapes[chosen]) if len(chosen) else None
    if drawn is None:
        assert len(selected.xy) == 0
        return
    for field in Rings.__slots__:
        np.testing.assert_array_equal(getattr(selected, field), getattr(drawn, field))


def many(count: int) -> list[Any]:
    return [(box((20 * k, 0)), np.nan if k == 4 else 5.0 + k, KINDS[k % 4]) for k in range(count)]


@pytest.mark.parametrize("name", ["a.gpkg", "a.fgb"])
def test_parts_of_a_file_make_the_same_scene(tmp_path: Path, monkeypatch: pytest.MonkeyPatch, name: str) -> None:
    path = write(tmp_path / name, many(23))
    whole = outcome(path, ReadOptions(), 1000)
    assert isinstance(whole, Scene)
    monkeypatch.setattr(ogr, "_OBJECTS", 10)
    read = []
    monkeypatch.setattr(ogr, "_read", lambda *given, one=ogr._read, **which: read.append(which) or one(*given, **which))
    assert_same(outcome(path, ReadOptions(), 3), whole)
    assert len(read) == (4 if name == "a.fgb" else 5)
    assert whole.attributes["number"].dtype == np.float64


def test_parquet_in_row_groups_and_batches(tmp_path: Path) -> None:
    path = write(tmp_path / "a.parquet", many(23))
    scene = outcome(path, ReadOptions(), 4)
    assert_same(scene, outcome(path, ReadOptions(), 1000))
    fgb = outcome(write(tmp_path / "a.fgb", many(23)), ReadOptions(), 1000)
    assert isinstance(scene, Scene)
    assert isinstance(fgb, Scene)
    for name, column in fgb.attributes.items():
        np.testing.assert_array_equal(column, scene.attributes[name])
    for mine, its in zip(scene.meshes, fgb.meshes, strict=True):
        for a, b in zip(arrays(mine), arrays(its), strict=True):  # type: ignore[arg-type]
            np.testing.assert_array_equal(a, b)


def test_counts_are_summed_over_batches(tmp_path: Path) -> None:
    bow = shapely.Polygon([(0, 40), (10, 50), (10, 40), (0, 50)])
    features = [*LEFT_OUT, (bow, 5.0, None), (box((0, 0)), np.nan, None), (box((50, 0)), 5.0, None)] * 4
    path = write(tmp_path / "a.fgb", features)
    assert [line.removeprefix(f"{path}: ") for line in read_footprints(path, ReadOptions(), batch=3).warnings] == [
        "left out 4 features that are not areas",
        "left out 4 features without a shape",
        "repaired 4 footprints with self-crossing rings",
        "left out 4 footprints without height (above 0 and below 2,000 m); a default_height keeps them",
    ]


def test_a_chunk_pickles_its_own_buildings_only(tmp_path: Path) -> None:
    scene = read_footprints(write(tmp_path / "a.fgb", many(3000)), ReadOptions(buildings_per_mesh=100))
    assert len(scene.meshes) > 29
    # A box: 4 vertices of 8 bytes, three starts of 8, ground, roof and seed of 4.
    assert max(len(pickle.dumps(source)) for source in scene.meshes) < 100 * 68 + 2000


@pytest.mark.parametrize("share", [0.3, 0.5, 0.99])
def test_a_flatgeobuf_that_is_cut_short(tmp_path: Path, share: float) -> None:
    path = write(tmp_path / "a.fgb", many(500))
    path.write_bytes(path.read_bytes()[: int(share * path.stat().st_size)])
    with pytest.raises(InputError, match=r"(is cut short: [0-9]+ of its 500 features are there|is damaged: it cannot "
                                         r"be read as a vector file) \(export or download it again\)"):  # fmt: skip
        read_footprints(path, ReadOptions())


def test_parquet_that_is_damaged(tmp_path: Path) -> None:
    path = write(tmp_path / "a.parquet", many(500))
    content = bytearray(path.read_bytes())
    content[4:2000] = bytes(1996)
    path.write_bytes(content)
    with pytest.raises(InputError, match=r"is damaged: it cannot be read as Parquet \(export or download it again\)"):
        read_footprints(path, ReadOptions())


def test_equal_texts_become_one_object(monkeypatch: pytest.MonkeyPatch) -> None:
    texts = np.array([f"{'ab'[k % 2]}-" for k in range(6)] + [None, 3, ["x"]], dtype=object)
    shared = with_shared_text(texts, {})
    assert list(shared) == list(texts)
    assert len({id(text) for text in shared[:6]}) == 2
    numbers = np.arange(3)
    assert with_shared_text(numbers, {}) is numbers
    monkeypatch.setattr("farfield.scene.footprints.table._MOST_KINDS", 1)
    known: dict[str, str] = {"a": "a", "b": "b"}
    assert list(with_shared_text(texts, known)) == list(texts)
    assert len(known) == 2
