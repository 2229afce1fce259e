"""Coefficients of printed cases over the angle of attack, as a figure."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING, Any

import numpy as np
import xarray as xr

from flightmech.errors import SchemaError, UnknownName
from flightmech.support.figures import new_figure, to_display_quantity

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure
    from matplotlib.lines import Line2D

COEFFICIENTS = ("CL", "CD", "Cm")
_CONDITIONS = ("mach", "h", "ground_height", "power")
_LINES = ("-", "--", ":", "-.")
_MARKERS = ("", "o", "s", "^", "v", "d")
_CURVE = {"color": "tab:blue", "linewidth": 1.0, "markersize": 3.0}
_LEGEND = {"color": "0.3", "linewidth": 1.0, "markersize": 3.0}


def coefficient_figure(
    title: str,
    cases: Mapping[str, xr.DataTree],
    coefficients: Sequence[str] = COEFFICIENTS,
    configuration: str | None = None,
) -> Figure:
    """Return coefficients over the angle of attack: a row of panels for each case.

    A panel has a curve for each flight condition.

    Parameters
    ----------
    title : str
    cases : mapping of str to DataTree
        Cases by name, see `datcom_io.Case.to_datatree`; those without tables of the static
        coefficients are left out.
    coefficients : sequence of str
        One column of panels each.
    configuration : str, optional
        One of the configurations of a build-up.  Default: the most complete one of the case.

    Raises
    ------
    SchemaError
        No case has the tables.
    UnknownName
        A coefficient or a configuration that a case does not have.
    AeromatchError
        matplotlib is not installed.
    """
    tables = {}
    for name, tree in cases.items():
        if "static" in tree.children:
            static = tree["static"].to_dataset()
            tables[name] = _select_configuration(static, configuration)
    if not tables:
        raise SchemaError(title, ["no case prints static coefficients over alpha; nothing to draw"])
    for name, table in tables.items():
        _check_coefficients(name, table, coefficients)
    # Size of a panel and of the margins. [inch]
    figure = new_figure(3.6 * len(coefficients) + 2.0, 2.9 * len(tables) + 0.6)
    axes = figure.subplots(len(tables), len(coefficients), squeeze=False)
    for row, (name, table) in zip(axes, tables.items(), strict=True):
        _draw_case(row, name, table=table, coefficients=coefficients)
    figure.suptitle(title, fontsize="medium")
    return figure


def _check_coefficients(name: str, table: xr.Dataset, coefficients: Sequence[str]) -> None:
    """Raise if a case does not print a coefficient over alpha."""
    for coefficient in coefficients:
        if coefficient in table:
            continue
        allowed = []
        for key in map(str, table.data_vars):
            if not key.endswith("_flag") and "alpha" in table[key].dims:
                allowed.append(key)
        hint = f"there are {', '.join(allowed)}"
        raise UnknownName(coefficient, allowed, f"coefficient of {name}", hint)


def _select_configuration(table: xr.Dataset, configuration: str | None) -> xr.Dataset:
    """Return the table of one configuration; None selects the one with most parts."""
    allowed = [str(name) for name in np.atleast_1d(table["configuration"].values)]
    # Parts of a configuration are joined by hyphens.
    selected = configuration or max(allowed, key=lambda name: name.count("-"))
    if selected not in allowed:
        raise UnknownName(selected, allowed, "configuration", f"there are {', '.join(allowed)}")
    if "configuration" not in table.dims:
        return table
    return table.sel(configuration=selected)


def _draw_case(
    row: Sequence[Axes], title: str, *, table: xr.Dataset, coefficients: Sequence[str]
) -> None:
    """Draw one case: a panel for each coefficient, a curve for each condition."""
    # Every combination of the other dimensions is one curve.
    dims = [dim for dim in table[coefficients[0]].dims if dim != "alpha"]
    curves = table.stack(curve=dims)
    varied, common = _split_conditions(curves)
    looks, legend = _curve_looks(varied, curves.sizes["curve"])
    alpha, unit = to_display_quantity("alpha", curves["alpha"].values)
    for ax, name in zip(row, coefficients, strict=True):
        values_of_curves = curves[name].transpose("curve", "alpha").values
        for values, look in zip(values_of_curves, looks, strict=True):
            ax.plot(alpha, values, **look)
        ax.set_xlabel(f"alpha [{unit}]")
        ax.set_ylabel(name)
        ax.grid(linewidth=0.3)
    heading = [title, table["configuration"].item().lower(), *common]
    row[0].set_title(", ".join(heading), loc="left", fontsize="small")
    if legend:
        row[-1].legend(
            handles=legend,
            loc="upper left",
            bbox_to_anchor=(1.0, 1.0),
            fontsize="x-small",
            frameon=False,
        )


def _curve_looks(varied: list[list[str]], curves: int) -> tuple[list[dict[str, Any]], list[Line2D]]:
    """Return colour, line and marker of each curve, and the entries of the legend.

    The first condition that varies gives the colour, the second the line, the third the marker.
    """
    from matplotlib import colormaps
    from matplotlib.lines import Line2D

    looks: list[dict[str, Any]] = [dict(_CURVE) for _ in range(curves)]
    legend = []
    for key, texts in zip(("color", "linestyle", "marker"), varied, strict=False):
        levels = list(dict.fromkeys(texts))
        steps = max(1, len(levels) - 1)
        shades = [colormaps["viridis"](0.9 * number / steps) for number in range(len(levels))]
        values = {"color": shades, "linestyle": _LINES, "marker": _MARKERS}[key]
        # A level of the condition has one look in all panels.
        for number, level in enumerate(levels):
            value = values[number % len(values)]
            entry: dict[str, Any] = {**_LEGEND, key: value}
            legend.append(Line2D([], [], label=level, **entry))
            for look, text in zip(looks, texts, strict=True):
                if text == level:
                    look[key] = value
    return looks, legend


def _split_conditions(curves: xr.Dataset) -> tuple[list[list[str]], list[str]]:
    """Return the conditions that differ between curves, and the texts of the other conditions.

    A condition that differs has a text for every curve.
    """
    names = []
    for name in map(str, curves.coords):
        if name in _CONDITIONS or name.startswith("delta_"):
            names.append(name)
    varied, common = [], []
    for name in sorted(names, key=lambda name: (*_CONDITIONS, name).index(name)):
        # A condition that is a scalar coordinate holds for all curves.
        values = np.broadcast_to(curves[name].values, curves.sizes["curve"])
        texts = [_condition_text(name, value) for value in values]
        if len(set(texts)) > 1:
            varied.append(texts)
        else:
            common.append(texts[0])
    return varied, common


def _condition_text(name: str, value: Any) -> str:
    if name == "mach":
        return f"M {value:g}"
    if name == "power":
        return f"power {value}"
    if name == "ground_height":
        if not np.isfinite(value):
            return "free air"
        return f"{to_display_quantity('h', value)[0]:.3g} ft over ground"
    number, unit = to_display_quantity(name, value)
    if name == "h":
        return f"{number:.0f} {unit}"
    return f"{name} {number:.3g} {unit}"
