"""An aeroplane below its runway is named in the attributes of a run; the T-37 lies on its skids."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import xarray as xr

import flightmech
from flightmech.terms import make_term

DATA = Path(__file__).parents[3] / "data" / "t37"
TIME = np.arange(0.0, 10.0, 0.02)
# 3 m over the runway, gear in, too slow to fly
LOW = {"init.V": 60.0, "init.h": 103.0, "env.runway_elevation": 100.0, "mode.engine": 2.0}


@pytest.fixture(scope="module", params=["aircraft.toml", "apriori.toml"])
def t37(request):
    return flightmech.read_aircraft(DATA / request.param)


def compile_with_little_lift(aircraft):
    """Return the model of an aircraft with a database in which it sinks."""
    leaves = {
        "/CL/basic": make_term(0.3),
        "/CL/alpha": make_term(4.0, regressors=["alpha"]),
        "/CD/basic": make_term(0.05),
        "/CY/beta": make_term(-0.6, regressors=["beta"]),
        "/Cl/beta": make_term(-0.08, regressors=["beta"]),
        "/Cl/phat": make_term(-0.45, regressors=["phat"]),
        "/Cm/alpha": make_term(-0.8, regressors=["alpha"]),
        "/Cm/qhat": make_term(-14.0, regressors=["qhat"]),
        "/Cn/beta": make_term(0.1, regressors=["beta"]),
        "/Cn/rhat": make_term(-0.14, regressors=["rhat"]),
    }
    return flightmech.compile(aircraft, xr.DataTree.from_dict(leaves))


def sink(aircraft, outputs=None, **start):
    """Return a run with the gear in, from low height."""
    model = compile_with_little_lift(aircraft)
    inputs = xr.Dataset({"gear": ("time", 0.0 * TIME)}, {"time": TIME})
    return flightmech.simulate(model, inputs, {**LOW, **start}, outputs=outputs)


def without_skids(aircraft):
    contacts = tuple(c for c in aircraft.gear.contacts if c.friction == 0.0)
    return replace(aircraft, gear=replace(aircraft.gear, contacts=contacts))


@pytest.mark.slow
@pytest.mark.parametrize("phi", [0.0, 0.3, -0.3])
def test_t37_with_its_gear_in_lies_on_belly_and_wing_tips(t37, phi):
    found = sink(t37, **{"init.phi": phi})
    assert found.attrs["below_runway"] == ""
    # c.g. 0.2235 m below the moment reference, belly 0.13 m below the c.g.
    assert 0.0 < float(found["h"].min()) - 100.0 < 0.3
    assert abs(float(found["phi"][-1])) < np.radians(10.0)
    on_skids = sum(float(found[f"wow_belly_{end}"].max()) for end in ("front", "rear"))
    assert on_skids == 2.0


def test_without_skids_it_sinks_through_and_the_run_states_it(t37):
    found = sink(without_skids(t37))
    depth = 100.0 - float(found["h"].min())
    assert depth > 1.0
    first = TIME[(found["h"].values < 100.0).argmax()]
    assert found.attrs["below_runway"].startswith(
        f"c.g. below the runway from {first:.1f} s on, by up to {depth:.2g} m; give the aircraft "
        f"contacts that touch"
    )


@pytest.mark.slow
def test_the_finding_does_not_depend_on_the_outputs(t37):
    every, one = sink(without_skids(t37)), sink(without_skids(t37), outputs=["V"])
    assert list(one) == ["V"]
    assert one.attrs["below_runway"] == every.attrs["below_runway"] != ""
    assert (one["V"].values == every["V"].values).all()


@pytest.mark.slow
def test_closed_loop_states_it_too(t37):
    model = compile_with_little_lift(without_skids(t37))
    inputs = xr.Dataset({"gear": ("time", 0.0 * TIME)}, {"time": TIME})
    found = flightmech.simulate_closed_loop(
        model, inputs, lambda time, outputs, inputs: {"delta_e": 0.0}, 0.02, parameters=LOW
    )
    assert found.attrs["below_runway"].startswith("c.g. below the runway from ")
