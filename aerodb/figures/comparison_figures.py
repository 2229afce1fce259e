"""Difference maps of two databases over two axes, absolute and in standard errors."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
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

_TOP, _HEIGHT, _BETWEEN, _AXIS = 0.95, 2.6, 0.62, 0.36  # [in]
_BOTTOM = 0.08  # between the panels and the foot [in]
_FAR = 2.0  # standard errors beyond which a difference is hatched
_CELLS = 60  # samples along an axis that can be distinguished
_SAMPLE_COLOUR = "#a63f00"


def plot_difference(
    databases: Mapping[str, xr.DataTree],
    name: str,
    family: str | None = None,
    *,
    over: str | None = None,
    at: Mapping[str, float] | None = None,
    support: Conditions | None = None,
) -> Figure:
    """Draw the difference of the last database from the first over two axes.

    A second map shows it in standard errors of the first database.

    Parameters
    ----------
    databases, name, over, at, support
        As in `plot_comparison`.  Flight samples are crosses, whatever their other conditions.
    family : str, optional
        The variable along the ordinate.

    Returns
    -------
    matplotlib Figure
        One map, or two if the first database states standard errors.  Lines of equal difference
        have labels, negative ones are dashed.  Beyond two standard errors the map is hatched.

    Raises
    ------
    UnknownName, SchemaError
        As in `plot_comparison`; also a term of one axis, or of one database.
    """
    surface = difference_surface(databases, name, family, over, at)
    f = surface.family
    first, last = f.curves
    notes = foot_lines(_foot_notes(databases, surface))
    has_stderr = bool((surface.stderr > 0).any())
    with drawing_style():
        sheet = FigureSheet(_TOP + _HEIGHT + _AXIS + _BOTTOM + foot_height(notes))
        title = term_title(name)
        sheet.figure.set_label(f"{title}: {last} less {first}")
        sheet.head(
            f"{databases[first].attrs['aircraft']}: {title}",
            [f"difference {last} less {first}, ${quantity_symbol(f)}${held_text(f)}"],
        )
        sheet.key(_legend_handles(has_stderr, support is not None), 0.5)
        # With standard errors two maps are next to each other.
        width = WIDTH - LEFT - RIGHT
        if has_stderr:
            width = (width - _BETWEEN) / 2
        axes = sheet.panel(LEFT, _TOP, width, _HEIGHT)
        difference_map = _DifferenceMap(surface, support)
        label = f"difference [{derivative_unit(f.regressors)}]"
        difference_map.draw(axes, surface.difference, label)
        if has_stderr:
            # NaN where the standard error is zero.
            ratio = np.full_like(surface.difference, np.nan)
            np.divide(surface.difference, surface.stderr, out=ratio, where=surface.stderr > 0)
            axes = sheet.panel(LEFT + width + _BETWEEN, _TOP, width, _HEIGHT)
            difference_map.draw(axes, ratio, f"difference in standard errors of {first}")
            difference_map.hatch(axes, ratio)
        sheet.foot(notes)
    return sheet.figure


@dataclass(frozen=True)
class _DifferenceMap:
    """Maps over the two axes of a surface, with the flight samples."""

    surface: DifferenceSurface
    support: Conditions | None

    def sides(self) -> tuple[np.ndarray, np.ndarray]:
        """Return the sides of the grid in display units."""
        f = self.surface.family
        return to_printed_unit(f.over, self.surface.x), to_printed_unit(f.by, self.surface.y)

    def draw(self, axes: Axes, values: np.ndarray, label: str) -> None:
        """Draw the values with lines, nodes and flight samples."""
        f, (x, y) = self.surface.family, self.sides()
        largest = 0.0
        if np.isfinite(values).any():
            largest = float(np.nanmax(np.abs(values)))
        if largest > 0.0:
            _draw_contours(axes, x, y, values=values, largest=largest, label=label)
        else:
            axes.text(0.5, 0.5, "no difference", transform=axes.transAxes, ha="center")
        axes.grid(False)
        # The nodes show where the tables state values.
        node_x, node_y = np.meshgrid(
            to_printed_unit(f.over, f.points[f.over]), to_printed_unit(f.by, f.points[f.by])
        )
        axes.plot(node_x.ravel(), node_y.ravel(), "k.", markersize=1.3, label="node")
        if self.support is not None and f.over in self.support and f.by in self.support:
            sample_x = to_printed_unit(f.over, np.ravel(np.asarray(self.support[f.over], float)))
            sample_y = to_printed_unit(f.by, np.ravel(np.asarray(self.support[f.by], float)))
            axes.plot(
                *_thin_samples(sample_x, sample_y),
                linestyle="none",
                marker="+",
                color=_SAMPLE_COLOUR,
                markersize=2.5,
                markeredgewidth=0.5,
                label="flight sample",
            )
        axes.set_xlim(x[0], x[-1])
        axes.set_ylim(y[0], y[-1])
        axes.set_title(label, fontsize=7.5, loc="left", pad=3)
        axes.set_xlabel(axis_label(f.over), labelpad=1)
        axes.set_ylabel(axis_label(f.by))

    def hatch(self, axes: Axes, ratio: np.ndarray) -> None:
        """Hatch the map where the difference is more than two standard errors."""
        # The second level is above the largest ratio, so that all of the range is hatched.
        worst = float(np.nanmax(np.abs(ratio)))
        if worst > _FAR:
            x, y = self.sides()
            levels = [_FAR, 2 * worst]
            axes.contourf(x, y, np.abs(ratio), levels, colors="none", hatches=["////"])


def _draw_contours(
    axes: Axes, x: np.ndarray, y: np.ndarray, *, values: np.ndarray, largest: float, label: str
) -> None:
    """Draw shades and labelled lines of equal values, dashed for negative values."""
    levels = np.asarray(MaxNLocator(10, symmetric=True).tick_values(-largest, largest))
    # The colour scale is wider than the values, so that the darkest shades are not used.
    scale = 1.3 * largest
    axes.contourf(x, y, values, levels, cmap="PuOr", alpha=0.55, vmin=-scale, vmax=scale)
    styles = np.where(levels < 0, "--", "-").tolist()
    lines = axes.contour(x, y, values, levels, colors="black", linewidths=0.6, linestyles=styles)
    lines.set_label(label)
    axes.clabel(lines, fontsize=6, fmt=number_text, inline_spacing=2)


def _thin_samples(x: np.ndarray, y: np.ndarray) -> np.ndarray:
    """Return the samples that can be distinguished in a map, (2, sample)."""
    samples = np.stack([x, y])[:, np.isfinite(x) & np.isfinite(y)]
    if not samples.size:
        return samples
    # One sample per cell of a grid, the first one.
    span = np.ptp(samples, axis=1, keepdims=True)
    cells = (samples / np.where(span > 0, span, 1.0) * _CELLS).round()
    _, first = np.unique(cells, axis=1, return_index=True)
    return samples[:, np.sort(first)]


def _legend_handles(has_stderr: bool, has_samples: bool) -> list[Any]:
    handles: list[Any] = [
        Line2D([], [], color="black", linewidth=0.6, label="positive"),
        Line2D([], [], color="black", linewidth=0.6, linestyle="--", label="negative"),
        _marker_handle("node of a table", "black", marker=".", size=2.5),
    ]
    if has_samples:
        handles.append(_marker_handle("flight sample", _SAMPLE_COLOUR, marker="+", size=4))
    if has_stderr:
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


def _marker_handle(label: str, color: str, marker: str, size: float) -> Line2D:
    return Line2D(
        [], [], color=color, linestyle="none", marker=marker, markersize=size, label=label
    )


def _foot_notes(databases: Mapping[str, xr.DataTree], surface: DifferenceSurface) -> list[str]:
    """Return references, sign and titles of the databases."""
    names = list(surface.family.curves)
    coefficient = surface.family.name.partition("/")[0]
    notes = reference_notes({name: databases[name] for name in names})
    sense = positive_sense(coefficient)
    if sense:
        notes.append(f"{coefficient} positive {sense}.")
    notes += [f"{name}: {databases[name].attrs['title']}." for name in names]
    return notes
