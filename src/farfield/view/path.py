"""Recorded camera paths: `{"fps": 30, "frames": [{"t": s, "eye": [x,y,z], "target": [x,y,z], "fov": degrees}]}`."""

from __future__ import annotations

from pathlib import Path

import msgspec

from farfield.errors import InputError
from farfield.geometry.cameras import Camera
from farfield.world.limits import DAMAGE

Vector = tuple[float, float, float]


class PathFrame(msgspec.Struct, frozen=True):
    """One frame of a path."""

    t: float
    """Seconds from the start."""
    eye: Vector
    """Local metres."""
    target: Vector
    fov: float
    """Vertical field of view, degrees."""

    @property
    def camera(self) -> Camera:
        """The camera of the frame."""
        return Camera(self.eye, self.target, self.fov)


class CameraPath(msgspec.Struct, frozen=True):
    """A recorded path."""

    fps: float
    frames: tuple[PathFrame, ...]


def read_path(file: Path) -> CameraPath:
    """Reads a recorded path. Raises InputError when the file is missing or something else."""
    hint = 'a path is {"fps": …, "frames": [{"t", "eye", "target", "fov"}, …]}'
    try:
        found = msgspec.json.decode(file.read_bytes(), type=CameraPath)
    except OSError as error:
        raise InputError(f"cannot be read: {error.strerror}", str(file)) from None
    except DAMAGE as error:
        raise InputError(f"not a recorded path: {error}", str(file), hint) from None
    if not found.frames:
        raise InputError("a path without frames", str(file), hint)
    return found
