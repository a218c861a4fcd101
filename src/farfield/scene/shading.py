"""Normals for meshes that have none: weighted by area and angle, smooth, but faceted across sharp edges."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

CREASE_COSINE = 0.766
"""Facets that meet at more than 40 degrees are not smoothed into each other (a box stays a box)."""

HALF_CREASE_COSINE = 0.9397
"""Where every facet is within 20 degrees of the mean no two are 40 apart: nothing to look at more closely."""

MOST_FACETS = 64
"""About a vertex; where more meet (the tip of a cone) each is compared with their mean only, not with each other."""

SAME_COSINE = 0.9998
"""Normals within one degree are one."""

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


def body_normals(positions: NDArray[np.float64], triangles: NDArray[np.uint32]) -> NDArray[np.float32]:
    """(n, 3) float32: normals of a body that is smooth everywhere."""
    return smooth_normals(positions, triangles, face_vectors(positions, triangles)).astype(np.float32)


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
    """Computes the normals that are missing and splits vertices at sharp edges.

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
    if crease_cosine > 1:
        rows, columns = np.nonzero(missing[triangles])
        own = facets[rows]
    else:
        turned = np.einsum("mkc,mc->mk", smooth[triangles], facets) < HALF_CREASE_COSINE
        creased = np.zeros(count, bool)
        creased[triangles[turned]] = True
        rows, columns = np.nonzero((creased & missing)[triangles])
        own = _creased_normals(positions, vectors, facets, triangles, smooth, rows, columns, crease_cosine)
    vertices = triangles[rows, columns].astype(np.intp)
    apart = (own * smooth[vertices]).sum(1) < (SAME_COSINE if crease_cosine <= 1 else np.inf)
    rows, columns, vertices, own = rows[apart], columns[apart], vertices[apart], own[apart]
    steps = np.round(own * 64).astype(np.int64) + 64
    names = (vertices << 24) | (steps[:, 0] << 16) | (steps[:, 1] << 8) | steps[:, 2]
    _, first, which = np.unique(names, return_index=True, return_inverse=True)
    out = triangles.copy()
    out[rows, columns] = count + which.reshape(-1).astype(np.uint32)
    return out, np.concatenate([np.arange(count), vertices[first]]), np.concatenate([filled, own[first]])


def _creased_normals(
    positions: NDArray[np.float64],
    vectors: NDArray[np.float64],
    facets: NDArray[np.float64],
    triangles: NDArray[np.uint32],
    smooth: NDArray[np.float64],
    rows: NDArray[np.intp],
    columns: NDArray[np.intp],
    crease_cosine: float,
) -> NDArray[np.float64]:
    """(c, 3) float64 unit: for each corner the mean of the facets at its vertex that its own is not creased against.

    rows, columns: (c,) triangle and corner; all corners of a vertex or none.

    The mean of all facets tells too little: at the corners of a flat box it leans so far to the large top that the top
    alone would seem to be smooth.
    """
    order = np.argsort(triangles[rows, columns], kind="stable")
    corner_rows, vertices = rows[order], triangles[rows, columns][order]
    weighted = (
        vectors[corner_rows]
        * corner_angles(positions, triangles[corner_rows])[np.arange(len(order)), columns[order], None]
    )
    starts = np.flatnonzero(np.append(True, vertices[1:] != vertices[:-1]))[: len(order)]
    group = np.diff(np.append(starts, len(order)))
    many = np.repeat(group > MOST_FACETS, group)
    each = np.where(many, 0, np.repeat(group, group))
    one = np.repeat(np.arange(len(order)), each)
    other = np.arange(len(one)) - np.repeat(np.cumsum(each) - each, each) + np.repeat(np.repeat(starts, group), each)
    near = (facets[corner_rows[one]] * facets[corner_rows[other]]).sum(1) >= crease_cosine
    one, other = one[near], other[near]
    sums = np.stack([np.bincount(one, weighted[other, axis], len(order)) for axis in range(3)], 1).astype(np.float64)
    alone = (smooth[vertices] * facets[corner_rows]).sum(1) < crease_cosine
    found = np.where(many[:, None], np.where(alone[:, None], facets[corner_rows], smooth[vertices]), unit(sums))
    normals = np.empty_like(found)
    normals[order] = found
    return normals
