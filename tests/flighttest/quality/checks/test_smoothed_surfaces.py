"""Surfaces that the recorder smooths: a pitch motion in closed steps, with its elevator behind a
filter.
"""

from pathlib import Path

import numpy as np
import pytest
from scipy.signal import butter, lfilter

import flighttest
from flighttest.reconstruction.quality.checks.control_response import control_responses
from flighttest.reconstruction.quality.checks.samples import faults_of
from flighttest.reconstruction.quality.checks.signals import ResampledChannels, resample_channels
from flighttest.reconstruction.quality.finding import Finding, without_consequences
from flighttest.reconstruction.quality.recording.smoothed_surfaces import (
    smoothed_surfaces,
    smoothing_findings,
)

T37 = Path(__file__).parents[4] / "data" / "t37"
STEP = 0.05
TIME = np.arange(0.0, 120.0, STEP)


def fly():
    """Return elevator, pitch rate and angle of attack: a 3-2-1-1 every 15 s, and gusts."""
    fine, count = 0.005, 10
    time = np.arange(0.0, TIME[-1] + STEP, fine)
    within = time % 15.0
    edges = np.searchsorted([3.0, 5.1, 6.5, 7.2, 7.9], within)
    delta_e = 0.04 * np.array([0.0, 1.0, -1.0, 1.0, -1.0, 0.0])[edges]
    gust = 0.1 * np.random.default_rng(3).normal(size=time.size)
    q, alpha = np.zeros(time.size), np.zeros(time.size)
    for i in range(time.size - 1):
        q_dot = -1.5 * q[i] - 5.0 * alpha[i] - 8.0 * delta_e[i] + gust[i]
        q[i + 1] = q[i] + fine * q_dot
        alpha[i + 1] = alpha[i] + fine * (q[i] - 0.9 * alpha[i])
    return delta_e[::count], q[::count], alpha[::count]


@pytest.fixture(scope="module")
def flown():
    return fly()


def signals_of(flown, recorded):
    delta_e, q, alpha = (x[: TIME.size] for x in flown)
    values = {"delta_e": recorded(delta_e), "q": q, "alpha_vane": alpha}
    everywhere = np.ones(TIME.size, bool)
    return ResampledChannels(
        TIME, values, good=dict.fromkeys(values, everywhere), flying=everywhere, step=STEP
    )


def lowpass(cutoff, order=1):
    return lambda x: lfilter(*butter(order, cutoff, fs=1.0 / STEP), x)


def mean(count):
    return lambda x: lfilter(np.full(count, 1.0 / count), 1.0, x)


@pytest.mark.parametrize(
    ("recorded", "words"),
    [
        (lowpass(0.5), "a low-pass of 0.5 Hz (first order)"),
        (lowpass(0.3), "a low-pass of 0.3 Hz (first order)"),
        (lowpass(0.5, 2), "a low-pass of 0.5 Hz (second order)"),
        (mean(18), "a mean over 0.89 s"),
    ],
)
def test_a_smoothed_elevator(flown, recorded, words):
    found, alike = smoothed_surfaces(signals_of(flown, recorded))
    (finding,) = smoothing_findings(found)
    assert (finding.severity, finding.name) == ("warning", "smoothed:delta_e+q")
    assert words in finding.text
    assert "sign = -1" not in finding.remedy
    # behind the same filter the elevator acts as the true one does
    (row,) = control_responses(alike).itertuples()
    assert row.sign == -1
    assert row.effect == pytest.approx(-8.0, rel=0.15)


@pytest.mark.parametrize(
    "recorded",
    [
        lambda x: x,
        lambda x: -x,
        lambda x: np.concatenate([np.zeros(6), x[:-6]]),
        # an anti-alias filter of 5 Hz
        lowpass(5.0, 2),
    ],
)
def test_other_elevators_are_not_smoothed(flown, recorded):
    found, alike = smoothed_surfaces(signals_of(flown, recorded))
    assert found == []
    assert alike.values.keys() == {"delta_e", "q", "alpha_vane"}


def test_a_vane_with_a_lag_is_named_in_place_of_the_elevator():
    """Its equation explains the motion as well if the elevator is smoothed, but less of it."""
    record = flighttest.read(T37 / "flight" / "t37_03_clean_high_speed_5kft.nc", T37 / "names.toml")
    signals = resample_channels(record, faults_of(record))
    share = 1.0 - np.exp(-signals.step / 1.0)
    x = signals["alpha_vane"]
    behind, _ = lfilter([share], [1.0, share - 1.0], x, zi=[(1.0 - share) * x[0]])
    found, alike = smoothed_surfaces(signals.with_values({"alpha_vane": behind}))
    (finding,) = smoothing_findings(found)
    assert (finding.severity, finding.name) == ("warning", "smoothed:alpha_vane+q")
    assert 0.5 <= finding.evidence["lag"] <= 2.0
    assert finding.evidence["unexplained"] < 0.5 * finding.evidence["smoothed"]
    # the elevator passes through the same lag, the vane has already
    assert np.array_equal(alike["alpha_vane"], behind)
    assert np.ptp(alike["delta_e"]) < np.ptp(signals["delta_e"])


def test_smoothing_is_not_a_delay():
    lag = Finding("warning", "lag", ("delta_e", "q"), "late")
    smoothed = Finding("warning", "smoothed", ("delta_e", "q"), "smoothed")
    assert without_consequences([lag, smoothed]) == [smoothed]
