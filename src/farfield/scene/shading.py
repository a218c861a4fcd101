"""Normals for meshes that have none: weighted by area and angle, smooth, but faceted across sharp edges."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

CREASE_COSINE = 0.766
"""A corner turned further than 40 degrees from its vertex's mean keeps the facet's own normal (a cube stays a cube)."""

ALWAYS_FLAT = 2.0
"""A cosine no corner reaches: every facet keeps its own normal, as glTF asks for."""


def face_vectors(positions: NDArray[np.float64], triangles: NDArray[np.uint32]) -> NDArray[np.float64]:
    """(m, 3) float64: normal of each triangle, its length twice the area."""
    a = positions[triangles[:, 0]]
    vectors: NDArray[np.float64] = np.cross(positions[triangles[:, 1]] - a, positions[triangles[:, 2]] - a)
    return vectors


def unit(vectors: NDArray[np.float64]) -> NDArray[np.float64]:
    """Rows scaled to length 1; rows of length 0 stay 0."""
    length = np.sqrt((vectors * vectors).sum(-1, keepdims=True))
    scaled: NDArray[np.float64] = np.divide(vectors, length, out=np.zeros_like(vectors), where=length > 0)
    return scaled


def smooth_normals(
    positions: NDArray[np.float64], triangles: NDArray[np.uint32], vectors: NDArray[np.float64]
) -> NDArray[np.float64]:
    """(n, 3) float64: mean of the facets at each vertex by area times angle there, unit or 0.

    Area alone would lean a cube's corners towards the faces whose diagonal ends there.
    """
    weighted = vectors * corner_angles(positions, triangles).T[:, :, None]
    flat, corners = weighted.reshape(-1, 3), triangles.T.ravel()
    sums = [np.bincount(corners, flat[:, axis], len(positions)) for axis in range(3)]
    return unit(np.stack(sums, -1).astype(np.float64))


def corner_angles(positions: NDArray[np.float64], triangles: NDArray[np.uint32]) -> NDArray[np.float64]:
    """(m, 3) float64: angle at each corner, radians."""
    corners = positions[triangles]
    forward = unit(np.roll(corners, -1, axis=1) - corners)
    cosine = -(forward * np.roll(forward, 1, axis=1)).sum(-1)
    return np.asarray(np.arccos(np.clip(cosine, -1, 1)))


def fill_normals(
    positions: NDArray[np.float64],
    vectors: NDArray[np.float64],
    triangles: NDArray[np.uint32],
    normals: NDArray[np.float64],
    crease_cosine: float = CREASE_COSINE,
) -> tuple[NDArray[np.uint32], NDArray[np.intp], NDArray[np.float64]]:
    """Computes the normals that are missing and splits vertices where a facet must keep its own.

    vectors: (m, 3), as `face_vectors` gives them, none zero. normals: (n, 3), rows of NaN where missing.
    Returns triangles (m, 3), the old vertex of every new one (n',), and normals (n', 3) unit.
    """
    count = len(normals)
    missing = np.isnan(normals[:, 0])
    if not missing.any():
        return triangles, np.arange(count), normals
    smooth = smooth_normals(positions, triangles, vectors)
    filled = np.where(missing[:, None], smooth, normals)
    facets = unit(vectors)
    cosine = np.einsum("mkc,mc->mk", smooth[triangles], facets)
    split = missing[triangles] & (cosine < crease_cosine)
    rows, corners = np.nonzero(split)
    out = triangles.copy()
    out[rows, corners] = count + np.arange(len(rows), dtype=np.uint32)
    source = np.concatenate([np.arange(count), triangles[rows, corners].astype(np.intp)])
    return out, source, np.concatenate([filled, facets[rows]])
