"""Faces with holes as triangles, each face in the plane that it lies most in."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from farfield.scene.footprints.rings import next_in_ring, starts_of
from farfield.scene.shading import unit
from farfield.scene.surfaces.clipping import flat_triangles

SMALLEST = 1e-6
"""Square metres; smaller faces are none."""
_FLAT = 1e-9
"""Area over the longest side squared; below it a face is a line."""
_ONE_TURN = 3 * np.pi


@dataclass(frozen=True, slots=True, eq=False)
class Triangles:
    """What faces became."""

    corners: NDArray[np.int64]
    """(m, 3) places in the corners of the faces, turning as the face does."""
    face: NDArray[np.int64]
    """(m,) ascending."""
    normal: NDArray[np.float64]
    """(f, 3) unit, of each face as a whole; 0 for one without area."""
    dropped: int
    """Faces without area."""


@dataclass(frozen=True, slots=True, eq=False)
class _Outlines:
    """Rings without repeated points."""

    at: NDArray[np.int64]
    """(k,) places in the corners."""
    points: NDArray[np.float64]
    """(k, 3)."""
    ring_start: NDArray[np.int64]
    face_start: NDArray[np.int64]
    """(g + 1,) into rings."""
    face: NDArray[np.int64]
    """(g,) faces that are left."""
    face_of: NDArray[np.int64]
    """(k,) row of `face` that a corner belongs to."""
    outer: NDArray[np.bool_]
    """(k,) whether it is in an outer ring."""


def triangulate(places: NDArray[np.float64], ring_start: NDArray[np.int64], face_start: NDArray[np.int64]) -> Triangles:
    """Triangles of faces that need not be plane; places: (c, 3) of the corners."""
    outlines = _without_repeats(places, ring_start, face_start)
    vectors = _vectors(outlines)
    normal = np.zeros((len(face_start) - 1, 3))
    solid = _solid(outlines, vectors)
    normal[outlines.face[solid]] = unit(vectors[solid])
    flat = _flattened(outlines, vectors)
    convex = _convex(outlines, flat) & solid
    corners = flat_triangles(flat, outlines.ring_start, outlines.face_start, convex, solid & ~convex)
    corners = corners[np.argsort(outlines.face_of[corners[:, 0]], kind="stable")]
    face = outlines.face[outlines.face_of[corners[:, 0]]]
    return Triangles(outlines.at[corners], face, normal, len(normal) - len(np.unique(face)))


def _without_repeats(
    places: NDArray[np.float64], ring_start: NDArray[np.int64], face_start: NDArray[np.int64]
) -> _Outlines:
    """Points that equal the next of their ring go, then rings of fewer than three, and faces without an outer one."""
    rings, faces = len(ring_start) - 1, len(face_start) - 1
    ring_of = np.repeat(np.arange(rings), np.diff(ring_start))
    face_of_ring = np.repeat(np.arange(faces), np.diff(face_start))
    keep = (places != places[next_in_ring(ring_start)]).any(1) if len(places) else np.zeros(0, bool)
    ring_good = np.bincount(ring_of[keep], minlength=rings) >= 3
    face_good = ring_good[face_start[:-1]]
    ring_good &= face_good[face_of_ring]
    keep &= ring_good[ring_of]
    at = np.flatnonzero(keep)
    sizes = np.bincount(ring_of[at], minlength=rings)[ring_good]
    counts = np.bincount(face_of_ring[ring_good], minlength=faces)[face_good]
    number = np.cumsum(face_good) - 1
    first_ring = np.zeros(rings, bool)
    first_ring[face_start[:-1]] = True
    return _Outlines(at, places[at], starts_of(sizes), starts_of(counts), np.flatnonzero(face_good),
                     number[face_of_ring[ring_of[at]]], first_ring[ring_of[at]])  # fmt: skip


def _vectors(outlines: _Outlines) -> NDArray[np.float64]:
    """(g, 3) normal of each face, its length the area of the outer ring (Newell)."""
    count = len(outlines.face)
    first = outlines.ring_start[outlines.face_start[:-1]][outlines.face_of]
    a = outlines.points - outlines.points[first]
    cross = np.cross(a, a[next_in_ring(outlines.ring_start)]) * (0.5 * outlines.outer[:, None]) if count else a
    sums = [np.bincount(outlines.face_of, cross[:, axis], count) for axis in range(3)]
    return np.stack(sums, -1).astype(np.float64)


def _solid(outlines: _Outlines, vectors: NDArray[np.float64]) -> NDArray[np.bool_]:
    if not len(vectors):
        return np.zeros(0, bool)
    edges = outlines.points[next_in_ring(outlines.ring_start)] - outlines.points
    starts = outlines.ring_start[outlines.face_start[:-1]]
    longest = np.maximum.reduceat((edges * edges).sum(1), starts)
    area = np.sqrt((vectors * vectors).sum(1))
    return np.asarray(area > np.maximum(SMALLEST, _FLAT * longest))


def _flattened(outlines: _Outlines, vectors: NDArray[np.float64]) -> NDArray[np.float64]:
    """(k, 2) corners without the axis that their face's normal has most of, counter-clockwise from where it faces."""
    axis = np.abs(vectors).argmax(1)
    backwards = vectors[np.arange(len(axis)), axis] < 0
    axis, backwards = axis[outlines.face_of], backwards[outlines.face_of]
    row = np.arange(len(axis))
    x, y = outlines.points[row, (axis + 1) % 3], outlines.points[row, (axis + 2) % 3]
    return np.stack([np.where(backwards, -x, x), y], -1)


def _convex(outlines: _Outlines, flat: NDArray[np.float64]) -> NDArray[np.bool_]:
    """(g,) faces without holes that turn left everywhere, and once."""
    if not len(flat):
        return np.zeros(0, bool)
    following = next_in_ring(outlines.ring_start)
    edge = flat[following] - flat
    after = edge[following]
    cross = edge[:, 0] * after[:, 1] - edge[:, 1] * after[:, 0]
    angle = np.arctan2(cross, (edge * after).sum(1))
    starts = outlines.ring_start[outlines.face_start[:-1]]
    left = np.minimum.reduceat(cross, starts) >= 0
    turned = np.add.reduceat(angle, starts)
    return np.asarray(left & (turned < _ONE_TURN) & (np.diff(outlines.face_start) == 1))
