"""The command line: one file per command, `main` the only place where errors become exit codes."""

from farfield.cli.entry import main

__all__ = ["main"]
