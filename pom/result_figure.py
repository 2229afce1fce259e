"""A replay drawn: flight, tolerance bands and models over time, a panel for each channel."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING

import numpy as np
import xarray as xr

from flightmech.errors import UnknownName
from flightmech.support.display import displayed, new_figure

if TYPE_CHECKING:
    from matplotlib.figure import Figure

_COLOURS = ("tab:red", "tab:blue", "tab:green", "tab:orange", "tab:purple")


def result_figure(title: str, signals: xr.Dataset, tolerance: xr.Dataset, channels: Sequence[str]) -> Figure:
    """Return the figure.

    Parameters
    ----------
    title : str
    signals : Dataset (run, time)
        Of a result; run ``flight`` first. [SI]
    tolerance : Dataset (time)
        Half width of the bands. [SI]
    channels : sequence of str
        What to draw, from the top.

    Raises
    ------
    UnknownName
        A channel that is not among the signals.
    AeromatchError
        matplotlib is not installed.
    """
    for name in channels:
        if name not in signals:
            raise UnknownName(name, map(str, signals.data_vars), "channel of the result")
    figure = new_figure(9.0, 1.9 * len(channels) + 0.8)
    axes = figure.subplots(len(channels), 1, sharex=True, squeeze=False)[:, 0]
    time = signals["time"].values
    for ax, name in zip(axes, channels, strict=True):
        flight, unit = displayed(name, signals[name].sel(run="flight").values)
        if name in tolerance:
            low, high = (displayed(name, signals[name].sel(run="flight").values + sign * tolerance[name].values)[0] for sign in (-1, 1))
            ax.fill_between(time, low, high, where=np.isfinite(low), color="0.85", linewidth=0, label="tolerance")
        ax.plot(time, flight, color="black", linewidth=1.2, label="flight")
        models = [str(run) for run in signals["run"].values if run != "flight"]
        for number, run in enumerate(models):
            model, _ = displayed(name, signals[name].sel(run=run).values)
            ax.plot(time, model, color=_COLOURS[number % len(_COLOURS)], linewidth=1.0, label=run)
        ax.set_ylabel(f"{name} [{unit}]")
        ax.grid(linewidth=0.3)
    axes[0].legend(frameon=False, fontsize="small", ncols=4)
    axes[0].set_title(title, fontsize="medium")
    axes[-1].set_xlabel("time [s]")
    return figure
