"""The true picture against rays traced by an independent library, and what it leaves out."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import pytest
import trimesh
from numpy.typing import NDArray

from farfield.errors import InputError
from farfield.geometry.cameras import Camera, vertical_fov
from farfield.geometry.color import srgb_from_linear
from farfield.octree.grid import Grid
from farfield.scene.model import Instances, Material, Mesh, MeshSource, Scene
from farfield.view.left_out import LeftOut
from farfield.view.shading import Light
from farfield.view.truth import TruthOptions, draw_truth
from represent.shapes import faces, mesh_of, rectangle

SIZE = (96, 64)


@dataclass
class Held:
    """A mesh that is loaded already."""

    mesh: Mesh
    name: str = "held"

    def load(self) -> Mesh:
        return self.mesh


class Broken:
    name = "broken"

    def load(self) -> Mesh:
        raise InputError("gone", "broken.glb")


def scene_of(meshes: list[MeshSource], placements: list[tuple[int, NDArray[np.float64]]] | None = None) -> Scene:
    placements = placements or [(k, np.eye(3, 4)) for k in range(len(meshes))]
    numbers = np.arange(1, len(placements) + 1, dtype=np.int64)
    rows = Instances(np.array([m for m, _ in placements], np.int32), np.stack([t for _, t in placements]), numbers,
                     np.ones_like(numbers))  # fmt: skip
    return Scene(meshes, rows, object_count=len(placements))


def at(x: float, y: float, z: float, linear: NDArray[np.float64] | None = None) -> NDArray[np.float64]:
    return np.concatenate([np.eye(3) if linear is None else linear, [[x], [y], [z]]], axis=1)


def test_depth_normals_and_silhouettes_agree_with_traced_rays() -> None:
    ray = pytest.importorskip("trimesh.ray.ray_pyembree")
    knot = trimesh.creation.torus(2.0, 0.7, 64, 32)
    ball = trimesh.creation.icosphere(4)
    ground = trimesh.creation.box([60, 60, 0.2])
    turned = trimesh.transformations.rotation_matrix(1.1, [1, 2, 0.5])[:3, :3]
    placements = [
        (0, at(0, 6, 2.5, turned)),
        (1, at(3, 9, 1, np.diag([1, 2, -1.0]))),
        (1, at(-3, 4, 1)),
        (2, at(0, 0, -0.1)),
    ]
    shapes = [knot, ball, ground]
    scene = scene_of([Held(mesh_of(knot)), Held(mesh_of(ball)), Held(mesh_of(ground, flat=True))], placements)
    camera = Camera((0.3, -4, 3), (0.1, 6, 1.2), vertical_fov(60, SIZE))
    picture = draw_truth(scene, camera, SIZE, TruthOptions(supersampling=1, normals=True, ids=True))

    world = [
        trimesh.Trimesh(shapes[m].vertices @ t[:, :3].T + t[:, 3], shapes[m].faces, process=False)
        for m, t in placements
    ]
    joined = trimesh.util.concatenate(world)
    owner = np.repeat(np.arange(1, 5), [len(w.faces) for w in world])
    axes, focal = camera.axes, camera.focal(SIZE)
    x, y = np.meshgrid(np.arange(SIZE[0]) + 0.5 - SIZE[0] / 2, np.arange(SIZE[1]) + 0.5 - SIZE[1] / 2)
    rays = (x[..., None] * axes[0] + y[..., None] * axes[1]) / focal + axes[2]
    origins = np.broadcast_to(camera.eye, rays.shape).reshape(-1, 3)
    hit, index, place = ray.RayMeshIntersector(joined).intersects_id(
        origins, rays.reshape(-1, 3), multiple_hits=False, return_locations=True
    )
    depth = np.full(SIZE[0] * SIZE[1], np.inf)
    depth[index] = (place - camera.eye) @ axes[2]
    names = np.zeros(SIZE[0] * SIZE[1], dtype=int)
    names[index] = owner[hit]
    assert picture.ids is not None
    assert picture.normal is not None
    agree = (picture.ids == names.reshape(picture.ids.shape)) & np.isclose(
        picture.depth, depth.reshape(picture.depth.shape), rtol=2e-3
    )
    agree |= np.isinf(picture.depth) & np.isinf(depth.reshape(picture.depth.shape))
    assert agree.mean() > 0.998  # rays and corners on the grid of 1/256 may part at silhouettes
    assert set(np.unique(picture.ids)) == {0, 1, 2, 3, 4}
    facing = (picture.normal * -rays).sum(-1)[np.isfinite(picture.depth)]
    assert (facing > -0.15).all()
    flat = picture.normal[picture.ids == 4]
    np.testing.assert_allclose(flat, np.broadcast_to([0, 0, 1], flat.shape), atol=0.01)


def test_a_plane_through_the_eye_s_height_is_cut_at_the_near_plane() -> None:
    ground = rectangle([-5000, -5000, 0], [10000, 0, 0], [0, 10000, 0])
    camera = Camera((0, 0, 1.7), (0, 10, 1.7), 50)
    picture = draw_truth(scene_of([Held(ground)]), camera, SIZE, TruthOptions(supersampling=2))
    below = np.arange(SIZE[1]) + 0.5 - SIZE[1] / 2
    assert (picture.alpha[below > 1] == 1).all()
    assert (picture.alpha[below < 0] == 0).all()
    rows = np.flatnonzero(below > 2)
    expected = 1.7 * camera.focal(SIZE) / (below[rows] + 0.25)
    np.testing.assert_allclose(picture.depth[rows, 40], expected, rtol=2e-3)


def test_light_sky_and_alpha() -> None:
    wall = rectangle([-1, 5, -1], [2, 0, 0], [0, 0, 2], Material(base_color=(0.5, 0.25, 0.125, 1)))
    lamp = rectangle([3, 5, -1], [2, 0, 0], [0, 0, 2], Material(base_color=(0.5, 0.25, 0.125, 1), unlit=True))
    camera = Camera((0, 0, 0), (0, 5, 0), 60)
    light = Light()
    picture = draw_truth(scene_of([Held(wall), Held(lamp)]), camera, SIZE, TruthOptions(supersampling=4, light=light))
    lambert = light.sun @ [0, -1, 0]
    middle = picture.color[SIZE[1] // 2, SIZE[0] // 2]
    np.testing.assert_allclose(middle, np.array([0.5, 0.25, 0.125]) * (0.3 + lambert), rtol=0.01)
    place = int(SIZE[0] / 2 + 4 / 5 * camera.focal(SIZE))
    np.testing.assert_allclose(picture.color[SIZE[1] // 2, place], [0.5, 0.25, 0.125], rtol=0.01)
    assert picture.pixels(light.sky_linear)[0, 0].tolist() == list(light.sky)
    assert picture.pixels(None)[0, 0].tolist()[3] == 0
    partly = (picture.alpha > 0) & (picture.alpha < 1)
    assert partly.any()
    row, column = np.argwhere(partly)[0]
    blended = (
        picture.alpha[row, column] * picture.color[row, column] + (1 - picture.alpha[row, column]) * light.sky_linear
    )
    expected = np.floor(srgb_from_linear(blended) * 255 + 0.5)
    np.testing.assert_allclose(picture.pixels(light.sky_linear)[row, column], expected, atol=1)


def test_cells_within_the_radius_are_left_out_exactly() -> None:
    grid = Grid(4.0, 64, (-40.0, -40.0, -4.0), (5, 5, 1))
    ground = rectangle([-40, -40, 0.0], [80, 0, 0], [0, 80, 0])
    hill = mesh_of(trimesh.creation.icosphere(4, radius=3.0))
    placements = [(0, np.eye(3, 4)), *((1, at(x, 10.0, 1.5)) for x in (-6, 2, 11))]
    eye = (1.0, -2.0, 30.0)
    left_out = LeftOut(grid, eye, 32.0)
    scene = scene_of([Held(ground), Held(hill)], placements)
    camera = Camera(eye, (1.0, -2.0, 0.0), 80)
    picture = draw_truth(scene, camera, SIZE, TruthOptions(supersampling=1, left_out=left_out))
    everything = draw_truth(scene, camera, SIZE, TruthOptions(supersampling=1))
    x, y = np.meshgrid(np.arange(SIZE[0]) + 0.5 - SIZE[0] / 2, np.arange(SIZE[1]) + 0.5 - SIZE[1] / 2)
    axes, focal = camera.axes, camera.focal(SIZE)
    point = (x[..., None] * axes[0] + y[..., None] * axes[1] + focal * axes[2]) * (everything.depth / focal)[
        ..., None
    ] + eye
    flat = np.abs(point[..., 2]) < 1e-3
    cells = grid.leaf_index(np.where(flat[..., None], point + [0, 0, 1e-4], 0))
    kept = left_out.keeps(cells)
    inner = np.abs((point - grid.corner) / 4 % 1 - 0.5)[..., :2].max(-1) < 0.49
    assert 300 < (flat & inner & kept).sum() < (flat & inner).sum() - 300
    np.testing.assert_array_equal(np.isfinite(picture.depth)[flat & inner], kept[flat & inner])


def test_meshes_that_cannot_be_loaded_are_counted() -> None:
    wall = faces([[-1, 5, -1], [1, 5, -1], [0, 5, 1]], [[0, 1, 2]])
    picture = draw_truth(
        scene_of([Broken(), Held(wall)]), Camera((0, 0, 0), (0, 5, 0)), SIZE, TruthOptions(supersampling=1)
    )
    assert picture.statistics.warnings == 1
    assert picture.statistics.triangles == 1
    assert picture.alpha.max() == 1
