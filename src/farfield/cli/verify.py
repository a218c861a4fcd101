"""`farfield verify`: whether a world is whole."""

from __future__ import annotations

from typing import Annotated

import typer

from farfield.cli.options import JsonOption, WorldArgument
from farfield.cli.output import in_bytes, report
from farfield.cli.progress import shown_progress

SHOWN = 20
"""Faults listed for people; JSON has them all."""


RepairOption = Annotated[bool, typer.Option("--repair", help="Bake what is bad again, from the source of WORLD.")]


def command(world: WorldArgument, repair: RepairOption = False, as_json: JsonOption = False) -> None:
    """Check every tile of WORLD; exit code 1 when something is bad, and stays so."""
    from farfield.pipeline import verify_place

    with shown_progress() as progress:
        found = verify_place(world, repair, progress)
    bad = [fault._asdict() for fault in found.faults]
    facts = {"ok": not bad, "bad": bad, "cells": found.cells, "tiles": found.tiles, "bytes": found.bytes}
    checked = f"{found.cells:,} cells, {found.tiles:,} tiles, {in_bytes(found.bytes)}"
    lines = [f"{fault.key}: {fault.what}" for fault in found.faults[:SHOWN]]
    if len(bad) > SHOWN:
        lines.append(f"… and {len(bad) - SHOWN:,} more (--json lists all)")
    lines.append(f"{world}: {len(bad):,} bad of {checked}" if bad else f"{world}: whole, {checked}")
    report(facts, as_json=as_json, text="\n".join(lines))
    if bad:
        raise typer.Exit(1)
