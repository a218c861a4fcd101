"""Bytes a valid pixel and milliseconds of everything between drawing a view and storing it.

    python benchmarks/encode.py [--size PX] [--quality NAME] [--repeat N] [--json]

Processor time, best of N. Object ids and decoding are measured too; colour's PSNR is over valid pixels.
"""

from __future__ import annotations

import argparse
import json
import time
from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import TypeVar

import numpy as np
from benchmarks.layers import SUBJECTS

from farfield.kernels.fill import fill_invalid
from farfield.represent.orthoview import container, webp
from farfield.represent.orthoview.connectivity import mark_connected
from farfield.represent.orthoview.layer import OrthoLayer
from farfield.represent.orthoview.parent import composite
from farfield.represent.orthoview.quality import QUALITIES, Quality
from farfield.represent.orthoview.tile import COLOR, COVERAGE, DEPTH, FLAGS, MAGIC, NORMAL, decode_tile, encode_tile

T = TypeVar("T")
_PLANES = {"depth": DEPTH, "color": COLOR, "normal": NORMAL, "coverage": COVERAGE, "flags": FLAGS}


@dataclass(frozen=True)
class Clock:
    """Runs things several times."""

    repeat: int

    def __call__(self, work: Callable[[], T]) -> tuple[T, float]:
        """The result and the milliseconds of processor time of the quickest run."""
        best = float("inf")
        for _ in range(self.repeat):
            start = time.thread_time()
            result = work()
            best = min(best, time.thread_time() - start)
        return result, round(best * 1e3, 2)


def measure_layer(layer: OrthoLayer, quality: Quality, clock: Clock) -> dict[str, object]:
    """Bytes a valid pixel by plane, milliseconds by step, decibels of colour."""
    valid = layer.valid
    count = int(np.count_nonzero(valid))
    _, connect_ms = clock(lambda: mark_connected(layer))
    data, encode_ms = clock(lambda: encode_tile(layer, 0, 0, 0, quality))
    tile, decode_ms = clock(lambda: decode_tile(data))
    filled, fill_ms = clock(lambda: fill_invalid(layer.color, valid))
    _, webp_ms = clock(lambda: webp.encode(filled, quality.webp_quality, quality.webp_method))
    _, planes = container.unpack(data, MAGIC, "")
    error = np.square(tile.layer.color[valid].astype(float) - layer.color[valid]).mean()
    stored = {name: len(planes[kind].stored) / count for name, kind in _PLANES.items() if kind in planes}
    return {
        "pixels": int(valid.size),
        "valid": count,
        "bytes_per_valid_pixel": {"all": round(len(data) / count, 3), **{k: round(v, 3) for k, v in stored.items()}},
        "ms": {"encode": encode_ms, "fill": fill_ms, "webp": webp_ms, "decode": decode_ms, "connect": connect_ms},
        "color_psnr": round(10 * np.log10(255**2 / max(error, 1e-9)), 1),
    }


def measure_parent(layers: list[OrthoLayer], size: int, clock: Clock) -> dict[str, object]:
    """Milliseconds to composite eight children, copies of one view two by two by two."""
    children = [
        [
            replace(a, x=a.x + size * (k & 1), y=a.y + size * (k >> 1 & 1), depth_base=8 * size * (k >> 2))
            for a in layers
        ]
        for k in range(8)
    ]
    _, ms = clock(lambda: composite(children, 2))
    count = sum(int(np.count_nonzero(a.valid)) for stack in children for a in stack)
    return {"children": 8, "valid": count, "ms": ms, "ns_per_valid_pixel": round(ms * 1e6 / count, 1)}


def measure(size: int, quality: Quality, repeat: int) -> dict[str, object]:
    """Everything, by subject."""
    clock = Clock(repeat)
    report: dict[str, object] = {"size": size, "quality": quality.name}
    for name, make in SUBJECTS.items():
        layers = make(size)
        report[name] = {
            "layers": [measure_layer(layer, quality, clock) for layer in layers],
            "parent": measure_parent(layers, size, clock),
        }
    return report


def main() -> None:
    """Command line."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--size", type=int, default=512)
    parser.add_argument("--quality", choices=sorted(QUALITIES), default="normal")
    parser.add_argument("--repeat", type=int, default=5)
    parser.add_argument("--json", action="store_true")
    options = parser.parse_args()
    report = measure(options.size, QUALITIES[options.quality], options.repeat)
    print(json.dumps(report) if options.json else json.dumps(report, indent=1))


if __name__ == "__main__":
    main()
