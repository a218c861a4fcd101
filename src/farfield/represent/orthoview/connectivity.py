"""Connectivity of an orthoview's pixels (OV 5.2): drawn as ellipses of a surface, or as loose spheres."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from farfield.geometry.normals import DECODED
from farfield.kernels import connect
from farfield.represent.orthoview.layer import DEPTH_STEPS_PER_PIXEL, OrthoLayer
from farfield.represent.orthoview.tile import CONNECTED_BIT


@dataclass(frozen=True, slots=True)
class Connection:
    """When two neighbouring pixels belong to one surface. All limits exclusive."""

    depth: float = 4.0
    """tau 1: largest difference in depth, pixel pitches."""
    normal: float = 0.6
    """tau 2: largest sine of the angle between the line joining the points and either tangent plane."""
    sphericity: float = 0.5
    """tau 3: smallest product of one normal, mirrored halfway between the points, with the other."""
    neighbours: int = 4
    """A pixel with more connected neighbours than this, of eight, is connected."""


def mark_connected(layer: OrthoLayer, connection: Connection = Connection()) -> None:
    """Write bit 1 of `layer.connected` in place; bit 2 (unlit) stays.

    Neighbours outside the layer's rectangle count as missing, so the outermost pixels of a cell need all five that
    they have. Raises ValueError when `layer.connected` is read-only.
    """
    flags = layer.connected.copy()
    limits = np.array([connection.depth, connection.normal, connection.sphericity], np.float32)
    edges = np.zeros(layer.shape, np.uint8)
    closed = np.empty(layer.shape, np.uint8)
    depth, normal = np.ascontiguousarray(layer.depth), np.ascontiguousarray(layer.normal)
    connect.join(depth, normal, DECODED, limits, 1.0 / DEPTH_STEPS_PER_PIXEL, edges)
    connect.close(edges, connect.CLOSURES, closed)
    connect.mark(closed, connection.neighbours, CONNECTED_BIT, flags)
    layer.connected[...] = flags
