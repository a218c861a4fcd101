"""The shapes of splats: those that viewers draw, and those that the paper compares (OV 5.2, Figure 8 b to f)."""

from __future__ import annotations

from dataclasses import replace
from enum import Enum

import numpy as np

from farfield.kernels.splat import BY_FLAG, DISCS, ELLIPSES, WARPED_DISCS
from farfield.represent.orthoview.connectivity import Connection, mark_connected
from farfield.represent.orthoview.layer import COVERAGE_STEPS, OrthoLayer

_NO_SPHERICITY = Connection(sphericity=-2.0)
"""The product of unit vectors is never below -1."""


class Splats(Enum):
    """What pixels of orthoviews become on the screen. All but the last take every pixel for full."""

    DISCS = "discs"
    """b: discs inscribed in the pixel."""
    WARPED_DISCS = "warped-discs"
    """c: discs about the pixel warped by its normal (Shade et al. 1998)."""
    ELLIPSES = "ellipses"
    """d: the ellipse of the pixel warped by its normal (Botsch et al. 2005)."""
    CONNECTED = "connected"
    """e: ellipses of connected pixels, discs about the others; connected by depth and normal alone."""
    SPHERICITY = "sphericity"
    """f: the paper's choice: connected by sphericity as well."""
    COVERED = "covered"
    """As f, and each covers as much as its pixel is filled: what viewers draw (spec/drawing.md)."""

    @property
    def shape(self) -> int:
        """Of footprints, as `splat_layer` takes it."""
        return {Splats.DISCS: DISCS, Splats.WARPED_DISCS: WARPED_DISCS, Splats.ELLIPSES: ELLIPSES}.get(self, BY_FLAG)

    def applied(self, layer: OrthoLayer) -> OrthoLayer:
        """The layer with the coverage and the flags that these splats are drawn by."""
        if self is Splats.COVERED:
            return layer
        layer = replace(layer, coverage=np.where(layer.valid, COVERAGE_STEPS, 0).astype(np.uint8))
        if self is Splats.CONNECTED:
            layer = replace(layer, connected=layer.connected.copy())
            mark_connected(layer, _NO_SPHERICITY)
        return layer
