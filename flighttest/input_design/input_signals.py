"""What all test inputs share: the Dataset they are, a quiet lead-in and repeats, and the numbers that judge them.

A test input is a Dataset over a uniform ``time`` that holds, per axis, the deflection to be *added* to trim.  It begins and ends
with a quiet stretch, so that every record holds some trimmed flight.
"""

from __future__ import annotations

from collections.abc import Mapping
from itertools import combinations
from typing import TYPE_CHECKING

import numpy as np
import xarray as xr

from flightmech.errors import SchemaError
from flightmech.names import attrs

from .phase_optimisation import relative_peak_factor

if TYPE_CHECKING:
    import pandas as pd

RATE = 50.0  # [Hz]
LEAD_IN = 1.0  # [s]
CHANNEL_SETS = {  # programmed test inputs of [DAS], Table 3
    "glide": ("delta_a", "delta_e", "delta_r"),
    "aeropropulsive": ("delta_a", "delta_e", "delta_r", "throttle"),
    "full": ("delta_a_left", "delta_a_right", "delta_f_left", "delta_f_right", "delta_e", "delta_r", "throttle"),
}


def assembled(
    active: Mapping[str, np.ndarray], rate: float, lead_in: float = LEAD_IN, repeats: int = 1, pause: float = 0.0, kind: str = ""
) -> xr.Dataset:
    """Return a test input from the moving stretch of each axis.

    Parameters
    ----------
    active : mapping of str to array (sample,)
        Axis to its deflections from trim, all of one length. [SI]
    rate : float
        Samples per second. [Hz]
    lead_in : float
        Quiet stretch before the first movement and after the last. [s]
    repeats : int
        How often the stretch is played.
    pause : float
        Quiet stretch between repeats; 0 joins periods without a seam. [s]
    kind : str
        Kept as an attribute.

    Returns
    -------
    Dataset (time,)
        One variable per axis; attributes ``kind rate lead_in repeats active_start active_stop`` [s], of the first stretch.
    """
    if repeats < 1 or lead_in < 0.0 or pause < 0.0:
        raise SchemaError(
            "test input", [f"repeats {repeats}, lead-in {lead_in:g} s, pause {pause:g} s; at least one stretch and no negative time"]
        )
    quiet, gap = np.zeros(round(lead_in * rate)), np.zeros(round(pause * rate))
    columns = {}
    for name, u in active.items():
        stretches = [part for k in range(repeats) for part in ((gap, u) if k else (u,))]
        columns[name] = "time", np.concatenate([quiet, *stretches, quiet, [0.0]]), attrs(name)
    length = len(next(iter(columns.values()))[1])
    start = len(quiet) / rate
    stop = start + len(next(iter(active.values()))) / rate
    about = {"kind": kind, "rate": rate, "lead_in": lead_in, "repeats": repeats, "active_start": start, "active_stop": stop}
    return xr.Dataset(columns, {"time": ("time", np.arange(length) / rate, attrs("time"))}, about)


def axes_of(signal: xr.Dataset) -> list[str]:
    """Return the names of the axes of a test input."""
    return [str(name) for name, item in signal.data_vars.items() if item.dims == ("time",)]


def active_part(signal: xr.Dataset) -> xr.Dataset:
    """Return the first moving stretch of a test input: one period of a multisine."""
    first, last = (round(signal.attrs[name] * signal.attrs["rate"]) for name in ("active_start", "active_stop"))
    return signal.isel(time=slice(first, last))


def measures(signal: xr.Dataset) -> pd.DataFrame:
    """Return the numbers that judge a test input, axis by axis, over its first moving stretch.

    Returns
    -------
    DataFrame
        Index ``axis``: ``peak rms`` [SI], ``peak_factor`` (`relative_peak_factor`), ``rate`` (largest, [SI per second]), ``low`` and
        ``high`` (band that holds 90 % of the power about the mean, [Hz]), ``correlation`` (largest with another axis), ``with``.
    """
    import pandas as pd

    part = active_part(signal)
    names, rate = axes_of(part), float(signal.attrs["rate"])
    columns = {name: part[name].values for name in names}
    related = {frozenset(pair): _correlation(columns[pair[0]], columns[pair[1]]) for pair in combinations(names, 2)}
    rows = {}
    for name, u in columns.items():
        others = {other: related[frozenset((name, other))] for other in names if other != name}
        nearest = max(others, key=lambda other: abs(others[other]), default="")
        low, high = _band(u, rate)
        rows[name] = {
            "peak": np.abs(u).max(),
            "rms": np.sqrt(np.mean(u**2)),
            "peak_factor": relative_peak_factor(u),
            "rate": np.abs(np.diff(signal[name].values)).max() * rate,
            "low": low,
            "high": high,
            "correlation": others.get(nearest, 0.0),
            "with": nearest,
        }
    return pd.DataFrame.from_dict(rows, orient="index").rename_axis("axis")


def correlations(signal: xr.Dataset) -> np.ndarray:
    """Return the correlation of the axes about zero over the first moving stretch, (axis, axis)."""
    part = active_part(signal)
    U = np.stack([part[name].values for name in axes_of(part)])
    U = U / np.linalg.norm(U, axis=1)[:, None]
    return U @ U.T


def _correlation(a: np.ndarray, b: np.ndarray) -> float:
    return float(a @ b / (np.linalg.norm(a) * np.linalg.norm(b)))


def _band(u: np.ndarray, rate: float) -> tuple[float, float]:
    """Frequencies below which 5 % and 95 % of the power about the mean lie."""
    power = np.abs(np.fft.rfft(u - u.mean(), 8 * len(u))) ** 2
    share = np.cumsum(power) / power.sum()
    frequency = np.fft.rfftfreq(8 * len(u), 1.0 / rate)
    return float(frequency[np.searchsorted(share, 0.05)]), float(frequency[np.searchsorted(share, 0.95)])
