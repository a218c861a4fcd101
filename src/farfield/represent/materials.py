"""Scene materials as flat arrays for kernels, their textures in one pool with mip levels."""

from __future__ import annotations

from collections import OrderedDict
from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from farfield.geometry.color import BYTE_OF_LINEAR, LINEAR_OF_BYTE
from farfield.kernels.surface import Materials
from farfield.scene.model import Material, Texture

LEVELS = 17
"""Most mip levels of a texture: 65536 pixels along the longer side."""


@dataclass(frozen=True, slots=True)
class MaterialTable:
    """All materials a chunk's triangles refer to."""

    arrays: Materials
    double_sided: NDArray[np.uint8]
    """(k,) uint8 0 or 1."""

    def __len__(self) -> int:
        return len(self.double_sided)

    @classmethod
    def build(cls, materials: Sequence[Material], pool: TexturePool | None = None) -> MaterialTable:
        """The table whose row i is materials[i]; textures used by several are kept once.

        pool: of an earlier table, whose textures are then not filtered again.
        """
        pool = pool or TexturePool()
        rows = [-1 if m.texture is None else pool.add(m.texture, masked=m.alpha_cutoff is not None) for m in materials]
        arrays = Materials(
            np.array([m.base_color for m in materials], dtype=np.float32).reshape(-1, 4),
            np.array(rows, dtype=np.int32),
            np.array([-1.0 if m.alpha_cutoff is None else m.alpha_cutoff for m in materials], dtype=np.float32),
            np.array([m.unlit for m in materials], dtype=np.uint8),
            np.array(pool.levels, dtype=np.int64).reshape(-1, LEVELS),
            np.array(pool.sizes, dtype=np.int32).reshape(-1, 3),
            np.concatenate(pool.pixels) if pool.pixels else np.empty((0, 4), dtype=np.uint8),
            np.array([pool.add_mask(m) for m in materials], dtype=np.int64),
            np.concatenate(pool.bits) if pool.bits else np.empty(0, dtype=np.uint8),
        )
        return cls(arrays, np.array([m.double_sided for m in materials], dtype=np.uint8))


class MipCache:
    """Mip levels of the textures used last, within a budget of bytes; 512 x 512 texels take 3 ms, cut-outs 27."""

    def __init__(self, budget: int = 256 << 20) -> None:
        self._budget = budget
        self._bytes = 0
        self._kept: OrderedDict[tuple[Texture, bool], list[NDArray[np.uint8]]] = OrderedDict()

    def get(self, texture: Texture, masked: bool) -> list[NDArray[np.uint8]]:
        """See `mip_levels`."""
        key = (texture, masked)
        if key not in self._kept:
            self._kept[key] = mip_levels(texture.pixels, masked)
            self._bytes += sum(image.nbytes for image in self._kept[key])
            while self._bytes > self._budget and len(self._kept) > 1:
                self._bytes -= sum(image.nbytes for image in self._kept.popitem(last=False)[1])
        self._kept.move_to_end(key)
        return self._kept[key]


class TexturePool:
    """Gathers textures; the same image is averaged differently with and without an alpha mask."""

    def __init__(self, mips: MipCache | None = None) -> None:
        self._mips = mips or MipCache()
        self.rows: dict[tuple[Texture, bool], int] = {}
        self.levels: list[list[int]] = []
        self.sizes: list[tuple[int, int, int]] = []
        self.pixels: list[NDArray[np.uint8]] = []
        self.count = 0
        self.masks: dict[tuple[Texture, int], int] = {}
        self.bits: list[NDArray[np.uint8]] = []
        self.bytes = 0

    def add(self, texture: Texture, masked: bool) -> int:
        key = (texture, masked)
        if key not in self.rows:
            self.rows[key] = len(self.levels)
            offsets = []
            images = self._mips.get(texture, masked)
            for image in images:
                offsets.append(self.count)
                self.pixels.append(image.reshape(-1, 4))
                self.count += image.shape[0] * image.shape[1]
            self.levels.append(offsets + offsets[-1:] * (LEVELS - len(offsets)))
            height, width = texture.pixels.shape[:2]
            self.sizes.append((width, height, len(images)))
        return self.rows[key]

    def add_mask(self, material: Material) -> int:
        """First byte of the bits that say which texels a material keeps; -1 when it has no mask."""
        if material.texture is None or material.alpha_cutoff is None:
            return -1
        alpha = np.float32(material.base_color[3]) * (np.arange(256, dtype=np.float32) * np.float32(1 / 255))
        least = int((alpha < np.float32(material.alpha_cutoff)).sum())
        key = (material.texture, least)
        if key not in self.masks:
            self.masks[key] = self.bytes
            kept = material.texture.pixels[..., 3] >= least
            self.bits.append(np.packbits(kept, axis=1, bitorder="little").ravel())
            self.bytes += len(self.bits[-1])
        return self.masks[key]


def mip_levels(pixels: NDArray[np.uint8], masked: bool) -> list[NDArray[np.uint8]]:
    """(h, w, 4) uint8 sRGB and alpha -> that and every half size down to 1 x 1 (halves rounded down).

    Averages are taken in linear light. masked: weighted by alpha, and colours of texels without any alpha are replaced
    by those of the level above, so that the background of a cut-out leaf never bleeds into it.
    """
    if (pixels[..., 3] == 255).all():
        return [pixels, *_opaque_below(pixels)]
    alpha = pixels[..., 3:].astype(np.float32) / np.float32(255)
    weight = alpha if masked else np.ones_like(alpha)
    level = np.concatenate([LINEAR_OF_BYTE[pixels[..., :3]] * weight, weight, alpha], axis=-1)
    linear = [level, *_halves_of(level)]
    colors = [_unweighted(level) for level in linear]
    if masked:
        for k in range(len(linear) - 2, -1, -1):
            _fill_empty(colors[k], linear[k][..., 3] == 0, colors[k + 1])
    images = [_bytes(color, level[..., 4]) for color, level in zip(colors, linear, strict=True)]
    kept = images[0][..., 3] > 0 if masked else np.ones(pixels.shape[:2], dtype=bool)
    images[0] = np.where(kept[..., None], pixels, images[0])  # what is seen at full size stays as it was read
    return images


def _opaque_below(pixels: NDArray[np.uint8]) -> Iterator[NDArray[np.uint8]]:
    """Those below the full size where nothing is left out, as nearly always: 3 ms for 27 at 512 x 512 texels."""
    for level in _halves_of(LINEAR_OF_BYTE[pixels[..., :3]]):
        yield _bytes(level, np.ones(level.shape[:2], np.float32))


def _halves_of(level: NDArray[np.float32]) -> Iterator[NDArray[np.float32]]:
    """Every half size of an image, down to one texel."""
    while max(level.shape[:2]) > 1:
        level = _halved(_halved(level, 0), 1)
        yield level


def _halved(image: NDArray[np.float32], axis: int) -> NDArray[np.float32]:
    """Box-filtered to half the size along an axis; odd sizes share the middle texels by area."""
    size = image.shape[axis]
    half = max(1, size // 2)
    if size == half:
        return image
    if size == 2 * half:
        even, odd = (np.take(image, np.arange(k, size, 2), axis=axis) for k in (0, 1))
        return (even + odd) * np.float32(0.5)
    edges = np.arange(half + 1) * (size / half)
    texel = np.arange(size)
    overlap = np.minimum(edges[1:, None], texel + 1) - np.maximum(edges[:-1, None], texel)
    weights = (np.maximum(overlap, 0) * (half / size)).astype(np.float32)
    return np.moveaxis(np.tensordot(weights, image, axes=(1, axis)), 0, axis).astype(np.float32)


def _unweighted(level: NDArray[np.float32]) -> NDArray[np.float32]:
    return np.asarray(level[..., :3] / np.maximum(level[..., 3:4], np.float32(1e-12)), dtype=np.float32)


def _fill_empty(color: NDArray[np.float32], empty: NDArray[np.bool_], above: NDArray[np.float32]) -> None:
    rows, columns = np.nonzero(empty)
    color[rows, columns] = above[
        np.minimum(rows // 2, above.shape[0] - 1), np.minimum(columns // 2, above.shape[1] - 1)
    ]


def _bytes(color: NDArray[np.float32], alpha: NDArray[np.float32]) -> NDArray[np.uint8]:
    steps = np.clip(color * np.float32(4095) + np.float32(0.5), 0, 4095).astype(np.uint16)
    opacity = np.floor(alpha * np.float32(255) + np.float32(0.5)).astype(np.uint8)
    return np.concatenate([BYTE_OF_LINEAR[steps], opacity[..., None]], axis=-1)
