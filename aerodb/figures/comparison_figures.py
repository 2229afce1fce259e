"""Difference maps: where over two axes one database departs from another, and by how many standard
errors.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np
import xarray as xr

from aerodb.comparison.conditions import Conditions
from aerodb.figures.curve_families import DifferenceSurface, difference_surface
from aerodb.figures.drawing import (
    LEFT,
    RIGHT,
    WIDTH,
    Axes,
    Figure,
    FigureSheet,
    Line2D,
    MaxNLocator,
    Patch,
    drawing_style,
    foot_height,
    foot_lines,
    reference_notes,
)
from aerodb.figures.family_panels import quantity_symbol
from aerodb.figures.figures import held_text, term_title
from aerodb.figures.symbols import (
    axis_label,
    derivative_unit,
    number_text,
    positive_sense,
    to_printed_unit,
)

_TOP, _HEIGHT, _BETWEEN, _AXIS = 0.95, 2.6, 0.62, 0.36
_FAR = 2.0  # standard errors beyond which a difference is hatched


def plot_difference(
    databases: Mapping[str, xr.DataTree],
    name: str,
    family: str | None = None,
    *,
    over: str | None = None,
    at: Mapping[str, float] | None = None,
    support: Conditions | None = None,
) -> Figure:
    """Draw the last of several databases less the first over two axes, and the same in standard
    errors of the first.

    Parameters
    ----------
    databases, name, over, at, support
        As in `plot_comparison`; flight samples are dots, whatever their other conditions.
    family : str, optional
        The variable along the ordinate.

    Returns
    -------
    matplotlib Figure
        One map, or two where the first database states standard errors. Lines of equal difference
        are labelled, negative ones dashed; beyond two standard errors the map is hatched.

    Raises
    ------
    UnknownName, SchemaError
        As in `plot_comparison`; a term of one axis, or of one database.
    """
    s = difference_surface(databases, name, family, over, at)
    first, last = s.family.curves
    notes = foot_lines(_notes(databases, s))
    known = bool((s.stderr > 0).any())
    with drawing_style():
        sheet = FigureSheet(_TOP + _HEIGHT + _AXIS + 0.08 + foot_height(notes))
        sheet.figure.set_label(f"{term_title(name)}: {last} less {first}")
        sheet.head(
            f"{databases[first].attrs['aircraft']}: {term_title(name)}",
            [f"difference {last} less {first}, ${quantity_symbol(s.family)}${held_text(s.family)}"],
        )
        sheet.key(_handles(known, support is not None), 0.5)
        width = (WIDTH - LEFT - RIGHT - (_BETWEEN if known else 0.0)) / (2 if known else 1)
        axes = sheet.panel(LEFT, _TOP, width, _HEIGHT)
        _map(axes, s, s.difference, support, f"difference [{derivative_unit(s.family.regressors)}]")
        if known:
            ratio = np.divide(
                s.difference, s.stderr, out=np.full_like(s.difference, np.nan), where=s.stderr > 0
            )
            axes = sheet.panel(LEFT + width + _BETWEEN, _TOP, width, _HEIGHT)
            _map(axes, s, ratio, support, f"difference in standard errors of {first}")
            _hatch(axes, s, ratio)
        sheet.foot(notes)
    return sheet.figure


def _map(
    axes: Axes, s: DifferenceSurface, values: np.ndarray, support: Conditions | None, words: str
) -> None:
    x, y = to_printed_unit(s.family.over, s.x), to_printed_unit(s.family.by, s.y)
    largest = float(np.nanmax(np.abs(values))) if np.isfinite(values).any() else 0.0
    if largest > 0.0:
        levels = MaxNLocator(10, symmetric=True).tick_values(-largest, largest)
        axes.contourf(
            x, y, values, levels, cmap="PuOr", alpha=0.55, vmin=-1.3 * largest, vmax=1.3 * largest
        )
        lines = axes.contour(
            x,
            y,
            values,
            levels,
            colors="black",
            linewidths=0.6,
            linestyles=["--" if v < 0 else "-" for v in levels],
        )
        lines.set_label(words)
        axes.clabel(lines, fontsize=6, fmt=number_text, inline_spacing=2)
    else:
        axes.text(0.5, 0.5, "no difference", transform=axes.transAxes, ha="center")
    axes.grid(False)
    nodes = np.meshgrid(
        *(to_printed_unit(axis, s.family.points[axis]) for axis in (s.family.over, s.family.by))
    )
    axes.plot(*(grid.ravel() for grid in nodes), "k.", markersize=1.3, label="node")
    if support is not None and s.family.over in support and s.family.by in support:
        places = [
            to_printed_unit(axis, np.ravel(np.asarray(support[axis], float)))
            for axis in (s.family.over, s.family.by)
        ]
        axes.plot(
            *_thinned(*places),
            linestyle="none",
            marker="+",
            color="#a63f00",
            markersize=2.5,
            markeredgewidth=0.5,
            label="flight sample",
        )
    axes.set_xlim(x[0], x[-1])
    axes.set_ylim(y[0], y[-1])
    axes.set_title(words, fontsize=7.5, loc="left", pad=3)
    axes.set_xlabel(axis_label(s.family.over), labelpad=1)
    axes.set_ylabel(axis_label(s.family.by))


def _hatch(axes: Axes, s: DifferenceSurface, ratio: np.ndarray) -> None:
    worst = float(np.nanmax(np.abs(ratio)))
    if worst > _FAR:
        x, y = to_printed_unit(s.family.over, s.x), to_printed_unit(s.family.by, s.y)
        axes.contourf(x, y, np.abs(ratio), [_FAR, 2 * worst], colors="none", hatches=["////"])


def _thinned(x: np.ndarray, y: np.ndarray) -> np.ndarray:
    """Return the samples that can be distinguished in a map, (2, samples)."""
    places = np.stack([x, y])[:, np.isfinite(x) & np.isfinite(y)]
    if not places.size:
        return places
    span = np.ptp(places, axis=1, keepdims=True)
    _, first = np.unique(
        (places / np.where(span > 0, span, 1.0) * 60).round(), axis=1, return_index=True
    )
    return places[:, np.sort(first)]


def _handles(known: bool, supported: bool) -> list[Any]:
    handles: list[Any] = [
        Line2D([], [], color="black", linewidth=0.6, label="positive"),
        Line2D([], [], color="black", linewidth=0.6, linestyle="--", label="negative"),
        Line2D(
            [],
            [],
            color="black",
            linestyle="none",
            marker=".",
            markersize=2.5,
            label="node of a table",
        ),
    ]
    if supported:
        handles.append(
            Line2D(
                [],
                [],
                color="#a63f00",
                linestyle="none",
                marker="+",
                markersize=4,
                label="flight sample",
            )
        )
    if known:
        handles.append(
            Patch(
                facecolor="none",
                edgecolor="black",
                hatch="////",
                linewidth=0.4,
                label=f"more than {_FAR:.0f} standard errors",
            )
        )
    return handles


def _notes(databases: Mapping[str, xr.DataTree], s: DifferenceSurface) -> list[str]:
    names = list(s.family.curves)
    sense = positive_sense(s.family.name.partition("/")[0])
    about = f"{s.family.name.partition('/')[0]} positive {sense}." if sense else ""
    return [
        *reference_notes({name: databases[name] for name in names}),
        *([about] if about else []),
        *(f"{n}: {databases[n].attrs['title']}." for n in names),
    ]
