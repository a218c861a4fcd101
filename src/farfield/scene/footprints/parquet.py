"""GeoParquet, read by pyarrow."""

from __future__ import annotations

import json
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from farfield.errors import InputError, MissingExtraError
from farfield.scene.faults import EXPORT_AGAIN
from farfield.scene.footprints.table import FeatureTable, plain, with_shared_text


def read_parquet(path: Path) -> FeatureTable:
    """All features of a GeoParquet file. Raises InputError, and MissingExtraError without pyarrow."""
    with _opened(path) as file:
        names = file.schema_arrow.names
        header = json.loads((file.schema_arrow.metadata or {}).get(b"geo", b"{}"))
        shape = header.get("primary_column", "geometry")
        if shape not in names:
            raise InputError("is Parquet without a column of shapes", str(path), "write it as GeoParquet")
        about = header.get("columns", {}).get(shape, {})
        if about.get("encoding", "WKB") != "WKB":
            raise InputError(f"stores shapes as {about['encoding']}", str(path), "write them as WKB")
        wkb = list(_encoded(file, shape))
        columns = {name: _column(file, name) for name in names if name not in (shape, "bbox")}
    return FeatureTable(wkb, columns, _crs(about, path) if header else None)


@contextmanager
def _opened(path: Path) -> Iterator[Any]:
    """The pyarrow.parquet.ParquetFile; what goes wrong while it is open is an InputError."""
    try:
        import pyarrow
        import pyarrow.parquet
    except ImportError as error:
        raise MissingExtraError("GeoParquet needs pyarrow", "geo", str(path)) from error
    try:
        with pyarrow.parquet.ParquetFile(path) as file:
            yield file
    except (pyarrow.ArrowException, OSError) as error:
        raise InputError("is damaged: it cannot be read as Parquet", str(path), EXPORT_AGAIN) from error


def _encoded(file: Any, name: str) -> Iterator[NDArray[np.object_]]:
    """The shapes by batches of rows, (k,) bytes or None."""
    import pyarrow

    for batch in file.iter_batches(columns=[name]):
        yield np.array(pyarrow.chunked_array([batch.column(name)]).to_numpy(), object)


def _column(file: Any, name: str) -> NDArray[Any]:
    """(n,): read alone, so that only one column at a time is there twice, in Arrow and in numpy."""
    return with_shared_text(plain(file.read(columns=[name]).column(name).to_numpy()), {})


def _crs(about: dict[str, Any], path: Path) -> str | None:
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
