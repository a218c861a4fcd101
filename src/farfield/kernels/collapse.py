"""Edge collapse by quadric errors (kernels.quadrics): a pass over all edges, cheapest first.

A *place* is a position; a *wedge* is a place with one set of attributes, one material and one object: at a seam a place
has several. A place that moves onto a neighbour (a half-edge collapse) moves each of its wedges to one of the other
place's: to the one it shares an edge with, else to the one whose attributes fit best. That fit is part of the price, so
that a chart is not drawn over another, and seams stay seams.
"""

from __future__ import annotations

import math

import numpy as np
from numba import types

from farfield.kernels.compiling import device, kernel
from farfield.kernels.quadrics import SHAPE, SLOPE, best_point, corner_at, misfit_of, squared_error
from farfield.kernels.surface import F64_1, F64_2, I64_1, U8_1, U32_1, U32_2

MOST_AROUND = 64
"""Triangles around a place of several wedges beyond which it stays: the tip of a cone of flat faces has as many wedges
as faces, and looking for their partners would take the cube of them."""

LEAST_TURN = 0.2
"""Cosine of the angle by which a collapse may turn a triangle, 78 degrees."""

_STAYS = types.uint32(0xFFFFFFFF)
_INFINITE = np.inf


@device
def _target(triangles, places, groups, points, attributes, slopes, start, around, wedge, onto):  # type: ignore[no-untyped-def]
    """Wedge of the place `onto` that a wedge goes to, and the misfit; _STAYS when none is of its group."""
    x = points[onto, 0]
    y = points[onto, 1]
    z = points[onto, 2]
    p = places[wedge]
    best = _STAYS
    least = _INFINITE
    for i in range(start[p], start[p + 1]):
        t = around[i]
        if triangles[t, 0] == wedge or triangles[t, 1] == wedge or triangles[t, 2] == wedge:
            for k in range(3):
                other = triangles[t, k]
                if places[other] == onto and other != best:
                    misfit = misfit_of(slopes, attributes, wedge, other, x, y, z)
                    if misfit < least:
                        best = other
                        least = misfit
    if best != _STAYS:
        return best, least
    for i in range(start[onto], start[onto + 1]):
        t = around[i]
        for k in range(3):
            other = triangles[t, k]
            if places[other] == onto and groups[other] == groups[wedge] and other != best:
                misfit = misfit_of(slopes, attributes, wedge, other, x, y, z)
                if misfit < least:
                    best = other
                    least = misfit
    return best, least


@device
def _is_first(triangles, places, start, around, i, p, wedge):  # type: ignore[no-untyped-def]
    """Whether no earlier triangle around a place has that wedge."""
    for j in range(start[p], i):
        t = around[j]
        if triangles[t, 0] == wedge or triangles[t, 1] == wedge or triangles[t, 2] == wedge:
            return False
    return True


@device
def _price(triangles, places, groups, points, attributes, shapes, slopes, single, start, around, p, onto):  # type: ignore[no-untyped-def]
    """Mean squared error of moving a place onto another; infinite when it may not."""
    x = points[onto, 0]
    y = points[onto, 1]
    z = points[onto, 2]
    total = squared_error(shapes[p], x, y, z)
    if not single[p] and start[p + 1] - start[p] > MOST_AROUND:
        return _INFINITE
    for i in range(start[p], start[p + 1]):
        wedge = corner_at(triangles, places, around[i], p)
        if not single[p] and not _is_first(triangles, places, start, around, i, p, wedge):
            continue
        target, misfit = _target(triangles, places, groups, points, attributes, slopes, start, around, wedge, onto)
        if target == _STAYS:
            return _INFINITE
        total += misfit
        if single[p]:
            break
    return max(total, 0.0) / max(shapes[p, 10], 1e-300)


@kernel(
    types.int64(
        U32_2, U32_1, U32_1, F64_2, F64_2, F64_2, F64_2, U8_1, I64_1, U32_1, F64_1, U32_1, U32_1,
    )
)  # fmt: skip
def price_edges(
    triangles, places, groups, points, attributes, shapes, slopes, single, start, around, prices, moved, onto
):  # type: ignore[no-untyped-def]
    """Prices of all edges, each in its cheaper direction. Returns how many edges may be collapsed.

    Arguments as those of `sum_quadrics`, and its results. single: (p,) uint8, 1 = a place of one wedge.
    prices: (3 m,) float64, moved, onto: (3 m,) uint32 places out.
    """
    count = 0
    for t in range(triangles.shape[0]):
        for k in range(3):
            p = places[triangles[t, k]]
            q = places[triangles[t, (k + 1) % 3]]
            if p > q:
                # The triangle across has the edge the other way round; a border has it only here.
                mirrored = False
                for i in range(start[p], start[p + 1]):
                    other = around[i]
                    for j in range(3):
                        if places[triangles[other, j]] == q and places[triangles[other, (j + 1) % 3]] == p:
                            mirrored = True
                if mirrored:
                    continue
            there = _price(triangles, places, groups, points, attributes, shapes, slopes, single, start, around, p, q)
            back = _price(triangles, places, groups, points, attributes, shapes, slopes, single, start, around, q, p)
            if min(there, back) == _INFINITE:
                continue
            prices[count] = min(there, back)
            moved[count] = p if there <= back else q
            onto[count] = q if there <= back else p
            count += 1
    return count


@device
def _after(points, place, p, q, x, y, z):  # type: ignore[no-untyped-def]
    if place in (p, q):
        return x, y, z
    return points[place, 0], points[place, 1], points[place, 2]


@device
def _turns(points, triangles, places, went, t, p, q, x, y, z):  # type: ignore[no-untyped-def]
    """Whether a triangle would face elsewhere, or lose its area, if its corner at p or q went to (x, y, z).

    One that has corners at both, or has had two at one place before, is none.
    """
    a = went[places[triangles[t, 0]]]
    b = went[places[triangles[t, 1]]]
    c = went[places[triangles[t, 2]]]
    if a == b or b == c or c == a:
        return False
    if (a == p or b == p or c == p) and (a == q or b == q or c == q):
        return False
    ux = points[b, 0] - points[a, 0]
    uy = points[b, 1] - points[a, 1]
    uz = points[b, 2] - points[a, 2]
    vx = points[c, 0] - points[a, 0]
    vy = points[c, 1] - points[a, 1]
    vz = points[c, 2] - points[a, 2]
    nx = uy * vz - uz * vy
    ny = uz * vx - ux * vz
    nz = ux * vy - uy * vx
    ax, ay, az = _after(points, a, p, q, x, y, z)
    bx, by, bz = _after(points, b, p, q, x, y, z)
    cx, cy, cz = _after(points, c, p, q, x, y, z)
    ux = bx - ax
    uy = by - ay
    uz = bz - az
    vx = cx - ax
    vy = cy - ay
    vz = cz - az
    mx = uy * vz - uz * vy
    my = uz * vx - ux * vz
    mz = ux * vy - uy * vx
    before = nx * nx + ny * ny + nz * nz
    after = mx * mx + my * my + mz * mz
    uu = ux * ux + uy * uy + uz * uz
    vv = vx * vx + vy * vy + vz * vz
    if after <= 1e-6 * uu * vv:
        return True
    return nx * mx + ny * my + nz * mz < LEAST_TURN * math.sqrt(before * after)


@device
def _any_turns(points, triangles, places, went, start, around, at, p, q, x, y, z):  # type: ignore[no-untyped-def]
    for j in range(start[at], start[at + 1]):
        if _turns(points, triangles, places, went, around[j], p, q, x, y, z):
            return True
    return False


@device
def _stays(triangles, places, owners, went, start, around, at, other, owner):  # type: ignore[no-untyped-def]
    """Whether a triangle of an object at one place is without a corner at the other."""
    for j in range(start[at], start[at + 1]):
        t = around[j]
        if owners[triangles[t, 0]] == owner:
            a = went[places[triangles[t, 0]]]
            b = went[places[triangles[t, 1]]]
            c = went[places[triangles[t, 2]]]
            if a != b and b != c and c != a and a != other and b != other and c != other:
                return True
    return False


@device
def _is_last(triangles, places, owners, went, start, around, p, q):  # type: ignore[no-untyped-def]
    """Whether nothing would be left of an object at p and q: no object vanishes by collapsing edges."""
    last = _STAYS
    for j in range(start[p], start[p + 1]):
        owner = owners[triangles[around[j], 0]]
        if owner != last:
            last = owner
            if not _stays(triangles, places, owners, went, start, around, p, q, owner) and not _stays(
                triangles, places, owners, went, start, around, q, p, owner
            ):
                return True
    return False


@device
def _move(triangles, places, points, attributes, slopes, start, around, q, x, y, z):  # type: ignore[no-untyped-def]
    """Moves a place, and the attributes of its wedges by their mean slopes."""
    dx = x - points[q, 0]
    dy = y - points[q, 1]
    dz = z - points[q, 2]
    if dx == 0.0 and dy == 0.0 and dz == 0.0:
        return
    for i in range(start[q], start[q + 1]):
        wedge = corner_at(triangles, places, around[i], q)
        if not _is_first(triangles, places, start, around, i, q, wedge):
            continue
        row = slopes[wedge]
        for k in range(attributes.shape[1]):
            first = SHAPE + SLOPE * k
            if row[first + 4] > 0.0:
                change = row[first] * dx + row[first + 1] * dy + row[first + 2] * dz
                attributes[wedge, k] += change / row[first + 4]
    points[q, 0] = x
    points[q, 1] = y
    points[q, 2] = z


@kernel(
    types.int64(
        U32_2, U32_1, U32_1, U32_1, F64_2, F64_2, F64_2, F64_2, F64_2, I64_1, U32_1, F64_1, U32_1, U32_1, I64_1,
        types.float64, types.int64, U8_1, U32_1, U32_1,
    )
)  # fmt: skip
def collapse(
    triangles, places, groups, owners, points, attributes, shapes, slopes, sums, start, around, prices, moved, onto,
    order, most, unwanted, busy, went, became,
):  # type: ignore[no-untyped-def]  # fmt: skip
    """Collapses edges in an order; places of a collapsed edge take no part in another. Returns how many triangles go.

    What is left of an edge moves to where it fits the planes of both ends; points and attributes change.

    Arguments as those of `price_edges`, and its results. owners: (w,) uint32 object of each wedge. sums: (w, s)
    float64, what adds up where wedges become one. order: (e,) int64. most: highest price. unwanted: triangles that are
    to go. busy: (p,) uint8 of zeros. went: (p,) uint32, became: (w,) uint32, both of their own numbers: place and wedge
    that each has become, out.
    """
    gone = 0
    for i in range(order.shape[0]):
        edge = order[i]
        if gone >= unwanted or prices[edge] > most:
            break
        p = moved[edge]
        q = onto[edge]
        if busy[p] or busy[q]:
            continue
        if _is_last(triangles, places, owners, went, start, around, p, q):
            continue
        x, y, z = best_point(points, shapes, p, q)
        if _any_turns(points, triangles, places, went, start, around, p, p, q, x, y, z) or _any_turns(
            points, triangles, places, went, start, around, q, p, q, x, y, z
        ):
            x = points[q, 0]
            y = points[q, 1]
            z = points[q, 2]
            if _any_turns(points, triangles, places, went, start, around, p, p, q, x, y, z):
                continue
        for j in range(start[p], start[p + 1]):
            t = around[j]
            for k in range(3):
                if went[places[triangles[t, k]]] == q:
                    gone += 1
                    break
            wedge = corner_at(triangles, places, t, p)
            if became[wedge] != wedge:
                continue
            target, _ = _target(triangles, places, groups, points, attributes, slopes, start, around, wedge, q)
            became[wedge] = target
            for k in range(slopes.shape[1]):
                slopes[target, k] += slopes[wedge, k]
            for k in range(sums.shape[1]):
                sums[target, k] += sums[wedge, k]
        for k in range(SHAPE):
            shapes[q, k] += shapes[p, k]
        _move(triangles, places, points, attributes, slopes, start, around, q, x, y, z)
        went[p] = q
        busy[p] = 1
        busy[q] = 1
    return gone


@kernel(types.void(U32_2, U32_1, U32_1))
def join_places(triangles, places, component):  # type: ignore[no-untyped-def]
    """Connected components: component (p,) uint32, of its own numbers; out the lowest place of each one's component."""
    for t in range(triangles.shape[0]):
        for k in range(2):
            a = places[triangles[t, k]]
            b = places[triangles[t, k + 1]]
            while component[a] != a:
                component[a] = component[component[a]]
                a = component[a]
            while component[b] != b:
                component[b] = component[component[b]]
                b = component[b]
            if a < b:
                component[b] = a
            else:
                component[a] = b
    for p in range(component.shape[0]):
        component[p] = component[component[p]]
