"""Accessors: typed arrays in buffer views, with strides, sparse overlays and normalised integers."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from farfield.errors import InputError
from farfield.scene.faults import EXPORT_AGAIN
from farfield.scene.gltf.container import Document

_COMPONENT: dict[int, str] = {5120: "i1", 5121: "u1", 5122: "<i2", 5123: "<u2", 5125: "<u4", 5126: "<f4"}
_WIDTH = {"SCALAR": 1, "VEC2": 2, "VEC3": 3, "VEC4": 4, "MAT4": 16}


def accessor_count(document: Document, index: int) -> int:
    """Rows of the accessor."""
    return int(document.item("accessors", index)["count"])


def accessor_array(document: Document, index: int, start: int = 0, stop: int | None = None) -> NDArray[Any]:
    """(count, components) in the stored type; rows from `start` up to but not including `stop` (None: the end).

    Raises InputError when the buffer is too short for it, or it has not so many rows.
    """
    accessor = document.item("accessors", index)
    dtype, width, count = _layout(accessor)
    stop = count if stop is None else stop
    if stop > count:
        raise InputError(f"is damaged: accessors[{index}] has {count:,} rows of {stop:,}", document.where, EXPORT_AGAIN)
    if "bufferView" in accessor:
        offset = accessor.get("byteOffset", 0)
        values = _strided(document, accessor["bufferView"], offset, dtype, (count, width))[start:stop]
    else:
        values = np.zeros((stop - start, width), dtype)
    if "sparse" in accessor:
        values = values.copy()
        rows, replacement = _sparse(document, accessor["sparse"], dtype, width)
        inside = (rows >= start) & (rows < stop)
        values[rows[inside].astype(np.int64) - start] = replacement[inside]
    return values


def accessor_floats(document: Document, index: int, start: int = 0, stop: int | None = None) -> NDArray[np.float64]:
    """(count, components) float64, normalised integers scaled to -1..1 or 0..1 as glTF defines; rows as above."""
    values = accessor_array(document, index, start, stop)
    if document.item("accessors", index).get("normalized", False):
        return normalised(values)
    return values.astype(np.float64)


def normalised(values: NDArray[Any]) -> NDArray[np.float64]:
    """Integers as fractions of their largest value, signed ones clipped at -1; floats unchanged."""
    if values.dtype.kind == "f":
        return values.astype(np.float64)
    scaled = values.astype(np.float64) / np.iinfo(values.dtype).max
    return np.maximum(scaled, -1.0)


def _layout(accessor: dict[str, Any]) -> tuple[np.dtype[Any], int, int]:
    return np.dtype(_COMPONENT[accessor["componentType"]]), _WIDTH[accessor["type"]], int(accessor["count"])


def _sparse(
    document: Document, sparse: dict[str, Any], dtype: np.dtype[Any], width: int
) -> tuple[NDArray[Any], NDArray[Any]]:
    count, indices, values = int(sparse["count"]), sparse["indices"], sparse["values"]
    index_type = np.dtype(_COMPONENT[indices["componentType"]])
    rows = _strided(document, indices["bufferView"], indices.get("byteOffset", 0), index_type, (count, 1))
    return rows[:, 0], _strided(document, values["bufferView"], values.get("byteOffset", 0), dtype, (count, width))


def _strided(document: Document, view: int, offset: int, dtype: np.dtype[Any], shape: tuple[int, int]) -> NDArray[Any]:
    """Rows of a buffer view, `byteStride` apart; no copy."""
    raw = document.view_bytes(view)
    row = dtype.itemsize * shape[1]
    stride = document.item("bufferViews", view).get("byteStride", row)
    needed = offset + (shape[0] - 1) * stride + row if shape[0] else 0
    if needed > len(raw) or offset < 0 or shape[0] < 0:
        raise InputError(
            f"is truncated: bufferViews[{view}] is shorter than its accessor", document.where, EXPORT_AGAIN
        )
    return np.ndarray(shape, dtype, raw, offset, (stride, dtype.itemsize))
