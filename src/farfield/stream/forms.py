"""What cells may be shown by, as things to send: values of the store, and how unlike the full geometry each looks."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from farfield.stream.accuracy import picture_accuracy
from farfield.world.index import BlockMapEntry, CellEntry, GeometryLevel

Floats = NDArray[np.float64]
REACHES = 3
"""Views that errors are told for."""


@dataclass(frozen=True, slots=True)
class CellValues:
    """What shows a cell: its tiles, best first, or its geometry."""

    cell: str
    is_geometry: bool
    keys: tuple[str, ...]
    sizes: tuple[int, ...]
    """Bytes of each."""
    shares: tuple[float, ...]
    """Of what all of them show; the sum is 1. None of geometry, which is shown by all or nothing."""
    steps: tuple[int, ...]
    """How many of them are offered together, ascending."""
    leaves: int = 1
    """How many leaves' geometry it is, `cell` and those after it."""
    level: int = 0
    """Of geometry: 0 = full, the larger the coarser."""
    refers: frozenset[str] = frozenset()
    """Those of the keys that other cells' geometry may have too: meshes and images."""
    listed: frozenset[str] = frozenset()
    """Those of the keys that are meshes of which leaves below list instances: they are sent by themselves."""

    def shown_by(self, held: set[str]) -> float:
        """Share that the viewer has."""
        there = [key in held for key in self.keys]
        if self.is_geometry:
            return float(all(there))
        return sum(share for share, is_there in zip(self.shares, there, strict=True) if is_there)


@dataclass(frozen=True, slots=True)
class CellForms:
    """A cell as geometry, from fine to coarse.

    Of a leaf its forms; of others those of all leaves below together, then those of its own, merged of all of these.
    """

    values: tuple[CellValues, ...]
    errors: Floats
    """(forms, 3) 0 = like the full geometry, 1 = as nothing; where a pixel is as wide as one of a leaf's pictures,
    of a mesh MESH_FARTHEST times as wide, then ERROR_SPACING times as narrow each. Of its own see `merged_accuracy`."""
    far: NDArray[np.bool_]
    """(forms,) whether it has few enough triangles to be drawn from farther than near."""
    merged: int = 0
    """How many, the last ones, are the cell's own."""

    @property
    def is_merged(self) -> NDArray[np.bool_]:
        """(forms,) whether it is the cell's own."""
        return np.arange(len(self.values)) >= len(self.values) - self.merged


NO_FORMS = CellForms((), np.zeros((0, REACHES)), np.zeros(0, bool))


def merged_accuracy(told: Floats, pitch: Floats | float, widths: Floats) -> Floats:
    """(f, k) how well merged geometry shows cells whose pictures have pixels `pitch` metres wide, (f, 1).

    told: (f, 3) or (3,) as CellForms has them; widths: (f, k) metres that pixels of the screen are wide. From nearer
    than is told of it goes on as pictures do: one sees its faces and texels.
    """
    return picture_accuracy(np.asarray(told)[..., None, :], pitch / widths)


def own_forms(entry: CellEntry) -> tuple[GeometryLevel | BlockMapEntry, ...]:
    """What a cell may be drawn by in place of its tiles that is its own and no leaf's, a BlockMap last."""
    merged = entry.geometry.forms if entry.geometry and entry.cell.level > 0 else ()
    return (*merged, entry.blockmap) if entry.tiles and entry.blockmap is not None else merged


def picture_errors(entry: CellEntry) -> tuple[int, ...]:
    """Those of its tiles, or of the BlockMap in their place."""
    return entry.errors if entry.tiles or entry.blockmap is None else entry.blockmap.errors


def together(fine: CellForms, coarse: CellForms) -> CellForms:
    if not fine.values or not coarse.values:
        return fine if fine.values else coarse
    return CellForms(
        fine.values + coarse.values,
        np.concatenate([fine.errors, coarse.errors]),
        np.concatenate([fine.far, coarse.far]),
        coarse.merged,
    )


def told_errors(errors: Sequence[int]) -> Floats:
    """(3,) errors of the index, 0 to 1; what is told for fewer views goes on as it ends."""
    known = tuple(errors[:REACHES]) or (0,)
    return np.array([*known, *known[-1:] * (REACHES - len(known))]) / 255
