"""What is clicked: the object under a pixel, near and far, however it is drawn, and what is known of it."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import pyogrio
import pytest
import shapely
from numpy.typing import NDArray

from e2e.browsing import Visit
from farfield.bake.bake import bake
from farfield.bake.options import BakeOptions
from farfield.geometry.cameras import Camera
from farfield.scene.read import read_scene
from farfield.serve.run import ServeOptions, serving
from farfield.store import DirectoryStore
from farfield.view.renderer import RenderOptions, render_world
from farfield.world.world import World
from scene.test_footprints import AT, CRS

SIZE = (640, 480)
SIDE, GAP = 12.0, 8.0
"""Metres: of the houses and between them."""
MANY = 6
"""Houses in a row, and rows."""
EYE, TARGET = (-26.0, -30.0, 34.0), (40.0, 40.0, 0.0)
NEAR = {"nearRadius": 1e4}
FAR = {"nearRadius": 0, "farGeometry": False}
BOTH = {"supersampling": 2, "fade": 0, "benefit": True}
PICK = """places => Promise.all(places.map(([x, y]) => farfield.pick(x, y)))"""

Ids = NDArray[np.uint32]


def height_of(house: int) -> float:
    return 6.0 + house * 5 % 14


def streets(folder: Path) -> Path:
    """Houses in rows on flat ground, with a number, a name and, some of them, a use."""
    places = [(SIDE + GAP) * np.array([n % MANY, n // MANY]) + AT for n in range(MANY**2)]
    shapes = [shapely.box(x, y, x + SIDE, y + SIDE) for x, y in places]
    columns: dict[str, list[Any]] = {
        "height": [height_of(n) for n in range(len(shapes))],
        "number": list(range(len(shapes))),
        "name": [f"House {n}" for n in range(len(shapes))],
        "use": ["shop" if n % 3 == 0 else None for n in range(len(shapes))],
    }
    arrays = [np.array(column, object if type(column[0]) is str else None) for column in columns.values()]
    path = folder / "houses.geojson"
    pyogrio.raw.write(path, shapely.to_wkb(np.array(shapes, object)), arrays, list(columns), driver="GeoJSON", crs=CRS,
                      geometry_type="Polygon")  # fmt: skip
    return path


@dataclass(frozen=True)
class Served:
    """A world and where it is served."""

    world: World
    address: str
    shift: NDArray[np.float64]
    """Local metres of the corner of the first house."""

    def ids(self, camera: Camera, **options: Any) -> Ids:
        """(480, 640) uint32 of the reference renderer."""
        found = render_world(self.world, camera, SIZE, RenderOptions(supersampling=2, ids=True, **options)).ids
        assert found is not None
        return found


@contextmanager
def served(folder: Path, options: BakeOptions) -> Iterator[Served]:
    store = DirectoryStore(folder / "world")
    bake(read_scene([streets(folder)]), store, options)
    world = World.open(store)
    with serving(store, ServeOptions(port=0)) as url:
        yield Served(world, url, np.array([*AT, 0.0]) - world.manifest.origin)


@pytest.fixture(scope="module")
def pictured(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Served]:
    """Houses with orthoviews."""
    options = BakeOptions(leaf_size=32.0, resolution=64, directions="17", workers=2)
    with served(tmp_path_factory.mktemp("pictured"), options) as found:
        yield found


@pytest.fixture(scope="module")
def mapped(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Served]:
    """The same with BlockMaps."""
    options = BakeOptions(leaf_size=32.0, orthoviews=False, blockmap="32:192", resolution=32, workers=2)
    with served(tmp_path_factory.mktemp("mapped"), options) as found:
        yield found


def opened(served: Served, visit: Callable[..., Visit], **options: Any) -> tuple[Visit, Camera]:
    """The page on the houses, complete; and its camera."""
    page = visit(served.address + "?sessions=0")
    page.options(**BOTH, **options)
    camera = Camera(tuple(served.shift + EYE), tuple(served.shift + TARGET), 46.8)
    page.look(camera.eye, camera.target)
    return page, camera


def picked(page: Visit, places: list[tuple[float, float]]) -> list[dict[str, Any] | None]:
    found: list[dict[str, Any] | None] = page.do(PICK, places)
    return found


def scattered(count: int = 150) -> list[tuple[float, float]]:
    """Middles of pixels all over the picture."""
    pixels = np.random.default_rng(5).integers(0, SIZE, (count, 2))
    return [(float(x) + 0.5, float(y) + 0.5) for x, y in pixels]


def at(ids: Ids, places: list[tuple[float, float]]) -> Ids:
    return ids[[int(y) for _, y in places], [int(x) for x, _ in places]]


def project(camera: Camera, point: NDArray[np.float64]) -> tuple[float, float]:
    """The middle of the pixel that a point is seen in."""
    eye, target = np.array(camera.eye), np.array(camera.target)
    ahead = (target - eye) / np.linalg.norm(target - eye)
    right = np.cross(ahead, (0, 0, 1))
    right /= np.linalg.norm(right)
    c = point - eye
    scale = SIZE[1] / 2 / np.tan(np.radians(camera.fov / 2)) / (c @ ahead)
    x, y = SIZE[0] / 2 + scale * (c @ right), SIZE[1] / 2 - scale * (c @ np.cross(right, ahead))
    return float(np.floor(x)) + 0.5, float(np.floor(y)) + 0.5


def like(found: list[dict[str, Any] | None], right: Ids) -> float:
    """Share of places that have the same object, of those where the reference renderer shows one."""
    pairs = [((one or {}).get("id"), id_) for one, id_ in zip(found, right.tolist(), strict=True)]
    return float(np.mean([one == id_ for one, id_ in pairs if id_]))


KINDS = [
    ("pictured", NEAR, "geometry"),
    ("pictured", FAR, "orthoview"),
    ("mapped", NEAR, "geometry"),
    ("mapped", FAR, "blockmap"),
]


@pytest.mark.parametrize(("kind", "how", "by"), KINDS)
def test_is_the_object_that_the_reference_renderer_shows(
    request: pytest.FixtureRequest, visit: Callable[..., Visit], kind: str, how: dict[str, Any], by: str
) -> None:
    served: Served = request.getfixturevalue(kind)
    page, camera = opened(served, visit, **how)
    places = scattered()
    found = picked(page, places)
    right = at(served.ids(camera, near_radius=how["nearRadius"], far_geometry=False), places)
    there = [one for one in found if one]
    assert 40 < len(there) < len(found)
    assert {one["by"] for one in there} == {by}
    assert like(found, right) >= (0.99 if by == "geometry" else 0.97)
    # Second layers of pictures have no ids; the page finds those of the first layers of other views there.
    assert np.mean([one["id"] is not None for one in there]) >= 0.97
    for one in there:
        if one["id"] is not None:
            assert one["attributes"]["name"] == f"House {one['attributes']['number']}"
    assert page.stats()["tiles_missing"] == 0


@pytest.mark.parametrize(("kind", "how", "by"), KINDS)
def test_walls_and_roofs_are_those_of_their_house(
    request: pytest.FixtureRequest, visit: Callable[..., Visit], kind: str, how: dict[str, Any], by: str
) -> None:
    served: Served = request.getfixturevalue(kind)
    page, camera = opened(served, visit, **how)
    found = []
    for house in (0, 1, MANY):
        corner = served.shift + [(SIDE + GAP) * (house % MANY), (SIDE + GAP) * (house // MANY), 0.0]
        height = height_of(house)
        points = {
            "roof": corner + [SIDE / 2, SIDE / 2, height],
            "wall": corner + [0.0, SIDE / 2, height / 2],
            "other wall": corner + [SIDE / 2, 0.0, height / 2],
        }
        for name, point in points.items():
            (one,) = picked(page, [project(camera, point)])
            assert one is not None, (house, name)
            expected = {
                "height": height,
                "number": house,
                "name": f"House {house}",
                **({"use": "shop"} if house % 3 == 0 else {}),
            }
            assert one["attributes"] == expected, (house, name)
            assert np.linalg.norm(np.array(one["position"]) - point) < 1.5, (house, name)
            found.append(one["id"])
    assert found == np.repeat(found[::3], 3).tolist()


def test_sky_is_nothing(pictured: Served, visit: Callable[..., Visit]) -> None:
    page, _ = opened(pictured, visit, **FAR)
    assert picked(page, [(3, 3), (-1, 5), (640, 100), (5, 480)]) == [None] * 4


@pytest.mark.parametrize("how", [NEAR, FAR])
def test_instances_have_ids_and_worlds_without_attributes_none(
    world: DirectoryStore, address: str, visit: Callable[..., Visit], how: dict[str, Any]
) -> None:
    page = visit(address + "?sessions=0")
    page.options(**BOTH, **how)
    camera = Camera((-30.0, -32.0, 24.0), (0.0, 0.0, 2.0), 46.8)
    page.look(camera.eye, camera.target)
    places = scattered()
    found = picked(page, places)
    options = RenderOptions(supersampling=2, ids=True, near_radius=how["nearRadius"], far_geometry=False)
    ids = render_world(World.open(world), camera, SIZE, options).ids
    assert ids is not None
    right = at(ids, places)
    assert len({one["id"] for one in found if one}) > 10
    assert like(found, right) >= 0.93
    assert all(one["attributes"] == {} for one in found if one)


def test_a_click_opens_a_card_that_escape_closes(pictured: Served, visit: Callable[..., Visit]) -> None:
    page, camera = opened(pictured, visit, **FAR)
    roof = pictured.shift + [SIDE / 2, SIDE / 2, height_of(0)]
    x, y = project(camera, roof)
    card = page.page.locator("#picked")
    assert not card.is_visible()
    page.page.mouse.click(x, y)
    card.wait_for(state="visible")
    page.says("House 0")
    assert card.get_by_role("row", name="use shop").inner_text().split() == ["use", "shop"]
    assert page.page.locator("#marker").is_visible()
    page.page.keyboard.press("Escape")
    card.wait_for(state="hidden")
    assert not page.page.locator("#marker").is_visible()
    # A drag asks nothing.
    page.page.mouse.move(x, y)
    page.page.mouse.down()
    page.page.mouse.move(x + 30, y, steps=3)
    page.page.mouse.up()
    page.page.wait_for_timeout(500)
    assert not card.is_visible()
    # The keyboard asks about the middle, and goes on in the card.
    page.look(tuple(roof + (-1.0, -1.0, 30.0)), tuple(roof))
    page.page.locator("#picture").focus()
    page.page.keyboard.press("Enter")
    page.says("House 0")
    assert page.do("document.activeElement.id") == "picked"
    page.page.get_by_role("button", name="Close").click()
    card.wait_for(state="hidden")
    assert page.do("document.activeElement.id") == "picture"
    # A click on nothing closes it.
    page.page.mouse.click(320, 240)
    card.wait_for(state="visible")
    page.look(camera.eye, camera.target)
    page.page.mouse.click(340, 3)
    card.wait_for(state="hidden")
