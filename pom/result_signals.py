"""Signals of a result: their figure and their form in a JSON document."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING, Any

import numpy as np
import xarray as xr

from flightmech.errors import UnknownName
from flightmech.support.figures import new_figure, to_display_quantity

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

_COLOURS = ("tab:red", "tab:blue", "tab:green", "tab:orange", "tab:purple")

# Exponents of ten that scale a sample to nine digits
_SMALLEST_EXPONENT, _LARGEST_EXPONENT = -300, 22


def result_figure(
    title: str, signals: xr.Dataset, tolerance: xr.Dataset, channels: Sequence[str]
) -> Figure:
    """Return the figure of the flight, its tolerance bands and the models.

    Parameters
    ----------
    title : str
    signals : Dataset (run, time)
        Signals of a result; run ``flight`` first. [SI]
    tolerance : Dataset (time)
        Half width of the bands. [SI]
    channels : sequence of str
        Channels to draw, from the top.

    Raises
    ------
    UnknownName
        The result has no such channel.
    AeromatchError
        matplotlib is not installed.
    """
    for name in channels:
        if name not in signals:
            raise UnknownName(name, map(str, signals.data_vars), "channel of the result")
    figure = new_figure(9.0, 1.9 * len(channels) + 0.8)
    axes = figure.subplots(len(channels), 1, sharex=True, squeeze=False)[:, 0]
    for ax, name in zip(axes, channels, strict=True):
        _draw_channel(ax, name, signals, tolerance)
    axes[0].legend(frameon=False, fontsize="small", ncols=4)
    axes[0].set_title(title, fontsize="medium")
    axes[-1].set_xlabel("time [s]")
    return figure


def _draw_channel(ax: Axes, name: str, signals: xr.Dataset, tolerance: xr.Dataset) -> None:
    """Draw one channel: its band below, then the flight, then the models."""
    time = signals["time"].values
    reference = signals[name].sel(run="flight").values
    flight, unit = to_display_quantity(name, reference)
    if name in tolerance:
        # The limits are converted after the sum, since units such as degC have an offset.
        low, _ = to_display_quantity(name, reference - tolerance[name].values)
        high, _ = to_display_quantity(name, reference + tolerance[name].values)
        ax.fill_between(
            time,
            low,
            high,
            where=np.isfinite(low),
            color="0.85",
            linewidth=0,
            label="tolerance",
        )
    ax.plot(time, flight, color="black", linewidth=1.2, label="flight")
    models = [str(run) for run in signals["run"].values if run != "flight"]
    for number, run in enumerate(models):
        model, _ = to_display_quantity(name, signals[name].sel(run=run).values)
        ax.plot(time, model, color=_COLOURS[number % len(_COLOURS)], linewidth=1.0, label=run)
    ax.set_ylabel(f"{name} [{unit}]")
    ax.grid(linewidth=0.3)


def dataset_to_dict(data: xr.Dataset) -> dict[str, Any]:
    """Return a dataset as plain data, samples to nine significant digits."""
    variables = {}
    for name, item in data.data_vars.items():
        variables[str(name)] = {
            "dims": list(map(str, item.dims)),
            "attrs": dict(item.attrs),
            "values": _round_samples(item.values).tolist(),
        }
    return {
        "coords": {str(name): data[name].values.tolist() for name in data.coords},
        "variables": variables,
        "attrs": dict(data.attrs),
    }


def dataset_from_dict(item: dict[str, Any]) -> xr.Dataset:
    """Rebuild a dataset from `dataset_to_dict`."""
    variables = {}
    for name, content in item["variables"].items():
        variables[name] = (content["dims"], np.array(content["values"], float), content["attrs"])
    return xr.Dataset(variables, coords=item["coords"], attrs=item["attrs"])


def _round_samples(values: np.ndarray) -> np.ndarray:
    """Return samples to nine significant digits.

    Nine digits are finer than any sensor and need half the characters of a full double.
    """
    # zero and NaN have no finite logarithm; they are scaled by one
    with np.errstate(divide="ignore", invalid="ignore"):
        digits = 8 - np.floor(np.log10(np.abs(values)))
    limited = np.clip(digits, _SMALLEST_EXPONENT, _LARGEST_EXPONENT)
    scale = 10.0 ** np.where(np.isfinite(digits), limited, 0.0)
    # A double holds the powers of ten from 1 to 10^22 exactly. Below 10^9 the quotient is therefore
    # the double nearest to the decimal.
    return np.rint(values * scale) / scale
