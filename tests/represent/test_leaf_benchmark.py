"""The benchmark of drawing leaves runs, small."""

from __future__ import annotations

from benchmarks.bench_leaf import run


def test_measures_every_subject() -> None:
    figures = run(quick=True)
    assert set(figures) == {"leaves", "statue", "city"}
    for measured in figures.values():
        assert measured["triangles"] > 300
        assert measured["view_1_ms"] > 0
        assert measured["million_triangles_per_second"] > 0
