"""An update gives the bytes of a whole bake, and bakes only what changed."""

from __future__ import annotations

import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from PIL import Image

from bake.scenes import contents
from farfield.bake.options import BakeOptions
from farfield.cli import main
from farfield.pipeline import bake_sources, update_place
from farfield.scene.procedural.objects import ObjectsOptions, make_objects
from farfield.scene.read import read_scene
from farfield.scene.stored.sources import print_of
from farfield.store.directory import DirectoryStore
from farfield.world.garbage import drop_garbage
from farfield.world.manifest import read_manifest
from scene.small_gltf import TRIANGLE, triangle_file

OPTIONS = BakeOptions(leaf_size=16.0, resolution=32, directions="5", workers=1)


@pytest.fixture
def scene(tmp_path: Path) -> Path:
    """Some objects."""
    return make_objects(tmp_path / "scene", ObjectsOptions(count=24, triangles=300, kinds=3)).path


def change(scene: Path, remove: bool) -> None:
    """One object moves; the last of another kind goes."""
    table = np.load(scene.parent / "objects-0.npy")
    table[2, :3] += [3.0, -2.0, 1.0]
    np.save(scene.parent / "objects-0.npy", table)
    if remove:
        last = np.load(scene.parent / "objects-2.npy")
        np.save(scene.parent / "objects-2.npy", last[:-1])


def test_the_bytes_are_those_of_a_whole_bake(scene: Path, tmp_path: Path) -> None:
    place = tmp_path / "world"
    bake_sources([scene], place, OPTIONS)
    before = read_manifest(DirectoryStore(place))
    change(scene, remove=True)
    facts = update_place(place, [scene], workers=1)
    assert 0 < facts["cells_rebuilt"] < facts["cells"] / 2
    assert facts["generation"] == before.generation + 1
    whole = tmp_path / "whole"
    corner = before.grid.corner
    bake_sources([scene], whole, BakeOptions(leaf_size=16.0, resolution=32, directions="5", workers=1, corner=corner))
    drop_garbage(DirectoryStore(place))
    assert contents(place) == contents(whole)


def test_without_a_change_nothing_is_baked(scene: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    place = tmp_path / "world"
    bake_sources([scene], place, OPTIONS)
    assert main(["update", str(place), str(scene), "--workers", "1", "--json"]) == 0
    facts = json.loads(capsys.readouterr().out)
    assert (facts["cells_rebuilt"], facts["generation"]) == (0, 1)


def test_a_world_in_another_crs_is_refused(scene: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    place = tmp_path / "world"
    bake_sources([scene], place, OPTIONS)
    text = scene.read_text()
    scene.write_text('crs = "EPSG:6677"\n' + text)
    assert main(["update", str(place), str(scene)]) == 1
    assert "the source has CRS EPSG:6677, the world None" in capsys.readouterr().err


def test_a_changed_mesh_is_noticed(scene: Path, tmp_path: Path) -> None:
    """What is known of meshes from the bake before holds while their files are as they were."""
    place = tmp_path / "world"
    bake_sources([scene], place, OPTIONS)
    mesh = scene.parent / "object-1.glb"
    other = make_objects(tmp_path / "other", ObjectsOptions(count=24, triangles=500, kinds=3, seed=7)).path
    mesh.write_bytes((other.parent / "object-1.glb").read_bytes())
    facts = update_place(place, [scene], workers=1)
    assert facts["cells_rebuilt"] > 0
    whole = tmp_path / "whole"
    corner = read_manifest(DirectoryStore(place)).grid.corner
    bake_sources([scene], whole, replace(OPTIONS, corner=corner))
    drop_garbage(DirectoryStore(place))
    assert contents(place) == contents(whole)


@pytest.mark.parametrize("extension", [".glb", ".gltf"])
def test_a_changed_image_beside_a_gltf_is_noticed(tmp_path: Path, extension: str) -> None:
    """And only then is the mesh read again."""
    file = triangle_file(material=0)
    file.json["meshes"][0]["primitives"][0]["attributes"]["TEXCOORD_0"] = file.accessor(TRIANGLE[:, :2])
    file.json |= {"images": [{"uri": "bark.png"}], "textures": [{"source": 0}]}
    file.material(pbrMetallicRoughness={"baseColorTexture": {"index": 0}}, doubleSided=True)
    source, image = file.write(tmp_path / f"tree{extension}"), tmp_path / "bark.png"
    Image.new("RGB", (4, 4), (200, 10, 10)).save(image)
    place = tmp_path / "world"
    bake_sources([source], place, OPTIONS)
    (mesh,) = read_scene([source]).meshes
    assert print_of(mesh) == print_of(mesh) is not None
    assert update_place(place, [source], workers=1)["cells_rebuilt"] == 0
    Image.new("RGB", (8, 8), (10, 10, 200)).save(image)
    assert update_place(place, [source], workers=1)["cells_rebuilt"] > 0
    whole = tmp_path / "whole"
    bake_sources([source], whole, replace(OPTIONS, corner=read_manifest(DirectoryStore(place)).grid.corner))
    drop_garbage(DirectoryStore(place))
    assert contents(place) == contents(whole)
