"""OBJ with MTL, PLY and STL."""

from __future__ import annotations

import struct
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
from PIL import Image

from farfield.errors import InputError
from farfield.scene.model import Mesh
from farfield.scene.options import ReadOptions
from farfield.scene.read import read_scene

OBJ = """mtllib scene.mtl
v 0 0 0
v 2 0 0
v 2 1 0
v 0 1 0
vt 0 0
vt 1 0
vt 1 1
vt 0 1
usemtl brick
f 1/1 2/2 3/3 4/4
usemtl glass
f -4 -3 -1
"""
MTL = "newmtl brick\nKd 1 1 1\nmap_Kd -s 1 1 1 wall tile.png\nnewmtl glass\nKd 0.5 0 0\nd 0.4\n"


def load(path: Path, options: ReadOptions | None = None) -> Mesh:
    return read_scene([path], options).meshes[0].load()


def error_line(path: Path) -> str:
    with pytest.raises(InputError) as caught:
        load(path)
    return str(caught.value).replace(str(path.parent) + "/", "")


def test_obj_with_materials(tmp_path: Path) -> None:
    (tmp_path / "scene.obj").write_text(OBJ)
    (tmp_path / "scene.mtl").write_text(MTL)
    Image.new("RGB", (2, 2), (1, 2, 3)).save(tmp_path / "wall tile.png")
    mesh = load(tmp_path / "scene.obj")
    assert [mesh.materials[k].name for k in mesh.triangle_material] == ["brick", "brick", "glass"]
    brick, glass = (mesh.materials[k] for k in mesh.triangle_material[[0, 2]])
    assert brick.texture is not None
    assert brick.texture.pixels[0, 0].tolist() == [1, 2, 3, 255]
    assert glass.base_color == pytest.approx((0.214, 0, 0, 0.4), abs=1e-3)
    assert mesh.uvs is not None
    corner = mesh.triangles[0, 2]
    assert mesh.positions[corner].tolist() == [2, 1, 0]
    assert mesh.uvs[corner].tolist() == [1, 0]
    assert mesh.positions[mesh.triangles[2]].tolist() == [[0, 0, 0], [2, 0, 0], [0, 1, 0]]
    assert mesh.warnings == ()


def test_obj_missing_texture_and_library_are_warnings(tmp_path: Path) -> None:
    (tmp_path / "scene.obj").write_text(OBJ)
    assert load(tmp_path / "scene.obj").warnings == (
        f"{tmp_path}/scene.mtl: there is no such file; its materials are drawn white",
    )
    (tmp_path / "scene.mtl").write_text(MTL)
    assert load(tmp_path / "scene.obj").warnings == (
        f"{tmp_path}/scene.mtl: texture wall tile.png: there is no such file; its material's colour is used",
    )


def test_obj_vertex_colours_and_normals(tmp_path: Path) -> None:
    (tmp_path / "a.obj").write_text("v 0 0 0 1 0 0\nv 1 0 0 0 1 0\nv 0 1 0 0 0 1\nvn 0 0 1\nf 1//1 2//1 3//1 # plain\n")
    mesh = load(tmp_path / "a.obj")
    assert mesh.colors is not None
    assert mesh.colors.tolist() == [[255, 0, 0, 255], [0, 255, 0, 255], [0, 0, 255, 255]]
    assert mesh.normals.tolist() == [[0, 0, 1]] * 3


def test_obj_faces_of_vertices_that_do_not_exist(tmp_path: Path) -> None:
    (tmp_path / "a.obj").write_text("v 0 0 0\nv 1 0 0\nv 0 1 0\nf 1 2 3\nf 1 2 9\n")
    mesh = load(tmp_path / "a.obj")
    assert len(mesh.triangles) == 1
    assert mesh.warnings == (f"{tmp_path}/a.obj: left out 1 triangle with vertices that are NaN or infinite",)


def test_obj_without_faces(tmp_path: Path) -> None:
    (tmp_path / "a.obj").write_text("v 0 0 0\nv 1 0 0\n")
    assert error_line(tmp_path / "a.obj") == "a.obj: holds no faces (export its polygons with it)"


def ply_header(form: str, vertices: int, faces: int, colors: bool = True) -> bytes:
    color = "property uchar red\nproperty uchar green\nproperty uchar blue\n" if colors else ""
    return (
        f"ply\nformat {form} 1.0\ncomment x\nelement vertex {vertices}\nproperty float x\nproperty float y\n"
        f"property float z\n{color}element face {faces}\nproperty list uchar int vertex_indices\nend_header\n"
    ).encode()


CORNERS = [(0, 0, 0, 255, 0, 0), (1, 0, 0, 0, 255, 0), (1, 1, 0, 0, 0, 255), (0, 1, 0, 9, 9, 9)]


@pytest.mark.parametrize("order", ["little", "big"])
@pytest.mark.parametrize("faces", [[(0, 1, 2), (0, 2, 3)], [(0, 1, 2, 3)]])
def test_ply_binary(tmp_path: Path, order: str, faces: list[tuple[int, ...]]) -> None:
    sign = "<" if order == "little" else ">"
    body = b"".join(struct.pack(sign + "3f3B", *corner) for corner in CORNERS)
    body += b"".join(struct.pack(f"{sign}B{len(face)}i", len(face), *face) for face in faces)
    (tmp_path / "a.ply").write_bytes(ply_header(f"binary_{order}_endian", 4, len(faces)) + body)
    check_square(load(tmp_path / "a.ply"))


def test_ply_text(tmp_path: Path) -> None:
    body = "\n".join(" ".join(map(str, corner)) for corner in CORNERS) + "\n4 0 1 2 3\n"
    (tmp_path / "a.ply").write_bytes(ply_header("ascii", 4, 1) + body.encode())
    check_square(load(tmp_path / "a.ply"))


def check_square(mesh: Mesh) -> None:
    assert mesh.triangles.tolist() == [[0, 1, 2], [0, 2, 3]]
    assert mesh.positions.tolist() == [list(corner[:3]) for corner in CORNERS]
    assert mesh.colors is not None
    assert mesh.colors[:, :3].tolist() == [list(corner[3:]) for corner in CORNERS]
    assert mesh.normals.tolist() == [[0, 0, 1]] * 4


def test_ply_truncated_and_of_points(tmp_path: Path) -> None:
    body = b"".join(struct.pack("<3f", *corner[:3]) for corner in CORNERS)
    (tmp_path / "a.ply").write_bytes(ply_header("binary_little_endian", 4, 2, colors=False) + body)
    assert error_line(tmp_path / "a.ply") == (
        "a.ply: is truncated: at least 1 byte are missing (export or download it again)"
    )
    (tmp_path / "a.ply").write_bytes(ply_header("binary_little_endian", 4, 0, colors=False) + body)
    assert error_line(tmp_path / "a.ply") == "a.ply: holds points but no faces (make a mesh of it first)"


def stl(triangles: list[list[list[float]]]) -> bytes:
    facets = b"".join(struct.pack("<12fH", 0, 0, 0, *np.ravel(corners), 0) for corners in triangles)
    return b"solid but binary".ljust(80) + struct.pack("<I", len(triangles)) + facets


def test_stl_binary_and_text(tmp_path: Path) -> None:
    corners = [[0.0, 0, 0], [1, 0, 0], [0, 0, 1]]
    (tmp_path / "a.stl").write_bytes(stl([corners]))
    lines = "".join(f"vertex {x} {y} {z}\n" for x, y, z in corners)
    (tmp_path / "b.stl").write_text(f"solid b\nfacet normal 0 0 0\nouter loop\n{lines}endloop\nendfacet\nendsolid\n")
    for name in ("a.stl", "b.stl"):
        mesh = load(tmp_path / name)
        assert mesh.positions[mesh.triangles[0]].tolist() == corners
        assert mesh.normals.tolist() == [[0, -1, 0]] * 3


def test_stl_truncated(tmp_path: Path) -> None:
    (tmp_path / "a.stl").write_bytes(stl([[[0.0, 0, 0], [1, 0, 0], [0, 0, 1]]] * 2)[:-60])
    assert error_line(tmp_path / "a.stl") == (
        "a.stl: is truncated: 124 of 184 bytes are there (export or download it again)"
    )


def test_up_option(tmp_path: Path) -> None:
    (tmp_path / "a.stl").write_bytes(stl([[[0.0, 0, 0], [1, 0, 0], [0, 5, 0]]]))
    scene = read_scene([tmp_path / "a.stl"], ReadOptions(up="y"))
    matrix = scene.instances.transform[0]
    np.testing.assert_allclose(matrix[:, :3] @ [0, 5, 0], [0, 0, 5])


@pytest.mark.parametrize("name", ["koala", "nefertiti-lowres"])
def test_real_ply_is_closed_and_smooth(shared_data: Callable[[str], Path], name: str) -> None:
    mesh = load(shared_data(f"odedstein_meshes/{name}.ply"))
    corners = mesh.positions[mesh.triangles]
    facing = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    # A closed surface has a vector area of zero, and a positive volume when its normals point outward.
    np.testing.assert_allclose(facing.sum(0), 0, atol=1e-6 * np.abs(facing).sum())
    assert (corners[:, 0] * facing).sum() > 0
    agree = np.einsum("mc,mc->m", facing, mesh.normals[mesh.triangles[:, 0]]) > 0
    assert agree.all()
