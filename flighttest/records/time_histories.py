"""Time histories of a record or a path as a figure, with the manoeuvres marked."""

from __future__ import annotations

from collections.abc import Collection, Iterator, Mapping, Sequence
from itertools import cycle, zip_longest
from textwrap import fill
from typing import TYPE_CHECKING

import numpy as np
import pandas as pd
import xarray as xr

from flightmech.errors import OutOfRange, UnknownName
from flightmech.support.figures import new_figure, to_display_quantity
from flighttest.records.record import channel_leaves as channels_of

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

GAP = 3.0  # median steps between samples that end a line
COLOURS = ("tab:blue", "tab:red", "tab:green", "tab:orange", "tab:purple", "tab:brown")
MOTION = (
    ("V", "V_cas"),
    ("h", "h_baro", "h_gps"),
    ("alpha", "beta", "alpha_vane", "beta_vane"),
    ("phi", "theta"),
    ("psi",),
    ("p", "q", "r"),
    ("ax", "ay", "az", "ax_imu", "ay_imu", "az_imu"),
)
CONTROLS = (
    ("delta_e", "delta_t"),
    ("delta_a",),
    ("delta_r",),
    ("delta_f",),
    ("gear", "speedbrake"),
    ("engine1.throttle", "engine2.throttle", "engine1.n1", "engine2.n1"),
    ("engine1.thrust", "engine2.thrust"),
)
"""Panels of the page without a choice of channels: motion on the left, controls and engines on the right."""
_STANDS_FOR = {
    "alpha_vane": "alpha",
    "beta_vane": "beta",
    "ax_imu": "ax",
    "ay_imu": "ay",
    "az_imu": "az",
    "h_baro": "h",
    "h_gps": "h",
}
_SHADES = ("#2a6f97", "#bc6c25")
_LEAST = {"deg": 0.5, "1": 0.1, "%": 2.0}  # span of an axis by its unit
_ONE_COLUMN = 5  # panels
_LETTERS = 14  # of the names of the manoeuvres in an inch


def record_figure(
    record: xr.DataTree,
    channels: Sequence[str] | None = None,
    marks: pd.DataFrame | None = None,
    window: tuple[float, float] | None = None,
) -> Figure:
    """Return channels of a flight record over time as a figure.

    Parameters
    ----------
    record : DataTree
    channels : sequence of str, optional
        One panel each; without it a page of motion (`MOTION`), controls and engines (`CONTROLS`).
    marks : DataFrame, optional
        Manoeuvres, with the columns of `flighttest.manoeuvres`.
    window : tuple of float (2,), optional
        Start and end of what is drawn. [s]

    Raises
    ------
    UnknownName
        A channel that the record does not hold.
    OutOfRange
        A window without samples.
    AeromatchError
        matplotlib is not installed.
    """
    leaves = channels_of(record)
    panels = [
        [record[leaves[name]].to_dataset()[name] for name in panel]
        for panel in chosen_panels(leaves, channels)
    ]
    return signals_figure(str(record.attrs.get("title", "")), panels, marks, window=window)


def states_figure(
    states: xr.Dataset,
    channels: Sequence[str] | None = None,
    marks: pd.DataFrame | None = None,
    window: tuple[float, float] | None = None,
    errors: xr.Dataset | None = None,
) -> Figure:
    """Return states of a reconstructed path over time as a figure; parameters and errors as for
    `record_figure`.

    Parameters
    ----------
    errors : Dataset (error, time), optional
        Change of the states for one standard error of each independent error: a band of two
        standard errors is drawn.
    """
    panels = [
        [states[name] for name in panel]
        for panel in chosen_panels(list(map(str, states.data_vars)), channels)
    ]
    found = (
        {}
        if errors is None
        else {str(name): (errors[name] ** 2).sum("error") ** 0.5 for name in errors.data_vars}
    )
    return signals_figure(str(states.attrs.get("record", "")), panels, marks, found, window)


def chosen_panels(
    available: Collection[str], channels: Sequence[str] | None = None
) -> list[list[str]]:
    """Return the channels of every panel: one panel for each of `channels`, or the page of those
    that are there.

    Raises
    ------
    UnknownName
        A channel that is not there.
    """
    for name in channels or ():
        if name not in available:
            raise UnknownName(name, available, "channel", f"there are {', '.join(available)}")
    if channels:
        return [[name] for name in channels]
    left, right = (_present(column, available) for column in (MOTION, CONTROLS))
    if not left or not right:
        return left or right or [[name] for name in sorted(available)]
    rows: Iterator[tuple[list[str], list[str]]] = zip_longest(left, right, fillvalue=[])
    return [panel for row in rows for panel in row]


def _present(column: Sequence[Sequence[str]], available: Collection[str]) -> list[list[str]]:
    """Return the panels of a column that have channels; one that stands for another is left out
    when that is there.
    """
    panels = [
        [name for name in panel if name in available and _STANDS_FOR.get(name) not in available]
        for panel in column
    ]
    return [panel for panel in panels if panel]


def signals_figure(
    title: str,
    panels: Sequence[Sequence[xr.DataArray]],
    marks: pd.DataFrame | None = None,
    stderr: Mapping[str, xr.DataArray] | None = None,
    window: tuple[float, float] | None = None,
) -> Figure:
    """Return signals over their times, several in a panel, manoeuvres shaded and named.

    Parameters
    ----------
    title : str
    panels : sequence of sequences of DataArray (time,)
        In SI units; they are drawn in the display unit of their name.  The place of an empty one
        stays free.
    marks : DataFrame, optional
        ``manoeuvre control start end``. [s]
    stderr : mapping of str to DataArray (time,), optional
        Standard error of a signal, by its name: a band of two.
    window : tuple of float (2,), optional
        Start and end of what is drawn. [s]

    Raises
    ------
    OutOfRange
        A window without samples.
    AeromatchError
        matplotlib is not installed.
    """
    inside = [[_inside(signal, window) for signal in panel] for panel in panels]
    if window is not None and not any(signal.size for panel in inside for signal in panel):
        start, end = _span(panels)
        raise OutOfRange(
            f"no sample between {window[0]:g} and {window[1]:g} s; the signals go from "
            f"{start:g} to {end:g} s"
        )
    columns = 2 if len(panels) > _ONE_COLUMN or not all(panels) else 1
    rows = -(-len(panels) // columns)
    figure = new_figure(8.0 if columns == 1 else 14.0, 1.5 * rows + 1.2)
    axes = figure.subplots(rows, columns, sharex=True, squeeze=False)
    for number, ax in enumerate(axes.flat):
        if number < len(inside) and inside[number]:
            _draw_panel(ax, inside[number], stderr or {})
        else:
            ax.set_axis_off()
    if marks is not None:
        _draw_marks(figure, axes, marks, window or _span(panels))
    axes.flat[0].set_xlim(*(window or _span(panels)))
    for column in range(columns):
        last = [ax for ax in axes[:, column] if ax.axison][-1]
        last.set_xlabel("time [s]")
        last.tick_params(labelbottom=True)
    figure.suptitle(title, fontsize="medium")
    return figure


def break_at_gaps(time: np.ndarray, values: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Return the finite samples with a NaN wherever more than `GAP` steps lie between two, so that
    no line crosses a gap.
    """
    there = np.isfinite(values)
    time, values = time[there], values[there]
    steps = np.diff(time)
    ends = np.flatnonzero(steps > GAP * np.median(steps)) + 1 if len(steps) else np.zeros(0, int)
    return np.insert(time, ends, np.nan), np.insert(values, ends, np.nan)


def _inside(signal: xr.DataArray, window: tuple[float, float] | None) -> xr.DataArray:
    if window is None:
        return signal
    time = signal["time"].values
    return signal[(time >= window[0]) & (time <= window[1])]


def _span(panels: Sequence[Sequence[xr.DataArray]]) -> tuple[float, float]:
    times = [signal["time"].values for panel in panels for signal in panel if signal.size]
    return min(float(time[0]) for time in times), max(float(time[-1]) for time in times)


def _draw_panel(
    ax: Axes, panel: Sequence[xr.DataArray], stderr: Mapping[str, xr.DataArray]
) -> None:
    names = list(dict.fromkeys(str(signal.name) for signal in panel))
    for signal, colour in zip(panel, cycle(COLOURS), strict=False):
        name, time = str(signal.name), signal["time"].values
        values, unit = to_display_quantity(name, np.asarray(signal.values, float))
        ax.plot(
            *break_at_gaps(time, values),
            color=colour,
            linewidth=0.8,
            label=name if len(names) == 1 else f"{name} [{unit}]",
        )
        if name in stderr:
            half = 2.0 * stderr[name].sel(time=time).values
            below, above = (
                to_display_quantity(name, signal.values + sign * half)[0] for sign in (-1.0, 1.0)
            )
            ax.fill_between(time, below, above, color=colour, alpha=0.25, linewidth=0)
    if len(names) == 1:
        ax.set_ylabel(f"{names[0]}\n[{unit}]", fontsize="small")
    else:
        ax.legend(
            loc="lower left",
            bbox_to_anchor=(0.0, 1.0),
            borderaxespad=0.2,
            fontsize="xx-small",
            ncols=len(panel),
            frameon=False,
        )
    low, high = ax.get_ylim()
    if high - low < (
        least := _LEAST.get(unit, 0.0)
    ):  # a control at rest does not fill its panel with noise
        ax.set_ylim((low + high - least) / 2.0, (low + high + least) / 2.0)
    ax.grid(linewidth=0.3)


def _draw_marks(
    figure: Figure, axes: np.ndarray, marks: pd.DataFrame, span: tuple[float, float]
) -> None:
    """Shade the manoeuvres in all panels, number them in the first row and name them below the
    figure.
    """
    rows = [
        (float(row["start"]), float(row["end"]), f"{row['manoeuvre']} {row['control']}".strip())
        for row in marks.to_dict("records")
    ]
    shown = [row for row in rows if row[1] > span[0] and row[0] < span[1]]
    for number, (start, end, _) in enumerate(shown, start=1):
        for ax in (ax for ax in axes.flat if ax.axison):
            ax.axvspan(start, end, color=_SHADES[number % 2], alpha=0.12, linewidth=0)
        for ax in axes[0]:
            ax.annotate(
                f" {number}",
                (max(start, span[0]), 0.98),
                xycoords=("data", "axes fraction"),
                va="top",
                fontsize=7,
            )
    named = [f"{number} {name}" for number, (_, _, name) in enumerate(shown, start=1)]
    text = "   ".join(name.replace(" ", "\N{NO-BREAK SPACE}") for name in named)
    width = int(_LETTERS * figure.get_figwidth())
    figure.supxlabel(fill(text, width, break_on_hyphens=False), fontsize="x-small")
