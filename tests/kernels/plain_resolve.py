"""The plain twin of kernels.resolve: every sample shaded by itself, in double precision; no textures."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from farfield.geometry.color import LINEAR_OF_BYTE
from farfield.kernels.surface import FAR, Materials, Surface


def weights(corners: NDArray[np.float64], x: float, y: float) -> NDArray[np.float64]:
    """Weights of three corners (x, y) at a point."""
    return np.linalg.solve(np.vstack([corners[:, :2].T, np.ones(3)]), [x, y, 1.0])


def resolve(
    screen: NDArray[np.float32],
    surface: Surface,
    materials: Materials,
    axes: NDArray[np.float32],
    samples: int,
    separation: float,
    depth: NDArray[np.float32],
    ids: NDArray[np.uint32],
) -> NDArray[np.float64]:
    """(h, w, 9) float64 as kernels.resolve describes its `pixels`."""
    height, width = depth.shape[0] // samples, depth.shape[1] // samples
    pixels = np.zeros((height, width, 9))
    for row in range(height):
        for column in range(width):
            place = [(row * samples + j, column * samples + i) for j in range(samples) for i in range(samples)]
            nearest = min(depth[p] for p in place)
            if nearest >= FAR:
                pixels[row, column, 0] = FAR
                continue
            chosen = [p for p in place if depth[p] <= np.float32(nearest + np.float32(separation))]
            shaded = [shade(screen, surface, materials, axes, int(ids[p]), p) for p in chosen]
            pixels[row, column, 0] = np.mean([depth[p] for p in chosen], dtype=np.float64)
            pixels[row, column, 1] = len(chosen) / samples**2
            pixels[row, column, 2:] = np.mean(shaded, axis=0)
    return pixels


def shade(
    screen: NDArray[np.float32],
    surface: Surface,
    materials: Materials,
    axes: NDArray[np.float32],
    t: int,
    place: tuple[int, int],
) -> NDArray[np.float64]:
    """(7,) unlit, linear colour, normal in the frame (u, v, -w)."""
    corners = surface.triangles[t]
    share = weights(screen[corners].astype(np.float64), place[1] + 0.5, place[0] + 0.5)
    material = int(surface.materials[t])
    color = materials.base_color[material, :3].astype(np.float64)
    if len(surface.colors):
        color = color * (share @ LINEAR_OF_BYTE[surface.colors[corners, :3]])
    normal = share @ surface.normals[corners].astype(np.float64)
    normal /= np.linalg.norm(normal)
    p = surface.positions[corners].astype(np.float64)
    across = np.cross(p[1] - p[0], p[2] - p[0])
    if (across @ -axes[2]) * (across @ normal) < 0:
        normal = -normal
    return np.concatenate([[float(materials.unlit[material])], color, axes @ normal * [1, 1, -1]])
