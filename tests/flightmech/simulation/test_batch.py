"""Batches: equal to single runs, for any number of threads; contributions of the terms."""

from __future__ import annotations

import numpy as np
import pytest
import xarray as xr

import flightmech
from flightmech.errors import SchemaError, SimulationError, UnknownName
from flightmech.terms import make_term


@pytest.fixture(scope="module")
def sim() -> flightmech.SimModel:
    craft = flightmech.Aircraft(
        name="glider", S=16.0, cbar=1.5, b=10.0, mass=900.0, Ixx=2000.0, Iyy=2500.0, Izz=4000.0
    )
    alpha = [-0.2, 0.0, 0.2, 0.4]
    leaves = {
        "CL/basic": make_term([-0.8, 0.3, 1.3, 1.5], {"alpha": alpha}),
        "CL/alphadothat": make_term(1.5, regressors=["alphadothat"]),
        "CD/basic": make_term([0.05, 0.02, 0.08, 0.3], {"alpha": alpha}),
        "CY/beta": make_term(-0.5, regressors=["beta"]),
        "Cl/beta": make_term(-0.08, regressors=["beta"]),
        "Cl/phat": make_term(-0.45, regressors=["phat"]),
        "Cm/basic": make_term([0.2, 0.03, -0.15, -0.4], {"alpha": alpha}),
        "Cm/qhat": make_term(-14.0, regressors=["qhat"]),
        "Cm/elevator": make_term(-1.2, regressors=["delta_e"]),
        "Cn/beta": make_term(0.1, regressors=["beta"]),
        "Cn/rhat": make_term(-0.12, regressors=["rhat"]),
    }
    return flightmech.compile(
        craft, xr.DataTree.from_dict({f"/{name}": leaf for name, leaf in leaves.items()})
    )


@pytest.fixture(scope="module")
def record() -> xr.Dataset:
    t = np.arange(0.0, 4.0, 0.02)
    return xr.Dataset({"delta_e": ("time", np.where((t > 1) & (t < 2), -0.05, 0.0))}, {"time": t})


VARIED = {
    "node.Cm.basic[1]": [0.03, 0.05, 0.01],
    "mass.mass": [900.0, 950.0, 1000.0],
    "term.CL.basic": [1.0, 1.0, 1.05],
}
HELD = {"init.V": 40.0, "init.h": 500.0}


def test_a_batch_is_the_single_runs_whatever_the_threads(sim, record):
    batch = flightmech.simulate_batch(sim, record, VARIED, HELD, outputs=["theta", "h"])
    for run in range(3):
        one = flightmech.simulate(
            sim,
            record,
            HELD | {name: values[run] for name, values in VARIED.items()},
            outputs=["h", "theta"],
        )
        assert np.array_equal(batch["theta"][run], one["theta"])
        assert np.array_equal(batch["h"][run], one["h"])
    for threads in (1, 2, 7):
        again = flightmech.simulate_batch(
            sim, record, VARIED, HELD, outputs=["theta", "h"], threads=threads
        )
        assert np.array_equal(again["theta"], batch["theta"])
    assert float(abs(batch["theta"][1] - batch["theta"][0]).max()) > 1e-3


def test_a_failed_run_is_a_row_of_its_own(sim, record):
    varied = {"mass.mass": [900.0, -1.0, 900.0]}
    with pytest.raises(SimulationError, match=r"run 1: mass.mass is -1; it must be positive"):
        flightmech.simulate_batch(sim, record, varied, HELD)
    found = flightmech.simulate_batch(sim, record, varied, HELD, outputs=["V"], failed="nan")
    assert found["failure"].values.tolist() == ["", "mass.mass is -1; it must be positive", ""]
    assert np.isnan(found["V"][1]).all()
    assert np.isfinite(found["V"][[0, 2]]).all()


def test_wrong_batches_are_refused(sim, record):
    with pytest.raises(SchemaError, match=r"mass.mass 2, init.V 3"):
        flightmech.simulate_batch(sim, record, {"mass.mass": [1.0, 2.0], "init.V": [1.0, 2.0, 3.0]})
    with pytest.raises(SchemaError, match="lengths found: none"):
        flightmech.simulate_batch(sim, record, {})
    with pytest.raises(UnknownName, match=r"unknown output 'thta'; near it: .*theta"):
        flightmech.simulate_batch(sim, record, VARIED, outputs=["thta"])


def test_the_contributions_of_the_terms_sum_to_the_coefficients(sim, record):
    found = flightmech.simulate(sim, record, HELD, terms=True)
    for coefficient in ("CL", "CD", "CY", "Cl", "Cm", "Cn"):
        own = [name for name in sim.terms if name.startswith(coefficient + "/")]
        np.testing.assert_allclose(
            found["contribution"].sel(term=own).sum("term"),
            found[coefficient],
            rtol=1e-13,
            atol=1e-15,
        )
    rate = found["contribution"].sel(term="CL/alphadothat")
    np.testing.assert_allclose(
        rate, 1.5 * found["alpha_dot"] * 0.75 / found["V"], rtol=1e-12, atol=1e-16
    )
    assert float(abs(rate).max()) > 1e-3
