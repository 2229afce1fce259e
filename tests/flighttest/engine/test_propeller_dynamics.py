"""Constants of governor, shaft and lever of a turboprop from a slam and a chop.

The truth is an Euler integration of our own of gas generator, shaft and blades; its propeller is a
formula, of which the product gets a table.
"""

from __future__ import annotations

import numpy as np
import pytest
import xarray as xr

import flightmech
from flightmech.air import atmosphere
from flightmech.aircraft import Engine, EngineDeck, Propeller
from flightmech.terms import make_term
from flighttest.submodels.engine.propellers.shaft_dynamics import identify_shaft

DIAMETER, SPEED, V, HEIGHT = 2.4, 190.0, 75.0, 1500.0
LOW, HIGH = np.radians(12.0), np.radians(42.0)
TRUTH = {
    "inertia": 9.0,
    "governor_gain": 0.03,
    "power_time": 0.35,
    "lever_delay": 0.25,
    "n1_up_time": 0.8,
    "n1_down_time": 1.1,
}
PRIOR = {
    "inertia": 11.0,
    "governor_gain": 0.02,
    "power_time": 0.5,
    "lever_delay": 0.15,
    "n1_up_time": 1.1,
    "n1_down_time": 0.8,
}
NOISE = {"rpm": 0.1, "torque": 5.0, "n1": 1e-3}


def taken(J, angle):
    """Return CP: linear in J and blade angle, so that a table has no error."""
    return 0.01 + 0.35 * angle - 0.08 * J


def turboprop(constants: dict[str, float]) -> Engine:
    """Return the engine with the equations of `power_change`."""
    J, angles = np.linspace(0.0, 3.0, 13), np.radians([12.0, 22.0, 32.0, 42.0])
    grid = {"J": J, "blade_angle": angles}
    CP = taken(J[:, None], angles[None, :])
    power = make_term([60e3, 300e3], {"n1": [0.5, 1.0]})
    CT = 0.05 + 0.18 * angles[None, :] - 0.11 * J[:, None]
    tables = {"CT_prop": make_term(CT, grid), "CP_prop": make_term(CP, grid), "shaft_power": power}
    propeller = Propeller(
        tables,
        DIAMETER,
        constants["inertia"],
        SPEED,
        low_pitch=LOW,
        high_pitch=HIGH,
        rpm_low=150.0,
        pitch_rate=2.0,
        governor_gain=constants["governor_gain"],
        power_time=constants["power_time"],
    )
    deck = EngineDeck(
        {
            "n1_command": make_term([0.5, 1.0], {"throttle": [0.0, 1.0]}),
            "n1_up_time": make_term(constants["n1_up_time"]),
            "n1_down_time": make_term(constants["n1_down_time"]),
            "thrust": make_term(0.0),
        },
        lever_delay=constants["lever_delay"],
    )
    return Engine((0.0, 0.0, 0.0), propeller=propeller, deck=deck)


def power_change(seed: int) -> xr.Dataset:
    """Integrate a slam and a chop; sampled at 10 Hz."""
    rng, dt, every = np.random.default_rng(seed), 0.004, 25
    air = atmosphere(HEIGHT)
    rho, sound = float(air.rho), float(air.a_sound)
    t = np.arange(-8.0, 16.0, dt)
    moves = np.array([(0.0, 0.3), (2.0, 0.3), (2.4, 0.9), (9.0, 0.9), (9.4, 0.3)]).T
    lever = np.interp(t, *moves)
    command = 0.5 + 0.5 * np.interp(t - TRUTH["lever_delay"], *moves)
    n1, w, angle, rows = command[0], SPEED, np.radians(25.0), []
    power = 60e3 + 240e3 * (n1 - 0.5) / 0.5
    for k in range(len(t)):
        if t[k] >= -1e-9 and k % every == 0:
            rows.append((t[k], lever[k], w, power / w, n1))
        J = V * 2.0 * np.pi / (w * DIAMETER)
        load = taken(J, angle) * rho * (w / (2.0 * np.pi)) ** 2 * DIAMETER**5 / (2.0 * np.pi)
        lag = TRUTH["n1_up_time"] if command[k] > n1 else TRUTH["n1_down_time"]
        wanted = 60e3 + 240e3 * (n1 - 0.5) / 0.5
        turn = TRUTH["governor_gain"] * (w - SPEED)
        w, power, n1, angle = (
            w + dt * (power / w - load) / TRUTH["inertia"],
            power + dt * (wanted - power) / TRUTH["power_time"],
            n1 + dt * (command[k] - n1) / lag,
            min(max(angle + dt * turn, LOW), HIGH),
        )
    time, lever, w, torque, n1 = np.array(rows).T
    truth = {"rpm": w, "torque": torque, "n1": n1}
    columns = {name: x + NOISE[name] * rng.standard_normal(len(x)) for name, x in truth.items()}
    columns |= {"throttle": lever, "mach": 0.0 * w + V / sound, "h": 0.0 * w + HEIGHT}
    return xr.Dataset({name: ("time", x) for name, x in columns.items()}, {"time": time})


@pytest.fixture(scope="module")
def found():
    engine = turboprop(PRIOR)
    craft = flightmech.Aircraft("one", 25.0, 2.0, 14.0, 4000.0, 1e4, 1e4, 1e4, engines=(engine,))
    return identify_shaft([power_change(1)], craft)


@pytest.mark.parametrize("name", list(TRUTH))
def test_constants_come_back(found, name):
    assert not found.remarks
    value, stderr = found.values[name]
    # the last two are factors of tables
    true = TRUTH[name] / PRIOR[name] if name.startswith("n1_") else TRUTH[name]
    assert found.determined[name]
    assert abs(value - true) < max(3.0 * stderr, 0.03 * true), (value, stderr, true)


def test_a_speed_that_nothing_commands_stays_a_priori(found):
    """The lever of the propeller does not move: its lower speed is not an unknown."""
    assert "rpm_low" not in found.values
    assert set(found.constants()) <= {*TRUTH, "pitch_rate", "rpm_high"}
