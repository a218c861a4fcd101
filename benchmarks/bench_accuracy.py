"""Whether what is told of kinds is what is seen of them: accuracy as told and as measured.

    farfield bench accuracy [--quick] [--json]
    python benchmarks/bench_accuracy.py [SCENE ...] [--cells N] [--rows FILE]

A cell alone, through a long lens, where a pixel is 2, 1, 1/4 and 1/16 times as wide as one of its own
pictures, from two sides: drawn by its geometry in each form, by its BlockMap, by its pictures, and by those of the
cells above it.
Measured, where the cell is: 1 - FLIP / FLIP of the sky alone, to it as full geometry. Told: what the scheduler takes
for it. Their rank correlation (Spearman) over all kinds, distances and angles; goal .8. Scenes whose worlds are there
(bench_quality). Quick: the town of the tests.
"""

from __future__ import annotations

import argparse
import itertools
import json
import math
import sys
import tempfile
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from bench_quality import WORK
from farfield.bake.bake import bake
from farfield.bake.options import BakeOptions
from farfield.geometry.cameras import Camera
from farfield.octree.grid import CellKey
from farfield.quality.metrics import flip_map, psnr
from farfield.store.directory import DirectoryStore
from farfield.store.opening import open_store
from farfield.stream.accuracy import loss_from, picture_accuracy
from farfield.stream.forms import CellValues, merged_accuracy, own_forms
from farfield.stream.tree import NONE, CellTree
from farfield.view.blockmaps import BlockMapPass
from farfield.view.frame import Frame
from farfield.view.geometry import Batches, GeometryPass
from farfield.view.kinds import ShownForm
from farfield.view.near import MergedPart, NearGeometry
from farfield.view.picture import Picture
from farfield.view.renderer import RenderOptions, chosen_tiles
from farfield.view.shading import Light
from farfield.view.tiles import TileCache, Wanted
from farfield.world.index import BlockMapEntry, CellEntry
from farfield.world.world import World

sys.path.insert(0, str(Path(__file__).parents[1] / "tests"))
from e2e.world import town

SCENES = ("tokyo", "avenues", "forest", "statues")
WIDTHS = (2.0, 1.0, 0.25, 0.0625)
"""Of a pixel, in pixels of the cell's own pictures."""
SIDES = ((35.0, 12.0), (200.0, 45.0))
"""Azimuth and elevation of the eye, degrees."""
LEVELS = 3
"""Levels of cells that are looked at."""
SIZE = 384, 384
FOV = 2.5
"""Degrees: all of a cell is about as far away."""
ABOVE = 4
"""Levels above the cell whose pictures stand in for it."""
SAMPLES = 2
LIGHT = Light()
LEAST_SHARE = 0.01
"""Of the picture that must be covered: the corner of a plane tells nothing."""

FAMILIES = {"picture": "pictures", "blockmap": "BlockMaps"}
"""Beside geometry."""


@dataclass(frozen=True, slots=True)
class Row:
    """A kind from somewhere."""

    scene: str
    cell: str
    kind: str
    """Of a cell so many levels up: picture+N; as geometry of its leaves: form N; of its own: merged N, blockmap."""
    width: float
    side: int
    told: float
    measured: float
    psnr: float

    def facts(self) -> dict[str, Any]:
        """As a line."""
        return {name: getattr(self, name) for name in self.__slots__}


def run(quick: bool = False) -> dict[str, Any]:
    """Correlations by scene; of scenes whose worlds are there."""
    if not quick:
        return figures([name for name in SCENES if (WORK / name / "world.json").exists()], 3)
    with tempfile.TemporaryDirectory(prefix="farfield-accuracy-") as folder:
        store = DirectoryStore(Path(folder) / "world")
        options = BakeOptions(leaf_size=16.0, resolution=64, directions="9", blockmap="16:64", workers=1)
        bake(town(), store, options)
        return summary(list(rows_of("town", World.open(store), 1)))


def figures(names: Sequence[str], cells: int, rows: Path | None = None) -> dict[str, Any]:
    """cells: that are looked at of each level. rows: a file for a line of each picture."""
    found: list[Row] = []
    for name in names:
        for row in rows_of(name, World.open(open_store(WORK / name)), cells):
            found.append(row)
            if rows:
                with rows.open("a") as file:
                    file.write(json.dumps(row.facts()) + "\n")
        print(name, json.dumps(summary(found)), file=sys.stderr, flush=True)
    return summary(found)


def summary(rows: Sequence[Row]) -> dict[str, Any]:
    """Rank correlations and mean errors, of all and by scene."""
    groups = {"all": list(rows)}
    for row in rows:
        groups.setdefault(row.scene, []).append(row)
        groups.setdefault(FAMILIES.get(row.kind.split("+")[0], "geometry"), []).append(row)
    found = {}
    for name, own in groups.items():
        told, measured = (np.array([getattr(row, of) for row in own]) for of in ("told", "measured"))
        found[name] = {
            "pictures": len(own),
            "rank_correlation": round(spearman(told, measured), 3),
            "too_good": round(float((told - measured).mean()), 3),
            "off": round(float(np.abs(told - measured).mean()), 3),
        }
    return found


def spearman(a: NDArray[np.float64], b: NDArray[np.float64]) -> float:
    """Rank correlation; ranks of ties are their mean."""

    def ranks(values: NDArray[np.float64]) -> NDArray[np.float64]:
        _, place, count = np.unique(values, return_inverse=True, return_counts=True)
        return np.asarray((np.cumsum(count) - (count - 1) / 2)[place])

    return float(np.corrcoef(ranks(a), ranks(b))[0, 1]) if len(a) > 2 else float("nan")


def rows_of(scene: str, world: World, cells: int) -> Iterator[Row]:
    """All kinds of some cells of a world."""
    tree, cache = CellTree.of(world), TileCache(world)
    random = np.random.default_rng(5)
    for level in range(LEVELS):
        own = np.flatnonzero((tree.levels == level) & tree.has_pictures)
        own = np.array([cell for cell in own if len(_of_leaves(tree, int(cell)))], np.int64)
        # Slivers at the rim of a world show nothing.
        shows = np.array([sum(size for _, _, size in tree.entries[cell].tiles) for cell in own])
        own = own[shows >= np.median(shows)]
        for cell in random.permutation(own)[:cells].tolist():
            for side in range(len(SIDES)):
                for width in WIDTHS:
                    yield from _Look(scene, world, tree, cache, cell, side, width).rows()


def _of_leaves(tree: CellTree, cell: int) -> tuple[CellValues, ...]:
    """A cell as geometry of all leaves at or below it."""
    forms = tree.forms(cell)
    return forms.values[: len(forms.values) - forms.merged]


@dataclass(frozen=True, slots=True)
class _Drawing:
    """A picture in the making."""

    frame: Frame
    reader: NearGeometry
    batches: Batches


@dataclass(frozen=True, slots=True)
class _Look:
    """A cell from somewhere."""

    scene: str
    world: World
    tree: CellTree
    cache: TileCache
    cell: int
    side: int
    width: float

    @property
    def camera(self) -> Camera:
        middle = self.tree.bounds[self.cell].reshape(2, 3).mean(axis=0)
        azimuth, elevation = np.radians(SIDES[self.side])
        flat = np.cos(elevation)
        towards = np.array([np.sin(azimuth) * flat, np.cos(azimuth) * flat, np.sin(elevation)])
        eye = middle + towards * self.metres * self.focal
        return Camera(tuple(eye.tolist()), tuple(middle.tolist()), FOV)

    @property
    def focal(self) -> float:
        return float(SIZE[1] / 2 / math.tan(math.radians(FOV) / 2))

    @property
    def metres(self) -> float:
        """Across a pixel."""
        return float(self.tree.errors[self.cell] * self.width)

    def rows(self) -> Iterator[Row]:
        """All kinds."""
        forms, count = self.tree.forms(self.cell), len(_of_leaves(self.tree, self.cell))
        truth = self._geometry(forms.values[0].keys)
        covered = truth.alpha > 0
        if covered.mean() < LEAST_SHARE:
            return
        # Round a cell, and through its holes, there are its neighbours in the whole picture, which look much the same.
        mean = np.average(truth.color.reshape(-1, 3), axis=0, weights=truth.alpha.ravel())
        true = truth.pixels(mean)
        empty = self._empty().develop(LIGHT).pixels(LIGHT.backdrop(self.camera, SIZE))
        nothing = float(flip_map(true, empty)[covered].mean())
        told = 1 - self.tree.errors_at(forms.errors, np.full((len(forms.values), 1), self.metres))[:, 0]
        kinds = ((f"form {n}", float(told[n]), self._geometry(forms.values[n].keys)) for n in range(1, count))
        for kind, accuracy, picture in itertools.chain(kinds, self._merged(), self._pictures()):
            shown = picture.pixels(mean)
            measured = 1 - float(flip_map(true, shown)[covered].mean()) / nothing
            row = self.tree.entries[self.cell].key, kind, self.width, self.side, accuracy, measured
            yield Row(self.scene, *row, float(psnr(true, shown)))

    def _pictures(self) -> Iterator[tuple[str, float, Picture]]:
        """Of the cell, then of those above it, cut off at its box."""
        tree, cell, up = self.tree, self.cell, 0
        told = float(picture_accuracy(tree.told[cell], tree.errors[cell] / self.metres))
        while cell != NONE and up <= ABOVE:
            yield f"picture+{up}", told, self._splatted(tree.entries[cell].cell)
            above = int(tree.parents[cell])
            told *= 1 - float(loss_from(tree.losses[cell], tree.errors[above] / self.metres))
            cell, up = above, up + 1

    def _merged(self) -> Iterator[tuple[str, float, Picture]]:
        """By its BlockMap, and geometry of its own with the instances in it in full, which that does not show."""
        tree, entry = self.tree, self.tree.entries[self.cell]
        forms = tree.merged(self.cell)
        for n, (form, value, errors) in enumerate(zip(own_forms(entry), forms.values, forms.errors, strict=True)):
            told = merged_accuracy(errors, tree.errors[self.cell], np.full((1, 1), self.metres))
            drawing = self._drawing()
            parts = [MergedPart(entry, form, leaf.cell, np.zeros(3)) for leaf in self._leaves()]
            drawing.reader.draw_merged(parts, drawing.batches, set(value.keys))
            is_map = isinstance(form, BlockMapEntry)
            if not is_map:
                for leaf in self._leaves():
                    drawing.reader.draw_placed(leaf, drawing.batches)
            drawing.batches.flush()
            BlockMapPass(self.world, drawing.frame, LIGHT).draw(drawing.reader.maps)
            yield "blockmap" if is_map else f"merged {n}", float(told[0, 0]), drawing.frame.develop(LIGHT)

    def _leaves(self) -> list[CellEntry]:
        return [self.tree.entries[leaf] for leaf in self.tree.leaves_below(self.cell)]

    def _geometry(self, held: Iterable[str]) -> Picture:
        """The leaves alone: what is held of their meshes shows in their neighbours too."""
        drawing = self._drawing()
        drawing.reader.draw(map(ShownForm, self._leaves()), drawing.batches, set(held))
        return drawing.frame.develop(LIGHT)

    def _drawing(self) -> _Drawing:
        frame = self._empty()
        return _Drawing(frame, NearGeometry(self.world, np.array(self.camera.eye)), Batches(GeometryPass(frame, LIGHT)))

    def _splatted(self, key: CellKey) -> Picture:
        frame, grid = self._empty(), self.world.grid
        places = chosen_tiles(self.world, self.world.entry(key), np.array(self.camera.eye), RenderOptions())
        box = None if key == self.tree.entries[self.cell].cell else grid.bounds(self.tree.entries[self.cell].cell)
        for place, layer in zip(places, self.cache.layers(Wanted(key, places), False), strict=True):
            direction = self.world.manifest.direction_by_number[place[0]]
            frame.splat(layer, direction, grid, key.level, LIGHT, box)
        return frame.develop(LIGHT)

    def _empty(self) -> Frame:
        return Frame.empty(self.camera, SIZE, SAMPLES)


def main() -> None:
    """The command line."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("scenes", nargs="*", default=list(SCENES))
    parser.add_argument("--cells", type=int, default=3)
    parser.add_argument("--rows", type=Path)
    given = parser.parse_args()
    print(json.dumps(figures(given.scenes, given.cells, given.rows), indent=1))


if __name__ == "__main__":
    main()
