"""Figures of the time histories of a record or a path, with its manoeuvres."""

from __future__ import annotations

from collections.abc import Collection, Iterator, Mapping, Sequence
from itertools import chain, cycle, zip_longest
from textwrap import fill
from typing import TYPE_CHECKING

import numpy as np
import pandas as pd
import xarray as xr

from flightmech.errors import OutOfRange, UnknownName
from flightmech.quantities import time_text
from flightmech.support.figures import new_figure, to_display_quantity
from flighttest.records.record import channel_leaves
from flighttest.records.signals.resampling import GAP

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

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
"""Panels of the page without a choice of channels: motion left, controls and engines right."""
# A channel is not drawn if the record also has the quantity that it approximates.
_APPROXIMATES = {
    "alpha_vane": "alpha",
    "beta_vane": "beta",
    "ax_imu": "ax",
    "ay_imu": "ay",
    "az_imu": "az",
    "h_baro": "h",
    "h_gps": "h",
}
_SHADES = ("#2a6f97", "#bc6c25")
# Smallest span of an axis by its unit, so that the noise of a fixed control does not fill a panel.
_LEAST_SPAN = {"deg": 0.5, "1": 0.1, "%": 2.0}
# More panels than these are drawn in two columns.
_ONE_COLUMN = 5
# Width and height of a figure and of a panel. [in]
_WIDTHS = {1: 8.0, 2: 14.0}
_PANEL_HEIGHT, _MARGIN_HEIGHT = 1.5, 1.2
# Letters of the names of the manoeuvres in an inch.
_LETTERS = 14


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
        One panel each.  Without it the page has motion (`MOTION`), controls and engines
        (`CONTROLS`).
    marks : DataFrame, optional
        Manoeuvres, with the columns of `flighttest.records.marked_manoeuvres`.
    window : tuple of float (2,), optional
        Start and end of the time axis. [s]

    Raises
    ------
    UnknownName
        A channel that the record does not hold.
    OutOfRange
        A window without samples.
    AeromatchError
        matplotlib is not installed.
    """
    leaves = channel_leaves(record)
    panels = []
    for names in chosen_panels(leaves, channels):
        panels.append([record[leaves[name]].to_dataset()[name] for name in names])
    return signals_figure(str(record.attrs.get("title", "")), panels, marks, window=window)


def states_figure(
    states: xr.Dataset,
    channels: Sequence[str] | None = None,
    marks: pd.DataFrame | None = None,
    window: tuple[float, float] | None = None,
    errors: xr.Dataset | None = None,
) -> Figure:
    """Return states of a reconstructed path over time as a figure.

    Other parameters and errors are the same as in `record_figure`.

    Parameters
    ----------
    errors : Dataset (error, time), optional
        Change of the states for one standard error of each independent error.  The figure has a
        band of two standard errors.
    """
    available = [str(name) for name in states.data_vars]
    panels = []
    for names in chosen_panels(available, channels):
        panels.append([states[name] for name in names])
    # The errors are independent, so that their squares add up.
    stderr = {}
    if errors is not None:
        for name in errors.data_vars:
            stderr[str(name)] = (errors[name] ** 2).sum("error") ** 0.5
    title = str(states.attrs.get("record", ""))
    return signals_figure(title, panels, marks, stderr=stderr, window=window)


def chosen_panels(
    available: Collection[str], channels: Sequence[str] | None = None
) -> list[list[str]]:
    """Return the channels of every panel.

    Parameters
    ----------
    available : collection of str
        Channels of the record.
    channels : sequence of str, optional
        One panel each.  Without it the result is the page of the available channels.

    Raises
    ------
    UnknownName
        A channel is not available.
    """
    for name in channels or ():
        if name not in available:
            raise UnknownName(name, available, "channel", f"there are {', '.join(available)}")
    if channels:
        return [[name] for name in channels]
    motion, controls = _available_panels(MOTION, available), _available_panels(CONTROLS, available)
    if not motion or not controls:
        return motion or controls or [[name] for name in sorted(available)]
    # The panels are in the order of the rows of the page.
    panels: list[list[str]] = []
    rows: Iterator[tuple[list[str], list[str]]] = zip_longest(motion, controls, fillvalue=[])
    for row in rows:
        panels += row
    return panels


def _available_panels(
    column: Sequence[Sequence[str]], available: Collection[str]
) -> list[list[str]]:
    """Return the panels of a column that have channels."""
    panels = []
    for names in column:
        panel = []
        for name in names:
            if name in available and _APPROXIMATES.get(name) not in available:
                panel.append(name)
        if panel:
            panels.append(panel)
    return panels


def signals_figure(
    title: str,
    panels: Sequence[Sequence[xr.DataArray]],
    marks: pd.DataFrame | None = None,
    stderr: Mapping[str, xr.DataArray] | None = None,
    window: tuple[float, float] | None = None,
) -> Figure:
    """Return signals over their times as a figure, with shaded and named manoeuvres.

    Parameters
    ----------
    title : str
    panels : sequence of sequences of DataArray (time,)
        In SI.  They are drawn in the display unit of their name.  An empty panel stays blank.
    marks : DataFrame, optional
        ``manoeuvre control start end``. [s]
    stderr : mapping of str to DataArray (time,), optional
        Standard error of a signal by its name.  The figure has a band of two standard errors.
    window : tuple of float (2,), optional
        Start and end of the time axis. [s]

    Raises
    ------
    OutOfRange
        A window without samples.
    AeromatchError
        matplotlib is not installed.
    """
    inside = []
    for panel in panels:
        inside.append([_select_window(signal, window) for signal in panel])
    signals = chain.from_iterable(inside)
    if window is not None and not any(signal.size for signal in signals):
        start, end = _time_span(panels)
        raise OutOfRange(
            f"no sample between {time_text(window[0])} and {time_text(window[1])} s; the signals "
            "go from "
            f"{time_text(start)} to {time_text(end)} s"
        )
    limits = window or _time_span(panels)
    columns = 2 if len(panels) > _ONE_COLUMN or not all(panels) else 1
    rows = -(-len(panels) // columns)
    figure = new_figure(_WIDTHS[columns], _PANEL_HEIGHT * rows + _MARGIN_HEIGHT)
    axes = figure.subplots(rows, columns, sharex=True, squeeze=False)
    for number, ax in enumerate(axes.flat):
        if number < len(inside) and inside[number]:
            _draw_panel(ax, inside[number], stderr or {})
        else:
            ax.set_axis_off()
    if marks is not None:
        _draw_marks(figure, axes, marks, limits)
    axes.flat[0].set_xlim(*limits)
    for column in range(columns):
        # The lowest panel of a column may be above the last row.
        lowest = [ax for ax in axes[:, column] if ax.axison][-1]
        lowest.set_xlabel("time [s]")
        lowest.tick_params(labelbottom=True)
    figure.suptitle(title, fontsize="medium")
    return figure


def break_at_gaps(time: np.ndarray, values: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Return the finite samples, with a NaN in each step longer than `GAP` median steps.

    A line through the result does not cross a gap.
    """
    is_finite = np.isfinite(values)
    time, values = time[is_finite], values[is_finite]
    steps = np.diff(time)
    if not len(steps):
        return time, values
    ends = np.flatnonzero(steps > GAP * np.median(steps)) + 1
    return np.insert(time, ends, np.nan), np.insert(values, ends, np.nan)


def _select_window(signal: xr.DataArray, window: tuple[float, float] | None) -> xr.DataArray:
    if window is None:
        return signal
    time = signal["time"].values
    return signal[(time >= window[0]) & (time <= window[1])]


def _time_span(panels: Sequence[Sequence[xr.DataArray]]) -> tuple[float, float]:
    """Return first and last time of all signals. [s]"""
    signals = chain.from_iterable(panels)
    times = [signal["time"].values for signal in signals if signal.size]
    return min(float(time[0]) for time in times), max(float(time[-1]) for time in times)


def _draw_panel(
    ax: Axes, panel: Sequence[xr.DataArray], stderr: Mapping[str, xr.DataArray]
) -> None:
    names = list(dict.fromkeys(str(signal.name) for signal in panel))
    for signal, colour in zip(panel, cycle(COLOURS), strict=False):
        name, time = str(signal.name), signal["time"].values
        values, unit = to_display_quantity(name, np.asarray(signal.values, float))
        label = name if len(names) == 1 else f"{name} [{unit}]"
        ax.plot(*break_at_gaps(time, values), color=colour, linewidth=0.8, label=label)
        if name in stderr:
            # Band of two standard errors.
            half_width = 2.0 * stderr[name].sel(time=time).values
            below = to_display_quantity(name, signal.values - half_width)[0]
            above = to_display_quantity(name, signal.values + half_width)[0]
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
    # A channel that hardly moves would show its noise over the whole panel.
    low, high = ax.get_ylim()
    least = _LEAST_SPAN.get(unit, 0.0)
    if high - low < least:
        ax.set_ylim((low + high - least) / 2.0, (low + high + least) / 2.0)
    ax.grid(linewidth=0.3)


def _draw_marks(
    figure: Figure, axes: np.ndarray, marks: pd.DataFrame, span: tuple[float, float]
) -> None:
    """Shade and number the manoeuvres inside a span of time, and name them below the figure."""
    labels: list[str] = []
    for row in marks.to_dict("records"):
        start, end = float(row["start"]), float(row["end"])
        # A manoeuvre without a time is not drawn.
        if not (end > span[0] and start < span[1]):
            continue
        number = len(labels) + 1
        name = f"{row['manoeuvre']} {row['control']}".strip()
        # A label is not broken between its number and its words.
        labels.append(f"{number} {name}".replace(" ", "\N{NO-BREAK SPACE}"))
        for ax in axes.flat:
            if ax.axison:
                ax.axvspan(start, end, color=_SHADES[number % 2], alpha=0.12, linewidth=0)
        for ax in axes[0]:
            ax.annotate(
                f" {number}",
                (max(start, span[0]), 0.98),
                xycoords=("data", "axes fraction"),
                va="top",
                fontsize=7,
            )
    width = int(_LETTERS * figure.get_figwidth())
    text = fill("   ".join(labels), width, break_on_hyphens=False)
    figure.supxlabel(text, fontsize="x-small")
