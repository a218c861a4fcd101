"""The converter of Tokyo's archives, the quality scenes, and `farfield make`."""

from __future__ import annotations

import importlib.util
import json
import subprocess
import sys
from collections.abc import Callable
from pathlib import Path
from types import ModuleType
from typing import Any

import numpy as np
import pytest
import shapely

from farfield.cli import main
from farfield.scene.read import read_scene

REPOSITORY = Path(__file__).parents[2]


def script(name: str) -> ModuleType:
    specification = importlib.util.spec_from_file_location(Path(name).stem, REPOSITORY / name)
    assert specification is not None
    assert specification.loader is not None
    module = importlib.util.module_from_spec(specification)
    sys.modules[specification.name] = module  # Dataclasses look their own module up.
    specification.loader.exec_module(module)
    return module


BUILDINGS = [
    [[(0, 0), (200, 0), (200, 200), (0, 200)], [(50, 50), (50, 90), (90, 90), (90, 50)]],
    [[(1000, 1000), (1100, 1000), (1000, 1200)]],
    [[(-40, 0), (-10, 0), (-10, 30)], [(400, 0), (500, 0), (500, 100), (400, 100)], [(410, 10), (430, 30), (430, 10)],
     [(450, 50), (460, 60), (460, 50)], [(600, 0), (601, 0), (601, 1)]],
]  # fmt: skip
"""Rings of decimetres: a square with a hole, a triangle, and three parts of which the second has two holes."""
HOLES = [[0, 1], [0], [0, 0, 1, 1, 0]]


def archive(path: Path) -> Path:
    """The buildings as differences."""
    rings = [ring for building in BUILDINGS for ring in building]
    steps = np.concatenate([np.diff(ring, axis=0) for ring in rings]).astype(np.int16)
    np.savez(
        path, ring_size=np.array([len(ring) for ring in rings], np.uint16),
        ring_is_hole=np.concatenate(HOLES).astype(np.uint8),
        anchor_x=np.array([ring[0][0] for ring in rings], np.int32), delta_x=steps[:, 0],
        anchor_y=np.array([ring[0][1] for ring in rings], np.int32), delta_y=steps[:, 1],
        building_rings=np.array([len(building) for building in BUILDINGS], np.uint16),
        height_dm=np.array([123, 45, 67], np.uint16), origin_m=np.array([-6000, -35000]),
    )  # fmt: skip
    return path


def plain_shape(rings: list[Any], holes: list[int]) -> shapely.Geometry:
    """The slow twin of Archive.shapes."""
    polygons: list[tuple[Any, list[Any]]] = []
    for ring, hole in zip(rings, holes, strict=True):
        points = np.round(np.array(ring) * 0.1 + (-6000, -35000), 1)
        if hole:
            polygons[-1][1].append(points)
        else:
            polygons.append((points, []))
    parts = [shapely.Polygon(outer, inner) for outer, inner in polygons]
    return parts[0] if len(parts) == 1 else shapely.MultiPolygon(parts)


def test_archive_to_flatgeobuf_to_scene(tmp_path: Path) -> None:
    source = archive(tmp_path / "a.npz")
    command = [sys.executable, str(REPOSITORY / "scripts/convert_tokyo.py"), str(source), str(tmp_path / "a.fgb")]
    subprocess.run(command, check=True, capture_output=True)
    scene = read_scene([tmp_path / "a.fgb"])
    assert scene.crs == "EPSG:6677"
    np.testing.assert_allclose(np.sort(scene.attributes["height"]), [4.5, 6.7, 12.3], rtol=1e-6)
    shapes, heights = script("scripts/convert_tokyo.py").read_archive(source, (-1, -1, 50, 50))
    assert heights.tolist() == [12.3]
    assert shapely.area(shapes).tolist() == pytest.approx([400 - 16])
    assert shapely.bounds(shapes)[0].tolist() == [-6000, -35000, -5980, -34980]


def test_archives_are_unpacked_as_one_building_after_another_would_be(tmp_path: Path) -> None:
    converter = script("scripts/convert_tokyo.py")
    packed = converter.open_archive(archive(tmp_path / "a.npz"))
    expected = np.array([plain_shape(*building) for building in zip(BUILDINGS, HOLES, strict=True)])
    assert shapely.equals_identical(packed.shapes(np.arange(3)), expected).all()
    assert shapely.equals_identical(packed.shapes(np.array([2, 0])), expected[[2, 0]]).all()
    assert packed.inside((-10, -10, 1, 1)).tolist() == [0, 2]
    assert [packed.kind(np.array(rows)) for rows in ([0, 1], [0, 1, 2])] == ["Polygon", "MultiPolygon"]


def test_batches_convert_to_the_same_file(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    converter = script("scripts/convert_tokyo.py")
    source = archive(tmp_path / "a.npz")
    converter.write_flatgeobuf(tmp_path / "b.fgb", *converter.read_archive(source))
    expected = (tmp_path / "b.fgb").read_bytes()
    monkeypatch.setattr(converter, "BATCH", 1)
    assert converter.convert(source, tmp_path / "b.fgb", None) == 3
    assert (tmp_path / "b.fgb").read_bytes() == expected


@pytest.mark.parametrize(
    ("name", "needs", "objects", "side"),
    [("tokyo", "tokyo_core_lod2/roofs.npz", 6919, 1240), ("forest", "eztree_trees/oak_dense.glb", 401, 200),
     ("statues", "threedscans_statues/pan.glb", 65, 28)],
)  # fmt: skip
def test_quality_scenes(
    shared_data: Callable[[str], Path], tmp_path: Path, monkeypatch: pytest.MonkeyPatch,
    name: str, needs: str, objects: int, side: float,
) -> None:  # fmt: skip
    data = shared_data(needs).parent.parent
    monkeypatch.setattr(sys, "path", list(sys.path))
    scene = read_scene([script("benchmarks/scenes.py").make(name, data, tmp_path)])
    assert scene.object_count == objects
    ground = scene.meshes[-1].load().positions
    assert np.ptp(ground[:, 0]) == side
    middle = scene.instances.transform[-1, :, 3]
    places = scene.instances.transform[:-1, :2, 3] - middle[:2]
    assert np.abs(places).max() <= 0.52 * side


def test_make_command(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    arguments = ["make", "objects", "-o", str(tmp_path / "a"), "--count", "9", "--triangles", "120", "--json"]
    assert main(arguments) == 0
    facts = json.loads(capsys.readouterr().out)
    assert facts["triangles"] == 9 * 108
    assert facts["bytes"] == sum(file.stat().st_size for file in (tmp_path / "a").iterdir())
    assert main([*arguments, "--side", "3"]) == 2
    assert "make: --side has no meaning for objects (leave it out)" in capsys.readouterr().err
    assert main(["make", "moon", "-o", str(tmp_path / "b")]) == 2
    assert "there is no scene 'moon' to make (one of objects, landscape, garden, terrain)" in capsys.readouterr().err
