"""Footprints with their heights as flat arrays, and the chunks of nearby ones that a scene holds."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field, replace

import numpy as np
from numpy.typing import NDArray

from farfield.scene.footprints.details import Details
from farfield.scene.footprints.order import Square, morton_codes
from farfield.scene.footprints.prisms import Buildings, prism_mesh
from farfield.scene.footprints.rings import Rings, starts_of
from farfield.scene.model import Mesh
from farfield.scene.options import Facades


@dataclass(frozen=True, slots=True, eq=False)
class Features:
    """Footprints in the coordinates of their file, exactly, so that chunks can be made of them again and again."""

    rings: Rings
    """Vertices float64."""
    bottom: NDArray[np.float64]
    """(n,) altitude where the walls begin: that of the ground, or above it by the lift."""
    top: NDArray[np.float64]
    """(n,) altitude of the flat roof."""
    seed: NDArray[np.uint32]
    """(n,) what a building's looks are drawn from."""
    details: Details = field(default_factory=Details)

    def __len__(self) -> int:
        return len(self.bottom)

    def of(self, rows: NDArray[np.int64]) -> Features:
        """Copies of some, in the order given."""
        return Features(
            self.rings.of_features(rows), self.bottom[rows], self.top[rows], self.seed[rows], self.details.of(rows)
        )

    @property
    def boxes(self) -> NDArray[np.float64]:
        """(n, 4) x0, y0, x1, y1."""
        first = self.rings.ring_start[self.rings.polygon_start[np.searchsorted(self.rings.polygon_feature, self._all)]]
        low = np.minimum.reduceat(self.rings.xy, first, axis=0)
        high = np.maximum.reduceat(self.rings.xy, first, axis=0)
        return np.concatenate([low, high], axis=1)

    @property
    def _all(self) -> NDArray[np.int64]:
        return np.arange(len(self))

    @classmethod
    def joined(cls, parts: Sequence[Features]) -> Features:
        """Several, one after the other; at least one."""
        rings = [part.rings for part in parts]
        before = starts_of(np.array([len(part) for part in parts]))
        return cls(
            Rings(
                np.concatenate([r.xy for r in rings]),
                starts_of(np.concatenate([np.diff(r.ring_start) for r in rings])),
                starts_of(np.concatenate([np.diff(r.polygon_start) for r in rings])),
                np.concatenate([r.polygon_feature + b for r, b in zip(rings, before[:-1], strict=True)]),
            ),
            np.concatenate([part.bottom for part in parts]),
            np.concatenate([part.top for part in parts]),
            np.concatenate([part.seed for part in parts]),
            Details.joined([part.details for part in parts], [len(part) for part in parts]),
        )


@dataclass(frozen=True, slots=True, eq=False)
class FootprintChunk:
    """The buildings of one file in one square of the plane, one object each, extruded when loaded."""

    name: str
    family: str
    """The file: its chunks share their quadtree."""
    square: Square
    features: Features
    facades: Facades

    @property
    def corner(self) -> NDArray[np.float64]:
        """(3,) coordinates of the mesh's zero: the lowest corner, whole metres."""
        low = self.features.rings.xy.min(axis=0)
        return np.asarray(np.floor([*low, self.features.bottom.min()]))

    def load(self) -> Mesh:
        """Extrudes the buildings: 4,096 take about 0.1 s. Vertices are float32 from the corner: 0.1 mm at 1 km."""
        corner, own = self.corner, self.features
        local = replace(own.rings, xy=(own.rings.xy - corner[:2]).astype(np.float32))
        bottom, top = ((z - corner[2]).astype(np.float32) for z in (own.bottom, own.top))
        return prism_mesh(Buildings(local, bottom, top, own.seed, own.details), self.facades)


def centres_of(boxes: NDArray[np.float64]) -> NDArray[np.float64]:
    """(n, 2) of (n, 4) x0, y0, x1, y1."""
    return (boxes[:, :2] + boxes[:, 2:]) / 2


def by_place(
    boxes: NDArray[np.float64], rows: NDArray[np.int64], lift: NDArray[np.float64] | None = None
) -> tuple[NDArray[np.uint64], NDArray[np.int64]]:
    """Places of some features as ascending codes, and the features in that order; those in one square by centre, those
    above each other by what lifts them.

    boxes, lift: of all features.
    """
    centres = centres_of(boxes[rows])
    codes = morton_codes(centres)
    order = np.lexsort((np.zeros(len(rows)) if lift is None else lift[rows], centres[:, 1], centres[:, 0], codes))
    return codes[order], rows[order]


def chunk_at(square: Square, features: Features, family: str, facades: Facades) -> FootprintChunk:
    """The chunk of a square, named by its place."""
    return FootprintChunk(f"{family}, {square}", family, square, features, facades)
