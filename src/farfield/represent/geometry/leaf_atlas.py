"""One image for many: what a leaf shows of its images, packed into an atlas of a fixed size.

    atlased = with_atlas(chunk, materials, 1024)

The atlas of a texture-atlas tree (Buchholz and Döllner 2005, View-dependent rendering of multiresolution
texture-atlases); its coarser levels are the same atlas, halved. What repeats cannot be packed and stays as it is.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
import rpack
from numpy.typing import NDArray

from farfield.geometry.color import BYTE_OF_LINEAR, LINEAR_OF_BYTE
from farfield.represent.chunk import Chunk
from farfield.scene.model import Material, Texture

GUTTER = 2
"""Texels round an image that repeat its rim: bilinear look-ups stay in it, in the atlas and in its first half size."""
GRAIN = 4
"""Texels: boxes begin and end at multiples, so that no texel of the first two half sizes is of two images."""
LARGE = 2
"""An image that is longer than this share of the atlas's side, of what is used of it, is left alone: a photograph of a
square is not to be as coarse as a street of façades."""
_ROUNDING = 1e-4
"""Of texture coordinates that are meant to be 0 or 1."""
_STEP = 0.97
"""From one scale that is tried to the next."""


@dataclass(frozen=True, slots=True)
class Atlased:
    """A leaf's triangles with the materials they have now."""

    chunk: Chunk
    materials: tuple[Material, ...]
    texture: Texture
    """The atlas."""


@dataclass(frozen=True, slots=True, eq=False)
class _Part:
    """What is used of an image."""

    pixels: NDArray[np.uint8]
    """All of it."""
    box: tuple[int, int, int, int]
    """Texels that are used: x0, y0, x1, y1."""

    @property
    def size(self) -> tuple[int, int]:
        """Texels across and down."""
        return self.box[2] - self.box[0], self.box[3] - self.box[1]


@dataclass(frozen=True, slots=True, eq=False)
class _Packing:
    """Where parts lie in an atlas."""

    inner: NDArray[np.int64]
    """(p, 4) texels without the gutter: x, y, width, height."""
    boxes: NDArray[np.int64]
    """(p, 4) with it, and with what fills the box."""

    @property
    def size(self) -> tuple[int, int]:
        """Width and height of the atlas."""
        width, height = (self.boxes[:, :2] + self.boxes[:, 2:]).max(axis=0)
        return int(width), int(height)


def with_atlas(
    chunk: Chunk, materials: Sequence[Material], side: int, name: Callable[[Material], Any] = lambda one: one.texture
) -> Atlased | None:
    """The same triangles, their images in one. None: fewer than two of them can be packed, or too many.

    Materials that differ in nothing but their image become one. An image is packed when no triangle repeats it and
    nothing is cut out of it. side: texels along the sides of the atlas, at most. name: the same for like images.
    """
    used = np.unique(chunk.materials).tolist()
    fit = [number for number in used if _may_be_packed(materials[number])] if len(chunk.uvs) else []
    names: dict[Any, int] = {}
    owner = np.full(len(materials), -1)
    boxes: list[NDArray[np.float64]] = []
    pixels: list[NDArray[np.uint8]] = []
    for number in fit:
        texture = materials[number].texture
        assert texture is not None
        uvs = chunk.uvs[chunk.triangles[chunk.materials == number]].astype(np.float64).reshape(-1, 2)
        if not ((uvs >= -_ROUNDING) & (uvs <= 1 + _ROUNDING)).all():
            continue
        box = _texels(uvs, texture)
        if (box[2:] - box[:2]).max() > side // LARGE:
            continue
        part = names.setdefault(name(materials[number]), len(names))
        owner[number] = part
        if part == len(boxes):
            boxes.append(box)
            pixels.append(texture.pixels)
        else:
            boxes[part] = np.concatenate([np.minimum(boxes[part], box)[:2], np.maximum(boxes[part], box)[2:]])
    if len(names) < 2:
        return None
    parts = [_Part(own, (int(b[0]), int(b[1]), int(b[2]), int(b[3]))) for own, b in zip(pixels, boxes, strict=True)]
    packing = _packed(parts, side)
    if packing is None:
        return None
    texture = Texture(_painted(parts, packing))
    return _joined(_moved(chunk, parts, packing, owner), materials, owner, texture)


def _may_be_packed(material: Material) -> bool:
    return material.texture is not None and material.alpha_cutoff is None


def _texels(uvs: NDArray[np.float64], texture: Texture) -> NDArray[np.float64]:
    """(4,) x0, y0, x1, y1: whole texels that bilinear look-ups at these places touch."""
    height, width = texture.pixels.shape[:2]
    size = np.array([width, height])
    low = np.clip(np.floor(uvs.min(axis=0) * size - 0.5), 0, size - 1)
    high = np.clip(np.ceil(uvs.max(axis=0) * size + 0.5), low + 1, size)
    return np.concatenate([low, high])


def _packed(parts: Sequence[_Part], side: int) -> _Packing | None:
    """As large as they fit, none larger than it is; None: they do not fit however small."""
    sizes = np.array([part.size for part in parts])
    room = side // GRAIN
    area = float((sizes + 2 * GUTTER).prod(axis=1).sum())
    scale = min(1.0, side / area**0.5)
    while True:
        inner = np.maximum(np.round(sizes * scale), 1).astype(np.int64)
        blocks = -(-(inner + 2 * GUTTER) // GRAIN)
        places = _places(blocks, room)
        if places is not None:
            corners = places * GRAIN
            return _Packing(
                np.concatenate([corners + GUTTER, inner], axis=1), np.concatenate([corners, blocks * GRAIN], axis=1)
            )
        if (inner == 1).all():
            return None
        scale *= _STEP


def _places(blocks: NDArray[np.int64], room: int) -> NDArray[np.int64] | None:
    """(p, 2) corners of rectangles (p, 2) in a square; None: they are not found to fit."""
    if blocks.prod(axis=1).sum() > room**2 or blocks.max() > room:
        return None
    try:
        return np.array(rpack.pack([(w, h) for w, h in blocks.tolist()], max_width=room, max_height=room), np.int64)
    except rpack.PackingImpossibleError:
        return None


def _painted(parts: Sequence[_Part], packing: _Packing) -> NDArray[np.uint8]:
    """(h, w, 4) sRGB, opaque; between the parts their mean colour."""
    width, height = packing.size
    image = np.full((height, width, 4), 255, np.uint8)
    is_free = np.ones((height, width), np.bool_)
    for part, inner, box in zip(parts, packing.inner.tolist(), packing.boxes.tolist(), strict=True):
        x0, y0, x1, y1 = part.box
        own = _shrunk(part.pixels[y0:y1, x0:x1, :3], inner[3], inner[2])
        down, right = box[3] - inner[3] - GUTTER, box[2] - inner[2] - GUTTER
        framed = np.pad(own, ((GUTTER, down), (GUTTER, right), (0, 0)), mode="edge")
        place = slice(box[1], box[1] + box[3]), slice(box[0], box[0] + box[2])
        image[(*place, slice(3))] = framed
        is_free[place] = False
    if is_free.any():
        image[is_free, :3] = np.round(image[~is_free, :3].mean(axis=0))
    return image


def _shrunk(pixels: NDArray[np.uint8], rows: int, columns: int) -> NDArray[np.uint8]:
    """(rows, columns, 3) sRGB, each texel the mean of what it covers, in linear light."""
    if pixels.shape[:2] == (rows, columns):
        return pixels
    linear = LINEAR_OF_BYTE[pixels].astype(np.float64)
    mean = _averaged(_averaged(linear, rows).swapaxes(0, 1), columns).swapaxes(0, 1)
    return np.asarray(BYTE_OF_LINEAR[np.clip(mean * 4095 + 0.5, 0, 4095).astype(np.uint16)])


def _averaged(image: NDArray[np.float64], count: int) -> NDArray[np.float64]:
    """(count, ...) means of stretches of the rows (n, ...), by differences of running sums."""
    total = np.zeros((len(image) + 1, *image.shape[1:]))
    np.cumsum(image, axis=0, out=total[1:])
    edges = np.arange(count + 1) * (len(image) / count)
    whole = np.minimum(edges.astype(np.int64), len(image) - 1)
    part = (edges - whole).reshape(-1, *(1,) * (image.ndim - 1))
    at = total[whole] + part * image[whole]
    return np.asarray(np.diff(at, axis=0) * (count / len(image)))


def _moved(chunk: Chunk, parts: Sequence[_Part], packing: _Packing, owner: NDArray[np.int64]) -> Chunk:
    """The triangles with texture coordinates in the atlas, a vertex for each part that has it."""
    part = owner[chunk.materials] + 1
    names = chunk.triangles.astype(np.int64) * (len(parts) + 1) + part[:, None]
    names, corners = np.unique(names, return_inverse=True)
    vertices, which = np.divmod(names, len(parts) + 1)
    uvs = chunk.uvs[vertices].astype(np.float64)
    inside = which > 0
    own = which[inside] - 1
    of = np.array([(*one.pixels.shape[1::-1], *one.box) for one in parts], np.float64)[own]
    inner = packing.inner[own].astype(np.float64)
    along = (uvs[inside] * of[:, :2] - of[:, 2:4]) / (of[:, 4:] - of[:, 2:4])
    uvs[inside] = (inner[:, :2] + np.clip(along, 0, 1) * inner[:, 2:]) / packing.size
    return replace(
        chunk,
        positions=chunk.positions[vertices],
        normals=chunk.normals[vertices],
        uvs=uvs.astype(np.float32),
        colors=chunk.colors[vertices] if len(chunk.colors) else chunk.colors,
        triangles=corners.reshape(-1, 3).astype(np.uint32),
    )


def _joined(chunk: Chunk, materials: Sequence[Material], owner: NDArray[np.int64], texture: Texture) -> Atlased:
    """Materials that are used, those of packed images as few as they can be."""
    numbers: dict[Material, int] = {}
    new = np.zeros(len(materials), np.uint32)
    for number in np.unique(chunk.materials).tolist():
        material = materials[number]
        if owner[number] >= 0:
            material = replace(material, name="atlas", texture=texture)
        # Others stay as they are, even if they are alike.
        new[number] = numbers.setdefault(material, len(numbers))
    return Atlased(replace(chunk, materials=new[chunk.materials]), tuple(numbers), texture)
