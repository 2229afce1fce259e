"""A database as a table that a person reads."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from typing import TYPE_CHECKING, Any

from aerodb.store.schema import terms
from flightmech import terms as _terms
from flightmech.names import lookup
from flightmech.units import from_si

if TYPE_CHECKING:
    import numpy as np
    import xarray as xr

    from flightmech.support.netcdf_trees import StoredGroup

FREE_AIR = 1e4  # h_agl from here on is no height over ground [m]


def display_text(name: str, value: float) -> str:
    """Return a value in the display unit of a quantity, ``12 deg``."""
    if name == "h_agl" and value >= FREE_AIR:
        return "in free air"
    unit = lookup(name).display_units
    return f"{plain_number(from_si(float(value), unit))}{'' if unit == '1' else f' {unit}'}"


def plain_number(value: float) -> str:
    """Return a number with four significant digits, larger ones whole.

    Examples
    --------
    >>> plain_number(20000.0), plain_number(-0.0), plain_number(0.123456)
    ('20000', '0', '0.1235')
    """
    return f"{value + 0.0:.0f}" if 1e4 <= abs(value) < 1e8 else f"{value + 0.0:.4g}"


OVERVIEW = "1"
"""Name of the rules that `describe_terms` follows, a number; files carry what it gave, so that it is raised whenever these rules change."""
_FEW = 12  # absent terms that are listed one by one
SHOWN = ("value", "K1", "K2", "stderr", "source")  # variables of a term that an overview needs
STATED = ("regressors", "power", "exponent", "floor")  # attributes of a term that it needs
HEAD = ("term", "axes", "times", "values", "stderr", "source")


def describe_database(db: xr.DataTree) -> list[dict[str, Any]]:
    """Return one row per term, for a program.

    Returns
    -------
    list of dict
        ``term``, ``axes`` (of all its tables: name, breakpoints [SI], unit), ``regressors``,
        ``power`` (factor in words, or empty), ``value`` and ``stderr`` (smallest and largest, or
        None), ``source`` (name to share of the nodes).
    """

    return describe_terms(terms(db))


def describe_terms(leaves: Mapping[str, xr.Dataset | StoredGroup]) -> list[dict[str, Any]]:
    """Return the rows of `describe_database` of terms by name, also as they stand in a file; who changes
    what they hold raises `OVERVIEW`.
    """
    return [_facts(name, leaf) for name, leaf in leaves.items()]


def summary(db: xr.DataTree) -> str:
    """Return a table of the terms as text: axes with ranges (angles in degrees), regressors,
    values, standard errors, source.
    """

    return overview_text(db.attrs, terms(db))


def overview_text(attributes: Mapping, leaves: Mapping[str, xr.Dataset | StoredGroup]) -> str:
    """Return the text of `summary` from root attributes and terms by name, also as they stand in a
    file.
    """
    return summary_text(attributes, describe_terms(leaves))


def summary_text(attributes: Mapping, terms: Iterable[Mapping[str, Any]]) -> str:
    """Return the text of `summary` from root attributes and the rows of `describe_database`."""
    rows = [_texts(row) for row in terms]
    widths = [max(len(line[i]) for line in [HEAD, *rows]) for i in range(len(HEAD))]
    lines = [
        "  ".join(cell.ljust(width) for cell, width in zip(line, widths)).rstrip()
        for line in [HEAD, *rows]
    ]
    return "\n".join([*heading_lines(attributes), "", *lines])


def heading_lines(a: Mapping) -> list[str]:
    """Return the lines about the whole database from its root attributes: title, reference
    quantities, axes, absent terms.
    """
    point = ", ".join(f"{a[key]:.4f}" for key in ("x_ref", "y_ref", "z_ref"))
    return [
        str(a["title"]),
        f"S {a['S']:.4f} m2, cbar {a['cbar']:.4f} m, b {a['b']:.4f} m; moments about "
        f"({point}) m from the datum",
        f"forces in {a['force_axes']} axes, moments and rates in body axes",
        f"absent: {_absent(str(a.get('absent', '')).split())}",
    ]


def _absent(names: list[str]) -> str:
    """Return the absent terms as text; many of them by the coefficients that lack them."""
    if len(names) <= _FEW:
        return " ".join(names) or "nothing"
    lacking: dict[str, list[str]] = {}
    for name in names:
        coefficient, _, contribution = name.partition("/")
        lacking.setdefault(contribution, []).append(coefficient)
    groups: dict[str, list[str]] = {}
    for contribution, coefficients in lacking.items():
        groups.setdefault(" ".join(coefficients), []).append(contribution)
    return "; ".join(f"{coefficients}: {' '.join(words)}" for coefficients, words in groups.items())


def _facts(name: str, leaf: xr.Dataset | StoredGroup) -> dict[str, Any]:

    axes = [
        (str(axis), leaf[str(axis)].values)
        for key in ("value", "K1", "K2")
        if key in leaf
        for axis in leaf[key].dims
    ]
    return {
        "term": name,
        "axes": [
            {
                "name": axis,
                "points": points.astype(float).tolist(),
                "units": lookup(axis).units,
            }
            for axis, points in axes
        ],
        "regressors": list(_terms.list_regressors(leaf)),
        "power": str(_terms.power_factor(leaf) or ""),
        "value": _ends(leaf["value"].values),
        "stderr": _ends(leaf["stderr"].values) if "stderr" in leaf else None,
        "source": _shares(leaf),
    }


def _ends(table: np.ndarray) -> list[float]:
    return [float(table.min()), float(table.max())]


def _shares(leaf: xr.Dataset | StoredGroup) -> dict[str, float]:
    if "source" not in leaf:
        return {}
    import numpy as np

    codes, counts = np.unique(leaf["source"].values, return_counts=True)
    return {
        _terms.SOURCES[int(code)]: float(count / counts.sum()) for code, count in zip(codes, counts)
    }


def _texts(row: Mapping[str, Any]) -> tuple[str, ...]:
    """Return a row of `describe_database` as a person reads it, in display units."""
    shares = row["source"]
    return (
        row["term"],
        ", ".join(_axis(**axis) for axis in row["axes"]) or "-",
        " ".join(filter(None, [*row["regressors"], row["power"]])) or "-",
        _span(row["value"]),
        _span(row["stderr"]) if row["stderr"] else "-",
        ", ".join(
            f"{word} {100 * share:.0f} %" if len(shares) > 1 else word
            for word, share in shares.items()
        )
        or "-",
    )


def _axis(name: str, points: list[float], units: str) -> str:
    shown = lookup(name).display_units
    low, high = (from_si(x, shown) for x in (points[0], points[-1]))
    return f"{name}[{len(points)}] {low:.6g} ... {high:.6g}{'' if shown == '1' else f' {shown}'}"


def _span(ends: list[float]) -> str:
    low, high = ends
    return f"{low:.4g}" if low == high else f"{low:.4g} ... {high:.4g}"


def leaf_rows(leaf: xr.Dataset | StoredGroup) -> tuple[list[str], list[tuple[str, ...]]]:
    """Return one term as a table of texts: a row per node of all axes but the last, whose
    breakpoints head the columns.
    """
    import numpy as np

    values = leaf["value"].values
    if not values.ndim:
        return ["value"], [(f"{float(values):.6g}",)]
    *rows_over, across = (str(axis) for axis in leaf["value"].dims)
    head = [_label(axis) for axis in rows_over] + [
        f"{across} {_show(across, x)}" for x in leaf[across].values
    ]
    rows = []
    for node in np.ndindex(values.shape[:-1]):
        place = tuple(_show(axis, leaf[axis].values[i]) for axis, i in zip(rows_over, node))
        rows.append(place + tuple(f"{x:.5g}" for x in np.atleast_1d(values[node])))
    return head, rows


def _label(axis: str) -> str:
    unit = lookup(axis).display_units
    return axis if unit == "1" else f"{axis} [{unit}]"


def _show(axis: str, value: float) -> str:
    return f"{from_si(float(value), lookup(axis).display_units):.6g}"
