"""A region is replaced with the bytes of a whole bake, and only what it reaches is baked."""

from __future__ import annotations

import json
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from bake.scenes import contents
from farfield.bake.options import BakeOptions
from farfield.cli import main
from farfield.pipeline import bake_sources, update_place, verify_place
from farfield.scene.footprints.features import FootprintChunk
from farfield.scene.georeference import moved_to
from farfield.scene.options import ReadOptions
from farfield.scene.read import read_scene
from farfield.store.directory import DirectoryStore
from farfield.world.garbage import drop_garbage
from farfield.world.manifest import read_manifest
from farfield.world.world import World

OPTIONS = BakeOptions(leaf_size=64.0, resolution=32, directions="5", workers=1)
BUILDINGS = [(40 * x, 30 * y, 10 + (x * 7 + y * 3) % 25, f"no. {x}-{y}") for x in range(10) for y in range(8)]
Building = tuple[int, int, int, str]


def write(path: Path, buildings: Sequence[Building]) -> Path:
    """Boxes of 20 m x 15 m, in Japan's zone IX."""
    features = [
        {
            "type": "Feature",
            "properties": {"height": height, "name": name},
            "geometry": {
                "type": "Polygon",
                "coordinates": [[[x, y], [x + 20, y], [x + 20, y + 15], [x, y + 15], [x, y]]],
            },
        }
        for x, y, height, name in buildings
    ]
    crs = {"type": "name", "properties": {"name": "urn:ogc:def:crs:EPSG::6677"}}
    path.write_text(json.dumps({"type": "FeatureCollection", "crs": crs, "features": features}))
    return path


def as_format(source: Path, extension: str) -> Path:
    """The same in another format."""
    import pyogrio

    target = source.with_suffix(extension)
    meta, _, shapes, columns = pyogrio.raw.read(source)
    driver = {".fgb": "FlatGeobuf", ".gpkg": "GPKG"}[extension]
    target.unlink(missing_ok=True)
    pyogrio.raw.write(target, shapes, columns, meta["fields"], crs="EPSG:6677", geometry_type="Polygon", driver=driver)
    return target


@pytest.fixture(autouse=True)
def _small_chunks(monkeypatch: pytest.MonkeyPatch) -> None:
    """16 buildings a mesh, as a city has a thousand."""
    monkeypatch.setattr("farfield.scene.footprints.order.BUILDINGS_PER_MESH", 16)


REGION = (170.0, 100.0, 260.0, 200.0)


def changed(height: int = 60) -> list[Building]:
    """In the region one house goes, one grows, one is new; the file is written in another order."""
    inside = [b for b in BUILDINGS if 150 <= b[0] < 250 and 100 <= b[1] < 190]
    kept = [b for b in BUILDINGS if b != inside[0] and b != inside[1]]
    return [(205, 128, 55, "new"), *kept[::-1], (*inside[1][:2], height, "grown")]


def whole_world(source: Path, place: Path, like: Path) -> Path:
    """A bake of everything into the grid of another world."""
    bake_sources([source], place, replace(OPTIONS, corner=read_manifest(DirectoryStore(like)).grid.corner))
    return place


@pytest.mark.parametrize(("extension", "height"), [(".geojson", 60), (".fgb", 60), (".gpkg", 90)])
def test_the_bytes_are_those_of_a_whole_bake(tmp_path: Path, extension: str, height: int) -> None:
    """90 m are a level of cells more, and every cell above the leaves is another."""

    def file(buildings: Sequence[Building]) -> Path:
        source = write(tmp_path / "town.geojson", buildings)
        return source if extension == ".geojson" else as_format(source, extension)

    place = tmp_path / "world"
    bake_sources([file(BUILDINGS)], place, OPTIONS)
    source = file(changed(height))
    facts = update_place(place, [source], workers=1, region=REGION)
    assert 0 < facts["cells_rebuilt"] < facts["cells"] * (1 if height > 64 else 0.6)
    whole = whole_world(source, tmp_path / "whole", place)
    drop_garbage(DirectoryStore(place))
    assert contents(place) == contents(whole)
    assert update_place(place, [source], workers=1)["cells_rebuilt"] == 0


def test_a_file_of_the_changes_alone_will_do(tmp_path: Path) -> None:
    place = tmp_path / "world"
    bake_sources([write(tmp_path / "town.geojson", BUILDINGS)], place, OPTIONS)
    x0, y0, x1, y1 = REGION
    inside = [b for b in changed() if x0 <= b[0] + 10 < x1 and y0 <= b[1] + 7.5 < y1]
    for _ in range(2):  # The second time it is known, and still stands for the file that the world was baked from.
        update_place(place, [write(tmp_path / "changes.geojson", inside)], workers=1, region=REGION)
    source = write(tmp_path / "town.geojson", changed())
    whole = whole_world(source, tmp_path / "whole", place)
    drop_garbage(DirectoryStore(place))
    ours, theirs = contents(place), contents(whole)
    assert ours.keys() == theirs.keys()
    # The manifest tells the bytes of the file that was read; everything else is the same.
    for found in (ours, theirs):
        manifest = json.loads(found["world.json"])
        del manifest["statistics"]["source_bytes"]
        found["world.json"] = json.dumps(manifest).encode()
    assert ours == theirs
    # The changes are not in the file that it was baked from, and are not lost when it is repaired.
    store = DirectoryStore(place)
    tile = next(iter(store.list("orthoview")))
    store.put(tile, b"broken")
    assert not verify_place(place, repair=True).faults
    assert {key: value for key, value in contents(place).items() if key != "world.json"} == {
        key: value for key, value in ours.items() if key != "world.json"
    }


def test_without_a_source_the_region_is_cleared(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    place = tmp_path / "world"
    bake_sources([write(tmp_path / "town.geojson", BUILDINGS)], place, OPTIONS)
    assert main(["update", str(place), "--region", "170,100,260,200", "--workers", "1", "--json"]) == 0
    facts = json.loads(capsys.readouterr().out)
    assert facts["generation"] == 2
    gone = [b for b in BUILDINGS if 170 <= b[0] + 10 < 260 and 100 <= b[1] + 7.5 < 200]
    assert read_manifest(DirectoryStore(place)).statistics.objects == len(BUILDINGS) - len(gone) < len(BUILDINGS)


def test_ids_lead_to_the_attributes_of_an_object(tmp_path: Path) -> None:
    """Every object id in a picture is that of the building that stands there."""
    from farfield.world.attributes import decode_attribute_index, read_table
    from farfield.world.keys import attributes_key

    place = tmp_path / "world"
    bake_sources([write(tmp_path / "town.geojson", BUILDINGS)], place, OPTIONS)
    world = World.open(DirectoryStore(place))
    name = world.manifest.attributes
    assert name is not None
    index = decode_attribute_index(world.store.get(attributes_key(name)))
    assert index.objects == sum(count for _, count, _ in index.parts) == len(BUILDINGS)
    names = [row for _, _, table in index.parts for row in read_table(world.store, table)["name"]]
    assert sorted(names) == sorted(name for *_, name in BUILDINGS)


def scene_toml(folder: Path, trees: np.ndarray) -> Path:
    """Buildings on ground, with posts."""
    from farfield.scene.gltf.write import write_glb
    from farfield.scene.procedural.blobs import blob

    folder.mkdir(exist_ok=True)
    write_glb(folder / "post.glb", blob(60, 4.0, 1))
    np.save(folder / "posts.npy", np.column_stack([trees, np.zeros(len(trees))]))
    scene = folder / "scene.toml"
    scene.write_text(
        'crs = "EPSG:6677"\n[[source]]\npath = "town.geojson"\n'
        '[[source]]\npath = "post.glb"\ninstances = "posts.npy"\nat = [0, 0, 0]\n'
        "[[ground]]\nsize = 500\nat = [200, 120, 0]\n"
    )
    return scene


def test_placements_in_the_region_are_replaced_and_the_ground_stays(tmp_path: Path) -> None:
    folder = tmp_path / "scene"
    posts = np.array([(30.0 + 40 * x, 22.0 + 60 * y, 0.0) for x in range(9) for y in range(4)])
    scene = scene_toml(folder, posts)
    write(folder / "town.geojson", BUILDINGS)
    place = tmp_path / "world"
    bake_sources([scene], place, OPTIONS)
    inside = (posts[:, 0] >= 170) & (posts[:, 0] < 260) & (posts[:, 1] >= 100) & (posts[:, 1] < 200)
    assert inside.any()
    write(folder / "town.geojson", changed())
    moved = np.where(inside[:, None], posts + [3.0, 2.0, 0.0], posts)
    scene_toml(folder, moved)
    facts = update_place(place, [scene], workers=1, region=REGION)
    assert 0 < facts["cells_rebuilt"] < facts["cells"] / 2
    whole = whole_world(scene, tmp_path / "whole", place)
    drop_garbage(DirectoryStore(place))
    ours, theirs = contents(place), contents(whole)
    assert ours == theirs


def test_colours_and_storeys_above_the_ground_are_replaced_as_well(tmp_path: Path) -> None:
    """Walls and roofs by columns, and towers that begin above other buildings, some of them exactly above."""
    folder, place = tmp_path / "scene", tmp_path / "world"
    folder.mkdir()
    scene = folder / "scene.toml"
    scene.write_text(
        '[[source]]\npath = "town.geojson"\nwall_colour_attribute = "wall"\nroof_colour_attribute = "roof"\n'
        'min_height_attribute = "above"\n'
    )

    towers = [(x, y, height + 9, f"above {name}") for x, y, height, name in BUILDINGS[::3]]

    def town(buildings: Sequence[Building], wall: str) -> None:
        path = write(folder / "town.geojson", buildings)
        collection = json.loads(path.read_text())
        for feature in collection["features"]:
            own = feature["properties"]
            x, y = feature["geometry"]["coordinates"][0][0]
            if x % 80 == 0 and y % 60 == 0:
                own["wall"] = wall if REGION[0] <= x < REGION[2] and REGION[1] <= y < REGION[3] else "tan"
            own["roof"] = "navy" if y == 0 else None
            own["above"] = own["height"] - 9 if own["name"].startswith("above") else None
        path.write_text(json.dumps(collection))

    town([*BUILDINGS, *towers], "red")
    bake_sources([scene], place, OPTIONS)
    town([*BUILDINGS, *towers][::-1], "green")
    facts = update_place(place, [scene], workers=1, region=REGION)
    assert 0 < facts["cells_rebuilt"] < facts["cells"] * 0.6
    whole = whole_world(scene, tmp_path / "whole", place)
    drop_garbage(DirectoryStore(place))
    assert contents(place) == contents(whole)
    assert update_place(place, [scene], workers=1)["cells_rebuilt"] == 0


@pytest.mark.parametrize("region", ["1,2,3", "a,b,c,d", "5,0,5,1", "0,0,nan,1", "9,0,1,1"])
def test_a_rectangle_is_asked_for(tmp_path: Path, region: str, capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["update", str(tmp_path), "--region", region]) == 2
    assert "--region" in capsys.readouterr().err


def test_something_must_be_asked_for(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["update", str(tmp_path)]) == 2
    assert "neither a source nor a region" in capsys.readouterr().err


def test_moved_footprints_are_refused(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    write(tmp_path / "town.geojson", BUILDINGS)
    scene = tmp_path / "scene.toml"
    scene.write_text('[[source]]\npath = "town.geojson"\nrotate = 30\n')
    place = tmp_path / "world"
    bake_sources([scene], place, OPTIONS)
    assert main(["update", str(place), str(scene), "--region", "170,100,260,200"]) == 2
    assert "moves cannot be replaced by region" in capsys.readouterr().err


def test_a_leaf_in_which_nothing_changed_is_not_drawn(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """All buildings are one mesh, which reaches into every leaf; one of them grows."""
    monkeypatch.setattr("farfield.scene.footprints.order.BUILDINGS_PER_MESH", 1024)
    place = tmp_path / "world"
    bake_sources([write(tmp_path / "town.geojson", BUILDINGS)], place, OPTIONS)
    grown = [(x, y, height + 7 * ((x, y) == (200, 120)), name) for x, y, height, name in BUILDINGS]
    source = write(tmp_path / "town.geojson", grown)
    facts = update_place(place, [source], workers=1, region=(195.0, 115.0, 225.0, 140.0))
    assert 0 < facts["cells_rebuilt"] <= 4 + 4 + 2 + 1
    whole = whole_world(source, tmp_path / "whole", place)
    drop_garbage(DirectoryStore(place))
    assert contents(place) == contents(whole)


@pytest.mark.parametrize("extension", [".geojson", ".gpkg"])
def test_an_unknown_base_is_the_median_of_the_whole_file(tmp_path: Path, extension: str) -> None:
    """Whichever part of the file a region makes read; the ground rises to the east."""
    folder = tmp_path / "scene"
    folder.mkdir()

    def file(buildings: Sequence[Building]) -> None:
        source = write(folder / "town.geojson", buildings)
        collection = json.loads(source.read_text())
        for feature in collection["features"]:
            x, y = feature["geometry"]["coordinates"][0][0]
            feature["properties"]["ground"] = None if (x + y) % 50 == 0 else 5 + x // 10
        source.write_text(json.dumps(collection))
        if extension != ".geojson":
            as_format(source, extension)

    scene = folder / "scene.toml"
    scene.write_text(f'crs = "EPSG:6677"\n[[source]]\npath = "town{extension}"\nbase_attribute = "ground"\n')
    # Nothing far from the region is read again.
    far = [(x + 4000, y, height, f"far {name}") for x, y, height, name in BUILDINGS]
    place = tmp_path / "world"
    file([*BUILDINGS, *far])
    bake_sources([scene], place, OPTIONS)
    file([*[(*b[:2], b[2] + 9, b[3]) if 170 <= b[0] < 240 and 100 <= b[1] < 180 else b for b in BUILDINGS], *far])
    assert update_place(place, [scene], workers=1, region=REGION)["cells_rebuilt"] > 0
    whole = whole_world(scene, tmp_path / "whole", place)
    drop_garbage(DirectoryStore(place))
    assert contents(place) == contents(whole)


def test_placements_are_to_the_bit_those_of_a_whole_bake(tmp_path: Path) -> None:
    """Of the region alone another origin follows, so that they are moved on another way."""
    posts = np.random.default_rng(1).uniform((-30, -90, 0), (59, 9, 0.1), (4000, 3))
    scene = scene_toml(tmp_path, posts)
    scene.write_text(scene.read_text().replace("at = [0, 0, 0]", "at = [3200.7, 7190.3, 0.1]"))
    scene.write_text(scene.read_text().partition("[[ground]]")[0])
    town = [(x + 3000, y + 7000, height, name) for x, y, height, name in BUILDINGS]
    write(tmp_path / "town.geojson", [(-50_000, -70_000, 9, "far away"), *town])
    whole = read_scene([scene])
    assert not whole.warnings
    part = read_scene([scene], ReadOptions(crs=whole.crs, region=(3170.0, 7100.0, 3260.0, 7200.0)))
    assert part.origin != whole.origin
    one, other = (
        s.instances.transform[[not isinstance(s.meshes[k], FootprintChunk) for k in s.instances.mesh]]
        for s in (whole, moved_to(part, whole.origin))
    )
    assert len(one) == len(posts)
    assert np.array_equal(one, other)


def test_a_world_is_repaired_in_its_own_frame(tmp_path: Path) -> None:
    """After an update the sources alone would put the origin, and the corner of the grid, elsewhere."""
    place = tmp_path / "world"
    town = [(x + 3000, y + 7000, height, name) for x, y, height, name in BUILDINGS]
    source = write(tmp_path / "town.geojson", [(0, 0, 9, "far away"), *town])
    bake_sources([source], place, OPTIONS)
    write(source, town)
    update_place(place, [source], workers=1)
    manifest = read_manifest(DirectoryStore(place))
    assert read_scene([source]).origin != manifest.origin
    drop_garbage(DirectoryStore(place))
    whole = contents(place)
    store = DirectoryStore(place)
    for key in (next(iter(store.list("orthoview"))), next(iter(store.list("geometry")))):
        store.put(key, b"broken")
    assert not verify_place(place, repair=True).faults
    assert contents(place) == whole


def test_what_has_no_coordinates_stays_where_the_world_has_it(tmp_path: Path) -> None:
    """The local zero follows from the extent of what is read, which a region makes smaller."""
    folder = tmp_path / "scene"
    scene = scene_toml(folder, np.array([[3200.0, 7130.0, 0.0]]))
    scene.write_text(scene.read_text().replace("at = [0, 0, 0]\n", "").partition("[[ground]]")[0])
    town = [(x + 3000, y + 7000, height, name) for x, y, height, name in BUILDINGS]
    write(folder / "town.geojson", [(0, 0, 9, "far away"), *town])
    place = tmp_path / "world"
    bake_sources([scene], place, OPTIONS)
    grown = [(x, y, height + 5 * (name == "no. 5-4"), name) for x, y, height, name in town]
    write(folder / "town.geojson", [(0, 0, 9, "far away"), *grown])
    region = (3170.0, 7100.0, 3260.0, 7200.0)
    assert (
        read_scene([scene], ReadOptions(crs="EPSG:6677", region=region)).origin
        != read_manifest(DirectoryStore(place)).origin
    )
    assert update_place(place, [scene], workers=1, region=region)["cells_rebuilt"] > 0
    whole = whole_world(scene, tmp_path / "whole", place)
    drop_garbage(DirectoryStore(place))
    assert contents(place) == contents(whole)
