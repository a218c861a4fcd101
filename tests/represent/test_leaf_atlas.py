"""Atlases of a leaf: every triangle shows its own image, and nothing of another."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from numpy.typing import NDArray

from farfield.represent.chunk import Chunk
from farfield.represent.geometry.leaf_atlas import GRAIN, GUTTER, Atlased, with_atlas
from farfield.represent.materials import mip_levels
from farfield.scene.model import Material, Texture


def flat(color: tuple[int, int, int], width: int, height: int) -> Texture:
    pixels = np.full((height, width, 4), 255, np.uint8)
    pixels[..., :3] = color
    return Texture(pixels)


def quads(uvs: list[NDArray[np.float64]]) -> Chunk:
    """A quad for each (4, 2) of texture coordinates, its material and object the number of it."""
    count = len(uvs)
    square = np.array([[0, 0, 0], [1, 0, 0], [1, 0, 1], [0, 0, 1]], np.float32)
    positions = np.concatenate([square + np.float32([2 * k, 0, 0]) for k in range(count)])
    first = 4 * np.arange(count)[:, None, None] + np.array([[0, 1, 2], [0, 2, 3]])
    return Chunk(
        positions,
        np.tile(np.array([0, -1, 0], np.float32), (4 * count, 1)),
        np.concatenate(uvs).astype(np.float32),
        np.empty((0, 4), np.uint8),
        first.reshape(-1, 3).astype(np.uint32),
        np.repeat(np.arange(count), 2).astype(np.uint32),
        np.repeat(np.arange(count), 2).astype(np.uint32),
    )


def rectangle(u0: float, v0: float, u1: float, v1: float) -> NDArray[np.float64]:
    return np.array([[u0, v1], [u1, v1], [u1, v0], [u0, v0]])


def looked_up(image: NDArray[np.uint8], uv: NDArray[np.float64]) -> NDArray[np.float64]:
    """(n, 3) bilinear, repeating."""
    height, width = image.shape[:2]
    at = uv * [width, height] - 0.5
    low = np.floor(at).astype(np.int64)
    part = at - low
    found = np.zeros((len(uv), 3))
    for i in (0, 1):
        for j in (0, 1):
            weight = np.abs(1 - i - part[:, 0]) * np.abs(1 - j - part[:, 1])
            found += weight[:, None] * image[(low[:, 1] + j) % height, (low[:, 0] + i) % width, :3]
    return found


def triangle_points(found: Atlased, triangle: int) -> NDArray[np.float64]:
    """(n, 2) texture coordinates all over a triangle, corners and edges too."""
    steps = [(i / 6, j / 6) for i in range(7) for j in range(7 - i)]
    weights = np.array([(a, b, 1 - a - b) for a, b in steps])
    return weights @ found.chunk.uvs[found.chunk.triangles[triangle]].astype(np.float64)


_image = st.tuples(
    st.integers(1, 60), st.integers(1, 60), st.floats(0, 1), st.floats(0, 1), st.floats(0, 1), st.floats(0, 1)
)


@settings(deadline=None, max_examples=80)
@given(st.lists(_image, min_size=2, max_size=40))
def test_every_triangle_shows_its_own_image(images: list[tuple[int, int, float, float, float, float]]) -> None:
    random = np.random.default_rng(len(images))
    colors = [tuple(random.integers(0, 256, 3).tolist()) for _ in images]
    materials = [Material(str(k), texture=flat(colors[k], w, h)) for k, (w, h, *_) in enumerate(images)]  # type: ignore[arg-type]
    chunk = quads([rectangle(min(a, c), min(b, d), max(a, c), max(b, d)) for _, _, a, b, c, d in images])
    found = with_atlas(chunk, materials, 128)
    assert found is not None
    assert len(found.materials) == 1
    pixels = found.texture.pixels
    assert max(pixels.shape[:2]) <= 128
    assert (np.array(pixels.shape[:2]) % GRAIN == 0).all()
    mips = mip_levels(pixels, masked=False)
    for triangle in range(len(chunk.triangles)):
        own = np.array(colors[int(chunk.materials[triangle])], np.float64)
        points = triangle_points(found, triangle)
        # In it and in its first half size nothing of a neighbour is seen; a step of sRGB is lost to linear light.
        for image in mips[:2]:
            assert np.abs(looked_up(image, points) - own).max() <= 1.01


def test_places_and_objects_stay() -> None:
    materials = [Material(str(k), texture=flat((9 * k, 5, 5), 8, 8)) for k in range(5)]
    chunk = quads([rectangle(0, 0, 1, 1)] * 5)
    found = with_atlas(chunk, materials, 64)
    assert found is not None
    np.testing.assert_array_equal(found.chunk.positions[found.chunk.triangles], chunk.positions[chunk.triangles])
    np.testing.assert_array_equal(found.chunk.objects, chunk.objects)
    assert len(np.unique(found.chunk.materials)) == 1


def test_what_is_small_enough_is_kept_to_the_bit() -> None:
    random = np.random.default_rng(0)
    textures = [Texture(random.integers(0, 256, (24, 20, 4)).astype(np.uint8)) for _ in range(3)]
    materials = [Material(str(k), texture=texture) for k, texture in enumerate(textures)]
    found = with_atlas(quads([rectangle(0, 0, 1, 1)] * 3), materials, 256)
    assert found is not None
    for k, texture in enumerate(textures):
        corners = found.chunk.uvs[found.chunk.triangles[2 * k : 2 * k + 2]].reshape(-1, 2)
        size = found.texture.pixels.shape[1::-1]
        low = np.round(corners.min(axis=0) * size).astype(int)
        image = found.texture.pixels[low[1] - GUTTER : low[1] + 24 + GUTTER, low[0] - GUTTER : low[0] + 20 + GUTTER, :3]
        expected = np.pad(texture.pixels[..., :3], ((GUTTER, GUTTER), (GUTTER, GUTTER), (0, 0)), mode="edge")
        np.testing.assert_array_equal(image, expected)


def test_only_what_is_used_is_taken() -> None:
    """A strip of a large image costs a strip."""
    materials = [Material("a", texture=flat((200, 0, 0), 256, 256)), Material("b", texture=flat((0, 0, 200), 64, 64))]
    found = with_atlas(quads([rectangle(0.25, 0.5, 0.375, 0.75), rectangle(0, 0, 1, 1)]), materials, 256)
    assert found is not None
    assert found.texture.pixels.shape[0] * found.texture.pixels.shape[1] <= 150 * 72


def test_what_repeats_or_is_cut_out_or_large_stays() -> None:
    small = [Material(str(k), texture=flat((k, 0, 0), 16, 16)) for k in range(2)]
    others = [
        Material("tiling", texture=flat((7, 0, 0), 16, 16)),
        Material("leaf", texture=flat((8, 0, 0), 16, 16), alpha_cutoff=0.5),
        Material("photograph", texture=flat((9, 0, 0), 80, 80)),
        Material("plain"),
    ]
    whole = rectangle(0, 0, 1, 1)
    chunk = quads([whole, rectangle(0, -1, 1, 0), whole, whole, whole, whole])
    materials = [small[0], others[0], *others[1:3], small[1], others[3]]
    found = with_atlas(chunk, materials, 128)
    assert found is not None
    assert [one.name for one in found.materials] == ["atlas", "tiling", "leaf", "photograph", "plain"]
    names = np.array([one.name for one in found.materials])[found.chunk.materials[::2]]
    assert names.tolist() == ["atlas", "tiling", "leaf", "photograph", "atlas", "plain"]
    stays = found.chunk.materials != 0
    np.testing.assert_array_equal(found.chunk.uvs[found.chunk.triangles[stays]], chunk.uvs[chunk.triangles[stays]])


def test_fewer_than_two_are_left_alone() -> None:
    one = Texture(np.full((8, 8, 4), 90, np.uint8))
    whole = rectangle(0, 0, 1, 1)
    assert with_atlas(quads([whole]), [Material("a", texture=one)], 64) is None
    assert with_atlas(quads([whole] * 2), [Material("a", texture=one), Material("b", texture=one)], 64) is None
    assert with_atlas(quads([whole] * 2), [Material("a"), Material("b")], 64) is None


def test_lights_and_sides_stay_apart() -> None:
    """Materials that are not alike stay several, on one image."""
    plain = [Material(str(k), texture=flat((50 * k, 0, 0), 8, 8)) for k in range(4)]
    materials = [plain[0], replace(plain[1], unlit=True), plain[2], replace(plain[3], base_color=(0.5, 1, 1, 1))]
    found = with_atlas(quads([rectangle(0, 0, 1, 1)] * 4), materials, 64)
    assert found is not None
    assert len(found.materials) == 3
    assert len({id(one.texture) for one in found.materials}) == 1


def test_averages_are_of_light() -> None:
    """A board of black and white is as bright as it was."""
    board = np.full((64, 64, 4), 255, np.uint8)
    board[..., :3] = 255 * (np.indices((64, 64)).sum(0) % 2)[..., None]
    materials = [Material(str(k), texture=Texture(board.copy())) for k in range(16)]
    found = with_atlas(quads([rectangle(0, 0, 1, 1)] * 16), materials, 136)
    assert found is not None
    middle = looked_up(found.texture.pixels, triangle_points(found, 0)[[10, 11, 12]])
    np.testing.assert_allclose(middle, 188, atol=30)
    assert found.texture.pixels[..., 0].mean() == pytest.approx(188, abs=4)


def test_too_many_to_fit() -> None:
    materials = [Material(str(k), texture=flat((k % 256, k // 256, 0), 4, 4)) for k in range(80)]
    assert with_atlas(quads([rectangle(0, 0, 1, 1)] * 80), materials, 64) is None
