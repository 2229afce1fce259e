"""Test of innovations for whiteness.

A filter with the right model of the disturbance leaves nothing to predict: its innovations are
white. Coloured innovations mean that the gain is not the best one, so that the slopes of the
innovations, which contain past readings, are correlated with them: the estimates are biased, and
no covariance repairs that.

References
----------
.. [Ljung1978] Ljung, Box, On a measure of lack of fit in time series models, Biometrika 65, 1978.
.. [Mehra1970] Mehra, On the identification of variances and adaptive Kalman filtering, IEEE Trans.
   Automatic Control 15, 1970.
"""

from __future__ import annotations

from collections.abc import Sequence
from itertools import pairwise

import numpy as np
import xarray as xr

from flighttest.regression.uncertainty.significance import residual_whiteness
from flighttest.remarks import Remark

CHANCE = 0.01  # probability that white innovations of any output are called coloured
# autocorrelation from which the gain of a filter is wrong: those of a wrong kind of disturbance
# were 0.8 and more, with 44 % of the estimates within two standard errors
STRONG = 0.3
_ADVICE = (
    "the model of the disturbance is wrong, and estimates and standard errors with it: free the "
    "process noise of the states, or give gusts whose scale is that of the air"
)
# correlation of neighbouring second differences of readings from which they show no white noise:
# white noise gives -2/3, readings after a low-pass of 1 Hz gave 0.6 at 5 Hz and 0.93 at 12.5 Hz
SMOOTH = 0.5
_SMOOTHED = (
    "its readings show no noise from sample to sample (second differences correlated by {:.2f}, "
    "those of white noise by -0.67): the recorder filtered or interpolated them, or their noise is "
    "far below the motion between samples, and a filter with white noises does not fit them; take "
    "the channel before that filter or fewer samples per second, or use output error, whose "
    "standard errors hold for coloured residuals"
)
_TWO_SIDED = 1.96  # standard errors that 95 % of normal values do not exceed


def whiteness_variables(
    parts: Sequence[np.ndarray], steps: Sequence[float], measured: Sequence[np.ndarray] = ()
) -> xr.Dataset:
    """Return the test of the innovations of each output.

    Parameters
    ----------
    parts : sequence of array (time, output)
        Innovations of each manoeuvre.
    steps : sequence of float
        Sampling interval of each manoeuvre. [s]
    measured : sequence of array (time, output), optional
        Readings of each manoeuvre, NaN for a missing one.

    Returns
    -------
    Dataset (output)
        ``portmanteau``, ``portmanteau_lags`` and ``portmanteau_probability`` as from
        `residual_whiteness` [Ljung1978]_; ``correlation`` (output, lag), the autocorrelations from
        lag 1 on, and ``outside``, the share of them beyond ``band``, the 95 % band
        1.96 / sqrt(N) of Bartlett [Mehra1970]_. With readings also ``smoothness``, the correlation
        of their neighbouring second differences: -2/3 for white noise.
    """
    edges = np.cumsum([0, *map(len, parts)])
    pieces = [slice(int(start), int(stop)) for start, stop in pairwise(edges)]
    columns: dict[str, list[float]] = {}
    for v in np.concatenate(parts).T:
        for name, value in residual_whiteness(v, pieces, steps).items():
            columns.setdefault(name, []).append(value)
    lags = int(columns["portmanteau_lags"][0])
    r = _autocorrelations(parts, lags)
    band = _TWO_SIDED / np.sqrt(edges[-1])
    variables = {name: ("output", values) for name, values in columns.items()}
    variables.pop("correlation_time")
    if len(measured):
        variables["smoothness"] = "output", _smoothness(measured).tolist()
    return xr.Dataset(
        {
            **variables,
            "correlation": (("output", "lag"), r),
            "outside": ("output", (np.abs(r) > band).mean(axis=1)),
            "band": float(band),
        },
        {"lag": np.arange(1, lags + 1)},
    )


def _autocorrelations(parts: Sequence[np.ndarray], lags: int) -> np.ndarray:
    """Return the autocorrelations (output, lag) of all manoeuvres together, from lag 1 on."""
    products, power = np.zeros((parts[0].shape[1], lags)), 0.0
    for part in parts:
        e = part - part.mean(axis=0)
        power = power + (e**2).sum(axis=0)
        for lag in range(1, min(lags, len(e) - 1) + 1):
            products[:, lag - 1] += (e[lag:] * e[:-lag]).sum(axis=0)
    return products / np.where(power > 0.0, power, np.inf)[:, None]


def _smoothness(measured: Sequence[np.ndarray]) -> np.ndarray:
    """Return the correlation of neighbouring second differences of readings, (output,)."""
    product, power = np.zeros(measured[0].shape[1]), np.zeros(measured[0].shape[1])
    for z in measured:
        bends = np.diff(z, 2, axis=0)
        product += np.nansum(bends[1:] * bends[:-1], axis=0)
        power += np.nansum(bends**2, axis=0)
    return product / np.where(power > 0.0, power, np.inf)


def whiteness_remarks(noise: xr.Dataset, is_filtered: bool) -> list[Remark]:
    """Return a remark for each output whose innovations are coloured.

    A filter with a strong correlation left has a wrong gain, and its figures must not be used.
    Without a disturbance in the model the fit is output error, whose standard errors hold for
    coloured residuals.

    Parameters
    ----------
    noise : Dataset (output)
        With the variables of `whiteness_variables`.
    is_filtered : bool
        Whether the model has a disturbance: process noise or gusts.
    """
    limit, remarks = CHANCE / noise.sizes["output"], []
    for name in map(str, noise["output"].values):
        row = noise.sel(output=name)
        chance = float(row["portmanteau_probability"])
        if chance >= limit:
            continue
        r = row["correlation"].values
        strongest = int(np.argmax(np.abs(r)))
        is_strong = is_filtered and abs(r[strongest]) > STRONG
        advice = _ADVICE
        if "smoothness" in row and float(row["smoothness"]) > SMOOTH:
            advice = _SMOOTHED.format(float(row["smoothness"]))
        text = (
            f"innovations of {name} are coloured: portmanteau {float(row['portmanteau']):.4g} over "
            f"{int(row['portmanteau_lags'])} lags, probability {chance:.2g}, correlation "
            f"{r[strongest]:.2f} at lag {strongest + 1}, {float(row['outside']):.0%} of the lags "
            f"outside the 95 % band; {advice}"
        )
        severity = "error" if is_strong else "warning"
        remarks.append(
            Remark("coloured", text, name, value=chance, threshold=limit, severity=severity)
        )
    return remarks
