"""Prices of edges against a plain twin, and what a pass leaves."""

from __future__ import annotations

import numpy as np
import trimesh
from numpy.typing import NDArray

from farfield.kernels.collapse import collapse, price_edges
from farfield.kernels.quadrics import SHAPE, SLOPE, sum_quadrics, triangles_around

FIRMNESS = 10.0
WEIGHT = 0.3
Prices = dict[tuple[int, int], float]


def plain_prices(points: NDArray[np.float64], faces: NDArray[np.uint32], values: NDArray[np.float64]) -> Prices:
    """Mean squared error of moving a corner onto a neighbour: from the planes, borders and slopes around it."""
    sides = [tuple(int(v) for v in (face[k], face[(k + 1) % 3])) for face in faces for k in range(3)]
    prices = {}
    for p, q in {pair for side in sides for pair in (side, side[::-1])}:
        total = weights = 0.0
        for face in faces[(faces == p).any(axis=1)]:
            a, b, c = points[face]
            normal = np.cross(b - a, c - a)
            length = float(np.linalg.norm(normal))
            normal /= length
            weight = length**0.5
            weights += weight
            total += weight * float(normal @ (points[q] - a)) ** 2
            gradient = np.linalg.lstsq(
                np.stack([b - a, c - a, normal]), [*(values[face[1:], 0] - values[face[0], 0]), 0]
            )
            expected = values[face[0], 0] + gradient[0] @ (points[q] - a)
            total += weight * WEIGHT**2 * float(expected - values[q, 0]) ** 2
            for k in range(3):
                i, j = int(face[k]), int(face[(k + 1) % 3])
                if p in (i, j) and (j, i) not in sides:
                    along = points[j] - points[i]
                    across = np.cross(along, normal) / np.linalg.norm(along)
                    total += FIRMNESS * np.linalg.norm(along) * float(across @ (points[q] - points[i])) ** 2
        prices[p, q] = total / weights
    return prices


class Setting:
    """A mesh whose corners all have one wedge."""

    def __init__(self, shape: trimesh.Trimesh) -> None:
        self.points = np.array(shape.vertices)
        self.faces = np.array(shape.faces, np.uint32)
        self.values = np.random.default_rng(2).normal(size=(len(self.points), 1))
        self.own = np.arange(len(self.points), dtype=np.uint32)
        self.group = np.zeros_like(self.own)
        self.start, self.around = np.empty(len(self.points) + 1, np.int64), np.empty(self.faces.size, np.uint32)
        triangles_around(self.faces, self.own, self.start, self.around)
        self.shapes = np.zeros((len(self.points), SHAPE))
        self.slopes = np.zeros((len(self.points), SHAPE + SLOPE))
        sum_quadrics(
            self.faces, self.own, self.group, self.points, self.values, np.array([WEIGHT]), self.start, self.around,
            FIRMNESS, self.shapes, self.slopes,
        )  # fmt: skip
        self.prices = np.empty(self.faces.size)
        self.moved, self.onto = (np.empty(self.faces.size, np.uint32) for _ in range(2))
        single = np.ones(len(self.points), np.uint8)
        self.count = price_edges(
            self.faces, self.own, self.group, self.points, self.values, self.shapes, self.slopes, single, self.start,
            self.around, self.prices, self.moved, self.onto,
        )  # fmt: skip

    def collapse(self, unwanted: int) -> tuple[int, NDArray[np.uint32]]:
        went, became = self.own.copy(), self.own.copy()
        order = np.argsort(self.prices[: self.count], kind="stable")
        busy, sums = np.zeros(len(self.points), np.uint8), np.ones((len(self.points), 1))
        gone = collapse(
            self.faces, self.own, self.group, self.group, self.points, self.values, self.shapes, self.slopes, sums,
            self.start, self.around, self.prices, self.moved, self.onto, order, np.inf, unwanted, busy, went, became,
        )  # fmt: skip
        assert (went == became).all()
        assert sums[np.unique(became)].sum() >= len(self.points)
        return gone, became


def open_sphere() -> trimesh.Trimesh:
    sphere = trimesh.creation.icosphere(2)
    return trimesh.Trimesh(sphere.vertices, sphere.faces[:200], process=True)


def test_prices_are_those_of_the_plain_twin() -> None:
    mesh = Setting(open_sphere())
    expected = plain_prices(mesh.points, mesh.faces, mesh.values)
    assert mesh.count == len(expected) // 2
    for price, p, q in zip(mesh.prices[: mesh.count], mesh.moved, mesh.onto, strict=False):
        pair = int(p), int(q)
        np.testing.assert_allclose(price, expected[pair], rtol=1e-6, atol=1e-12)
        assert expected[pair] <= expected[pair[::-1]] * (1 + 1e-6) + 1e-12


def test_a_pass_takes_as_many_triangles_as_it_says() -> None:
    mesh = Setting(trimesh.creation.icosphere(3))
    gone, became = mesh.collapse(200)
    left = became[mesh.faces]
    flat = (left[:, 0] == left[:, 1]) | (left[:, 1] == left[:, 2]) | (left[:, 2] == left[:, 0])
    assert gone == np.count_nonzero(flat)
    assert 200 <= gone <= 201
    solid = trimesh.Trimesh(mesh.points, left[~flat], process=False)
    assert solid.is_watertight
    assert solid.is_winding_consistent


def test_nothing_vanishes() -> None:
    mesh = Setting(trimesh.creation.box())
    for _ in range(8):
        gone, became = mesh.collapse(100)
        mesh.faces = became[mesh.faces]
        corners = mesh.faces.T
        mesh.faces = mesh.faces[(corners != np.roll(corners, 1, axis=0)).all(axis=0)]
        if not gone:
            break
        mesh.around = np.empty(mesh.faces.size, np.uint32)
        triangles_around(mesh.faces, mesh.own, mesh.start, mesh.around)
        mesh.count = price_edges(
            mesh.faces, mesh.own, mesh.group, mesh.points, mesh.values, mesh.shapes, mesh.slopes,
            np.ones(len(mesh.points), np.uint8), mesh.start, mesh.around, mesh.prices, mesh.moved, mesh.onto,
        )  # fmt: skip
    assert len(mesh.faces) >= 2
