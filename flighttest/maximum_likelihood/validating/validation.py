"""Models on records that none of them has used: one figure per model, and figures per channel."""

from __future__ import annotations

import os
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np
import pandas as pd

from flightmech.errors import AeromatchError, ParseError
from flightmech.support.console import to_json_types
from flighttest.maximum_likelihood.result import OutputError, open_output_error
from flighttest.maximum_likelihood.validating.predicted_channels import (
    PredictedChannel,
    count_parameters,
    figures_of,
    predict_window,
)
from flighttest.maximum_likelihood.validating.used_windows import ValidationWindow, find_use
from flighttest.regression.equation_error.fit import Fit
from flighttest.regression.equation_error.fit_file import open_fit
from flighttest.remarks import PrintedResult

COLUMNS = (
    "model", "method", "channel", "unit", "window", "parameters", "samples",
    "R2", "theil", "theil_bias", "theil_variance", "theil_covariance", "rms", "nrmse", "windows",
    "remarks",
)  # fmt: skip
"""Columns of the board: a row for each model, channel and window, and one of all windows.

``windows`` is the number of windows that count: those that the model has not used.
"""
ALL = "all"
"""Name of the window of a row over all windows."""


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
        """One row per model: the least ``R2`` and the largest ``theil`` of its channels.

        ``windows`` are those that count, of all. ``common`` is the least R2 over the windows that
        count for all models: figures of different windows do not rank models.
        """
        counted = {}
        for name, rows in self.rows.groupby("model", sort=False):
            counted[name] = _counted_windows(rows)
        sets = [windows for windows in counted.values() if windows]
        common = set.intersection(*sets) if sets else set()
        found = []
        for name, rows in self.rows.groupby("model", sort=False):
            total = rows[rows["window"] == ALL]
            first = rows.iloc[0]
            every = rows.loc[rows["window"] != ALL, "window"].nunique()
            row = {
                "model": name,
                "method": first["method"],
                "channels": " ".join(dict.fromkeys(rows["channel"])),
                "parameters": first["parameters"],
                "windows": f"{len(counted[name])} of {every}",
                "common": _least_r2(rows, common) if counted[name] else np.nan,
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
        summary = self.summary
        is_ranked = summary["windows"].nunique() > 1 or not _is_same(summary)
        for row in summary.sort_values("common", ascending=False).to_dict("records"):
            shared = f"  common R2 {row['common']:8.4f}" if is_ranked else ""
            lines.append(
                f"  {row['model']:{width}s} R2 {row['R2']:8.4f}  Theil {row['theil']:7.4f}  "
                f"{row['windows']} windows{shared}  {row['parameters']} parameters, "
                f"{row['channels']}"
            )
        if is_ranked:
            lines.append(
                "! the models have different windows: their order is that of the R2 over the "
                "windows that count for all"
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


def _counted_windows(rows: pd.DataFrame) -> set[str]:
    """Return the windows of the rows of a model that count."""
    return set(rows.loc[(rows["window"] != ALL) & (rows["windows"] > 0), "window"])


def _least_r2(rows: pd.DataFrame, windows: set[str]) -> float:
    """Return the least R2 of the channels over some windows; NaN without a window.

    The sums of squares follow from rms and R2 of the rows, since each window has its own mean.
    """
    least = np.inf
    for _, channel in rows[rows["window"].isin(windows)].groupby("channel"):
        errors = channel["samples"] * channel["rms"] ** 2
        remainder = 1.0 - channel["R2"]
        if np.all(errors == 0.0):
            least = min(least, 1.0)
            continue
        # A window that is predicted without an error has no sum of squares about its mean.
        moved = (errors / remainder.where(remainder > 0.0)).sum(skipna=False)
        least = np.minimum(least, 1.0 - errors.sum(skipna=False) / moved)
    return float(least) if windows and least < np.inf else np.nan


def _is_same(summary: pd.DataFrame) -> bool:
    """Return whether every R2 is that over the common windows."""
    known = summary.dropna(subset=["R2"])
    return bool(np.allclose(known["R2"], known["common"], rtol=1e-9, atol=1e-12))


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
    remark states how many of its samples are in the fit (`find_use`). A window that it may have
    used does not count either. A model that cannot predict a window has a row without figures and
    with the reason.
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
            empty = {"channel": _first_channel(model), "unit": "", "samples": 0, "windows": 0}
            rows.append({**head, **empty, "window": window.name, "remarks": f"no figure: {reason}"})
            continue
        use = find_use(model, window)
        if use.remark:
            remarks.insert(0, use.remark)
        for channel in channels:
            found = _WindowPrediction(window.name, channel, remarks, use.counts)
            by_channel.setdefault(channel.name, []).append(found)
    for predictions in by_channel.values():
        for found in predictions:
            texts = "; ".join(dict.fromkeys(found.remarks))
            figures = figures_of([found.channel]) | {"windows": int(found.counts)}
            rows.append({**head, **figures, "window": found.window, "remarks": texts})
        rows.append({**head, **_figures_of_all(predictions, len(windows))})
    return rows


class _WindowPrediction(NamedTuple):
    """One channel of one window, predicted by a model."""

    window: str
    channel: PredictedChannel
    remarks: list[str]
    counts: bool


def _figures_of_all(predictions: Sequence[_WindowPrediction], count: int) -> dict[str, Any]:
    """Return the row over the windows that a model has not used."""
    channels = [found.channel for found in predictions if found.counts]
    texts = []
    if len(channels) < count:
        texts.append(
            f"{len(channels)} of {count} windows: the others are or may be in the fit, or fail"
        )
    remarked = sum(bool(found.remarks) for found in predictions if found.counts)
    if remarked:
        texts.append(f"{remarked} of them with remarks")
    first = predictions[0].channel
    figures: dict[str, Any] = {"channel": first.name, "unit": first.unit, "samples": 0}
    if channels:
        figures = figures_of(channels)
    found = {"windows": len(channels), "window": ALL, "remarks": "; ".join(texts)}
    return {**figures, **found}


def _method_of(model: Fit | OutputError) -> str:
    if isinstance(model, OutputError):
        motion = str(model.estimates.attrs.get("motion", ""))
        is_filtered = any(name.startswith(("process.", "gust.")) for name in model.parameters)
        return f"{'filter' if is_filtered else 'output'} error" + (f", {motion}" if motion else "")
    return "equation error"


def _first_channel(model: Fit | OutputError) -> str:
    return "" if isinstance(model, OutputError) else model.model.coefficient
