"""Attributes of objects: tables of objects that lie together, and where each is (spec/world.md, Attributes)."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Annotated, Any

import msgspec
from msgspec import Meta

from farfield.errors import CorruptTileError
from farfield.store.contract import Store
from farfield.store.once import put_once
from farfield.world.keys import attributes_key, content_hash
from farfield.world.limits import DAMAGE, Count, Hash

Part = tuple[Count, Count, Hash]
"""First id, number of ids, hash of the table whose rows are those objects'."""


class AttributeIndex(msgspec.Struct, frozen=True):
    """What the manifest's `attributes` names."""

    objects: Count
    """Objects of the world, with attributes or without."""
    parts: Annotated[tuple[Part, ...], Meta(max_length=1 << 24)] = ()
    """Ascending; ranges of ids do not overlap."""


def encode_attribute_index(index: AttributeIndex) -> bytes:
    """JSON."""
    return msgspec.json.encode(index)


def decode_attribute_index(data: bytes, where: str = "") -> AttributeIndex:
    """Reads an index; allocates at most 32 bytes for each byte of it. Raises CorruptTileError."""
    try:
        return msgspec.json.decode(data, type=AttributeIndex)
    except DAMAGE as error:
        raise CorruptTileError(f"index of attributes is damaged: {error}", where) from None


def attribute_tables(store: Store, name: str) -> list[str]:
    """Keys of the tables of an index, each once. Raises CorruptTileError and StoreError."""
    key = attributes_key(name)
    index = decode_attribute_index(store.get(key), key)
    return [attributes_key(part) for part in dict.fromkeys(part for _, _, part in index.parts)]


def put_table(store: Store, columns: Mapping[str, Sequence[Any]]) -> str:
    """Stores a table, columns of equal length, and gives its hash; "" when there is nothing in it but nulls."""
    plain = {
        name: [value if value is None or type(value) is str else _plain(value) for value in columns[name]]
        for name in sorted(columns)
    }
    # A column of nulls says nothing: whether the file has one may depend on what of it was read.
    plain = {name: column for name, column in plain.items() if any(value is not None for value in column)}
    if not plain:
        return ""
    data = msgspec.json.encode({"columns": plain})
    name = content_hash(data)
    put_once(store, attributes_key(name), data)
    return name


def read_table(store: Store, name: str) -> dict[str, list[Any]]:
    """The columns of a table. Raises CorruptTileError and StoreError."""
    key = attributes_key(name)
    data = store.get(key)
    if content_hash(data) != name:
        raise CorruptTileError("table of attributes is damaged: its hash is another", key)
    try:
        return msgspec.json.decode(data, type=_Table).columns
    except DAMAGE as error:
        raise CorruptTileError(f"table of attributes is damaged: {error}", key) from None


class _Table(msgspec.Struct, frozen=True):
    columns: dict[str, list[Any]]


def _plain(value: Any) -> Any:
    """What JSON can say: whole numbers as such, whatever type their column has for the sake of its other rows."""
    if hasattr(value, "item"):
        value = value.item()
    if isinstance(value, float):
        if value != value:
            return None
        return int(value) if value.is_integer() and abs(value) < 1 << 53 else value
    return value if value is None or isinstance(value, bool | int | str) else str(value)
