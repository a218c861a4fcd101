"""Triangles along a space-filling curve, and a fingerprint of what is drawn of them."""

from __future__ import annotations

from numba import types

from farfield.geometry.morton import BITS
from farfield.kernels.compiling import device, kernel
from farfield.kernels.surface import F32_2, U32_1, U32_2

_U64 = types.uint64
_WORDS = types.Array(types.uint32, 2, "C", readonly=True)


@device
def _spread(value):  # type: ignore[no-untyped-def]
    """Bit i of a number below 2**21 becomes bit 3 i."""
    v = _U64(value)
    v = (v | (v << _U64(32))) & _U64(0x1F00000000FFFF)
    v = (v | (v << _U64(16))) & _U64(0x1F0000FF0000FF)
    v = (v | (v << _U64(8))) & _U64(0x100F00F00F00F00F)
    v = (v | (v << _U64(4))) & _U64(0x10C30C30C30C30C3)
    return (v | (v << _U64(2))) & _U64(0x1249249249249249)


@device
def _sum(positions, triangles, t, axis):  # type: ignore[no-untyped-def]
    """Three times the middle of a triangle."""
    one = types.float64(positions[triangles[t, 0], axis]) + types.float64(positions[triangles[t, 1], axis])
    return one + types.float64(positions[triangles[t, 2], axis])


@kernel(types.void(F32_2, U32_2, types.uint64[::1]))
def curve_codes(positions, triangles, codes):  # type: ignore[no-untyped-def]
    """Morton codes of the middles of triangles in the smallest cube around them, as geometry.morton.codes_along.

    positions: (n, 3) float32. triangles: (m, 3) uint32. codes: (m,) uint64, written. One pass over memory instead of
    NumPy's thirty: 25 ns a triangle instead of 300.
    """
    widest = types.float64(1e-300)
    low0 = low1 = low2 = types.float64(0)
    for axis in range(3):
        low = types.float64(1e300)
        high = types.float64(-1e300)
        for t in range(len(triangles)):
            value = _sum(positions, triangles, t, axis)
            low = min(low, value)
            high = max(high, value)
        widest = max(widest, high - low)
        if axis == 0:
            low0 = low
        elif axis == 1:
            low1 = low
        else:
            low2 = low
    scale = types.float64((1 << BITS) - 1) / widest
    for t in range(len(triangles)):
        x = _spread((_sum(positions, triangles, t, 0) - low0) * scale)
        y = _spread((_sum(positions, triangles, t, 1) - low1) * scale)
        z = _spread((_sum(positions, triangles, t, 2) - low2) * scale)
        codes[t] = x | (y << _U64(1)) | (z << _U64(2))


@device
def _mixed(state, word, factor):  # type: ignore[no-untyped-def]
    state = (state ^ _U64(word)) * factor
    return state ^ (state >> _U64(29))


@kernel(types.void(_WORDS, _WORDS, _WORDS, _WORDS, U32_2, U32_1, U32_1, types.uint64[::1]))
def fingerprint(positions, normals, uvs, colors, triangles, materials, objects, marks):  # type: ignore[no-untyped-def]
    """Numbers of 128 bits that tell one list of triangles from another: corner by corner, so that vertices may be
    numbered otherwise or held twice. Against chance, not against malice. 40 ns a triangle; gathering the corners for a
    cryptographic hash takes 350.

    positions .. colors: the arrays of a Surface as uint32, (n, 3), (n, 3), (n or 0, 2), (n or 0, 1). marks: (2,)
    uint64, changed.
    """
    a = marks[0]
    b = marks[1]
    p = _U64(0x9E3779B97F4A7C15)
    q = _U64(0xC2B2AE3D27D4EB4F)
    for t in range(len(triangles)):
        word = (_U64(materials[t]) << _U64(32)) | _U64(objects[t])
        a = _mixed(a, word, p)
        b = _mixed(b, word, q)
        for corner in range(3):
            v = triangles[t, corner]
            one = (_U64(positions[v, 0]) << _U64(32)) | _U64(positions[v, 1])
            two = (_U64(positions[v, 2]) << _U64(32)) | _U64(normals[v, 0])
            three = (_U64(normals[v, 1]) << _U64(32)) | _U64(normals[v, 2])
            a = _mixed(_mixed(_mixed(a, one, p), two, p), three, p)
            b = _mixed(_mixed(_mixed(b, one, q), two, q), three, q)
            if len(uvs) > 0:
                four = (_U64(uvs[v, 0]) << _U64(32)) | _U64(uvs[v, 1])
                a = _mixed(a, four, p)
                b = _mixed(b, four, q)
            if len(colors) > 0:
                a = _mixed(a, colors[v, 0], p)
                b = _mixed(b, colors[v, 0], q)
    marks[0] = a
    marks[1] = b
