"""Towns of prisms of which every height is known, and how far a point is from their surface."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import trimesh
from numpy.typing import ArrayLike, NDArray

from farfield.represent.blockmap.blockmap import BlockMap
from farfield.represent.blockmap.build import Square
from farfield.represent.chunk import Chunk
from farfield.represent.materials import MaterialTable
from farfield.scene.model import Material

Floats = NDArray[np.float64]
SQUARE = Square(128.0, 96.0, 64.0)
WHITE = MaterialTable.build([Material("", (1.0, 1.0, 1.0, 1.0))])
GROUND = (60, 110, 40)
"""sRGB."""
_UNIT = np.array([[-1, -1], [1, -1], [1, 1], [-1, 1]]) / 2


@dataclass(frozen=True, slots=True)
class House:
    """A right-angled prism with a gable, or a flat roof when its ridge is as high as its eaves."""

    middle: tuple[float, float]
    size: tuple[float, float]
    eaves: float
    """Metres."""
    ridge: float = 0.0
    """Along its own x."""
    turn: float = 0.0
    """Radians."""
    color: tuple[int, int, int] = (200, 60, 30)
    """sRGB of its walls; roofs are brighter by 40."""

    @property
    def foot(self) -> Floats:
        """(4, 2) counter-clockwise."""
        return self.placed(_UNIT * self.size)

    def placed(self, own: Floats) -> Floats:
        """(n, 2) of its own frame -> metres."""
        c, s = np.cos(self.turn), np.sin(self.turn)
        return np.asarray(own @ np.array([[c, s], [-s, c]]) + self.middle)

    def height(self, points: Floats) -> Floats:
        """(n, 2) metres -> (n,) of its roof; -inf beside it."""
        c, s = np.cos(self.turn), np.sin(self.turn)
        own = (points - self.middle) @ np.array([[c, -s], [s, c]])
        half = np.array(self.size) / 2
        up = max(self.ridge - self.eaves, 0.0) * (1 - np.abs(own[:, 1]) / half[1])
        return np.where((np.abs(own) <= half).all(axis=1), self.eaves + up, -np.inf)

    def faces(self, low: float, high: float) -> tuple[list[Floats], list[Floats]]:
        """Triangles of its walls, and of its roof, from `low` up; what is above `high` is left out of flat ones."""
        foot, top = self.foot, min(self.eaves, high)
        walls: list[Floats] = []
        for a, b in zip(foot, np.roll(foot, -1, axis=0), strict=True):
            walls += _quad([*a, low], [*b, low], [*b, top], [*a, top])
        if self.eaves > high:
            return walls, []
        a, b, c, d = (np.array([*corner, self.eaves]) for corner in foot)
        if self.ridge <= self.eaves:
            return walls, _quad(a, b, c, d)
        west, east = (np.array([*(one[:2] + two[:2]) / 2, self.ridge]) for one, two in ((a, d), (b, c)))
        walls += [np.stack([b, c, east]), np.stack([d, a, west])]
        return walls, [*_quad(a, b, east, west), *_quad(c, d, west, east)]


def _quad(a: ArrayLike, b: ArrayLike, c: ArrayLike, d: ArrayLike) -> list[Floats]:
    a, b, c, d = (np.asarray(corner, np.float64) for corner in (a, b, c, d))
    return [np.stack([a, b, c]), np.stack([a, c, d])]


def chunk_of(houses: list[House], square: Square = SQUARE, ground: float | None = 0.0) -> Chunk:
    """The ground is object 1 and reaches to the ends of the square, house n (from 0) is object n + 2.

    ground: metres, of a plane; None: there is none, and walls go down to 0.
    """
    faces: list[Floats] = []
    colors: list[tuple[int, ...]] = []
    objects: list[int] = []
    low = 0.0 if ground is None else ground
    if ground is not None:
        (w, d), z = (square.width, square.depth), ground
        faces += _quad([0, 0, z], [w, 0, z], [w, d, z], [0, d, z])
        colors, objects = [GROUND] * 2, [1] * 2
    for number, house in enumerate(houses):
        walls, roof = house.faces(low, square.height)
        faces += walls + roof
        bright = tuple(min(channel + 40, 255) for channel in house.color)
        colors += [house.color] * len(walls) + [bright] * len(roof)
        objects += [number + 2] * (len(walls) + len(roof))
    corners = np.array(faces)
    normals = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    normals /= np.linalg.norm(normals, axis=1, keepdims=True)
    alpha = np.full((len(faces), 1), 255)
    return Chunk(
        corners.reshape(-1, 3).astype(np.float32),
        normals.repeat(3, axis=0).astype(np.float32),
        np.empty((0, 2), np.float32),
        np.concatenate([np.array(colors), alpha], axis=1).repeat(3, axis=0).astype(np.uint8),
        np.arange(3 * len(faces), dtype=np.uint32).reshape(-1, 3),
        np.zeros(len(faces), np.uint32),
        np.array(objects, np.uint32),
    )


def random_town(seed: int, gables: bool, count: int = 14, smallest: float = 5.0) -> list[House]:
    """Houses that do not meet, all within the square."""
    random = np.random.default_rng(seed)
    houses: list[House] = []
    while len(houses) < count:
        size = tuple(random.uniform(smallest, 30, 2).tolist())
        middle = tuple(random.uniform([0, 0], [SQUARE.width, SQUARE.depth]).tolist())
        reach = float(np.hypot(*size)) / 2 + 0.5
        inside = reach + 5 < min(middle[0], middle[1], SQUARE.width - middle[0], SQUARE.depth - middle[1])
        apart = all(np.hypot(*np.subtract(middle, one.middle)) > reach + np.hypot(*one.size) / 2 for one in houses)
        if inside and apart:
            eaves = float(3 + 40 * random.random() ** 3)
            ridge = eaves + size[1] / 2 * random.uniform(0.2, 1.4) if gables else 0.0
            houses.append(House(middle, size, eaves, ridge, float(random.uniform(0, np.pi))))
        count -= random.random() < 0.01
    return houses


def distances(points: Floats, houses: list[House]) -> Floats:
    """(n, 3) points -> (n,) metres to the surface of ground at height 0 and the houses on it, exact."""
    found = np.abs(points[:, 2])
    for house in houses:
        # Below a house there is no ground to be near to, but for the foot of its walls.
        found[house.height(points[:, :2]) > -np.inf] = np.inf
    triangles = np.array([face for house in houses for part in house.faces(0.0, np.inf) for face in part])
    lower, upper = triangles.min(axis=1), triangles.max(axis=1)
    for begin in range(0, len(points), 2000):
        part = points[begin : begin + 2000]
        gap = np.maximum(np.maximum(lower - part[:, None], part[:, None] - upper), 0.0)
        may_be = np.nonzero(np.linalg.norm(gap, axis=2) < np.minimum(found[begin : begin + 2000], 20.0)[:, None])
        nearest = trimesh.triangles.closest_point(triangles[may_be[1]], part[may_be[0]])
        away = np.linalg.norm(nearest - part[may_be[0]], axis=1)
        np.minimum.at(found, begin + may_be[0], away)
    return found


def surface_of(blockmap: BlockMap, width: float, depth: float, each: int = 5) -> Floats:
    """(k, 3) points of a map's tops and of its sides within, so many along each edge of a texel, ends included."""
    n = blockmap.size.side
    texel = np.array([width, depth]) / n
    slopes = np.zeros((n, n, 2)) if blockmap.slopes is None else blockmap.slopes / 32
    heights = blockmap.heights.astype(np.float64)
    at = np.linspace(-0.5, 0.5, each)

    def plane(j: NDArray[np.int64], i: NDArray[np.int64], x: Floats, y: Floats) -> Floats:
        """Height of a texel's top, x and y in texels from its middle."""
        return np.asarray(heights[j, i] + slopes[j, i, 0] * x * texel[0] + slopes[j, i, 1] * y * texel[1])

    j, i, y, x = (grid.ravel() for grid in np.meshgrid(np.arange(n), np.arange(n), at, at, indexing="ij"))
    j, i = j.astype(int), i.astype(int)
    points = [np.stack([(i + 0.5 + x) * texel[0], (j + 0.5 + y) * texel[1], plane(j, i, x, y)], axis=1)]
    for axis in range(2):
        rows, columns = n - axis, n - 1 + axis
        grids = np.meshgrid(np.arange(rows), np.arange(columns), at, np.linspace(0, 1, 9), indexing="ij")
        j, i, s, u = (grid.ravel() for grid in grids)
        j, i, half = j.astype(int), i.astype(int), np.full(len(s), 0.5)
        if axis == 0:
            one, other = plane(j, i, half, s), plane(j, i + 1, -half, s)
            x, y = i + 1.0, j + 0.5 + s
        else:
            one, other = plane(j, i, s, half), plane(j + 1, i, s, -half)
            x, y = i + 0.5 + s, j + 1.0
        steep = np.abs(one - other) > 1e-3
        points.append(np.stack([x * texel[0], y * texel[1], one + u * (other - one)], axis=1)[steep])
    found = np.concatenate(points)
    return found[np.isfinite(found[:, 2])]
