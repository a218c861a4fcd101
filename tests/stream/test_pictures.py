"""Cells as things to send: which are made out, what shows which, and what is taken to be there."""

from __future__ import annotations

from dataclasses import replace

import msgspec
import numpy as np
import pytest

from farfield.octree.cut import cut
from farfield.octree.grid import CellKey
from farfield.represent.geometry.board import FULL_SINE, directions, dynamic_angle
from farfield.stream import boards, geometry
from farfield.stream.geometry import FINE, MORE
from farfield.stream.link import Link
from farfield.stream.motion import MotionPredictor, Viewing
from farfield.stream.offers import SHARES, Offers
from farfield.stream.outlook import look
from farfield.stream.pictures import SHARP, Pictures, SentCell
from farfield.stream.regions import OBJECTS, Regions, Shape
from farfield.stream.scheduler import Scheduler
from farfield.stream.tree import CellTree
from farfield.world.index import MESH_FARTHEST
from farfield.world.keys import DynamicImpostor
from stream.cells import BOARDS, GEOMETRY_BYTES, GRID, SHARED, STATUE, TILE_BYTES, flat_tree
from stream.test_motion import viewing

FAR = 200.0
TREE = flat_tree()


class Keys:
    """The same tree for `cut`."""

    def __init__(self, tree: CellTree) -> None:
        self._entries = {entry.cell: entry for entry in tree.entries}
        self.roots = [tree.entries[number].cell for number in tree.roots]

    def children(self, key: CellKey) -> list[CellKey]:
        return [CellKey.parse(child) for child in self._entries[key].children]


def seen_from(eye: tuple[float, float, float], velocity: tuple[float, float, float] = (0, 0, 0)) -> Viewing:
    forward = np.array([0.0, 1.0, 0.0])
    return Viewing(0.0, np.array(eye, float), forward, 60.0, (100, 100), velocity=np.array(velocity, float))


def regions_of(seen: Viewing, shape: Shape | None = None) -> Regions:
    regions = Regions(TREE, shape)
    regions.boxes(MotionPredictor().follow(seen), 60.0)
    return regions


@pytest.mark.parametrize("near", [0.0, 10.0, None])
@pytest.mark.parametrize("eye", [(-5.0, -5.0, 2.0), (20.0, 20.0, 2.0), (-300.0, 0.0, 50.0)])
def test_who_stands_sees_the_cut(eye: tuple[float, float, float], near: float | None) -> None:
    regions = regions_of(seen_from(eye), Shape(near))
    shown = cut(Keys(TREE), GRID, np.array(eye), regions.radius, regions.near)
    assert {TREE.entries[n].cell for n in regions.cells} == {*shown.pictures, *shown.geometry}


def test_who_moves_sees_what_is_fine_enough_on_the_way_and_everything_once() -> None:
    still, moving = regions_of(seen_from((-300, 30, 20))), regions_of(seen_from((-300, 30, 20), (50, 0, 0)))
    assert len(moving.cells) > len(still.cells)
    sizes = TREE.boxes[moving.cells, 3:5] - TREE.boxes[moving.cells, :2]
    assert sizes.prod(axis=1).sum() == 64.0**2


def offers_of(pictures: Pictures, regions: Regions, seen: Viewing) -> tuple[Offers, np.ndarray]:
    prediction = MotionPredictor().follow(seen)
    outlook = look(prediction, regions.boxes(prediction, 60.0), 0.0, FAR)
    offers = pictures.offers(outlook)
    best = np.zeros((*outlook.visible.shape, len(SHARES)), np.float32)
    pictures.shown(outlook, best)
    return offers, best


def test_what_is_offered_and_shown() -> None:
    seen, regions = seen_from((32.0, -30.0, 10.0)), Regions(TREE, Shape(near=12.0))
    pictures = Pictures(regions)
    offers, best = offers_of(pictures, regions, seen)
    assert not best.any()
    items = [pictures.take(n) for n in range(len(offers.sizes))]
    first, root = (n for n, item in enumerate(items) if item.cell == "3/0/0/0")
    # Two of the three tiles are worth their bytes, and all that is seen is below the root.
    assert offers.sizes[[first, root]].tolist() == [TILE_BYTES, 2 * TILE_BYTES]
    assert 0 < offers.parts[first] < offers.parts[root] == len(SHARES)
    assert offers.series[first] == offers.series[root]
    assert len(items[first].keys) == len(items[root].keys) == 1
    visible = {int(n) for n in offers.objects}
    assert {int(n) for n in offers.objects[offers.uses(root)]} == visible
    assert not any(item.is_geometry for item in items)
    # The finer, the more accurate; nothing is offered twice.
    finest = np.zeros(len(regions.cells))
    for n in range(len(items)):
        own = offers.objects[offers.uses(n)]
        finest[own] = np.maximum(finest[own], offers.accuracy[offers.uses(n), 0] * (offers.parts[n] == len(SHARES)))
    assert (finest[list(visible)] > offers.accuracy[offers.uses(root), 0].max()).any()
    again, best = offers_of(pictures, regions, seen)
    assert len(again.sizes) == 0
    assert (best[list(visible), 0] == finest[list(visible), None].astype(np.float32)).all()


def test_geometry_of_near_leaves_with_the_meshes_it_places() -> None:
    seen, regions = seen_from((32.0, 1.0, 2.0)), Regions(TREE, Shape(near=12.0, far_geometry=False))
    pictures = Pictures(regions)
    offers, _ = offers_of(pictures, regions, seen)
    sizes = sorted(int(size) for size in offers.sizes if size >= GEOMETRY_BYTES)
    assert sizes[0] == GEOMETRY_BYTES
    assert GEOMETRY_BYTES + SHARED[1] in sizes
    # And 2, 4 … and all at once of those that place the same mesh.
    leaves = sum(size <= GEOMETRY_BYTES + SHARED[1] for size in sizes)
    sharing = sizes.count(GEOMETRY_BYTES + SHARED[1])
    assert sizes[-1] == sharing * GEOMETRY_BYTES + SHARED[1]
    counts = np.diff(offers.firsts)[-(len(sizes) - leaves) :]
    assert counts.tolist() == [2, 3]
    assert sharing == 3
    items = [pictures.take(n) for n in range(len(offers.sizes))]
    near = [item for item in items if item.is_geometry]
    assert any(item.keys[:-1] == (f"mesh/{SHARED[0]}",) for item in near)
    geometry = [key for item in near for key in item.keys]
    # Its pictures show a leaf less well.
    pictures.keep([key for item in items for key in item.keys if key not in geometry])
    _, by_pictures = offers_of(pictures, regions, seen)
    pictures.keep(key for item in items for key in item.keys)
    _, whole = offers_of(pictures, regions, seen)
    assert by_pictures.max() < whole.max() == 1.0


def test_what_is_farther_away_is_offered_as_geometry_and_where_that_shows_more_than_all_pictures() -> None:
    # 16 triangles a leaf, and 64 pixels a view: few enough of 4 leaves, too many of 16.
    tree = flat_tree(drawn=16, geometry_bytes=TILE_BYTES // 8)
    seen, regions = seen_from((32.0, -330.0, 10.0)), Regions(tree, Shape(near=12.0))
    pictures = Pictures(regions)
    offers, _ = offers_of(pictures, regions, seen)
    items = [pictures.take(n) for n in range(len(offers.sizes))]
    as_geometry = {item.cell for item in items if item.is_geometry}
    own = {tree.entries[n].key for n in regions.cells}
    assert {cell[0] for cell in own} == {"1", "2"}
    assert as_geometry == {cell for cell in own if cell[0] == "1"}
    four = next(item for item in items if item.is_geometry and item.cell[0] == "1")
    assert len([key for key in four.keys if key.startswith("geometry/")]) == 4
    pictures.keep({key for item in items if not item.is_geometry for key in item.keys})
    offers, best = offers_of(pictures, regions, seen)
    # Then where it shows much more than these alone.
    for n in range(len(offers.sizes)):
        uses = offers.uses(n)
        gains = offers.accuracy[uses] - best[offers.objects[uses], :, 0]
        assert (gains.max(axis=1) > 0.99 * MORE).all()
    assert {item.cell for item in (pictures.take(n) for n in range(len(offers.sizes)))} <= as_geometry
    pictures.keep({key for item in items if not item.is_geometry for key in item.keys})
    # And what is held of it shows more than pictures do.
    _, by_pictures = offers_of(pictures, regions, seen)
    pictures.hold(four.keys)
    _, best = offers_of(pictures, regions, seen)
    region = [tree.entries[n].key for n in regions.cells].index(four.cell)
    assert (best[region] == 1).all()
    assert (by_pictures[region] < 1).all()


@pytest.mark.parametrize(("geometry_bytes", "comes"), [(200, True), (300, False)])
def test_what_is_farther_away_is_no_geometry_that_takes_more_than_its_pictures(
    geometry_bytes: int, comes: bool
) -> None:
    """Four leaves for the tile of 1,000 bytes that is drawn, where it does not add enough for each kilobyte."""
    regions = Regions(flat_tree(drawn=16, geometry_bytes=geometry_bytes), Shape(near=12.0, least_gain=1e5))
    pictures = Pictures(regions)
    offers, _ = offers_of(pictures, regions, seen_from((32.0, -330.0, 10.0)))
    items = [pictures.take(n) for n in range(len(offers.sizes))]
    assert any(item.is_geometry and item.cell[0] == "1" for item in items) == comes


def test_geometry_of_leaves_that_a_viewer_does_not_know_comes_where_pictures_err_enough(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    """The leaves are told in index tiles of their own, below cells of level 1."""
    tree = flat_tree(drawn=16, geometry_bytes=TILE_BYTES // 8)
    entries = [msgspec.structs.replace(one, index="0f" * 8 if one.cell.level == 1 else "") for one in tree.entries]
    apart = CellTree(tree.grid, entries, tree.parents.tolist())
    seen, regions = seen_from((32.0, -330.0, 10.0)), Regions(apart, Shape(near=12.0, least_gain=0.0))
    pictures = Pictures(regions)

    def as_geometry() -> set[str]:
        offers, _ = offers_of(pictures, regions, seen)
        items = [pictures.take(n) for n in range(len(offers.sizes))]
        pictures.keep({key for item in items if not item.is_geometry for key in item.keys})
        return {item.cell for item in items if item.is_geometry}

    assert as_geometry() == set()
    found = as_geometry()
    assert found
    assert {cell[0] for cell in found} == {"1"}
    monkeypatch.setattr(geometry, "WORTH_READING", 1.0)
    assert as_geometry() == set()


def test_cells_are_offered_by_geometry_of_their_own_and_those_above_stand_in() -> None:
    tree = flat_tree(merged=True)
    seen, regions = seen_from((32.0, -330.0, 10.0)), Regions(tree, Shape(near=12.0))
    pictures = Pictures(regions)
    offers, _ = offers_of(pictures, regions, seen)
    items = [pictures.take(n) for n in range(len(offers.sizes))]
    shows = {
        item.cell: len(offers.objects[offers.uses(n)])
        for n, item in enumerate(items)
        if item.is_geometry and len(item.keys) > 0
    }
    cells = [tree.entries[n].key for n in regions.cells]
    assert {cell for cell in cells if cell[0] != "0"} < set(shows)
    assert shows["3/0/0/0"] == len(cells)
    # The coarser a form, the less it takes and shows.
    own = [
        (int(offers.sizes[n]), float(offers.accuracy[offers.uses(n)].mean()))
        for n, item in enumerate(items)
        if item.is_geometry and item.cell == "3/0/0/0"
    ]
    assert own == sorted(own, reverse=True)
    assert len(own) == 2
    # What is held of it shows all that lies below it.
    pictures.keep(items[[item.cell for item in items].index("3/0/0/0")].keys)
    pictures.hold({key for item in items if item.is_geometry and item.cell == "3/0/0/0" for key in item.keys})
    _, best = offers_of(pictures, regions, seen)
    assert (best > 0).all()


def test_what_is_there_needs_nothing_to_stand_in() -> None:
    tree = flat_tree(merged=True)
    seen, regions = seen_from((32.0, -330.0, 10.0)), Regions(tree, Shape(near=12.0))
    pictures = Pictures(regions)
    offers, _ = offers_of(pictures, regions, seen)
    items = [pictures.take(n) for n in range(len(offers.sizes))]
    pictures.keep({key for item in items if not item.is_geometry for key in item.keys})
    offers, _ = offers_of(pictures, regions, seen)
    own = {tree.entries[n].key for n in regions.cells}
    assert {pictures.take(n).cell for n in range(len(offers.sizes))} <= own < {item.cell for item in items}


@pytest.mark.parametrize(("drawn", "shape"), [(0, Shape(12.0)), (4, Shape(0.0)), (4, Shape(12.0, far_geometry=False))])
def test_who_is_not_offered_what_is_farther_away_as_geometry(drawn: int, shape: Shape) -> None:
    """Older worlds do not tell how many triangles instances have."""
    tree = flat_tree(drawn=drawn)
    regions = Regions(tree, shape)
    pictures = Pictures(regions)
    offers, _ = offers_of(pictures, regions, seen_from((32.0, -30.0, 10.0)))
    assert not any(pictures.take(n).is_geometry for n in range(len(offers.sizes)))


def sent(seen: Viewing, pictures: Pictures, regions: Regions, bandwidth: float, seconds: float) -> list[SentCell]:
    """What a viewer that stays is sent in so many seconds."""
    scheduler = Scheduler(regions, [pictures], FAR, Link(bandwidth, 0.0))
    now, found = 0.0, []
    scheduler.follow(seen, now)
    while (choice := scheduler.next(now)) and now < seconds:
        found.append(choice.item)
        now += choice.seconds
        scheduler.follow(Viewing(now, seen.eye, seen.forward, seen.fov, seen.size), now)
    return found


def test_coarse_everywhere_before_fine_somewhere_and_all_of_the_cut_in_the_end() -> None:
    seen, regions = seen_from((32.0, -30.0, 10.0)), Regions(TREE, Shape(near=0.0))
    pictures = Pictures(regions)
    found = sent(seen, pictures, regions, 10_000, 600)
    assert found[0].cell == "3/0/0/0"
    keys = [key for item in found for key in item.keys]
    assert len(keys) == len(set(keys))
    assert all(item.keys for item in found)
    outlook = look(MotionPredictor().follow(seen), regions.boxes(MotionPredictor().follow(seen), 1), 0.0, FAR)
    in_picture = {TREE.entries[n].key for n in regions.cells[outlook.visible[:, 0] > 0]}
    assert in_picture <= {item.cell for item in found}


def test_what_was_dropped_is_sent_again() -> None:
    seen, regions = seen_from((32.0, -30.0, 10.0)), Regions(TREE, Shape(near=0.0))
    pictures = Pictures(regions)
    found = sent(seen, pictures, regions, 10_000, 600)
    assert sent(seen, pictures, regions, 10_000, 600) == []
    pictures.drop(found[-1].keys[:1])
    assert sent(seen, pictures, regions, 10_000, 600) == [SentCell(found[-1].cell, False, found[-1].keys[:1])]


def test_no_world_no_offers() -> None:
    regions = Regions(CellTree(GRID, [], []))
    assert sent(viewing(), Pictures(regions), regions, 1_000, 10) == []


STATUES = flat_tree(statues=True)


def test_instances_are_objects_of_their_own() -> None:
    seen, regions = seen_from((32.0, -30.0, 10.0)), Regions(STATUES)
    boxes = regions.boxes(MotionPredictor().follow(seen), 60.0)
    count = len(regions.cells)
    assert len(boxes) == count + 16
    outlook = look(MotionPredictor().follow(seen), boxes, 0.0, FAR)
    overlap = float(outlook.visible[:count].sum() / outlook.pixels)
    assert np.allclose(regions.importance(outlook), [1.0] * count + [OBJECTS] * 16)
    twice = replace(outlook, visible=outlook.visible * (2 / overlap))
    assert np.allclose(regions.importance(twice), [1.0] * count + [2 * OBJECTS] * 16)
    for box, home in zip(boxes[count:], regions.homes, strict=True):
        cell = STATUES.bounds[regions.cells[home]]
        assert (box[:3] >= cell[:3]).all()
        assert (box[3:] <= cell[3:]).all()
        assert np.allclose(box[3:] - box[:3], (1.0, 1.0, 2.0))
    assert len(Regions(STATUES, Shape(near=0.0)).boxes(MotionPredictor().follow(seen), 60.0)) == count


def test_a_level_of_a_mesh_shows_all_of_its_instances_at_once() -> None:
    seen, regions = seen_from((32.0, -30.0, 10.0)), Regions(STATUES)
    pictures = Pictures(regions)
    offers, _ = offers_of(pictures, regions, seen)
    items = [pictures.take(n) for n in range(len(offers.sizes))]
    full, coarse = (n for n, item in enumerate(items) if item.cell == STATUE[0].hash)
    assert offers.sizes[[full, coarse]].tolist() == [6_000, 1_000]
    assert items[full].keys == (f"mesh/{STATUE[0].hash}",)
    assert items[coarse].keys == (f"texture/{STATUE[1].textures[0][0]}", f"mesh/{STATUE[1].hash}")
    count = len(regions.cells)
    shown = offers.objects[offers.uses(full)]
    assert sorted(shown) == sorted(offers.objects[offers.uses(coarse)])
    assert len(shown) > 8
    assert (shown >= count).all()
    assert (offers.accuracy[offers.uses(full)] == 1.0).all()
    own = STATUES.instances.bounds[regions.instances[shown - count]]
    gap = np.maximum(np.maximum(own[:, :3] - seen.eye, seen.eye - own[:, 3:]), 0.0)
    widths = np.linalg.norm(gap, axis=1, keepdims=True) / seen.focal
    errors = STATUES.errors_at(np.array([[30, 40, 50]]) / 255, widths, MESH_FARTHEST)
    areas = np.hypot(1.0, 1.0) * 2.0 / widths**2
    fine = np.sqrt(np.maximum(areas / 2_000, 1) / np.maximum(areas / 120, 1))
    assert np.allclose(offers.accuracy[offers.uses(coarse)], (1 - FINE) * (1 - errors) + FINE * fine, atol=1e-6)
    # Pictures show the less of one the wider their pixels are.
    root = next(n for n, item in enumerate(items) if item.cell == "3/0/0/0" and offers.parts[n] == len(SHARES))
    uses = offers.uses(root)
    of_instances = offers.accuracy[uses][offers.objects[uses] >= count]
    widest = 100.0 / seen.focal
    assert 0 < of_instances.max() <= SHARP * widest / GRID.pitch(3)


def test_an_image_shows_instances_as_sharp_as_it_is_from_its_side() -> None:
    tree = flat_tree(statues=True, boards=True)
    seen, regions = seen_from((32.0, -30.0, 1.0)), Regions(tree)
    pictures = Pictures(regions)
    offers, _ = offers_of(pictures, regions, seen)
    items = [pictures.take(n) for n in range(len(offers.sizes))]
    names = {f"texture/{name}": side for side, (name, _) in enumerate(BOARDS.images)}
    boards = {names[item.keys[0]]: n for n, item in enumerate(items) if names.keys() & item.keys}
    # Seen from the south, by some from a little east or west: an eighth of a turn is a side.
    assert set(boards) <= {5, 6, 7}
    assert [int(offers.sizes[n]) for n in boards.values()] == [900 + side for side in boards]
    count = len(regions.cells)
    front = offers.uses(boards[6])
    rows = offers.objects[front] - count
    own = tree.instances.bounds[regions.instances[rows]]
    middle = own.reshape(-1, 2, 3).mean(axis=1)
    towards = seen.eye - middle
    away = np.linalg.norm(towards, axis=1)
    square = np.minimum(-towards[:, 1] / away, np.sin(np.radians(60))) / np.sin(np.radians(60))
    gap = np.linalg.norm(np.maximum(np.maximum(own[:, :3] - seen.eye, seen.eye - own[:, 3:]), 0.0), axis=1)
    errors = tree.errors_at(np.array([[20, 40, 80]]) / 255, gap[:, None] / seen.focal, MESH_FARTHEST)[:, 0]
    whole = offers.accuracy[front, 0] / square**3
    sharp = 64 * gap / seen.focal / 2.0
    # The rectangle round a box is a little higher than the box is far away.
    assert np.allclose(whole, (1 - FINE) * (1 - errors) + FINE * np.minimum(sharp, 1.0), atol=0.04)
    assert whole.min() > 0.3
    # One that is there counts, also where another is seen more squarely.
    pictures.keep({f"texture/{BOARDS.images[4][0]}"})
    offers, _ = offers_of(pictures, regions, seen)
    best = np.zeros((len(regions.bounds), offers.accuracy.shape[1], len(SHARES)), np.float32)
    pictures.shown(look(MotionPredictor().follow(seen), regions.bounds, 0.0, FAR), best)
    assert 0 < best[count:].max() < 0.9


def test_where_all_pictures_are_there_meshes_are_not_sent() -> None:
    seen, regions = seen_from((32.0, -80.0, 10.0)), Regions(STATUES, Shape(near=1.0))
    pictures = Pictures(regions)
    offers, _ = offers_of(pictures, regions, seen)
    assert any(pictures.take(n).cell == STATUE[0].hash for n in range(len(offers.sizes)))
    keys = {key for cell in regions.cells.tolist() for n in range(26) for key in STATUES.pictures(cell, n, 10.0).keys}
    pictures.keep(keys)
    offers, _ = offers_of(pictures, regions, seen)
    assert not any(pictures.take(n).cell == STATUE[0].hash for n in range(len(offers.sizes)))
    near = Regions(STATUES, Shape(near=1.0, far_geometry=False))
    near.boxes(MotionPredictor().follow(seen), 60.0)
    offers, _ = offers_of(Pictures(near), near, seen)
    assert offers.accuracy[offers.objects >= len(near.cells)].max(initial=0.0) < 1.0


def test_who_looks_down_is_offered_images_made_on_demand() -> None:
    tree = flat_tree(statues=True, boards=True)
    eye, forward = np.array([32.0, 10.0, 40.0]), np.array([0.0, 0.5, -(0.75**0.5)])
    seen = Viewing(0.0, eye, forward, 60.0, (100, 100))

    def made(shape: Shape, held: set[str], seen: Viewing = seen) -> tuple[dict[str, np.ndarray], np.ndarray, Regions]:
        """Offered images -> accuracy of all objects by each, the best by what is held, and the regions."""
        regions = Regions(tree, shape)
        pictures = Pictures(regions)
        pictures.keep(held)
        offers, best = offers_of(pictures, regions, seen)
        found = {}
        for n in range(len(offers.sizes)):
            key = "".join(pictures.take(n).keys[:1])
            if key.startswith("impostor/"):
                assert int(offers.sizes[n]) == np.mean([size for _, size in BOARDS.images]) // 1
                found[key] = np.zeros(len(regions.bounds))
                found[key][offers.objects[offers.uses(n)]] = offers.accuracy[offers.uses(n), 0]
        return found, best, regions

    assert not made(Shape(), set())[0]
    on_demand = Shape(dynamic_impostors=True)
    level = Viewing(0.0, np.array([32.0, -30.0, 1.0]), np.array([0.0, 1.0, 0.0]), 60.0, (100, 100))
    assert not made(on_demand, set(), level)[0], "a side is as good as head on"
    found, none, regions = made(on_demand, set())
    named = {key: DynamicImpostor.of(key) for key in found}
    assert {(one.mesh, one.rows) for one in named.values() if one} == {(STATUE[0].hash, 64)}
    count = len(regions.cells)
    own = tree.instances.bounds[regions.instances].reshape(-1, 2, 3).mean(axis=1)
    towards = (eye - own) / np.linalg.norm(eye - own, axis=1, keepdims=True)
    for key, one in named.items():
        assert one is not None
        sine = towards @ directions(dynamic_angle(one.turn, one.tilt))
        # What is seen from straight before it is seen whole, and nothing from behind.
        of_it = found[key][count:]
        # Those that are not in the picture are none of its uses.
        assert (of_it[(sine > FULL_SINE) & (of_it > 0)] > 0.4).all()
        assert of_it.max() > 0.4
        assert (of_it[sine <= 0] == 0).all()
    # The one in the middle of the picture, 45 degrees below.
    middle = int(np.argmin(np.abs(towards - [0, -(0.5**0.5), 0.5**0.5]).sum(axis=1)))
    best = max(found, key=lambda key: found[key][count + middle])
    assert (chosen := named[best])
    assert towards[middle] @ directions(dynamic_angle(chosen.turn, chosen.tilt)) > FULL_SINE
    # What is held is shown, and not offered again; also where nothing can be made.
    for shape in (on_demand, Shape()):
        again, shown, _ = made(shape, {best})
        assert best not in again
        assert shown[count + middle, 0, 0] == pytest.approx(found[best][count + middle], abs=1e-6)
        assert shown[count + middle, 0, 0] > none[count + middle, 0, 0]


def test_of_images_made_on_demand_more_come_as_soon_as_some_are_there(monkeypatch: pytest.MonkeyPatch) -> None:
    """A look offers a few alone, of those that are not held."""
    tree, most = flat_tree(statues=True, boards=True), 2
    monkeypatch.setattr(boards, "MOST_DYNAMIC", most)
    seen = Viewing(0.0, np.array([32.0, 10.0, 40.0]), np.array([0.0, 0.5, -(0.75**0.5)]), 60.0, (100, 100))
    held: set[str] = set()
    for _ in range(10):
        regions = Regions(tree, Shape(dynamic_impostors=True))
        pictures = Pictures(regions)
        pictures.keep(held)
        offers, _ = offers_of(pictures, regions, seen)
        keys = ("".join(pictures.take(n).keys[:1]) for n in range(len(offers.sizes)))
        made = {key for key in keys if key.startswith("impostor/")}
        assert len(made) <= most
        assert not made & held
        if not made:
            break
        held |= made
    assert len(held) > 2 * most
    assert not made
