"""`farfield gc`: drops old generations of a world."""

from __future__ import annotations

from typing import Annotated

import typer

from farfield.cli.options import JsonOption, WorldArgument
from farfield.cli.output import in_bytes, report
from farfield.cli.progress import shown_progress

DryOption = Annotated[bool, typer.Option("--dry-run", help="Say what would be dropped, and drop nothing.")]


def command(world: WorldArgument, dry_run: DryOption = False, as_json: JsonOption = False) -> None:
    """Drop what the current generation of WORLD does not name; pages that still show an older one lose its tiles."""
    from farfield.world.garbage import drop_garbage
    from farfield.world.split import open_world

    with shown_progress() as progress:
        dropped = drop_garbage(open_world(world), dry_run, progress)
    done = "would be dropped" if dry_run else "dropped"
    facts = {"world": str(world), "keys": dropped.keys, "bytes": dropped.bytes, "dropped": not dry_run}
    report(facts, as_json=as_json, text=f"{world}: {dropped.keys:,} values, {in_bytes(dropped.bytes)}, {done}")
