"""Levers that share samples, thrust of the wrong sign and unit, engines that push backwards."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import xarray as xr

import flightmech
import flighttest
from flightmech.units import POUND_FORCE
from flighttest.reconstruction.quality.checks.samples import faults_of
from flighttest.reconstruction.quality.checks.signals import resample_channels
from flighttest.reconstruction.quality.declarations.engines import (
    lever_findings,
    shaft_findings,
    thrust_findings,
)

T37 = Path(__file__).parents[4] / "data" / "t37"
THRUSTS = ("engine1.thrust", "engine2.thrust")


@pytest.fixture(scope="module")
def signals():
    record = flighttest.read(T37 / "flight" / "t37_24_val_power_slam.nc", T37 / "names.toml")
    return resample_channels(record, faults_of(record))


@pytest.fixture(scope="module")
def aircraft():
    return flightmech.read_aircraft(T37 / "aircraft.toml")


def scaled(signals, factor):
    return signals.with_values({name: factor * signals[name] for name in THRUSTS})


def test_thrust_as_it_is(signals, aircraft):
    findings, unchecked = thrust_findings(signals, aircraft)
    assert findings == []
    assert [row[0] for row in unchecked] == ["thrust_line", "engine_sides"]


@pytest.mark.parametrize(
    ("factor", "name", "words"),
    [
        (-1.0, "sign", "wrong sign"),
        (1.0 / POUND_FORCE, "unit", "in lbf and was taken as N"),
        (0.5, "scale", "one of two engines"),
    ],
)
def test_wrong_thrust(signals, aircraft, factor, name, words):
    (finding,), _ = thrust_findings(scaled(signals, factor), aircraft)
    assert finding.kind == name
    assert words in finding.text


def test_thrust_that_does_not_change_shows_nothing(signals, aircraft):
    steady = signals.with_values({name: np.full_like(signals.time, 2e3) for name in THRUSTS})
    findings, unchecked = thrust_findings(steady, aircraft)
    assert findings == []
    assert unchecked[0][0] == "thrust"


def test_engine_that_pushes_backwards(signals, aircraft):
    engine = replace(aircraft.engines[0], direction=(-1.0, 0.0, 0.0))
    turned = replace(aircraft, engines=(engine, aircraft.engines[1]))
    (finding,), _ = thrust_findings(signals, turned)
    assert (finding.severity, finding.name) == ("error", "sign:engine_direction")


@pytest.mark.parametrize(
    ("unmapped", "severity"), [("", "note"), ("controls/throttle_right, data/RPM", "warning")]
)
def test_one_lever_for_two_engines(signals, unmapped, severity):
    record = xr.DataTree(xr.Dataset(attrs={"unmapped": unmapped}))
    shared = signals.with_values({"engine2.throttle": signals["engine1.throttle"]})
    (finding,) = lever_findings(record, shared)
    assert finding.severity == severity
    assert lever_findings(record, signals) == []


@pytest.mark.parametrize(
    ("factor", "unit"), [(POUND_FORCE, "N"), (1.0 / POUND_FORCE, "lbf"), (1e-3, "kN")]
)
@pytest.mark.parametrize("name", THRUSTS)
def test_thrust_of_one_engine_in_another_unit(signals, aircraft, name, factor, unit):
    wrong = signals.with_values({name: factor * signals[name]})
    (finding,), _ = thrust_findings(wrong, aircraft)
    assert finding.name == f"unit:{name}"
    assert f"is in {unit} " in finding.text


@pytest.mark.slow
@pytest.mark.parametrize(("factor", "errors"), [(1.0, 0), (2.2, 2), (60.0 / (2.0 * np.pi), 2)])
def test_a_propeller_that_turns_faster_than_it_can(factor, errors):
    """Crankshaft or turbine for propeller, and rpm read as rad/s, of an aeroplane with two turboprops."""
    folder = T37.parent / "commuter"
    record = flighttest.read(folder / "flight" / "check_dutch_roll.csv", folder / "names.toml")
    signals = resample_channels(record, faults_of(record))
    fast = {name: factor * signals[name] for name in ("engine1.rpm", "engine2.rpm")}
    found, unchecked = shaft_findings(
        signals.with_values(fast), flightmech.read_aircraft(folder / "aircraft.toml")
    )
    assert [finding.name for finding in found] == [f"unit:{name}" for name in fast][:errors]
    assert [row[2] for row in unchecked] == [("engine1.torque", "engine2.torque")]
