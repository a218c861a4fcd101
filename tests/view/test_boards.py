"""Instances that are drawn by boards: where their pixels are, and when they are drawn in place of meshes."""

from __future__ import annotations

import io
from dataclasses import replace

import msgspec
import numpy as np
import pytest
from PIL import Image

from bake.scenes import Held, ground, quad_mesh
from farfield.bake.bake import bake
from farfield.bake.options import BakeOptions
from farfield.geometry.cameras import Camera
from farfield.octree.grid import CellKey
from farfield.scene.model import Instances, Material, Mesh, Scene, Texture
from farfield.store import MemoryStore
from farfield.stream.tree import CellTree
from farfield.view.kinds import Kinds
from farfield.view.picture import Picture
from farfield.view.renderer import RenderOptions, render_world
from farfield.world.index import CellEntry, Impostor, InstancedMesh, MeshLevel
from farfield.world.keys import content_hash, texture_key
from farfield.world.world import World

SIZE, FOCAL = (160, 120), 60 / np.tan(np.radians(30))
RED, GREEN, BLUE = (230, 20, 20), (20, 220, 20), (30, 40, 230)
TURN = np.radians(30)
PLACES = {
    "still": np.eye(3),
    "turned": np.array([[np.cos(TURN), -np.sin(TURN), 0], [np.sin(TURN), np.cos(TURN), 0], [0, 0, 1]]),
    "mirrored and stretched": np.diag([1.5, -1.2, 0.8]) @ np.array([[0.6, -0.8, 0], [0.8, 0.6, 0], [0, 0, 1]]),
}
AT, AWAY = (8.0, 8.0, 1.0), 5.0
CUTS = 8
"""Of the panel along its sides: meshes of 96 triangles and more are listed."""


def sign() -> np.ndarray:
    """(16, 24, 4) red on the left, blue on the right, green at the top, a hole at the lower right."""
    pixels = np.zeros((16, 24, 4), np.uint8)
    pixels[:, :12], pixels[:, 12:], pixels[:4] = (*RED, 255), (*BLUE, 255), (*GREEN, 255)
    pixels[12:, 18:, 3] = 0
    return pixels


def panel() -> Mesh:
    """3 m wide and 2 m high across x; from +x one sees the sign on it, from -x its mirror image."""
    across, up = np.meshgrid(np.arange(CUTS) / CUTS, np.arange(CUTS) / CUTS)
    steps = np.array([[0, 0], [1, 0], [1, 1], [0, 1]]) / CUTS
    at = np.stack([across.ravel(), up.ravel()], axis=1)[:, None] + steps
    corners = np.stack([np.zeros(at.shape[:2]), 3 * at[..., 0] - 1.5, 2 * at[..., 1]], axis=2)
    mesh = quad_mesh(corners, Material("sign", texture=Texture(sign()), alpha_cutoff=0.5))
    uvs = np.stack([at[..., 0], 1 - at[..., 1]], axis=2).reshape(-1, 2).astype(np.float32)
    return replace(mesh, uvs=uvs, triangle_object=None, object_count=1)


def encoded(pixels: np.ndarray) -> bytes:
    out = io.BytesIO()
    Image.fromarray(pixels).save(out, "WEBP", lossless=True, exact=True)
    return out.getvalue()


class WithBoards(World):
    """A world whose index lists these impostors of what has a texture."""

    impostors: tuple[Impostor, ...] = ()
    levels: tuple[MeshLevel, ...] = ()
    """In place of its own."""

    def entry(self, key: CellKey) -> CellEntry:
        entry = super().entry(key)
        return msgspec.structs.replace(entry, instances=tuple(map(self._changed, entry.instances)))

    def _changed(self, listed: InstancedMesh) -> InstancedMesh:
        if not listed.levels[0].textures:
            return listed
        return msgspec.structs.replace(listed, impostors=self.impostors, levels=self.levels or listed.levels)


IMAGES = {side: encoded(sign()[:, ::-1] if side == 2 else sign()) for side in (0, 2)}
HASHES = {side: content_hash(data) for side, data in IMAGES.items()}
BOARDS = {side: texture_key(name) for side, name in HASHES.items()}
SIDES = tuple((HASHES.get(side, "0" * 15 + str(side)), 100) for side in range(4))


def baked(place: str) -> WithBoards:
    store = MemoryStore()
    transform = np.stack([np.column_stack([PLACES[place], AT]), np.eye(3, 4)])
    meshes = [panel(), ground(0.0, 16.0)]
    every = np.arange(2)
    instances = Instances(every.astype(np.int32), transform, every + 7, np.ones(2, np.int64))
    scene = Scene([Held(mesh, str(n)) for n, mesh in enumerate(meshes)], instances, object_count=8)
    bake(scene, store, BakeOptions(leaf_size=16.0, resolution=64, directions="5", workers=1))
    for side, data in IMAGES.items():
        store.put(BOARDS[side], data)
    world = WithBoards.open(store)
    world.impostors = (Impostor(16, SIDES),)
    return world


@pytest.fixture(scope="module", params=PLACES)
def world(request: pytest.FixtureRequest) -> WithBoards:
    return baked(request.param)


@pytest.fixture(scope="module")
def still() -> WithBoards:
    return baked("still")


def eye_of(world: WithBoards, towards: tuple[float, float, float]) -> np.ndarray:
    """(3,) AWAY before the middle of the panel, in a direction of the mesh's frame."""
    matrix, at = np.array(instance(world).transforms[0]).reshape(3, 4)[:, :3], np.array(AT)
    along = matrix @ towards
    return np.asarray(at + matrix @ [0, 0, 1] + AWAY * along / np.linalg.norm(along))


def instance(world: WithBoards) -> InstancedMesh:
    """What the index lists of the panel."""
    return next(one for entry in world.cells() for one in entry.instances if one.impostors)


def drawn(world: WithBoards, eye: np.ndarray, held: set[str]) -> Picture:
    target = np.array(AT) + [0, 0, 1]
    camera = Camera((eye[0], eye[1], eye[2]), (target[0], target[1], target[2]), 60.0)
    return render_world(world, camera, SIZE, RenderOptions(supersampling=2, held=held, ids=True))


def mesh_keys(world: WithBoards) -> set[str]:
    level = instance(world).levels[0]
    return {f"mesh/{level.hash}", *(texture_key(name) for name, _ in level.textures)}


def kinds_of(picture: Picture) -> np.ndarray:
    """(h, w) 0 red, 1 green, 2 blue; -1 where the panel does not cover a pixel whole."""
    return np.where(picture.alpha > 0.99, picture.color.argmax(axis=2), -1)


@pytest.mark.parametrize("towards", [(1, 0, 0), (-1, 0, 0), (1, 0.4, 0.2), (-1, 0.3, 0.4)])
def test_a_board_stands_where_its_mesh_does(world: WithBoards, towards: tuple[float, float, float]) -> None:
    eye = eye_of(world, towards)
    mesh, board = (drawn(world, eye, held) for held in (mesh_keys(world), set(BOARDS.values())))
    assert (mesh.statistics.triangles, board.statistics.triangles) == (2 * CUTS**2, 2)
    assert board.statistics.warnings == 0
    true, found = kinds_of(mesh), kinds_of(board)
    assert np.mean((true >= 0)[found >= 0]) > 0.99
    for kind in range(3):
        assert (true == kind).sum() > 400
        # Where two colours meet in a texel, their light decides, and that is another.
        assert (found == kind)[true == kind].mean() > 0.93
    assert np.mean((found == true)[true >= 0]) > 0.97
    assert np.allclose(mesh.depth[true >= 0], board.depth[true >= 0], rtol=1e-3)
    assert mesh.ids is not None
    assert board.ids is not None
    assert np.array_equal(np.unique(mesh.ids), np.unique(board.ids))


@pytest.mark.parametrize(("side", "left"), [(0, 0), (2, 2)])
def test_the_sign_is_upright_and_not_mirrored(still: WithBoards, side: int, left: int) -> None:
    """By hand: from +x red is on the left, from -x on the right; green is at the top from both."""
    found = kinds_of(drawn(still, eye_of(still, (1 - side, 0, 0)), set(BOARDS.values())))
    rows, columns = np.nonzero(found >= 0)
    top, bottom, first, last = rows.min(), rows.max(), columns.min(), columns.max()
    # 2 m and 3 m.
    assert abs(bottom + 1 - top - FOCAL * 2 / AWAY) <= 2
    assert abs(last + 1 - first - FOCAL * 3 / AWAY) <= 2
    assert (found[top + 1, first + 1 : last] == 1).all()
    middle = (top + bottom) // 2
    assert found[middle, first + 2] == left
    assert found[middle, last - 2] == 2 - left
    assert found[bottom - 2, last - 2 if side == 0 else first + 2] == -1


FINE, COARSE = MeshLevel("aa" * 8, 1, 9), MeshLevel("bb" * 8, 1, 2, errors=(102, 102, 102))
"""Levels, the second of which shows .6."""
BOARD = (76, 76, 76)
"""Errors of boards that show .702 head on."""


def chosen(still: WithBoards, azimuth: float, held: set[str], *impostors: Impostor, is_near: bool = True) -> str:
    """Key of what the panel is drawn by, seen from there (degrees), of FINE, COARSE and boards; none: nothing."""
    world = WithBoards(still.store, still.manifest)
    world.impostors, world.levels = impostors, (FINE, COARSE)
    (cell,) = (entry.cell for entry in world.cells() if any(one.impostors for one in entry.instances))
    turn = np.radians(azimuth)
    kinds = Kinds(world, eye_of(still, (np.cos(turn), np.sin(turn), 0)), FOCAL, 10.0)
    found = kinds.instances_of(cell, {name for key in held for name in (f"mesh/{key}", f"texture/{key}")}, is_near)
    assert len(found) < 2
    return found[0].key.split("/")[1] if found else ""


def images(letter: str, count: int = 4) -> tuple[tuple[str, int], ...]:
    return tuple((letter * 15 + str(side), 1) for side in range(count))


def keys(*listed: tuple[tuple[str, int], ...]) -> set[str]:
    return {name for own in listed for name, _ in own}


def test_what_shows_most_is_drawn(still: WithBoards) -> None:
    fine, coarse = images("f"), images("c")
    two = Impostor(96, fine, BOARD), Impostor(12, coarse, (*BOARD[:2], 90))
    level, boards = {COARSE.hash}, keys(fine)
    # At 45 degrees a board shows .702 (sin 45 / sin 60)^3 = .38; behind 60 degrees it is as good as head on.
    assert [chosen(still, azimuth, level | boards, two[0]) for azimuth in (0, 29, 45, 61, 90, 181)] == [
        fine[0][0], fine[0][0], COARSE.hash, fine[1][0], fine[1][0], fine[2][0],
    ]  # fmt: skip
    # Level and board show the same: the full mesh, and all there is.
    assert chosen(still, 0, {FINE.hash} | boards, Impostor(96, fine)) == FINE.hash
    assert chosen(still, 0, {FINE.hash} | level | boards, two[0]) == FINE.hash
    # The finer rows, when they show no less.
    assert chosen(still, 0, boards | keys(coarse), Impostor(96, fine, BOARD), Impostor(12, coarse, BOARD)) == fine[0][0]
    assert chosen(still, 0, boards | keys(coarse), Impostor(96, fine, BOARD), Impostor(12, coarse)) == coarse[0][0]
    assert chosen(still, 181, keys(fine[:2], coarse[2:3]), *two) == coarse[2][0]
    # 20 and 25 degrees from head on show the same: the one that is seen more squarely.
    assert chosen(still, 25, keys(images("e", 8)), Impostor(96, images("e", 8))) == "e" * 15 + "1"


def test_boards_that_show_nothing_are_not_drawn(still: WithBoards) -> None:
    boards = images("f")
    assert chosen(still, 45, keys(boards[2:]), Impostor(96, boards)) == ""
    assert chosen(still, 0, keys(boards), Impostor(96, boards, (255, 255, 255))) == ""
    assert chosen(still, 1, keys(boards[1:2]), Impostor(96, boards)) == boards[1][0]
    above = drawn(still, eye_of(still, (0, 0, 1)) + [0.01, 0, 0], set(BOARDS.values()) - {BOARDS[0]})
    assert above.statistics.triangles == 0


def test_boards_are_drawn_near_and_far(still: WithBoards, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(CellTree, "may_be_afar", lambda *_: False)
    boards = images("f")
    for is_near in (True, False):
        assert chosen(still, 0, keys(boards), Impostor(96, boards), is_near=is_near) == boards[0][0]
        own = chosen(still, 0, {COARSE.hash}, Impostor(96, boards), is_near=is_near)
        assert own == (COARSE.hash if is_near else "")


def test_an_image_that_cannot_be_read_is_warned_of(still: WithBoards) -> None:
    store = MemoryStore()
    for key in still.store.list():
        store.put(key, still.store.get(key) if key != BOARDS[0] else b"no image")
    world = WithBoards(store, still.manifest)
    world.impostors = still.impostors
    found = drawn(world, eye_of(still, (1, 0, 0)), {BOARDS[0]})
    assert (found.statistics.warnings, found.statistics.triangles) == (1, 0)
