import numpy as np
import pytest

import flighttest
from flightmech.errors import IdentificationError
from flighttest.records.signals.differentiation import (
    derivative_gain,
    derivative_window,
    fourier_smooth,
)

STEP = 0.02
TIME = np.arange(3001) * STEP
MOTION = (
    0.05 * np.sin(2.0 * TIME) * np.exp(-0.02 * TIME)
    + 0.03 * np.sin(5.3 * TIME + 1.0)
    + 0.002 * TIME
)
RATE = np.gradient(MOTION, STEP)


def test_noise_is_found_and_taken_out():
    sizes, errors = [], []
    for seed in range(20):
        found = fourier_smooth(
            MOTION + 0.002 * np.random.default_rng(seed).normal(size=len(TIME)), STEP
        )
        sizes.append(found.noise)
        errors.append(np.std(found.value - MOTION))
    # a pure tone at 0.6 of the cut-off loses 4.5 % of its 0.021 rms, which counts as noise: 0.00222
    assert np.mean(sizes) == pytest.approx(0.00222, rel=0.03)
    assert np.max(errors) < 0.0016  # of the noise of 0.002; 0.001 of it is the tone


def test_derivative_is_better_than_that_of_five_points():
    noisy = MOTION + 0.002 * np.random.default_rng(0).normal(size=len(TIME))
    inside = slice(50, -50)
    smooth = np.std((fourier_smooth(noisy, STEP).derivative - RATE)[inside])
    five = np.std((flighttest.signals.derivative(noisy, STEP, window=5, order=2) - RATE)[inside])
    assert smooth < 0.5 * five


def test_cutoff_lies_between_motion_and_half_the_rate():
    found = fourier_smooth(MOTION + 0.002 * np.random.default_rng(1).normal(size=len(TIME)), STEP)
    assert 5.3 / (2 * np.pi) < found.cutoff < 5.0


def test_noise_free_channel_stays():
    found = fourier_smooth(MOTION, STEP)
    np.testing.assert_allclose(
        found.value[20:-20], MOTION[20:-20], atol=2e-5
    )  # 1/2500 of the motion


def test_too_short_or_nan():
    with pytest.raises(IdentificationError, match="20 samples, 1 of them NaN"):
        fourier_smooth(np.append(np.zeros(19), np.nan), STEP)


def test_window_of_the_derivative_is_the_longest_that_follows():
    window = derivative_window(2.0, STEP)
    assert window == 11
    assert (
        float(derivative_gain(2.0, STEP, window))
        >= 0.99
        > float(derivative_gain(2.0, STEP, window + 2))
    )


def test_no_window_follows():
    with pytest.raises(IdentificationError, match="shortest window of order 4 has a gain of"):
        derivative_window(20.0, STEP)


def test_smooth_leaves_controls_and_scalars():
    import xarray as xr

    data = xr.Dataset(
        {
            "q": ("time", np.sin(2 * np.pi * 12.0 * TIME)),
            "delta_e": ("time", np.sin(2 * np.pi * 12.0 * TIME)),
            "mass": 5.0,
        },
        coords={"time": TIME},
    )
    plain, both = flighttest.signals.smooth(data), flighttest.signals.smooth(data, controls=True)
    inside = slice(100, -100)
    assert (
        np.abs(plain["q"].values[inside]).max() < 0.01
    )  # two octaves of eight poles and a doubled pass: 2^-8
    np.testing.assert_array_equal(plain["delta_e"], data["delta_e"])
    assert np.abs(both["delta_e"].values[inside]).max() < 0.01
    assert float(both["mass"]) == 5.0
    assert plain.attrs["smoothed"] == 6.0
