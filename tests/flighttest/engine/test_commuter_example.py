"""Charts and engines of the example with two turboprops against the equations of its aeroplane."""

from __future__ import annotations

import sys
from pathlib import Path

import numpy as np
import pytest
import xarray as xr

import flightmech
from flighttest.reconstruction.dynamics.propeller_loads import with_engine_channels

COMMUTER = Path(__file__).parents[3] / "data" / "commuter"


@pytest.fixture(scope="module")
def aeroplane():
    sys.path.insert(0, str(COMMUTER))
    try:
        import aeroplane  # the truth of the example, next to its files
    finally:
        sys.path.remove(str(COMMUTER))
    return aeroplane


@pytest.fixture(scope="module")
def craft():
    return flightmech.read_aircraft(COMMUTER / "aircraft.toml")


def test_thrust_of_torque_and_speed_is_that_of_the_aeroplane(aeroplane, craft):
    """Climb, cruise, approach, windmilling: CT is 2 % too high, and CP 2 % too low adds as much."""
    density = aeroplane.air(1800.0)[2]
    rpm, truth = 178.0, []
    cases = [(62.0, 0.50), (80.0, 0.58), (92.0, 0.62), (75.0, 0.45), (70.0, 0.4225)]
    unit = density * (rpm / (2.0 * np.pi)) ** 2 * aeroplane.D**4
    torques = []
    for V, angle in cases:
        CT, CP = aeroplane.coefficients(V / (rpm / (2.0 * np.pi) * aeroplane.D), angle)
        truth.append(CT * unit)
        torques.append(CP * unit * aeroplane.D / (2.0 * np.pi))
    count = len(cases)
    columns = {"V": [V for V, _ in cases], "h": np.full(count, 1800.0)}
    columns["temperature"] = np.full(count, aeroplane.air(1800.0)[1])
    columns["p_static"] = np.full(count, aeroplane.air(1800.0)[0])
    for number in (1, 2):
        columns[f"engine{number}.rpm"] = np.full(count, rpm)
        columns[f"engine{number}.torque"] = torques
    states = xr.Dataset(
        {name: ("time", np.asarray(x)) for name, x in columns.items()},
        {"time": 100.0 * np.arange(count)},
    )
    found = with_engine_channels(states, craft)
    for number in (1, 2):
        error = found[f"engine{number}.thrust"].values - np.array(truth)
        assert np.abs(error).max() < 0.06 * np.max(truth)
    assert truth[-1] < 0.0
    assert max(torques) > 2000.0


def test_power_of_the_chart_is_two_percent_too_high(aeroplane, craft):
    leaf = craft.engines[0].propeller.tables["shaft_power"]
    for h, n1, mach in ((0.0, 1.0, 0.0), (2000.0, 0.85, 0.3), (4000.0, 0.75, 0.3)):
        p, _, density, _ = aeroplane.air(h)
        at = {"n1": n1, "pressure_ratio": p / aeroplane.P0, "mach": mach}
        found = float(leaf["value"].interp(at))
        assert found == pytest.approx(1.02 * aeroplane.engine_power(n1, mach, density), rel=2e-3)
