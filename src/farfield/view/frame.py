"""The supersampled frame that layers are splatted into and pictures come out of (spec/drawing.md)."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from farfield.geometry.cameras import Camera
from farfield.geometry.directions import Direction
from farfield.kernels import average, splat
from farfield.octree.grid import Grid
from farfield.represent.orthoview.layer import OrthoLayer
from farfield.view.picture import Picture
from farfield.view.shading import Light
from farfield.view.splats import Splats

NEAR_PLANE = 1e-4
"""Metres in front of the eye from which on splats are drawn."""
WIDEST_FILLING = 1 / 96
"""Of the frame's height: wider discs of leaves, as cells far above have them, show nothing of leaves."""
_NO_OBJECTS = np.zeros((0, 0), np.uint32)


@dataclass(frozen=True, slots=True)
class Frame:
    """Samples of a picture, k x k a pixel; written by the kernels of farfield.kernels.splat."""

    camera: Camera
    size: tuple[int, int]
    """Width and height of the picture, pixels."""
    supersampling: int
    """k, samples a pixel along each axis."""
    depth: NDArray[np.float32]
    """(k h, k w) float32 metres along the view axis; inf = nothing."""
    surface: NDArray[np.uint32]
    """(k h, k w) uint32 sRGB albedo and light byte, see splat_layer."""
    normal: NDArray[np.uint32]
    """(k h, k w) uint32 packed world normals, or (0, 0)."""
    objects: NDArray[np.uint32]
    """(k h, k w) uint32 object ids, or (0, 0)."""

    @classmethod
    def empty(
        cls, camera: Camera, size: tuple[int, int], supersampling: int, normals: bool = False, objects: bool = False
    ) -> Frame:
        """A frame with nothing in it; normals, objects: whether to keep those layers."""
        shape = size[1] * supersampling, size[0] * supersampling
        return cls(
            camera,
            size,
            supersampling,
            np.full(shape, np.inf, np.float32),
            np.zeros(shape, np.uint32),
            np.zeros(shape if normals else (0, 0), np.uint32),
            np.zeros(shape if objects else (0, 0), np.uint32),
        )

    @property
    def sample_size(self) -> tuple[int, int]:
        """Width and height in samples."""
        return self.size[0] * self.supersampling, self.size[1] * self.supersampling

    def splat(
        self,
        layer: OrthoLayer,
        direction: Direction,
        grid: Grid,
        level: int,
        light: Light,
        box: NDArray[np.float64] | None = None,
        splats: Splats = Splats.COVERED,
        moved: NDArray[np.float64] | None = None,
        is_filling: bool = False,
    ) -> int:
        """Draws one layer of an orthoview; returns the number of splats in the frame.

        box: (2, 3) local metres to clip to, half-open; None: no clipping. splats: their shapes. moved: (3,) metres by
        which all of it is drawn elsewhere; None: it is not. is_filling: whether it fills gaps of what is there, which
        it must not hide.
        """
        layer = splats.applied(layer)
        widest = WIDEST_FILLING * self.sample_size[1] if is_filling else np.inf
        return int(
            splat.splat_layer(
                layer.depth, layer.color, layer.normal, layer.length, layer.coverage, layer.connected,
                _NO_OBJECTS if layer.objects is None else layer.objects, layer.x, layer.y,
                self._placement(layer, direction, grid, level, light, box, moved),
                np.float32(grid.pitch(level)), np.float32(NEAR_PLANE), np.float32(widest), box is not None,
                splats.shape,
                self.depth, self.surface, self.normal, self.objects,
            )
        )  # fmt: skip

    def _placement(
        self,
        layer: OrthoLayer,
        direction: Direction,
        grid: Grid,
        level: int,
        light: Light,
        box: NDArray[np.float64] | None,
        moved: NDArray[np.float64] | None,
    ) -> NDArray[np.float32]:
        """(10, 3) float32, see splat_layer; differences of large coordinates are taken in double precision."""
        axes, eye = direction.axes, np.array(self.camera.eye, dtype=np.float64)
        eye = eye if moved is None else eye - moved
        placement = np.zeros((10, 3))
        corner = np.array([layer.x, layer.y, layer.depth_base / 8]) * grid.pitch(level)
        placement[splat.ORIGIN] = axes @ (np.array(grid.corner) - eye) + corner
        placement[splat.TO_X : splat.TO_W + 1] = self.camera.matrix(self.sample_size)[:, :3] @ axes.T
        placement[splat.SUN] = axes @ light.sun
        if box is not None:
            placement[splat.LOWER], placement[splat.UPPER] = box - eye
        placement[splat.WORLD_X : splat.WORLD_Z + 1] = axes.T
        return placement.astype(np.float32)

    def develop(self, light: Light) -> Picture:
        """Lights the samples, puts haze before them and averages them to a picture."""
        width, height = self.size
        picture = Picture(
            np.empty((height, width, 3), np.float32),
            np.empty((height, width), np.float32),
            np.empty((height, width), np.float32),
            np.empty((height, width, 3), np.float32) if self.normal.size else None,
            np.empty((height, width), np.uint32) if self.objects.size else None,
        )
        k = self.supersampling
        veil = light.veil(self.camera, self.size)
        average.average_color(
            self.depth, self.surface, light.terms, veil, k, picture.color, picture.alpha, picture.depth
        )
        if picture.normal is not None:
            average.average_normals(self.depth, self.normal, k, picture.normal)
        if picture.ids is not None:
            average.nearest_object(self.depth, self.objects, k, picture.ids)
        return picture
