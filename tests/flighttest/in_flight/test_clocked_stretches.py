"""Stretches of a stream on one clock: rates that are not whole, stated ones, coarse and late
stamps.
"""

import numpy as np
import pytest

from flightmech.errors import IdentificationError
from flighttest.in_flight.clocked_stretches import ClockedSamples


def divide(time, given=0.0, piece=40):
    """Clock, and the stretches as arrays of time."""
    clock = ClockedSamples(given=given)
    stretches = []
    rows = np.arange(len(time), dtype=float)[:, None]
    for first in range(0, len(time) + piece, piece):
        part = slice(first, first + piece)
        for is_new, times, _ in clock.divide(time[part], rows[part], final=first >= len(time)):
            if is_new:
                stretches.append([])
            stretches[-1] += times.tolist()
    return clock, stretches


@pytest.mark.slow
@pytest.mark.parametrize("digits", [2, 3, 12])
@pytest.mark.parametrize("rate", [10.0, 12.5, 29.97, 33.3, 50.4, 59.94])
def test_any_rate_is_one_stretch_for_minutes(rate, digits):
    time = np.round(np.arange(round(300.0 * rate)) / rate, digits)
    clock, stretches = divide(time)
    assert clock.step == pytest.approx(1.0 / rate, rel=0.002 if digits > 2 else 0.02)
    assert len(stretches) == 1
    assert len(stretches[0]) == len(time)
    assert clock.bridged == clock.gaps == clock.jumps == clock.repeated == 0


@pytest.mark.parametrize("rate", [48.0, 49.9, 51.0, 52.0])
def test_a_stated_rate_that_the_stamps_nearly_have_adds_up_to_no_gap(rate):
    time = np.round(np.arange(6000) / rate, 4)
    clock, stretches = divide(time, given=0.02)
    assert len(stretches) == 1
    assert clock.bridged == clock.repeated == 0
    # the stamps show their own rate
    assert clock.step == pytest.approx(1.0 / rate, rel=3e-4)
    with pytest.raises(IdentificationError, match="50 Hz is stated"):
        divide(np.arange(100) / 47.0, given=0.02)


def test_whole_and_stated_rates_are_exact_where_stamps_are_rounded():
    for rate, digits in ((60.0, 3), (60.0, 2), (64.0, 3), (30.0, 3), (100.0, 12)):
        time = np.round(np.arange(2000) / rate, digits)
        assert divide(time)[0].step == 1.0 / rate
    assert divide(np.round(np.arange(2000) / 59.94, 3), given=1.0 / 59.94)[0].step == 1.0 / 59.94
    assert divide(np.arange(2000) / 50.01)[0].step == pytest.approx(1.0 / 50.01, rel=1e-9)


def test_a_rate_that_drifts_is_followed():
    """From 49 to 51 Hz within two minutes."""
    time = np.cumsum(1.0 / np.linspace(49.0, 51.0, 6000))
    clock, stretches = divide(time)
    assert len(stretches) == 1
    assert clock.bridged == clock.repeated == 0


def test_late_stamps_continue_the_stretch():
    rng = np.random.default_rng(0)
    time = np.arange(6000) / 50.4 + rng.uniform(-0.2, 0.2, 6000) / 50.4
    clock, stretches = divide(time)
    assert len(stretches) == 1
    assert clock.bridged == clock.repeated == 0


@pytest.mark.parametrize("rate", [29.97, 50.0, 50.4])
def test_missing_samples_are_the_only_ones_that_are_filled(rate):
    time = np.arange(3000) / rate
    keep = np.ones(3000, bool)
    keep[[5, 500, 1000, 1001, 2000, 2001, 2002]] = False
    clock, stretches = divide(time[keep])
    assert clock.bridged == 7
    np.testing.assert_allclose(stretches[0], time, atol=0.1 / rate)
    keep[2500:2520] = False
    clock, stretches = divide(time[keep])
    assert (clock.gaps, len(stretches)) == (1, 2)
    back = np.concatenate([time[:1500], time[1500:] - 3.0])
    assert divide(back)[0].jumps == 1
    twice = np.repeat(time, np.where(np.arange(3000) % 300 == 7, 2, 1))
    assert divide(twice)[0].repeated == 10
