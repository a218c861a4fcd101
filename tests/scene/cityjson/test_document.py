"""Files, versions, transforms, and what is said of those that cannot be read."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from farfield.errors import InputError
from farfield.scene.cityjson.document import points_of
from farfield.scene.read import read_scene
from scene.cityjson.small_city import AT, CUBE, City, box, load, notes


def error_line(path: Path) -> str:
    with pytest.raises(InputError) as caught:
        read_scene([path])
    return str(caught.value).replace(f"{path.parent}/", "")


def written(folder: Path, text: str, name: str = "a.city.json") -> Path:
    (folder / name).write_text(text)
    return folder / name


def sequence(path: Path, count: int = 3) -> Path:
    """A CityJSONSeq; every feature has vertices of its own."""
    head = City("1.1").json
    lines = [json.dumps(head)]
    for k in range(count):
        city = City()
        city.add(f"b{k}", city.cube(corners=box(x=20.0 * k)), attributes={"number": k})
        own = {key: city.json[key] for key in ("CityObjects", "vertices")}
        lines.append(json.dumps({"type": "CityJSONFeature", "id": f"b{k}", **own}))
    path.write_text("\n".join(lines) + "\n")
    return path


@pytest.mark.parametrize("version", ["1.0", "1.1", "2.0", "1.0.3", "2.0.1"])
def test_versions(tmp_path: Path, version: str) -> None:
    city = City(version)
    city.add("a", city.cube())
    scene = city.read(tmp_path)
    points = load(scene).positions + scene.instances.transform[0, :, 3]
    np.testing.assert_allclose([points.min(0), points.max(0)], [AT, AT + (10, 8, 6)], atol=1e-6)
    assert scene.name == "a"


def test_version_1_0_without_transform(tmp_path: Path) -> None:
    city = City("1.0")
    city.add("a", city.cube())
    del city.json["transform"]
    city.json["vertices"] = (box() + AT).tolist()
    assert city.read(tmp_path).instances.transform[0, :, 3].tolist() == AT.tolist()


@pytest.mark.parametrize(
    ("change", "line"),
    [
        ({"version": "0.9"}, "a.city.json: is CityJSON 0.9, which is not read (upgrade it with cjio)"),
        ({"version": "3.0"}, "a.city.json: is CityJSON 3.0, which is not read (1.0, 1.1 and 2.0 are read)"),
        ({"version": None}, "a.city.json: is CityJSON of no known version (1.0, 1.1 and 2.0 are read)"),
        ({"version": {}}, "a.city.json: is CityJSON of no known version (1.0, 1.1 and 2.0 are read)"),
        ({"transform": None}, "a.city.json: has no transform (CityJSON from 1.1 on needs one; export it again)"),
        ({"transform": 3}, "a.city.json: has a transform without numbers (it needs scale and translate, three each)"),
        ({"type": "CityJSONFeature"}, "a.city.json: begins with a CityJSONFeature "
         "(put the line of type CityJSON, with transform, first)"),
        ({"type": ["x"]}, "a.city.json: is JSON, but not CityJSON (check the path)"),
        ({"CityObjects": {}}, "a.city.json: holds no surfaces (check what was exported)"),
        ({"CityObjects": []}, "a.city.json: holds no surfaces (check what was exported)"),
        ({"vertices": "none"}, "a.city.json: holds no surfaces; left out 6 surfaces with vertices that do not exist "
         "(check what was exported)"),
    ],
)  # fmt: skip
def test_what_cannot_be_read(tmp_path: Path, change: dict[str, Any], line: str) -> None:
    city = City()
    city.add("a", city.cube())
    city.json.update(change)
    assert error_line(city.write(tmp_path / "a.city.json")) == line


def test_broken_json(tmp_path: Path) -> None:
    city = City()
    city.add("a", city.cube())
    text = json.dumps(city.json)
    assert "is damaged: " in error_line(written(tmp_path, text[:-40]))
    assert error_line(written(tmp_path, "")) == "a.city.json: is empty (export or download it again)"
    deep = '{"CityObjects": ' + "[" * 100_000
    assert "is damaged: " in error_line(written(tmp_path, deep))
    (tmp_path / "b.city.json").write_bytes(b'\xff\xfe{"CityObjects"')
    assert "b.city.json: " in error_line(tmp_path / "b.city.json")


def test_numbers_that_only_python_writes(tmp_path: Path) -> None:
    city = City()
    city.add("a", city.cube(), attributes={"height": float("nan"), "name": "\ud800x"})
    city.json["vertices"] += [[float("nan"), 0, float("inf")], [1e300, 0, 0], ["x", None, 3], [1], 5]
    for bad in range(8, 13):
        city.add(f"b{bad}", city.geometry([[[0, 1, bad]]]))
    scene = city.read(tmp_path)
    assert scene.object_count == 1
    assert scene.attributes["name"].tolist() == ["?x"]
    assert notes(scene) == [
        "left out 5 surfaces with vertices that are no numbers",
        "left out 5 objects without geometry",
    ]


def test_content_tells_json_apart(tmp_path: Path) -> None:
    city = City()
    city.add("a", city.cube())
    # Type and version last, far behind what is sniffed.
    order = {"metadata": {"title": "x" * 6000}, "vertices": city.json["vertices"], **city.json}
    order = {key: order[key] for key in ("metadata", "vertices", "transform", "CityObjects", "version", "type")}
    for text in (json.dumps(order), json.dumps(order, indent=1), "\ufeff" + json.dumps(city.json)):
        assert read_scene([written(tmp_path, text, "b.json")]).object_count == 1
    city.write(tmp_path / "c.geojson")
    assert error_line(tmp_path / "c.geojson") == (
        "c.geojson: is a CityJSON file, not GeoJSON (rename it to c.city.json)"
    )


@pytest.mark.parametrize("name", ["a.jsonl", "a.city.jsonl", "a.city.json"])
def test_sequences(tmp_path: Path, name: str) -> None:
    scene = read_scene([sequence(tmp_path / name)])
    mesh = load(scene)
    assert scene.object_count == 3
    assert sorted(scene.attributes["number"].tolist()) == [0, 1, 2]
    assert np.ptp(mesh.positions[:, 0]) == pytest.approx(50)


def test_lines_that_cannot_be_read_are_counted(tmp_path: Path) -> None:
    path = sequence(tmp_path / "a.jsonl")
    text = path.read_text()
    path.write_text(text[:-30] + "\n\n[1]\n" + '{"type": "Feature"}\n')
    scene = read_scene([path])
    assert scene.object_count == 2
    assert notes(scene) == ["left out 3 lines that cannot be read"]
    path.write_text("\n".join(text.splitlines()[1:]))
    assert error_line(path) == (
        "a.jsonl: begins with a CityJSONFeature (put the line of type CityJSON, with transform, first)"
    )


def test_far_vertices_are_mistakes(tmp_path: Path) -> None:
    city = City()
    city.add("a", city.cube())
    city.json["vertices"].append([10**11, 0, 0])
    city.add("b", city.geometry([[[0, 1, 8]]]), kind="Road")
    assert notes(city.read(tmp_path))[0] == "left out 1 surface with vertices that are no numbers"


JSON = st.recursive(
    st.none() | st.booleans() | st.integers() | st.floats() | st.text(max_size=3),
    lambda inner: st.lists(inner, max_size=4) | st.dictionaries(st.text(max_size=3), inner, max_size=3),
    max_leaves=12,
)


@given(JSON)
def test_points_of_anything(given_: Any) -> None:
    points = points_of(given_)
    assert points.shape[1:] == (3,)
    assert (np.isfinite(points).all(1) | np.isnan(points).all(1)).all()


PLACES = [("transform",), ("CityObjects",), ("CityObjects", "a"), ("CityObjects", "a", "geometry"),
          ("CityObjects", "a", "geometry", 0), ("CityObjects", "a", "geometry", 0, "boundaries"),
          ("CityObjects", "a", "geometry", 0, "boundaries", 0, 2), ("CityObjects", "a", "geometry", 0, "lod"),
          ("CityObjects", "a", "geometry", 0, "semantics"), ("CityObjects", "a", "geometry", 0, "material"),
          ("CityObjects", "a", "geometry", 0, "texture"), ("CityObjects", "a", "attributes"), ("metadata",),
          ("CityObjects", "a", "geometry", 0, "texture", "t", "values", 0, 1), ("appearance", "materials"),
          ("appearance", "textures"), ("appearance", "vertices-texture"), ("appearance",), ("vertices", 3),
          ("CityObjects", "a", "parents"), ("CityObjects", "a", "children"), ("CityObjects", "b", "geometry", 0),
          ("CityObjects", "b", "geometry", 0, "transformationMatrix"), ("geometry-templates",),
          ("geometry-templates", "templates", 0), ("CityObjects", "b", "geometry", 0, "boundaries"),
          ("CityObjects", "a", "type")]  # fmt: skip


@given(st.sampled_from(PLACES), JSON)
def test_anything_anywhere_is_read_or_an_input_error(
    tmp_path_factory: pytest.TempPathFactory, place: tuple[Any, ...], value: Any
) -> None:
    city = City()
    uvs = {"values": [[[[0, 0, 1, 2, 3]]] * 6]}
    city.add("a", city.cube(texture={"t": uvs}, material={"m": {"values": [[0] * 6]}},
                            semantics={"values": [[0] * 6], "surfaces": [{"type": "WallSurface"}]}),
             attributes={"x": 1}, parents=[], children=[])  # fmt: skip
    instance = {"type": "GeometryInstance", "template": 0, "boundaries": [0], "transformationMatrix": np.eye(4).ravel().tolist()}  # noqa: E501  # fmt: skip
    city.add("b", instance, kind="CityFurniture")
    city.json["geometry-templates"] = {"templates": [city.geometry(CUBE)], "vertices-templates": box().tolist()}
    city.json["appearance"] = {"materials": [{"diffuseColor": [1, 0, 0]}], "textures": [{"image": "none.png"}],
                               "vertices-texture": [[0, 0], [1, 0], [1, 1], [0, 1]]}  # fmt: skip
    at: Any = city.json
    for key in place[:-1]:
        at = at[key]
    at[place[-1]] = value
    try:
        scene = city.read(tmp_path_factory.mktemp("city"))
    except InputError:
        return
    for source in scene.meshes:
        mesh = source.load()
        assert np.isfinite(mesh.positions).all()
        assert len(mesh.triangles) == len(mesh.triangle_material)
