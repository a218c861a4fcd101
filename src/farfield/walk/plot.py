"""Quality over time as a picture."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path

from farfield.errors import MissingExtraError


def plot_quality(file: Path, curves: Mapping[str, Sequence[float]], title: str = "") -> None:
    """Draws a curve of each name: quality, 0 to 1, second by second. Raises MissingExtraError without matplotlib."""
    try:
        import matplotlib
    except ImportError:
        raise MissingExtraError("matplotlib is not installed", "quality") from None
    matplotlib.use("Agg")
    from matplotlib import pyplot

    figure, axes = pyplot.subplots(figsize=(8, 4), layout="constrained")
    for name, curve in curves.items():
        axes.plot([second + 0.5 for second in range(len(curve))], [100 * value for value in curve], label=name)
    axes.set(xlabel="seconds", ylabel="quality, %", ylim=(0, 102), title=title)
    axes.set_xlim(0, max(map(len, curves.values()), default=1))
    axes.grid(alpha=0.3)
    axes.legend()
    figure.savefig(file, dpi=100)
    pyplot.close(figure)
