"""Innovations are tested for whiteness, and coloured ones are a remark of the fit."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.signal import butter, lfilter, sosfiltfilt

from flighttest.maximum_likelihood.innovations import whiteness_remarks, whiteness_variables
from flighttest.maximum_likelihood.linear.innovation_likelihood import InnovationLikelihood
from flighttest.maximum_likelihood.unknowns import Unknown, lay_out


def innovations(seed, pole):
    rng = np.random.default_rng(seed)
    v = rng.standard_normal((2, 500, 2))
    v[:, :, 1] = lfilter([1.0], [1.0, -pole], v[:, :, 1], axis=1)
    return list(v)


def examined(seed, pole):
    found = whiteness_variables(innovations(seed, pole), [0.04, 0.04])
    return found.assign_coords(output=["alpha", "q"])


@pytest.mark.nightly
def test_white_innovations_are_rarely_called_coloured():
    alarms = sum(len(whiteness_remarks(examined(seed, 0.0), True)) for seed in range(200))
    # One record in a hundred is expected: with more than seven the test is wrong (P < 0.001).
    assert alarms <= 7


def test_coloured_innovations_are_named_with_their_correlation():
    for seed in range(20):
        found = examined(seed, 0.25)
        (remark,) = whiteness_remarks(found, True)
        assert remark.term == "q"
        assert remark.value < remark.threshold == pytest.approx(0.005)
        # The standard deviation of the autocorrelation is 0.03 with 1000 samples.
        assert found["correlation"].sel(output="q").values[0] == pytest.approx(0.25, abs=0.13)


def test_a_strong_colour_forbids_the_figures_of_a_filter_alone():
    strong, weak = examined(1, 0.8), examined(1, 0.25)
    severities = []
    for noise, is_filtered in ((strong, True), (strong, False), (weak, True)):
        (remark,) = whiteness_remarks(noise, is_filtered)
        severities.append(remark.severity)
    assert severities == ["error", "warning", "warning"]


def test_readings_that_a_recorder_smoothed_are_named_as_the_cause():
    """White noise has second differences that are correlated by -4/6."""
    rng = np.random.default_rng(2)
    readings = rng.standard_normal((2, 500, 2))
    readings[:, :, 1] = sosfiltfilt(butter(4, 0.08, output="sos"), readings[:, :, 1], axis=1)
    found = whiteness_variables(innovations(3, 0.8), [0.1, 0.1], list(readings))
    found = found.assign_coords(output=["alpha", "q"])
    np.testing.assert_allclose(found["smoothness"][0], -2.0 / 3.0, atol=0.05)
    assert found["smoothness"][1] > 0.9
    (remark,) = whiteness_remarks(found, True)
    assert "the recorder filtered or interpolated them" in remark.text
    assert "use output error" in remark.text
    rough = found.assign(smoothness=("output", [-0.67, -0.6]))
    (remark,) = whiteness_remarks(rough, True)
    assert "recorder" not in remark.text


@pytest.mark.slow
def test_the_band_is_that_of_bartlett():
    found = examined(1, 0.0)
    assert float(found["band"]) == pytest.approx(1.96 / np.sqrt(1000.0))
    outside = [float(examined(seed, 0.0)["outside"].mean()) for seed in range(50)]
    assert np.mean(outside) == pytest.approx(0.05, abs=0.015)


@pytest.mark.parametrize("variance", [0.04, -0.04])
def test_only_a_positive_definite_covariance_has_a_cost(variance):
    """The determinant of two negative variances is positive, and the search would accept them."""
    e, S = np.zeros((500, 2)), np.diag([variance, variance])[None]

    class Piece:
        def predict(self, _):
            return e, S

    layout = lay_out({"M_q": Unknown(0.0)}, [{}])
    likelihood = InnovationLikelihood([Piece()], layout)
    cost = likelihood.cost(layout.start, likelihood.residuals(layout.start))
    assert cost == (pytest.approx(500.0 * np.log(0.04)) if variance > 0.0 else np.inf)
