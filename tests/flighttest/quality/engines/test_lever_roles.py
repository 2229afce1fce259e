"""Power lever and propeller lever of one engine that were exchanged."""

import numpy as np
import pytest

from flighttest.reconstruction.quality.checks.signals import ResampledChannels
from flighttest.reconstruction.quality.engines.lever_roles import role_findings

TIME = np.arange(0.0, 120.0, 0.05)
POWER = 0.7 + 0.2 * np.sign(np.sin(TIME / 7.0))
SPEED = 230.0 + 2.0 * np.sin(TIME)
PRESSURE = 20e3 + 70e3 * POWER


def signals(**channels):
    values = {f"engine1.{name}": x for name, x in channels.items()}
    good = {name: np.ones(TIME.shape, bool) for name in values}
    return ResampledChannels(TIME, values, good, np.ones(TIME.shape, bool), 0.05)


def test_exchanged_levers_are_named():
    steady = np.full(TIME.shape, 0.9)
    (finding,) = role_findings(
        signals(throttle=steady, prop_command=POWER, rpm=SPEED, manifold_pressure=PRESSURE)
    )
    assert finding.name == "column:engine1.throttle+engine1.prop_command"
    assert "manifold_pressure follows engine1.prop_command (correlation 0.99" in finding.text


@pytest.mark.parametrize("lever", [POWER, np.full(TIME.shape, 0.9)])
def test_levers_in_their_places(lever):
    # the propeller lever stands still, or both move together
    flown = signals(throttle=POWER, prop_command=lever, rpm=SPEED, manifold_pressure=PRESSURE)
    assert role_findings(flown) == []


def test_a_propeller_lever_that_moves_alone():
    # a faster propeller burns more fuel at a lower manifold pressure
    steady = np.full(TIME.shape, 0.7)
    flown = signals(
        throttle=steady,
        prop_command=POWER,
        rpm=150.0 + 80.0 * POWER,
        fuel_flow=0.01 * POWER,
        manifold_pressure=80e3 - 30e3 * POWER,
    )
    assert role_findings(flown) == []
