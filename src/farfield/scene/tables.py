"""Instance tables: many placements of one source, from .npy or Parquet."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from farfield.errors import InputError, MissingExtraError
from farfield.scene.faults import existing_file, reading

_COLUMNS = {
    4: ("x", "y", "z", "heading"),
    5: ("x", "y", "z", "heading", "scale"),
    7: ("x", "y", "z", "heading", "scale_x", "scale_y", "scale_z"),
    8: ("x", "y", "z", "qx", "qy", "qz", "qw", "scale"),
}
"""Meaning of the columns of a (k, n) array by n."""

_SHAPES = "shape (k, 3, 4), or (k, 4), (k, 5), (k, 7) or (k, 8)"


def read_table(path: Path) -> NDArray[np.float64]:
    """(k, 3, 4) float64 placements of a .npy or .parquet file. Raises InputError."""
    existing_file(path)
    with reading(str(path)):
        if path.suffix.lower() == ".npy":
            return _from_array(np.load(path, mmap_mode="r", allow_pickle=False), path)
        if path.suffix.lower() in (".parquet", ".geoparquet"):
            return placements_of(_parquet_columns(path), str(path))
    raise InputError("is not an instance table", str(path), "use .npy or .parquet")


def placements_of(columns: dict[str, NDArray[Any]], where: str) -> NDArray[np.float64]:
    """(k, 3, 4) float64: scale, then turn, then move.

    columns: x, y, z in metres; heading in degrees counter-clockwise seen from above, or qx, qy, qz, qw;
    scale, or scale_x, scale_y, scale_z. All but x and y may be absent. Raises InputError.
    """
    missing = [name for name in "xy" if name not in columns]
    if missing:
        raise InputError(f"has no column {missing[0]!r}", where, "name its columns x, y, z, heading, scale")
    count = len(columns["x"])
    zero, one = np.zeros(count), np.ones(count)
    out = np.empty((count, 3, 4))
    out[:, :, :3] = _rotations(columns, zero)
    uniform = columns.get("scale", one)
    out[:, :, :3] *= np.stack([columns.get(f"scale_{axis}", uniform) for axis in "xyz"], -1)[:, None, :]
    out[:, :, 3] = np.stack([columns.get(axis, zero) for axis in "xyz"], -1)
    return out


def turned(heading: NDArray[np.float64]) -> NDArray[np.float64]:
    """(k, 3, 3): turns about z by degrees, counter-clockwise seen from above."""
    angle = np.deg2rad(heading)
    c, s, zero, one = np.cos(angle), np.sin(angle), np.zeros(len(angle)), np.ones(len(angle))
    rows = np.array([[c, -s, zero], [s, c, zero], [zero, zero, one]])
    return np.moveaxis(rows, 2, 0)


def _rotations(columns: dict[str, NDArray[Any]], zero: NDArray[np.float64]) -> NDArray[np.float64]:
    from farfield.scene.gltf.nodes import rotation_matrices

    if "qw" in columns:
        return rotation_matrices(np.stack([columns[f"q{axis}"] for axis in "xyzw"], -1).astype(np.float64))
    return turned(np.asarray(columns.get("heading", zero), np.float64))


def _from_array(table: NDArray[Any], path: Path) -> NDArray[np.float64]:
    if table.dtype.kind not in "iuf":
        raise InputError(f"holds {table.dtype}, not numbers", str(path), f"save floats of {_SHAPES}")
    if table.ndim == 3 and table.shape[1:] == (3, 4):
        return np.array(table, np.float64)
    if table.ndim != 2 or table.shape[1] not in _COLUMNS:
        raise InputError(f"has the shape {table.shape}", str(path), f"save {_SHAPES}")
    names = _COLUMNS[table.shape[1]]
    return placements_of({name: np.array(table[:, k], np.float64) for k, name in enumerate(names)}, str(path))


def _parquet_columns(path: Path) -> dict[str, NDArray[Any]]:
    try:
        import pyarrow.parquet as parquet
    except ImportError as error:
        raise MissingExtraError("Parquet needs pyarrow", "geo", str(path)) from error
    file = parquet.ParquetFile(path)
    known = {name for names in _COLUMNS.values() for name in names}
    wanted = [name for name in file.schema_arrow.names if name in known]
    table = file.read(columns=wanted)
    return {name: table.column(name).to_numpy().astype(np.float64) for name in wanted}
