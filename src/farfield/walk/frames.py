"""Frames of a walk as they were seen, drawn by the reference renderer from what was held, beside the true ones."""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from farfield.geometry.cameras import Camera
from farfield.quality.metrics import flip_map, psnr
from farfield.view.renderer import RenderOptions, render_world
from farfield.view.tiles import TileCache
from farfield.walk.observer import Pose
from farfield.world.world import World

Pixels = NDArray[np.uint8]
SUPERSAMPLING = 4
"""Samples a pixel along each axis."""


@dataclass(frozen=True, slots=True)
class Frame:
    """A moment of a walk as a picture."""

    second: float
    psnr: float
    """dB, to the true picture."""
    flip: float
    shown: Pixels
    """(h, w, 3) sRGB."""
    true: Pixels

    def facts(self) -> dict[str, float]:
        """What is told of it."""
        return {"second": self.second, "psnr": round(self.psnr, 2), "flip": round(self.flip, 4)}


class FrameDrawer:
    """Draws frames of one world."""

    def __init__(
        self,
        world: World,
        size: tuple[int, int],
        near_radius: float | None = None,
        beside: FrameDrawer | None = None,
    ) -> None:
        """size: width and height, pixels. near_radius: metres; None: r, as the cut defines it.

        beside: another of the same world and size, whose true pictures are taken.
        """
        self._world, self._size, self._near_radius = world, size, near_radius
        self._cache = TileCache(world)
        self._true: dict[tuple[float, ...], Pixels] = {} if beside is None else beside._true

    def frame(self, second: float, pose: Pose, held: set[str]) -> Frame:
        """What a viewer with these values sees. Raises MissingExtraError without flip-evaluator."""
        camera = _camera(pose)
        shown = self._drawn(
            camera, RenderOptions(supersampling=SUPERSAMPLING, near_radius=self._near_radius, held=held)
        )
        true = self.true(camera)
        return Frame(second, float(psnr(true, shown)), float(flip_map(true, shown).mean()), shown, true)

    def true(self, camera: Camera) -> Pixels:
        """All leaves as geometry; drawn once of each camera."""
        name = (*camera.eye, *camera.target, camera.fov)
        if name not in self._true:
            self._true[name] = self._drawn(camera, RenderOptions(supersampling=SUPERSAMPLING, near_radius=math.inf))
        return self._true[name]

    def _drawn(self, camera: Camera, options: RenderOptions) -> Pixels:
        picture = render_world(self._world, camera, self._size, options, self._cache)
        return picture.pixels(options.light.backdrop(camera, self._size))


def frames(
    drawer: FrameDrawer, arrivals: Sequence[tuple[float, str]], poses: Sequence[tuple[float, Pose]]
) -> Iterator[Frame]:
    """One of each pose, with what had arrived by its time. Both ascend; seconds."""
    for at, pose in poses:
        yield drawer.frame(at, pose, {key for time, key in arrivals if time <= at})


def _camera(pose: Pose) -> Camera:
    eye, forward = pose.eye.tolist(), pose.forward.tolist()
    return Camera((eye[0], eye[1], eye[2]), (eye[0] + forward[0], eye[1] + forward[1], eye[2] + forward[2]), pose.fov)
