"""A world in one file (spec/archive.md), read by plain byte ranges."""

from farfield.store.archive.reader import ArchiveStore
from farfield.store.archive.writer import ArchiveWriter

__all__ = ["ArchiveStore", "ArchiveWriter"]
