"""Archives for tests."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from contextlib import AbstractContextManager
from pathlib import Path

from farfield.store import MemoryStore
from farfield.store.archive import ArchiveStore
from farfield.store.archive.writer import DIRECTORY_KEYS, writing_archive


def write_archive(path: Path, values: Mapping[str, bytes], directory_keys: int = DIRECTORY_KEYS) -> ArchiveStore:
    """An archive of `values` at `path`, written in their order; what was there is replaced."""
    path.unlink(missing_ok=True)
    with writing_archive(path, directory_keys) as writer:
        for key, data in values.items():
            writer.put(key, data)
    return ArchiveStore(path)


class ArchiveOnDemand:
    """Writes to memory and reads from an archive of it, so that the suite of all stores tries an archive's readers."""

    def __init__(self, path: Path) -> None:
        self._path = path.with_suffix(".farfield")
        self._values = MemoryStore()
        self._archive: ArchiveStore | None = None

    @property
    def location(self) -> str:
        return str(self._path)

    def put(self, key: str, data: bytes) -> None:
        self._values.put(key, data)
        self._archive = None

    def delete(self, key: str) -> None:
        self._values.delete(key)
        self._archive = None

    def writing(self) -> AbstractContextManager[None]:
        return self._values.writing()

    def get(self, key: str) -> bytes:
        return self._read().get(key)

    def get_range(self, key: str, start: int, length: int) -> bytes:
        return self._read().get_range(key, start, length)

    def exists(self, key: str) -> bool:
        return self._read().exists(key)

    def size(self, key: str) -> int:
        return self._read().size(key)

    def list(self, prefix: str = "") -> Iterator[str]:
        return self._read().list(prefix)

    def _read(self) -> ArchiveStore:
        if self._archive is None:
            values = {key: self._values.get(key) for key in self._values.list()}
            self._archive = write_archive(self._path, values)
        return self._archive
