"""Figures of bench_mesh_levels as a table, a plot of bytes and PSNR, and a picture side by side.

python -m mesh_levels.report ROWS [--plot FILE] [--side-by-side FILE --truth PNG PNG…]     in benchmarks/
"""

from __future__ import annotations

import argparse
import json
import sys
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np
from PIL import Image

sys.path.insert(0, str(Path(__file__).parents[1]))
from bench_mesh_levels import SKY, summary
from farfield.quality.metrics import over_sky
from farfield.quality.pictures import read_picture

MARKS = {
    "farfield": "s-",
    "farfield, pictures": ".-",
    "tiles": "o--",
    "tiles, instanced": "^:",
    "farfield, BlockMaps": "D-",
    "farfield, BlockMaps, pictures": "x-",
    "farfield, all kinds": "+-",
}
WIDTHS = {"farfield": 2.2, "farfield, BlockMaps": 2.2}
"""Of lines, points."""


def table(found: dict[str, Any]) -> str:
    """Markdown: a line for each scene, level and viewer; PSNR / FLIP after each limit; the best of each is bold."""
    limits = sorted(
        {limit for levels in found.values() for v in levels.values() for r in v.values() for limit in r}, key=int
    )
    head = ["scene, from", "viewer", *(f"{int(limit) / 1e6:g} MB" for limit in limits), "all: MB, ms, of which"]
    lines = [" | ".join(head), "|".join("---" for _ in head)]
    for scene, levels in found.items():
        for level, shown in levels.items():
            for viewer, rows in shown.items():
                cells = [_cell(rows.get(limit), [r.get(limit) for r in shown.values()]) for limit in limits]
                last = rows[limits[-1]]
                whole = f"{last['bytes'] / 1e6:.1f}, {last['processor_ms']:,.0f}, {last['primitives'] / 1e6:.2f} M"
                lines.append(" | ".join([f"{scene}, {level}", viewer, *cells, whole]))
    return "\n".join(f"| {line} |" for line in lines)


def plot(found: dict[str, Any], file: Path) -> None:
    """PSNR over bytes, a panel for each scene and level."""
    import matplotlib

    matplotlib.use("Agg")
    from matplotlib import pyplot

    levels = list(dict.fromkeys(level for own in found.values() for level in own))
    figure, panels = pyplot.subplots(
        len(levels), len(found), figsize=(3.1 * len(found), 2.5 * len(levels)), dpi=110, sharex=True, squeeze=False
    )
    for column, (scene, own) in enumerate(found.items()):
        for row, level in enumerate(levels):
            axes = panels[row][column]
            for viewer, limits in own.get(level, {}).items():
                points = [(int(limit) / 1e6, figures["psnr_covered"]) for limit, figures in limits.items()]
                axes.plot(
                    *zip(*points, strict=True), MARKS[viewer], label=viewer, markersize=4, lw=WIDTHS.get(viewer, 1.0)
                )
            axes.set(xscale="log", title=f"{scene}, from {level}")
            axes.set_xticks([0.5, 2, 8, 32], ["0.5", "2", "8", "32"])
            axes.grid(alpha=0.3)
    for axes in panels[-1]:
        axes.set_xlabel("MB")
    for axes in panels[:, 0]:
        axes.set_ylabel("PSNR, dB")
    panels[0][0].legend(fontsize=7)
    figure.tight_layout()
    figure.savefig(file)


def side_by_side(files: Sequence[Path], target: Path, size: tuple[int, int] = (480, 360)) -> None:
    """Pictures in a row."""
    pictures = [over_sky(read_picture(file), SKY) for file in files]
    small = [np.array(Image.fromarray(p[..., :3]).resize(size, Image.Resampling.LANCZOS)) for p in pictures]
    Image.fromarray(np.concatenate(small, axis=1)).save(target, quality=88)


def _cell(row: dict[str, float] | None, beside: Sequence[dict[str, float] | None]) -> str:
    if row is None:
        return ""
    others = [other for other in beside if other is not None]
    psnr, flip = f"{row['psnr_covered']:.1f}", f"{row['flip_covered']:.3f}"
    is_best = (
        psnr == f"{max(other['psnr_covered'] for other in others):.1f}",
        flip == f"{min(other['flip_covered'] for other in others):.3f}",
    )
    return " / ".join(f"**{text}**" if best else text for text, best in zip((psnr, flip), is_best, strict=True))


def main() -> None:
    """The command line."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("rows", type=Path)
    parser.add_argument("--plot", type=Path)
    parser.add_argument("--side-by-side", type=Path)
    parser.add_argument("--pictures", type=Path, nargs="*", default=())
    given = parser.parse_args()
    found = summary([json.loads(line) for line in given.rows.read_text().splitlines()])
    print(table(found))
    if given.plot:
        plot(found, given.plot)
    if given.side_by_side:
        side_by_side(given.pictures, given.side_by_side)


if __name__ == "__main__":
    main()
