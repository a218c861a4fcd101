"""`farfield coverage`: how much of a scene each preset of directions misses."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from farfield.cli.options import JsonOption
from farfield.cli.output import report
from farfield.cli.progress import shown_progress

SourcesArgument = Annotated[list[Path], typer.Argument(metavar="SOURCE…", help="Files that bake would read.")]
ThetaOption = Annotated[
    float, typer.Option(metavar="DEGREES", min=1, max=90, help="Largest angle at which a direction sees a surface.")
]
LeafSizeOption = Annotated[float | None, typer.Option(metavar="M", help="Edge of a leaf; default: as bake chooses.")]
LeavesOption = Annotated[int, typer.Option(metavar="N", min=1, help="Most leaves looked at.")]
DirectionsOption = Annotated[
    str | None, typer.Option(metavar="SET", help="A set of directions to judge beside the presets.")
]


def command(
    sources: SourcesArgument,
    theta: ThetaOption = 55.0,
    leaf_size: LeafSizeOption = None,
    leaves: LeavesOption = 64,
    directions: DirectionsOption = None,
    as_json: JsonOption = False,
) -> None:
    """Say what share of the visible surface of SOURCE… the directions of each preset do not see."""
    from farfield.bake.coverage import CoverageOptions, judge_presets
    from farfield.scene.read import read_scene

    options = CoverageOptions(theta=theta, leaf_size=leaf_size, leaves=leaves, directions=directions)
    with shown_progress() as progress:
        shares = judge_presets(read_scene(sources), options, progress)
    lines = [f"{'directions':<12} missed at {theta:g} degrees"]
    lines += [f"{name:<12} {100 * share:5.1f} %" for name, share in shares.items()]
    facts = {"presets": {name: round(share, 5) for name, share in shares.items()}, "theta": theta}
    report(facts, as_json=as_json, text="\n".join(lines))
