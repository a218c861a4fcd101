"""Images of a mesh from round about, for boards that stand in for it (BEN 4.1; spec/world.md, Instances).

Those from the side are made once, at the bake: of eight one always lies within 22.5 degrees, where the thesis calls a
board as good as head on, and they come from any web server. For eyes that look down, or up, a server makes them on
demand (view/impostors.py).
"""

from __future__ import annotations

import io
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from PIL import Image

from farfield.geometry.color import srgb_from_linear
from farfield.kernels.project import project_orthographic
from farfield.kernels.resolve import PLANES, resolve
from farfield.represent.blocks import BlockedMesh
from farfield.represent.chunk import Chunk
from farfield.represent.geometry.board import board_matrix, board_mesh, side_angles
from farfield.represent.geometry.likeness import Likeness
from farfield.represent.materials import MaterialTable, TexturePool
from farfield.represent.orthoview.visibility import nearest_surface
from farfield.scene.model import Texture

ROWS = (192, 64, 20)
"""Heights of images, pixels, from fine to coarse."""
SIDES = 8
QUALITY = 40
"""Of WebP."""
SAMPLES = 2
"""Along the side of a pixel of the finest images."""
MOST_COLUMNS = 4
"""Times as wide as high that the finest image is, at most."""
LOOKED_AT = (3, 6)
"""Sides from which errors are told, a quarter of the way to the next, at ELEVATION degrees."""
ELEVATION = 8.0


@dataclass(frozen=True, slots=True)
class SideImages:
    """A mesh from all sides, in one size."""

    rows: int
    """Pixels along the height of the mesh's box."""
    images: tuple[bytes, ...]
    """SIDES of them, WebP with alpha."""
    errors: tuple[float, ...]
    """For each of likeness.PIXELS, from between two sides; see levels.Level."""


def impostors_of(chunk: Chunk, materials: MaterialTable, bounds: NDArray[np.float64]) -> tuple[SideImages, ...]:
    """From fine to coarse; none of a mesh that is flat.

    bounds: (2, 3) of the mesh, metres: the boards' rectangles go round it. A tree of 11,000 triangles takes 0.8 s.
    """
    size = bounds[1] - bounds[0]
    if not (size > 1e-6 * size.max()).all():
        return ()
    views = [_view(chunk, materials, bounds, angle) for angle in side_angles(SIDES)]
    truth = Likeness.of(chunk, materials, [_between(side) for side in LOOKED_AT])
    found: list[SideImages] = []
    for rows in ROWS:
        pictures = [_picture(view, rows) for view in views]
        boards = [(_board(pictures[side], bounds, side), _table(pictures[side])) for side in LOOKED_AT]
        errors = truth.errors_by(boards)
        if found:
            errors = tuple(map(max, errors, found[-1].errors))
        found.append(SideImages(rows, tuple(map(_encoded, pictures)), errors))
    return tuple(found)


def impostor_image(
    chunk: Chunk, materials: MaterialTable, bounds: NDArray[np.float64], rows: int, angle: NDArray[np.float64]
) -> bytes:
    """A mesh as an eye at `angle` sees it, WebP with alpha. A statue of 248,000 triangles takes 16 to 29 ms.

    bounds: (2, 3) of the mesh, metres. rows: pixels of the image for the height of the bounds. angle: (2,) see
    `board.side_angles`.
    """
    return _encoded(_picture(_view(chunk, materials, bounds, angle), rows))


def _between(side: int) -> tuple[float, float]:
    """Azimuth and elevation in degrees, as `likeness.SIDES` has them: clockwise from y."""
    return 90.0 - 360.0 / SIDES * (side + 0.25), ELEVATION


def _view(
    chunk: Chunk, materials: MaterialTable, bounds: NDArray[np.float64], angle: NDArray[np.float64]
) -> NDArray[np.float32]:
    """(h, w, 4) of the finest image: linear colour of what is there in each pixel, and the share that is filled."""
    matrix = board_matrix(bounds, angle)
    right, toward, up = matrix[:, 0], matrix[:, 1], matrix[:, 2]
    pixels = ROWS[0] / float(bounds[1, 2] - bounds[0, 2])
    rows, columns = (
        int(np.clip(round(pixels * float(np.linalg.norm(side))), 1, MOST_COLUMNS * ROWS[0])) for side in (up, right)
    )
    axes = np.stack([right, -up, -toward])
    scale = np.array([columns, rows, rows]) / (axes * axes).sum(axis=1)
    lattice = np.concatenate([axes * scale[:, None], np.zeros((3, 1))], axis=1)
    # The upper left corner of the board lies on that of the image; nothing is nearer than its front.
    lattice[:, 3] = -lattice[:, :3] @ matrix[:, 3] + [columns / 2, rows / 2, 0.0]
    deep = np.abs(lattice[2, :3]) @ (bounds[1] - bounds[0])
    first, shape = np.array([0.0, 0.0, -deep]), (rows * SAMPLES, columns * SAMPLES)
    screen = np.empty((len(chunk.positions), 4), np.float32)
    project_orthographic(chunk.positions, lattice, first, SAMPLES, screen)
    depth, ids = nearest_surface(screen, chunk, materials, shape)
    planes, objects = np.empty((rows, columns, PLANES), np.float32), np.empty((rows, columns), np.uint32)
    turned = (axes / np.linalg.norm(axes, axis=1, keepdims=True)).astype(np.float32)
    none = np.empty((0, 0), np.float32)
    resolve(
        screen, chunk.surface, materials.arrays, turned, SAMPLES, np.float32(1e9), depth, ids, none, planes, objects
    )
    return np.concatenate([planes[..., 3:6], planes[..., 1:2]], axis=2)


def _picture(view: NDArray[np.float32], rows: int) -> Texture:
    """Of so many rows for the height of the mesh: as many pixels are filled as the shares add up to, the fullest."""
    rows, columns = (max(1, round(count * rows / ROWS[0])) for count in view.shape[:2])
    colors, filled = view[..., :3] * view[..., 3:], view[..., 3]
    parts = [_shrunk(plane, rows, columns) for plane in (*np.moveaxis(colors, 2, 0), filled)]
    share = parts[3]
    wanted = round(float(share.sum()))
    least = np.sort(share, axis=None)[::-1][min(wanted, share.size) - 1] if wanted else np.inf
    alpha = np.where((share >= least) & (share > 0), 255, 0)
    mean = colors.sum(axis=(0, 1)) / max(float(filled.sum()), 1e-9)
    color = [
        np.where(share > 0, part / np.maximum(share, 1e-9), whole)
        for part, whole in zip(parts, mean.tolist(), strict=False)
    ]
    rgb = np.rint(255 * srgb_from_linear(np.clip(np.stack(color, axis=2), 0.0, 1.0)))
    return Texture(np.concatenate([rgb, alpha[..., None]], axis=2).astype(np.uint8))


def _shrunk(plane: NDArray[np.float32], rows: int, columns: int) -> NDArray[np.float64]:
    """Means over the parts of a plane, by area."""
    if plane.shape == (rows, columns):
        return plane.astype(np.float64)
    image = Image.fromarray(np.ascontiguousarray(plane, np.float32), "F")
    return np.asarray(image.resize((columns, rows), Image.Resampling.BOX), np.float64)


def _encoded(picture: Texture) -> bytes:
    out = io.BytesIO()
    Image.fromarray(picture.pixels).save(out, "WEBP", quality=QUALITY, method=4)
    return out.getvalue()


def _board(picture: Texture, bounds: NDArray[np.float64], side: int) -> Chunk:
    board = BlockedMesh.from_mesh(board_mesh(picture))
    return board.placed(board_matrix(bounds, side_angles(SIDES)[side]), board.all_blocks).chunk()


def _table(picture: Texture) -> MaterialTable:
    return MaterialTable.build(board_mesh(picture).materials, TexturePool())
