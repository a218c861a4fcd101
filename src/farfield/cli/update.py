"""`farfield update`: a changed source into a world that is there."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from farfield.cli.options import JsonOption, WorldArgument
from farfield.cli.output import in_bytes, in_time, report
from farfield.cli.progress import shown_progress

SourcesArgument = Annotated[
    list[Path], typer.Argument(metavar="SOURCE…", help="Everything the world is to hold now, as for `bake`.")
]
WorkersOption = Annotated[int, typer.Option(metavar="N", min=0, help="Worker processes; 0: one a processor.")]


def command(
    world: WorldArgument, sources: SourcesArgument, workers: WorkersOption = 0, as_json: JsonOption = False
) -> None:
    """Make WORLD hold what SOURCE… holds now: only cells whose input changed are baked, in the world's own grid."""
    from farfield.pipeline import update_place

    with shown_progress() as progress:
        facts = update_place(world, sources, workers, progress)
    text = (
        f"{world}: {facts['cells_rebuilt']:,} of {facts['cells']:,} cells rebuilt in {in_time(facts['seconds'])}, "
        f"generation {facts['generation']}, {in_bytes(facts['bytes'])}"
    )
    report(facts, as_json=as_json, text=text)
