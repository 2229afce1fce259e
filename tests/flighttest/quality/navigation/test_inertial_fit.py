"""Delay, scale and drift of a channel fitted together against an integral."""

import numpy as np
import pytest

from flighttest.reconstruction.quality.navigation.inertial_fit import fit_inertial

STEP, SECONDS = 0.05, 120.0
TIME = np.arange(0.0, SECONDS, STEP)
# a velocity with accelerations of several periods, m/s
SPEED = 20.0 * np.sin(0.13 * TIME) + 4.0 * np.sin(0.7 * TIME + 1.0)


def fitted(channel, mask=None, stretch=30.0):
    mask = np.ones_like(TIME, bool) if mask is None else mask
    # the reference drifts as the integral of a biased and slowly changing accelerometer does
    reference = SPEED + 7.0 + 0.05 * TIME + 2e-4 * TIME**2
    return fit_inertial(channel, (reference,), mask=mask, step=STEP, stretch=stretch, longest=4.0)


@pytest.mark.parametrize("delay", [-1.2, 0.0, 0.17, 2.3])
def test_delay_and_scale_in_spite_of_drift_and_noise(delay):
    noise = np.random.default_rng(2).normal(0.0, 0.1, len(TIME))
    fit = fitted(1.04 * np.interp(TIME - delay, TIME, SPEED) + noise)
    assert not fit.bound
    assert abs(fit.delay - delay) < max(3.0 * fit.stderr, 0.01)
    assert abs(fit.scales[0] - 1.04) < max(3.0 * fit.errors[0], 0.005)
    assert fit.stderr < 0.05
    assert fit.explained > 0.99


def test_delay_beyond_the_search_is_a_bound():
    fit = fitted(np.interp(TIME - 4.6, TIME, SPEED))
    assert fit.bound
    assert np.isinf(fit.stderr)


def test_a_record_that_is_too_short_gives_nothing():
    assert fitted(SPEED, mask=TIME < 5.0) is None
