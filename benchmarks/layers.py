"""Orthoview layers made up from formulas: for measuring and testing what comes after drawing, without any input."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
from numpy.typing import NDArray

from farfield.geometry import normals
from farfield.geometry.color import BYTE_OF_LINEAR, LINEAR_OF_BYTE
from farfield.represent.orthoview.layer import DEPTH_STEPS_PER_PIXEL, SEPARATION, OrthoLayer

FAR = np.float32(1e9)
Samples = tuple[NDArray[np.float32], NDArray[np.float32], NDArray[np.uint8]]
"""Depth in pitches, FAR where nothing is (2h, 2w); normal (2h, 2w, 3); sRGB (2h, 2w, 3)."""


def statue(size: int = 512, seed: int = 0) -> list[OrthoLayer]:
    """A smooth, bumpy body that fills half of a view of `size` pixels; one layer."""
    rng = np.random.default_rng(seed)
    y, x = np.mgrid[0 : 2 * size, 0 : 2 * size].astype(np.float32) / (2 * size) - np.float32(0.5)
    height = np.sqrt(np.maximum(0.2 - x * x - y * y, 0))
    for _ in range(12):
        fx, fy, phase = rng.uniform(-40, 40, 3)
        height += np.float32(0.25 / (8 + abs(fx) + abs(fy))) * np.sin(fx * x + fy * y + phase)
    slope_y, slope_x = np.gradient(height * (2 * size))
    normal = np.stack([-slope_x, -slope_y, np.ones_like(height)], -1)
    depth = np.where(x * x + y * y < 0.16, (1 - height) * size, FAR).astype(np.float32)
    color = 170 + 20 * np.sin(30 * height)[..., None] + rng.normal(0, 4, (2 * size, 2 * size, 3))
    return layers_of_samples([(depth, normal.astype(np.float32), np.clip(color, 0, 255).astype(np.uint8))])


def foliage(size: int = 512, seed: int = 0, leaves: int = 4000) -> list[OrthoLayer]:
    """Flat leaves of about 8 pixels in a ball, all directions; two layers."""
    rng = np.random.default_rng(seed)
    near, behind = _empty(size), _empty(size)
    scale = size / 512
    for _ in range(leaves):
        normal = rng.normal(size=3)
        normal[2] = abs(normal[2]) + 0.05
        normal /= np.linalg.norm(normal)
        place = rng.normal(size=3)
        place *= rng.random() ** (1 / 3) / np.linalg.norm(place)
        color = np.array([70, 110, 40]) + rng.normal(0, 18, 3)
        _leaf(near, behind, (place * 0.45 + 0.5) * size, normal, rng.uniform(6, 12) * scale, color)
    return layers_of_samples([near, behind])


def city(size: int = 512, seed: int = 0, houses: int = 150) -> list[OrthoLayer]:
    """Plane faces with windows, seen obliquely, over a plane ground; two layers."""
    rng = np.random.default_rng(seed)
    near, behind = _empty(size), _empty(size)
    y, x = np.mgrid[0 : 2 * size, 0 : 2 * size].astype(np.float32) / 2
    slope = np.array([0.0, -0.7], np.float32)
    faces = [(np.array([0, 0, size, size]), size * 1.2, slope, np.array([110, 110, 105]))]
    for _ in range(houses):
        left, top = rng.uniform(0, size, 2)
        box = np.array([left, top, left + size * rng.uniform(0.03, 0.12), top + size * rng.uniform(0.03, 0.2)])
        wall = rng.random() < 0.6
        faces.append((box, size * rng.uniform(0.6, 1.1), -slope if wall else slope, rng.uniform(60, 220, 3)))
    for box, start, steep, color in faces:
        inside = (x >= box[0]) & (y >= box[1]) & (x < box[2]) & (y < box[3])
        depth = np.where(inside, start + steep[0] * x + steep[1] * y, FAR).astype(np.float32)
        normal = np.array([-steep[0], -steep[1], 1.0]) / np.sqrt(1 + float(steep @ steep))
        windows = ((x % 12 < 6) & (y % 10 < 5))[..., None] & (steep[1] > 0)
        _nearest(near, behind, depth, normal, np.where(windows, color * 0.3, color))
    return layers_of_samples([near, behind])


SUBJECTS: dict[str, Callable[..., list[OrthoLayer]]] = {"statue": statue, "foliage": foliage, "city": city}


def canopy(cover: float, slab: float, size: int = 256, seed: int = 0, ground: float = 0.0) -> list[OrthoLayer]:
    """Every sample is covered with probability `cover`, at a random depth in `slab` pitches; two layers.

    ground: pitches from the top of the slab down to a full ground; 0 = none.
    """
    rng = np.random.default_rng(seed)
    shape = (2 * size, 2 * size)
    covered = rng.random(shape) < cover
    under = np.full(shape, ground + 16 if ground else FAR, np.float32)
    depth = np.where(covered, 16 + slab * rng.random(shape), under).astype(np.float32)
    normal = rng.normal(size=(*shape, 3)).astype(np.float32)
    normal[..., 2] = np.abs(normal[..., 2])
    normal /= np.linalg.norm(normal, axis=-1, keepdims=True)
    color = rng.integers(20, 200, (*shape, 3), dtype=np.uint8)
    hidden = np.where(covered, under, FAR).astype(np.float32)
    return layers_of_samples([(depth, normal, color), (hidden, normal, color)])


def layers_of_samples(surfaces: list[Samples]) -> list[OrthoLayer]:
    """One or two surfaces of 2x2 samples a pixel -> layers, cropped; as many as hold anything.

    The first layer takes the samples within SEPARATION of the pixel's nearest, the second those within SEPARATION of
    the nearest behind, of either surface.
    """
    depths = [_blocks(s[0]) for s in surfaces]
    limit = np.full(depths[0].shape[:2], -FAR, np.float32)
    made = []
    for _ in surfaces:
        behind = [np.where(d > limit[..., None], d, FAR) for d in depths]
        nearest = np.minimum.reduce([b.min(-1) for b in behind])
        limit = nearest + SEPARATION
        seen = np.minimum.reduce(behind)
        which = np.argmin(behind, axis=0)
        counted = (seen < FAR) & (seen <= limit[..., None])
        made.append(_layer(surfaces, seen, which, counted))
    return [layer for layer in made if layer is not None]


def _layer(
    surfaces: list[Samples], depth: NDArray[np.float32], which: NDArray[np.intp], counted: NDArray[np.bool_]
) -> OrthoLayer | None:
    count = counted.sum(-1)
    valid = count > 0
    if not valid.any():
        return None
    weight = counted / np.maximum(count, 1)[..., None]
    normal, color = (
        (np.choose(which[..., None], [_blocks(s[k]) for s in surfaces]), weight[..., None]) for k in (1, 2)
    )
    mean_normal = (normal[0] * normal[1]).sum(2)
    length = np.linalg.norm(mean_normal, axis=-1)
    mean_color = (LINEAR_OF_BYTE[color[0]] * color[1]).sum(2)
    steps = np.floor(np.where(counted, depth, 0).sum(-1) / np.maximum(count, 1) * DEPTH_STEPS_PER_PIXEL + 0.5)
    rows, columns = np.flatnonzero(valid.any(1)), np.flatnonzero(valid.any(0))
    cut = (slice(rows[0], rows[-1] + 1), slice(columns[0], columns[-1] + 1))
    unit = mean_normal / np.maximum(length, 1e-9)[..., None]
    planes = {
        "depth": np.where(valid, steps, 0).astype(np.uint16),
        "color": BYTE_OF_LINEAR[(mean_color * 4095 + 0.5).astype(int)],
        "normal": normals.encode(np.where(valid[..., None], unit, [0, 0, 1])),
        "length": np.clip(np.floor(length * 8 + 0.5), 1, 8).astype(np.uint8),
        "coverage": (count * 4).astype(np.uint8),
        "connected": np.zeros(valid.shape, np.uint8),
    }
    cropped = {name: np.ascontiguousarray(plane[cut]) for name, plane in planes.items()}
    return OrthoLayer(x=int(columns[0]), y=int(rows[0]), depth_base=0, **cropped)


def _blocks(samples: NDArray[np.generic]) -> NDArray[np.generic]:
    """(2h, 2w, ...) -> (h, w, 4, ...)."""
    rows, columns = samples.shape[0] // 2, samples.shape[1] // 2
    split = samples.reshape(rows, 2, columns, 2, *samples.shape[2:])
    return np.moveaxis(split, 2, 1).reshape(rows, columns, 4, *samples.shape[2:])


def _empty(size: int) -> Samples:
    shape = (2 * size, 2 * size)
    return np.full(shape, FAR), np.zeros((*shape, 3), np.float32), np.zeros((*shape, 3), np.uint8)


def _leaf(
    near: Samples, behind: Samples, place: NDArray[np.float64], normal: NDArray[np.float64], radius: float,
    color: NDArray[np.float64],
) -> None:  # fmt: skip
    """Draw a disc; place in pixels, radius in pixels."""
    limit = near[0].shape[0]
    x0, y0 = (max(0, int(2 * (place[k] - radius))) for k in (0, 1))
    x1, y1 = (min(limit, int(2 * (place[k] + radius)) + 1) for k in (0, 1))
    y, x = np.mgrid[y0:y1, x0:x1] / 2
    dx, dy = x - place[0], y - place[1]
    dz = (normal[0] * dx + normal[1] * dy) / normal[2]
    depth = np.where(dx * dx + dy * dy + dz * dz < radius * radius, place[2] + dz + 16, FAR).astype(np.float32)
    window = (slice(y0, y1), slice(x0, x1))
    _nearest(tuple(a[window] for a in near), tuple(a[window] for a in behind), depth, normal, color)


def _nearest(
    near: Samples, behind: Samples, depth: NDArray[np.float32], normal: NDArray[np.float64], color: NDArray[np.float64]
) -> None:
    """Depth test against the two nearest surfaces, the second more than SEPARATION behind the first."""
    first = depth < near[0]
    moves = first & (near[0] > depth + SEPARATION)
    for back, front in zip(behind, near, strict=True):
        back[moves] = front[moves]
    second = ~first & (depth > near[0] + SEPARATION) & (depth < behind[0])
    shaded = np.broadcast_to(np.clip(color, 0, 255).astype(np.uint8), near[2].shape)
    for mask, target in ((first, near), (second, behind)):
        target[0][mask] = depth[mask]
        target[1][mask] = normal
        target[2][mask] = shaded[mask]
