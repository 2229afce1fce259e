"""Two flights in a file, with a gap of the clock between them and without a position."""

import numpy as np
import pytest
import xarray as xr

from flighttest.reconstruction.quality.checks.samples import faults_of
from flighttest.reconstruction.quality.recording.gap_jumps import gap_jumps

CLOCK = np.arange(0.0, 120.0, 0.05)


def record(gap, **later):
    """Return a record with a gap of the clock [s], and jumps of its channels across it."""
    time = np.where(CLOCK > 60.0, CLOCK + gap, CLOCK)
    noise = np.random.default_rng(2).normal(size=(6, time.size))
    flow = {"mass": -0.1, "fuel": -0.1, "fuel_used": 0.1, "h_baro": 2.0, "V": 0.1, "p": 0.0}
    levels = {"mass": 2000.0, "fuel": 400.0, "fuel_used": 100.0, "h_baro": 1500.0, "V": 80.0}
    channels = {}
    for k, (name, rate) in enumerate(flow.items()):
        x = levels.get(name, 0.0) + rate * time + 0.3 * noise[k]
        channels[name] = "time", x + later.get(name, 0.0) * (CLOCK > 60.0)
    data = xr.Dataset(channels, {"time": time}, {"rate": 20.0})
    return xr.DataTree.from_dict({"/all": data})


@pytest.mark.parametrize(
    ("gap", "later"),
    [
        (2.0, {"mass": 40.0}),
        (2.0, {"mass": -60.0}),
        (120.0, {"mass": 90.0, "fuel": 90.0}),
        (2.0, {"fuel_used": -60.0}),
        (1.0, {"h_baro": -2000.0}),
        (1.0, {"V": 250.0}),
    ],
)
def test_a_second_flight_behind_a_gap(gap, later):
    flown = record(gap, **later)
    (finding,) = gap_jumps(flown, faults_of(flown))
    assert (finding.severity, finding.kind) == ("warning", "gap")
    assert finding.channels == tuple(later)
    assert "another flight begins there" in finding.text
    assert ("fuel was taken" in finding.text) == (not {"h_baro", "V"} & set(later))
    assert finding.start == pytest.approx(60.0, abs=0.1)


@pytest.mark.parametrize("gap", [0.0, 2.0, 120.0])
def test_one_flight_goes_on(gap):
    flown = record(gap)
    assert gap_jumps(flown, faults_of(flown)) == []


def test_a_climb_in_a_long_gap_is_one_flight():
    flown = record(120.0, h_baro=3000.0, V=60.0, mass=-20.0)
    assert gap_jumps(flown, faults_of(flown)) == []


def test_full_power_in_a_gap_between_two_glides_is_one_flight():
    """The recorder stands still in the climb back: 8 times the flow of idle on both sides."""
    burnt = 7.0 * 0.1 * 600.0
    flown = record(600.0, mass=-burnt, fuel_used=burnt)
    assert gap_jumps(flown, faults_of(flown)) == []
    # the same fuel more on board is another flight, or fuel was taken
    filled = record(600.0, mass=burnt)
    assert [finding.channels for finding in gap_jumps(filled, faults_of(filled))] == [("mass",)]
