"""Minimum control speed and linear model of aircraft with propellers."""

from __future__ import annotations

import numpy as np
import pytest
import xarray as xr

import flightmech
from flightmech import air
from flightmech.aircraft import Engine, Propeller
from flightmech.flying_qualities import lateral
from flightmech.steady_flight.trim_point import Point, trimmed_at
from flightmech.terms import make_term

D, RATED = 1.9, 280.0
J = [0.0, 1.2]
BLADES = {
    "CT_prop": make_term([0.1, -0.045], {"J": J}),
    "CP_prop": make_term([0.06, -0.02], {"J": J}),
}


def make_two_engined(make_aircraft, make_tree, **limits: tuple[float, float]) -> Point:
    """Return level flight of an aircraft with two propellers at 1.5 m from the centre line."""
    power = make_term([0.0, 2e5], {"throttle": [0.0, 1.0]})
    oblique = {
        "CN_prop": make_term([0.08, 0.08], {"J": J}),
        "CM_prop": make_term([0.03, 0.03], {"J": J}),
    }
    tables = BLADES | {"shaft_power": power} | oblique
    blades = Propeller(tables, diameter=D, inertia=2.0, rpm_high=RATED)
    engines = tuple(Engine((0.0, y, 0.0), propeller=blades) for y in (-1.5, 1.5))
    limits = dict.fromkeys(("delta_e", "delta_a", "delta_r"), (-0.4, 0.4)) | limits
    craft = make_aircraft(
        engines=engines, mass=1800.0, limits=limits, cg=(0.0, 0.0, 0.0), Ixy=0.0, Ixz=0.0, Iyz=0.0
    )
    leaves = {
        "CL/basic": make_term([-0.6, 1.4], {"alpha": [-0.2, 0.2]}),
        "CD/basic": make_term(0.035),
        "Cm/basic": make_term([0.2, -0.2], {"alpha": [-0.2, 0.2]}),
        "Cm/elevator": make_term(-1.2, regressors=["delta_e"]),
        "CY/beta": make_term(-0.5, regressors=["beta"]),
        "Cn/beta": make_term(0.1, regressors=["beta"]),
        "Cn/rudder": make_term(-0.03, regressors=["delta_r"]),
        "Cl/beta": make_term(-0.1, regressors=["beta"]),
        "Cl/aileron": make_term(-0.1, regressors=["delta_a"]),
    }
    return trimmed_at(craft, make_tree(leaves), {"V": 55.0, "h": 1000.0})


@pytest.mark.slow
def test_minimum_control_speed_counts_the_windmilling_propeller(make_aircraft, make_tree):
    """Moments by hand at the speed found: thrust, drag, torque and P-factor; the rudder is full."""
    level = make_two_engined(make_aircraft, make_tree)
    craft = level.aircraft
    (row,) = lateral.minimum_control_speed(level, 30.0)
    assert "windmills without power" in row.remark
    failed = int(row.remark.split()[1]) - 1
    bank = np.radians(5.0) * (1.0 if failed == 0 else -1.0)
    fixed = {f"engine{failed + 1}.failed": 1.0, f"engine{2 - failed}.throttle": 1.0, "phi": bank}
    start = {"init.V": row.value, "init.h": 1000.0, "mode.engine": 0.0, "mode.earth": 0.0}
    flown = flightmech.trim(level.sim, start, kind="engine_out", fixed=fixed)
    y = {str(name): float(x) for name, x in flown.items() if x.ndim == 0}
    T = [y["engine1.thrust"], y["engine2.thrust"]]
    assert T[failed] < 0.0 < T[1 - failed]
    assert max(abs(y["applied.delta_r"]), abs(y["applied.delta_a"])) == pytest.approx(0.4, rel=1e-3)
    # force in the disk and P-factor of each propeller, per sine of the angle of attack [N, N m]
    rho, climb = float(air.atmosphere(1000.0).rho), np.sin(y["alpha"]) * np.cos(y["beta"])
    n = np.array([y["engine1.rpm"], y["engine2.rpm"]]) / (2.0 * np.pi)
    disk, turn = 0.08 * rho * n**2 * D**4, 0.03 * rho * n**2 * D**5
    qSb = y["qbar"] * craft.S * craft.b
    yaw = 0.1 * y["beta"] - 0.03 * y["applied.delta_r"]
    assert turn.sum() * climb > 0.05 * abs(qSb * yaw)
    assert qSb * yaw == pytest.approx(1.5 * (T[1] - T[0]) + turn.sum() * climb, rel=1e-3)
    torque = y["engine1.torque"] + y["engine2.torque"]
    roll = -0.1 * y["beta"] - 0.1 * y["applied.delta_a"]
    assert qSb * roll == pytest.approx(torque + 1.5 * (disk[1] - disk[0]) * climb, rel=1e-3)


@pytest.mark.slow
def test_speeds_without_trim_are_stated(make_aircraft, make_tree):
    """An elevator of 4 deg does not carry the aircraft below 47 m/s, the rudder is enough."""
    limits = {"delta_e": (-0.07, 0.4), "delta_r": (-1.05, 1.05)}
    level = make_two_engined(make_aircraft, make_tree, **limits)
    flown = [lateral._fly_on_one_engine(level, V, 0) for V in (35.0, 44.0, 50.0)]
    assert flown[0] == (np.inf, "")  # both elevator and rudder at the stop
    assert flown[1].obstacle == "delta_e at the limit"
    assert flown[1].share == pytest.approx(0.49, abs=0.01)
    assert flown[2] == (pytest.approx(0.308, abs=0.005), "")
    (row,) = lateral.minimum_control_speed(level, 44.0)
    assert "at all speeds at which the flight trims" in row.absent
    assert "; not trimmed up to 46.06 m/s: delta_e at the limit" in row.absent


@pytest.mark.parametrize("stopped", ["alpha delta_r", "delta_r", "delta_a delta_e"])
def test_a_flight_that_does_not_trim_with_a_full_rudder_is_not_controllable(
    make_aircraft, make_tree, monkeypatch, stopped
):
    level = make_two_engined(make_aircraft, make_tree)
    applied = {"applied.delta_a": 0.1, "applied.delta_r": 0.4}
    ended = xr.Dataset(applied, attrs={"converged": 0, "at_limit": stopped})
    monkeypatch.setattr(lateral, "find_trim", lambda *args, **kwargs: ended)
    assert lateral._fly_on_one_engine(level, 44.0, 0).share == np.inf


def test_speed_is_a_state_of_the_linear_model(make_aircraft, make_tree):
    """The slope of the shaft by hand: w' = (P/w - Q) / I over the speed of the propeller."""
    blades = Propeller(
        BLADES | {"shaft_power": make_term([0.0, 9e4], {"throttle": [0.0, 1.0]})},
        diameter=D,
        inertia=2.0,
        rpm_high=RATED,
    )
    craft = make_aircraft(engines=(Engine((0.0, 0.0, 0.0), propeller=blades),))
    sim = flightmech.compile(craft, make_tree({"CD/basic": make_term(0.0)}))
    linear = flightmech.linearize(
        sim,
        {"init.V": 50.0, "init.h": 1000.0, "mode.trim": 0.0, "engine1.throttle": 0.6},
        states=("V", "engine1.rpm"),
        inputs=("engine1.throttle",),
        outputs=("engine1.thrust",),
    )
    w = float(linear["x"].sel(state="engine1.rpm"))
    rho, n = float(air.atmosphere(1000.0).rho), w / (2.0 * np.pi)
    slope = -0.08 / 1.2
    # Q = (0.06 n^2 + slope n V/D) rho D^5 / (2 pi)
    dQ = (2.0 * 0.06 * n + slope * 50.0 / D) * rho * D**5 / (2.0 * np.pi) ** 2
    expected = (-0.6 * 9e4 / w**2 - dQ) / 2.0
    A = linear["A"].sel(state="engine1.rpm")
    assert float(A.sel(state_="engine1.rpm")) == pytest.approx(expected, rel=1e-6)
    assert float(A.sel(state_="V")) == pytest.approx(
        -slope * n / D * rho * D**5 / (2.0 * np.pi) / 2.0, rel=1e-6
    )
    assert float(linear["B"].sel(state="engine1.rpm")[0]) == pytest.approx(9e4 / w / 2.0, rel=1e-6)
