"""Coordinate reference systems: one frame for several sources, a local origin, metres instead of degrees."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from farfield.errors import InputError, MissingExtraError
from farfield.scene.assembly import join
from farfield.scene.model import Scene

ORIGIN_STEP = 1024.0
"""Local origins are multiples of this, metres."""
_FINEST = 2.0**-20
"""Metres: placements with a CRS are rounded to multiples of this. Within 2^32 m no sum of such is rounded any more, so
that a placement is the same whichever origins it was told from on the way: those depend on what else is read."""


def local_origin(low: tuple[float, float, float]) -> tuple[float, float, float]:
    """Lower corner floored to multiples of 1024 m; heights keep their zero unless the ground is above 1024 m."""
    x, y, z = (float(np.floor(value / ORIGIN_STEP) * ORIGIN_STEP) for value in low)
    return x, y, max(z, 0.0)


def to_common_frame(scenes: list[Scene], origin: tuple[float, float, float] | None = None) -> Scene:
    """Scenes joined. Those with a CRS are moved to `origin`, by default the lowest of theirs; the others are local.

    Raises InputError when their CRS differ.
    """
    located = [scene for scene in scenes if scene.crs is not None]
    if not located:
        joined = join(scenes)
        return joined if origin is None else replace(joined, origin=origin)
    different = {scene.crs for scene in located}
    if len(different) > 1:
        names = ", ".join(sorted(str(crs)[:40] for crs in different))
        raise InputError(f"the sources use different coordinate reference systems: {names}", "scene",
                         "give one as crs in a scene.toml; footprints are brought to it")  # fmt: skip
    # What holds nothing lies nowhere.
    placed = [scene for scene in located if len(scene.instances.mesh)] or located
    x, y, z = origin or (min(scene.origin[axis] for scene in placed) for axis in range(3))
    return join([scene if scene.crs is None else moved_to(scene, (x, y, z)) for scene in scenes])


def moved_to(scene: Scene, origin: tuple[float, float, float]) -> Scene:
    """The same scene, told from another origin; its placements are rounded to 2^-20 m (1 µm)."""
    transforms = scene.instances.transform.copy()
    transforms[:, :, 3] = _rounded(transforms[:, :, 3]) + (_rounded(scene.origin) - _rounded(origin))
    return replace(scene, instances=replace(scene.instances, transform=transforms), origin=origin)


def _rounded(metres: ArrayLike) -> NDArray[np.float64]:
    """To multiples of _FINEST, exactly."""
    return np.asarray(np.round(np.asarray(metres, np.float64) / _FINEST) * _FINEST)


def load_pyproj(where: str) -> Any:
    """The pyproj module. Raises MissingExtraError when it is not installed."""
    try:
        import pyproj
    except ImportError as error:
        raise MissingExtraError("coordinates in degrees need pyproj", "geo", where) from error
    return pyproj
