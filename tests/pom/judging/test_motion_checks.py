"""Channels of a record that contradict each other by kinematics."""

import sys
from pathlib import Path

import numpy as np
import pytest

from flightmech.units import DEGREE, G0
from pom.judging.motion_checks import motion_remarks
from pom.judging.signals import signals_of_run

sys.path.insert(0, str(Path(__file__).parents[1]))
import report_fixture as fixture

TIME = np.arange(0.0, 20.0, 0.02)
THETA = 5.0 * DEGREE * np.sin(0.8 * TIME)
CLIMB = 6.0 * np.cos(0.4 * TIME)
ZERO = 0.0 * TIME


def texts(clock=1.0, **changes):
    """Return the departures of a pitching flight; `clock` is the rate of a wrong clock."""
    channels = {
        "phi": ZERO,
        "theta": THETA,
        "psi": 1.0 + ZERO,
        "p": ZERO,
        # with the bias of a gyro
        "q": 4.0 * DEGREE * np.cos(0.8 * TIME) + 0.05 * DEGREE,
        "r": ZERO,
        "h": 1000.0 + 15.0 * np.sin(0.4 * TIME),
        "vd": -CLIMB,
        "nz": 1.0 + 0.1 * np.sin(0.8 * TIME),
        "az": -G0 * (1.0 + 0.1 * np.sin(0.8 * TIME)),
        **changes,
    }
    case = fixture.roll_result().case
    return [
        item.text for item in motion_remarks(case, signals_of_run(case, channels, TIME * clock))
    ]


def test_a_consistent_flight_with_noise_has_no_remark():
    noise = np.random.default_rng(1).standard_normal(TIME.size)
    assert texts() == []
    assert texts(theta=THETA + 0.05 * DEGREE * noise, nz=1.0 + ZERO, az=-G0 + 0.1 * noise) == []


@pytest.mark.parametrize(
    ("changes", "words"),
    [
        ({"q": 3.4 * DEGREE * np.cos(0.8 * TIME)}, "pitch attitude and the rates"),
        ({"theta": np.where(TIME < 4.0, THETA, THETA[200])}, "pitch attitude and the rates"),
        ({"nz": 0.95 + ZERO, "az": -G0 + ZERO}, "and the normal acceleration"),
    ],
)
def test_a_wrong_gain_and_a_held_channel_are_departures(changes, words):
    (text,) = texts(**changes)
    assert text.startswith("departure: ")
    assert words in text


def test_a_fast_clock_contradicts_attitude_and_height():
    attitude, height = texts(clock=1.05)
    assert "pitch attitude" in attitude
    assert "vertical speed" in height
    assert "% of the motion" in height


def test_channels_with_missing_samples_are_not_compared():
    assert texts(q=np.where(TIME < 1.0, np.nan, 0.0)) == []
