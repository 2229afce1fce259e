"""Manifold pressures over the atmosphere, and weights that grow in flight."""

from types import SimpleNamespace

import numpy as np
import pytest

from flighttest.reconstruction.quality.checks.signals import ResampledChannels
from flighttest.reconstruction.quality.engines.usual_readings import (
    growing_findings,
    manifold_findings,
)

TIME = np.arange(0.0, 150.0, 0.05)
NOISE = np.random.default_rng(1).normal(size=TIME.size)


def signals(**values):
    values = {name.replace("__", "."): x for name, x in values.items()}
    good = {name: np.ones(TIME.size, bool) for name in values}
    return ResampledChannels(TIME, values, good, flying=np.ones(TIME.size, bool), step=0.05)


def test_manifold_pressure_of_gauge_and_absolute():
    pressure = 70e3 + 8e3 * np.sin(TIME)
    assert manifold_findings(signals(engine1__manifold_pressure=pressure)) == []
    gauge = signals(engine1__manifold_pressure=pressure - 101325.0)
    (finding,) = manifold_findings(gauge)
    assert (finding.severity, finding.name) == ("warning", "range:engine1.manifold_pressure")
    assert "gauge pressure" in finding.text
    assert '"29.92 inHg"' in finding.remedy
    # inHg that were taken as kPa are positive
    (finding,) = manifold_findings(signals(engine1__manifold_pressure=pressure / 33.8))
    assert "unit" in finding.remedy


def test_manifold_pressure_of_an_idling_engine_in_level_flight():
    pressure = 60e3 + 8e3 * np.sin(TIME)
    level, sinking = np.full(TIME.size, 1500.0), 1500.0 - 3.0 * TIME
    assert manifold_findings(signals(engine1__manifold_pressure=pressure, h_baro=level)) == []
    # psi that were taken as inHg
    pressure /= 2.036
    (finding,) = manifold_findings(signals(engine1__manifold_pressure=pressure, h_baro=level))
    assert finding.name == "unit:engine1.manifold_pressure"
    assert "is 29.5 kPa for half of the flight" in finding.text
    assert "as if psi were taken as inHg" in finding.text
    assert manifold_findings(signals(engine1__manifold_pressure=pressure, h_baro=sinking)) == []


AIRCRAFT = SimpleNamespace(mass=1040.0)


@pytest.mark.parametrize(("name", "change"), [("mass", 5.4), ("fuel", 5.4), ("fuel_used", -5.4)])
def test_weight_that_changes_the_wrong_way(name, change):
    amount = 500.0 + change * TIME / TIME[-1] + 0.3 * NOISE
    (finding,) = growing_findings(signals(**{name: amount}), AIRCRAFT)
    assert (finding.severity, finding.name) == ("warning", f"sign:{name}")
    burned = 500.0 - change * TIME / TIME[-1] + 0.3 * NOISE
    assert growing_findings(signals(**{name: burned}), AIRCRAFT) == []


def test_noise_a_constant_and_a_step_are_no_growth():
    assert growing_findings(signals(mass=np.full(TIME.size, 1040.0)), AIRCRAFT) == []
    assert growing_findings(signals(mass=1040.0 + 5.0 * NOISE), AIRCRAFT) == []
    step = np.where(TIME > 75.0, 1060.0, 1040.0)
    assert growing_findings(signals(mass=step), AIRCRAFT) == []
