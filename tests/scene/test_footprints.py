"""Footprints: extruded with holes, repaired or counted, split by place, with façades that fit."""

from __future__ import annotations

import json
import pickle
import sys
from collections.abc import Callable
from itertools import pairwise
from pathlib import Path
from typing import Any

import numpy as np
import pyarrow
import pyarrow.parquet
import pyogrio
import pytest
import shapely
from hypothesis import given, settings
from hypothesis import strategies as st

from farfield.errors import InputError, MissingExtraError
from farfield.scene.footprints.facades import BAYS, FACADES, FLOORS, VARIANTS, facade_pixels
from farfield.scene.footprints.heights import heights_of, numbers
from farfield.scene.footprints.order import morton_codes, split
from farfield.scene.model import Mesh, Scene
from farfield.scene.options import ReadOptions
from farfield.scene.read import read_scene

CRS = "EPSG:6677"
AT = np.array([-6500.0, -35500.0])
SQUARE = shapely.box(0, 0, 12, 9)
COURT = shapely.box(20, 0, 50, 30).difference(shapely.box(28, 8, 42, 22))
TWO = shapely.MultiPolygon([shapely.box(60, 0, 66, 6), shapely.box(70, 0, 76, 6)])
BOW = shapely.Polygon([(0, 40), (10, 50), (10, 40), (0, 50)])


def write(path: Path, shapes: list[Any], crs: str | None = CRS, **columns: list[Any]) -> Path:
    """A vector file by its extension; shapes are moved to where the CRS has them."""
    moved = [shape and shapely.transform(shape, lambda points: points + AT) for shape in shapes]
    arrays = [np.array(column, object if isinstance(column[0], str) else None) for column in columns.values()]
    driver = {".gpkg": "GPKG", ".fgb": "FlatGeobuf", ".geojson": "GeoJSON"}[path.suffix]
    options = {"SPATIAL_INDEX": "NO"} if path.suffix == ".fgb" else {}
    pyogrio.raw.write(path, shapely.to_wkb(np.array(moved, object)), arrays, list(columns), driver=driver, crs=crs,
                      geometry_type="Unknown", **options)  # fmt: skip
    return path


def load(scene: Scene) -> Mesh:
    (source,) = scene.meshes
    return source.load()


def facing(mesh: Mesh) -> np.ndarray:
    a, b, c = (mesh.positions[mesh.triangles[:, k]] for k in range(3))
    return np.cross(b - a, c - a) / 2


@pytest.mark.parametrize("name", ["a.fgb", "a.gpkg"])
def test_volumes_holes_and_parts(tmp_path: Path, name: str) -> None:
    scene = read_scene([write(tmp_path / name, [SQUARE, COURT, TWO], height=[10.0, 20.0, 5.0], use=["a", "b", "c"])])
    mesh = load(scene)
    assert (scene.crs, scene.origin) == (CRS, (-7168, -35840, 0))
    assert scene.object_count == 3
    assert mesh.object_count == 3
    assert mesh.triangle_object is not None
    vectors = facing(mesh)
    np.testing.assert_allclose(vectors / np.linalg.norm(vectors, axis=1)[:, None], mesh.normals[mesh.triangles[:, 0]],
                               atol=1e-4)  # fmt: skip
    for k, (shape, height) in enumerate([(SQUARE, 10), (COURT, 20), (TWO, 5)]):
        row = list(scene.attributes["use"]).index("abc"[k])
        own = mesh.triangle_object == row
        roof = own & (mesh.normals[mesh.triangles[:, 0], 2] > 0.5)
        assert np.linalg.norm(vectors[roof], axis=1).sum() == pytest.approx(shape.area, rel=1e-5)
        walls = np.linalg.norm(vectors[own & ~roof], axis=1).sum()
        assert walls == pytest.approx(shape.length * height, rel=1e-5)
        # Outward walls: the horizontal flux of (x, y) through them is twice the volume, holes included.
        corners = mesh.positions[mesh.triangles[own & ~roof]].mean(1)
        assert (corners * vectors[own & ~roof]).sum() == pytest.approx(2 * shape.area * height, rel=1e-4)


def test_place_on_the_map(tmp_path: Path) -> None:
    scene = read_scene([write(tmp_path / "a.fgb", [SQUARE], height=[10.0])])
    points = load(scene).positions + scene.instances.transform[0, :, 3] + scene.origin
    np.testing.assert_allclose([points.min(0), points.max(0)], [[*AT, 0], [*(AT + (12, 9)), 10]], atol=1e-4)


def test_geoparquet_and_geojson(tmp_path: Path) -> None:
    wkb = [shapely.to_wkb(shapely.transform(shape, lambda points: points + AT)) for shape in (SQUARE, COURT)]
    crs = {"id": {"authority": "EPSG", "code": 6677}}
    header = {"version": "1.1.0", "primary_column": "shape", "columns": {"shape": {"encoding": "WKB", "crs": crs}}}
    table = pyarrow.table({"shape": wkb, "levels": [3, 4], "name": ["x", "y"]})
    pyarrow.parquet.write_table(table.replace_schema_metadata({"geo": json.dumps(header)}), tmp_path / "a.parquet")
    scene = read_scene([tmp_path / "a.parquet"])
    assert scene.crs == CRS
    assert load(scene).positions[:, 2].max() == 12
    assert set(scene.attributes) == {"levels", "name"}
    json_scene = read_scene([write(tmp_path / "b.geojson", [SQUARE, COURT], height=[9.0, 12.0])])
    assert (json_scene.crs, json_scene.origin) == (scene.crs, scene.origin)


def test_base_altitudes(tmp_path: Path) -> None:
    path = write(tmp_path / "a.fgb", [SQUARE, COURT, TWO], height=[10.0, 5.0, 5.0], ground=[1300.0, np.nan, 1320.0])
    scene = read_scene([path], ReadOptions(base_attribute="ground"))
    assert scene.origin[2] == 1024
    heights = load(scene).positions[:, 2] + scene.instances.transform[0, 2, 3] + 1024
    assert (heights.min(), heights.max()) == (1300, 1325)
    assert scene.warnings == (f"{path}: 1 footprint without ground stand on the median of the others",)


def test_what_is_left_out_is_counted(tmp_path: Path) -> None:
    line, flat = shapely.LineString([(0, 0), (5, 5)]), shapely.Polygon([(0, 0), (5, 0), (9, 0)])
    shapes = [SQUARE, COURT, TWO, BOW, line, flat, None, SQUARE]
    path = write(tmp_path / "a.gpkg", shapes, height=[10.0, np.nan, -2.0, 8.0, 5.0, 5.0, 5.0, 90_000.0])
    scene = read_scene([path])
    assert scene.object_count == 2
    assert [line.removeprefix(f"{path}: ") for line in scene.warnings] == [
        "left out 1 feature that are not areas",
        "left out 1 feature without a shape",
        "repaired 1 footprint with self-crossing rings",
        "left out 1 footprint of no area",
        "left out 3 footprints without height (above 0 and below 2,000 m); a default_height keeps them",
    ]
    kept = read_scene([path], ReadOptions(default_height=7))
    assert kept.object_count == 5
    assert load(kept).positions[:, 2].max() == 10


def test_self_crossing_rings_keep_their_area(tmp_path: Path) -> None:
    mesh = load(read_scene([write(tmp_path / "a.fgb", [BOW], height=[8.0])]))
    roof = mesh.normals[mesh.triangles[:, 0], 2] > 0.5
    assert np.linalg.norm(facing(mesh)[roof], axis=1).sum() == pytest.approx(50, rel=1e-4)


def error_line(path: Path, options: ReadOptions | None = None) -> str:
    with pytest.raises(InputError) as caught:
        read_scene([path], options)
    return str(caught.value).replace(str(path.parent) + "/", "")


def test_errors_say_what_where_and_what_to_try(tmp_path: Path) -> None:
    path = write(tmp_path / "a.fgb", [SQUARE], stories=["3"], kind=["x"])
    assert error_line(path) == (
        "a.fgb: has no attribute of heights (name one as height_attribute or give a default_height; "
        "its attributes: stories, kind)"
    )
    assert error_line(path, ReadOptions(height_attribute="h")) == (
        "a.fgb: has no attribute 'h' (its attributes: stories, kind)"
    )
    empty = write(tmp_path / "b.fgb", [SQUARE], height=[np.nan])
    assert error_line(empty) == (
        "b.fgb: holds no footprint that can be extruded; left out 1 footprint without height (above 0 and "
        "below 2,000 m); a default_height keeps them (check its shapes and heights)"
    )
    nothing = tmp_path / "d.geojson"
    nothing.write_text('{"type": "FeatureCollection", "features": []}')
    assert error_line(nothing) == "d.geojson: holds no features (export or download it again)"
    path.write_bytes(path.read_bytes()[:200])
    assert error_line(path) == ("a.fgb: is damaged: it cannot be read as a vector file (export or download it again)")
    layers = write(tmp_path / "c.gpkg", [SQUARE], height=[3.0])
    assert error_line(layers, ReadOptions(layer="roofs")) == "c.gpkg: has no layer 'roofs' (its layers: c)"


def test_degrees_become_the_local_utm_zone(tmp_path: Path) -> None:
    lon, lat = 139.767, 35.681
    shape = shapely.box(lon, lat, lon + 0.001, lat + 0.001)
    pyogrio.raw.write(tmp_path / "a.geojson", shapely.to_wkb(np.array([shape])), [np.array([9.0])], ["height"],
                      driver="GeoJSON", crs="EPSG:4326", geometry_type="Polygon")  # fmt: skip
    scene = read_scene([tmp_path / "a.geojson"])
    assert scene.crs == "EPSG:32654"
    np.testing.assert_allclose(np.ptp(load(scene).positions, axis=0), [92, 112, 9], atol=3)
    assert scene.warnings == (
        f"{tmp_path}/a.geojson: reprojected from degrees (EPSG:4326) to the local UTM zone, EPSG:32654",
    )
    moved = read_scene([tmp_path / "a.geojson"], ReadOptions(crs=CRS))
    assert moved.crs == CRS
    assert moved.origin == (-6144, -35840, 0)


def test_missing_extra_is_named(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(sys.modules, "pyarrow", None)
    (tmp_path / "a.parquet").write_bytes(b"PAR1....PAR1")
    with pytest.raises(
        MissingExtraError, match=r"a.parquet: GeoParquet needs pyarrow \(pip install 'farfield\[geo\]'\)"
    ):
        read_scene([tmp_path / "a.parquet"])


def test_columns_of_heights() -> None:
    columns: dict[str, Any] = {
        "name": np.array(["a", "b", "c", "d"], object),
        "building:levels": np.array(["4", "2", None, "x"], object),
        "Measured_Height": np.array([np.nan, 7.5, 0, np.nan]),
    }
    np.testing.assert_array_equal(heights_of(columns, 4, None, None, "x"), [12, 7.5, np.nan, np.nan])
    np.testing.assert_array_equal(heights_of(columns, 4, None, 3.0, "x"), [12, 7.5, 3, 3])
    texts = np.array(["12 m", "12,5", " 40ft", "tall", None, 3, "7'"], object)
    np.testing.assert_allclose(numbers(texts), [12, 12.5, 12.192, np.nan, np.nan, 3, 2.1336])


def grid(count: int) -> list[Any]:
    return [shapely.box(30 * i, 30 * j, 30 * i + 9, 30 * j + 11) for i in range(count) for j in range(count)]


def test_chunks_cover_every_building_once_and_carry_their_rings(tmp_path: Path) -> None:
    heights = list(np.arange(400) % 37 + 3.0)
    path = write(tmp_path / "a.fgb", grid(20), height=heights, number=list(range(400)))
    scene = read_scene([path], ReadOptions(buildings_per_mesh=50))
    assert len(scene.meshes) > 8
    path.unlink()
    objects = 0
    for row, source in enumerate(scene.meshes):
        mesh = pickle.loads(pickle.dumps(source)).load()
        assert mesh.object_count <= 50
        assert scene.instances.first_object[row] == objects + 1
        assert mesh.triangle_object is not None
        for k in range(mesh.object_count):
            top = mesh.positions[mesh.triangles[mesh.triangle_object == k]][..., 2].max()
            assert top == scene.attributes["height"][objects + k]
        objects += mesh.object_count
    assert sorted(scene.attributes["number"]) == list(range(400))


def test_looks_do_not_depend_on_order_or_neighbours(tmp_path: Path) -> None:
    shapes, heights = grid(5), list(np.arange(25) + 4.0)
    forward = load(read_scene([write(tmp_path / "a.fgb", shapes, height=heights)]))
    backward = load(read_scene([write(tmp_path / "b.fgb", shapes[:0:-1], height=heights[:0:-1])]))

    def looks(mesh: Mesh) -> dict[float, Any]:
        assert mesh.triangle_object is not None
        assert mesh.colors is not None
        rows = [np.flatnonzero(mesh.triangle_object == k)[0] for k in range(mesh.object_count)]
        corners = [mesh.triangles[row, 2] for row in rows]
        return {
            mesh.positions[corner, 2]: (mesh.triangle_material[row], mesh.colors[corner].tolist())
            for row, corner in zip(rows, corners, strict=True)
        }

    one, other = looks(forward), looks(backward)
    assert {key: one[key] for key in other} == other


def test_walls_hold_whole_bays_and_floors(tmp_path: Path) -> None:
    mesh = load(read_scene([write(tmp_path / "a.fgb", [SQUARE], height=[11.0])]))
    assert mesh.uvs is not None
    walls = mesh.triangle_material > 0
    quads = mesh.triangles[walls][::2]
    for quad in quads:
        u, v = (mesh.uvs[quad] * (BAYS, FLOORS)).T
        length = np.linalg.norm(np.ptp(mesh.positions[quad][:, :2], axis=0))
        assert np.ptp(u) == pytest.approx(round(length / 3))
        assert np.ptp(v) == pytest.approx(3)
        np.testing.assert_allclose(u, np.round(u), atol=1e-5)
        # v grows downwards: the top of the wall has the least.
        assert mesh.positions[quad[np.argmin(v)], 2] == 11


def test_plain_walls(tmp_path: Path) -> None:
    mesh = load(read_scene([write(tmp_path / "a.fgb", [SQUARE], height=[11.0])], ReadOptions(facades=False)))
    assert len(mesh.materials) == 1
    assert mesh.materials[0].texture is None


@pytest.mark.parametrize("variant", range(VARIANTS))
def test_facades_are_upright_and_have_windows(variant: int) -> None:
    pixels = facade_pixels(variant)[..., :3].astype(float).mean(-1)
    look = FACADES[variant]
    rows = pixels.reshape(FLOORS, 64, -1).mean((0, 2))
    middle, below = 1 - (look.sill + look.head) / 2, 1 - look.sill / 2
    assert rows[int(64 * middle)] < rows[min(int(64 * below), 63)]
    np.testing.assert_array_equal(facade_pixels(variant), facade_pixels(variant))


@settings(max_examples=50, deadline=None)
@given(st.lists(st.tuples(st.floats(-1e5, 1e5), st.floats(-1e5, 1e5)), min_size=1, max_size=200), st.integers(1, 20))
def test_split_is_a_partition(points: list[tuple[float, float]], most: int) -> None:
    codes = np.sort(morton_codes(np.array(points)))
    found = split(codes, most)
    ranges = [(low, high) for _, low, high in found]
    for square, low, high in found:
        assert square.codes[0] <= codes[low]
        assert codes[high - 1] < square.codes[1]
    assert ranges[0][0] == 0
    assert ranges[-1][1] == len(codes)
    assert all(a[1] == b[0] for a, b in pairwise(ranges))
    assert all(high - low <= most or codes[low] == codes[high - 1] for low, high in ranges)


def test_lyon(shared_data: Callable[[str], Path]) -> None:
    scene = read_scene([shared_data("lyon1_3dtiles/buildings_lyon1.geojson")], ReadOptions(base_attribute="Z_MIN_SOL"))
    assert scene.object_count == 2576
    assert scene.crs == "EPSG:3946"
    assert {"HAUTEUR", "USAGE1", "DATE_MAJ"} <= scene.attributes.keys()
    meshes = [source.load() for source in scene.meshes]
    assert sum(mesh.object_count for mesh in meshes) == 2576
    for mesh in meshes:
        assert (np.einsum("mc,mc->m", facing(mesh), mesh.normals[mesh.triangles[:, 0]]) > 0).all()


def test_columns_of_colours_and_beginnings(tmp_path: Path) -> None:
    path = write(tmp_path / "a.fgb", [SQUARE, COURT, TWO], height=[10.0, 20.0, 5.0], wall=["red", "#00f", "glassy"],
                 roof=["", "grey", "white"], above=[0.0, 6.0, 9.0])  # fmt: skip
    scene_file = tmp_path / "scene.toml"
    scene_file.write_text(
        '[[source]]\npath = "a.fgb"\nwall_colour_attribute = "wall"\nroof_colour_attribute = "roof"\n'
        'min_height_attribute = "above"\nfacades = false\n'
    )
    scene = read_scene([scene_file])
    assert [line.removeprefix(f"{path}: ") for line in scene.warnings] == [
        "1 value of wall that are no colours",
        "1 height that end below where the walls begin are taken from there",
    ]
    mesh = load(scene)
    assert mesh.colors is not None
    assert mesh.triangle_object is not None
    for row, wall in enumerate(scene.attributes["wall"]):
        corners = mesh.triangles[mesh.triangle_object == row].ravel()
        z = mesh.positions[corners, 2]
        told = {"red": (0, 10, (255, 0, 0)), "#00f": (6, 20, (0, 0, 255)), "glassy": (9, 14, None)}[wall]
        assert (z.min(), z.max()) == told[:2]
        if told[2]:
            walls = mesh.normals[corners, 2] == 0
            assert (mesh.colors[corners[walls], :3] == told[2]).all()


def test_beginnings_that_cannot_be_are_the_ground(tmp_path: Path) -> None:
    shapes = [shapely.box(20 * k, 0, 20 * k + 12, 9) for k in range(7)]
    above = [1e8, -5.0, np.inf, 1995.0, 25.0, 4.0, np.nan]
    path = write(tmp_path / "a.fgb", shapes, height=[10.0] * 7, above=above)
    scene = read_scene([path], ReadOptions(min_height_attribute="above", facades=False))
    assert [line.removeprefix(f"{path}: ") for line in scene.warnings] == [
        "4 buildings whose walls would begin below 0 m or end above 2,000 m are taken from the ground",
        "1 height that end below where the walls begin are taken from there",
    ]
    mesh = load(scene)
    assert mesh.triangle_object is not None
    for row, wanted in enumerate(scene.attributes["above"]):
        z = mesh.positions[mesh.triangles[mesh.triangle_object == row], 2]
        assert (z.min(), z.max()) == {25.0: (25, 35), 4.0: (4, 10)}.get(wanted, (0, 10))


def test_altitudes_of_roofs(tmp_path: Path) -> None:
    path = write(tmp_path / "a.fgb", [SQUARE, COURT, TWO], height=[10.0, 20.0, 5.0], roof=[108.0, np.nan, 90.0],
                 ground=[100.0, 100.0, 100.0])  # fmt: skip
    scene = read_scene([path], ReadOptions(base_attribute="ground", top_attribute="roof"))
    mesh = load(scene)
    assert mesh.triangle_object is not None
    for row, height in enumerate(scene.attributes["height"]):
        top = mesh.positions[mesh.triangles[mesh.triangle_object == row]][..., 2].max()
        assert top == {10.0: 8, 20.0: 20, 5.0: 5}[height]
