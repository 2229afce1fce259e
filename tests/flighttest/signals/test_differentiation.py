import numpy as np
import pytest

from flightmech.errors import IdentificationError
from flighttest.records.signals.differentiation import derivative, derivative_gain, derivative_noise

STEP = 0.02


def test_a_quartic_is_differentiated_exactly_ends_included():
    t = np.arange(40) * STEP
    x = 1.0 - 2.0 * t + 3.0 * t**2 - t**3 + 0.5 * t**4
    exact = -2.0 + 6.0 * t - 3.0 * t**2 + 2.0 * t**3
    np.testing.assert_allclose(
        derivative(x, STEP), exact, atol=1e-10
    )  # order four fits it; rounding of x/step remains


def test_the_gain_formula_is_what_happens_to_a_sine():
    t, f = np.arange(400) * STEP, 3.0
    rate = derivative(np.sin(2 * np.pi * f * t), STEP)[20:-20]
    cosine = np.cos(2 * np.pi * f * t)[20:-20]
    amplitude = rate @ cosine / (cosine @ cosine) / (2 * np.pi * f)
    assert amplitude == pytest.approx(float(derivative_gain(f, STEP)), abs=1e-6)


def test_the_noise_formula_is_the_scatter_of_differentiated_noise():
    noise = np.random.default_rng(1).normal(size=200_000)
    assert np.std(derivative(noise, STEP)) == pytest.approx(
        derivative_noise(STEP), rel=0.01
    )  # 1/sqrt(2 N/9) is 0.5 %


def test_too_few_samples_are_refused():
    with pytest.raises(
        IdentificationError, match="8 samples cannot be differentiated over a window of 9"
    ):
        derivative(np.zeros(8), STEP)
