"""Devices that a case sets and no term of a model uses: their setting is without effect."""

from __future__ import annotations

from collections.abc import Container

import numpy as np
import xarray as xr

from flightmech.units import DEGREE
from pom.cases.case import PomCase
from pom.tolerances.bands import RowRemark

WITHOUT_EFFECT = "without_effect"
"""Kind of the remark; it changes no verdict, since the fixed gear of a model needs no term."""
_FLAPS = 0.5 * DEGREE  # smaller settings are the zero of a sensor
_SHARE = 0.05  # of the travel of gear and speedbrake, likewise
_DEVICES = {"delta_f": "flaps", "gear": "landing gear", "speedbrake": "speedbrake"}


def idle_devices(case: PomCase, states: xr.Dataset | None, variables: Container[str]) -> list[str]:
    """Return a sentence for each device that is out in a case, and that a model does not use.

    Parameters
    ----------
    case : PomCase
        Its conditions replace the recorded settings.
    states : Dataset (time,) or None
        Flight over the window of the case; None if the record has a problem. [SI]
    variables : container of str
        Variables of the terms of the model.

    Returns
    -------
    list of str
        Empty if each device is retracted or has a term.
    """
    texts = []
    for name, words in _DEVICES.items():
        if name in variables:
            continue
        if name in case.conditions:
            setting = float(case.conditions[name])
        elif states is not None and name in states:
            # lost samples are NaN and hide no setting
            values = np.abs(np.asarray(states[name].values, float))
            setting = float(np.nanmax(values, initial=0.0))
        else:
            continue
        shown, least = f"at {setting:.2g}", _SHARE
        if name == "delta_f":
            shown, least = f"at {setting / DEGREE:.3g} deg", _FLAPS
        if abs(setting) > least:
            texts.append(f"{words} {shown} without effect: no term of the model is over {name}")
    return texts


def idle_remarks(
    case: PomCase, states: xr.Dataset, variables: Container[str]
) -> tuple[RowRemark, ...]:
    """Return the remarks of `idle_devices` on a run; parameters as there."""
    texts = idle_devices(case, states, variables)
    return tuple(RowRemark(WITHOUT_EFFECT, text) for text in texts)
