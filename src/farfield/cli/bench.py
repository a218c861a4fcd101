"""`farfield bench`: the benchmarks of the source tree, one file each."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated, Any

import typer

from farfield.cli.options import JsonOption
from farfield.cli.output import plain, report
from farfield.errors import OptionError

FOLDER = Path(__file__).parents[3] / "benchmarks"
"""Beside the package in a clone; an installed farfield has none."""

PREFIX = "bench_"
"""`benchmarks/bench_NAME.py` has a function `run(quick: bool) -> dict` of the benchmark's figures."""


def command(
    name: Annotated[str | None, typer.Argument(metavar="NAME", help="A benchmark, or `all`; none lists them.")] = None,
    quick: Annotated[bool, typer.Option("--quick", help="Small sizes: whether it works, not how fast it is.")] = False,
    as_json: JsonOption = False,
) -> None:
    """Run the benchmark NAME and print its figures."""
    names = sorted(path.stem.removeprefix(PREFIX) for path in FOLDER.glob(f"{PREFIX}*.py"))
    if name is None:
        report({"benchmarks": names}, as_json=as_json, text="\n".join(names) or "no benchmarks here")
        return
    if name != "all" and name not in names:
        raise OptionError(f"no benchmark {name!r}", str(FOLDER), f"one of: {', '.join(names) or 'none in this tree'}")
    chosen = names if name == "all" else [name]
    figures = {one: plain(_run(one, quick)) for one in chosen}
    facts = figures if name == "all" else figures[name]
    text = "\n".join(f"{one}: {figure} {value}" for one in chosen for figure, value in figures[one].items())
    report(facts, as_json=as_json, text=text or "no benchmarks here")


def _run(name: str, quick: bool) -> dict[str, Any]:
    import importlib
    import sys

    # Benchmarks share modules of their folder (scenes, cameras).
    for folder in (FOLDER, FOLDER.parent):
        if str(folder) not in sys.path:
            sys.path.insert(0, str(folder))
    module = importlib.import_module(f"{PREFIX}{name}")
    figures: dict[str, Any] = module.run(quick=quick)
    return figures
