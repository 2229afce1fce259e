"""Remark on spikes: single samples that decide a fit."""

from __future__ import annotations

from collections.abc import Collection

import numpy as np

from flightmech.quantities import time_text
from flighttest.regression.equation_error.fit_data import FitData
from flighttest.remarks import Remark

# robust standard deviations of a departure from its neighbours: never by chance in 10^6 Gaussian
# samples
SPIKE = 8.0
OUTSIDE = 5.0  # robust standard deviations of the residual of a spike
SMOOTH = 0.1  # least scatter about the neighbours, of that of the residual
NEIGHBOURS = 4  # samples on each side that determine the expected sample; spikes are shorter
_TO_SIGMA = 1.4826  # standard deviation of Gaussian noise over its median absolute deviation
TINY = np.finfo(float).tiny  # keeps divisions by a zero scatter finite
_ROUNDING = 1e-9  # residual, of the largest coefficient, that may be rounding


def remark_spikes(fit: FitData) -> list[Remark]:
    """Return the largest residual that its neighbours do not share, and the fit without it."""
    a = fit.estimates.attrs
    if a.get("weights") == "robust" or fit.data.sizes.get("sample", 0) <= 2 * NEIGHBOURS + 1:
        return []
    v = fit.residual
    departure = v - _running_median(v)
    # A smooth residual is equal to its running median almost everywhere: its scatter is not used.
    scatter = max(_robust_deviation(departure), SMOOTH * _robust_deviation(v), TINY)
    sizes = np.abs(departure) / scatter
    distance = np.abs(v - np.median(v)) / max(_robust_deviation(v), TINY)
    least = _ROUNDING * np.abs(fit.data[fit.model.coefficient].values).max()
    spikes = np.flatnonzero((sizes > SPIKE) & (distance > OUTSIDE) & (np.abs(v) > least))
    if not len(spikes):
        return []
    worst = int(spikes[np.argmax(np.abs(departure[spikes]))])
    where = f"{time_text(float(fit.data['time'].values[worst]))} s"
    if a["manoeuvres"] != 1:
        where += f" of manoeuvre {int(fit.data['manoeuvre'].values[worst])}"
    count = f" ({len(spikes)} samples stand out)" if len(spikes) > 1 else ""
    text = (
        f"spike of {departure[worst]:.3g} in {fit.model.coefficient} at {where}, "
        f"{sizes[worst]:.0f} times the scatter of the residual{count}"
        f"{_describe_without(fit, spikes)}; take it out of the record, or use weights='robust'"
    )
    return [Remark("spike", text, "", float(sizes[worst]), SPIKE)]


def _running_median(v: np.ndarray) -> np.ndarray:
    """Return the median of each sample and its neighbours; the ends are reflected."""
    padded = np.pad(v, NEIGHBOURS, mode="reflect")
    windows = np.lib.stride_tricks.sliding_window_view(padded, 2 * NEIGHBOURS + 1)
    return np.median(windows, axis=1)


def _describe_without(fit: FitData, spikes: Collection[int]) -> str:
    """Return the largest change of an estimate without the spikes; empty for a weighted fit."""
    e, a = fit.estimates, fit.estimates.attrs
    if a["domain"] != "time" or a["weights"] != "equal" or a["ridge"]:
        return ""
    if "method" in a or "constraints" in a:
        return ""
    # Least squares again without the spikes, in standard errors of the fit.
    rows = np.setdiff1d(np.arange(fit.data.sizes["sample"]), list(spikes))
    z = fit.data[fit.model.coefficient].values
    theta = np.linalg.lstsq(fit.regressors.values[rows], z[rows], rcond=None)[0]
    estimates = e["estimate"].values
    change = np.abs(theta - estimates) / np.maximum(e["stderr"].values, TINY)
    k = int(np.argmax(change))
    return f"; without it {e['term'].values[k]} is {theta[k]:.4g} and not {float(estimates[k]):.4g}"


def _robust_deviation(x: np.ndarray) -> float:
    return float(_TO_SIGMA * np.median(np.abs(x - np.median(x))))
