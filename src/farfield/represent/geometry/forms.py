"""A mesh in its forms, from fine to coarse, and how unlike the mesh each looks from some way off."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from hashlib import blake2b

import numpy as np

from farfield.kernels.surface import Materials
from farfield.represent.chunk import Chunk
from farfield.represent.geometry.levels import levels_of
from farfield.represent.geometry.likeness import PIXELS, blur_errors
from farfield.represent.materials import MaterialTable

FEWEST_PER_OBJECT = 64
"""Triangles of an object, on average, from which on a mesh has levels. Buildings of a dozen lose whole façades with the
first, and to find that out takes a second a leaf."""
_REMEMBERED = 4096
"""Images whose blur is known: each takes some 50 ms, and many a leaf has the same."""
_BLUR: dict[tuple[int, int, bytes], tuple[float, ...]] = {}
"""Width, height and digest of an image -> likeness.blur_errors."""


@dataclass(frozen=True, slots=True)
class Form:
    """A mesh with some of its triangles."""

    chunk: Chunk
    errors: tuple[float, ...]
    """For each of likeness.PIXELS; none: it is the mesh itself."""
    geometric_error: float
    """Metres, see levels.Level; 0: it is the mesh itself."""
    extent: float
    """Of the mesh, metres along the longest side of its box."""
    texel: float
    """Of the mesh, metres between texels on its surface, on average; 0: it has no images."""
    blur: tuple[float, ...]
    """How unlike its images look when they are halved 0, 1, 2 … times, mean by area (likeness.blur_errors)."""


def forms_of(chunk: Chunk, materials: MaterialTable, simplified: bool = True) -> tuple[Form, ...]:
    """The mesh itself, then its levels. simplified: whether it has any, which take a second to make."""
    extent = float(np.ptp(chunk.bounds, axis=0).max())
    texel, blur = _images_of(chunk, materials.arrays)
    dense = simplified and len(chunk.triangles) >= FEWEST_PER_OBJECT * len(np.unique(chunk.objects))
    levels = levels_of(chunk, materials) if dense else []
    each = ((level.chunk, level.errors, level.geometric_error) for level in levels)
    return tuple(Form(*one, extent, texel, blur) for one in ((chunk, (), 0.0), *each))


def errors_at(forms: Sequence[Form], level: int, extent: float, width: float, halvings: int) -> float:
    """Error of a level (the coarsest, beyond that), 0 = like the mesh, where a pixel is `width` metres wide.

    extent: of the mesh as it is placed. halvings: of the sides of its images. Both errors together are as those of the
    compound accuracy, a product (BEN 4.1.1).
    """
    form = forms[min(level, len(forms) - 1)]
    shape = 0.0
    if form.errors:
        pixels = np.log2(max(extent / width, 1.0))
        known = np.log2(PIXELS)
        shape = float(np.interp(pixels, known, form.errors))
        if pixels > known[-1]:
            # From nearer than was looked at: it goes on as it did before.
            steep = (form.errors[-1] - form.errors[-2]) / (known[-1] - known[-2])
            shape += float(max(steep, 0.0) * (pixels - known[-1]))
    return float(1 - (1 - min(shape, 1.0)) * (1 - _softness(forms[0], extent, width, halvings)))


def _softness(mesh: Form, extent: float, width: float, halvings: int) -> float:
    """Error of images halved so often, beside what is lost anyway where a pixel is that wide."""
    if mesh.texel == 0:
        return 0.0
    texel = mesh.texel * extent / max(mesh.extent, 1e-9)
    least = max(float(np.log2(width / texel)), 0.0)
    own, anyway = np.interp([halvings, min(least, halvings)], range(len(mesh.blur)), mesh.blur)
    return float(min(max(own - anyway, 0.0), 1.0))


def _images_of(chunk: Chunk, materials: Materials) -> tuple[float, tuple[float, ...]]:
    """(metres between texels where there are any, by area, 0: nowhere; Form.blur)."""
    textured = materials.texture[chunk.materials] >= 0
    if not len(chunk.uvs) or not textured.any():
        return 0.0, (0.0,)
    corners, which = chunk.triangles[textured], materials.texture[chunk.materials[textured]]
    a, b, c = (chunk.positions[corners[:, n]].astype(np.float64) for n in range(3))
    areas = np.linalg.norm(np.cross(b - a, c - a), axis=1)
    u, v, w = (chunk.uvs[corners[:, n]].astype(np.float64) for n in range(3))
    edges = np.stack([v - u, w - u], axis=1)
    texels = (np.abs(np.linalg.det(edges)) * materials.size[which, :2].prod(axis=1)).sum()
    by_image = np.bincount(which, areas, minlength=len(materials.size))
    blur = np.zeros(len(materials.level[0]))
    for image in np.flatnonzero(by_image > 0):
        told = _blur(materials, int(image))
        blur += by_image[image] * np.interp(range(len(blur)), range(len(told)), told)
    width = float(np.sqrt(areas.sum() / texels)) if texels > 0 else 0.0
    return width, tuple((blur / max(by_image.sum(), 1e-12)).tolist())


def _blur(materials: Materials, image: int) -> tuple[float, ...]:
    """Of an image of the pool, see likeness.blur_errors."""
    width, height, count = materials.size[image].tolist()
    first = at = int(materials.level[image, 0])
    mips = []
    for level in range(count):
        rows, columns = max(1, height >> level), max(1, width >> level)
        mips.append(materials.pixels[at : at + rows * columns].reshape(rows, columns, 4))
        at += rows * columns
    # By all of its sizes: images unlike at full size may be alike at half of it, and holes may alter those alone.
    # A city's leaves ask for the same seven again and again; to hash one of 512 x 512 takes 4 ms.
    key = width, height, blake2b(materials.pixels[first:at].ravel().data, digest_size=16).digest()
    if key not in _BLUR:
        while len(_BLUR) >= _REMEMBERED:
            del _BLUR[next(iter(_BLUR))]
        _BLUR[key] = blur_errors(mips)
    return _BLUR[key]
