"""Constraints in output error and filter error: against fits in which they are built in."""

from __future__ import annotations

import json
import sys
from pathlib import Path

import numpy as np
import pytest

sys.path.insert(0, str(Path(__file__).parent))
import test_output_error as simulated
from test_motion_fit import SHORT, short_period
from test_output_error import sim as sim  # the fixture

import flighttest
from flightmech.errors import SchemaError
from flighttest.maximum_likelihood.linear.motion_fit import fit_motion
from flighttest.maximum_likelihood.unknowns import Unknown


def stored(fit) -> list[dict]:
    return json.loads(fit.estimates.attrs["constraints"])


@pytest.mark.nightly
@pytest.mark.parametrize("disturbance", ["none", "process"])
def test_a_derivative_that_is_fixed_or_proportional(disturbance):
    records = [short_period(1)]
    texts = ["M_q = 0.3*M_alpha", f"Z_delta_e = {SHORT['Z_delta_e']}"]
    fit = fit_motion(records, "short-period", disturbance, constraints=texts).fit
    e = fit.estimates
    values = fit.parameters
    assert values["M_q"] == pytest.approx(0.3 * values["M_alpha"], rel=1e-12)
    assert values["Z_delta_e"] == SHORT["Z_delta_e"]
    assert float(e["stderr"].sel(parameter="Z_delta_e")) == 0.0
    ratio = e["stderr"].sel(parameter="M_q") / e["stderr"].sel(parameter="M_alpha")
    assert float(ratio) == pytest.approx(0.3)
    for name in ("M_alpha", "M_q", "M_delta_e"):
        error = (values[name] - SHORT[name]) / float(e["stderr"].sel(parameter=name))
        assert abs(error) < 3.5, name
    # The truth satisfies both: the data do not contradict them.
    assert max(abs(row["t"]) for row in stored(fit)) < 3.0
    assert not [remark for remark in fit.remarks if remark.kind == "constraint"]


@pytest.mark.slow
def test_the_contradiction_is_that_of_a_fit_without_the_constraint():
    records = [short_period(2)]
    free = fit_motion(records, "short-period").fit.estimates.sel(parameter="M_q")
    far = float(free["estimate"] + 1.0 * free["stderr"])
    near = fit_motion(records, "short-period", constraints=[f"M_q = {far!r}"]).fit
    assert stored(near)[0]["t"] == pytest.approx(-1.0, abs=0.15)
    wrong = fit_motion(records, "short-period", constraints=["M_q = -0.2"]).fit
    assert [remark for remark in wrong.remarks if remark.kind == "constraint"]
    assert "M_q = -0.2" in wrong.report()


@pytest.mark.slow
def test_a_sign_is_a_bound():
    records = [short_period(3)]
    free = fit_motion(records, "short-period").fit.parameters
    idle = fit_motion(records, "short-period", constraints=["M_q < 0"]).fit
    assert idle.parameters["M_q"] == pytest.approx(free["M_q"], rel=1e-5)
    held = fit_motion(records, "short-period", constraints=["Z_delta_e > 0"]).fit
    assert held.parameters["Z_delta_e"] == 0.0
    assert np.isnan(held.estimates["stderr"].sel(parameter="Z_delta_e"))
    assert stored(held)[0]["t"] < 0.0


@pytest.mark.slow
def test_the_simulation_takes_constraints(sim):
    """Against the fit in which the proportional terms are one unknown by hand."""
    record = simulated.flight(sim, 1)
    wanted = {name: Unknown(1.0) for name in simulated.TRUTH}
    fit = flighttest.output_error(
        sim,
        [record],
        {**wanted, **simulated.STARTS},
        outputs=list(simulated.NOISE),
        conditions=simulated.HELD,
        constraints=["term.Cm.elevator = 1.15", "term.CL.basic = 0.95*term.Cm.basic"],
    )
    values = fit.parameters
    assert values["term.Cm.elevator"] == 1.15
    assert values["term.CL.basic"] == pytest.approx(0.95 * values["term.Cm.basic"], rel=1e-12)
    # The same values held by hand: the damping alone is free.
    names = ("term.Cm.basic", "term.CL.basic", "term.Cm.elevator")
    held = flighttest.output_error(
        sim,
        [record],
        {"term.Cm.qhat": 1.0, **simulated.STARTS},
        outputs=list(simulated.NOISE),
        conditions={**simulated.HELD, **{name: values[name] for name in names}},
    )
    difference = values["term.Cm.qhat"] - held.parameters["term.Cm.qhat"]
    assert abs(difference) < 0.1 * float(fit.estimates["stderr"].sel(parameter="term.Cm.qhat"))


def test_what_a_likelihood_cannot_take_is_refused():
    records = [short_period(4)]
    with pytest.raises(SchemaError, match="limits of single unknowns"):
        fit_motion(records, "short-period", constraints=["M_q < M_alpha"])
    with pytest.raises(SchemaError, match="noise or a scale"):
        fit_motion(records, "short-period", "process", constraints=["process.q = 0.1"])
    with pytest.raises(SchemaError, match="no parameter 'M_beta'"):
        fit_motion(records, "short-period", constraints=["M_beta = 0"])
    with pytest.raises(SchemaError, match="leave no value"):
        fit_motion(records, "short-period", constraints=["M_q < -1", "M_q > 0"])


def test_a_change_of_rounding_size_changes_nothing():
    record = short_period(5)
    moved = record.copy()
    rng = np.random.default_rng(0)
    for name in ("alpha", "q", "az", "delta_e"):
        moved[name] = record[name] * (1.0 + 1e-12 * rng.normal(size=record.sizes["time"]))
    texts = ["M_q = 0.3*M_alpha", "Z_delta_e < 0"]
    a, b = (fit_motion([item], "short-period", constraints=texts).fit for item in (record, moved))
    size = np.where(a.estimates["stderr"] > 0.0, a.estimates["stderr"], np.inf)
    assert np.nanmax(np.abs(a.estimates["estimate"] - b.estimates["estimate"]) / size) < 1e-4
