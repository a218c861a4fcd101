"""Statues that leaves list as instances: they are seen as soon as a mesh is there, before and without all else."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from contextlib import AbstractContextManager
from functools import partial

import numpy as np
import pytest
from numpy.typing import NDArray
from playwright.sync_api import Browser

from bake.scenes import Held, ground
from e2e.browsing import Pixels, Visit, differing, visiting
from e2e.pushing import opened_with
from farfield.bake.bake import bake
from farfield.bake.options import BakeOptions
from farfield.scene.model import Instances, Material, Mesh, Scene, Texture
from farfield.scene.procedural.blobs import cube_sphere
from farfield.serve.run import ServeOptions, serving
from farfield.store import DirectoryStore
from farfield.world.index import InstancedMesh, MeshLevel
from farfield.world.world import World

LEAF = 8.0
SIDE = (3, 2)
"""Statues along x and y, each in the middle of a leaf."""
EYE, TARGET = (21.0, -9.0, 9.0), (12.0, 7.5, 0.5)
SETTINGS = {"supersampling": 2, "fade": 0, "sky": "rgb(40, 42, 46)"}
AFAR = 2.0
"""Near radius with which no statue is near: they are drawn in the place of pictures."""
NEAR = 1000.0
"""With which all are: in the place of their leaves' geometry."""
COLORS = ((0.9, 0.1, 0.1), (0.9, 0.4, 0.05), (0.8, 0.8, 0.1), (0.1, 0.8, 0.1), (0.1, 0.2, 0.9))
"""Of the statues; the last one has a texture of the next two."""
PAINT = ((20, 210, 220), (230, 40, 220))
HUES = (0, 31, 60, 120, 234, 183, 303)
"""Degrees, of the colours and the paint as they are seen."""

Body = tuple[tuple[float, float, float], tuple[float, float, float]]
BODIES: tuple[Body, ...] = (
    ((0.0, 0.0, 1.3), (0.45, 0.35, 1.3)),
    ((0.9, 0.0, 2.0), (0.9, 0.22, 0.28)),
    ((0.0, 0.8, 0.3), (0.3, 0.8, 0.3)),
)
"""Middle and radii of a statue's body, arm and foot: no two of its sides look the same."""


def statue(number: int) -> Mesh:
    """576 triangles, of the colour of that number or painted: above with the one, below with the other."""
    directions, faces = cube_sphere(4)
    stretched = 1 + 0.1 * number / len(COLORS)
    points = np.concatenate([np.array(middle) * stretched + directions * radii for middle, radii in BODIES])
    normals = np.concatenate([directions / radii for _, radii in BODIES])
    triangles = np.concatenate([faces + n * len(directions) for n in range(len(BODIES))])
    painted = number == len(COLORS)
    pixels = np.full((64, 64, 4), 255, np.uint8)
    pixels[:32, :, :3], pixels[32:, :, :3] = PAINT
    material = Material("paint", texture=Texture(pixels)) if painted else Material("stone", (*COLORS[number], 1.0))
    return Mesh(
        positions=points,
        triangles=triangles.astype(np.uint32),
        normals=(normals / np.linalg.norm(normals, axis=1, keepdims=True)).astype(np.float32),
        materials=(material,),
        triangle_material=np.zeros(len(triangles), np.uint16),
        uvs=np.column_stack([points[:, 0], 1 - points[:, 2] / points[:, 2].max()]).astype(np.float32),
    )


def placed(number: int) -> NDArray[np.float64]:
    """(3, 4): each turned another way, one mirrored, one stretched, one tilted."""
    angle = np.radians(25 + 67 * number)
    turn = np.array([[np.cos(angle), -np.sin(angle), 0], [np.sin(angle), np.cos(angle), 0], [0, 0, 1.0]])
    shape = {1: np.diag([-1.0, 1.0, 1.0]), 3: np.diag([1.2, 0.9, 1.1])}.get(number, np.eye(3))
    if number == 4:
        shape = np.array([[1, 0, 0], [0, np.cos(0.4), -np.sin(0.4)], [0, np.sin(0.4), np.cos(0.4)]])
    x, y = number % SIDE[0], number // SIDE[0]
    return np.column_stack([turn @ shape, [(x + 0.5) * LEAF, (y + 0.5) * LEAF, 0.4]])


def garden() -> Scene:
    """Ground, and six statues, each a mesh of its own."""
    count = SIDE[0] * SIDE[1]
    meshes = [ground(0.5, 23.5, color=(0.3, 0.3, 0.3)), *(statue(n) for n in range(count))]
    transform = np.stack([np.eye(3, 4), *(placed(n) for n in range(count))])
    every = np.arange(len(meshes))
    instances = Instances(every.astype(np.int32), transform, every + 1, np.ones_like(every))
    return Scene([Held(mesh, f"mesh {n}") for n, mesh in enumerate(meshes)], instances, object_count=len(meshes))


@pytest.fixture(scope="module")
def statues(tmp_path_factory: pytest.TempPathFactory) -> DirectoryStore:
    """The garden, baked."""
    store = DirectoryStore(tmp_path_factory.mktemp("instances") / "garden")
    grid = {"leaf_size": LEAF, "resolution": 64, "corner": (0.0, 0.0, -LEAF / 2)}
    bake(garden(), store, BakeOptions(**grid, directions="9", workers=2))  # type: ignore[arg-type]
    return store


@pytest.fixture(scope="module")
def listed(statues: DirectoryStore) -> list[InstancedMesh]:
    """What the index tells of them."""
    return [mesh for entry in World.open(statues).cells() for mesh in entry.instances]


@pytest.fixture(scope="module")
def server(statues: DirectoryStore) -> Iterator[str]:
    """Where the garden is served."""
    with serving(statues, ServeOptions(port=0)) as url:
        yield url


Opened = Callable[..., AbstractContextManager[Visit]]


@pytest.fixture
def opened(browser: Browser, server: str) -> Opened:
    """Opens a page of the garden; see `opened_with`."""
    return partial(opened_with, browser, server)


def values_of(store: DirectoryStore, levels: list[MeshLevel]) -> dict[str, bytes]:
    """The images of some meshes and, behind them, the meshes."""
    images = [f"texture/{name}" for level in levels for name, _ in level.textures]
    return {key: store.get(key) for key in [*images, *(f"mesh/{level.hash}" for level in levels)]}


def kinds(picture: Pixels) -> NDArray[np.int64]:
    """(480, 640) number of the colour that is seen there, -1 where it is none of the statues'."""
    rgb = picture.astype(np.float64) / 255
    most, least = rgb.max(-1), rgb.min(-1)
    spread = np.maximum(most - least, 1e-9)
    red, green, blue = rgb[..., 0], rgb[..., 1], rgb[..., 2]
    hue = np.select(
        [most == red, most == green],
        [(green - blue) / spread % 6, (blue - red) / spread + 2],
        (red - green) / spread + 4,
    )
    apart = np.abs((60 * hue[..., None] - np.array(HUES) + 180) % 360 - 180)
    is_colored = (spread > 0.6 * most) & (most > 0.1)
    return np.where(is_colored, apart.argmin(-1), -1)


def box_of(mask: NDArray[np.bool_]) -> NDArray[np.int64]:
    """(4,) first and last row and column."""
    rows, columns = np.flatnonzero(mask.any(1)), np.flatnonzero(mask.any(0))
    return np.array([rows[0], rows[-1], columns[0], columns[-1]])


def overlap(one: NDArray[np.bool_], other: NDArray[np.bool_]) -> float:
    """What both have of what either has."""
    return float((one & other).sum() / (one | other).sum())


@pytest.fixture(scope="module")
def whole(browser: Browser, server: str) -> Pixels:
    """The picture when everything is there, as geometry."""
    with visiting(browser, server) as page:
        page.options(**SETTINGS, nearRadius=NEAR)
        page.look(EYE, TARGET)
        return page.picture()


def test_a_garden_lists_each_statue_once(listed: list[InstancedMesh]) -> None:
    assert len(listed) == len({mesh.levels[0].hash for mesh in listed}) == SIDE[0] * SIDE[1]
    assert all(len(mesh.objects) == 1 and len(mesh.levels) > 1 for mesh in listed)
    assert sum(bool(mesh.levels[-1].textures) for mesh in listed) == 1


@pytest.mark.parametrize("near", [AFAR, NEAR])
@pytest.mark.parametrize("level", [-1, 0])
def test_statues_are_seen_by_their_meshes_alone(
    opened: Opened, statues: DirectoryStore, listed: list[InstancedMesh], whole: Pixels, near: float, level: int
) -> None:
    levels = [mesh.levels[level] for mesh in listed]
    values = values_of(statues, levels)
    with opened(set(values), values) as page:
        page.options(**SETTINGS, nearRadius=near)
        page.look(EYE, TARGET)
        page.page.wait_for_function(f"farfield.stats().triangles === {sum(one.triangles for one in levels)}")
        # On a busy machine the image of one is decoded a little later.
        page.quiet()
        stats, picture = page.stats(), page.picture()
    assert stats["splats"] == stats["geometry_cells"] == 0
    assert stats["pushed_bytes"] > 0
    shown, true = kinds(picture), kinds(whole)
    for number in range(len(listed)):
        own, full = (np.minimum(one, len(COLORS)) == number for one in (shown, true))
        assert full.sum() > 1000
        assert np.abs(box_of(own) - box_of(full)).max() <= (3 if level else 1), number
        assert overlap(own, full) > (0.78 if level else 0.93), number
    both = (shown == true) & (true >= 0)
    # Lit as they are in their leaves, the mirrored one too: flat faces of 36 triangles differ.
    assert np.abs(picture[both].astype(int) - whole[both]).mean() < (15 if level else 0.5)


def test_statues_stay_while_they_are_drawn_however_small_the_cache(
    opened: Opened, statues: DirectoryStore, listed: list[InstancedMesh]
) -> None:
    levels = [mesh.levels[-1] for mesh in listed]
    values = values_of(statues, levels)
    triangles = sum(one.triangles for one in levels)
    with opened(set(values), values) as page:
        page.options(**SETTINGS, nearRadius=AFAR)
        page.look(EYE, TARGET)
        page.page.wait_for_function(f"farfield.stats().triangles === {triangles}")
        page.options(cacheBytes=1)
        page.look((21.0, -9.5, 9.0), TARGET)
        assert page.stats()["triangles"] == triangles


def test_statues_give_way_to_their_leaves(
    opened: Opened, statues: DirectoryStore, listed: list[InstancedMesh], whole: Pixels
) -> None:
    values = values_of(statues, [mesh.levels[-1] for mesh in listed])
    with opened(set(statues.list()), values) as page:
        page.options(**SETTINGS, nearRadius=NEAR)
        page.look(EYE, TARGET)
        page.quiet()
        # Two of the ground in each of nine leaves.
        assert page.stats()["triangles"] == sum(mesh.levels[0].triangles for mesh in listed) + 18
        assert differing(page.picture(), whole) < 1e-4
        page.options(nearRadius=AFAR, farGeometry=False)
        page.complete()
        assert page.stats()["triangles"] == 0
        assert page.stats()["splats"] > 1000


@pytest.mark.parametrize("near", [AFAR, NEAR])
def test_who_is_sent_nothing_asks_for_meshes(
    opened: Opened, statues: DirectoryStore, listed: list[InstancedMesh], whole: Pixels, near: float
) -> None:
    values = values_of(statues, [level for mesh in listed for level in mesh.levels])
    with opened(set(values), {}, "?sessions=0") as page:
        page.options(**SETTINGS, nearRadius=near)
        page.do("camera => farfield.setCamera(camera)", {"eye": EYE, "target": TARGET, "fov": 46.8})
        keys = [[f"mesh/{level.hash}" for level in mesh.levels] for mesh in listed]
        page.page.wait_for_function("all => all.every(one => one.some(key => farfield.world.holds(key)))", arg=keys)
        page.page.wait_for_timeout(1000)
        asked = {key for key in page.fetched if key.startswith("mesh/")}
        shown, true = kinds(page.picture()), kinds(whole)
    for number, mesh in enumerate(listed):
        assert asked & {f"mesh/{level.hash}" for level in mesh.levels}
        own, full = (np.minimum(one, len(COLORS)) == number for one in (shown, true))
        assert overlap(own, full) > 0.7, number
