"""Which tiles show what an eye sees of a cell: visibility by small pictures, then a greedy cover (OV 5.1).

Samples of all tiles of a cell are drawn as points into one small picture a tile; a tile shows a picture pixel when
its nearest sample there lies about as near as that of any tile.
"""

from __future__ import annotations

import math

import numpy as np
from numba import types

from farfield.geometry.normals import DECODED
from farfield.kernels.compiling import device, kernel
from farfield.kernels.splat import STEEPEST

_F0, _F1, _HALF = np.float32(0.0), np.float32(1.0), np.float32(0.5)
_NOTHING = np.float32(1e30)
BEST = 120
"""Quality of a surface that is seen as well as it can be."""
LOOSE = 128
"""Added to the quality of what fills its place by chance only: of several such surfaces over each other, each fills a
share of what those before it leave. Counted as full, as what is connected is, a canopy's first tile was held to hide
all else: 2 dB in a forest two levels up, or 20 % of the bytes."""
_BEST = np.float32(BEST)
_STEEPEST = np.float32(STEEPEST)
_U8_2 = types.Array(types.uint8, 2, "C", readonly=True)
_U8_3 = types.Array(types.uint8, 3, "C", readonly=True)
_U16 = types.Array(types.uint16, 2, "C", readonly=True)
_F32 = types.Array(types.float32, 2, "C", readonly=True)


@kernel(
    types.int64(_U16, _U8_3, _U8_2, _U8_2, _F32, types.float32, types.int64, types.int64, types.int64,
                types.float32[:, ::1])
)  # fmt: skip
def sample_layer(depth, normal, coverage, flags, frame, pitch, step, first_row, first_column, samples):  # type: ignore[no-untyped-def]
    """Takes every `step`-th valid pixel of a layer in both axes; returns how many.

    depth .. flags: arrays of an OrthoLayer. frame: (4, 3) float32, rows origin (lattice column and row 0 of the arrays
    at code 0, u, v, w metres from the middle) and the axes u, v, w in the world's frame. first_row, first_column: the
    first sample. samples: (n, 8) float32, written: position (3) and normal (3) along the world's axes, coverage
    (0..1], 1 when connected else 0.
    """
    rows, columns = depth.shape
    count = 0
    for j in range(first_row, rows, step):
        cv = frame[0, 1] + (np.float32(j) + _HALF) * pitch
        for i in range(first_column, columns, step):
            if depth[j, i] == 0:
                continue
            cu = frame[0, 0] + (np.float32(i) + _HALF) * pitch
            cw = frame[0, 2] + np.float32(depth[j, i]) * pitch * np.float32(0.125)
            at = np.intp(normal[j, i, 0]) * 64 + np.intp(normal[j, i, 1])
            nu, nv, nw = DECODED[at, 0], DECODED[at, 1], -DECODED[at, 2]
            for axis in range(3):
                samples[count, axis] = cu * frame[1, axis] + cv * frame[2, axis] + cw * frame[3, axis]
                samples[count, 3 + axis] = nu * frame[1, axis] + nv * frame[2, axis] + nw * frame[3, axis]
            samples[count, 6] = np.float32(coverage[j, i]) * np.float32(1.0 / 16.0)
            samples[count, 7] = np.float32(flags[j, i] & 1)
            count += 1
    return count


@device
def _worth(sample, towards, ex, ey, ez):  # type: ignore[no-untyped-def]
    """How well a view shows a sample to an eye in direction (ex, ey, ez), 0..1; loose samples always count 1.

    A surface that the view sees more obliquely than the eye does is stretched (fourth root: a little), and has gaps
    where it rises by more than STEEPEST pixels a pixel. A bonus for views near the eye's direction cost 0.2 to 0.5 dB.
    """
    worth = _F1
    if sample[7] > _F0:
        by_view = abs(sample[3] * towards[0] + sample[4] * towards[1] + sample[5] * towards[2])
        by_eye = max(abs(sample[3] * ex + sample[4] * ey + sample[5] * ez), np.float32(0.1))
        worth = min(_F1, math.sqrt(math.sqrt(by_view / by_eye)))
        across = math.sqrt(max(_F1 - by_view * by_view, np.float32(1e-6)))
        worth *= min(_F1, _STEEPEST * by_view / across)
    return worth


@kernel(
    types.void(_F32, types.Array(types.int64, 1, "C", readonly=True), _F32, _F32, types.float32, types.float32,
               types.int64, types.float32[:, :, :, ::1], types.uint8[:, :, :, ::1])
)  # fmt: skip
def draw_samples(samples, starts, towards, camera, focal, spacing, eye, nearest, quality):  # type: ignore[no-untyped-def]
    """Draws the samples of every tile into its small picture for one eye.

    samples: (n, 8) float32, see sample_layer. starts: (tiles + 1,) int64, rows of each tile. towards: (tiles, 3) unit
    vectors to the canonical cameras. camera: (4, 3) float32, rows eye (metres from the middle), right, down, forward.
    focal: picture pixels that one metre at one metre covers. spacing: metres between samples. eye: which picture.
    nearest: (tiles, eyes, p, p) float32 metres along the view axis, 1e30 = nothing; quality: the same uint8, 0..BEST,
    with LOOSE.
    """
    tiles, _, size, _ = nearest.shape
    middle = np.float32(size) * _HALF
    for tile in range(tiles):
        for p in range(size):
            for q in range(size):
                nearest[tile, eye, p, q] = _NOTHING
                quality[tile, eye, p, q] = 0
        for k in range(starts[tile], starts[tile + 1]):
            ex = camera[0, 0] - samples[k, 0]
            ey = camera[0, 1] - samples[k, 1]
            ez = camera[0, 2] - samples[k, 2]
            seen = samples[k, 3] * ex + samples[k, 4] * ey + samples[k, 5] * ez
            if samples[k, 7] > _F0 and seen <= _F0:
                continue
            d = -(camera[3, 0] * ex + camera[3, 1] * ey + camera[3, 2] * ez)
            if d <= spacing:
                continue
            scale = focal / d
            x = middle - (camera[1, 0] * ex + camera[1, 1] * ey + camera[1, 2] * ez) * scale
            y = middle - (camera[2, 0] * ex + camera[2, 1] * ey + camera[2, 2] * ez) * scale
            reach = max(_HALF, _HALF * spacing * scale)
            left, right = max(0, math.floor(x - reach + _HALF)), min(size, math.floor(x + reach + _HALF))
            top, bottom = max(0, math.floor(y - reach + _HALF)), min(size, math.floor(y + reach + _HALF))
            is_hidden = True
            for q in range(top, bottom):
                for p in range(left, right):
                    is_hidden &= d >= nearest[tile, eye, q, p]
            if is_hidden:
                continue
            away = math.sqrt(ex * ex + ey * ey + ez * ez)
            shown = _BEST * _worth(samples[k], towards[tile], ex / away, ey / away, ez / away)
            if samples[k, 7] > _F0:
                worth = np.uint8(shown + _HALF)
            else:
                worth = np.uint8(shown * samples[k, 6] + _HALF) | np.uint8(LOOSE)
            for q in range(top, bottom):
                for p in range(left, right):
                    if d < nearest[tile, eye, q, p]:
                        nearest[tile, eye, q, p] = d
                        quality[tile, eye, q, p] = worth


@kernel(types.void(types.float32[:, ::1], types.uint8[:, ::1], types.float32, types.float32))
def discount_hidden(nearest, quality, tolerance, behind):  # type: ignore[no-untyped-def]
    """Lowers the quality of what another tile hides.

    nearest: (tiles, m) float32, quality: (tiles, m) uint8, written. tolerance: metres behind the nearest of all tiles
    that still count as visible. behind: what a hidden surface counts, of its quality: it fills a hole, if with the
    wrong thing.
    """
    tiles, pixels = nearest.shape
    for at in range(pixels):
        front = _NOTHING
        for tile in range(tiles):
            front = min(front, nearest[tile, at])
        for tile in range(tiles):
            if nearest[tile, at] > front + tolerance:
                kept = quality[tile, at] & np.uint8(LOOSE)
                quality[tile, at] = np.uint8(np.float32(quality[tile, at] & np.uint8(LOOSE - 1)) * behind) | kept


@device
def _added(quality, best, shown):  # type: ignore[no-untyped-def]
    """What a quality adds to the best so far; shown: the best of the same surface."""
    value = np.int32(quality & np.uint8(LOOSE - 1))
    if quality & np.uint8(LOOSE):
        return max(np.int32(0), value - shown) * (BEST - best) // BEST
    return max(np.int32(0), value - best)


@kernel(
    types.int64(types.uint8[:, ::1], types.float32[:, ::1], types.float32,
                types.Array(types.float64, 1, "C", readonly=True), types.float64, types.int64[::1], types.int64[::1]),
    allocates=True,
)  # fmt: skip
def greedy_cover(quality, nearest, tolerance, cost, least, chosen, gains):  # type: ignore[no-untyped-def]
    """Chooses one after the other, each the one that adds most for what it costs; returns how many.

    quality: (things, m) uint8, 0..BEST, with LOOSE. nearest: (things, m) float32 metres to what each shows; tolerance:
    metres between two that show the same surface: the rim of a body that each view has half full is not filled by
    showing it twice (0.6 dB at statues, -0.3 in a city and a forest, from r on). cost: (things,) float64. least: gain
    per cost from which a thing is worth taking; the first is taken if it adds anything. chosen: (k,) int64, written;
    gains: (k,) int64, written: what each adds, a sum of qualities. Ties go to the earlier thing.
    """
    things, pixels = quality.shape
    best = np.zeros(pixels, np.uint8)
    shown = np.zeros((things, pixels), np.uint8)
    # What a thing adds becomes less only: one that added too little before need not be looked at again.
    before = np.full(things, np.iinfo(np.int64).max)
    for place in range(chosen.size):
        most, won, winner = 0.0, 0, -1
        for thing in range(things):
            if before[thing] <= most * cost[thing]:
                continue
            gain = 0
            for at in range(pixels):
                gain += _added(quality[thing, at], np.int32(best[at]), np.int32(shown[thing, at]))
            before[thing] = gain
            if gain > most * cost[thing]:
                most, won, winner = gain / cost[thing], gain, thing
        if winner < 0 or (place > 0 and most < least):
            return place
        chosen[place], gains[place] = winner, won
        for at in range(pixels):
            best[at] += np.uint8(_added(quality[winner, at], np.int32(best[at]), np.int32(shown[winner, at])))
        for thing in range(things):
            for at in range(pixels):
                if abs(nearest[thing, at] - nearest[winner, at]) <= tolerance:
                    value = quality[winner, at] & np.uint8(LOOSE - 1)
                    shown[thing, at] = max(shown[thing, at], value)
    return chosen.size


@kernel(
    types.int64(_F32, _U16, _F32, types.float32, types.float32, types.float32, types.uint64, types.uint64[::1])
)  # fmt: skip
def mark_seen(samples, depth, frame, pitch, tolerance, cosine, bit, seen):  # type: ignore[no-untyped-def]
    """Sets `bit` of every sample that a view sees squarely enough; returns how many.

    samples: (n, 8) float32, see sample_layer. depth: (h, w) uint16 codes of the view's first layer. frame: (4, 3)
    float32 of the view, see sample_layer. pitch: metres. tolerance: metres that a sample may lie from the view's
    surface. cosine: least cosine between the sample's normal and the direction to the view's camera. seen: (n,) uint64.
    """
    rows, columns = depth.shape
    count = 0
    for k in range(samples.shape[0]):
        u, v, w, squarely = _F0, _F0, _F0, _F0
        for axis in range(3):
            u += samples[k, axis] * frame[1, axis]
            v += samples[k, axis] * frame[2, axis]
            w += samples[k, axis] * frame[3, axis]
            squarely -= samples[k, 3 + axis] * frame[3, axis]
        if squarely < cosine:
            continue
        i, j = math.floor((u - frame[0, 0]) / pitch), math.floor((v - frame[0, 1]) / pitch)
        if i < 0 or j < 0 or i >= columns or j >= rows or depth[j, i] == 0:
            continue
        if abs(w - frame[0, 2] - np.float32(depth[j, i]) * pitch * np.float32(0.125)) <= tolerance:
            seen[k] |= bit
            count += 1
    return count
