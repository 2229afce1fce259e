"""Departure of cases that a control of doubtful size drives."""

from types import SimpleNamespace

import numpy as np
import pytest
import xarray as xr

from pom.cases.case_inputs import CaseInputs
from pom.probing.control_doubts import size_remarks

NOTICE = "size of delta_a: the flights give 1.49 (standard error 0.02) of its a-priori effect in Cl"


def remarks(deflection=0.1, surfaces="recorded", blank=0):
    evidence = xr.DataTree(xr.Dataset(attrs={"notices": f"suspect fits: slow\n{NOTICE}"}))
    case = SimpleNamespace(drive=CaseInputs(surfaces=surfaces), window=(2.0, 8.0), law_moves=())
    time = np.arange(0.0, 10.0, 0.1)
    aileron = deflection * np.sin(time)
    aileron[30 : 30 + blank] = np.nan
    states = {"delta_a": ("time", aileron)}
    return size_remarks(evidence, case, xr.Dataset(states, {"time": time}))


def test_a_recorded_control_of_doubtful_size_departs():
    (remark,) = remarks()
    assert remarks(blank=5) == (remark,)
    assert (remark.kind, remark.quantity) == ("departure", "delta_a")
    assert remark.text == f"departure: {NOTICE}"


@pytest.mark.parametrize("other", [{"deflection": 0.002}, {"surfaces": "cockpit"}])
def test_a_control_that_rests_or_does_not_drive_has_no_effect(other):
    assert remarks(**other) == ()
