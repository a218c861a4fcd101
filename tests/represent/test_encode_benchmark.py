"""The benchmark runs, small."""

from __future__ import annotations

import json

from benchmarks.encode import measure

from farfield.represent.orthoview.quality import quality


def test_measures_every_part() -> None:
    report = json.loads(json.dumps(measure(48, quality("normal"), 1)))
    for subject in ("statue", "foliage", "city"):
        for layer in report[subject]["layers"]:
            assert set(layer["bytes_per_valid_pixel"]) >= {"all", "depth", "color", "normal"}
            assert set(layer["ms"]) == {"encode", "fill", "webp", "decode", "connect"}
        assert report[subject]["parent"]["ms"] > 0
