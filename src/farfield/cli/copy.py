"""`farfield copy`: a world from one store to another."""

from __future__ import annotations

from typing import Annotated, Any

import typer

from farfield.cli.options import JsonOption, WorldArgument
from farfield.cli.output import in_bytes, in_time, report
from farfield.cli.progress import shown_progress

TargetArgument = Annotated[
    str, typer.Argument(metavar="TARGET", help="Folder, NAME.farfield for one file, or the URL of a bucket's folder.")
]

ServersOption = Annotated[
    str | None,
    typer.Option(
        metavar="ADDRESS,ADDRESS…",
        help="Split the copy over these servers: https:// addresses, or names of folders beside each other.",
    ),
]


def command(
    world: WorldArgument, target: TargetArgument, servers: ServersOption = None, as_json: JsonOption = False
) -> None:
    """Copy WORLD to TARGET; goes on where an interrupted copy stopped, unless TARGET is an archive.

    With --servers TARGET gets a folder for each server, to be put there as it is. A world that is split over servers
    is put together.
    """
    from farfield.pipeline import copy_place

    with shown_progress() as progress:
        facts = copy_place(world, target, progress, servers.split(",") if servers is not None else ())
    report(facts, as_json=as_json, text=_text(facts, target))


def _text(facts: dict[str, Any], target: str) -> str:
    there = f", {facts['skipped']:,} of them there already" if facts["skipped"] else ""
    done = f"{target}: {facts['keys']:,} values, {in_bytes(facts['bytes'])}{there}, in {in_time(facts['seconds'])}"
    shares = facts.get("servers", [])
    lines = [f"  {s['place']} to {s['address']} ({s['keys']:,} values, {in_bytes(s['bytes'])})" for s in shares]
    if lines:
        done += (
            "\nPut what is in each folder on its server; page and manifest are in each, so any of them can be opened:"
        )
    return "\n".join([done, *lines])
