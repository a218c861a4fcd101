"""Putting values whose name tells what they hold: most of them are there already."""

from __future__ import annotations

from farfield.errors import MissingKeyError
from farfield.store.contract import Store


def put_once(store: Store, key: str, data: bytes) -> bool:
    """Stores `data` unless `key` holds just that; whether it had to.

    What is there is read and compared: of a damaged value the name alone would say that it is whole. Raises StoreError.
    """
    try:
        if store.get(key) == data:
            return False
    except MissingKeyError:
        pass
    store.put(key, data)
    return True
