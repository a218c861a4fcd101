"""Coordinate reference systems and their horizontal part."""

from __future__ import annotations

import sys
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from farfield.errors import MissingExtraError
from farfield.scene.cityjson.crs import _HORIZONTAL, code_of
from scene.cityjson.small_city import City, box, notes


@pytest.mark.parametrize(
    ("reference", "code"),
    [
        ("https://www.opengis.net/def/crs/EPSG/0/7415", "EPSG:7415"),
        ("http://www.opengis.net/def/crs/EPSG/9.9.1/28992", "EPSG:28992"),
        ("urn:ogc:def:crs:EPSG::7415", "EPSG:7415"),
        ("urn:ogc:def:crs:EPSG:9.9:7415", "EPSG:7415"),
        ("urn:ogc:def:crs,crs:EPSG::25832,crs:EPSG::5783", "EPSG:25832"),
        ("EPSG:7415", "EPSG:7415"),
        ("epsg:7415", "EPSG:7415"),
        ("7415", "EPSG:7415"),
        (7415, "EPSG:7415"),
        ("https://www.opengis.net/def/crs/OGC/0/CRS84h", "OGC:CRS84h"),
        ("somewhere", None),
        ({}, None),
        (None, None),
    ],
)
def test_codes(reference: Any, code: str | None) -> None:
    assert code_of(reference) == code


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
