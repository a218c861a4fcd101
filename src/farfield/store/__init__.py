"""Where a world's bytes are kept: one contract (`Store`), one file or folder for each kind of store."""

from farfield.store.archive import ArchiveStore
from farfield.store.bucket import BucketStore
from farfield.store.cached import CachedStore
from farfield.store.contract import Store
from farfield.store.directory import DirectoryStore
from farfield.store.http import HttpStore
from farfield.store.keys import MAX_KEY_LENGTH, check_key, is_key
from farfield.store.latency import LatencyStore
from farfield.store.memory import MemoryStore
from farfield.store.opening import Place, open_store

__all__ = [
    "MAX_KEY_LENGTH",
    "ArchiveStore",
    "BucketStore",
    "CachedStore",
    "DirectoryStore",
    "HttpStore",
    "LatencyStore",
    "MemoryStore",
    "Place",
    "Store",
    "check_key",
    "is_key",
    "open_store",
]
