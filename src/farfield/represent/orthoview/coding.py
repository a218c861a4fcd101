"""Planes as coded symbols: the tables that tell probabilities, and the stream (spec/orthoview.md, Codec 3)."""

from __future__ import annotations

import struct
import zlib
from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from farfield.errors import CorruptTileError
from farfield.inflate import inflate
from farfield.kernels import rans

_SIZES = struct.Struct("<HH")


class Model(NamedTuple):
    """Contexts that share an alphabet; those of a plane's models are numbered one after the other."""

    contexts: int
    alphabet: int


def coded(models: Sequence[Model], contexts: NDArray[np.uint16], symbols: NDArray[np.uint8]) -> bytes:
    """The plane. contexts: (n,) of each symbol, numbers of the models or from rans.BITS on. symbols: (n,)."""
    table = np.empty(sum(model.contexts for model in models), np.int32)
    codes = []
    first = rows = 0
    for model in models:
        counts = np.zeros(model, np.int64)
        last = first + model.contexts
        rans.count_symbols(contexts, symbols, first, last, counts)
        own, found = rans.tables_of(counts)
        table[first:last] = own + rows
        codes.append(found)
        first, rows = last, rows + len(found)
    told = _told(table, codes)
    packer = zlib.compressobj(9, zlib.DEFLATED, -15)
    packed = packer.compress(told) + packer.flush()
    starts, widths = _spread(codes)
    stream = np.empty(4 + 2 * len(contexts), np.uint8)
    begin = rans.encode(contexts, symbols, table, starts, widths, stream)
    return _SIZES.pack(len(packed), len(told)) + packed + stream[begin:].tobytes()


def _told(table: NDArray[np.int32], codes: Sequence[NDArray[np.uint8]]) -> bytes:
    """Which contexts take another table than the one before, a bit each, and the codes of all tables."""
    other = np.ones(len(table), bool)
    other[1:] = table[1:] != table[:-1]
    return np.packbits(other).tobytes() + b"".join(found.tobytes() for found in codes)


def _spread(codes: Sequence[NDArray[np.uint8]]) -> tuple[NDArray[np.uint16], NDArray[np.uint16]]:
    """(tables, largest alphabet) starts and widths in 1/1024."""
    whole = np.zeros((sum(map(len, codes)), max(found.shape[1] for found in codes)), np.uint8)
    row = 0
    for found in codes:
        whole[row : row + len(found), : found.shape[1]] = found
        row += len(found)
    starts, widths = np.empty_like(whole, np.uint16), np.empty_like(whole, np.uint16)
    rans.spread(whole, rans.WEIGHTS, starts, widths)
    return starts, widths


Tables = tuple[NDArray[np.uint8], NDArray[np.int32], NDArray[np.uint32], NDArray[np.int64]]
"""(n + 2,) stream with two zeros behind it, (contexts,) table of each, (tables, 1024) slots, (2,) cursor."""


class Reader:
    """A coded plane while it is read: tables and cursor as the kernels of kernels/contexts.py take them.

    Raises CorruptTileError for tables that no writer makes. Allocates at most 5 kB a context.
    """

    def __init__(self, models: Sequence[Model], plane: bytes, name: str, where: str) -> None:
        self._name, self._where = name, where
        if len(plane) < _SIZES.size:
            raise self._wrong("is too short")
        packed, size = _SIZES.unpack_from(plane)
        told, stream = plane[_SIZES.size : _SIZES.size + packed], plane[_SIZES.size + packed :]
        if len(stream) < 4:
            raise self._wrong("is too short")
        table, codes = self._tables(models, self._inflated(told, size))
        starts, widths = _spread(codes)
        slots = np.zeros((len(starts), rans.ONE), np.uint32)
        rans.fill_slots(starts, widths, slots)
        self._end = len(stream)
        self._cursor = np.array([int.from_bytes(stream[:4], "little"), 4], np.int64)
        self.arguments: Tables = (np.frombuffer(stream + bytes(2), np.uint8), table, slots, self._cursor)

    def finish(self) -> None:
        """Raises CorruptTileError unless the stream has been read to its end and came out as a writer began it."""
        if self._cursor.tolist() != [rans.LOWEST, self._end]:
            raise self._wrong("does not hold what it should")

    def _inflated(self, packed: bytes, size: int) -> bytes:
        try:
            return inflate(packed, size)
        except zlib.error as error:
            raise self._wrong(f"has tables that cannot be inflated: {error}") from None

    def _tables(self, models: Sequence[Model], told: bytes) -> tuple[NDArray[np.int32], list[NDArray[np.uint8]]]:
        contexts = sum(model.contexts for model in models)
        bits = np.unpackbits(np.frombuffer(told, np.uint8)[: (contexts + 7) // 8])
        codes = np.frombuffer(told, np.uint8)[(contexts + 7) // 8 :]
        if len(bits) < contexts or bits[contexts:].any() or codes.max(initial=0) > rans.LARGEST_CODE:
            raise self._wrong("has tables that no writer makes")
        other = bits[:contexts].astype(np.int32)
        table = (np.cumsum(other) - 1).astype(np.int32)
        found: list[NDArray[np.uint8]] = []
        first = at = 0
        for model in models:
            rows = int(other[first : first + model.contexts].sum())
            size = rows * model.alphabet
            if not other[first] or len(codes) - at < size:
                raise self._wrong("has tables that no writer makes")
            found.append(codes[at : at + size].reshape(rows, model.alphabet))
            first, at = first + model.contexts, at + size
        if at != len(codes):
            raise self._wrong("has more tables than contexts")
        return table, found

    def _wrong(self, what: str) -> CorruptTileError:
        return CorruptTileError(f"{self._name} plane {what}", self._where)
