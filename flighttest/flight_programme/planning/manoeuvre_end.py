"""End of a manoeuvre: the time at which the standard errors have reached their bounds.

The estimates are those of `flighttest.in_flight`, on a record in place of a stream: their standard
errors follow the spectrum of the residual.
"""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np
import xarray as xr

from flightmech.errors import UnknownName
from flighttest.in_flight.following import BAND, SPACING, FlightFollower
from flighttest.regression.equation_error.model import RegressionModel


def running_estimate(
    model: RegressionModel,
    data: xr.Dataset,
    band: tuple[float, float] = BAND,
    spacing: float = SPACING,
) -> xr.Dataset:
    """Return the estimates of a model along a manoeuvre, one per second.

    Parameters
    ----------
    model : RegressionModel
    data : Dataset (time,)
        Coefficient and variables, as `flighttest.coefficients` returns them.
    band : (low, high)
        Band of the excitation; the first estimate comes after one period of its lower edge. [Hz]
    spacing : float
        Spacing of the frequencies. [Hz]

    Returns
    -------
    Dataset (time, term)
        ``estimate`` and ``stderr``, NaN while the samples do not determine them.

    Raises
    ------
    IdentificationError, UnknownName
        As `FlightFollower`.
    """
    follower = FlightFollower(model, band=band, spacing=spacing)
    channels = follower.choose_channels([str(name) for name in data.data_vars])
    values = np.column_stack([data[name].values for name in channels])
    estimates, stderrs = [], []
    times: list[float] = []
    for found in follower.add(data["time"].values.astype(float), values, final=True):
        if times and found.time == times[-1]:
            continue  # the end of the record is a whole second
        unknown = np.full(len(follower.always), np.nan)
        estimates.append(unknown if found.waiting else found.values)
        stderrs.append(unknown if found.waiting else found.stderr)
        times.append(found.time)
    shape = (len(times), len(follower.always))
    columns = {
        "estimate": (("time", "term"), np.reshape(estimates, shape)),
        "stderr": (("time", "term"), np.reshape(stderrs, shape)),
    }
    attributes = {"model": str(model), "band": f"{band[0]:g} ... {band[1]:g}", "spacing": spacing}
    return xr.Dataset(columns, {"time": times, "term": follower.always}, attributes)


def may_end(running: xr.Dataset, bounds: Mapping[str, float], settled: float = 2.0) -> float:
    """Return the time at which a manoeuvre may end.

    All standard errors have been below their bounds since `settled` seconds at that time.

    Parameters
    ----------
    running : Dataset (time, term)
        From `running_estimate`.
    bounds : mapping of str to float
        Largest standard error by term.
    settled : float
        Time below the bounds. [s]

    Returns
    -------
    float
        NaN if the standard errors do not stay below their bounds. [s]

    Raises
    ------
    UnknownName
        The model does not have a term of `bounds`.
    """
    terms = [str(term) for term in running["term"].values]
    for name in bounds:
        if name not in terms:
            raise UnknownName(name, terms, "term")
    time, below = running["time"].values, np.ones(running.sizes["time"], bool)
    for name, bound in bounds.items():
        below &= running["stderr"].sel(term=name).values <= bound
    since = np.nan
    for t, is_below in zip(time, below, strict=True):
        if not is_below:
            since = np.nan
            continue
        if np.isnan(since):
            since = t
        if t - since >= settled - 1e-9:
            return float(t)
    return float("nan")
