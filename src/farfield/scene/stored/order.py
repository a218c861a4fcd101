"""The triangles of a surface along a space-filling curve, on disk, and where the pieces of it begin and end."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from farfield.geometry.morton import BITS, morton_codes
from farfield.progress import Progress
from farfield.scene.cleaning import ABSURD_METRES, Losses, unit_or_missing, usable
from farfield.scene.stored.sorting import SortedRecords, scratch
from farfield.scene.streams import BATCH, SurfaceStream, Vertices, gather

TRIANGLE = np.dtype([("triangle", "<i8"), ("corners", "<i8", (3,))])
"""Number of a triangle in its file and its vertices there."""

_CODED = np.dtype([("code", "<i8"), ("triangle", "<i8"), ("corners", "<i8", (3,))])

_CODES, _TRIANGLES = "codes", "triangles"
_TOP = 1 << (BITS - 1)
"""Steps of the curve along the edge of one of its at most eight outermost cells."""


@dataclass(frozen=True, slots=True)
class Extent:
    """What has to be known of all vertices before the first triangle is looked at."""

    lower: NDArray[np.float64]
    upper: NDArray[np.float64]
    """(3,) of the finite vertices near the others."""
    middle: NDArray[np.float64] | None
    """(3,) median of the finite ones (of the medians of parts of them), when some lie absurdly far away."""
    lacks_normals: bool
    """Whether any vertex has none."""

    @classmethod
    def of(cls, stream: SurfaceStream) -> Extent:
        """Reads all vertices."""
        lower, upper, middle, lacking = _looked_through(stream, None)
        if (upper - lower).max() <= ABSURD_METRES:
            return cls(lower, upper, None, lacking)
        lower, upper, *_ = _looked_through(stream, middle)
        return cls(lower, upper, middle, lacking)

    def codes(self, points: NDArray[np.float64]) -> NDArray[np.int64]:
        """(n,) int64 Morton codes of points within the bounds.

        The steps are a power of two long and counted from the frame's own zero, so that a change in one place of a
        mesh leaves the codes everywhere else as they are.
        """
        reach = max(float((self.upper - self.lower).max()), float(np.abs([self.lower, self.upper]).max()) * 2.0**-32)
        step = 2.0 ** (np.frexp(max(reach, 2.0**-900))[1] - (BITS - 1))
        first = np.floor(self.lower / step / _TOP) * _TOP
        steps = np.floor(points / step) - first
        return morton_codes(np.clip(steps, 0, (1 << BITS) - 1).astype(np.uint64)).astype(np.int64)


class Order:
    """The usable triangles of a surface in the order of their codes; those of one code in that of the file."""

    def __init__(self, folder: Path, extent: Extent, count: int) -> None:
        self._folder, self.extent, self.count = folder, extent, count

    @classmethod
    def of(cls, stream: SurfaceStream, extent: Extent, folder: Path, losses: Losses, progress: Progress) -> Order:
        """Reads all triangles, with the vertices they need; counts in `losses` what cannot be used.

        folder: an empty one, for files of 80 bytes a triangle. Vertices are read again for each batch of triangles that
        needs them: a file whose triangles are in no spatial order at all is read once for every batch.
        """
        coded, number = SortedRecords(folder / "coded", _CODED), 0
        for corners in stream.batches():
            keep, middles = _looked_at(stream, extent, corners, losses)
            records = np.empty(int(keep.sum()), _CODED)
            records["code"] = extent.codes(middles)
            records["triangle"] = number + np.flatnonzero(keep)
            records["corners"] = corners[keep]
            coded.add(records)
            number += len(corners)
            progress.advance(len(corners))
        count = 0
        with scratch(folder), (folder / _CODES).open("wb") as codes, (folder / _TRIANGLES).open("wb") as triangles:
            for batch in coded.batches():
                codes.write(batch["code"].tobytes())
                triangles.write(batch[["triangle", "corners"]].astype(TRIANGLE).tobytes())
                count += len(batch)
        (folder / "coded").unlink()
        return cls(folder, extent, count)

    def part(self, start: int, stop: int) -> NDArray[Any]:
        """(stop - start,) TRIANGLE."""
        offset = start * TRIANGLE.itemsize
        return np.fromfile(self._folder / _TRIANGLES, TRIANGLE, stop - start, offset=offset)

    def cuts(self, most: int) -> list[tuple[int, int]]:
        """First and last + 1 of each piece: cells of an octree with at most `most` triangles, and of neighbouring
        cells in the same cell above as many together as come to no more."""
        if not self.count:
            return []
        codes = np.memmap(self._folder / _CODES, np.int64, "r")
        return list(_cut(codes, 0, self.count, 0, 3 * BITS - 3, most))


def _cut(
    codes: NDArray[np.int64], start: int, stop: int, first_code: int, shift: int, most: int
) -> list[tuple[int, int]]:
    """Pieces of the cell whose codes begin with `first_code` and whose eight cells are 2**shift codes each."""
    if stop - start <= most:
        return [(start, stop)]
    if shift < 0:
        # More triangles in one step of the curve than a piece may have are cut by their order in the file.
        return [(at, min(at + most, stop)) for at in range(start, stop, most)]
    walls = [(first_code + (cell << shift)) for cell in range(1, 8)]
    ends = [start, *(start + np.searchsorted(codes[start:stop], walls)).tolist(), stop]
    pieces: list[tuple[int, int]] = []
    pending = start
    for cell in range(8):
        first, last = ends[cell], ends[cell + 1]
        if last - pending <= most:
            continue
        if first > pending:
            pieces.append((pending, first))
        pending = first
        if last - first > most:
            pieces += _cut(codes, first, last, first_code + (cell << shift), shift - 3, most)
            pending = last
    return [*pieces, (pending, stop)] if stop > pending else pieces


def _looked_at(
    stream: SurfaceStream, extent: Extent, corners: NDArray[np.int64], losses: Losses
) -> tuple[NDArray[np.bool_], NDArray[np.float64]]:
    """Which triangles can be used, and the middles of these."""
    keep: NDArray[np.bool_] = np.all((corners >= 0) & (corners < stream.vertices), axis=1)
    losses.absent += int((~keep).sum())
    numbers, local = np.unique(corners[keep], return_inverse=True)
    triangles = local.reshape(-1, 3)
    positions = gather(stream, numbers).positions
    solid, _ = usable(positions, triangles, extent.middle, losses)
    keep[keep] = solid
    a, b, c = (positions[triangles[solid, k]] for k in range(3))
    return keep, (a + b + c) / 3


def _looked_through(
    stream: SurfaceStream, centre: NDArray[np.float64] | None
) -> tuple[NDArray[np.float64], NDArray[np.float64], NDArray[np.float64], bool]:
    """Bounds and middle, (3,) each, of the finite vertices not absurdly far from `centre`; whether normals lack."""
    bounds, medians, lacking = [], [], False
    for start in range(0, stream.vertices, BATCH):
        vertices = stream.rows(start, min(start + BATCH, stream.vertices))
        lacking = lacking or _lacks_normals(vertices)
        good = np.isfinite(vertices.positions).all(axis=1)
        if centre is not None:
            with np.errstate(invalid="ignore"):
                good &= (np.abs(vertices.positions - centre) <= ABSURD_METRES).all(axis=1)
        if good.any():
            points = vertices.positions[good]
            bounds.append([points.min(0), points.max(0)])
            medians.append(np.median(points, axis=0, keepdims=True))
    if not bounds:
        return np.zeros(3), np.zeros(3), np.zeros(3), lacking
    lower, upper = np.array(bounds).swapaxes(0, 1)
    return lower.min(0), upper.max(0), np.median(np.concatenate(medians), axis=0), lacking


def _lacks_normals(vertices: Vertices) -> bool:
    return vertices.normals is None or bool(np.isnan(unit_or_missing(vertices.normals)).any())
