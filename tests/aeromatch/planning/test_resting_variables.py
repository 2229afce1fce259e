"""A fit over manoeuvres in which its control rests has a remark, before the match and after it."""

from types import SimpleNamespace

import numpy as np
import pandas as pd
import xarray as xr

from aeromatch.planning.resting_variables import movements, resting_remarks
from flighttest.regression.equation_error.model import RegressionModel
from flighttest.regression.equation_error.time_domain import regress

TIME = np.arange(0.0, 30.0, 0.02)
ELEVATOR = np.where((TIME > 5.0) & (TIME < 8.0), 0.03, 0.0)
STATES = xr.Dataset(
    {
        "delta_e": ("time", ELEVATOR + 1e-3 * np.random.default_rng(0).normal(size=TIME.size)),
        "alpha": ("time", 0.05 * np.sin(TIME)),
        "q": ("time", 0.05 * np.cos(TIME)),
    },
    {"time": TIME},
)
TABLE = pd.DataFrame(
    {
        "manoeuvre": ["3211", "doublet"],
        "control": ["elevator", "rudder"],
        "start": [4.0, 15.0],
        "end": [10.0, 25.0],
    }
)


def look(spans):
    moved, movers = movements(STATES, TABLE, spans)
    return SimpleNamespace(moved=moved, movers=movers)


def project(**models):
    return SimpleNamespace(
        cutoff=None,
        fit=[SimpleNamespace(name=name, models=[text]) for name, text in models.items()],
    )


PITCH = "Cm = 1 + alpha + qhat + delta_e"


def test_an_elevator_that_rests_and_the_manoeuvre_that_moves_it():
    looks = {"cruise": look({"fit 'pitch'": [(15.0, 25.0)]})}
    (line,) = resting_remarks(project(pitch=PITCH), looks)
    assert line.startswith("fit 'pitch': delta_e hardly moves in its manoeuvres (range 0.")
    assert "derivative of Cm" in line
    assert line.endswith("manoeuvres of its records that move it: 3211 elevator")


def test_a_control_that_moves_in_one_record_or_in_another_fit():
    moved = look({"fit 'pitch'": [(4.0, 10.0)], "fit 'power'": [(15.0, 25.0)]})
    rest = look({"fit 'pitch'": [(15.0, 25.0)]})
    assert resting_remarks(project(pitch=PITCH), {"a": moved, "b": rest}) == []
    assert resting_remarks(project(pitch=PITCH, power=PITCH), {"a": moved}) == []
    # the other fit has another coefficient
    other = "CL = 1 + alpha + delta_e"
    (line,) = resting_remarks(project(pitch=PITCH, power=other), {"a": moved})
    assert line.startswith("fit 'power'")


def test_a_fit_over_manoeuvres_of_rest_has_a_remark():
    data = STATES.assign(CL=5.0 * STATES["alpha"] + 0.4 * STATES["delta_e"])
    for window, count in ((slice(4, 10), 0), (slice(15, 25), 1)):
        fit = regress(RegressionModel.parse("CL = 1 + alpha + delta_e"), data.sel(time=window))
        rest = [remark for remark in fit.remarks if remark.kind == "rest"]
        assert [remark.term for remark in rest] == ["delta_e"] * count


def test_a_low_pass_below_the_motion_is_named():
    slow = project(pitch=PITCH)
    slow.cutoff = 0.1
    flown = SimpleNamespace(moved={}, movers={}, uses={"fit 'pitch'": (3, 30.0)})
    (line,) = resting_remarks(slow, {"cruise": flown})
    assert "manoeuvres last 10 s on average" in line
    assert "cutoff = 0.1 Hz leaves 1 periods of them" in line
    slow.cutoff = 4.0
    assert resting_remarks(slow, {"cruise": flown}) == []
