"""Checks on where things stand."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from farfield.errors import InputError
from farfield.scene.cleaning import ABSURD_METRES
from farfield.scene.faults import counted
from farfield.scene.model import Instances, Scene


def without_absurd(scene: Scene) -> Scene:
    """The scene without placements that are not finite or lie more than 10,000 km from the others; they are counted.

    Object ids stay as they are. Raises InputError when no placement is left.
    """
    transforms = scene.instances.transform
    good = np.isfinite(transforms).all((1, 2))
    if good.any():
        middle = np.median(transforms[good, :, 3], axis=0)
        with np.errstate(invalid="ignore"):
            good &= (np.abs(transforms[:, :, 3] - middle) <= ABSURD_METRES).all(1)
            good &= (np.abs(transforms[:, :, :3]) <= ABSURD_METRES).all((1, 2))
    if good.all():
        return scene
    lost = counted(int((~good).sum()), "placement")
    if not good.any():
        raise InputError(f"{lost} of meshes are NaN or infinite, and there are no others", "scene",
                         "check the transforms")  # fmt: skip
    names = sorted({scene.meshes[row].name for row in scene.instances.mesh[~good]})
    line = f"{names[0]}: left out {lost} that are NaN, infinite or more than 10,000 km from the rest"
    own = scene.instances
    kept = Instances(own.mesh[good], own.transform[good], own.first_object[good], own.objects[good])
    return replace(scene, instances=kept, warnings=(*scene.warnings, line))
