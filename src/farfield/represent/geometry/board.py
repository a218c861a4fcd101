"""Boards of impostors: where each stands, how squarely it is seen, what is drawn (BEN 4.1; spec/world.md)."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from farfield.scene.model import Material, Mesh, Texture

Floats = NDArray[np.float64]
FULL_SINE = 0.75**0.5
"""Sine of 60 degrees: seen at that angle to its plane, or more squarely, a board is as good as head on (BEN 4.1)."""
TURNS, TILTS = 16, 8
"""Parts of a turn, and of half a turn from straight below to straight above, between the eyes that dynamic impostors
are made for: one is never farther than 16 degrees from a line of sight."""
BULGE = 1.2
"""How far normals lean outwards at a board's corners, for 1 towards the eye."""
CUTOFF = 0.5
"""Alpha below which there is a hole: below 128 of 255."""
_SINGULAR = 1e-12
"""Of the product of its columns' lengths, up to which the determinant of a matrix is none."""


def side_angles(count: int) -> Floats:
    """(count, 2) azimuth and elevation, radians, of the eyes that the images of a baked impostor show a mesh to.

    Number n lies at an azimuth of n count-ths of a turn, 0 along x; none looks down, or up.
    """
    return np.stack([2 * np.pi * np.arange(count) / count, np.zeros(count)], axis=1)


def dynamic_angle(turn: int, tilt: int) -> Floats:
    """(2,) the same of a dynamic impostor (world.keys)."""
    return np.array([2 * np.pi * turn / TURNS, np.pi * (tilt / TILTS - 0.5)])


def directions(angles: Floats) -> Floats:
    """(..., 3) unit vectors, mesh frame, from the middle of a mesh to the eyes at these angles, (..., 2)."""
    azimuth, elevation = angles[..., 0], angles[..., 1]
    level = np.cos(elevation)
    return np.stack([level * np.cos(azimuth), level * np.sin(azimuth), np.sin(elevation)], axis=-1)


def board_matrix(bounds: Floats, angle: Floats) -> Floats:
    """(3, 4) from the frame of a board that is 1 wide and 1 high to that of its mesh, as an eye at `angle` sees it.

    The board's frame: from the middle of the board, x to the right as the eye sees it, y towards the eye, as long as
    the board is wide, z up. It is left-handed, so the determinant is negative. bounds: (2, 3) of the mesh, metres.
    angle: (2,) see `side_angles`.
    """
    towards = directions(np.asarray(angle))
    right = np.array([-np.sin(angle[0]), np.cos(angle[0]), 0.0])
    up = np.cross(towards, right)
    width, height = (float(np.abs(axis) @ (bounds[1] - bounds[0])) for axis in (right, up))
    return np.stack([right * width, towards * width, up * height, bounds.mean(axis=0)], axis=1)


def squareness(sines: Floats) -> Floats:
    """How much of an instance a board shows, for the angle alone (BEN 4.1); an array of the same shape.

    The cube of the sine over that of 60 degrees: 1 from there on, 0 from behind. sines: see `sines`.
    """
    return np.asarray((np.clip(sines, 0.0, FULL_SINE) / FULL_SINE) ** 3)


def sines(bounds: Floats, angles: Floats, transforms: Floats, eyes: Floats) -> Floats:
    """(m, k, b) sine of the angle between the lines of sight of k eyes and the boards of m instances of a mesh.

    In the mesh's frame; below 0 from behind. bounds: (2, 3) of the mesh, metres. angles: (b, 2) of the boards, see
    `side_angles`. transforms: (m, 3, 4) from the mesh's frame to local metres; those that flatten it give 0. eyes:
    (k, 3) local metres.
    """
    matrices = transforms[:, :, :3]
    spans = np.linalg.norm(matrices, axis=1).prod(axis=1)
    is_flat = ~(np.abs(np.linalg.det(matrices)) > _SINGULAR * spans)
    inverse = np.linalg.inv(np.where(is_flat[:, None, None], np.eye(3), matrices))
    towards = np.einsum("mij,mkj->mki", inverse, eyes - transforms[:, None, :, 3]) - bounds.mean(axis=0)
    length = np.linalg.norm(towards, axis=2, keepdims=True)
    sine = towards / np.where(length > 0, length, 1.0) @ directions(angles).T
    sine[is_flat] = 0.0
    return np.asarray(sine)


def board_mesh(texture: Texture) -> Mesh:
    """A board in its own frame (see `board_matrix`), two triangles, lit as a body as deep as it is wide.

    texture: an impostor's image, straight alpha, row 0 at the top.
    """
    right, up = np.array([0.5, -0.5, -0.5, 0.5]), np.array([-0.5, -0.5, 0.5, 0.5])
    flat = np.zeros(4)
    normals = np.stack([BULGE * right, flat + 1, BULGE * up], axis=1)
    return Mesh(
        positions=np.stack([right, flat, up], axis=1),
        triangles=np.array([[0, 1, 2], [0, 2, 3]], np.uint32),
        normals=(normals / np.linalg.norm(normals, axis=1, keepdims=True)).astype(np.float32),
        materials=(Material("board", texture=texture, alpha_cutoff=CUTOFF, double_sided=True),),
        triangle_material=np.zeros(2, np.uint16),
        uvs=np.stack([right + 0.5, 0.5 - up], axis=1).astype(np.float32),
    )
