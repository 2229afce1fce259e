"""Remarks on an identified actuator: contradictions, limits, logs without convergence."""

from __future__ import annotations

from collections.abc import Collection, Sequence

import numpy as np
import pandas as pd
import xarray as xr

from flighttest.regression.combining.pooling import DISAGREEMENT
from flighttest.remarks import Remark
from flighttest.submodels.actuators.values import LogEstimates


def contradiction_remarks(table: pd.DataFrame, text: str) -> list[Remark]:
    """Return a remark on each parameter whose estimates contradict each other.

    Parameters
    ----------
    table : DataFrame
        Index parameter; ``disagreement`` in combined standard errors, and ``contradictory``.
    text : str
        Sentence with a field for the disagreement.
    """
    remarks = []
    for name, row in table.iterrows():
        if row["contradictory"]:
            disagreement = float(row["disagreement"])
            sentence = f"{name}: {text.format(row['disagreement'])}"
            remarks.append(Remark("scatter", sentence, str(name), disagreement, DISAGREEMENT))
    return remarks


def unconverged_log_remarks(logs: Sequence[LogEstimates]) -> list[Remark]:
    """Return a remark on each log whose search alone did not converge."""
    remarks = []
    for log in logs:
        if not log.converged:
            text = (
                f"{log.record or 'log'}: the output error on this log alone is not converged after "
                f"{log.iterations} iterations; the averages over the logs leave it out"
            )
            remarks.append(Remark("convergence", text, log.record))
    return remarks


def limit_remarks(logs: Sequence[xr.Dataset], reached: Collection[str]) -> list[Remark]:
    """Return a remark on each kind of limit that no log reached.

    Parameters
    ----------
    logs : sequence of Dataset (time,)
        Logs of a servo.
    reached : collection of str
        Names of the limits that the response reaches.
    """
    remarks = []
    if "rate_limit" not in reached:
        fastest = max(_largest_rate(log) for log in logs)
        text = f"no rate limit was reached; the logs reach {fastest:.3g} rad/s"
        remarks.append(Remark("limit", text, "rate_limit", severity="note"))
    if not {"stop_low", "stop_high"} & set(reached):
        low = min(float(np.nanmin(log["position"].values)) for log in logs)
        high = max(float(np.nanmax(log["position"].values)) for log in logs)
        text = f"no stop was reached; the logs reach {low:.3g} to {high:.3g} rad"
        remarks.append(Remark("limit", text, "stops", severity="note"))
    return remarks


def _largest_rate(log: xr.Dataset) -> float:
    """Return the largest recorded rate, or the largest slope of the position over five samples."""
    if "rate" in log:
        return float(np.nanmax(np.abs(log["rate"].values)))
    x, time = log["position"].values, log["time"].values
    return float(np.nanmax(np.abs((x[4:] - x[:-4]) / (time[4:] - time[:-4]))))
