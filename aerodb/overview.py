"""A database as a table that a person reads."""

from __future__ import annotations

from typing import Any

import numpy as np
import xarray as xr

from flightmech import terms as _terms
from flightmech.names import lookup
from flightmech.units import from_si

from .schema import terms

HEAD = ("term", "axes", "times", "values", "stderr", "source")


def describe(db: xr.DataTree) -> list[dict[str, Any]]:
    """Return one row per term, made of texts: term, axes with ranges (display units), regressors, value and stderr range, source."""
    return [_row(name, leaf) for name, leaf in terms(db).items()]


def summary(db: xr.DataTree) -> str:
    """Return a table of the terms as text: axes with ranges (angles in degrees), regressors, values, standard errors, source."""
    rows = [tuple(row[key] for key in HEAD) for row in describe(db)]
    widths = [max(len(line[i]) for line in [HEAD, *rows]) for i in range(len(HEAD))]
    lines = ["  ".join(cell.ljust(width) for cell, width in zip(line, widths)).rstrip() for line in [HEAD, *rows]]
    return "\n".join([*heading(db), "", *lines])


def heading(db: xr.DataTree) -> list[str]:
    """Return the lines about the whole database: title, reference quantities, axes, absent terms."""
    a = db.attrs
    point = ", ".join(f"{a[key]:.4f}" for key in ("x_ref", "y_ref", "z_ref"))
    return [
        str(a["title"]),
        f"S {a['S']:.4f} m2, cbar {a['cbar']:.4f} m, b {a['b']:.4f} m; moments about ({point}) m from the datum",
        f"forces in {a['force_axes']} axes, moments and rates in body axes",
        f"absent: {a.get('absent') or 'nothing'}",
    ]


def _row(name: str, leaf: xr.Dataset) -> dict[str, Any]:
    tables = [leaf[key] for key in ("value", "K1", "K2") if key in leaf]
    stderr = leaf["stderr"].values if "stderr" in leaf else np.array([])
    return {
        "term": name,
        "axes": ", ".join(_axis(table[axis]) for table in tables for axis in map(str, table.dims)) or "-",
        "times": " ".join(_terms.regressors(leaf)) or "-",
        "values": _span(leaf["value"].values),
        "stderr": _span(stderr) if stderr.size else "-",
        "source": _sources(leaf),
    }


def _axis(points: xr.DataArray) -> str:
    unit = lookup(str(points.name)).display_units
    low, high = (from_si(float(p), unit) for p in (points[0], points[-1]))
    return f"{points.name}[{points.size}] {low:.4g} ... {high:.4g}{'' if unit == '1' else f' {unit}'}"


def _span(values: np.ndarray) -> str:
    low, high = float(values.min()), float(values.max())
    return f"{low:.4g}" if low == high else f"{low:.4g} ... {high:.4g}"


def _sources(leaf: xr.Dataset) -> str:
    """Name the sources of the nodes; more than one with their shares."""
    if "source" not in leaf:
        return "-"
    codes, counts = np.unique(leaf["source"].values, return_counts=True)
    words = [_terms.SOURCES[int(code)] for code in codes]
    if len(words) == 1:
        return words[0]
    return ", ".join(f"{word} {100 * count / counts.sum():.0f} %" for word, count in zip(words, counts))


def leaf_rows(leaf: xr.Dataset) -> tuple[list[str], list[tuple[str, ...]]]:
    """Return one term as a table of texts: a row per node of all axes but the last, whose breakpoints head the columns."""
    value = leaf["value"]
    if not value.ndim:
        return ["value"], [(f"{float(value):.6g}",)]
    *rows_over, across = (str(axis) for axis in value.dims)
    head = [_label(axis) for axis in rows_over] + [f"{across} {_show(across, x)}" for x in value[across].values]
    rows = []
    for node in np.ndindex(*(value.sizes[axis] for axis in rows_over)):
        place = tuple(_show(axis, value[axis].values[i]) for axis, i in zip(rows_over, node))
        rows.append(place + tuple(f"{x:.5g}" for x in np.atleast_1d(value.values[node])))
    return head, rows


def _label(axis: str) -> str:
    unit = lookup(axis).display_units
    return axis if unit == "1" else f"{axis} [{unit}]"


def _show(axis: str, value: float) -> str:
    return f"{from_si(float(value), lookup(axis).display_units):.4g}"
