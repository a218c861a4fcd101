"""Edge functions of screen triangles, shared by the two rasterisers.

Corners lie on a grid of 1/256 sample, so that edge functions are exact: in 32-bit integers for triangles up to
64 samples wide, in float64 for larger ones (exact while corners are within 2^17 samples). A sample on an edge
belongs to the triangle on the edge's right (below it, when the edge is horizontal): surfaces without cracks are drawn
without cracks, and no sample of a shared edge is drawn twice.
"""

from __future__ import annotations

import numpy as np

from farfield.kernels.compiling import device

SUBSAMPLES = 256
"""Steps of the corner grid per sample."""
SMALL = 64
"""Samples: triangles at most this wide and high have edge functions within 31 bits."""
BARELY_INSIDE = 2.0**-17
"""Edge functions are multiples of 2^-16 square samples: what is positive is at least this."""

_ZERO = np.float32(0.0)
_HALF = np.float32(0.5)
_SCALE = np.float32(SUBSAMPLES)
_SHIFT = 8
_MIDDLE = SUBSAMPLES // 2


@device
def closes(dx, dy):  # type: ignore[no-untyped-def]
    """Whether an edge whose function grows along (dx, dy) owns the samples that lie on it."""
    return dx > 0 or (dx == 0 and dy > 0)


@device
def bounding_samples(screen, ia, ib, ic, width, height):  # type: ignore[no-untyped-def]
    """(x0, x1, y0, y1, small): columns and rows (inclusive) a triangle may cover, none when x0 > x1 or y0 > y1."""
    ax = screen[ia, 0]
    ay = screen[ia, 1]
    low_x = min(ax, min(screen[ib, 0], screen[ic, 0]))
    low_y = min(ay, min(screen[ib, 1], screen[ic, 1]))
    high_x = max(ax, max(screen[ib, 0], screen[ic, 0]))
    high_y = max(ay, max(screen[ib, 1], screen[ic, 1]))
    right = np.float32(width)
    bottom = np.float32(height)
    if not (high_x > _ZERO and high_y > _ZERO and low_x < right and low_y < bottom):
        return 1, 0, 1, 0, False
    x0 = (np.int64(max(low_x, _ZERO) * _SCALE) + (_MIDDLE - 1)) >> _SHIFT
    y0 = (np.int64(max(low_y, _ZERO) * _SCALE) + (_MIDDLE - 1)) >> _SHIFT
    x1 = min((np.int64(min(high_x, right) * _SCALE) - _MIDDLE) >> _SHIFT, width - 1)
    y1 = min((np.int64(min(high_y, bottom) * _SCALE) - _MIDDLE) >> _SHIFT, height - 1)
    small = high_x - low_x <= np.float32(SMALL) and high_y - low_y <= np.float32(SMALL)
    return x0, x1, y0, y1, small


@device
def small_edges(ax, ay, bx, by, cx, cy, x0, y0):  # type: ignore[no-untyped-def]
    """Integer edge functions of a small triangle of positive area whose corners b, c are relative to a.

    Returns (area, eb, ec, right_b, right_c, down_b, down_c, bias_a, bias_b, bias_c), int32, in 2^-16 square samples:
    eb and ec (the weights of b and c times area) at sample (x0, y0), their steps to the next column and row, and
    what to add to each of ea, eb, ec so that a sample is inside when none is negative.
    """
    qbx = np.int32(bx * _SCALE)
    qby = np.int32(by * _SCALE)
    qcx = np.int32(cx * _SCALE)
    qcy = np.int32(cy * _SCALE)
    ox = np.int32((np.float32(x0) + _HALF - ax) * _SCALE)
    oy = np.int32((np.float32(y0) + _HALF - ay) * _SCALE)
    return (
        np.int32(qbx * qcy - qcx * qby),
        np.int32(ox * qcy - oy * qcx),
        np.int32(qbx * oy - qby * ox),
        np.int32(qcy * SUBSAMPLES),
        np.int32(-qby * SUBSAMPLES),
        np.int32(-qcx * SUBSAMPLES),
        np.int32(qbx * SUBSAMPLES),
        np.int32(0) if closes(qby - qcy, qcx - qbx) else np.int32(-1),
        np.int32(0) if closes(qcy, -qcx) else np.int32(-1),
        np.int32(0) if closes(-qby, qbx) else np.int32(-1),
    )


@device
def row_span(e, step, least, first, last):  # type: ignore[no-untyped-def]
    """Part of columns first..last (inclusive) where e + step * column >= least; exact in spite of the division."""
    if step == 0.0:
        return (first, last) if e >= least else (1, 0)
    if step > 0.0:
        first = np.int64(min(max((least - e) / step, float(first)), last + 1.0))
        while first <= last and e + step * first < least:
            first += 1
    else:
        last = np.int64(max(min((least - e) / step + 2.0, float(last) + 1.0), float(first))) - 1
        while last >= first and e + step * last < least:
            last -= 1
    return first, last


@device
def inside_span(bx, by, cx, cy, twice, ox, oy, count):  # type: ignore[no-untyped-def]
    """(first, last, eb, ec): columns inside a large triangle in the row whose column 0 is at (ox, oy) from corner a.

    Steps to the right are cy for eb and -by for ec; twice is the triangle's doubled area, positive.
    """
    eb = ox * cy - oy * cx
    ec = bx * oy - by * ox
    ea = twice - eb - ec
    first, last = row_span(eb, cy, 0.0 if closes(cy, -cx) else BARELY_INSIDE, 0, count - 1)
    first, last = row_span(ec, -by, 0.0 if closes(-by, bx) else BARELY_INSIDE, first, last)
    first, last = row_span(ea, by - cy, 0.0 if closes(by - cy, cx - bx) else BARELY_INSIDE, first, last)
    return first, last, eb, ec


@device
def corner_weights(ea, eb, ec, wa, wb, wc):  # type: ignore[no-untyped-def]
    """Perspective-correct weights (float32, sum 1) from edge functions and 1/w of the corners."""
    pa = np.float32(ea) * wa
    pb = np.float32(eb) * wb
    pc = np.float32(ec) * wc
    share = np.float32(1.0) / (pa + pb + pc)
    return pa * share, pb * share, pc * share
