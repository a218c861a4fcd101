"""The rules of spec/drawing.md, Splats, one splat and one sample at a time, in double precision."""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np

from farfield.geometry.cameras import Camera
from farfield.geometry.directions import Direction
from farfield.geometry.normals import DECODED
from farfield.kernels.splat import FOOTPRINT
from farfield.octree.grid import Grid
from farfield.represent.orthoview.layer import OrthoLayer
from farfield.view.splats import Splats


@dataclass
class PlainFrame:
    """What is seen at each sample."""

    camera: Camera
    size: tuple[int, int]
    depth: np.ndarray = field(init=False)
    pixel: dict[tuple[int, int], tuple[int, int]] = field(default_factory=dict)
    """(row, column) of a sample -> (row, column) of the layer's pixel seen there."""

    def __post_init__(self) -> None:
        self.depth = np.full(self.size[::-1], np.inf)

    def put(self, x: int, y: int, z: float, j: int, i: int) -> None:
        inside = 0 <= x < self.size[0] and 0 <= y < self.size[1]
        if inside and z < self.depth[y, x]:
            self.depth[y, x] = z
            self.pixel[y, x] = (j, i)


def lattice_hash(column: int, row: int) -> float:
    """Rule 5: 0..1."""
    mask = 0xFFFFFFFF
    h = (((column & mask) * 0x9E3779B1) & mask) ^ (((row & mask) * 0x85EBCA77) & mask)
    h = ((h ^ (h >> 15)) * 0x2C1B3C6D) & mask
    h = ((h ^ (h >> 12)) * 0x297A2D39) & mask
    return (h ^ (h >> 15)) / 2**32


def splat(
    frame: PlainFrame, layer: OrthoLayer, direction: Direction, grid: Grid, level: int, box=None, splats=Splats.COVERED
) -> None:
    """Draws every valid pixel of the layer."""
    for j, i in np.argwhere(layer.valid):
        _splat_pixel(frame, layer, direction, grid.corner, grid.pitch(level), box, splats, int(j), int(i))


def _splat_pixel(frame, layer, direction, corner, p, box, splats, j, i):
    u, v, w = direction.axes
    eye = np.array(frame.camera.eye)
    point = np.array(corner) + u * (layer.x + i + 0.5) * p + v * (layer.y + j + 0.5) * p
    point = point + w * (layer.depth_base + int(layer.depth[j, i])) * p / 8
    if box is not None and not ((point >= box[0]) & (point < box[1])).all():
        return
    matrix = frame.camera.matrix(frame.size)[:, :3]
    c = point - eye
    screen, forward = matrix[:2], matrix[2]
    d = forward @ c
    if d <= 1e-4:
        return
    code = layer.normal[j, i].astype(int)
    nu, nv, away = (float(n) for n in DECODED[code[0] * 64 + code[1]])
    n = nu * u + nv * v - away * w
    connected = bool(layer.connected[j, i] & 1)
    if connected and n @ c >= 0:
        return
    front = d + p * (1 - abs(away))
    s = screen @ c / d
    elliptic = connected if splats in (Splats.CONNECTED, Splats.SPHERICITY, Splats.COVERED) else splats != Splats.DISCS
    if elliptic:
        nw = -max(away, 0.001)
        a, b = np.clip(-nu / nw, -4, 4), np.clip(-nv / nw, -4, 4)
        U, V = p * (u + a * w), p * (v + b * w)
        U_screen, V_screen = ((screen @ A - s * (forward @ A)) / d for A in (U, V))
        U_depth, V_depth = forward @ U, forward @ V
    else:
        rho = p * frame.camera.focal(frame.size) / d / (np.sqrt(2) if splats is Splats.DISCS else 1)
        U_screen, V_screen, U_depth, V_depth = np.array([rho, 0]), np.array([0, rho]), 0.0, 0.0
    if splats is Splats.WARPED_DISCS:
        rho = max(np.linalg.norm(U_screen + V_screen), np.linalg.norm(U_screen - V_screen)) / np.sqrt(2)
        U_screen, V_screen, U_depth, V_depth = np.array([rho, 0]), np.array([0, rho]), 0.0, 0.0
    share, whole = layer.coverage[j, i] / 16, abs(np.linalg.det(np.stack([U_screen, V_screen], 1)))
    if splats is Splats.DISCS:
        whole *= 2
    shrunk = FOOTPRINT[layer.coverage[j, i]]
    T = np.stack([U_screen, V_screen], 1) * shrunk
    area = np.pi / 2 * abs(np.linalg.det(T))
    x0, y0 = int(np.floor(s[0])), int(np.floor(s[1]))
    if area < 1:
        if lattice_hash(layer.x + i, layer.y + j) < (share * whole if whole >= 1 else 1 - (1 - share) ** whole):
            frame.put(x0, y0, front, j, i)
        return
    reach = np.sqrt((T * T).sum(1) / 2)
    if 2 * reach.max() > frame.size[1]:
        return
    reach += 1
    first = np.maximum(np.floor(s - reach), 0).astype(int)
    last = np.minimum(np.ceil(s + reach), np.array(frame.size) - 1).astype(int)
    for y in range(first[1], last[1] + 1):
        for x in range(first[0], last[0] + 1):
            alpha, beta = np.linalg.solve(T, [x + 0.5 - s[0], y + 0.5 - s[1]])
            if alpha**2 + beta**2 <= 0.5:
                frame.put(x, y, max(front + (alpha * U_depth + beta * V_depth) * shrunk, front / 2), j, i)
            elif (x, y) == (x0, y0):
                frame.put(x, y, front, j, i)
