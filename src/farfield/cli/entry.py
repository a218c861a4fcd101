"""Runs a command and turns whatever happens into one line and an exit code.

0: done. 1: failed, or whoever read the output stopped reading. 2: called wrongly. 130: interrupted, by Ctrl-C or by
SIGTERM.
"""

from __future__ import annotations

import os
import signal
import sys
import threading
from collections.abc import Iterator, Sequence
from contextlib import contextmanager

import typer

from farfield.cli.app import TRACEBACK, build_app
from farfield.errors import FarfieldError, OptionError

FAILED, USAGE, INTERRUPTED = 1, 2, 130


def main(arguments: Sequence[str] | None = None) -> int:
    """Run the command line `arguments` (default: those of the process) and return its exit code."""
    given = list(sys.argv[1:] if arguments is None else arguments)
    with _termination_as_interrupt():
        if TRACEBACK in given:
            return _run([word for word in given if word != TRACEBACK])
        return _answered(given)


@contextmanager
def _termination_as_interrupt() -> Iterator[None]:
    """SIGTERM, by which systems end what runs, is taken as Ctrl-C: work is put down tidily, one line says so."""
    ours = threading.current_thread() is threading.main_thread() and signal.getsignal(signal.SIGTERM) == signal.SIG_DFL
    if ours:
        signal.signal(signal.SIGTERM, signal.default_int_handler)
    try:
        yield
    finally:
        if ours:
            signal.signal(signal.SIGTERM, signal.SIG_DFL)


def _answered(given: list[str]) -> int:
    try:
        return _run(given)
    except OptionError as error:
        return _say(str(error), USAGE)
    except FarfieldError as error:
        return _say(str(error), FAILED)
    except typer.TyperException as error:
        return _say_usage(error)
    except (KeyboardInterrupt, typer.Abort):
        return _say("interrupted", INTERRUPTED)
    except BrokenPipeError:
        return _leave_quietly()
    except OSError as error:
        return _say(f"{error.filename or 'system'}: {error.strerror or error} (--traceback shows where)", FAILED)
    except MemoryError:
        return _say("out of memory (try fewer --workers or a smaller --leaf-size)", FAILED)


def _run(arguments: list[str]) -> int:
    code = build_app()(arguments or ["--help"], prog_name="farfield", standalone_mode=False)
    # typer turns Ctrl-C into this code itself.
    if code == INTERRUPTED:
        raise KeyboardInterrupt
    sys.stdout.flush()
    return code if isinstance(code, int) else 0


def _say(line: str, code: int) -> int:
    print("farfield: " + " ".join(line.split()), file=sys.stderr)
    return code


def _say_usage(error: typer.TyperException) -> int:
    context = getattr(error, "ctx", None)
    command = context.command_path if context else "farfield"
    message = error.format_message() if hasattr(error, "format_message") else str(error)
    return _say(f"{message.rstrip('.')} ({command} --help)", getattr(error, "exit_code", USAGE))


def _leave_quietly() -> int:
    # Python flushes stdout once more when it ends, and would complain about the same pipe again.
    os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())
    return FAILED
