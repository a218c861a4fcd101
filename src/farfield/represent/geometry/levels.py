"""Levels of detail of a mesh, each with the error measured against the mesh itself.

    levels = levels_of(chunk, materials)
    level = simplified(chunk, 1000)

Solid parts lose edges (kernels.collapse), aggregates such as leaves lose members (aggregate). Both are told apart by
their connected components alone, so nothing has to be said about a mesh.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from farfield.errors import OptionError
from farfield.represent.chunk import Chunk, merge, ordered
from farfield.represent.geometry.aggregate import Aggregate, aggregates, thinned
from farfield.represent.geometry.distance import SampledSurface, surface_distance
from farfield.represent.geometry.likeness import Likeness
from farfield.represent.geometry.reduction import reduced
from farfield.represent.geometry.wedges import Wedges
from farfield.represent.materials import MaterialTable

STEP = 4
"""Times fewer triangles from level to level."""
FEWEST = 24
"""Triangles: a level of fewer is not made."""
SMALLER = 0.7
"""A level has no more than this share of the triangles of the one before, or it is the end."""
WORST = 0.75
"""Error at the smallest size from which on a level is the end: little more than a blot shows the mesh as well."""
LEAST_PART = 12
"""Triangles of a part of an aggregate below which parts are left out rather than collapsed."""
SLACK = 1.05
"""An aggregate of this many times the triangles asked for is left as it is."""


@dataclass(frozen=True, slots=True)
class Level:
    """A level of detail and how wrong it is."""

    chunk: Chunk
    """Materials and objects are those of the mesh; in an order that its triangles decide (`chunk.ordered`)."""
    errors: tuple[float, ...]
    """For each of likeness.PIXELS (that many pixels along the longest side of the box), the error of its pictures over
    that of showing nothing: 0 = like the mesh, 1 = as nothing. Never less than those of the level before."""
    geometric_error: float
    """Metres, see `surface_distance`. Never less than that of the level before."""


def simplified(chunk: Chunk, triangles: int) -> Chunk:
    """About as many triangles as asked for; more when its objects need them, the chunk itself when it has no more.

    Positions, normals, texture coordinates, colours, materials and objects are kept; vertices that were twice there are
    one. 200,000 triangles take 1.2 s and 100 MB. Raises OptionError when none are asked for.
    """
    if triangles < 1:
        raise OptionError("a level needs a triangle at least", f"triangles {triangles}")
    if len(chunk.triangles) <= triangles:
        return chunk
    parts = _Parts.of(chunk)
    share = triangles / len(chunk.triangles)
    return parts.joined(share, parts.fewer_solid(parts.solid, share))


def levels_of(chunk: Chunk, materials: MaterialTable) -> list[Level]:
    """Levels from fine to coarse, without the mesh itself; none when the mesh has too few triangles.

    Solid parts are made from those of the level before: that costs a quarter, and a statue of 218,000 triangles has an
    error of .27 instead of .31 with 212. Aggregates are made from the mesh: enlarged twice they lose their outline,
    and a fir of 73,000 triangles has .67 instead of .53 with 1,100.
    """
    levels: list[Level] = []
    if len(chunk.triangles) < STEP * FEWEST:
        return levels
    likeness, surface, parts = Likeness.of(chunk, materials), SampledSurface.of(chunk), _Parts.of(chunk)
    last, solid, share = Level(chunk, (), 0.0), parts.solid, 1.0
    while len(last.chunk.triangles) >= STEP * FEWEST:
        share /= STEP
        solid = parts.fewer_solid(solid, share)
        coarser = parts.joined(share, solid)
        if not 0 < len(coarser.triangles) <= SMALLER * len(last.chunk.triangles):
            break
        errors = likeness.errors(coarser)
        if errors[0] > WORST:
            break
        distance = max(surface_distance(surface, SampledSurface.of(coarser)), last.geometric_error)
        last = Level(coarser, tuple(map(max, errors, last.errors or errors)), distance)
        levels.append(last)
    return levels


@dataclass(frozen=True, slots=True)
class _Parts:
    """A mesh, taken apart."""

    chunk: Chunk
    """All of it, in order."""
    aggregates: list[Aggregate]
    solid: Chunk
    """What is in none of them."""

    @classmethod
    def of(cls, chunk: Chunk) -> _Parts:
        chunk = ordered(chunk)
        found = aggregates(chunk, Wedges.of(chunk))
        rest = np.ones(len(chunk.triangles), np.bool_)
        for aggregate in found:
            rest[aggregate.rows] = False
        return cls(chunk, found, _of(chunk, rest))

    def fewer_solid(self, solid: Chunk, share: float) -> Chunk:
        """From `solid` or a level of it, a share of the triangles that `self.solid` has."""
        wanted = max(int(share * len(self.solid.triangles)), 1)
        return reduced(solid, wanted) if len(solid.triangles) > wanted else solid

    def joined(self, share: float, solid: Chunk) -> Chunk:
        """A share of the aggregates, and a level of what is solid."""
        fewer = [_fewer(self.chunk, a, max(int(share * len(a.rows)), 1)) for a in self.aggregates]
        return ordered(merge([*fewer, solid] if len(solid.triangles) else fewer or [solid]))


def _fewer(chunk: Chunk, aggregate: Aggregate, triangles: int) -> Chunk:
    """An aggregate with fewer parts, and fewer triangles in each as far as they have more than LEAST_PART."""
    size = len(aggregate.rows) / aggregate.count
    fewer = thinned(chunk, aggregate, int(triangles * max(size / LEAST_PART, 1.0)))
    return reduced(fewer, triangles) if len(fewer.triangles) > SLACK * triangles else fewer


def _of(chunk: Chunk, rows: NDArray[np.bool_]) -> Chunk:
    return replace(chunk, triangles=chunk.triangles[rows], materials=chunk.materials[rows], objects=chunk.objects[rows])
