"""Forms of a mesh: which have levels, and how unlike the mesh they are told to be."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from farfield.represent.blocks import BlockedMesh
from farfield.represent.chunk import Chunk
from farfield.represent.geometry.forms import errors_at, forms_of
from farfield.represent.geometry.likeness import blur_errors
from farfield.represent.materials import MaterialTable, mip_levels
from farfield.scene.model import Material, Texture
from farfield.scene.procedural.blobs import blob


def noise(side: int) -> Texture:
    pixels = np.random.default_rng(1).integers(0, 256, (side, side, 4), dtype=np.uint8)
    pixels[..., 3] = 255
    return Texture(pixels)


def square(texture: Texture) -> tuple[Chunk, MaterialTable]:
    """Of 4 m, its image once over it."""
    corners = np.array([[0, 0, 0], [4, 0, 0], [4, 4, 0], [0, 4, 0]], np.float32)
    chunk = Chunk(
        corners,
        np.tile(np.float32([0, 0, 1]), (4, 1)),
        (corners[:, :2] / 4).astype(np.float32),
        np.zeros((0, 4), np.uint8),
        np.array([[0, 1, 2], [0, 2, 3]], np.uint32),
        np.zeros(2, np.uint32),
        np.ones(2, np.uint32),
    )
    return chunk, MaterialTable.build([Material("", (1.0, 1.0, 1.0, 1.0), texture)])


def test_dense_meshes_have_levels_and_houses_have_none() -> None:
    body = blob(6_000, 2.0, 3)
    chunk = Chunk.whole(BlockedMesh.from_mesh(body))
    table = MaterialTable.build(body.materials)
    assert len(forms_of(chunk, table)) > 2
    many = replace(chunk, objects=(np.arange(len(chunk.triangles)) // 12 + 1).astype(np.uint32))
    assert len(forms_of(many, table)) == 1


def test_images_as_wide_as_pixels_may_be_halved_as_often_as_pixels_are_wider() -> None:
    (form,) = forms_of(*square(noise(64)))
    assert np.isclose(form.texel, 4 / 64)
    assert errors_at([form], 0, 4.0, 4 / 64, 0) == 0
    assert errors_at([form], 0, 4.0, 4 * 4 / 64, 2) == 0
    near, nearer = (errors_at([form], 0, 4.0, width, 2) for width in (2 * 4 / 64, 4 / 64))
    assert 0 < near < nearer
    # Placed twice as large its texels are twice as wide.
    assert errors_at([form], 0, 8.0, 4 * 4 / 64, 2) == near


def test_plain_images_lose_nothing_and_noise_does() -> None:
    plain = np.full((32, 32, 4), 255, np.uint8)
    plain[..., :3] = (120, 90, 60)
    assert max(blur_errors(mip_levels(plain, False))) < 0.02
    lost = blur_errors(mip_levels(noise(32).pixels, False))
    assert lost[0] == 0
    assert lost[1] > 0.2
    assert list(lost) == sorted(lost)


def test_images_alike_at_half_their_size_are_told_apart() -> None:
    stripes = np.full((64, 64, 4), 255, np.uint8)
    stripes[:, ::2, :3] = 40
    plain = np.full((64, 64, 4), 255, np.uint8)
    plain[...] = mip_levels(stripes, False)[1][0, 0]
    assert mip_levels(plain, False)[1].tolist() == mip_levels(stripes, False)[1].tolist()
    (rough,) = forms_of(*square(Texture(stripes)))
    (smooth,) = forms_of(*square(Texture(plain)))
    assert max(smooth.blur) < 0.02 < 0.2 < rough.blur[1]


def test_errors_go_on_from_nearer_than_was_looked_at() -> None:
    body = blob(6_000, 2.0, 3)
    forms = forms_of(Chunk.whole(BlockedMesh.from_mesh(body)), MaterialTable.build(body.materials))
    far, near, nearer = (errors_at(forms, 2, 2.0, width, 0) for width in (2 / 64, 2 / 256, 2 / 1024))
    assert far <= near <= nearer <= 1
    assert errors_at(forms, 0, 2.0, 0.001, 0) == 0
    assert errors_at(forms, 99, 2.0, 2 / 64, 0) == errors_at(forms, len(forms) - 1, 2.0, 2 / 64, 0)


def test_of_large_images_full_size_is_compared() -> None:
    """A fine pattern that is gone after two halvings, on a patch that is wider than a piece that is looked at."""
    stripes = np.full((600, 1000, 4), 255, np.uint8)
    stripes[..., :3] = np.where(np.arange(1000)[:, None] & 1, 200, 40)
    lost = blur_errors(mip_levels(stripes, False))
    assert lost[1] > 0.2
    (form,) = forms_of(*square(noise(512)))
    (small,) = forms_of(*square(noise(256)))
    assert np.allclose(form.blur[:4], small.blur[:4], atol=0.02)
