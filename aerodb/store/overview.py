"""Overview of a database as text: its terms, ranges and sources."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from typing import TYPE_CHECKING, Any

import numpy as np

from aerodb.store.schema import terms
from flightmech import terms as _terms
from flightmech.names import lookup, unit_suffix
from flightmech.units import from_si

if TYPE_CHECKING:
    import xarray as xr


FREE_AIR = 1e4  # value of h_agl from which on there is no ground effect [m]


def display_text(name: str, value: float) -> str:
    """Return a value in the display unit of a quantity, ``12 deg``."""
    if name == "h_agl" and value >= FREE_AIR:
        return "in free air"
    unit = lookup(name).display_units
    return f"{plain_number(from_si(float(value), unit))}{unit_suffix(unit)}"


def plain_number(value: float) -> str:
    """Return a number with four significant digits, larger ones whole.

    Examples
    --------
    >>> plain_number(20000.0), plain_number(-0.0), plain_number(0.123456)
    ('20000', '0', '0.1235')
    """
    # The sum turns -0.0 into 0.0.
    if 1e4 <= abs(value) < 1e8:
        return f"{value + 0.0:.0f}"
    return f"{value + 0.0:.4g}"


OVERVIEW = "1"
"""Version number of the rows of `describe_database`.

Files contain these rows.  Raise the number whenever the rules of the rows change.
"""
_FEW = 12  # absent terms that are listed one by one
HEAD = ("term", "axes", "times", "values", "stderr", "source")
ORIGIN = "origin"
"""Attribute of a term: the programs of its a-priori value, such as ``Digital DATCOM, AVL``."""


def list_origins(db: xr.DataTree) -> dict[str, str]:
    """Return the a-priori sources of the terms that state them, by term."""
    leaves = terms(db).items()
    return {name: str(leaf.attrs[ORIGIN]) for name, leaf in leaves if ORIGIN in leaf.attrs}


def describe_database(db: xr.DataTree) -> list[dict[str, Any]]:
    """Return one row per term, for a program.

    Returns
    -------
    list of dict
        ``term``, ``axes`` (of all its tables: name, breakpoints [SI], unit), ``regressors``,
        ``power`` (factor in words, or empty), ``value`` and ``stderr`` (smallest and largest, or
        None), ``source`` (name to share of the nodes). A change of the rows requires a higher
        `OVERVIEW`.
    """
    return [_describe_term(name, leaf) for name, leaf in terms(db).items()]


def summary(db: xr.DataTree) -> str:
    """Return a table of the terms as text.

    Its columns are axes with ranges (angles in degrees), regressors, values, standard errors and
    source.
    """
    return summary_text(db.attrs, describe_database(db))


def summary_text(attributes: Mapping[Any, Any], terms: Iterable[Mapping[str, Any]]) -> str:
    """Return the text of `summary` from root attributes and the rows of `describe_database`."""
    # Columns as wide as their widest cell, the head included.
    rows: list[tuple[str, ...]] = [HEAD]
    rows += [_format_row(row) for row in terms]
    widths = [max(map(len, column)) for column in zip(*rows)]
    lines = []
    for row in rows:
        cells = [cell.ljust(width) for cell, width in zip(row, widths)]
        lines.append("  ".join(cells).rstrip())
    return "\n".join([*heading_lines(attributes), "", *lines])


def heading_lines(a: Mapping[Any, Any]) -> list[str]:
    """Return the lines on a database: title, reference quantities, axes, absent terms."""
    point = ", ".join(f"{a[key]:.4f}" for key in ("x_ref", "y_ref", "z_ref"))
    return [
        str(a["title"]),
        f"S {a['S']:.4f} m2, cbar {a['cbar']:.4f} m, b {a['b']:.4f} m; moments about "
        f"({point}) m from the datum",
        f"forces in {a['force_axes']} axes, moments and rates in body axes",
        f"absent: {_list_absent(str(a.get('absent', '')).split())}",
    ]


def _list_absent(names: list[str]) -> str:
    """Return the absent terms as text; a long list is grouped by coefficients."""
    if len(names) <= _FEW:
        return " ".join(names) or "nothing"
    # Coefficients that lack each contribution, in the order of the scheme.
    by_contribution: dict[str, list[str]] = {}
    for name in names:
        coefficient, _, contribution = name.partition("/")
        by_contribution.setdefault(contribution, []).append(coefficient)
    # Contributions that are absent from the same coefficients share a group.
    groups: dict[str, list[str]] = {}
    for contribution, coefficients in by_contribution.items():
        groups.setdefault(" ".join(coefficients), []).append(contribution)
    texts = [f"{group}: {' '.join(contributions)}" for group, contributions in groups.items()]
    return "; ".join(texts)


def _describe_term(name: str, leaf: xr.Dataset) -> dict[str, Any]:
    """Return the row of `describe_database` of one term."""
    # Axes of the table first, then those of its factors.
    axes = []
    for table in ("value", "K1", "K2"):
        if table not in leaf:
            continue
        for axis in map(str, leaf[table].dims):
            points = leaf[axis].values.astype(float).tolist()
            axes.append({"name": axis, "points": points, "units": lookup(axis).units})
    stderr = None
    if "stderr" in leaf:
        stderr = _value_range(leaf["stderr"].values)
    return {
        "term": name,
        "axes": axes,
        "regressors": list(_terms.list_regressors(leaf)),
        "power": str(_terms.power_factor(leaf) or ""),
        "value": _value_range(leaf["value"].values),
        "stderr": stderr,
        "source": _source_shares(leaf),
    }


def _value_range(table: np.ndarray) -> list[float]:
    """Return the smallest and the largest value of a table."""
    return [float(table.min()), float(table.max())]


def _source_shares(leaf: xr.Dataset) -> dict[str, float]:
    """Return the share of the nodes of each source, by its name."""
    if "source" not in leaf:
        return {}
    codes, counts = np.unique(leaf["source"].values, return_counts=True)
    shares = {}
    for code, count in zip(codes, counts):
        shares[_terms.SOURCES[int(code)]] = float(count / counts.sum())
    return shares


def _format_row(row: Mapping[str, Any]) -> tuple[str, ...]:
    """Return the cells of a row of `describe_database` as texts, in display units."""
    # A dash marks an empty cell.
    axes = [_format_axis(**axis) for axis in row["axes"]]
    multipliers = filter(None, [*row["regressors"], row["power"]])
    stderr = "-"
    if row["stderr"]:
        stderr = _format_range(row["stderr"])
    sources = list(row["source"])
    if len(sources) > 1:
        sources = [f"{source} {100 * share:.0f} %" for source, share in row["source"].items()]
    return (
        row["term"],
        ", ".join(axes) or "-",
        " ".join(multipliers) or "-",
        _format_range(row["value"]),
        stderr,
        ", ".join(sources) or "-",
    )


def _format_axis(name: str, points: list[float], units: str) -> str:
    """Return an axis as text, ``alpha[5] -4 ... 12 deg``; `units` is part of the row only."""
    unit = lookup(name).display_units
    low, high = from_si(points[0], unit), from_si(points[-1], unit)
    return f"{name}[{len(points)}] {low:.6g} ... {high:.6g}{unit_suffix(unit)}"


def _format_range(ends: list[float]) -> str:
    """Return a range of values as text; a single number if both ends are equal."""
    low, high = ends
    if low == high:
        return f"{low:.4g}"
    return f"{low:.4g} ... {high:.4g}"


def leaf_rows(leaf: xr.Dataset) -> tuple[list[str], list[tuple[str, ...]]]:
    """Return the head and the rows of one term as a table of texts.

    Each row belongs to a node of all axes but the last.  The breakpoints of the last axis are in
    the head of the columns.
    """
    values = leaf["value"].values
    if not values.ndim:
        return ["value"], [(f"{float(values):.6g}",)]
    # Rows are the nodes of all axes but the last, columns its breakpoints.
    *row_axes, column_axis = map(str, leaf["value"].dims)
    head = [_label_axis(axis) for axis in row_axes]
    head += [f"{column_axis} {_format_point(column_axis, x)}" for x in leaf[column_axis].values]
    rows = []
    for node in np.ndindex(values.shape[:-1]):
        row = [_format_point(axis, leaf[axis].values[i]) for axis, i in zip(row_axes, node)]
        row += [f"{x:.5g}" for x in np.atleast_1d(values[node])]
        rows.append(tuple(row))
    return head, rows


def _label_axis(axis: str) -> str:
    """Return the name of an axis with its display unit."""
    unit = lookup(axis).display_units
    if unit == "1":
        return axis
    return f"{axis} [{unit}]"


def _format_point(axis: str, value: float) -> str:
    """Return a breakpoint in the display unit of its axis."""
    return f"{from_si(float(value), lookup(axis).display_units):.6g}"
