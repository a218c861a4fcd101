"""Heights of buildings from the columns of a table: found by name, or named."""

from __future__ import annotations

import re
from typing import Any

import numpy as np
from numpy.typing import NDArray

from farfield.errors import InputError

STOREY = 3.0
"""Metres a level counts where only levels are known."""

HEIGHT_NAMES = ("height", "measuredheight", "bldgmeasuredheight", "buildingheight", "hauteur", "renderheight",
                "roofheight", "hmean", "heightm", "bldgheight", "hoehe", "hoogte", "altura")  # fmt: skip
LEVEL_NAMES = ("buildinglevels", "levels", "numfloors", "storeysaboveground", "bldgstoreysaboveground", "nbetages",
               "floors", "numberoffloors")  # fmt: skip
TALLEST = 2000.0
"""Metres; greater heights are mistakes (the tallest building has 828 m)."""


def heights_of(
    columns: dict[str, NDArray[Any]], count: int, named: str | None, default: float | None, where: str
) -> NDArray[np.float64]:
    """(n,) float64 metres, NaN where unknown.

    Without a name: the first column called like a height, then levels times 3 m, then the default.
    Raises InputError when there is nothing to take heights from.
    """
    height = np.full(count, np.nan)
    names = [named_column(columns, named, where)] if named else _found(columns, HEIGHT_NAMES)
    levels = [] if named else _found(columns, LEVEL_NAMES)
    if not names and not levels and default is None:
        known = ", ".join(list(columns)[:12]) or "none"
        raise InputError("has no attribute of heights", where,
                         f"name one as height_attribute or give a default_height; its attributes: {known}")  # fmt: skip
    for name, metres in [(name, 1.0) for name in names] + [(name, STOREY) for name in levels]:
        values = numbers(columns[name]) * metres
        height = np.where(np.isnan(height) & (values > 0) & (values < TALLEST), values, height)
    return height if default is None else np.where(np.isnan(height), default, height)


def named_column(columns: dict[str, NDArray[Any]], name: str, where: str) -> str:
    """The name itself. Raises InputError when there is no such column."""
    if name not in columns:
        known = ", ".join(list(columns)[:12]) or "none"
        raise InputError(f"has no attribute {name!r}", where, f"its attributes: {known}")
    return name


def numbers(column: NDArray[Any]) -> NDArray[np.float64]:
    """(n,) float64; text such as '12', '12,5' or '12.5 m' is understood, feet as well; NaN for the rest."""
    if column.dtype.kind in "iufb":
        return column.astype(np.float64)
    return np.array([_number(value) for value in column], np.float64)


def _number(value: Any) -> float:
    if isinstance(value, int | float):
        return float(value)
    found = re.match(r"\s*([-+]?\d+(?:[.,]\d+)?)\s*(m|ft|')?", value) if isinstance(value, str) else None
    if not found:
        return float("nan")
    return float(found[1].replace(",", ".")) * (0.3048 if found[2] in ("ft", "'") else 1.0)


def _found(columns: dict[str, NDArray[Any]], wanted: tuple[str, ...]) -> list[str]:
    """Columns whose letters spell one of the wanted names, in the order wanted."""
    spelt = {re.sub(r"[^a-z]", "", name.lower()): name for name in reversed(columns)}
    return [spelt[name] for name in wanted if name in spelt]
