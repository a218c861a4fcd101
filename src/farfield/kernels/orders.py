"""Which of a few values should come first: all their orders at once, by dynamic programming over subsets.

Held and Karp, A Dynamic Programming Approach to Sequencing Problems (1962): what a set of values takes does not depend
on their order, so behind a set only the
best order of the rest counts.
"""

from __future__ import annotations

import numpy as np
from numba import types

from farfield.kernels.compiling import device, kernel

_I32 = types.Array(types.int32, 1, "C", readonly=True)
_I64 = types.Array(types.int64, 1, "C", readonly=True)
_F32 = types.Array(types.float32, 1, "C", readonly=True)
_F64 = types.Array(types.float64, 1, "C", readonly=True)
_F32_3 = types.Array(types.float32, 3, "C", readonly=True)
_F32_2 = types.Array(types.float32, 2, "C", readonly=True)


@kernel(types.void(_F64, types.Array(types.int64, 1, "C")))
def largest(values, found):  # type: ignore[no-untyped-def]
    """Places of the largest values, the largest first, of equal ones the first.

    values: (m,) float64. found: (l,) int64 out, l no more than m. One pass: a sort of 7,000 takes ten times as long.
    """
    count = 0
    for n in range(values.shape[0]):
        if count == found.shape[0]:
            if values[n] <= values[found[count - 1]]:
                continue
            count -= 1
        place = count
        while place > 0 and values[found[place - 1]] < values[n]:
            found[place] = found[place - 1]
            place -= 1
        found[place] = n
        count += 1


@kernel(
    types.void(
        _I64, _I64, _I32, _I32, _F32_2, _F32_3, _F32_2, _F32, types.float64,
        types.Array(types.int32, 2, "C"), types.Array(types.float64, 3, "C"),
    )
)  # fmt: skip
def gains_beside(  # type: ignore[no-untyped-def]
    items, firsts, parts, objects, accuracy, held, visible, weights, least, places, gains
):
    """What each of l items adds a second, alone and beside each other one.

    items to least: as of kernels.benefit.added_benefits. places: (l, n) int32, -1 everywhere: room for the use of each
    object. gains: (l, l, k) float64 out, pixels: of the first beside the second; of each alone on the diagonal.
    """
    count = items.shape[0]
    for n in range(count):
        for use in range(firsts[items[n]], firsts[items[n] + 1]):
            places[n, objects[use]] = use
    for n in range(count):
        gains[n] = 0.0
        for use in range(firsts[items[n]], firsts[items[n] + 1]):
            thing = objects[use]
            for other in range(count):
                place = places[other, thing] if other != n else -1
                shown = parts[items[other]] if place >= 0 else 0
                for k in range(visible.shape[1]):
                    added = np.float32(0.0)
                    for part in range(parts[items[n]]):
                        best = held[thing, k, part]
                        if part < shown:
                            best = max(best, accuracy[place, k])
                        gain = accuracy[use, k] - best
                        if gain > least or (gain > np.float32(0.0) and best == np.float32(0.0)):
                            added += gain * weights[part]
                    gains[n, other, k] += added * visible[thing, k]


@device
def _added(gains, n, chosen, arrival, bounds):  # type: ignore[no-untyped-def]
    """The integral of what item n adds from its arrival on beside the chosen ones: no more than beside any of them."""
    total = 0.0
    for k in range(bounds.shape[0] - 1):
        begin = max(bounds[k], arrival)
        if begin < bounds[k + 1]:
            gain = gains[n, n, k]
            for other in range(gains.shape[0]):
                if chosen >> other & 1:
                    gain = min(gain, gains[n, other, k])
            total += gain * (bounds[k + 1] - begin)
    return total


@kernel(
    types.void(
        types.Array(types.float64, 3, "C", readonly=True), _F64, types.float64, _F64,
        types.Array(types.float64, 2, "C"), types.Array(types.float64, 1, "C"),
    )
)  # fmt: skip
def best_totals(gains, seconds, before, bounds, table, totals):  # type: ignore[no-untyped-def]
    """What l items add together in the best of all orders that begin with each of them.

    gains: as `gains_beside` leaves it. seconds: (l,) float64, that each takes. before: seconds from where bounds begin
    until one that takes no time would be there. bounds: (k + 1,) float64, seconds. table: (2, 2^l) float64, room.
    totals: (l,) float64 out, pixel seconds.
    """
    count = gains.shape[0]
    after, taken = table[0], table[1]
    for chosen in range(1 << count):
        taken[chosen] = before
        for n in range(count):
            if chosen >> n & 1:
                taken[chosen] += seconds[n]
    # What the best order adds after some are chosen: from all of them back to none.
    after[:] = 0.0
    for chosen in range((1 << count) - 2, 0, -1):
        for n in range(count):
            more = chosen | 1 << n
            if more != chosen:
                after[chosen] = max(after[chosen], _added(gains, n, chosen, taken[more], bounds) + after[more])
    for first in range(count):
        totals[first] = _added(gains, first, 0, taken[1 << first], bounds) + after[1 << first]
