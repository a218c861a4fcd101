"""Features of a vector file: shapes, columns and coordinate reference system."""

from __future__ import annotations

import json
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from farfield.errors import InputError, MissingExtraError
from farfield.scene.faults import EXPORT_AGAIN


@dataclass(frozen=True, slots=True, eq=False)
class FeatureTable:
    """What a vector file holds."""

    shapes: NDArray[np.object_]
    """(n,) shapely geometries, None where a feature has none."""
    columns: dict[str, NDArray[Any]]
    """(n,) each; numbers, text (object) or ISO dates (object)."""
    crs: str | None
    """Authority code or WKT, or None."""


def read_table(path: Path, layer: str | None) -> FeatureTable:
    """All features of a GeoJSON, GeoPackage, FlatGeobuf or GeoParquet file. Raises InputError."""
    if path.suffix.lower() in (".parquet", ".geoparquet"):
        return _parquet(path)
    import pyogrio
    import shapely

    try:
        meta, _, raw, fields = pyogrio.raw.read(path, layer=layer, force_2d=True)
    except (RuntimeError, ValueError, IndexError) as error:
        raise InputError(_reason(str(error), layer), str(path), _hint(path, layer)) from error
    if raw is None:
        raise InputError("holds a table without shapes", str(path), "export the footprints with it")
    columns = {str(name): _plain(column) for name, column in zip(meta["fields"], fields, strict=True)}
    return FeatureTable(shapely.from_wkb(raw, on_invalid="ignore"), columns, meta["crs"])


def _reason(message: str, layer: str | None) -> str:
    if layer is not None and "layer" in message.lower():
        return f"has no layer {layer!r}"
    return "is damaged: it cannot be read as a vector file"


def _hint(path: Path, layer: str | None) -> str:
    import pyogrio

    if layer is None:
        return EXPORT_AGAIN
    try:
        return "its layers: " + ", ".join(str(row[0]) for row in pyogrio.list_layers(path))
    except RuntimeError:
        return EXPORT_AGAIN


def _plain(column: NDArray[Any]) -> NDArray[Any]:
    """Dates become ISO text; numbers and text stay."""
    if column.dtype.kind != "M":
        return column
    text = np.datetime_as_string(column).astype(object)
    text[np.isnat(column)] = None
    return text


def _parquet(path: Path) -> FeatureTable:
    try:
        import pyarrow
        import pyarrow.parquet
    except ImportError as error:
        raise MissingExtraError("GeoParquet needs pyarrow", "geo", str(path)) from error
    import shapely

    try:
        table = pyarrow.parquet.read_table(path)
    except (pyarrow.ArrowException, OSError) as error:
        raise InputError("is damaged: it cannot be read as Parquet", str(path), EXPORT_AGAIN) from error
    header = json.loads((table.schema.metadata or {}).get(b"geo", b"{}"))
    name = header.get("primary_column", "geometry")
    if name not in table.column_names:
        raise InputError("is Parquet without a column of shapes", str(path), "write it as GeoParquet")
    about = header.get("columns", {}).get(name, {})
    if about.get("encoding", "WKB") != "WKB":
        raise InputError(f"stores shapes as {about['encoding']}", str(path), "write them as WKB")
    raw = table.column(name).to_numpy()
    shapes = shapely.force_2d(shapely.from_wkb(raw, on_invalid="ignore"))
    others = [other for other in table.column_names if other != name and other != "bbox"]
    columns = {other: _plain(table.column(other).to_numpy()) for other in others}
    return FeatureTable(shapes, columns, _parquet_crs(about, path) if header else None)


def _parquet_crs(about: dict[str, Any], path: Path) -> str | None:
    """GeoParquet: PROJJSON; absent means longitude and latitude, null means unknown."""
    if "crs" not in about:
        return "OGC:CRS84"
    crs = about["crs"]
    if crs is None or isinstance(crs, str):
        return crs
    if "id" in crs:
        return f"{crs['id']['authority']}:{crs['id']['code']}"
    from farfield.scene.georeference import load_pyproj

    return str(load_pyproj(str(path)).CRS.from_json_dict(crs).to_wkt())
