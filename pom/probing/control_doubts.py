"""Controls whose recorded size an identification doubts, as departures of the cases they drive."""

from __future__ import annotations

import numpy as np
import xarray as xr

from aerodb.update.cautions.control_sizes import doubted_control
from aerodb.update.cautions.notices import notices_of
from flightmech.units import DEGREE
from pom.cases.case import PomCase, driven_quantities
from pom.tolerances.bands import RowRemark

_MOVED = 0.5 * DEGREE
"""Movement in the window of a case below which the size of a control has no effect."""


def size_remarks(evidence: xr.DataTree, case: PomCase, states: xr.Dataset) -> tuple[RowRemark, ...]:
    """Return a ``departure`` for each recorded control whose size the evidence doubts.

    A model from half the deflections has twice the effect, so that it passes against its own
    record.

    Parameters
    ----------
    evidence : DataTree
        An identified database; its notices have the doubts (`aerodb.tabulate`).
    case : PomCase
        A control counts that drives the model and moves in its window.
    states : Dataset (time,)
        Of the flight. [SI]
    """
    driven = driven_quantities(case)
    time = states["time"].values
    inside = (time >= case.window[0]) & (time <= case.window[1])
    remarks = []
    for text in notices_of(evidence.attrs):
        control = doubted_control(text)
        if control not in driven or control not in states:
            continue
        # a control that the record holds in [constants] has one number
        values = np.broadcast_to(states.variables[control].values.astype(float), time.shape)
        # a control may be blank for a part of the window
        known = values[inside & np.isfinite(values)]
        if known.size and np.ptp(known) >= _MOVED:
            remarks.append(RowRemark("departure", f"departure: {text}", control))
    return tuple(remarks)
