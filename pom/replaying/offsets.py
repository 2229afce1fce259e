"""What was done to the flight data before they were compared, and what a long replay drifts by.

The flight traces are those of the reconstruction: constants of the instruments are calibration corrections, each listed with
its standard error.  No trace is shifted, scaled or centred anew on the start of a model.
"""

from __future__ import annotations

import json

import numpy as np
import pandas as pd
import xarray as xr

from flightmech.names import lookup

from ..judging.signals import trace_of
from ..result import PomResult

CALIBRATION = "calibration"  # attribute of flight states and of the signals of a result: JSON
DRIFTING = ("V_cas", "V", "h", "psi")
_COLUMNS = ("parameter", "estimate", "stderr", "unit")


def calibration_text(biases: xr.Dataset) -> str:
    """Return the corrections of a reconstruction as the JSON text that travels with its states.

    Parameters
    ----------
    biases : Dataset (parameter,)
        ``estimate``, ``stderr``, ``unit``, ``held``, from `flighttest.reconstruct` or `flighttest.reconstruction.open_biases`.
        Constants that were held are left out: nothing was corrected by them that the instrument's own specification does not state.
    """
    rows = [
        {
            "parameter": str(biases["parameter"].values[i]),
            "estimate": float(biases["estimate"].values[i]),
            "stderr": float(biases["stderr"].values[i]),
            "unit": str(biases["unit"].values[i]),
        }
        for i in np.flatnonzero(~biases["held"].values.astype(bool))
    ]
    return json.dumps(rows)


def calibration(result: PomResult) -> pd.DataFrame:
    """Return the corrections that the flight data of a result carry: ``parameter estimate stderr unit``, empty when none are known."""
    return pd.DataFrame(json.loads(result.signals.attrs.get(CALIBRATION, "[]")), columns=list(_COLUMNS))


def drift(result: PomResult) -> pd.DataFrame:
    """Return how speed, height and heading of every model leave those of the flight.

    Returns
    -------
    DataFrame
        ``run channel start rate spread unit``: value and slope [per s] of the line through model minus flight, and the standard
        deviation about it, over the whole window. [SI]  A slope with a small spread points to an error of force, of wind or of mass.
    """
    return result.once(_drift)


def _drift(result: PomResult) -> pd.DataFrame:
    time = result.signals["time"].values
    rows = []
    for name in (name for name in DRIFTING if name in result.signals):
        flight = trace_of(result.signals, "flight", name)
        for run in result.runs:
            difference = trace_of(result.signals, run, name) - flight
            if np.isfinite(difference).all() and time.size > 2:
                slope, start = np.polyfit(time - time[0], difference, 1)
                spread = float(np.std(difference - start - slope * (time - time[0])))
                rows.append((run, name, float(start), float(slope), spread, lookup(name).units))
    return pd.DataFrame(rows, columns=["run", "channel", "start", "rate", "spread", "unit"])
