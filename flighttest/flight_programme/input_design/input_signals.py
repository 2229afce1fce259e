"""Test inputs as datasets over time: assembly from moving parts, and numbers that judge them."""

from __future__ import annotations

from collections.abc import Mapping
from itertools import combinations

import numpy as np
import pandas as pd
import xarray as xr

from flightmech.errors import SchemaError
from flightmech.names import quantity_attributes
from flighttest.flight_programme.input_design.phases import relative_peak_factor

RATE = 50.0  # [Hz]
LEAD_IN = 1.0  # [s]
# Programmed test inputs of [DAS], Table 3
CHANNEL_SETS = {
    "glide": ("delta_a", "delta_e", "delta_r"),
    "aeropropulsive": ("delta_a", "delta_e", "delta_r", "throttle"),
    "full": (
        "delta_a_left",
        "delta_a_right",
        "delta_f_left",
        "delta_f_right",
        "delta_e",
        "delta_r",
        "throttle",
    ),
}
# Factor of the length by which a signal is padded with zeros, for a finer spectrum.
_PADDING = 8


def assemble_signal(
    active: Mapping[str, np.ndarray],
    rate: float,
    lead_in: float = LEAD_IN,
    repeats: int = 1,
    pause: float = 0.0,
    kind: str = "",
) -> xr.Dataset:
    """Return a test input from the moving part of each axis.

    Parameters
    ----------
    active : mapping of str to array (sample,)
        Axis to its deflections from trim, all of one length. [SI]
    rate : float
        Samples per second. [Hz]
    lead_in : float
        Quiet time before the first movement and after the last. [s]
    repeats : int
        Number of repetitions of the moving part.
    pause : float
        Quiet time between repeats; 0 joins periods without a seam. [s]
    kind : str
        Stored as an attribute.

    Returns
    -------
    Dataset (time,)
        One variable per axis; attributes ``kind rate lead_in repeats active_start active_stop``
        [s], of the first moving part.

    Raises
    ------
    SchemaError
        A time is negative, or there is no repeat.
    """
    if repeats < 1 or lead_in < 0.0 or pause < 0.0:
        problem = (
            f"repeats {repeats}, lead-in {lead_in:g} s, pause {pause:g} s; give at least one "
            "repeat and no negative time"
        )
        raise SchemaError("test input", [problem])
    columns = {}
    for name, u in active.items():
        values = _repeat_part(u, rate, lead_in, repeats=repeats, pause=pause)
        columns[name] = ("time", values, quantity_attributes(name))
    length = len(next(iter(columns.values()))[1])
    start = round(lead_in * rate) / rate
    attributes = {
        "kind": kind,
        "rate": rate,
        "lead_in": lead_in,
        "repeats": repeats,
        "active_start": start,
        "active_stop": start + len(next(iter(active.values()))) / rate,
    }
    time = ("time", np.arange(length) / rate, quantity_attributes("time"))
    return xr.Dataset(columns, {"time": time}, attributes)


def _repeat_part(
    u: np.ndarray, rate: float, lead_in: float, *, repeats: int, pause: float
) -> np.ndarray:
    """Return the repeated moving part of one axis, with the quiet time around it."""
    quiet, gap = np.zeros(round(lead_in * rate)), np.zeros(round(pause * rate))
    parts = [quiet, u]
    for _ in range(repeats - 1):
        parts += [gap, u]
    # one more sample of zero, so that the last command of the input is the trim
    return np.concatenate([*parts, quiet, [0.0]])


def axes_of(signal: xr.Dataset) -> list[str]:
    """Return the names of the axes of a test input."""
    return [str(name) for name, item in signal.data_vars.items() if item.dims == ("time",)]


def active_part(signal: xr.Dataset) -> xr.Dataset:
    """Return the first moving part of a test input: one period of a multisine."""
    rate = signal.attrs["rate"]
    first = round(signal.attrs["active_start"] * rate)
    last = round(signal.attrs["active_stop"] * rate)
    return signal.isel(time=slice(first, last))


def measures(signal: xr.Dataset) -> pd.DataFrame:
    """Return the numbers that judge a test input, by axis, over its first moving part.

    Returns
    -------
    DataFrame
        Index ``axis``: ``peak rms`` [SI], ``peak_factor`` (`relative_peak_factor`), ``rate``
        (largest, [SI per second]), ``low`` and ``high`` (band that contains 90 % of the power about
        the mean, [Hz]), ``correlation`` (largest with another axis), ``with`` (that axis).
    """
    part = active_part(signal)
    names, rate = axes_of(part), float(signal.attrs["rate"])
    columns = {name: part[name].values for name in names}
    # each pair once; the correlation does not depend on the order of its axes
    correlations = {}
    for first, second in combinations(names, 2):
        correlation = _correlate(columns[first], columns[second])
        correlations[first, second] = correlations[second, first] = correlation
    rows = {}
    for name, u in columns.items():
        others = {peer: correlations[name, peer] for peer in names if peer != name}
        nearest = max(others, key=lambda peer: abs(others[peer]), default="")
        low, high = _find_band(u, rate)
        rows[name] = {
            "peak": np.abs(u).max(),
            "rms": np.sqrt(np.mean(u**2)),
            "peak_factor": relative_peak_factor(u),
            # the edges of the moving part move too, so the rate is that of the whole signal
            "rate": np.abs(np.diff(signal[name].values)).max() * rate,
            "low": low,
            "high": high,
            "correlation": others.get(nearest, 0.0),
            "with": nearest,
        }
    return pd.DataFrame.from_dict(rows, orient="index").rename_axis("axis")


def axis_correlations(signal: xr.Dataset) -> np.ndarray:
    """Return the correlation of the axes about zero over the first moving part, (axis, axis)."""
    part = active_part(signal)
    U = np.stack([part[name].values for name in axes_of(part)])
    U = U / np.linalg.norm(U, axis=1)[:, None]
    return U @ U.T


def _correlate(a: np.ndarray, b: np.ndarray) -> float:
    return float(a @ b / (np.linalg.norm(a) * np.linalg.norm(b)))


def _find_band(u: np.ndarray, rate: float) -> tuple[float, float]:
    """Return the frequencies below which 5 % and 95 % of the power about the mean lie. [Hz]"""
    samples = _PADDING * len(u)
    power = np.abs(np.fft.rfft(u - u.mean(), samples)) ** 2
    share = np.cumsum(power) / power.sum()
    frequency = np.fft.rfftfreq(samples, 1.0 / rate)
    low, high = np.searchsorted(share, 0.05), np.searchsorted(share, 0.95)
    return float(frequency[low]), float(frequency[high])
