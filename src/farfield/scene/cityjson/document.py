"""CityJSON files as documents: one of a file, one for each feature of a CityJSONSeq."""

from __future__ import annotations

import json
import math
import re
from collections import Counter
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import msgspec
import numpy as np
from numpy.typing import NDArray

from farfield.errors import InputError
from farfield.scene.cleaning import ABSURD_METRES
from farfield.scene.faults import EXPORT_AGAIN

_READ = ((1, 0), (1, 1), (2, 0))
_NO_JSON = (ValueError, RecursionError)


@dataclass(frozen=True, slots=True, eq=False)
class Header:
    """What holds for every document of a file."""

    scale: NDArray[np.float64]
    """(3,)."""
    translate: NDArray[np.float64]
    """(3,)."""
    reference: object
    """metadata.referenceSystem as it is, or None."""
    templates: tuple[Any, ...]
    """Geometries of geometry-templates."""
    template_vertices: NDArray[np.float64]
    """(n, 3), NaN where unusable; in the unit of the CRS (metres where that is degrees), not transformed."""
    json: dict[str, Any]


@dataclass(frozen=True, slots=True, eq=False)
class Document:
    """City objects that share their vertices."""

    objects: dict[str, Any]
    vertices: NDArray[np.float64]
    """(n, 3) in the file's CRS; NaN where unusable."""
    appearance: dict[str, Any]


def open_documents(path: Path, faults: Counter[str]) -> tuple[Header, Iterator[Document]]:
    """The header of a CityJSON or CityJSONSeq file, and its documents, which are read as they are asked for.

    Lines of a sequence that cannot be read are counted in `faults`. Raises InputError.
    """
    where = str(path)
    with path.open("rb") as file:
        line = file.readline()
        first = _parsed(line)
        if first is None:
            whole = _whole(line + file.read(), where)
            header = _header(whole, where)
            return header, iter([_document(whole, header)])
    header = _header(first, where)
    return header, _sequence(path, len(line), first, header, faults)


def _sequence(
    path: Path, begin: int, first: dict[str, Any], header: Header, faults: Counter[str]
) -> Iterator[Document]:
    if mapping(first.get("CityObjects")):
        yield _document(first, header)
    with path.open("rb") as file:
        file.seek(begin)
        for line in file:
            if not line.strip():
                continue
            feature = _parsed(line)
            if feature is None or feature.get("type") != "CityJSONFeature":
                faults["line that cannot be read"] += 1
            else:
                yield _document(feature, header)


def _whole(text: bytes, where: str) -> dict[str, Any]:
    try:
        found = _decoded(text)
    except _NO_JSON as error:
        what = "nested too deeply" if isinstance(error, RecursionError) else str(error).splitlines()[0]
        raise InputError(f"is damaged: {what}", where, EXPORT_AGAIN) from error
    if not isinstance(found, dict):
        raise InputError("is JSON, but not CityJSON", where, "check the path")
    return found


def _parsed(line: bytes) -> dict[str, Any] | None:
    """The object of one line, or None."""
    try:
        found = _decoded(line)
    except _NO_JSON:
        return None
    return found if isinstance(found, dict) else None


def _decoded(text: bytes) -> Any:
    text = text.removeprefix(b"\xef\xbb\xbf")
    try:
        return msgspec.json.decode(text)
    except _NO_JSON:
        if not re.search(rb"NaN|Infinity|\\u[dD][89a-fA-F]|\d{300}|[eE]\+?\d{3}", text):
            raise
        return json.loads(text)  # Takes what only JavaScript and Python write.


def _header(top: dict[str, Any], where: str) -> Header:
    """Raises InputError for what is no CityJSON, or of a version that is not read."""
    kind = top.get("type")
    if kind == "CityJSONFeature":
        raise InputError("begins with a CityJSONFeature", where, "put the line of type CityJSON, with transform, first")
    if kind != "CityJSON":
        raise InputError("is JSON, but not CityJSON", where, "check the path")
    version = _version(top.get("version"), where)
    templates = mapping(top.get("geometry-templates"))
    scale, translate = _transform(top.get("transform"), version, where)
    return Header(
        scale,
        translate,
        mapping(top.get("metadata")).get("referenceSystem"),
        tuple(sequence(templates.get("templates"))),
        points_of(templates.get("vertices-templates")),
        top,
    )


def _version(given: object, where: str) -> tuple[int, int]:
    found = re.match(r"(\d{1,4})(?:\.(\d{1,4}))?", str(given))
    version = (int(found[1]), int(found[2] or 0)) if found else (0, 0)
    if version in _READ:
        return version
    if found is None:
        raise InputError("is CityJSON of no known version", where, "1.0, 1.1 and 2.0 are read")
    hint = "upgrade it with cjio" if version < _READ[0] else "1.0, 1.1 and 2.0 are read"
    raise InputError(f"is CityJSON {version[0]}.{version[1]}, which is not read", where, hint)


def _transform(given: object, version: tuple[int, int], where: str) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    if given is None and version == (1, 0):
        return np.ones(3), np.zeros(3)
    if given is None:
        raise InputError("has no transform", where, "CityJSON from 1.1 on needs one; export it again")
    parts = [points_of([mapping(given).get(name)])[0] for name in ("scale", "translate")]
    if not np.isfinite(parts).all() or not parts[0].all():
        raise InputError("has a transform without numbers", where, "it needs scale and translate, three each")
    return parts[0], parts[1]


def _document(top: dict[str, Any], header: Header) -> Document:
    with np.errstate(over="ignore", invalid="ignore"):
        vertices = points_of(top.get("vertices")) * header.scale + header.translate
    appearance = top.get("appearance", header.json.get("appearance"))
    return Document(mapping(top.get("CityObjects")), _believable(vertices), mapping(appearance))


def points_of(given: object) -> NDArray[np.float64]:
    """(n, 3) float64 of a list of triples; rows that are none become NaN."""
    rows = sequence(given)
    try:
        points = np.array(rows, np.float64)
        if points.ndim == 2 and points.shape[1] == 3:
            points[~np.isfinite(points).all(1)] = np.nan
            return points
    except (ValueError, TypeError, OverflowError):
        pass
    return np.array([_triple(row) for row in rows], np.float64).reshape(-1, 3)


def _triple(row: object) -> tuple[float, float, float]:
    try:
        x, y, z = (float(value) for value in row)  # type: ignore[attr-defined]
    except (ValueError, TypeError, OverflowError):
        return math.nan, math.nan, math.nan
    return (x, y, z) if math.isfinite(x + y + z) else (math.nan, math.nan, math.nan)


def _believable(vertices: NDArray[np.float64]) -> NDArray[np.float64]:
    """NaN for vertices more than 10,000 km from the middle of the others."""
    known = ~np.isnan(vertices[:, 0])
    if known.any():
        with np.errstate(over="ignore", invalid="ignore"):
            apart = vertices - np.median(vertices[known], axis=0)
            vertices[~(np.abs(apart) <= ABSURD_METRES).all(1)] = np.nan
    return vertices


def mapping(given: object) -> dict[str, Any]:
    """The object of a JSON text, or an empty one in place of anything else."""
    return given if isinstance(given, dict) else {}


def sequence(given: object) -> list[Any]:
    """The list of a JSON text, or an empty one in place of anything else."""
    return given if isinstance(given, list) else []
