"""`farfield compare`: how near one picture comes to another."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from farfield.cli.options import JsonOption
from farfield.cli.output import report


def command(
    reference: Annotated[Path, typer.Argument(metavar="A.png", help="The reference, such as the true picture.")],
    picture: Annotated[Path, typer.Argument(metavar="B.png", help="The picture to judge.")],
    as_json: JsonOption = False,
) -> None:
    """Compare two pictures of one size: PSNR, SSIM, FLIP; with alpha also over the covered pixels of either."""
    from farfield.quality.metrics import compare
    from farfield.quality.pictures import read_picture

    facts = compare(read_picture(reference), read_picture(picture))
    report(facts, as_json=as_json, text="\n".join(f"{name:<14} {value:.4g}" for name, value in facts.items()))
