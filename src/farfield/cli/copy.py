"""`farfield copy`: a world from one store to another."""

from __future__ import annotations

from typing import Annotated

import typer

from farfield.cli.options import JsonOption, WorldArgument
from farfield.cli.output import in_bytes, in_time, report
from farfield.cli.progress import shown_progress

TargetArgument = Annotated[
    str, typer.Argument(metavar="TARGET", help="Folder, NAME.farfield for one file, or the URL of a bucket's folder.")
]


def command(world: WorldArgument, target: TargetArgument, as_json: JsonOption = False) -> None:
    """Copy WORLD to TARGET; goes on where an interrupted copy stopped, unless TARGET is an archive."""
    from farfield.pipeline import copy_place

    with shown_progress() as progress:
        facts = copy_place(world, target, progress)
    there = f", {facts['skipped']:,} of them there already" if facts["skipped"] else ""
    text = f"{target}: {facts['keys']:,} values, {in_bytes(facts['bytes'])}{there}, in {in_time(facts['seconds'])}"
    report(facts, as_json=as_json, text=text)
