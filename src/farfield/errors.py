"""The exception tree, divided by what the caller can do.

FarfieldError
├── InputError            a source the user gave is at fault: mend or leave out the named file
│   └── MissingExtraError an optional dependency is needed: install the named extra
├── OptionError           an option or argument is at fault: call again with another value
├── WorldError            the world on disk is at fault
│   ├── NotAWorldError    there is no world there, or something else is
│   ├── VersionError      the world was written by a newer version: upgrade farfield
│   ├── CorruptTileError  one tile cannot be read: the rest of the world still can; `farfield verify`
│   └── ClusterError      the machines that bake it fail: start or mend them, and bake again
├── StoreError            the storage failed: disk full, no permission, server away
│   ├── MissingKeyError   nothing is stored under that key: take another, or go without
│   └── DamagedValueError a value is not what was stored, or its server fails (a CorruptTileError too): the others can
│                         still be read
└── ServeError            the server cannot start: port in use
"""

from __future__ import annotations


class FarfieldError(Exception):
    """Root of every error farfield raises on purpose.

    what: what went wrong, one clause.
    where: the file, key, option or place it went wrong in; may be empty.
    hint: what to try; may be empty.
    """

    def __init__(self, what: str, where: str = "", hint: str = "") -> None:
        self.what = what
        self.where = where
        self.hint = hint
        super().__init__(what, where, hint)

    def __str__(self) -> str:
        line = f"{self.where}: {self.what}" if self.where else self.what
        return f"{line} ({self.hint})" if self.hint else line


class InputError(FarfieldError):
    """A source cannot be read or holds nothing usable."""


class MissingExtraError(InputError):
    """An optional dependency is not installed; `extra` names what brings it."""

    def __init__(self, what: str, extra: str, where: str = "") -> None:
        self.extra = extra
        super().__init__(what, where, f"pip install 'farfield[{extra}]'")

    def __reduce__(self) -> tuple[type[MissingExtraError], tuple[str, str, str]]:
        return MissingExtraError, (self.what, self.extra, self.where)


class OptionError(FarfieldError):
    """An option has a value that cannot be used."""


class WorldError(FarfieldError):
    """A world cannot be read or written as one."""


class NotAWorldError(WorldError):
    """The place holds no world, or holds something else."""


class VersionError(WorldError):
    """The world's format is newer than this version reads."""


class CorruptTileError(WorldError):
    """A tile is truncated, altered or missing."""


class ClusterError(WorldError):
    """A world cannot be baked on a cluster: its scheduler, its workers, or what is installed there."""


class StoreError(FarfieldError):
    """The storage below a world failed."""


class MissingKeyError(StoreError):
    """Nothing is stored under a key; `where` is the store and the key."""


class DamagedValueError(StoreError, CorruptTileError):
    """A store gives other bytes than were put into it, or the server that has a part of a world gives none. Whoever can
    do without one tile can do without this one."""


class ServeError(FarfieldError):
    """The server could not be started."""


class ProtocolError(FarfieldError):
    """A viewer says what nobody may say in a session; that session ends."""
