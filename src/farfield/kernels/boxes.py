"""Boxes on the screen: the rectangle that a box takes in pictures from many poses (BEN 4.2)."""

from __future__ import annotations

import numpy as np
from numba import types

from farfield.kernels.compiling import device, kernel

_NEAR = 1e-3
"""Least distance along the view axis, as a share of the box's diagonal; behind it nothing projects."""
_BOXES = types.Array(types.float64, 2, "C", readonly=True)
_EYES = types.Array(types.float64, 2, "C", readonly=True)
_AXES = types.Array(types.float64, 3, "C", readonly=True)


@device
def _corner(box, eye, axes, number):  # type: ignore[no-untyped-def]
    """Right, down and forward of a corner from the eye, metres; bit a of its number: the upper side of axis a."""
    right, down, forward = 0.0, 0.0, 0.0
    for axis in range(3):
        by = box[axis + 3 * ((number >> axis) & 1)] - eye[axis]
        right += by * axes[0, axis]
        down += by * axes[1, axis]
        forward += by * axes[2, axis]
    return right, down, forward


@kernel(
    types.void(
        _BOXES, _EYES, _AXES, types.int64, types.float64, types.float64, types.float64,
        types.Array(types.float32, 3, "C"),
    )
)  # fmt: skip
def see_boxes(boxes, eyes, axes, own, focal, width, height, seen):  # type: ignore[no-untyped-def]
    """The bounding rectangle of each box's projection, from each pose.

    boxes: (n, 6) float64, lower and upper corner, local metres. eyes: (p, 3) float64, local metres. axes: (p, 3, 3)
    float64, rows right, down, forward. own: 0 for k = p poses of all boxes, 1 for one pose of each: p = n, k = 1.
    focal: pixels of one unit at distance one. width, height: of the picture, pixels.
    seen: (n, k, 3) float32 out: pixels of the rectangle within the picture, pixels of the whole rectangle, and its
    height in pixels; zeros for what lies behind the eye. What passes the eye is cut off close before it.
    """
    for n in range(boxes.shape[0]):
        box = boxes[n]
        diagonal = 0.0
        for axis in range(3):
            diagonal += (box[axis + 3] - box[axis]) ** 2
        near = max(_NEAR * diagonal**0.5, 1e-9)
        for k in range(seen.shape[1]):
            pose = n if own else k
            left, top, right, bottom = np.inf, np.inf, -np.inf, -np.inf
            before = 0
            for number in range(8):
                x, y, w = _corner(box, eyes[pose], axes[pose], number)
                if w < near:
                    continue
                before += 1
                left, right = min(left, x / w), max(right, x / w)
                top, bottom = min(top, y / w), max(bottom, y / w)
            if before == 0:
                seen[n, k, 0] = seen[n, k, 1] = seen[n, k, 2] = 0.0
                continue
            if before < 8:
                for number in range(8):
                    x, y, w = _corner(box, eyes[pose], axes[pose], number)
                    for axis in range(3):
                        if (number >> axis) & 1:
                            continue
                        to_x, to_y, to_w = _corner(box, eyes[pose], axes[pose], number | (1 << axis))
                        if (w < near) == (to_w < near):
                            continue
                        share = (near - w) / (to_w - w)
                        at_x, at_y = (x + share * (to_x - x)) / near, (y + share * (to_y - y)) / near
                        left, right = min(left, at_x), max(right, at_x)
                        top, bottom = min(top, at_y), max(bottom, at_y)
            left, right = left * focal + width / 2, right * focal + width / 2
            top, bottom = top * focal + height / 2, bottom * focal + height / 2
            across = max(min(right, width) - max(left, 0.0), 0.0)
            down = max(min(bottom, height) - max(top, 0.0), 0.0)
            seen[n, k, 0] = across * down
            seen[n, k, 1] = (right - left) * (bottom - top)
            seen[n, k, 2] = bottom - top
