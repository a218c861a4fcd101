"""GeoJSON, GeoPackage and FlatGeobuf, read by GDAL."""

from __future__ import annotations

import math
from collections import defaultdict
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from farfield.errors import InputError
from farfield.scene.faults import EXPORT_AGAIN
from farfield.scene.footprints.table import FeatureTable, plain, with_shared_text
from farfield.scene.georeference import load_pyproj
from farfield.scene.options import Region

_OBJECTS = 1 << 22
"""Texts and encoded shapes that a part of a file may hold: 0.3 to 0.8 GB before equal texts are shared."""
_REACH = 500.0
"""Metres around a region: what has its middle in it reaches into this, up to a kilometre in size."""
_PARTS = 4
"""Parts of a FlatGeobuf at most: GDAL skips its features by reading them, 0.7 to 1.8 µs each."""


def read_ogr(
    path: Path, layer: str | None, region: Region | None = None, region_crs: str | None = None
) -> FeatureTable:
    """The features of a GeoJSON, GeoPackage or FlatGeobuf file. Raises InputError.

    region: no others than those whose shapes reach near it, found by the file's own index where it has one.
    region_crs: CRS of its coordinates; None: that of the file.
    """
    wkb: list[NDArray[np.object_]] = []
    columns: dict[str, list[NDArray[Any]]] = defaultdict(list)
    known: dict[str, dict[str, str]] = defaultdict(dict)
    crs: str | None = None
    for part in _parts(path, layer) if region is None else _near(path, layer, region, region_crs):
        crs = part.crs
        wkb += part.wkb
        for name in list(part.columns):
            columns[name].append(with_shared_text(plain(part.columns.pop(name)), known[name]))
    return FeatureTable(wkb, {name: np.concatenate(columns.pop(name)) for name in list(columns)}, crs)


def read_ogr_column(path: Path, layer: str | None, name: str) -> NDArray[Any]:
    """(n,): one attribute of all features of a file, without their shapes. Raises InputError."""
    _, _, _, (column,) = _raw(path, layer, columns=[name], read_geometry=False)
    return plain(column)


def _near(path: Path, layer: str | None, region: Region, region_crs: str | None) -> Iterator[FeatureTable]:
    about = _facts(path, layer)
    low = (region[0] - _REACH, region[1] - _REACH)
    box = (*low, region[2] + _REACH, region[3] + _REACH)
    if about["crs"] is not None and region_crs is not None and about["crs"] != region_crs:
        pyproj = load_pyproj(str(path))
        box = pyproj.Transformer.from_crs(region_crs, about["crs"], always_xy=True).transform_bounds(*box)
    yield _read(path, about["layer_name"], bbox=box)


def _parts(path: Path, layer: str | None) -> Iterator[FeatureTable]:
    """The file in order, at least one part. Raises InputError."""
    if path.suffix.lower() not in (".gpkg", ".fgb"):
        yield _read(path, layer)  # GDAL parses a GeoJSON as a whole whenever it is opened.
        return
    about = _facts(path, layer)
    count, rows = int(about["features"]), _rows_of_a_part(about)
    found = 0
    while True:
        part = _read(path, about["layer_name"], skip_features=found, max_features=rows)
        found += len(part)
        yield part
        if len(part) < rows or found >= count:
            break
    if about["driver"] == "FlatGeobuf" and found < count:
        raise InputError(f"is cut short: {found:,} of its {count:,} features are there", str(path), EXPORT_AGAIN)


def _rows_of_a_part(about: dict[str, Any]) -> int:
    """Features read together. Few enough for _OBJECTS; all of them, when their number is unknown (-1)."""
    count, texts = int(about["features"]), len([kind for kind in about["dtypes"] if kind == "object"])
    if count < 0:
        return int(np.iinfo(np.int32).max)
    rows = max(_OBJECTS // (1 + texts), 1)
    return max(rows, math.ceil(count / _PARTS)) if about["driver"] == "FlatGeobuf" else rows


def _facts(path: Path, layer: str | None) -> dict[str, Any]:
    import pyogrio

    try:
        return dict(pyogrio.read_info(path, layer=layer))
    except (RuntimeError, ValueError, IndexError) as error:
        raise _unreadable(path, layer, error) from error


def _read(path: Path, layer: str | None, **which: Any) -> FeatureTable:
    meta, _, raw, fields = _raw(path, layer, force_2d=True, **which)
    if raw is None:
        raise InputError("holds a table without shapes", str(path), "export the footprints with it")
    columns = {str(name): column for name, column in zip(meta["fields"], fields, strict=True)}
    return FeatureTable([raw], columns, meta["crs"])


def _raw(path: Path, layer: str | None, **which: Any) -> Any:
    import pyogrio

    try:
        return pyogrio.raw.read(path, layer=layer, **which)
    except (RuntimeError, ValueError, IndexError) as error:
        raise _unreadable(path, layer, error) from error


def _unreadable(path: Path, layer: str | None, error: Exception) -> InputError:
    if layer is not None and "layer" in str(error).lower():
        return InputError(f"has no layer {layer!r}", str(path), _layers(path))
    return InputError("is damaged: it cannot be read as a vector file", str(path), EXPORT_AGAIN)


def _layers(path: Path) -> str:
    import pyogrio

    try:
        return "its layers: " + ", ".join(str(row[0]) for row in pyogrio.list_layers(path))
    except RuntimeError:
        return EXPORT_AGAIN
