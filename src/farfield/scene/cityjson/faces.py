"""Faces as flat arrays: compact to hold, to pickle and to store."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from farfield.scene.footprints.rings import starts_of, stretches


@dataclass(frozen=True, slots=True, eq=False)
class Faces:
    """Faces with holes, of several objects, in the coordinates of their CRS."""

    points: NDArray[np.float64]
    """(v, 3)."""
    corner: NDArray[np.int64]
    """(c,) point of each corner, ring after ring; rings may be closed, and may repeat points."""
    ring_start: NDArray[np.int64]
    """(r + 1,) into the corners."""
    face_start: NDArray[np.int64]
    """(f + 1,) into the rings; the first ring of a face is its outer one."""
    owner: NDArray[np.int64]
    """(f,) object of each face."""
    family: NDArray[np.uint8]
    """(f,) Family of the object or part."""
    role: NDArray[np.uint8]
    """(f,) Role."""
    single: NDArray[np.bool_]
    """(f,) whether it is seen from one side only."""
    image: NDArray[np.int32]
    """(f,) number of its image, or -1."""
    color: NDArray[np.uint8]
    """(f, 4) sRGB that the file gives it; alpha 0 where it gives none."""
    uv: NDArray[np.float32]
    """(c, 2) of the corners of faces with an image, v upwards; (0, 2) when there are none."""

    def __len__(self) -> int:
        return len(self.owner)

    @property
    def sizes(self) -> NDArray[np.int64]:
        """(f,) corners of each."""
        return np.diff(self.ring_start[self.face_start])

    def of(self, rows: NDArray[np.int64]) -> Faces:
        """Copies of some faces in the order given, with the points that they have."""
        rings = stretches(self.face_start[rows], self.face_start[rows + 1])
        corners = stretches(self.ring_start[rings], self.ring_start[rings + 1])
        used, corner = np.unique(self.corner[corners], return_inverse=True)
        return Faces(
            self.points[used],
            corner.reshape(-1).astype(np.int64),
            starts_of(np.diff(self.ring_start)[rings]),
            starts_of(np.diff(self.face_start)[rows]),
            self.owner[rows],
            self.family[rows],
            self.role[rows],
            self.single[rows],
            self.image[rows],
            self.color[rows],
            self.uv[corners] if len(self.uv) else self.uv,
        )

    @classmethod
    def joined(cls, parts: Sequence[Faces]) -> Faces:
        """Several, one after the other; at least one."""
        points = starts_of(np.array([len(part.points) for part in parts]))
        textured = any(len(part.uv) for part in parts)
        uvs = [part.uv if len(part.uv) else np.zeros((len(part.corner) * textured, 2), np.float32) for part in parts]
        return cls(
            np.concatenate([part.points for part in parts]),
            np.concatenate([part.corner + first for part, first in zip(parts, points[:-1], strict=True)]),
            starts_of(np.concatenate([np.diff(part.ring_start) for part in parts])),
            starts_of(np.concatenate([np.diff(part.face_start) for part in parts])),
            np.concatenate([part.owner for part in parts]),
            np.concatenate([part.family for part in parts]),
            np.concatenate([part.role for part in parts]),
            np.concatenate([part.single for part in parts]),
            np.concatenate([part.image for part in parts]),
            np.concatenate([part.color for part in parts]),
            np.concatenate(uvs),
        )

    def boxes(self, count: int) -> NDArray[np.float64]:
        """(count, 2, 3) lower and upper corner of each object; of one without faces infinite, upside down."""
        out = np.tile(np.array([[[np.inf] * 3, [-np.inf] * 3]]), (count, 1, 1))
        owners = np.repeat(self.owner, self.sizes)
        places = self.points[self.corner]
        np.minimum.at(out[:, 0], owners, places)
        np.maximum.at(out[:, 1], owners, places)
        return out
