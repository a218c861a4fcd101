"""Trees made by rule: branching limbs, and leaves on small masked cards."""

from __future__ import annotations

from dataclasses import dataclass
from functools import lru_cache

import numpy as np
from numpy.typing import NDArray

from farfield.geometry.color import linear_from_srgb
from farfield.scene.cleaning import RawSurface, assemble, merge
from farfield.scene.model import Material, Mesh, Texture


@dataclass(frozen=True, slots=True)
class TreeShape:
    """How a kind of tree grows."""

    name: str
    height: float
    """Metres."""
    spread: float
    """How far limbs lean from their parent, radians."""
    first: int
    """Limbs that leave the trunk."""
    children: int
    """Limbs that leave each other limb."""
    depth: int
    """Times limbs part."""
    leaf: float
    """Side of a leaf card, metres."""
    leaf_color: tuple[int, int, int]
    trunk: float
    """Length of the trunk, as a fraction of the height."""
    bare: float
    """Part of the trunk without limbs."""
    droop: float = 0.0
    """How strongly limbs turn down (negative: up) over their length."""
    conical: bool = False
    """Limbs leave the whole trunk, shorter towards its top."""


SHAPES = (
    TreeShape("broadleaf", 15.0, 0.85, 11, 4, 4, 0.60, (88, 116, 52), 0.62, 0.40, -0.05),
    TreeShape("slender", 20.0, 0.55, 16, 4, 4, 0.50, (112, 134, 66), 0.85, 0.30, -0.1),
    TreeShape("conifer", 19.0, 1.35, 36, 7, 3, 0.60, (48, 84, 56), 0.92, 0.15, 0.25, True),
)
SIDES = 5
"""Sides of a limb's cross-section."""
BARK = (96, 82, 68)


def tree(shape: TreeShape, triangles: int, seed: int) -> Mesh:
    """A tree of about `triangles` triangles, standing on z = 0: limbs first, leaves with what remains."""
    random = np.random.default_rng(seed)
    limbs = _grow(shape, random)
    wood = _wood(limbs)
    count = max((triangles - len(wood.triangles)) // 2, 8)
    return merge([wood, _leaves(shape, limbs, count, random)])


@dataclass(frozen=True, slots=True, eq=False)
class _Limbs:
    start: NDArray[np.float64]
    end: NDArray[np.float64]
    thick: NDArray[np.float64]
    """(n, 2) radius at both ends."""
    last: NDArray[np.bool_]
    """Bears leaves."""


def _grow(shape: TreeShape, random: np.random.Generator) -> _Limbs:
    """Level by level: every limb parts into children that lean away from it."""
    up = np.array([[0.0, 0.0, 1.0]])
    levels = [(np.zeros((1, 3)), up * shape.height * shape.trunk, np.array([[0.018, 0.006]]))]
    for level in range(1, shape.depth):
        start, along, thick = levels[-1]
        parent = np.repeat(np.arange(len(start)), shape.first if level == 1 else shape.children)
        place = random.uniform(shape.bare if level == 1 else 0.3, 1.0, len(parent))
        length = np.linalg.norm(along[parent], axis=1)
        direction = _leaning(along[parent] / length[:, None], shape.spread, random)
        direction[:, 2] -= shape.droop
        direction /= np.linalg.norm(direction, axis=1, keepdims=True)
        if level == 1:
            reach = shape.height * (0.26 * (1.08 - place) if shape.conical else 0.30 * (1.25 - 0.6 * place))
            reach = reach * random.uniform(0.8, 1.1, len(parent))
        else:
            reach = length * random.uniform(0.4, 0.7, len(parent))
        radius = thick[parent, 0] + (thick[parent, 1] - thick[parent, 0]) * place
        origin = start[parent] + along[parent] * place[:, None]
        drop = np.maximum(-direction[:, 2], 1e-9)
        reach = np.minimum(reach, 0.9 * origin[:, 2] / drop)
        levels.append((origin, direction * reach[:, None], np.stack([radius * 0.6, radius * 0.25], -1)))
    start, along, thick = (np.concatenate(part) for part in zip(*levels, strict=True))
    last = np.concatenate([np.full(len(level[0]), k >= max(shape.depth - 2, 1)) for k, level in enumerate(levels)])
    return _Limbs(start, start + along, thick * shape.height, last)


def _leaning(direction: NDArray[np.float64], angle: float, random: np.random.Generator) -> NDArray[np.float64]:
    """(n, 3) unit vectors about `angle` away from the given ones, to all sides."""
    side = random.standard_normal(direction.shape)
    side -= (side * direction).sum(1, keepdims=True) * direction
    side /= np.linalg.norm(side, axis=1, keepdims=True)
    lean = angle * random.uniform(0.7, 1.3, len(direction))[:, None]
    return np.asarray(np.cos(lean) * direction + np.sin(lean) * side)


def _wood(limbs: _Limbs) -> Mesh:
    """Tapered tubes."""
    along = limbs.end - limbs.start
    across = np.cross(along, np.where(np.abs(along[:, 2:]) < 0.9 * np.linalg.norm(along, axis=1)[:, None],
                                      [[0.0, 0, 1]], [[1.0, 0, 0]]))  # fmt: skip
    across /= np.linalg.norm(across, axis=1, keepdims=True)
    other = np.cross(along / np.linalg.norm(along, axis=1, keepdims=True), across)
    angle = np.arange(SIDES) * (2 * np.pi / SIDES)
    ring = across[:, None] * np.cos(angle)[:, None] + other[:, None] * np.sin(angle)[:, None]
    low = limbs.start[:, None] + ring * limbs.thick[:, 0, None, None]
    high = limbs.end[:, None] + ring * limbs.thick[:, 1, None, None]
    points = np.concatenate([low, high], 1).reshape(-1, 3)
    k = np.arange(SIDES)
    n = (k + 1) % SIDES
    tube = np.concatenate([np.stack([k, n, n + SIDES], -1), np.stack([k, n + SIDES, k + SIDES], -1)])
    faces = (tube[None] + np.arange(len(along))[:, None, None] * 2 * SIDES).reshape(-1, 3)
    normals = np.repeat(ring[:, None], 2, 1).reshape(-1, 3)
    bark = Material("bark", _linear(BARK), double_sided=False)
    return assemble(RawSurface(points, faces, normals=normals, materials=(bark,)), "tree")


def _leaves(shape: TreeShape, limbs: _Limbs, count: int, random: np.random.Generator) -> Mesh:
    """Cards along the last limbs, turned at random; their normals point out of the crown, so that it shades as one."""
    bearing = np.flatnonzero(limbs.last)
    length = np.linalg.norm(limbs.end[bearing] - limbs.start[bearing], axis=1)
    chosen = bearing[random.choice(len(bearing), count, p=length / length.sum())]
    place = random.uniform(0.25, 1.05, (count, 1))
    center = limbs.start[chosen] + (limbs.end[chosen] - limbs.start[chosen]) * place
    center += random.standard_normal((count, 3)) * 0.22 * shape.leaf
    center[:, 2] = np.maximum(center[:, 2], shape.leaf)
    a = random.standard_normal((count, 3))
    a /= np.linalg.norm(a, axis=1, keepdims=True)
    b = np.cross(a, random.standard_normal((count, 3)))
    b /= np.linalg.norm(b, axis=1, keepdims=True)
    half = 0.5 * shape.leaf * random.uniform(0.75, 1.25, (count, 1))
    corners = np.stack([center - a * half - b * half, center + a * half - b * half,
                        center + a * half + b * half, center - a * half + b * half], 1)  # fmt: skip
    middle = np.array([0, 0, center[:, 2].mean()])
    normals = np.repeat(center - middle + 0.3 * shape.height * a * np.sign(a[:, 2:]), 4, 0)
    quad = np.array([[0, 1, 2], [0, 2, 3]])
    faces = (quad[None] + np.arange(count)[:, None, None] * 4).reshape(-1, 3)
    uvs = np.tile(np.array([[0, 1], [1, 1], [1, 0], [0, 0]], np.float32), (count, 1))
    colors = np.full((count, 4), 255, np.uint8)
    colors[:, :3] = random.uniform(205, 255, (count, 1)).astype(np.uint8)
    leaf = Material(shape.name, _linear(shape.leaf_color), leaf_texture(), 0.5, True)
    raw = RawSurface(corners.reshape(-1, 3), faces, normals=normals, uvs=uvs, colors=np.repeat(colors, 4, 0),
                     materials=(leaf,))  # fmt: skip
    return assemble(raw, "tree")


@lru_cache(maxsize=1)
def leaf_texture() -> Texture:
    """(128, 128) sprig of a dozen leaves with alpha, grey, so that the material colours it."""
    size = 128
    y, x = np.mgrid[:size, :size] / size - 0.5
    pixels = np.zeros((size, size, 4), np.uint8)
    pixels[..., :3] = 215
    random = np.random.default_rng(5)
    for k in range(13):
        angle = random.uniform(0, 2 * np.pi)
        cx, cy = 0.34 * np.array([np.cos(angle), np.sin(angle)]) * random.uniform(0.1, 1.0)
        turn = angle + random.uniform(-0.6, 0.6)
        u = (x - cx) * np.cos(turn) + (y - cy) * np.sin(turn)
        v = (y - cy) * np.cos(turn) - (x - cx) * np.sin(turn)
        inside = (u / 0.17) ** 2 + (v / 0.075) ** 2 * (1 + 2.2 * (u / 0.17 + 0.3) ** 2) < 1
        pixels[inside, :3] = int(190 + 4.5 * k)
        pixels[inside & (np.abs(v) < 0.008), :3] = 250
        pixels[inside, 3] = 255
    return Texture(pixels)


def _linear(srgb: tuple[int, int, int]) -> tuple[float, float, float, float]:
    red, green, blue = linear_from_srgb(np.array(srgb) / 255.0).tolist()
    return red, green, blue, 1.0
