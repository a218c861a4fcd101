"""Turning what goes wrong inside a reader into errors that say what, where and what to try."""

from __future__ import annotations

import struct
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

from farfield.errors import FarfieldError, InputError

EXPORT_AGAIN = "export or download it again"

_DAMAGE = (KeyError, IndexError, TypeError, ValueError, AttributeError, OverflowError, struct.error, EOFError)


@contextmanager
def reading(where: str, hint: str = EXPORT_AGAIN) -> Iterator[None]:
    """Reports whatever a parser trips over as one InputError at `where`; errors of farfield pass unchanged."""
    try:
        yield
    except FarfieldError:
        raise
    except FileNotFoundError as error:
        raise InputError("there is no such file", str(error.filename or where), "check the path") from error
    except IsADirectoryError as error:
        raise InputError("is a folder, not a file", where, "name a file in it") from error
    except OSError as error:
        raise InputError(f"cannot be read: {error.strerror or error}", where, "check its permissions") from error
    except MemoryError as error:
        raise InputError("asks for more memory than there is", where, hint) from error
    except _DAMAGE as error:
        raise InputError(f"is damaged: {_clause(error)}", where, hint) from error


def _clause(error: Exception) -> str:
    if isinstance(error, KeyError):
        return f"{error} is missing"
    return (str(error) or type(error).__name__).splitlines()[0]


def counted(count: int, noun: str) -> str:
    """'1 triangle', '2,345 triangles'."""
    return f"{count:,} {noun}" if count == 1 else f"{count:,} {noun}s"


def existing_file(path: Path) -> Path:
    """The path itself. Raises InputError when it is missing, a folder, or empty."""
    if not path.exists():
        raise InputError("there is no such file", str(path), "check the path")
    if path.is_dir():
        raise InputError("is a folder, not a file", str(path), "name a file in it, or a folder that holds a scene.toml")
    with reading(str(path)):
        if path.stat().st_size == 0:
            raise InputError("is empty", str(path), EXPORT_AGAIN)
        path.open("rb").close()
    return path
