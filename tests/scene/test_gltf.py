"""glTF: what is in the file is in the scene, z up."""

from __future__ import annotations

import base64
import io
import pickle
from collections.abc import Callable
from pathlib import Path

import DracoPy
import numpy as np
import pytest
import trimesh
from PIL import Image

from farfield.errors import InputError
from farfield.scene.assembly import compose
from farfield.scene.gltf import read_gltf
from farfield.scene.gltf.write import GlbOptions, write_glb
from farfield.scene.model import Mesh, Scene
from farfield.scene.procedural.trees import SHAPES, tree
from scene.small_gltf import TRIANGLE, GltfFile, triangle_file


def placed_corners(scene: Scene, instance: int = 0) -> np.ndarray:
    """(m, 3, 3) corners of an instance's triangles in the scene."""
    mesh = scene.meshes[scene.instances.mesh[instance]].load()
    matrix = scene.instances.transform[instance]
    return (mesh.positions @ matrix[:, :3].T + matrix[:, 3])[mesh.triangles]


def png(color: tuple[int, ...], mode: str = "RGBA") -> bytes:
    file = io.BytesIO()
    Image.new(mode, (2, 2), color).save(file, "PNG")
    return file.getvalue()


def test_y_up_becomes_z_up(tmp_path: Path) -> None:
    scene = read_gltf(triangle_file().write(tmp_path / "a.glb"))
    np.testing.assert_allclose(placed_corners(scene)[0], [[0, 0, 0], [1, 0, 0], [0, 0, 1]])
    np.testing.assert_allclose(scene.meshes[0].load().normals, [[0, -1, 0]] * 3, atol=1e-6)


def test_node_transforms_are_applied_along_the_tree(tmp_path: Path) -> None:
    file = triangle_file()
    file.json["nodes"][0] = {"children": [1], "translation": [10, 0, 0]}
    quarter = [0, np.sqrt(0.5), 0, np.sqrt(0.5)]
    file.node(root=False, mesh=0, rotation=quarter, scale=[2, 2, 2])
    corners = placed_corners(read_gltf(file.write(tmp_path / "a.glb")))[0]
    # A quarter turn about the file's y sends x to -z there, which is +y here.
    np.testing.assert_allclose(corners, [[10, 0, 0], [10, 2, 0], [10, 0, 2]], atol=1e-12)


def test_matrix_nodes_are_column_major(tmp_path: Path) -> None:
    file = triangle_file()
    file.json["nodes"][0]["matrix"] = [1, 0, 0, 0, 0, 1, 0, 0, 0, 0, 1, 0, 5, 6, 7, 1]
    assert placed_corners(read_gltf(file.write(tmp_path / "a.glb")))[0, 0].tolist() == [5, -7, 6]


def test_a_mesh_of_several_nodes_is_one_source_with_as_many_instances(tmp_path: Path) -> None:
    file = triangle_file()
    file.node(mesh=0, translation=[0, 0, 4])
    scene = read_gltf(file.write(tmp_path / "a.glb"))
    assert len(scene.meshes) == 1
    assert scene.instances.first_object.tolist() == [1, 2]
    assert scene.object_count == 2


def test_instancing_extension_with_normalised_rotations(tmp_path: Path) -> None:
    file = triangle_file()
    places = np.array([[0, 0, 0], [3, 0, 0], [6, 0, 0]], np.float32)
    turns = np.array([[0, 0, 0, 127], [0, 90, 0, 90], [0, 127, 0, 0]], np.int8)
    sizes = np.array([[1, 1, 1], [1, 1, 1], [2, 2, 2]], np.float32)
    file.json["nodes"][0]["extensions"] = {"EXT_mesh_gpu_instancing": {"attributes": {
        "TRANSLATION": file.accessor(places), "ROTATION": file.accessor(turns, normalized=True),
        "SCALE": file.accessor(sizes)}}}  # fmt: skip
    file.json["nodes"][0]["translation"] = [0, 5, 0]
    scene = read_gltf(file.write(tmp_path / "a.glb"))
    assert len(scene.instances.mesh) == 3
    np.testing.assert_allclose(placed_corners(scene, 1)[0], [[3, 0, 5], [3, 1, 5], [3, 0, 6]], atol=1e-6)
    np.testing.assert_allclose(placed_corners(scene, 2)[0], [[6, 0, 5], [4, 0, 5], [6, 0, 7]], atol=1e-6)


def test_quantised_positions_and_strided_views(tmp_path: Path) -> None:
    file = GltfFile()
    packed = np.zeros(3, np.dtype([("p", "<u2", 3), ("pad", "<u2"), ("n", "i1", 3), ("pad2", "i1")]))
    packed["p"] = TRIANGLE * 65535
    packed["n"] = [0, 0, 127]
    view = file.view(packed.tobytes(), byteStride=12)
    common = {"bufferView": view, "count": 3, "type": "VEC3", "normalized": True}
    file.json["accessors"] = [common | {"componentType": 5123}, common | {"componentType": 5120, "byteOffset": 8}]
    file.mesh({"POSITION": 0, "NORMAL": 1})
    file.node(mesh=0)
    file.json["extensionsRequired"] = ["KHR_mesh_quantization"]
    mesh = read_gltf(file.write(tmp_path / "a.glb")).meshes[0].load()
    np.testing.assert_allclose(mesh.positions, [[0, 0, 0], [1, 0, 0], [0, 0, 1]])
    np.testing.assert_allclose(mesh.normals, [[0, -1, 0]] * 3)


def test_sparse_accessors(tmp_path: Path) -> None:
    file = triangle_file()
    file.json["accessors"][0]["sparse"] = {
        "count": 1,
        "indices": {"bufferView": file.view(np.array([1], "<u2").tobytes()), "componentType": 5123},
        "values": {"bufferView": file.view(np.array([7, 0, 0], "<f4").tobytes())},
    }
    corners = placed_corners(read_gltf(file.write(tmp_path / "a.glb")))
    np.testing.assert_allclose(corners[0], [[0, 0, 0], [7, 0, 0], [0, 0, 1]])


@pytest.mark.parametrize(("mode", "count"), [(4, 1), (5, 2), (6, 2)])
def test_strips_and_fans(tmp_path: Path, mode: int, count: int) -> None:
    file = GltfFile()
    square = [[0, 0, 0], [1, 0, 0], [0, 1, 0], [1, 1, 0]] if mode == 5 else [[0, 0, 0], [1, 0, 0], [1, 1, 0], [0, 1, 0]]
    file.mesh({"POSITION": file.accessor(np.array(square, np.float32))}, mode=mode)
    file.node(mesh=0)
    mesh = read_gltf(file.write(tmp_path / "a.glb")).meshes[0].load()
    assert len(mesh.triangles) == count
    np.testing.assert_allclose(mesh.normals, [[0, -1, 0]] * len(mesh.normals), atol=1e-6)


def test_material_channels(tmp_path: Path) -> None:
    file = triangle_file(material=0)
    uv = np.array([[0, 0], [1, 0], [0, 1]], np.float32)
    attributes = file.json["meshes"][0]["primitives"][0]["attributes"]
    attributes |= {"TEXCOORD_1": file.accessor(uv), "COLOR_0": file.accessor(np.array([[0.5, 0, 1]] * 3, np.float32))}
    file.json["images"] = [{"bufferView": file.view(png((10, 20, 30, 255))), "mimeType": "image/png"}]
    file.json["textures"] = [{"source": 0}]
    transform = {"KHR_texture_transform": {"offset": [0.5, 0], "scale": [2, 3], "rotation": np.pi / 2}}
    file.material(
        name="leaf", alphaMode="MASK", alphaCutoff=0.3, doubleSided=True, extensions={"KHR_materials_unlit": {}},
        pbrMetallicRoughness={"baseColorFactor": [0.1, 0.2, 0.3, 0.4],
                              "baseColorTexture": {"index": 0, "texCoord": 1, "extensions": transform}},
    )  # fmt: skip
    mesh = read_gltf(file.write(tmp_path / "a.glb")).meshes[0].load()
    material = mesh.materials[0]
    assert (material.name, material.base_color, material.alpha_cutoff) == ("leaf", (0.1, 0.2, 0.3, 0.4), 0.3)
    assert material.double_sided
    assert material.unlit
    assert material.texture is not None
    assert material.texture.pixels[0, 0].tolist() == [10, 20, 30, 255]
    assert mesh.colors is not None
    assert mesh.colors[0].tolist() == [188, 0, 255, 255]
    # Scale, then a quarter turn that sends u to -v, then the offset.
    np.testing.assert_allclose(mesh.uvs, [[0.5, 0], [0.5, -2], [3.5, 0]], atol=1e-6)


@pytest.mark.parametrize(
    ("fields", "cutoff"), [({}, None), ({"alphaMode": "MASK"}, 0.5), ({"alphaMode": "BLEND"}, 0.5)]
)
def test_alpha_modes(tmp_path: Path, fields: dict[str, str], cutoff: float | None) -> None:
    file = triangle_file(material=0)
    file.material(**fields)
    material = read_gltf(file.write(tmp_path / "a.glb")).meshes[0].load().materials[0]
    assert material.alpha_cutoff == cutoff
    assert not material.double_sided


def test_buffers_beside_and_inside_the_file(tmp_path: Path) -> None:
    scene = read_gltf(triangle_file().write(tmp_path / "a.gltf"))
    assert len(scene.meshes[0].load().triangles) == 1
    assert scene.source_bytes == sum(file.stat().st_size for file in tmp_path.iterdir())
    file = triangle_file()
    file.write(tmp_path / "b.gltf")
    uri = "data:application/octet-stream;base64," + base64.b64encode(file.chunk).decode()
    text = (tmp_path / "b.gltf").read_text().replace("a%20b.bin", uri)
    (tmp_path / "c.gltf").write_text(text)
    (tmp_path / "a b.bin").unlink()
    assert len(read_gltf(tmp_path / "c.gltf").meshes[0].load().triangles) == 1


def test_draco_with_attribute_numbers_of_the_file(tmp_path: Path) -> None:
    file = GltfFile()
    raw = DracoPy.encode(TRIANGLE, np.array([[0, 1, 2]], np.uint32), quantization_bits=14,
                         normals=np.array([[0.0, 0, 1]] * 3))  # fmt: skip
    ids = {entry["attribute_type"]: entry["unique_id"] for entry in DracoPy.decode(raw).attributes}
    stub = {"componentType": 5126, "count": 3, "type": "VEC3"}
    file.json["accessors"] = [stub, stub]
    extension = {"bufferView": file.view(raw), "attributes": {"POSITION": ids[0], "NORMAL": ids[1]}}
    file.mesh({"POSITION": 0, "NORMAL": 1}, extensions={"KHR_draco_mesh_compression": extension})
    file.node(mesh=0)
    file.json["extensionsRequired"] = ["KHR_draco_mesh_compression"]
    mesh = read_gltf(file.write(tmp_path / "a.glb")).meshes[0].load()
    np.testing.assert_allclose(np.sort(mesh.positions, 0), [[0, 0, 0], [0, 0, 0], [1, 0, 1]], atol=1e-3)
    np.testing.assert_allclose(mesh.normals, [[0, -1, 0]] * 3, atol=1e-6)


@pytest.mark.parametrize("options", [GlbOptions(), GlbOptions(draco=True, position_bits=16, image_format="WEBP")])
def test_what_is_written_is_read(tmp_path: Path, options: GlbOptions) -> None:
    mesh = tree(SHAPES[0], 2500, 3)
    write_glb(tmp_path / "tree.glb", mesh, options)
    again = read_gltf(tmp_path / "tree.glb").meshes[0].load()
    assert [m.name for m in again.materials] == [m.name for m in mesh.materials]
    assert [m.alpha_cutoff for m in again.materials] == [None, 0.5]
    assert abs(len(again.triangles) - len(mesh.triangles)) <= 5
    np.testing.assert_allclose(bounds(again), bounds(mesh), atol=2e-3)
    assert again.colors is not None
    if not options.draco:
        np.testing.assert_allclose(centers(again), centers(mesh), atol=1e-5)


def bounds(mesh: Mesh) -> np.ndarray:
    return np.stack([mesh.positions.min(0), mesh.positions.max(0)])


def centers(mesh: Mesh) -> np.ndarray:
    return mesh.positions[mesh.triangles].mean(1)


def test_sources_are_picklable_and_hold_no_geometry(tmp_path: Path) -> None:
    scene = read_gltf(triangle_file().write(tmp_path / "a.glb"))
    source = pickle.loads(pickle.dumps(scene.meshes[0]))
    assert source == scene.meshes[0]
    assert len(source.load().triangles) == 1
    assert len(pickle.dumps(source)) < 1000


def test_a_changed_file_is_read_again(tmp_path: Path) -> None:
    path = triangle_file().write(tmp_path / "a.glb")
    source = read_gltf(path).meshes[0]
    assert len(source.load().triangles) == 1
    file = GltfFile()
    file.mesh({"POSITION": file.accessor(np.concatenate([TRIANGLE, TRIANGLE + 1]))})
    file.node(mesh=0)
    file.write(path)
    assert len(source.load().triangles) == 2


def test_compose_agrees_with_matrices() -> None:
    random = np.random.default_rng(1)
    a, b = random.standard_normal((2, 5, 3, 4))
    full = [np.concatenate([m, np.tile([[[0, 0, 0, 1.0]]], (5, 1, 1))], 1) for m in (a, b)]
    np.testing.assert_allclose(compose(a, b), (full[0] @ full[1])[:, :3])


def error_line(path: Path) -> str:
    def everything() -> list[Mesh]:
        return [source.load() for source in read_gltf(path).meshes]

    with pytest.raises(InputError) as caught:
        everything()
    return str(caught.value).replace(str(path.parent) + "/", "")


def test_refuses_required_extensions_by_name(tmp_path: Path) -> None:
    file = triangle_file()
    file.json["extensionsRequired"] = ["EXT_meshopt_compression"]
    assert error_line(file.write(tmp_path / "a.glb")) == (
        "a.glb: needs the glTF extension EXT_meshopt_compression, which is not read (export it without that extension)"
    )


def test_truncated(tmp_path: Path) -> None:
    path = triangle_file().write(tmp_path / "a.glb")
    whole = path.read_bytes()
    path.write_bytes(whole[:-20])
    assert error_line(path) == (
        f"a.glb: is truncated: {len(whole) - 20} of {len(whole)} bytes are there (export or download it again)"
    )
    path.write_bytes(whole[:10])
    assert error_line(path) == "a.glb: is truncated after 10 bytes (export or download it again)"


def test_damaged(tmp_path: Path) -> None:
    file = triangle_file()
    file.json["accessors"][0]["count"] = 4
    assert error_line(file.write(tmp_path / "a.glb")) == (
        "a.glb: is truncated: bufferViews[0] is shorter than its accessor (export or download it again)"
    )
    file.json["accessors"][0]["count"] = 3
    file.json["nodes"][0]["children"] = [0]
    assert error_line(file.write(tmp_path / "a.glb")) == (
        "a.glb: is damaged: its nodes form a cycle (export or download it again)"
    )
    file.json["nodes"][0] = {"mesh": 7}
    assert error_line(file.write(tmp_path / "a.glb")) == (
        "a.glb: is damaged: it refers to meshes[7], which is not there (export or download it again)"
    )


def test_missing_buffer(tmp_path: Path) -> None:
    path = triangle_file().write(tmp_path / "a.gltf")
    (tmp_path / "a b.bin").unlink()
    assert error_line(path) == "a b.bin: there is no such file (check the path)"


def test_missing_texture_is_a_warning_and_the_factor_is_used(tmp_path: Path) -> None:
    file = triangle_file(material=0)
    file.json |= {"images": [{"uri": "bark.png"}], "textures": [{"source": 0}]}
    file.material(pbrMetallicRoughness={"baseColorFactor": [0.5, 0.25, 0, 1], "baseColorTexture": {"index": 0}})
    mesh = read_gltf(file.write(tmp_path / "a.glb")).meshes[0].load()
    assert mesh.materials[0].base_color == (0.5, 0.25, 0, 1)
    assert mesh.materials[0].texture is None
    line = f"{tmp_path}/a.glb: texture bark.png: there is no such file; its material's colour is used"
    assert mesh.warnings == (line,)
    (tmp_path / "bark.png").write_bytes(b"no image")
    (tmp_path / "a.glb").touch()
    assert "is not an image" in read_gltf(tmp_path / "a.glb").meshes[0].load().warnings[0]


def test_nothing_but_points(tmp_path: Path) -> None:
    file = triangle_file(mode=0)
    assert error_line(file.write(tmp_path / "a.glb")) == "a.glb: holds no triangles (export its meshes with it)"


@pytest.mark.parametrize(
    ("name", "triangles"),
    [
        ("threedscans_statues/eagle.glb", 217_768),
        ("eztree_trees/aspen_medium.glb", 7_200),
        ("eztree_trees/extra_rock1.glb", 1_756),
        ("gltf_samples/DiffuseTransmissionPlant.glb", 69_806),
        ("gltf_samples/ToyCar/ToyCar.gltf", 108_936),
    ],
)
def test_real_files_agree_with_trimesh(shared_data: Callable[[str], Path], name: str, triangles: int) -> None:
    scene = read_gltf(shared_data(name))
    meshes = [scene.meshes[row].load() for row in scene.instances.mesh]
    assert sum(len(mesh.triangles) for mesh in meshes) == triangles
    corners = np.concatenate([placed_corners(scene, k).reshape(-1, 3) for k in range(len(meshes))])
    low, high = trimesh.load_scene(shared_data(name)).bounds
    expected = [[low[0], -high[2], low[1]], [high[0], -low[2], high[1]]]
    size = np.ptp(corners, axis=0).max()
    np.testing.assert_allclose([corners.min(0), corners.max(0)], expected, atol=1e-3 * size)
    for mesh in meshes:
        np.testing.assert_allclose(np.linalg.norm(mesh.normals, axis=1), 1, atol=1e-5)
