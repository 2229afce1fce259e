"""Models on records that none of them has used: one figure per model, and figures per channel."""

from __future__ import annotations

import json
import os
import warnings
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np
import pandas as pd
import xarray as xr

from flightmech.errors import AeromatchError, AeromatchWarning, ParseError
from flightmech.support.arrays import rms
from flightmech.support.console import to_json_types
from flighttest.maximum_likelihood.linear.motion_prediction import predict_motion
from flighttest.maximum_likelihood.result import OutputError, open_output_error
from flighttest.regression.equation_error.fit import Fit, open_fit
from flighttest.regression.equation_error.least_squares import intercept_mask
from flighttest.regression.uncertainty.prediction_errors import theil, theil_shares
from flighttest.remarks import PrintedResult

COLUMNS = (
    "model", "method", "channel", "unit", "window", "parameters", "samples",
    "R2", "theil", "theil_bias", "theil_variance", "theil_covariance", "rms", "nrmse", "remarks",
)  # fmt: skip
"""Columns of the board: a row for each model, channel and window, and one of all windows."""
ALL = "all"
"""Name of the window of a row over all windows."""
WINDOWS = "windows"
"""Attribute of the estimates of a file: its windows as JSON, [record, start, stop] of each. [s]"""
USED = "in the fit"
"""Beginning of the remark on a window that the fit has used."""


class ValidationWindow(NamedTuple):
    """A stretch of a record that models predict.

    Attributes
    ----------
    record : str
    data : Dataset (time,)
        Coefficients and states, as from `flighttest.coefficients`. [SI]
    """

    record: str
    data: xr.Dataset

    @property
    def name(self) -> str:
        """Record and times."""
        time = self.data["time"].values
        return f"{self.record} {time[0]:g}-{time[-1]:g} s"


class PredictedChannel(NamedTuple):
    """One channel of a window, measured and predicted. [SI]"""

    name: str
    unit: str
    measured: np.ndarray
    predicted: np.ndarray


@dataclass(frozen=True)
class ValidationBoard(PrintedResult):
    """Comparison of models on records.

    Attributes
    ----------
    rows : DataFrame
        Columns `COLUMNS`.
    """

    rows: pd.DataFrame

    @property
    def summary(self) -> pd.DataFrame:
        """One row per model: the least ``R2`` and the largest ``theil`` of its channels."""
        found = []
        for name, rows in self.rows.groupby("model", sort=False):
            total = rows[rows["window"] == ALL]
            first = rows.iloc[0]
            row = {
                "model": name,
                "method": first["method"],
                "channels": " ".join(dict.fromkeys(rows["channel"])),
                "parameters": first["parameters"],
                "R2": total["R2"].min(skipna=False) if len(total) else np.nan,
                "theil": total["theil"].max(skipna=False) if len(total) else np.nan,
                "remarks": int((rows["remarks"] != "").sum()),
            }
            found.append(row)
        return pd.DataFrame(found)

    @property
    def remarks(self) -> list[Any]:
        """No remarks of the whole board; each row has its own."""
        return []

    def report_lines(self) -> list[str]:
        """Return one line per model, the best first, then the rows."""
        width = max([5, *map(len, self.rows["model"])])
        windows = max([6, *map(len, self.rows["window"])])
        lines = ["over all windows that a model has not used, the worst of its channels:"]
        for row in self.summary.sort_values("R2", ascending=False).to_dict("records"):
            lines.append(
                f"  {row['model']:{width}s} R2 {row['R2']:8.4f}  Theil {row['theil']:7.4f}  "
                f"{row['parameters']} parameters, {row['channels']}"
            )
        lines += [
            "",
            f"{'model':{width}s} {'method':14s} {'channel':7s} {'window':{windows}s} "
            f"{'par.':>4s} {'samples':>8s} {'R2':>9s} {'Theil':>7s} {'rms':>10s} unit",
        ]
        for row in self.rows.to_dict("records"):
            lines.append(
                f"{row['model']:{width}s} {row['method']:14s} {row['channel']:7s} "
                f"{row['window']:{windows}s} {row['parameters']:4d} {row['samples']:8d} "
                f"{row['R2']:9.4f} {row['theil']:7.4f} {row['rms']:10.4g} {row['unit']}"
            )
            if row["remarks"]:
                lines.append(f"  ! {row['remarks']}")
        return lines

    def as_dict(self) -> dict[str, Any]:
        """Return summary and rows as JSON types."""
        return to_json_types(
            {"summary": self.summary.to_dict("records"), "rows": self.rows.to_dict("records")}
        )


def open_model(path: str | os.PathLike) -> Fit | OutputError:
    """Return a fit of ``identify``, ``select`` or ``fit-linear`` from its file.

    Raises
    ------
    ParseError
        The file is none of them.
    """
    try:
        return open_fit(path)
    except ParseError as first:
        try:
            return open_output_error(path)
        except ParseError:
            raise first from None


def validate_models(
    models: Mapping[str, Fit | OutputError], windows: Sequence[ValidationWindow]
) -> ValidationBoard:
    """Compare models by their predictions of windows of records.

    Parameters
    ----------
    models : mapping of str to Fit or OutputError
        A `Fit` predicts its coefficient from the measured states; an `OutputError` of `fit_motion`
        simulates the motion from the measured controls.
    windows : sequence of ValidationWindow

    Returns
    -------
    ValidationBoard
        A row for each window, then one of all windows that the model has not used.  ``R2`` is
        1 - sum(z - y)^2/sum(z - mean)^2 with the mean of the window, over all windows of the sums.
        It is negative for a prediction worse than a constant.

    Notes
    -----
    A window that the fit has used proves nothing: it is not in the row of all windows, and its
    remark states how many of its samples are in the fit. A model that cannot predict a window has a row without figures and with the reason.
    """
    rows: list[dict[str, Any]] = []
    for name, model in models.items():
        rows += _rows_of_model(name, model, windows)
    return ValidationBoard(pd.DataFrame(rows, columns=list(COLUMNS)))


def _rows_of_model(
    name: str, model: Fit | OutputError, windows: Sequence[ValidationWindow]
) -> list[dict[str, Any]]:
    head = {"model": name, "method": _method_of(model), "parameters": count_parameters(model)}
    by_channel: dict[str, list[_WindowPrediction]] = {}
    rows = []
    for window in windows:
        try:
            channels, remarks = predict_window(model, window.data)
        except AeromatchError as error:
            reason = "; ".join(getattr(error, "problems", ())) or str(error)
            empty = {"channel": _first_channel(model), "unit": "", "samples": 0}
            rows.append({**head, **empty, "window": window.name, "remarks": f"no figure: {reason}"})
            continue
        used = count_used_samples(model, window)
        if used:
            remarks.insert(0, f"{USED}: {used} samples of the window; it validates nothing")
        for channel in channels:
            found = _WindowPrediction(window.name, channel, remarks, used > 0)
            by_channel.setdefault(channel.name, []).append(found)
    for predictions in by_channel.values():
        for found in predictions:
            texts = "; ".join(dict.fromkeys(found.remarks))
            figures = figures_of([found.channel])
            rows.append({**head, **figures, "window": found.window, "remarks": texts})
        rows.append({**head, **_figures_of_all(predictions, len(windows))})
    return rows


class _WindowPrediction(NamedTuple):
    """One channel of one window, predicted by a model."""

    window: str
    channel: PredictedChannel
    remarks: list[str]
    is_used: bool


def _figures_of_all(predictions: Sequence[_WindowPrediction], count: int) -> dict[str, Any]:
    """Return the row over the windows that a model has not used."""
    channels = [found.channel for found in predictions if not found.is_used]
    texts = []
    if len(channels) < count:
        texts.append(f"{len(channels)} of {count} windows: the others are in the fit or fail")
    remarked = sum(bool(found.remarks) for found in predictions if not found.is_used)
    if remarked:
        texts.append(f"{remarked} of them with remarks")
    first = predictions[0].channel
    figures: dict[str, Any] = {"channel": first.name, "unit": first.unit, "samples": 0}
    if channels:
        figures = figures_of(channels)
    return {**figures, "window": ALL, "remarks": "; ".join(texts)}


def _method_of(model: Fit | OutputError) -> str:
    if isinstance(model, OutputError):
        motion = str(model.estimates.attrs.get("motion", ""))
        is_filtered = any(name.startswith(("process.", "gust.")) for name in model.parameters)
        return f"{'filter' if is_filtered else 'output'} error" + (f", {motion}" if motion else "")
    return "equation error"


def _first_channel(model: Fit | OutputError) -> str:
    return "" if isinstance(model, OutputError) else model.model.coefficient


def count_parameters(model: Fit | OutputError) -> int:
    """Return the number of parameters that a prediction holds, without constants of records."""
    if isinstance(model, OutputError):
        fixed = ("init.", "drift.", "sensor.", "process.", "gust.", "scale.", "noise.")
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
        The model cannot predict the window.
    """
    if isinstance(model, OutputError):
        found = predict_motion(model, data)
        channels = []
        for name in found.predicted.data_vars:
            measured, predicted = found.measured[name], found.predicted[name]
            unit = str(measured.attrs.get("units", ""))
            channels.append(PredictedChannel(str(name), unit, measured.values, predicted.values))
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
    return [PredictedChannel(coefficient, "1", measured, predicted)], remarks


def count_used_samples(model: Fit | OutputError, window: ValidationWindow) -> int:
    """Return the number of samples of a window that a model has used.

    A sample is in a regression if its time and its coefficient are, to the last digits.  A fit by
    output error has the names and times of its windows in its file.
    """
    if isinstance(model, OutputError):
        return _count_common_times(model, window)
    coefficient, data = model.model.coefficient, window.data
    if "time" not in model.data or coefficient not in data or coefficient not in model.data:
        return 0

    def keys(samples: xr.Dataset) -> set[tuple[float, float]]:
        values = samples[coefficient].values.astype(float)
        return set(zip(np.round(samples["time"].values, 6), np.round(values, 12), strict=True))

    return len(keys(model.data) & keys(data))


def _count_common_times(model: OutputError, window: ValidationWindow) -> int:
    time = window.data["time"].values
    is_used = np.zeros(len(time), bool)
    for record, start, stop in json.loads(str(model.estimates.attrs.get(WINDOWS, "[]"))):
        if record == window.record:
            is_used |= (time >= start) & (time <= stop)
    return int(is_used.sum())


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
