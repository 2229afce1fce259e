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

COEFFICIENTS = ("CL", "CD", "Cm")
_CONDITIONS = ("mach", "h", "ground_height", "power")
_LINES = ("-", "--", ":", "-.")
_MARKERS = ("", "o", "s", "^", "v", "d")


def coefficient_figure(
    title: str,
    cases: Mapping[str, xr.DataTree],
    coefficients: Sequence[str] = COEFFICIENTS,
    configuration: str | None = None,
) -> Figure:
    """Return coefficients over the angle of attack: a row of panels for each case, a curve for each
    of its conditions.

    Parameters
    ----------
    title : str
    cases : mapping of str to DataTree
        Cases by name, see `datcom_io.Case.to_datatree`; those without tables of the static
        coefficients are left out.
    coefficients : sequence of str
        One column of panels each.
    configuration : str, optional
        Of the configurations of a build-up; the most complete one of the case without it.

    Raises
    ------
    SchemaError
        No case has the tables.
    UnknownName
        A coefficient or a configuration that a case does not have.
    AeromatchError
        matplotlib is not installed.
    """
    tables = {
        name: _chosen(tree["static"].to_dataset(), configuration)
        for name, tree in cases.items()
        if "static" in tree.children
    }
    if not tables:
        raise SchemaError(title, ["no case prints static coefficients over alpha; nothing to draw"])
    for name, table in tables.items():
        for coefficient in coefficients:
            if coefficient not in table:
                known = [
                    str(key)
                    for key in table.data_vars
                    if not str(key).endswith("_flag") and "alpha" in table[key].dims
                ]
                raise UnknownName(
                    coefficient, known, f"coefficient of {name}", f"there are {', '.join(known)}"
                )
    figure = new_figure(3.6 * len(coefficients) + 2.0, 2.9 * len(tables) + 0.6)
    axes = figure.subplots(len(tables), len(coefficients), squeeze=False)
    for row, (name, table) in zip(axes, tables.items(), strict=True):
        _draw_case(row, name, table, coefficients)
    figure.suptitle(title, fontsize="medium")
    return figure


def _chosen(table: xr.Dataset, configuration: str | None) -> xr.Dataset:
    """Return the table of one configuration."""
    known = [str(name) for name in np.atleast_1d(table["configuration"].values)]
    wanted = configuration or max(known, key=lambda name: name.count("-"))
    if wanted not in known:
        raise UnknownName(wanted, known, "configuration", f"there are {', '.join(known)}")
    return table.sel(configuration=wanted) if "configuration" in table.dims else table


def _draw_case(
    row: Sequence[Axes], title: str, table: xr.Dataset, coefficients: Sequence[str]
) -> None:
    """Draw one case: the first condition that varies gives the colour, the second the line, the
    third the marker.
    """
    from matplotlib import colormaps
    from matplotlib.lines import Line2D

    curves = table.stack(curve=[dim for dim in table[coefficients[0]].dims if dim != "alpha"])
    varied, common = _conditions(curves)
    looks: list[dict[str, Any]] = [
        {"color": "tab:blue", "linewidth": 1.0, "markersize": 3.0}
        for _ in range(curves.sizes["curve"])
    ]
    legend = []
    for key, texts in zip(("color", "linestyle", "marker"), varied, strict=False):
        levels = list(dict.fromkeys(texts))
        shades = [
            colormaps["viridis"](0.9 * number / max(1, len(levels) - 1))
            for number in range(len(levels))
        ]
        values = {"color": shades, "linestyle": _LINES, "marker": _MARKERS}[key]
        for number, level in enumerate(levels):
            look: dict[str, Any] = {
                "color": "0.3",
                "linewidth": 1.0,
                "markersize": 3.0,
                key: values[number % len(values)],
            }
            legend.append(Line2D([], [], label=level, **look))
            for curve in (curve for curve, text in zip(looks, texts, strict=True) if text == level):
                curve[key] = look[key]
    alpha, unit = to_display_quantity("alpha", curves["alpha"].values)
    for ax, name in zip(row, coefficients, strict=True):
        for values, look in zip(
            curves[name].transpose("curve", "alpha").values, looks, strict=True
        ):
            ax.plot(alpha, values, **look)
        ax.set_xlabel(f"alpha [{unit}]")
        ax.set_ylabel(name)
        ax.grid(linewidth=0.3)
    about = [table["configuration"].item().lower(), *common]
    row[0].set_title(", ".join([title, *about]), loc="left", fontsize="small")
    if legend:
        row[-1].legend(
            handles=legend,
            loc="upper left",
            bbox_to_anchor=(1.0, 1.0),
            fontsize="x-small",
            frameon=False,
        )


def _conditions(curves: xr.Dataset) -> tuple[list[list[str]], list[str]]:
    """Return the conditions that differ between the curves of a table, each as a text for every
    curve, and the texts of the others.
    """
    known = [
        name for name in map(str, curves.coords) if name in _CONDITIONS or name.startswith("delta_")
    ]
    varied, common = [], []
    for name in sorted(known, key=lambda name: (*_CONDITIONS, name).index(name)):
        texts = [
            _text(name, value)
            for value in np.broadcast_to(curves[name].values, curves.sizes["curve"])
        ]
        if len(set(texts)) > 1:
            varied.append(texts)
        else:
            common.append(texts[0])
    return varied, common


def _text(name: str, value: Any) -> str:
    if name == "mach":
        return f"M {value:g}"
    if name == "power":
        return f"power {value}"
    if name == "ground_height":
        return (
            f"{to_display_quantity('h', value)[0]:.3g} ft over ground"
            if np.isfinite(value)
            else "free air"
        )
    shown, unit = to_display_quantity(name, value)
    return f"{shown:.0f} {unit}" if name == "h" else f"{name} {shown:.3g} {unit}"
