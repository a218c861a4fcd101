"""Coordinate reference systems and their horizontal part."""

from __future__ import annotations

import sys
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from farfield.errors import InputError, MissingExtraError
from farfield.scene.cityjson.crs import _HORIZONTAL, codes_of
from scene.cityjson.small_city import CUBE, City, box, notes


@pytest.mark.parametrize(
    ("reference", "codes"),
    [
        ("https://www.opengis.net/def/crs/EPSG/0/7415", ["EPSG:7415"]),
        ("http://www.opengis.net/def/crs/EPSG/9.9.1/28992", ["EPSG:28992"]),
        ("urn:ogc:def:crs:EPSG::7415", ["EPSG:7415"]),
        ("urn:ogc:def:crs:EPSG:9.9:7415", ["EPSG:7415"]),
        ("urn:ogc:def:crs,crs:EPSG::25832,crs:EPSG::5783", ["EPSG:25832", "EPSG:5783"]),
        (
            "http://www.opengis.net/def/crs-compound?1=http://www.opengis.net/def/crs/EPSG/0/2263"
            "&2=http://www.opengis.net/def/crs/EPSG/0/6360",
            ["EPSG:2263", "EPSG:6360"],
        ),
        ("EPSG:7415", ["EPSG:7415"]),
        ("epsg:7415", ["EPSG:7415"]),
        ("7415", ["EPSG:7415"]),
        (7415, ["EPSG:7415"]),
        ("https://www.opengis.net/def/crs/OGC/0/CRS84h", ["OGC:CRS84h"]),
        ("somewhere", []),
        ({}, []),
        (None, []),
    ],
)
def test_codes(reference: Any, codes: list[str]) -> None:
    assert codes_of(reference) == codes


def test_known_horizontal_parts_are_those_of_pyproj() -> None:
    pyproj = pytest.importorskip("pyproj")
    for compound, horizontal in _HORIZONTAL.items():
        own = pyproj.CRS.from_user_input(compound).sub_crs_list[0]
        assert ":".join(own.to_authority(min_confidence=100)) == horizontal


@pytest.mark.parametrize(("reference", "crs"), [("EPSG:7415", "EPSG:28992"), ("EPSG:6677", "EPSG:6677"),
                                                ("EPSG:5556", "EPSG:25833"), ("EPSG:5513", "EPSG:5513")])  # fmt: skip
def test_metres(tmp_path: Path, reference: str, crs: str) -> None:
    city = City(reference=reference)
    city.add("a", city.cube())
    scene = city.read(tmp_path)
    assert (scene.crs, scene.origin) == (crs, (0, 1024, 0))
    assert scene.instances.transform[0, :, 3].tolist() == [1000, 976, 5]
    assert scene.warnings == ()


def in_degrees(reference: str, first: float, second: float) -> City:
    city = City(reference=reference)
    points = box() * (1e-5, 1e-5, 1)
    city.json["transform"] = {"scale": [1e-7, 1e-7, 0.001], "translate": [first, second, 40]}
    city.json["vertices"] = np.round(points / (1e-7, 1e-7, 0.001)).astype(int).tolist()
    city.add("a", city.geometry([[[0, 1, 2, 3]]]), kind="Road")
    return city


@pytest.mark.parametrize(
    ("reference", "first", "second"),
    [("EPSG:4979", 52.0, 4.4), ("EPSG:6697", 35.6, 139.7), ("OGC:CRS84h", 4.4, 52.0), ("EPSG:6697", 139.7, 35.6)],
)
def test_degrees_become_metres(tmp_path: Path, reference: str, first: float, second: float) -> None:
    pytest.importorskip("pyproj")
    scene = in_degrees(reference, first, second).read(tmp_path)
    assert scene.crs == ("EPSG:32631" if min(first, second) < 10 else "EPSG:32654")
    assert "reprojected from degrees" in notes(scene)[0]
    mesh = scene.meshes[0].load()
    assert np.ptp(mesh.positions, axis=0).max() == pytest.approx(10, abs=4)
    assert scene.instances.transform[0, 2, 3] == 40


FOOT = 1200 / 3937
"""Metres of a US survey foot."""


def in_feet(reference: str, height: float) -> City:
    """100 m x 100 m x 10 m in New York, and a template of 1 m, once. height: metres of the unit upwards."""
    city = City(reference=reference)
    city.json["transform"] = {"scale": [0.001] * 3, "translate": [300_000 / FOOT, 60_000 / FOOT, 20 / height]}
    corners = box(width=100 / FOOT, depth=100 / FOOT, height=10 / height)
    city.add("a", city.cube(corners=corners), kind="Road")
    city.json["geometry-templates"] = {
        "templates": [city.geometry([CUBE], "Solid") | {"boundaries": [CUBE]}],
        "vertices-templates": (box(width=1, depth=1, height=1) / (FOOT, FOOT, height)).tolist(),
    }
    at = [city.points([(50 / FOOT, 0, 0)])]
    city.add("b", {"type": "GeometryInstance", "template": 0, "boundaries": at}, kind="CityFurniture")
    return city


@pytest.mark.parametrize(
    ("reference", "height"),
    [
        ("EPSG:2263", FOOT),
        ("urn:ogc:def:crs,crs:EPSG::2263,crs:EPSG::6360", FOOT),
        ("urn:ogc:def:crs,crs:EPSG::2263,crs:EPSG::5703", 1.0),
    ],
)
def test_feet_become_metres(tmp_path: Path, reference: str, height: float) -> None:
    pyproj = pytest.importorskip("pyproj")
    scene = in_feet(reference, height).read(tmp_path)
    assert scene.crs == "EPSG:32618"
    told = ["reprojected from units of 0.3048006 m (EPSG:2263) to the local UTM zone, EPSG:32618"]
    told += ["its heights are brought to metres from units of 0.3048006 m"] * (height != 1)
    assert notes(scene) == told
    sizes = [mesh.load().positions.astype(float) @ transform[:, :3].T for mesh, transform in
             zip(scene.meshes, scene.instances.transform, strict=True)]  # fmt: skip
    for points, wanted in zip(sizes, ([100, 100, 10], [1, 1, 1]), strict=True):
        # What is parallel to the axes is turned a little.
        corner, along, upwards = (points[np.argmin(points @ way)] for way in ([9, 3, 1], [-9, 3, 1], [9, 3, -1]))
        assert np.linalg.norm(along - corner) == pytest.approx(wanted[0], rel=0.01)
        assert np.linalg.norm(upwards - corner) == pytest.approx(wanted[2], rel=0.01)
    assert scene.instances.transform[:, 2, 3] == pytest.approx([20, 20], abs=0.1)
    # EPSG:32118 is EPSG:2263 in metres; the first mesh begins at its westernmost and southernmost corners.
    place = pyproj.Transformer.from_crs("EPSG:32118", "EPSG:32618", always_xy=True).transform(300_000, 60_000)
    assert scene.instances.transform[0, :2, 3] + scene.origin[:2] == pytest.approx(place, abs=3)


def test_a_vertical_part_that_is_not_known(tmp_path: Path) -> None:
    pytest.importorskip("pyproj")
    city = City(reference="urn:ogc:def:crs,crs:EPSG::25832,crs:EPSG::1")
    city.add("a", city.cube())
    scene = city.read(tmp_path)
    assert (scene.crs, scene.warnings) == ("EPSG:25832", ())


def test_heights_in_feet_alone(tmp_path: Path) -> None:
    pytest.importorskip("pyproj")
    city = City(reference="urn:ogc:def:crs,crs:EPSG::32618,crs:EPSG::6360")
    city.add("a", city.cube())
    scene = city.read(tmp_path)
    assert scene.crs == "EPSG:32618"
    mesh = scene.meshes[0].load()
    assert np.ptp(mesh.positions, axis=0) == pytest.approx([10, 8, 6 * FOOT], abs=1e-4)
    assert notes(scene) == ["its heights are brought to metres from units of 0.3048006 m"]


@pytest.mark.parametrize("crs", ["EPSG:2263", "EPSG:4326"])
def test_what_is_not_in_metres_is_no_frame(tmp_path: Path, crs: str) -> None:
    pytest.importorskip("pyproj")
    with pytest.raises(InputError, match=f"cannot be brought to {crs}, which is not in metres"):
        in_feet("EPSG:2263", FOOT).read(tmp_path, crs=crs)


def test_another_crs(tmp_path: Path) -> None:
    pytest.importorskip("pyproj")
    city = City(reference="EPSG:25832")
    city.json["transform"] = {"scale": [0.001] * 3, "translate": [500_000, 5_700_000, 0]}
    city.add("a", city.cube())
    scene = city.read(tmp_path, crs="EPSG:25833")
    assert scene.crs == "EPSG:25833"
    assert scene.origin[0] < 200_000
    local = City()
    local.add("a", local.cube())
    assert local.read(tmp_path, crs="EPSG:25833").crs == "EPSG:25833"


def test_without_pyproj(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(sys.modules, "pyproj", None)
    for reference, crs in (("EPSG:7415", "EPSG:28992"), ("EPSG:6677", "EPSG:6677")):
        city = City(reference=reference)
        city.add("a", city.cube())
        assert city.read(tmp_path).crs == crs
    with pytest.raises(MissingExtraError, match=r"farfield\[geo\]"):
        in_degrees("EPSG:4979", 52, 4.4).read(tmp_path)


@pytest.mark.parametrize("reference", ["somewhere", "EPSG:1", "EPSG:4978", ["x"]])
def test_what_is_no_crs_is_said(tmp_path: Path, reference: Any) -> None:
    pytest.importorskip("pyproj")
    city = City(reference=reference)
    city.add("a", city.cube())
    scene = city.read(tmp_path)
    assert scene.crs is None
    assert len(scene.warnings) == 1
