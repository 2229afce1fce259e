"""Parts of the figures of lift and rolling moment: lines, panels, ranges and local estimates."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence

import numpy as np
import xarray as xr

from aerodb.figures.curve_families import thin_breakpoints
from aerodb.figures.curve_sources import refine_breakpoints
from aerodb.figures.lr743_set.chart import Chart, ChartLine, ChartPanel, FlightPoints, NotDrawn
from aerodb.figures.lr743_set.combinations import coefficient_leaves, points_of, span_of
from aerodb.figures.symbols import axis_label, math_symbol, to_printed_unit, value_with_symbol
from flightmech import terms as _terms
from flightmech.names import lookup

Databases = Mapping[str, xr.DataTree]
Curves = Callable[[xr.DataTree], tuple[list[ChartLine], str]]
"""The lines of one database, and the values of its fixed variables in words."""

MOST_CURVES = 7  # of a family


def chart_over_alpha(
    databases: Databases,
    curves: Curves,
    *,
    stem: str,
    number: str,
    title: str,
    y_label: str,
    by: str,
    points: Sequence[FlightPoints] = (),
    notes: Sequence[str] = (),
) -> Chart:
    """Return a chart over angle of attack with a panel per database, curves by a variable."""
    panels, fixed = panels_of_databases(databases, curves, points, by=by)
    symbol = y_label.split(" [")[0]
    unit = " [deg]" if lookup(by).units == "rad" else ""
    line = f"{symbol} over ${math_symbol('alpha')}$, curves by ${math_symbol(by)}${unit}{fixed}"
    return Chart(
        stem=stem,
        number=number,
        title=title,
        line=line,
        x_label=axis_label("alpha"),
        y_label=y_label,
        panels=panels,
        notes=notes,
    )


def panels_of_databases(
    databases: Databases, curves: Curves, points: Sequence[FlightPoints], by: str
) -> tuple[list[ChartPanel], str]:
    """Return a panel per database, and the fixed variables of the first in words."""
    panels = []
    texts = []
    last = list(databases)[-1]
    for name, db in databases.items():
        lines, text = curves(db)
        texts.append(text)
        # The points from flight belong to the final database.
        panel_points = points if name == last else ()
        panels.append(ChartPanel(name, lines, points=panel_points, by=f"${math_symbol(by)}$"))
    return panels, texts[0]


def line_over_alpha(
    by: str,
    member: float,
    alpha: np.ndarray,
    *,
    values: tuple[np.ndarray, np.ndarray],
    index: int,
) -> ChartLine:
    """Return a curve over angle of attack [rad]; `values` are ordinates and standard errors."""
    y, stderr = values
    x = to_printed_unit("alpha", alpha)
    return ChartLine(value_with_symbol(by, member), x, y, stderr=stderr, member=index)


def flap_settings(db: xr.DataTree) -> tuple[float, ...]:
    """Return the flap settings of the curves. [rad]"""
    return thin_breakpoints(points_of(db, "CL", "delta_f"), MOST_CURVES)


def covered_alphas(db: xr.DataTree) -> np.ndarray:
    """Return angles of attack over the range that all tables of lift cover. [rad]"""
    low, high = span_of(db, "CL", "alpha")
    points = points_of(db, "CL", "alpha")
    return refine_breakpoints(points[(points >= low) & (points <= high)])


def half_chord(db: xr.DataTree, name: str, preferred: float) -> float:
    """Return half the chord of a derivative, inside the tables of the variable on both sides."""
    demand_dependence(db, name)
    try:
        low, high = span_of(db, "CL", name)
    except NotDrawn:
        # A regressor has no table, and therefore no limit.
        return preferred
    return min(preferred, -low, high)


def middle_mach(db: xr.DataTree, among: str) -> dict[str, float]:
    """Return the middle Mach number of the terms of lift that depend on a variable."""
    demand_dependence(db, among)
    try:
        points = points_of(db, "CL", "mach", among)
    except NotDrawn:
        # These terms do not depend on Mach number, so the other terms decide.
        points = points_of(db, "CL", "mach")
    return {"mach": float(points[(len(points) - 1) // 2])}


def demand_dependence(db: xr.DataTree, name: str) -> None:
    """Raise `NotDrawn` if no term of lift depends on a variable."""
    leaves = coefficient_leaves(db, "CL")
    if not any(name in _terms.list_model_variables(leaf) for leaf in leaves):
        raise NotDrawn(f"no term of CL depends on {name}")


def fixed_text(values: Mapping[str, float]) -> str:
    """Return the values of fixed variables as the end of a line. [SI]"""
    texts = ", ".join(value_with_symbol(name, value) for name, value in values.items())
    return f"; at {texts}" if texts else ""
