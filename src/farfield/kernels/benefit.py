"""What a value would add to the picture for the time that it takes: the added-benefit integral (BEN 5)."""

from __future__ import annotations

import numpy as np
from numba import types

from farfield.kernels.compiling import kernel

_I32 = types.Array(types.int32, 1, "C", readonly=True)
_I64 = types.Array(types.int64, 1, "C", readonly=True)
_F32 = types.Array(types.float32, 1, "C", readonly=True)
_F64 = types.Array(types.float64, 1, "C", readonly=True)
_F32_3 = types.Array(types.float32, 3, "C", readonly=True)
_F32_2 = types.Array(types.float32, 2, "C", readonly=True)


@kernel(
    types.void(
        _I64, _F64, _I64, _I32, _I32, _F32_2, _F32_3, _F32_2, _F64, _F32, types.float64,
        types.Array(types.float64, 1, "C"),
    )
)  # fmt: skip
def added_benefits(  # type: ignore[no-untyped-def]
    items, arrivals, firsts, parts, objects, accuracy, held, visible, bounds, weights, least, benefits
):
    """The integral of what each item adds from its arrival to the cut-off.

    items: (l,) int64, numbers of the items to look at. arrivals: (l,) float64, when each would be there, seconds from
    where bounds begin. firsts: (m + 1,) int64: uses firsts[i] to firsts[i + 1] - 1 are those of item i. parts: (m,)
    int32, how many parts of its objects it shows. objects: (u,) int32, the object of each use. accuracy: (u, k)
    float32, of the use in each interval. held: (n, k, p) float32, accuracy of the best that each part of each object
    has. visible: (n, k) float32, pixels, times importance. bounds: (k + 1,) float64, seconds. weights: (p,) float32,
    of the parts. least: gains that change a picture less do not count. benefits: (l,) float64 out, pixel seconds.
    """
    intervals = bounds.shape[0] - 1
    for n in range(items.shape[0]):
        item, arrival = items[n], arrivals[n]
        total = 0.0
        for k in range(intervals):
            begin = max(bounds[k], arrival)
            if begin >= bounds[k + 1]:
                continue
            added = np.float32(0.0)
            for use in range(firsts[item], firsts[item + 1]):
                thing = objects[use]
                for part in range(parts[item]):
                    gain = accuracy[use, k] - held[thing, k, part]
                    if gain > least or (gain > np.float32(0.0) and held[thing, k, part] == np.float32(0.0)):
                        added += gain * weights[part] * visible[thing, k]
            total += added * (bounds[k + 1] - begin)
        benefits[n] = total
