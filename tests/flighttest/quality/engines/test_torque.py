"""Torques in another unit, of another shaft or of two engines."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

import flightmech
from flightmech.aircraft.engine import list_leaves
from flightmech.terms import evaluate_term
from flighttest.reconstruction.quality.checks.signals import ResampledChannels
from flighttest.reconstruction.quality.engines.torque import torque_findings

TIME = np.arange(0.0, 60.0, 0.05)
NAMES = ("engine1.torque", "engine2.torque")


@pytest.fixture(scope="module")
def aircraft():
    return flightmech.read_aircraft(Path(__file__).parents[4] / "data/commuter/aircraft.toml")


def signals(aircraft, factor):
    """Return a flight at several powers whose torques are those of the charts times a factor."""
    noise = np.random.default_rng(3).normal(size=TIME.size)
    n1 = 0.8 + 0.15 * np.sin(0.2 * TIME)
    mach, pressure = np.full(TIME.size, 0.2), np.full(TIME.size, 85e3)
    at = {"n1": n1, "mach": mach, "pressure_ratio": pressure / 101325.0}
    power = evaluate_term(list_leaves(aircraft.engines[0])["shaft_power"], at)
    torque = factor * power / 178.0 + 20.0 * noise
    values = {"mach": mach, "p_static": pressure, "temperature": np.full(TIME.size, 280.0)}
    for number in (1, 2):
        values |= {
            f"engine{number}.n1": n1,
            f"engine{number}.rpm": np.full(TIME.size, 178.0),
            f"engine{number}.torque": torque,
        }
    good = {name: np.ones(TIME.size, bool) for name in values}
    return ResampledChannels(TIME, values, good, flying=np.ones(TIME.size, bool), step=0.05)


@pytest.mark.parametrize(
    ("factor", "kind", "words"),
    [
        (0.7376, "unit", "lbf ft taken as N m"),
        (1.3558, "unit", "N m taken as lbf ft"),
        (8.851, "unit", "lbf in taken as N m"),
        (2.0, "scale", "2 engines in place of one"),
        (0.5, "scale", "charts of 2 engines in place of one"),
    ],
)
def test_a_torque_of_another_unit_or_shaft(aircraft, factor, kind, words):
    findings, unchecked = torque_findings(signals(aircraft, factor), aircraft)
    assert [(finding.severity, finding.kind) for finding in findings] == 2 * [("warning", kind)]
    assert [finding.channels for finding in findings] == [(name,) for name in NAMES]
    assert words in findings[0].text
    assert findings[0].evidence["ratio"] == pytest.approx(factor, rel=0.01)
    assert unchecked == []


def test_a_torque_in_front_of_the_gearbox(aircraft):
    geared = []
    for engine in aircraft.engines:
        geared.append(replace(engine, propeller=replace(engine.propeller, gear_ratio=17.0)))
    geared = replace(aircraft, engines=tuple(geared))
    findings, _ = torque_findings(signals(aircraft, 1.0 / 17.0), geared)
    assert "in front of the gearbox" in findings[0].text


@pytest.mark.parametrize("factor", [0.88, 1.0, 1.12])
def test_a_model_error_of_the_charts_is_no_mistake(aircraft, factor):
    assert torque_findings(signals(aircraft, factor), aircraft) == ([], [])


def test_the_mach_number_is_formed_from_the_airspeed(aircraft):
    flown = signals(aircraft, 0.7376)
    speed = 0.2 * np.sqrt(1.4 * 287.05287 * flown["temperature"])
    flown.good["V"] = np.ones(TIME.size, bool)
    findings, unchecked = torque_findings(
        flown.with_values({"V": speed}).without({"mach"}), aircraft
    )
    assert [finding.kind for finding in findings] == ["unit", "unit"]
    assert unchecked == []


def test_an_engine_that_is_stopped_shows_nothing(aircraft):
    flown = signals(aircraft, 1.0)
    stopped = {"engine1.n1": np.full(TIME.size, 0.12), "engine1.torque": np.full(TIME.size, 3.0)}
    findings, unchecked = torque_findings(flown.with_values(stopped), aircraft)
    assert findings == []
    assert [row[2] for row in unchecked] == [NAMES[:1]]


def test_a_record_without_the_axes_of_the_charts(aircraft):
    flown = signals(aircraft, 0.7376)
    short = flown.without({"engine1.n1", "engine2.n1"})
    findings, unchecked = torque_findings(short, aircraft)
    assert findings == []
    assert [row[2] for row in unchecked] == [NAMES]
