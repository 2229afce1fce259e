"""Thrust of a jet from its recorded N1 and the deck, against that of the simulation."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
import xarray as xr

import flightmech
from flightmech.aircraft import Engine
from flightmech.aircraft.propulsion.engine_deck import EngineDeck
from flightmech.errors import AeromatchWarning, UnknownName
from flightmech.terms import make_term
from flighttest.reconstruction.dynamics.loads import external_load
from flighttest.reconstruction.dynamics.propeller_loads import with_engine_channels

SPEEDS, MACHS = [0.3, 0.7, 1.1], [0.0, 0.5]
TABLES = {
    "n1_command": make_term([0.4, 1.0], {"throttle": [0.0, 1.0]}),
    "n1_up_time": make_term(0.8),
    "corrected_thrust": make_term(
        [[500.0, 300.0], [4000.0, 3500.0], [11e3, 9e3]], {"corrected_n1": SPEEDS, "mach": MACHS}
    ),
    "corrected_air_flow": make_term([10.0, 40.0], {"corrected_n1": [0.3, 1.1]}),
}
TIME = np.arange(0.0, 6.01, 0.02)
LEVER = np.interp(TIME, [0.0, 1.0, 1.5, 4.0, 4.2], [0.5, 0.5, 0.8, 0.8, 0.4])
AIR = ("V", "alpha", "beta", "qbar", "h", "p_static", "temperature", "rho", "a_sound")
MOTION = ("p", "q", "r", "p_dot", "q_dot", "r_dot", "ax", "ay", "az", "mass")


def jet(tables=TABLES, **changes) -> flightmech.Aircraft:
    deck = EngineDeck(tables, inlet=(1.5, 0.0, 0.3))
    parts = {"deck": deck, "time_constant": 0.3} | changes
    return flightmech.Aircraft(
        name="jet",
        S=22.0,
        cbar=1.9,
        b=12.5,
        mass=5000.0,
        Ixx=9800.0,
        Iyy=17000.0,
        Izz=25000.0,
        engines=tuple(Engine((-2.0, y, -0.4), **parts) for y in (-1.0, 1.0)),
        limits={"delta_e": (-0.4, 0.4)},
    )


@pytest.fixture(scope="module")
def flown() -> xr.Dataset:
    """Level flight with both levers up and down."""
    leaves = {
        "CL/basic": make_term([-0.8, 1.3], {"alpha": [-0.2, 0.2]}),
        "CD/basic": make_term(0.04),
        "Cm/basic": make_term([0.2, -0.2], {"alpha": [-0.2, 0.2]}),
        "Cm/q": make_term(-15.0, regressors=["qhat"]),
        "Cm/elevator": make_term(-1.2, regressors=["delta_e"]),
    }
    tree = xr.DataTree.from_dict({f"/{name}": leaf for name, leaf in leaves.items()})
    tree.attrs["force_axes"] = "stability"
    sim = flightmech.compile(jet(), tree)
    levers = {f"engine{i}.throttle": ("time", LEVER) for i in (1, 2)}
    start = {"init.V": 120.0, "init.h": 3000.0, "mode.trim": 1.0, "mode.engine": 0.0}
    return flightmech.simulate(sim, xr.Dataset(levers, {"time": TIME}), start)


def recorded(flown: xr.Dataset, *names: str) -> xr.Dataset:
    kept = [name for name in (*AIR, *MOTION) if name in flown]
    return flown[[*kept, *names]]


def test_thrust_and_ram_drag_of_the_recorded_speed(flown):
    found = with_engine_channels(recorded(flown, "engine1.n1", "engine2.n1"), jet())
    # the trim adds a thrust that no engine makes
    own = flown["engine1.thrust"] - flown["trim.thrust"]
    assert np.ptp(own.values) > 1000.0
    np.testing.assert_allclose(found["engine1.thrust"], own, atol=10.0)
    np.testing.assert_allclose(found["engine2.ram_drag"], flown["engine2.ram_drag"], rtol=1e-6)


def test_the_ram_drag_acts_against_the_airspeed_at_the_inlet(flown):
    """The load that is left is that of the air: neither thrust nor intake shows in it."""
    craft = jet()
    F, M = external_load(recorded(flown, "engine1.n1", "engine2.n1"), craft)
    al, de = flown["alpha"].values, flown["applied.delta_e"].values
    qbar_S = flown["qbar"].values * craft.S
    lift = F[:, 0] * np.sin(al) - F[:, 2] * np.cos(al)
    # the trim adds a thrust at both engines that no engine makes
    added = 2.0 * flown["trim.thrust"].values
    CL = (lift - added * np.sin(al)) / qbar_S
    np.testing.assert_allclose(CL, 0.25 + 5.25 * al, atol=1e-4)
    qhat = flown["q"].values * craft.cbar / (2.0 * flown["V"].values)
    Cm = (M[:, 1] + 0.4 * added) / (qbar_S * craft.cbar)
    np.testing.assert_allclose(Cm, -al - 15.0 * qhat - 1.2 * de, atol=2e-4)


def test_a_recorded_thrust_holds(flown):
    states = recorded(flown, "engine1.n1", "engine2.n1", "engine1.thrust", "engine2.thrust")
    assert with_engine_channels(states, jet()) is states


def test_an_engine_without_fuel_has_the_thrust_of_its_windmilling(flown):
    out = {"engine1.cutoff": ("time", (TIME > 3.0).astype(float))}
    states = recorded(flown, "engine1.n1", "engine2.n1").assign(out)
    tables = TABLES | {"windmill_thrust": make_term(-120.0)}
    # it runs down below the table of the thrust, which does not hold there: no warning
    states["engine1.n1"] = states["engine1.n1"].where(TIME <= 3.0, 0.05)
    found = with_engine_channels(states, jet(tables, time_constant=0.0))
    assert set(found["engine1.gross_thrust"].values[TIME > 3.01]) == {-120.0}
    assert found["engine2.gross_thrust"].values.min() > 500.0


def test_speeds_in_per_cent_are_named(flown):
    states = recorded(flown, "engine1.n1", "engine2.n1")
    states["engine1.n1"] = 100.0 * states["engine1.n1"]
    with pytest.warns(AeromatchWarning, match=r"engine 1: recorded corrected_n1 .* check the unit"):
        with_engine_channels(states, jet())


def test_a_variable_of_the_table_that_nobody_recorded_is_named(flown):
    states = recorded(flown, "engine1.n1", "engine2.n1")
    tables = TABLES | {
        "thrust": make_term([0.0, 9.0], {"pla": [0.0, 1.0]}),
    }
    with pytest.raises(
        UnknownName, match=r"variable of the table thrust .* 'pla'.* map its column"
    ):
        with_engine_channels(states, jet(tables))
    # without the speed the thrust stays unknown, as before
    assert with_engine_channels(recorded(flown), jet()).equals(recorded(flown))
    bare = replace(jet(), engines=(Engine((0.0, 0.0, 0.0)),))
    assert with_engine_channels(states, bare) is states
