"""Options that several commands share, and how their values are read."""

from __future__ import annotations

import math
from typing import Annotated

import typer

from farfield.errors import OptionError

JsonOption = Annotated[bool, typer.Option("--json", help="Print one JSON object on stdout.")]

WorldArgument = Annotated[
    str,
    typer.Argument(
        metavar="WORLD", help="A baked world: folder, .farfield archive, or URL s3://, gs://, az://, https://."
    ),
]

HostOption = Annotated[str, typer.Option("--host", help="Address to listen on; 0.0.0.0 for every one.")]

PortOption = Annotated[
    int | None, typer.Option("--port", min=0, max=65535, help="Port; default: the first free one from 8000.")
]

OpenOption = Annotated[bool, typer.Option("--open", help="Open the page in the browser.")]

OpenedOption = Annotated[bool, typer.Option("--open/--no-open", help="Open the page in the browser.")]

BandwidthOption = Annotated[
    float | None, typer.Option("--bandwidth", metavar="B", help="Send at most B bytes a second, to try a slow link.")
]

DelayOption = Annotated[
    float, typer.Option("--delay", metavar="MS", help="Answer MS milliseconds late, to try a server far away.")
]


def numbers(text: str, count: int, option: str) -> tuple[float, ...]:
    """`text` as `count` finite numbers with commas between them: "1,2,3".

    Raises OptionError: it is something else; the message names `option`.
    """
    try:
        values = tuple(float(part) for part in text.split(","))
    except ValueError:
        values = ()
    if len(values) != count or not all(math.isfinite(value) for value in values):
        raise OptionError(f"expected {count} numbers with commas between them, got {text!r}", option)
    return values


def size(text: str, option: str) -> tuple[int, int]:
    """`text` such as "640x480" as (width, height), pixels, each 1 to 16384.

    Raises OptionError: it is something else; the message names `option`.
    """
    width, _, height = text.lower().partition("x")
    if width.isascii() and width.isdigit() and height.isascii() and height.isdigit():
        found = int(width), int(height)
        if all(1 <= side <= 16384 for side in found):
            return found
    raise OptionError(f"expected WIDTHxHEIGHT, each 1 to 16384 pixels, got {text!r}", option)
