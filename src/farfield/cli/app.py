"""Which commands there are. Each is the function `command` of the file of its name in this folder.

Those files import nothing but typer and the small files beside them; what a command works with is imported inside
its function. That keeps `farfield --help` fast: 0.1 s, where numba alone takes 0.5.
"""

from __future__ import annotations

import importlib
from typing import Annotated

import typer

from farfield import __version__

COMMANDS = (
    "demo",
    "view",
    "bake",
    "update",
    "serve",
    "info",
    "verify",
    "copy",
    "gc",
    "render",
    "compare",
    "walk",
    "coverage",
    "make",
    "warmup",
    "bench",
)
"""In the order in which `--help` lists them."""

TRACEBACK = "--traceback"
"""Understood anywhere on the line, taken out by `main` before the line is read."""


def build_app() -> typer.Typer:
    """The whole command line as a typer application."""
    # Plain help: drawing the boxes loads rich and markdown, 0.15 s more.
    app = typer.Typer(
        add_completion=False, rich_markup_mode=None, pretty_exceptions_enable=False, callback=_root, help=_ROOT_HELP
    )
    for name in COMMANDS:
        app.command(name)(importlib.import_module(f"farfield.cli.{name}").command)
    return app


_ROOT_HELP = (
    "Bakes 3D scenes far too large for one machine into small pictures with depth, and shows them in a web page."
)


def _show_version(wanted: bool) -> None:
    if wanted:
        typer.echo(f"farfield {__version__}")
        raise typer.Exit


def _root(
    version: Annotated[
        bool, typer.Option("--version", callback=_show_version, is_eager=True, help="Print the version.")
    ] = False,
    traceback: Annotated[
        bool, typer.Option(TRACEBACK, help="Show where an error comes from (may stand anywhere).")
    ] = False,
) -> None:
    pass
