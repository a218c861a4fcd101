"""OpenStreetMap extracts: what is a building, parts in place of outlines, heights by tags, what is left out."""

from __future__ import annotations

import sys
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from xml.sax.saxutils import quoteattr

import numpy as np
import pytest

from farfield.errors import InputError, MissingExtraError
from farfield.scene.footprints.features import FootprintChunk
from farfield.scene.model import Scene
from farfield.scene.options import ReadOptions
from farfield.scene.read import read_scene

SOUTH, WEST = 47.14, 9.52
DEGREE = np.array([111_320 * np.cos(np.radians(SOUTH)), 111_200.0])
"""Metres of a degree of longitude and latitude."""
Tags = Mapping[str, str]
Box = tuple[float, float, float, float]
"""x0, y0, x1, y1 in metres."""


@dataclass
class Extract:
    """Written as .osm."""

    nodes: list[tuple[float, float]] = field(default_factory=list)
    lines: list[str] = field(default_factory=list)
    relations: list[str] = field(default_factory=list)
    ways: int = 0

    def way(self, points: Sequence[tuple[float, float]], close: bool = True, lost: int = 0, **tags: str) -> int:
        """lost: points that the file lacks."""
        first = len(self.nodes) + 1
        self.nodes += points
        refs = [*range(first, len(self.nodes) + 1), *range(90_000, 90_000 + lost)] + [first] * close
        self.ways += 1
        inner = "".join(f'<nd ref="{ref}"/>' for ref in refs) + told(tags)
        self.lines.append(f'<way id="{self.ways}" version="1">{inner}</way>')
        return self.ways

    def box(self, box: Box, **tags: str) -> int:
        """A closed way."""
        x0, y0, x1, y1 = box
        return self.way([(x0, y0), (x1, y0), (x1, y1), (x0, y1)], **tags)

    def relation(self, members: Sequence[tuple[int, str]], **tags: str) -> None:
        """A multipolygon of ways."""
        inner = "".join(f'<member type="way" ref="{ref}" role="{role}"/>' for ref, role in members)
        inner += told({"type": "multipolygon", **tags})
        self.relations.append(f'<relation id="{len(self.relations) + 1}" version="1">{inner}</relation>')

    def write(self, path: Path) -> Path:
        """As XML, or as PBF by the extension."""
        places = [(WEST + x / DEGREE[0], SOUTH + y / DEGREE[1]) for x, y in self.nodes]
        nodes = "".join(
            f'<node id="{k}" version="1" lon="{x:.7f}" lat="{y:.7f}"/>' for k, (x, y) in enumerate(places, 1)
        )
        text = f'<?xml version="1.0"?><osm version="0.6">{nodes}{"".join(self.lines + self.relations)}</osm>'
        if path.suffix == ".osm":
            path.write_text(text, encoding="utf-8")
            return path
        import osmium

        with osmium.SimpleWriter(osmium.io.File(str(path), "pbf")) as writer:
            for element in osmium.FileProcessor(osmium.io.FileBuffer(text.encode(), "osm")):
                writer.add(element)
        return path


def told(tags: Tags) -> str:
    """The words of keys joined by __ stand for a colon."""
    return "".join(f"<tag k={quoteattr(key.replace('__', ':'))} v={quoteattr(value)}/>" for key, value in tags.items())


def stands(scene: Scene) -> dict[str, tuple[float, float]]:
    """Bottom and top of each, by id."""
    features = [source.features for source in scene.meshes if isinstance(source, FootprintChunk)]
    bottom, top = (np.concatenate([getattr(own, name) for own in features]) for name in ("bottom", "top"))
    ends = zip(bottom.round(2).tolist(), top.round(2).tolist(), strict=True)
    return dict(zip(scene.attributes["id"], ends, strict=True))


def notes(scene: Scene) -> list[str]:
    lines = [line.split(": ", 1)[1] for line in scene.warnings]
    return [line for line in lines if not line.startswith("reprojected")]


SMALL, WIDE = (0.0, 0.0, 10.0, 8.0), (0.0, 0.0, 40.0, 30.0)


@pytest.mark.parametrize("name", ["a.osm", "a.osm.pbf", "A.PBF"])
def test_ways_and_multipolygons(tmp_path: Path, name: str) -> None:
    extract = Extract()
    extract.box(SMALL, building="house", height="6.5 m", name="Zum Löwen", addr__street="Gasse", note="not a column")
    outer, inner = extract.box((50, 0, 90, 30)), extract.box((60, 8, 80, 22))
    extract.relation([(outer, "outer"), (inner, "inner")], building="yes", building__levels="4")
    extract.box((200, 0, 210, 10), building="no")
    extract.box((220, 0, 230, 10), highway="service")
    path = extract.write(tmp_path / name)
    scene = read_scene([path])
    assert stands(scene) == {"way/1": (0, 6.5), "relation/1": (0, 12)}
    assert scene.crs == "EPSG:32632"
    assert scene.credits == ("© OpenStreetMap contributors, ODbL 1.0",)
    assert scene.name == name.split(".")[0]
    assert notes(scene) == []
    row = list(scene.attributes["id"]).index("way/1")
    told = {key: column[row] for key, column in scene.attributes.items()}
    assert (told["name"], told["addr:street"], told["building"], told["height"]) == ("Zum Löwen", "Gasse", "house", 6.5)
    assert "note" not in told
    (source,) = scene.meshes
    mesh = source.load()
    roof = mesh.normals[mesh.triangles[:, 0], 2] > 0.5
    corners = mesh.positions[mesh.triangles[roof]]
    area = np.linalg.norm(np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0]), axis=1).sum() / 2
    assert area == pytest.approx(80 + 40 * 30 - 20 * 14, rel=0.01)


HEIGHTS = [
    ({"height": "12"}, (0, 12)),
    ({"height": "40 ft"}, (0, 12.19)),
    ({"height": "tall", "building__levels": "3"}, (0, 9)),
    ({"height": "20", "building__levels": "3"}, (0, 20)),
    ({"building__height": "7"}, (0, 7)),
    ({"building__levels": "2", "roof__levels": "1"}, (0, 9)),
    ({"building__levels": "2", "roof__height": "2.5"}, (0, 8.5)),
    ({"building__levels": "0", "roof__levels": "2"}, (0, 6)),
    ({"building__levels": "5", "min_height": "3"}, (3, 15)),
    ({"building__levels": "5", "building__min_level": "2"}, (6, 15)),
    ({"min_height": "18", "roof__height": "5"}, (18, 23)),
    ({"height": "4", "min_height": "10"}, (10, 14)),
    ({"height": "5", "min_height": "-3"}, (0, 5)),
    ({"height": "99999"}, (0, 4)),
    ({"building": "roof"}, (3.6, 4)),
    ({"building": "roof", "height": "6"}, (5.6, 6)),
    ({"building": "house"}, (0, 7)),
    ({"building": "church"}, (0, 15)),
    ({"building": "something"}, (0, 4)),
]  # fmt: skip


@pytest.mark.parametrize(("tags", "wanted"), HEIGHTS)
def test_heights_by_tags(tmp_path: Path, tags: Tags, wanted: tuple[float, float]) -> None:
    """80 square metres of which nothing is known have 4 m."""
    extract = Extract()
    extract.box((0, 0, 9, 7), **{"building": "yes", **tags})
    assert stands(read_scene([extract.write(tmp_path / "a.osm")])) == {"way/1": wanted}


def test_the_usual_height_is_by_kind_and_size_and_counted(tmp_path: Path) -> None:
    extract = Extract()
    for k, side in enumerate((5, 8, 15, 40)):
        extract.box((100.0 * k, 0, 100.0 * k + side, side), building="yes")
    extract.box((0, 100, 9, 109), building="house", height="8")
    path = extract.write(tmp_path / "a.osm")
    scene = read_scene([path])
    assert [top for _, top in sorted(stands(scene).values())] == [3, 4, 7, 8, 10]
    assert notes(scene) == ["4 buildings without height stand at what is usual for their kind"]
    scene = read_scene([path], ReadOptions(default_height=5.5))
    assert [top for _, top in sorted(stands(scene).values())] == [5.5] * 4 + [8]
    assert notes(scene) == ["4 buildings without height stand at the default of 5.5 m"]


def test_parts_are_drawn_in_place_of_their_outline(tmp_path: Path) -> None:
    extract = Extract()
    extract.box(WIDE, building="church", name="St. Florin", height="30", building__colour="#102030")
    extract.box((0, 0, 30, 30), building__part="yes", height="12", roof__colour="red")
    extract.box((30, 0, 40, 30), building__part="tower", name="Turm", building__colour="white")
    extract.box((200, 0, 210, 10), building__part="yes", height="9")
    scene = read_scene([extract.write(tmp_path / "a.osm")])
    assert stands(scene) == {"way/2": (0, 12), "way/3": (0, 30), "way/4": (0, 9)}
    rows = [list(scene.attributes["id"]).index(f"way/{k}") for k in (2, 3, 4)]
    table = {name: [scene.attributes[name][row] for row in rows] for name in ("outline", "name", "building")}
    assert table == {
        "outline": ["way/1", "way/1", None],
        "name": ["St. Florin", "Turm", None],
        "building": ["church", "church", None],
    }
    (source,) = scene.meshes
    assert isinstance(source, FootprintChunk)
    details, seed = source.features.details, source.features.seed[rows]
    assert details.wall_color is not None
    assert details.roof_color is not None
    assert details.wall_color[rows].tolist() == [[16, 32, 48, 255], [255, 255, 255, 255], [0, 0, 0, 0]]
    assert details.roof_color[rows].tolist() == [[255, 0, 0, 255], [0, 0, 0, 0], [0, 0, 0, 0]]
    assert seed[0] == seed[1] != seed[2]


def test_a_few_parts_are_cut_out_of_their_outline(tmp_path: Path) -> None:
    extract = Extract()
    extract.box(WIDE, building="yes", height="10")
    extract.box((0, 0, 10, 30), building__part="yes", height="25")
    scene = read_scene([extract.write(tmp_path / "a.osm")])
    assert stands(scene) == {"way/1": (0, 10), "way/2": (0, 25)}
    (source,) = scene.meshes
    assert isinstance(source, FootprintChunk)
    areas = sorted(np.prod(source.features.boxes[:, 2:] - source.features.boxes[:, :2], axis=1))
    np.testing.assert_allclose(areas, [300, 900], rtol=0.05)


def test_an_outline_below_its_parts_is_what_they_stand_on(tmp_path: Path) -> None:
    extract = Extract()
    extract.box(WIDE, building="yes", building__levels="1")
    extract.box(WIDE, building__part="yes", building__levels="5", building__min_level="1")
    extract.box(WIDE, building__part="yes", building__levels="7", building__min_level="5")
    assert stands(read_scene([extract.write(tmp_path / "a.osm")])) == {
        "way/1": (0, 3), "way/2": (3, 15), "way/3": (15, 21),
    }  # fmt: skip


def test_what_is_tagged_as_both_is_a_part_of_the_largest(tmp_path: Path) -> None:
    extract = Extract()
    both = {"building": "yes", "building__part": "yes"}
    extract.box((2, 2, 8, 8), **both, height="40")
    extract.box((0, 0, 30, 30), **both, height="20")
    extract.box(WIDE, building="yes", height="30", name="all")
    extract.box((100, 0, 110, 10), **both, height="9")
    scene = read_scene([extract.write(tmp_path / "a.osm")])
    assert stands(scene) == {"way/1": (0, 40), "way/2": (0, 20), "way/4": (0, 9)}
    assert dict(zip(scene.attributes["id"], scene.attributes["outline"], strict=True)) == {
        "way/1": "way/3", "way/2": "way/3", "way/4": None,
    }  # fmt: skip


def test_what_is_left_out_is_counted(tmp_path: Path) -> None:
    extract = Extract()
    extract.box(SMALL, building="yes", height="5")
    extract.way([(20, 0), (30, 0), (30, 8)], close=False, building="yes", height="5")
    extract.way([(20, 0), (30, 0), (30, 8), (20, 8)], close=False, building="yes", height="5")
    extract.way([(40, 0), (50, 0), (50, 8)], lost=1, building="yes", height="5")
    extract.way([(60, 0), (60, 0), (60, 0)], building="yes", height="5")
    extract.way([(80, 0), (90, 8), (90, 0), (80, 8)], building="yes", height="5")
    outer = extract.box((100, 0, 120, 20), building="yes", height="5")
    extract.relation([(outer, "outer")], building="yes", height="6")
    half = extract.way([(140, 0), (150, 0), (150, 8)], close=False)
    extract.relation([(half, "outer")], building="yes", height="6")
    extract.relation([(4711, "outer")], building="yes", height="6")
    extract.relation([(outer, "outline")], type="building", building="yes")
    cellars: list[Tags] = [
        {"location": "underground", "height": "4"},
        {"layer": "-1"},
        {"layer": "-2", "building__levels": "0"},
        {"building__levels__underground": "2"},
        {"layer": "-1", "building": "roof", "height": "3"},
    ]
    for k, tags in enumerate(cellars):
        extract.box((200 + 20.0 * k, 0, 210 + 20.0 * k, 9), **{"building": "yes", **tags})
    extract.box((400, 0, 410, 9), building="yes", height="5", layer="-1", building__levels__underground="1")
    extract.box((420, 0, 430, 9), building="yes", height="5", building__colour="bright", roof__material="moss")
    scene = read_scene([extract.write(tmp_path / "a.osm")])
    last = extract.ways
    assert set(stands(scene)) == {"relation/1", "way/1", "way/6", f"way/{last - 1}", f"way/{last}"}
    assert notes(scene) == [
        "left out 1 way that do not close",
        "left out 1 outline with points that the file lacks, as at the border of an extract",
        "left out 2 outlines of less than three points",
        "left out 2 multipolygons that are not whole or cross themselves",
        "left out 1 way that a multipolygon has as well",
        "left out 5 buildings below the ground",
        "1 value of building:colour that are not known",
        "1 value of roof:material that are not known",
        "repaired 1 footprint with self-crossing rings",
    ]


def error_line(path: Path) -> str:
    with pytest.raises(InputError) as caught:
        read_scene([path])
    return str(caught.value).replace(str(path.parent) + "/", "")


@pytest.mark.parametrize("share", [0.02, 0.5, 0.97])
def test_a_file_that_is_cut_short(tmp_path: Path, share: float) -> None:
    extract = Extract()
    for k in range(300):
        extract.box((20.0 * k, 0, 20.0 * k + 9 + k % 7, 8), building="yes", name=f"no. {k * 7919}")
    path = extract.write(tmp_path / "a.osm.pbf")
    path.write_bytes(path.read_bytes()[: int(share * path.stat().st_size)])
    assert error_line(path) == (
        "a.osm.pbf: is damaged: it cannot be read as OpenStreetMap data (export or download it again)"
    )


def test_files_that_are_something_else_or_hold_nothing(tmp_path: Path) -> None:
    path = tmp_path / "a.osm.pbf"
    damaged = "is damaged: it cannot be read as OpenStreetMap data (export or download it again)"
    path.write_bytes(b"no map at all " * 50)
    assert error_line(path) == f"a.osm.pbf: {damaged}"
    path = Extract().write(tmp_path / "b.osm.pbf")
    assert error_line(path) == "b.osm.pbf: holds no features (export or download it again)"
    (tmp_path / "c.osm").write_text("<osm version='0.6'><node id='1' lat='")
    assert error_line(tmp_path / "c.osm") == f"c.osm: {damaged}"
    (tmp_path / "d.osm").write_text("<osm version='0.6'><way id='2'/><way id='1'/></osm>")
    assert error_line(tmp_path / "d.osm") == "d.osm: is not sorted by id (sort it with: osmium sort)"
    extract = Extract()
    extract.way([(40, 0), (50, 0), (50, 8)], lost=1, building="yes")
    assert error_line(extract.write(tmp_path / "e.osm")) == (
        "e.osm: holds no features; left out 1 outline with points that the file lacks, as at the border of an extract "
        "(export or download it again)"
    )


def test_missing_extra_is_named(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    path = Extract().write(tmp_path / "a.osm")
    monkeypatch.setitem(sys.modules, "osmium", None)
    with pytest.raises(MissingExtraError, match=r"OpenStreetMap extracts need osmium \(pip install 'farfield\[geo\]'"):
        read_scene([path])


def test_a_region_and_the_order_of_the_file_make_no_difference(tmp_path: Path) -> None:
    boxes = [(30.0 * i, 30.0 * j, 30.0 * i + 12, 30.0 * j + 9) for i in range(6) for j in range(5)]
    forward, backward = Extract(), Extract()
    for extract, order in ((forward, boxes), (backward, boxes[::-1])):
        for box in order:
            extract.box(box, building="yes", building__levels=str(1 + int(box[0] + box[1]) % 5))
    scene = read_scene([forward.write(tmp_path / "a.osm")])
    assert scene.crs is not None
    other = read_scene([backward.write(tmp_path / "b.osm.pbf")])
    assert sorted(stands(scene).values()) == sorted(stands(other).values())
    middle = tuple(np.concatenate([source.features.rings.xy for source in scene.meshes]).mean(0))  # type: ignore[attr-defined]
    region = (middle[0] - 40, middle[1] - 40, middle[0] + 40, middle[1] + 40)
    part = read_scene([tmp_path / "a.osm"], ReadOptions(region=region, crs=scene.crs))
    assert 0 < part.object_count < scene.object_count
    assert stands(part).items() <= stands(scene).items()
    nothing = read_scene([tmp_path / "a.osm"], ReadOptions(region=(0, 0, 1, 1), crs=scene.crs))
    assert nothing.object_count == 0


REAL = [("monaco", 1216, 170.0, 13), ("helsinki_core", 549, 70.0, 127), ("liechtenstein", 8988, 25.0, 0)]


@pytest.mark.parametrize(("name", "count", "highest", "parts"), REAL)
def test_real_extracts(shared_data: Callable[[str], Path], name: str, count: int, highest: float, parts: int) -> None:
    scene = read_scene([shared_data(f"osm_pbf/{name}.osm.pbf")])
    assert scene.object_count == count
    assert max(top for _, top in stands(scene).values()) == highest
    assert sum(outline is not None for outline in scene.attributes["outline"]) == parts
    assert len(set(scene.attributes["id"])) == count
    for source in scene.meshes:
        mesh = source.load()
        corners = mesh.positions[mesh.triangles]
        facing = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
        assert (np.einsum("mc,mc->m", facing, mesh.normals[mesh.triangles[:, 0]]) > 0).all()
