"""How much a level of a mesh looks like the mesh: both drawn small from a few sides, and compared as FLIP does.

FLIP itself (Andersson et al. 2020) is not among the dependencies of a bake. This keeps what of it tells levels apart:
pictures as they are seen from a little away, HyAB distances in CIELAB, and their power. Over 44 levels of statues,
trees, a pot and a heap of stones it has the rank of FLIP over FLIP of nothing (Spearman .98, .96, .98 at 16, 64, 256
pixels), and about its value: the mean of FLIP's over this is .91, 1.11, 1.19.
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from farfield.geometry.color import LINEAR_OF_BYTE, linear_from_srgb
from farfield.geometry.directions import Direction
from farfield.kernels.project import lattice_bounds, project_orthographic
from farfield.kernels.resolve import PLANES, resolve
from farfield.represent.chunk import Chunk
from farfield.represent.materials import MaterialTable
from farfield.represent.orthoview.visibility import nearest_surface

PIXELS = (16, 64, 256)
"""Pixels along the longest side of the mesh's box at which pictures are compared, ascending."""

BLOCK, BLOCKS = 64, 4
"""Texels along the side of a piece of an image that its smaller sizes are compared with, and pieces along its side: all
of an image of up to 256 texels, and of a larger one about what all of it tells in a sixteenth of the time or less."""

SAMPLES = 2
"""Samples along the side of a pixel of the finest pictures."""

SIDES = ((20.0, 10.0), (110.0, 40.0), (200.0, 25.0), (290.0, 60.0))
"""Azimuth and elevation in degrees of the eyes: no face of a house lies along one."""

_SUN = np.array([-0.45, -0.55, 0.703])
"""Unit vector in each view's own frame (right, down, towards the eye): what is seen is lit, so its shape shows."""
_AMBIENT, _STRENGTH = 0.25, 0.75
SKY = linear_from_srgb(np.array([158, 191, 235]) / 255.0)
_POWER = 0.7
"""Of colour distances (FLIP, section 4.1)."""

_XYZ = np.array([[0.4124564, 0.3575761, 0.1804375], [0.2126729, 0.7151522, 0.072175], [0.0193339, 0.119192, 0.9503041]])


@dataclass(frozen=True, slots=True)
class Likeness:
    """Pictures of a mesh that its levels are compared with."""

    materials: MaterialTable
    frames: tuple[_Frame, ...]
    pictures: tuple[tuple[NDArray[np.float64], ...], ...]
    """For each frame and size (h, w, 3) CIELAB."""

    @classmethod
    def of(cls, chunk: Chunk, materials: MaterialTable, sides: Sequence[tuple[float, float]] = SIDES) -> Likeness:
        """Draws a mesh; one without any extent is like everything. sides: as SIDES."""
        extent = float(np.ptp(chunk.bounds, axis=0).max())
        pitch = max(extent, 1e-6) / (PIXELS[-1] * SAMPLES)
        frames = tuple(_Frame.around(chunk, Direction(26, _toward(*side)), pitch) for side in sides)
        return cls(materials, frames, tuple(_pictures(frame.draw(chunk, materials)) for frame in frames))

    def errors(self, level: Chunk) -> tuple[float, ...]:
        """For each of PIXELS, the error of the level's pictures over that of nothing at all: 0 = like, 1 = as nothing.

        It can be above 1. Materials are those of the mesh.
        """
        return self.errors_by((level, self.materials) for _ in self.frames)

    def errors_by(self, shown: Iterable[tuple[Chunk, MaterialTable]]) -> tuple[float, ...]:
        """The same, with something else shown from each of the sides."""
        wrong, empty = np.zeros(len(PIXELS)), np.zeros(len(PIXELS))
        sky = _lab(SKY)
        for frame, pictures, (chunk, materials) in zip(self.frames, self.pictures, shown, strict=True):
            for k, (true, other) in enumerate(zip(pictures, _pictures(frame.draw(chunk, materials)), strict=True)):
                wrong[k] += _distance(true, other)
                empty[k] += _distance(true, np.broadcast_to(sky, true.shape))
        return tuple(float(e) for e in wrong / np.maximum(empty, 1e-12))


def blur_errors(mips: Sequence[NDArray[np.uint8]]) -> tuple[float, ...]:
    """How unlike an image its smaller sizes look, each over that of the sky in its place.

    mips: (h, w, 4) sRGB and alpha, each half as large as the one before.
    """
    shape = mips[0].shape[:2]
    rows, columns = (_looked_at(size) for size in shape)
    first = mips[0][rows[:, None], columns]
    true = _lab(LINEAR_OF_BYTE[first[..., :3]].astype(np.float64))
    solid = first[..., 3:] >= 128
    empty = _distance(true * solid, _lab(SKY) * solid)
    found = [0.0]
    for image in mips[1:]:
        r, c = rows * image.shape[0] // shape[0], columns * image.shape[1] // shape[1]
        shown = _lab(LINEAR_OF_BYTE[image[r[:, None], c, :3]].astype(np.float64))
        found.append(_distance(true * solid, shown * solid) / max(empty, 1e-12))
    return tuple(found)


def _looked_at(size: int) -> NDArray[np.intp]:
    """Rows or columns of an image that are compared: pieces spread over all of it."""
    if size <= BLOCK * BLOCKS:
        return np.arange(size)
    first = np.linspace(0, size - BLOCK, BLOCKS).astype(np.intp)
    return (first[:, None] + np.arange(BLOCK)).ravel()


def unlikeness(true: NDArray[np.float64], shown: NDArray[np.float64], weight: NDArray[np.float64]) -> float | None:
    """Error of a picture over that of the sky alone, 0 = like, 1 = as nothing; (h, w, 3) linear light.

    weight: (h, w) of each pixel. None: there is nothing to be seen where it is.
    """
    first, second = (_lab(_blurred(_blurred(picture, 0), 1)) for picture in (true, shown))
    empty = float((weight * _distances(first, _lab(SKY))).sum())
    return None if empty <= 0 else float((weight * _distances(first, second)).sum()) / empty


@dataclass(frozen=True, slots=True)
class _Frame:
    """A view of the mesh's box and a margin around it."""

    matrix: NDArray[np.float64]
    """(3, 4) float64 to samples along u, v and w."""
    first: NDArray[np.float64]
    shape: tuple[int, int]
    axes: NDArray[np.float64]

    @classmethod
    def around(cls, chunk: Chunk, direction: Direction, pitch: float) -> _Frame:
        matrix = np.concatenate([direction.axes / pitch, np.zeros((3, 1))], axis=1)
        bounds = np.empty((2, 3))
        lattice_bounds(chunk.positions, matrix, bounds)
        coarsest = SAMPLES * (PIXELS[-1] // PIXELS[0])
        first = np.floor(bounds[0]) - coarsest
        size = (np.ceil((bounds[1] - first) / coarsest) + 1).astype(int) * coarsest
        return cls(matrix, first, (int(size[1]), int(size[0])), direction.axes)

    def draw(self, chunk: Chunk, materials: MaterialTable) -> NDArray[np.float64]:
        """(h, w, 3) float64 linear light before the sky. What lies outside the frame is cut off."""
        picture = np.broadcast_to(SKY, (*self.shape, 3)).copy()
        if len(chunk.triangles) == 0:
            return picture
        screen = np.empty((len(chunk.positions), 4), np.float32)
        project_orthographic(chunk.positions, self.matrix, self.first, 1, screen)
        depth, ids = nearest_surface(screen, chunk, materials, self.shape)
        pixels, objects = np.empty((*self.shape, PLANES), np.float32), np.empty(self.shape, np.uint32)
        none = np.empty((0, 0), np.float32)
        axes = self.axes.astype(np.float32)
        resolve(screen, chunk.surface, materials.arrays, axes, 1, np.float32(1), depth, ids, none, pixels, objects)
        seen = pixels[..., 1] > 0
        found = pixels[seen].astype(np.float64)
        lit = _AMBIENT + _STRENGTH * np.maximum(found[:, 6:9] @ _SUN, 0)
        picture[seen] = found[:, 3:6] * np.where(found[:, 2] > 0, 1.0, lit)[:, None]
        return picture


def _toward(azimuth: float, elevation: float) -> tuple[float, float, float]:
    a, e = np.radians(azimuth), np.radians(elevation)
    return float(np.sin(a) * np.cos(e)), float(np.cos(a) * np.cos(e)), float(np.sin(e))


def _pictures(samples: NDArray[np.float64]) -> tuple[NDArray[np.float64], ...]:
    """(h, w, 3) linear light of samples -> for each of PIXELS (h', w', 3) CIELAB, as seen from a little away."""
    found = []
    for pixels in PIXELS:
        step = SAMPLES * (PIXELS[-1] // pixels)
        height, width = samples.shape[0] // step, samples.shape[1] // step
        mean = samples.reshape(height, step, width, step, 3).mean(axis=(1, 3))
        found.append(_lab(_blurred(_blurred(mean, 0), 1)))
    return tuple(found)


def _blurred(picture: NDArray[np.float64], axis: int) -> NDArray[np.float64]:
    """With the weights 1 2 1: about what FLIP's contrast sensitivity keeps at 67 pixels a degree."""
    padded = np.pad(picture, [(1, 1) if a == axis else (0, 0) for a in range(3)], mode="edge")
    before, after = (np.take(padded, range(k, k + picture.shape[axis]), axis=axis) for k in (0, 2))
    return np.asarray((before + 2 * picture + after) / 4)


def _lab(linear: NDArray[np.float64]) -> NDArray[np.float64]:
    """(..., 3) linear sRGB -> (..., 3) CIELAB, D65."""
    xyz = linear @ _XYZ.T / _XYZ.sum(axis=1)
    f = np.where(xyz > 216 / 24389, np.cbrt(xyz), (24389 / 27 * xyz + 16) / 116)
    return np.stack([116 * f[..., 1] - 16, 500 * (f[..., 0] - f[..., 1]), 200 * (f[..., 1] - f[..., 2])], axis=-1)


def _distance(true: NDArray[np.float64], shown: NDArray[np.float64]) -> float:
    """Sum over the pixels of `_distances`."""
    return float(_distances(true, shown).sum())


def _distances(true: NDArray[np.float64], shown: NDArray[np.float64]) -> NDArray[np.float64]:
    """HyAB distances to the power of FLIP."""
    apart = np.abs(true - shown)
    hyab = apart[..., 0] + np.hypot(apart[..., 1], apart[..., 2])
    return np.asarray(hyab**_POWER)
