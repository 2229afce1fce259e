import numpy as np
import pytest
from scipy.linalg import toeplitz

from flighttest.regression.uncertainty.coloured_residuals import (
    coloured_covariance_of,
    estimate_disturbances,
)

STEP, SAMPLES = 0.01, 1000
TIME = STEP * np.arange(SAMPLES)
RISING = np.array(
    [6.0, -4.0, 1.0]
)  # autocovariance of second differences of white noise, as of accelerations from positions


def regressors(frequency):
    turn = 2.0 * np.pi * frequency * TIME
    return np.column_stack([np.ones(SAMPLES), np.sin(turn), np.cos(turn)])


def residual(X, seed):
    v = np.diff(np.random.default_rng(seed).normal(size=SAMPLES + 2), 2)
    return v - X @ np.linalg.lstsq(X, v, rcond=None)[0]


@pytest.mark.slow
@pytest.mark.parametrize("frequency", [4.0, 8.0])
def test_motion_faster_than_the_blocks_has_the_noise_of_its_frequency(frequency):
    """Noise that grows with the fourth power of the frequency; taken as white it makes standard
    errors nine to 24 times too large.
    """
    X = regressors(frequency)
    A = np.linalg.pinv(X)
    expected = np.sqrt(np.diag(A @ toeplitz(np.pad(RISING, (0, SAMPLES - 3))) @ A.T))
    found = [
        np.sqrt(
            np.diag(
                coloured_covariance_of(X, residual(X, seed), [slice(0, SAMPLES)], [STEP]).covariance
            )
        )
        for seed in range(10)
    ]
    ratio = np.sqrt(np.mean(np.square(found), axis=0)) / expected
    assert ((ratio[1:] > 0.8) & (ratio[1:] < 2.0)).all(), ratio


def test_slow_motion_leaves_the_blocks_as_they_are():
    X = regressors(0.5)
    assert estimate_disturbances(X, residual(X, 0), [slice(0, SAMPLES)], [STEP])[0].length == 8


def test_two_clocks_are_shortened_together():
    X, pieces = regressors(8.0), [slice(0, 500), slice(500, 1000)]
    found = estimate_disturbances(X, residual(X, 1), pieces, [STEP, STEP])
    assert [colour.length for colour in found] == [1, 1]
    assert coloured_covariance_of(X, residual(X, 1), pieces, [STEP, STEP]).covariance.shape == (
        3,
        3,
    )


@pytest.mark.parametrize("steps", [(0.01, 0.01), (0.001, 0.001), (0.001, 0.0014), (0.0004, 0.0006)])
def test_short_blocks_of_unlike_length_have_spectra_of_their_own(steps):
    """The same samples, taken for 700 and 1000 a second: fast motion shortens the blocks to one
    sample.
    """
    X, pieces = regressors(25.0), [slice(0, 500), slice(500, 1000)]
    one, other = estimate_disturbances(X, residual(X, 1), pieces, steps)
    assert (one.length, other.length) == (1, 1)
    assert (one.spectrum is other.spectrum) == (steps[0] == steps[1])
