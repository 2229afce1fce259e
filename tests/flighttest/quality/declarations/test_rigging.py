"""Recorded surfaces that contradict the gearing or the stops of the aircraft file."""

from types import SimpleNamespace

import numpy as np
import pytest

from flighttest.reconstruction.quality.checks.signals import ResampledChannels
from flighttest.reconstruction.quality.declarations.rigging import past_stops, rigging_findings

TIME = np.arange(0.0, 20.0, 0.05)
WHEEL = 0.5 * np.sin(TIME)
GEARING = -0.35


def judged(delta_a, wheel=WHEEL, stop=0.35):
    aircraft = SimpleNamespace(
        controls={"delta_a": SimpleNamespace(gearing=GEARING)}, limits={"delta_a": (-stop, stop)}
    )
    values = {"delta_a": delta_a}
    if wheel is not None:
        values["wheel"] = wheel
    good = {name: np.ones(TIME.size, bool) for name in values}
    flying = np.zeros(TIME.size, bool)  # a control check is made on the ground
    signals = ResampledChannels(TIME, values, good=good, flying=flying, step=0.05)
    return rigging_findings(signals, aircraft)


@pytest.mark.parametrize("gain", [0.85, 1.0, 1.15])
def test_stretch_of_cables_and_a_bias_are_usual(gain):
    assert judged(gain * GEARING * WHEEL + 0.01) == []


@pytest.mark.parametrize("gain", [0.5, 1.5])
def test_a_gain_contradicts_the_gearing(gain):
    (finding,) = judged(gain * GEARING * WHEEL)
    assert (finding.severity, finding.name) == ("warning", "scale:delta_a+wheel")
    assert f"{gain:.2f} of the gearing" in finding.text
    assert "[control.delta_a]" in finding.remedy


def test_controls_that_do_not_go_together_or_rest_show_no_gearing():
    assert judged(0.5 * GEARING * np.cos(TIME)) == []  # a quarter of a period late
    assert judged(-0.5 * GEARING * WHEEL) == []  # the wrong sign is a finding of its own
    assert judged(np.zeros(TIME.size)) == []


def test_a_position_of_0_to_1_taken_for_an_angle():
    flap = 0.5 + 0.5 * np.sin(TIME)
    text = past_stops("delta_f", flap, (0.0, np.radians(40.0)))
    assert text == (
        "delta_f reaches 57.3 deg, past its upper stop of 40 deg in [limits] of the aircraft file, "
        "1 rad: a position of 0 to 1; give it scale = '40 deg'"
    )
    assert past_stops("delta_f", np.radians(40.0) * flap, (0.0, np.radians(40.0))) == ""


def test_a_surface_past_its_stop():
    (finding,) = judged(0.5 * np.sin(TIME), wheel=None)
    assert finding.name == "scale:delta_a"
    assert "lower stop" in finding.text
    assert "upper stop" in finding.text
    # the accuracy of a pick-up at the stop
    assert judged(0.36 * np.sin(TIME), wheel=None) == []
