"""Scale of a difference by ice, estimated from an iced flight of a simulated glider."""

import numpy as np
import pytest
import xarray as xr

import aerodb
import flightmech
import flighttest
from aerodb.edit.ice_file import IceDifference, IceFile
from flightmech.aircraft.controls import ICE
from flightmech.terms import make_term
from flighttest.maximum_likelihood.database_update import updated_database
from flighttest.maximum_likelihood.unknowns import Unknown

NOISE = {"V": 0.1, "alpha": 2e-3, "q": 1e-3, "theta": 1e-3, "az": 0.1}
HELD = {"mode.earth": 0.0, "init.h": 500.0, "init.q": 0.0}
STARTS = {name: Unknown(None, own=True) for name in ("init.V", "init.alpha", "init.theta")}
TRUE_SCALE = 1.6  # the elevator of this flight lost 1.6 times 12 %


@pytest.fixture(scope="module")
def iced():
    alpha = [-0.2, 0.0, 0.2, 0.4]
    leaves = {
        "CL/basic": make_term([-0.8, 0.3, 1.3, 1.5], {"alpha": alpha}, stderr=0.05),
        "CD/basic": make_term([0.05, 0.02, 0.08, 0.3], {"alpha": alpha}, stderr=0.01),
        "Cm/basic": make_term([0.2, 0.03, -0.15, -0.4], {"alpha": alpha}, stderr=0.02),
        "Cm/qhat": make_term(-14.0, regressors=["qhat"], stderr=3.0),
        "Cm/elevator": make_term(-1.2, regressors=["delta_e"], stderr=0.1),
    }
    box = {"S": 16.0, "cbar": 1.5, "b": 10.0, "x_ref": 0.0, "y_ref": 0.0, "z_ref": 0.0}
    clean = aerodb.make_database(
        leaves, title="glider", aircraft="glider", force_axes="stability", **box
    )
    elevator = IceDifference(factor=0.88, factor_stderr=0.05)
    ice = IceFile(
        title="tail ice", reference="NASA, 1993", valid="-", terms={"Cm/elevator": elevator}
    )
    return aerodb.edit.add_ice(clean, ice)


def test_flight_with_ice_determines_the_scale_of_the_difference(iced):
    craft = flightmech.Aircraft(
        "glider", S=16.0, cbar=1.5, b=10.0, mass=900.0, Ixx=2000.0, Iyy=2500.0, Izz=4000.0
    )
    sim = flightmech.compile(craft, iced)
    t = np.arange(0.0, 10.0, 0.04)
    doublet = 0.05 * (((t > 1) & (t < 2)) * 1.0 - ((t > 2) & (t < 3)))
    record = xr.Dataset({"delta_e": ("time", doublet), ICE: ("time", np.ones(t.size))}, {"time": t})
    start = {"init.V": 40.0, "init.alpha": 0.03, "init.theta": 0.0}
    true = {**HELD, **start, "term.Cm.elevator_ice": TRUE_SCALE}
    y = flightmech.simulate(sim, record, true, outputs=list(NOISE), step=0.04)
    rng = np.random.default_rng(7)
    for name, sigma in NOISE.items():
        record[name] = y[name] + sigma * rng.standard_normal(t.size)
    # the a-priori standard error of the scale: that of the factor, 0.05 of 0.12
    unknowns = {"term.Cm.elevator_ice": Unknown(1.0, sigma=0.05 / 0.12), **STARTS}
    fit = flighttest.output_error(sim, record, unknowns, list(NOISE), HELD)
    found = fit.estimates.sel(parameter="term.Cm.elevator_ice")
    assert float(found["stderr"]) < 0.1
    assert abs(float(found["estimate"]) - TRUE_SCALE) < 3.0 * float(found["stderr"])
    after, unplaced = updated_database(iced, fit)
    leaf = aerodb.terms(after)["Cm/elevator_ice"]
    assert float(leaf["value"]) == pytest.approx(0.144 * float(found["estimate"]), rel=1e-12)
    assert set(np.atleast_1d(leaf["source"].values)) == {1}
    xr.testing.assert_identical(
        aerodb.terms(after)["Cm/elevator"], aerodb.terms(iced)["Cm/elevator"]
    )
    assert not set(unplaced) & {"term.Cm.elevator_ice"}
