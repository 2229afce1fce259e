"""Filter error of the simulation: a glider in gusts, whose truth is known."""

from __future__ import annotations

import numpy as np
import pytest
import xarray as xr

import flightmech
import flighttest
from flightmech.errors import AeromatchWarning, SchemaError, UnknownName
from flightmech.simulation.run import constant_inputs, initialise_run
from flightmech.terms import make_term
from flighttest.maximum_likelihood import DrydenGust, Unknown, simulated_filter_error
from flighttest.maximum_likelihood.nonlinear.disturbances import choose_disturbances

ALPHA = np.linspace(-0.2, 0.4, 4)
STEP, SPEED = 0.05, 60.0
NOISE = {"alpha": 2e-3, "q": 1e-3, "az": 0.1}
FIXED = {"mode.earth": 0.0, "init.V": SPEED, "init.h": 1000.0, "init.theta": 0.02}
TRUTH = {"term.Cm.qhat": 1.0, "term.Cm.delta_e": 1.0}
GUST = DrydenGust("alpha", SPEED, 150.0, 1.0, air_relative=())


@pytest.fixture(scope="module")
def glider():
    leaves = {
        "/CL/basic": make_term(0.3 + 5.0 * ALPHA, {"alpha": ALPHA}),
        "/CD/basic": make_term(0.02 + 0.9 * ALPHA**2, {"alpha": ALPHA}),
        "/Cm/basic": make_term(0.018 - 0.9 * ALPHA, {"alpha": ALPHA}),
        "/Cm/qhat": make_term(-14.0, regressors=["qhat"]),
        "/Cm/delta_e": make_term(-1.2, regressors=["delta_e"]),
    }
    craft = flightmech.Aircraft("glider", 16.0, 1.5, 10.0, 900.0, 2000.0, 2500.0, 4000.0)
    return flightmech.compile(craft, xr.DataTree.from_dict(leaves))


def flown(sim, seed, duration=6.0, noise=1.0, size=1.0):
    """Return a doublet in a vertical gust: a lag of white noise, as a wind in short steps."""
    rng, fine = np.random.default_rng(seed), 5
    h = STEP / fine
    t = np.arange(0.0, duration + h / 2, h)
    u = np.tile(constant_inputs(sim, {}), (len(t), 1))
    places = [sim.inputs.index(name) for name in ("delta_e", "wind_d")]
    u[:, places[0]] = 0.04 * np.interp(t, [0.5, 0.6, 1.3, 1.5, 2.2, 2.3], [0, 1, 1, -1, -1, 0])
    gust, T = 0.0, 150.0 / SPEED
    for k in range(len(t)):
        u[k, places[1]] = -size * gust
        gust += -gust * h / T + np.sqrt(2.0 * h / T) * rng.standard_normal()
    y = initialise_run(sim, {**FIXED, "init.alpha": 0.02, "mode.step": h}, u[0])
    rows = y.run(t, u, hold=False)[::fine]
    columns = {"delta_e": ("time", u[::fine, places[0]])}
    for name, sigma in NOISE.items():
        z = rows[:, sim.outputs.index(name)]
        columns[name] = "time", z + noise * sigma * rng.standard_normal(len(z))
    return xr.Dataset(columns, {"time": t[::fine]})


def wanted():
    return {name: 0.9 * value for name, value in TRUTH.items()} | {"init.alpha": Unknown(0.02)}


@pytest.mark.slow
@pytest.mark.nightly
def test_gusts_that_ruin_output_error_cost_the_filter_little(glider):
    record = flown(glider, 3)
    unknowns = wanted() | {"gust.w": 0.5}
    fit = simulated_filter_error(glider, record, unknowns, list(NOISE), [GUST], FIXED)
    with pytest.warns(AeromatchWarning):
        open_loop = flighttest.output_error(glider, record, wanted(), list(NOISE), FIXED)
    truth = np.array(list(TRUTH.values()))
    errors = []
    for found in (fit, open_loop):
        e = found.estimates.sel(parameter=list(TRUTH))
        errors.append(np.abs(e["estimate"].values - truth))
    z = errors[0] / fit.estimates["stderr"].sel(parameter=list(TRUTH)).values
    assert fit.estimates.attrs["converged"]
    assert (z < 3.0).all()
    assert np.linalg.norm(errors[0]) < 0.5 * np.linalg.norm(errors[1])
    e = fit.estimates.sel(parameter="noise.q")
    assert float(e["estimate"]) == pytest.approx(1e-3, abs=3.0 * float(e["stderr"]))


@pytest.mark.nightly
def test_without_a_disturbance_it_is_output_error(glider):
    """The records do not need the gust, and a remark states it; a given gust stays."""
    record = flown(glider, 4, duration=3.0, size=0.0)
    unknowns = wanted() | {"gust.w": 0.5, "scale.w": 300.0}
    fit = simulated_filter_error(glider, record, unknowns, list(NOISE), [GUST], FIXED)
    calm = flighttest.output_error(glider, record, wanted(), list(NOISE), FIXED)
    xr.testing.assert_equal(fit.estimates["estimate"], calm.estimates["estimate"])
    xr.testing.assert_equal(fit.estimates["stderr"], calm.estimates["stderr"])
    notes = [remark for remark in fit.remarks if remark.kind == "disturbance"]
    assert [remark.severity for remark in notes] == ["note"]
    assert notes[0].text.startswith("no process noise is identified: without it the cost rises by")
    assert set(fit.noise) >= {"portmanteau_probability", "outside"}
    given = simulated_filter_error(
        glider, record, wanted(), list(NOISE), [GUST], FIXED, iterations=1
    )
    assert "init.gust_w" in given.estimates["parameter"].values


@pytest.mark.nightly
def test_constraints_hold_over_several_manoeuvres(glider):
    records = [flown(glider, seed, duration=3.0) for seed in (5, 6)]
    unknowns = wanted() | {"init.alpha": Unknown(0.02, own=True), "gust.w": 0.5}
    texts = ["term.Cm.qhat = 2*term.Cm.delta_e - 1"]
    fit = simulated_filter_error(
        glider, records, unknowns, list(NOISE), [GUST], FIXED, constraints=texts
    )
    values = dict(zip(fit.estimates["parameter"].values, fit.estimates["estimate"].values))
    expected = 2.0 * values["term.Cm.delta_e"] - 1.0
    assert values["term.Cm.qhat"] == pytest.approx(expected, abs=1e-12)
    assert {"init.gust_w@1", "init.gust_w@2", "init.alpha@1", "init.alpha@2"} <= set(values)
    e = fit.estimates.sel(parameter=list(TRUTH))
    assert (np.abs(e["estimate"] - list(TRUTH.values())) < 3.0 * e["stderr"]).all()
    assert float(e["stderr"][0]) == pytest.approx(2.0 * float(e["stderr"][1]))
    assert "constraints" in fit.estimates.attrs
    with pytest.raises(SchemaError, match="noise or a scale"):
        simulated_filter_error(
            glider, records, unknowns, list(NOISE), [GUST], FIXED, constraints=["gust.w = 1"]
        )


@pytest.mark.parametrize(
    ("unknowns", "gusts", "error", "text"),
    [
        ({}, [], SchemaError, "no disturbance"),
        ({"gust.v": 1.0}, [GUST], UnknownName, "gust.w"),
        ({"process.u": 1.0}, [], UnknownName, "process.q"),
        ({"process.q": 0.0}, [], SchemaError, "starts at zero"),
        ({}, [DrydenGust("q", SPEED, 150.0, 1.0, ())], SchemaError, "acts on q"),
        ({}, [DrydenGust("alpha", SPEED, -1.0, 1.0, ())], SchemaError, "scale of gust w is -1"),
        ({}, [DrydenGust("alpha", SPEED, 9.0, 1.0, (), ("az",))], SchemaError, "az of gust w"),
        ({}, [GUST, GUST], SchemaError, "own name"),
    ],
)
def test_a_wrong_disturbance_is_named(glider, unknowns, gusts, error, text):
    record = flown(glider, 1, duration=1.0)
    with pytest.raises(error, match=text):
        simulated_filter_error(glider, record, wanted() | unknowns, list(NOISE), gusts, FIXED)


def test_disturbances_follow_the_outputs():
    t = np.arange(50.0)
    names = ("V", "alpha", "q", "beta", "p", "r")
    record = xr.Dataset({name: ("time", 50.0 + np.sin(t + k)) for k, name in enumerate(names)})
    found = choose_disturbances("both", [record], ["az", "ay"], angle="inertial", scale=200.0)
    states = ("alpha", "q", "beta", "p", "r")
    assert set(found.unknowns) == {*(f"process.{name}" for name in states), "gust.w", "gust.v"}
    assert [gust.state for gust in found.gusts] == ["alpha", "beta"]
    assert found.gusts[0].speed == pytest.approx(50.0, abs=0.1)
    assert found.gusts[0].inertial == ("V", "alpha", "beta")
    assert "scale.w" in choose_disturbances("gusts", [record], ["q"], angle="vane").unknowns
    assert choose_disturbances("none", [record], ["h"]) == ({}, [])
    with pytest.raises(SchemaError, match="neither the longitudinal"):
        choose_disturbances("process", [record], ["h"])
    with pytest.raises(ValueError, match="gusts need it: vane, inertial"):
        choose_disturbances("gusts", [record], ["q"])
    with pytest.raises(UnknownName, match="record 1 does not hold it"):
        choose_disturbances("process", [record.drop_vars("q")], ["q"])
