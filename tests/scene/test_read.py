"""Choosing a reader, and what is said when a source cannot be read."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from farfield.errors import InputError
from farfield.scene.read import read_scene
from scene.small_gltf import triangle_file


def error_line(*paths: Path) -> str:
    with pytest.raises(InputError) as caught:
        read_scene(paths)
    return str(caught.value).replace(str(paths[0].parent) + "/", "")


@pytest.mark.parametrize(
    ("name", "content", "line"),
    [
        ("a.obj", b"glTF\2\0\0\0", "a.obj: is a GLB file, not OBJ (rename it to a.glb)"),
        ("a.glb", b"ply\nformat", "a.glb: is a PLY file, not GLB (rename it to a.ply)"),
        ("a.glb", b"v 0 0 0\nv 1 0 0\nv 0 1 0\nf 1 2 3\n", "a.glb: is an OBJ file, not GLB (rename it to a.obj)"),
        ("a.gltf", b'{"type": "FeatureCollection"}', "a.gltf: is a GeoJSON file, not glTF (rename it to a.geojson)"),
        ("a.fgb", b"\0\0\0\x0e\x0a\x09OSMHeader", "a.fgb: is an OSM-PBF file, not FlatGeobuf (rename it to a.osm.pbf)"),
        ("a.pbf", b'<?xml version="1.0"?>\n<osm>', "a.pbf: is an OSM-XML file, not OSM-PBF (rename it to a.osm)"),
        ("a.osm", b"BZh91AY", "a.osm: is a bzip2 archive, not OSM-XML (check what was downloaded or exported)"),
        ("a.geojson", b'{"asset": {}}', "a.geojson: is a glTF file, not GeoJSON (rename it to a.gltf)"),
        ("a.fgb", b"SQLite format 3\0", "a.fgb: is a GeoPackage file, not FlatGeobuf (rename it to a.gpkg)"),
        ("a.glb", b"PK\3\4", "a.glb: is a ZIP archive, not GLB (check what was downloaded or exported)"),
        ("a.ply", b"<!DOCTYPE html>", "a.ply: is an HTML page, not PLY (check what was downloaded or exported)"),
        ("a.glb", b"", "a.glb: is empty (export or download it again)"),
        ("a.ply", b"nonsense", "a.ply: is damaged: it has no PLY header (export or download it again)"),
        ("a.gltf", b'{"a": 1}', "a.gltf: is JSON, but not glTF (check the path)"),
    ],
)  # fmt: skip
def test_content_and_extension(tmp_path: Path, name: str, content: bytes, line: str) -> None:
    (tmp_path / name).write_bytes(content)
    assert error_line(tmp_path / name) == line


def test_missing_folder_and_unknown_extension(tmp_path: Path) -> None:
    assert error_line(tmp_path / "a.glb") == "a.glb: there is no such file (check the path)"
    (tmp_path / "folder").mkdir()
    assert error_line(tmp_path / "folder") == (
        "folder: is a folder, not a file (name a file in it, or a folder that holds a scene.toml)"
    )
    (tmp_path / "a.fbx").write_bytes(b"Kaydara FBX")
    assert error_line(tmp_path / "a.fbx") == (
        "a.fbx: .fbx is not a format that is read (one of .glb .gltf .obj .ply .stl .geojson .json .jsonl .gpkg .fgb "
        ".parquet .geoparquet .pbf .osm .toml)"
    )


def test_the_good_part_of_a_mixed_input_is_read(tmp_path: Path) -> None:
    good, bad = triangle_file().write(tmp_path / "a.glb"), tmp_path / "b.glb"
    bad.write_bytes(good.read_bytes()[:-8])
    scene = read_scene([bad, good, tmp_path / "c.glb"])
    assert len(scene.meshes[0].load().triangles) == 1
    size = good.stat().st_size
    assert scene.warnings == (
        f"left out: {bad}: is truncated: {size - 8} of {size} bytes are there (export or download it again)",
        f"left out: {tmp_path}/c.glb: there is no such file (check the path)",
    )
    assert error_line(tmp_path / "c.glb", bad) == (
        "c.glb: there is no such file; and 1 more sources cannot be read (check the path)"
    )


def test_nan_vertices_of_a_file(tmp_path: Path) -> None:
    corners = np.array([[0, 0, 0], [1, 0, 0], [0, 1, 0], [np.nan, 0, 0]])
    text = "".join(f"v {x} {y} {z}\n" for x, y, z in corners) + "f 1 2 3\nf 1 2 4\nf 1 1 2\n"
    (tmp_path / "a.obj").write_text(text)
    mesh = read_scene([tmp_path / "a.obj"]).meshes[0].load()
    assert len(mesh.triangles) == 1
    assert mesh.warnings == (
        f"{tmp_path}/a.obj: left out 1 triangle with vertices that are NaN or infinite",
        f"{tmp_path}/a.obj: left out 1 triangle of zero area",
    )
