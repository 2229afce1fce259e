"""Output error in time: a simulated glider whose truth is known."""

from __future__ import annotations

import numpy as np
import pytest
import xarray as xr

import flightmech
import flighttest
from flightmech.errors import IdentificationError, SchemaError, UnknownName
from flightmech.terms import make_term
from flighttest.maximum_likelihood import time_domain
from flighttest.maximum_likelihood.unknowns import Unknown

TRUTH = {"term.Cm.basic": 1.1, "term.Cm.qhat": 0.8, "term.Cm.elevator": 1.15, "term.CL.basic": 1.05}
NOISE = {"V": 0.1, "alpha": 2e-3, "q": 1e-3, "theta": 1e-3, "az": 0.1}
HELD = {"mode.earth": 0.0, "init.h": 500.0, "init.q": 0.0}
STARTS = {name: Unknown(None, own=True) for name in ("init.V", "init.alpha", "init.theta")}


@pytest.fixture(scope="module")
def sim() -> flightmech.SimModel:
    craft = flightmech.Aircraft(
        name="glider", S=16.0, cbar=1.5, b=10.0, mass=900.0, Ixx=2000.0, Iyy=2500.0, Izz=4000.0
    )
    alpha = [-0.2, 0.0, 0.2, 0.4]
    leaves = {
        "/CL/basic": make_term([-0.8, 0.3, 1.3, 1.5], {"alpha": alpha}),
        "/CD/basic": make_term([0.05, 0.02, 0.08, 0.3], {"alpha": alpha}),
        "/Cm/basic": make_term([0.2, 0.03, -0.15, -0.4], {"alpha": alpha}),
        "/Cm/qhat": make_term(-14.0, regressors=["qhat"]),
        "/Cm/elevator": make_term(-1.2, regressors=["delta_e"]),
    }
    return flightmech.compile(craft, xr.DataTree.from_dict(leaves))


def flight(sim, seed, V=40.0, duration=10.0, alpha_bias=0.0, colour=0.0):
    """A doublet as instruments record it; noise with a pole at `colour`."""
    t = np.arange(0.0, duration, 0.04)
    record = xr.Dataset(
        {"delta_e": ("time", 0.02 * (((t > 1) & (t < 2)) * 1.0 - ((t > 2) & (t < 3))))}, {"time": t}
    )
    start = {"init.V": V, "init.alpha": 0.03, "init.theta": 0.0}
    y = flightmech.simulate(sim, record, {**HELD, **start, **TRUTH}, outputs=list(NOISE), step=0.04)
    rng = np.random.default_rng(seed)
    for name, sigma in NOISE.items():
        e = rng.standard_normal(len(t))
        for k in range(1, len(e)):
            e[k] = colour * e[k - 1] + np.sqrt(1.0 - colour**2) * e[k]
        record[name] = y[name] + sigma * e + (alpha_bias if name == "alpha" else 0.0)
    return record


def errors(fit):
    """Errors of the terms in standard errors."""
    e = fit.estimates.sel(parameter=list(TRUTH))
    return (e["estimate"].values - np.array(list(TRUTH.values()))) / e["stderr"].values


def test_the_truth_comes_back_within_its_standard_errors(sim):
    unknowns = {name: 1.0 for name in TRUTH} | STARTS | {"sensor.alpha": (0.0, 0.02)}
    fit = flighttest.output_error(sim, flight(sim, 1, alpha_bias=0.01), unknowns, list(NOISE), HELD)
    e = fit.estimates
    assert e.attrs["converged"] == 1
    assert np.abs(errors(fit)).max() < 3.0
    assert e["stderr"].sel(parameter="term.Cm.elevator") < 0.01
    assert abs(e["estimate"].sel(parameter="sensor.alpha") - 0.01) < 3.0 * e["stderr"].sel(
        parameter="sensor.alpha"
    )
    found = fit.noise["stderr"].sel(manoeuvre=1)
    assert np.allclose(
        found.values, list(NOISE.values()), rtol=0.15
    )  # 250 readings determine a deviation to 4.5 %
    assert fit.parameters["term.Cm.qhat"] == float(e["estimate"].sel(parameter="term.Cm.qhat"))


@pytest.mark.slow
def test_several_manoeuvres_share_the_model_and_keep_their_starts(sim):
    records = [flight(sim, seed, V) for seed, V in ((1, 40.0), (2, 44.0), (3, 36.0))]
    one = flighttest.output_error(
        sim, records[0], {name: 1.0 for name in TRUTH} | STARTS, list(NOISE), HELD
    )
    fit = flighttest.output_error(
        sim, records, {name: 1.0 for name in TRUTH} | STARTS, list(NOISE), HELD, noise="own"
    )
    assert np.abs(errors(fit)).max() < 3.0
    assert [round(fit.of_manoeuvre(k)["init.V"]) for k in (1, 2, 3)] == [40, 44, 36]
    assert "init.V@2" in fit.report()
    gain = one.estimates["stderr"].sel(parameter=list(TRUTH)) / fit.estimates["stderr"].sel(
        parameter=list(TRUTH)
    )
    assert (gain > 1.2).all()
    assert fit.noise["stderr"].shape == (3, len(NOISE))


def test_a_bound_holds_and_is_reported(sim):
    unknowns = (
        {name: 1.0 for name in TRUTH} | STARTS | {"term.Cm.qhat": Unknown(1.0, low=0.9, high=1.2)}
    )
    fit = flighttest.output_error(sim, flight(sim, 1), unknowns, list(NOISE), HELD)
    row = fit.estimates.sel(parameter="term.Cm.qhat")
    assert row["estimate"] == 0.9
    assert row["active"] == 1
    assert np.isnan(row["stderr"])
    assert "term.Cm.qhat is at its bound 0.9" in fit.report()


@pytest.mark.slow
def test_a_prior_pulls_by_its_weight(sim):
    record = flight(sim, 1)

    def with_prior(sigma):
        unknowns = {name: 1.0 for name in TRUTH} | STARTS | {"term.Cm.qhat": Unknown(1.0, sigma)}
        return flighttest.output_error(sim, record, unknowns, list(NOISE), HELD).estimates.sel(
            parameter="term.Cm.qhat"
        )

    free, weak, strong = with_prior(np.inf), with_prior(10.0), with_prior(1e-4)
    assert abs(weak["estimate"] - free["estimate"]) < 1e-2 * free["stderr"]
    assert abs(strong["estimate"] - 1.0) < 1e-2
    assert strong["stderr"] < 1.05e-4  # residuals of the value that the prior holds add to it


def test_the_inverse_information_is_the_covariance_when_residuals_are_white(sim):
    fit = flighttest.output_error(
        sim,
        flight(sim, 4, duration=30.0),
        {name: 1.0 for name in TRUTH} | STARTS,
        list(NOISE),
        HELD,
    )
    ratio = fit.estimates["stderr"] / fit.estimates["stderr_white"]
    assert (abs(ratio - 1.0) < 0.25).all()  # the colour of 30 s is itself an estimate


def test_coloured_residuals_widen_the_errors(sim):
    record = flight(sim, 5, duration=30.0, colour=0.7)
    fit = flighttest.output_error(
        sim, record, {name: 1.0 for name in TRUTH} | STARTS, list(NOISE), HELD
    )
    ratio = (fit.estimates["stderr"] / fit.estimates["stderr_white"]).sel(parameter=list(TRUTH))
    assert float(ratio.median()) > 1.6
    assert np.abs(errors(fit)).max() < 3.0


def test_readings_that_are_missing_do_not_count(sim):
    record = flight(sim, 6)
    record["theta"][100:160] = np.nan
    fit = flighttest.output_error(
        sim, record, {name: 1.0 for name in TRUTH} | STARTS, list(NOISE), HELD
    )
    assert np.abs(errors(fit)).max() < 3.0
    assert int(np.isnan(fit.residuals[0]["theta"]).sum()) == 60


def test_error_free_readings_give_the_truth_to_rounding(sim, monkeypatch):
    for name in NOISE:
        monkeypatch.setitem(NOISE, name, 0.0)
    fit = flighttest.output_error(
        sim, flight(sim, 1), {name: 1.0 for name in TRUTH} | STARTS, list(NOISE), HELD
    )
    found = fit.estimates["estimate"].sel(parameter=list(TRUTH)).values
    assert np.allclose(found, list(TRUTH.values()), rtol=1e-6)
    assert fit.warnings == ()


def test_slopes_flown_with_the_response_change_nothing_but_the_number_of_batches(sim, monkeypatch):
    """Two instruments among the unknowns, one factor and one constant, whose slopes are not
    flown.
    """
    record = flight(sim, 7, alpha_bias=0.01)
    unknowns = {name: 1.0 for name in TRUTH} | STARTS | {"sensor.alpha": 0.0, "factor.q": 1.0}
    batches: list[int] = []
    fly = time_domain.fly_batch

    def counted(*args, values, **options):
        batches.append(len(values))
        return fly(*args, values=values, **options)

    monkeypatch.setattr(time_domain, "fly_batch", counted)
    ahead = flighttest.output_error(sim, record, unknowns, list(NOISE), HELD).estimates
    together, batches[:] = list(batches), []
    monkeypatch.setattr(time_domain.SimulatedRecord, "expect", lambda *_: None)
    apart = flighttest.output_error(sim, record, unknowns, list(NOISE), HELD).estimates
    assert ahead.identical(apart)
    n, flown = ahead.attrs["iterations"], len(TRUTH) + len(STARTS)
    assert together == [1 + flown] * n + [1 + 2 * flown]
    assert batches == [1, flown] * n + [1, 2 * flown]


def test_what_cannot_be_determined_is_refused_by_name(sim):
    record = flight(sim, 1)
    unknowns = {"term.Cm.elevator": 1.0, **STARTS}
    with pytest.raises(
        IdentificationError,
        match=r"0\.71 \w+\.Cm\.elevator - 0\.71 \w+\.Cm\.elevator.*changes no output",
    ):
        flighttest.output_error(
            sim, record, unknowns | {"table.Cm.elevator": 1.0}, list(NOISE), HELD
        )
    with pytest.raises(IdentificationError, match=r"no output responds to bias\.delta_r"):
        flighttest.output_error(sim, record, unknowns | {"bias.delta_r": 0.0}, list(NOISE), HELD)
    with pytest.raises(UnknownName, match=r"sensor\.beta"):
        flighttest.output_error(sim, record, unknowns | {"sensor.beta": 0.0}, list(NOISE), HELD)
    with pytest.raises(UnknownName, match="unknown measured output 'ax'"):
        flighttest.output_error(sim, record, unknowns, ["ax"], HELD)
    with pytest.raises(
        SchemaError,
        match=r"init\.beta has no start.*\n.*term\.CL\.basic starts at 3, bounds 0 \.\.\. 2",
    ):
        flighttest.output_error(
            sim,
            record,
            {"init.beta": Unknown(None), "term.CL.basic": Unknown(3.0, low=0.0, high=2.0)},
            list(NOISE),
            HELD,
        )
    with pytest.raises(SchemaError, match="time is not uniform"):
        flighttest.output_error(
            sim,
            record.isel(time=[0, 1, 2, 4, 5, 6, 7, 8, 9, 10, 11, 12]),
            unknowns,
            list(NOISE),
            HELD,
        )
