"""`farfield update`: a changed source into a world that is there."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from farfield.cli.options import JsonOption, WorldArgument
from farfield.cli.output import in_bytes, in_time, report
from farfield.cli.progress import shown_progress
from farfield.errors import OptionError

SourcesArgument = Annotated[
    list[Path] | None,
    typer.Argument(metavar="[SOURCE…]", help="What the world, or the region, is to hold now; as for `bake`."),
]
RegionOption = Annotated[
    str | None,
    typer.Option(
        metavar="X0,Y0,X1,Y1",
        help="Replace what has its middle in this rectangle of the CRS, and nothing else; without SOURCE: clear it.",
    ),
]
WorkersOption = Annotated[int, typer.Option(metavar="N", min=0, help="Worker processes; 0: one a processor.")]


def command(
    world: WorldArgument,
    sources: SourcesArgument = None,
    region: RegionOption = None,
    workers: WorkersOption = 0,
    as_json: JsonOption = False,
) -> None:
    """Make WORLD hold what SOURCE… holds now: only cells whose input changed are baked, in the world's own grid."""
    from farfield.pipeline import update_place

    if not sources and region is None:
        raise OptionError("neither a source nor a region is given", str(world), "name what it is to hold now")
    place = None if region is None else _rectangle(region)
    with shown_progress() as progress:
        facts = update_place(world, sources or [], workers, progress, place)
    text = (
        f"{world}: {facts['cells_rebuilt']:,} of {facts['cells']:,} cells rebuilt in {in_time(facts['seconds'])}, "
        f"generation {facts['generation']}, {in_bytes(facts['bytes'])}"
    )
    report(facts, as_json=as_json, text=text)


def _rectangle(text: str) -> tuple[float, float, float, float]:
    """Raises OptionError for anything but a rectangle."""
    try:
        x0, y0, x1, y1 = (float(part) for part in text.split(","))
    except ValueError:
        raise OptionError(f"{text!r} is not a rectangle", "--region", "four numbers: X0,Y0,X1,Y1") from None
    # Written so that NaN is refused, too.
    if not (-1e12 < x0 < x1 < 1e12 and -1e12 < y0 < y1 < 1e12):
        raise OptionError(f"{text} holds nothing", "--region", "X0 < X1 and Y0 < Y1, in the units of the CRS")
    return x0, y0, x1, y1
