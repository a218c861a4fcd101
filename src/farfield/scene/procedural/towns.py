"""Towns: a turned grid of streets, blocks of lots, higher buildings towards the middle."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import shapely
from numpy.typing import NDArray

from farfield.scene.procedural.land import Land

BLOCK, STREET = (62.0, 40.0), 12.0
"""Metres: a block, and the streets round it."""


def footprints(land: Land, seed: int) -> tuple[NDArray[np.object_], NDArray[np.float64], NDArray[np.float64]]:
    """Polygons, heights above ground and altitudes of the ground of all buildings of all towns."""
    random = np.random.default_rng(seed)
    shapes: list[shapely.Polygon] = []
    heights: list[float] = []
    for x, y, radius in land.towns:
        angle = random.uniform(0, 90)
        for shape, height in _town(radius, random):
            shapes.append(shapely.affinity.translate(shapely.affinity.rotate(shape, angle, (0, 0)), x, y))
            heights.append(height)
    grounds = [float(land.height_at(np.asarray(shape.exterior.coords)).min()) - 0.3 for shape in shapes]
    return np.array(shapes, object), np.array(heights), np.array(grounds)


def write_footprints(
    path: Path, shapes: NDArray[np.object_], heights: NDArray[np.float64], grounds: NDArray[np.float64]
) -> None:
    """FlatGeobuf with the attributes `height` and `ground`, in local metres."""
    import warnings

    import pyogrio

    with warnings.catch_warnings():
        # Local metres have no coordinate reference system, and none is wanted.
        warnings.filterwarnings("ignore", message="'crs' was not provided")
        pyogrio.raw.write(
            path, shapely.to_wkb(shapes), [heights + 0.3, grounds], ["height", "ground"],
            driver="FlatGeobuf", geometry_type="Polygon", SPATIAL_INDEX="NO",
        )  # fmt: skip


def _town(radius: float, random: np.random.Generator) -> list[tuple[shapely.Polygon, float]]:
    """Buildings round (0, 0), blocks cut off at the radius."""
    pitch = np.array(BLOCK) + STREET
    reach = np.ceil(radius / pitch).astype(int)
    found: list[tuple[shapely.Polygon, float]] = []
    for i in range(-reach[0], reach[0] + 1):
        for j in range(-reach[1], reach[1] + 1):
            center = np.array([i, j]) * pitch
            distance = np.hypot(*center) / radius
            if distance < 0.92 and random.random() > 0.06:
                found += _block(center - np.array(BLOCK) / 2, distance, random)
    return found


def _block(
    low: NDArray[np.float64], distance: float, random: np.random.Generator
) -> list[tuple[shapely.Polygon, float]]:
    """One large building with a courtyard, or two rows of lots."""
    if distance < 0.45 and random.random() < 0.3:
        inset = random.uniform(1, 4)
        outer = shapely.box(*(low + inset), *(low + np.array(BLOCK) - inset))
        yard = outer.buffer(-random.uniform(11, 14), join_style="mitre")
        return [(outer.difference(yard), _height(distance, random))]
    found = []
    columns = int(random.integers(3, 6))
    width, depth = BLOCK[0] / columns, BLOCK[1] / 2
    for column in range(columns):
        for row in range(2):
            if random.random() < 0.08:
                continue
            x, y = low[0] + column * width, low[1] + row * depth
            front = random.uniform(0, 3)
            x0, x1 = x + random.uniform(0, 1.5), x + width - random.uniform(0, 1.5)
            back = random.uniform(3, 8)
            y0, y1 = (y + front, y + depth - back) if row == 0 else (y + back, y + depth - front)
            found.append((shapely.box(x0, y0, x1, y1), _height(distance, random)))
    return found


def _height(distance: float, random: np.random.Generator) -> float:
    """Whole floors of 3.6 m: towers in the middle, houses at the edge."""
    floors = 1 + random.exponential(1.2) + 9 * max(0.0, 1 - 1.6 * distance) * random.uniform(0.4, 1.6)
    return float(3.6 * min(round(floors), 30) or 3.6)
