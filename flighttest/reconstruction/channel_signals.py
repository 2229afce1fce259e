"""Raw, corrected and reconstructed signals of the measured channels of a path."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from typing import TYPE_CHECKING, Any

import numpy as np
import xarray as xr

from flightmech.errors import UnknownName
from flightmech.names import quantity_attributes
from flightmech.support.figures import new_figure
from flighttest.reconstruction.problem.assembly import Setup
from flighttest.reconstruction.problem.output_equations import no_sideslip
from flighttest.reconstruction.problem.problem import PathProblem, Sensor
from flighttest.reconstruction.problem.readings import sensor_residuals
from flighttest.reconstruction.problem.trajectory import Solution
from flighttest.records.time_histories import break_at_gaps

if TYPE_CHECKING:
    from matplotlib.figure import Figure

VERSIONS = ("raw", "corrected", "reconstructed")
_RAW, _CORRECTED, _RECONSTRUCTED = range(3)  # columns of the versions
# Colour and line width of each version.
_STYLE = {"raw": ("0.6", 0.8), "corrected": ("tab:blue", 0.8), "reconstructed": ("tab:red", 1.1)}


def channel_signals(setup: Setup, solution: Solution) -> xr.Dataset:
    """Return raw, corrected and reconstructed signal of every measured channel.

    Returns
    -------
    Dataset (time, version)
        On the clock of the path, NaN where the channel has no reading. ``raw`` is at the sample
        next to its time stamp. ``corrected`` is next to the instant of its measurement. The
        attributes ``rms_raw`` and ``rms_corrected`` are the rms of each against the reconstructed
        signal.
    """
    signals: dict[str, Any] = {}
    for sensor in setup.problem.sensors:
        # zero sideslip is an assumption, not an instrument
        if sensor.model is not no_sideslip:
            signals |= _sensor_signals(setup.problem, sensor, solution)
    clock = ("time", setup.problem.time, quantity_attributes("time"))
    return xr.Dataset(signals, coords={"time": clock, "version": list(VERSIONS)})


def _sensor_signals(problem: PathProblem, sensor: Sensor, solution: Solution) -> dict[str, Any]:
    """Return the signals of the channels of one sensor."""
    constants, c = problem.constants, solution.c
    # residuals with and without the correction of the instrument, each at its instants
    residuals, k = sensor_residuals(problem, sensor, solution.x, c)
    ideal = _ideal_constants(problem, sensor, c)
    raw_residuals, k_raw = sensor_residuals(problem, sensor, solution.x, ideal)
    # readings of an ideal instrument at the instants of measurement
    latency = 0.0
    if sensor.delay:
        latency = constants.get(c, sensor.delay)
    undelayed = replace(sensor, time=sensor.time - latency)
    ideal_residuals, _ = sensor_residuals(problem, undelayed, solution.x, ideal)
    exact = sensor.z - ideal_residuals
    signals = {}
    for j, name in enumerate(sensor.names):
        factor = constants.get(c, f"factor.{name}", 1.0)
        columns = np.full((len(problem.time), len(VERSIONS)), np.nan)
        columns[k_raw, _RAW] = sensor.z[:, j]
        columns[k_raw, _RECONSTRUCTED] = sensor.z[:, j] - raw_residuals[:, j]
        columns[k, _CORRECTED] = exact[:, j] + residuals[:, j] / factor
        columns[k, _RECONSTRUCTED] = exact[:, j]
        rms = {
            "rms_raw": float(np.sqrt(np.mean(raw_residuals[:, j] ** 2))),
            "rms_corrected": float(np.sqrt(np.mean(residuals[:, j] ** 2))),
        }
        attributes = {**quantity_attributes(name), **rms}
        signals[name] = (("time", "version"), columns, attributes)
    return signals


def _ideal_constants(problem: PathProblem, sensor: Sensor, c: np.ndarray) -> np.ndarray:
    """Return the constants (nc,) without the errors of one sensor."""
    ideal = {"static_error": 0.0, sensor.delay: 0.0}
    for name in sensor.names:
        ideal[f"bias.{name}"] = 0.0
        ideal[f"factor.{name}"] = 1.0
    named_values = zip(problem.constants.names, c, strict=True)
    return np.array([ideal.get(name, value) for name, value in named_values])


def compatibility_figure(
    compatibility: xr.Dataset, title: str, channels: Sequence[str] | None = None
) -> Figure:
    """Draw raw, corrected and reconstructed signal of each channel ([Gresham] figure 5).

    Parameters
    ----------
    compatibility : Dataset (time, version)
        Signals of a path, see `channel_signals`.
    title : str
        Name of the record.
    channels : sequence of str, optional
        Channels to draw; all measured channels by default.

    Returns
    -------
    Figure

    Raises
    ------
    UnknownName
        A channel was not measured.
    AeromatchError
        matplotlib is not installed.
    """
    measured = list(map(str, compatibility.data_vars))
    names = measured
    if channels is not None:
        names = list(channels)
    for name in names:
        if name not in measured:
            raise UnknownName(name, measured, "measured channel")
    # two columns, rounded up
    rows = -(-len(names) // 2)
    figure = new_figure(11.0, 1.9 * rows + 0.8)
    axes = figure.subplots(rows, min(2, len(names)), sharex=True, squeeze=False)
    for ax, name in zip(axes.flat, names, strict=False):
        _draw_channel(ax, compatibility[name])
    for ax in axes.flat[len(names) :]:
        ax.set_visible(False)
    for ax in axes[-1]:
        ax.set_xlabel("time [s]")
    axes.flat[0].legend(loc="best", fontsize="small", frameon=False)
    figure.suptitle(f"Data compatibility: {title}", fontsize="medium")
    return figure


def _draw_channel(ax, signals: xr.DataArray) -> None:
    unit, factor = signals.attrs.get("units", ""), 1.0
    if unit == "rad":
        unit, factor = "deg", np.degrees(1.0)
    time = signals["time"].values
    for version, (colour, width) in _STYLE.items():
        values = signals.sel(version=version).values * factor
        ax.plot(*break_at_gaps(time, values), color=colour, linewidth=width, label=version)
    before = factor * signals.attrs["rms_raw"]
    after = factor * signals.attrs["rms_corrected"]
    ax.set_title(f"{signals.name}: rms {before:.3g} before, {after:.3g} after", fontsize="small")
    ax.set_ylabel(f"[{unit}]")
    ax.grid(linewidth=0.3)
