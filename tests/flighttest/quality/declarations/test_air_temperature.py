"""Temperatures that no day has at the height of the flight, and a mass of zero."""

from pathlib import Path

import pytest

import flighttest
from flighttest.reconstruction.quality.checks.samples import faults_of
from flighttest.reconstruction.quality.checks.signals import resample_channels
from flighttest.reconstruction.quality.declarations.air_temperature import (
    explain_by_fahrenheit,
    temperature_findings,
)
from flighttest.reconstruction.quality.finding import Finding

T37 = Path(__file__).parents[4] / "data" / "t37"


@pytest.fixture(scope="module")
def flight():
    path = T37 / "flight" / "t37_21_val_short_period_full_flaps_gear_down.nc"
    return flighttest.read(path, T37 / "names.toml")


def judged(record, change):
    record = record.copy(deep=True)
    values = record["air_data/temperature"].values
    values[:] = change(values)
    return temperature_findings(resample_channels(record, faults_of(record)), record)


@pytest.mark.slow
@pytest.mark.parametrize("warmer", [-70.0, 0.0, 20.0])
def test_temperatures_of_this_planet(flight, warmer):
    assert judged(flight, lambda T: T + warmer) == []


def test_fahrenheit_taken_as_celsius(flight):
    (finding,) = judged(flight, lambda T: 1.8 * (T - 273.15) + 32.0 + 273.15)
    assert (finding.severity, finding.name) == ("warning", "unit:temperature")
    assert "in degF" in finding.text
    assert 'unit = "degF"' in finding.remedy or "scale" in finding.remedy


@pytest.mark.slow
@pytest.mark.parametrize(("scale", "kind"), [(1.0615, "unit"), (1.02, "scale"), (0.94, "scale")])
def test_scale_of_the_airspeed_that_fahrenheit_explains(flight, scale, kind):
    """At 2.1 degC, 35.8 degF, an airspeed of the root of the temperature is 1.059 of the true
    one.
    """
    record = flight.copy(deep=True)
    values = record["air_data/temperature"].values
    values[:] = 273.15 + 1.8 * (values - values.mean() + 2.1) + 32.0
    signals = resample_channels(record, faults_of(record)).without(("V",))
    evidence = {"slope": scale, "stderr": 0.002}
    found = Finding("warning", "scale", ("V_cas",), "text", evidence=evidence)
    (finding,) = explain_by_fahrenheit([found], signals, record)
    assert finding.kind == kind
    assert ("in degF" in finding.text) == (kind == "unit")


def test_temperature_of_something_else(flight):
    (finding,) = judged(flight, lambda T: T + 90.0)
    assert "degF" not in finding.text


@pytest.mark.slow
def test_mass_of_zero(flight):
    record = flight.copy(deep=True)
    record["mass/mass"].values[:] = 0.0
    found = flighttest.assess(record).findings
    assert "range:mass" in [one.name for one in found if one.severity == "error"]
