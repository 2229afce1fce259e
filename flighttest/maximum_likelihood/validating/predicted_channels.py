"""Predictions of a window by a model, channel by channel, and their figures."""

from __future__ import annotations

import warnings
from collections.abc import Sequence
from typing import Any, NamedTuple

import numpy as np
import xarray as xr

from flightmech.errors import AeromatchWarning, IdentificationError
from flightmech.support.arrays import rms
from flighttest.maximum_likelihood.linear.motion_prediction import predict_motion
from flighttest.maximum_likelihood.result import OutputError
from flighttest.regression.equation_error.fit import Fit
from flighttest.regression.equation_error.least_squares import intercept_mask
from flighttest.regression.uncertainty.prediction_errors import theil, theil_shares


class PredictedChannel(NamedTuple):
    """One channel of a window, measured and predicted. [SI]"""

    name: str
    unit: str
    measured: np.ndarray
    predicted: np.ndarray


def count_parameters(model: Fit | OutputError) -> int:
    """Return the number of parameters that a prediction holds, without constants of records."""
    if isinstance(model, OutputError):
        fixed = ("init.", "drift.", "sensor.", "process.", "gust.", "scale.", "turn.", "noise.")
        return sum(not name.startswith(fixed) for name in model.parameters)
    terms = [str(term) for term in model.estimates["term"].values]
    return sum(not term.startswith("1[") for term in terms)


def predict_window(
    model: Fit | OutputError, data: xr.Dataset
) -> tuple[list[PredictedChannel], list[str]]:
    """Return measured and predicted channels of a window, and remarks.

    Raises
    ------
    AeromatchError
        The model cannot predict the window, or its run diverges.
    """
    if isinstance(model, OutputError):
        found = predict_motion(model, data)
        channels = []
        for name in found.predicted.data_vars:
            measured, predicted = found.measured[name], found.predicted[name]
            unit = str(measured.attrs.get("units", ""))
            channels.append(PredictedChannel(str(name), unit, measured.values, predicted.values))
            _demand_values(channels[-1], np.isfinite(measured.values))
        return channels, list(found.remarks)
    return _predict_coefficient(model, data)


def _predict_coefficient(fit: Fit, data: xr.Dataset) -> tuple[list[PredictedChannel], list[str]]:
    """Return the coefficient along a window.

    A fit with a constant for each manoeuvre has none for this one: it is taken from the window.
    """
    coefficient = fit.model.coefficient
    terms = [str(term) for term in fit.estimates["term"].values]
    separate = [term for term in terms if term != "1" and intercept_mask([term])[0]]
    manoeuvre = int(separate[0][2:-1]) if separate else None
    with warnings.catch_warnings(record=True) as caught:
        warnings.simplefilter("always")
        predicted = fit.predict(data, manoeuvre)[coefficient].values.astype(float)
    remarks = []
    for item in caught:
        if issubclass(item.category, AeromatchWarning):
            remarks.append(str(item.message).partition(" is used ")[2] or str(item.message))
    measured = data[coefficient].values.astype(float)
    if separate:
        predicted = predicted + np.nanmean(measured - predicted)
        remarks.append("its constant is taken from the window")
    channel = PredictedChannel(coefficient, "1", measured, predicted)
    # A state without a value gives no coefficient, and that is not a fault of the model.
    lost = np.isnan(predicted) & np.isfinite(measured)
    if lost.any():
        remarks.append(f"{int(lost.sum())} samples without a state of the model do not count")
    _demand_values(channel, np.isfinite(measured) & ~lost)
    return [channel], remarks


def _demand_values(channel: PredictedChannel, counted: np.ndarray) -> None:
    """Raise IdentificationError if a counted sample (time,) has no predicted value."""
    lost = counted & ~np.isfinite(channel.predicted)
    if lost.any():
        raise IdentificationError(
            f"the run diverges: {channel.name} has no value in {int(lost.sum())} of "
            f"{int(counted.sum())} samples"
        )


def figures_of(parts: Sequence[PredictedChannel]) -> dict[str, Any]:
    """Return the figures of a channel over one or several windows."""
    measured, predicted, centred = [], [], []
    for part in parts:
        valid = np.isfinite(part.measured) & np.isfinite(part.predicted)
        z = part.measured[valid]
        measured.append(z)
        predicted.append(part.predicted[valid])
        centred.append(z - z.mean() if len(z) else z)
    z, y, moved = (np.concatenate(arrays) for arrays in (measured, predicted, centred))
    figures: dict[str, Any] = {
        "channel": parts[0].name,
        "unit": parts[0].unit,
        "samples": len(z),
    }
    if len(z) < 2 or not np.any(moved):
        return figures
    shares: tuple[float, ...] = (np.nan,) * 3
    if np.any(z != y):
        shares = tuple(theil_shares(z, y))
    figures |= dict(zip(("theil_bias", "theil_variance", "theil_covariance"), shares, strict=True))
    figures["R2"] = 1.0 - float(((z - y) ** 2).sum() / (moved**2).sum())
    figures["theil"] = theil(z, y)
    figures["rms"] = rms(z - y)
    figures["nrmse"] = 100.0 * rms(z - y) / float(np.ptp(z))
    return figures
