"""A canopy keeps what it has on its way up: its cover, its colour and how bright it is (OV 5.1)."""

from __future__ import annotations

from benchmarks.bench_levels import COVER, run


def test_a_canopy_keeps_cover_colour_and_shading_over_four_levels() -> None:
    figures = run(quick=True)
    assert len(figures["levels"]) == 5
    for level in figures["levels"]:
        assert abs(level["cover"] - COVER) < 0.03
    assert figures["color_drift"] < 0.03
    assert figures["shading_drift"] < 0.03
