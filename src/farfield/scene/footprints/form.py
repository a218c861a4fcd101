"""What is to stand on each footprint: its height, where it begins, its colours."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from farfield.scene.faults import counted
from farfield.scene.footprints.colours import colours_of
from farfield.scene.footprints.details import Form
from farfield.scene.footprints.heights import TALLEST, heights_of, named_column, numbers
from farfield.scene.footprints.table import FeatureTable
from farfield.scene.options import ReadOptions


def form_of(
    table: FeatureTable, base: NDArray[np.float64], options: ReadOptions, where: str, warnings: list[str]
) -> Form:
    """The form that a table has or its columns tell; what an option names comes first.

    base: (n,) altitudes of the ground. Raises InputError when there is nothing to take heights from.
    """
    form = Form(_heights(table, base, options, where)) if table.form is None or _names_heights(options) else table.form
    if table.form is not None:
        form = replace(form, details=table.form.details, seed=table.form.seed)
    details, named = form.details, options.min_height_attribute
    if named is not None:
        lift = numbers(table.columns[named_column(table.columns, named, where)])
        details = replace(details, lift=np.where(np.isnan(lift), 0.0, lift))
    if options.wall_color_attribute is not None:
        details = replace(details, wall_color=_colors(table, options.wall_color_attribute, where, warnings))
    if options.roof_color_attribute is not None:
        details = replace(details, roof_color=_colors(table, options.roof_color_attribute, where, warnings))
    return _standing(replace(form, details=details), where, warnings)


def _colors(table: FeatureTable, named: str, where: str, warnings: list[str]) -> NDArray[np.uint8]:
    colors, unknown = colours_of(table.columns[named_column(table.columns, named, where)])
    if unknown:
        warnings.append(f"{where}: {counted(unknown, 'value')} of {named} that are no colours")
    return colors


def _names_heights(options: ReadOptions) -> bool:
    return options.height_attribute is not None or options.top_attribute is not None


def _heights(table: FeatureTable, base: NDArray[np.float64], options: ReadOptions, where: str) -> NDArray[np.float64]:
    """(n,) by the altitudes of the roofs where these are asked for and known, else by the columns of heights."""
    named, other, default = options.top_attribute, options.height_attribute, options.default_height
    if named is None:
        return heights_of(table.columns, len(table), other, default, where)
    height = numbers(table.columns[named_column(table.columns, named, where)]) - base
    stands = (height > 0) & (height < TALLEST)
    unknown = heights_of(table.columns, len(table), other, np.nan if default is None else default, where)
    return np.where(stands, height, unknown)


def _standing(form: Form, where: str, warnings: list[str]) -> Form:
    """A height that ends below its own beginning was measured from there; what begins below the ground, or would end
    above all buildings for it, begins at the ground.
    """
    lift = form.details.lift
    if lift is None:
        return form
    short = form.height <= lift
    top = np.where(short, lift + form.height, lift)
    absurd = (lift < 0) | (top >= TALLEST)
    if absurd.any():
        mended = counted(int(absurd.sum()), "building")
        what = f"{mended} whose walls would begin below 0 m or end above {TALLEST:,.0f} m"
        warnings.append(f"{where}: {what} are taken from the ground")
    lift, short = np.where(absurd, 0.0, lift), short & ~absurd
    if short.any():
        mended = counted(int(short.sum()), "height")
        warnings.append(f"{where}: {mended} that end below where the walls begin are taken from there")
    height = np.where(short, lift + form.height, form.height)
    return replace(form, height=height, details=replace(form.details, lift=lift))
