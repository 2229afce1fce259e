"""The warning of turbulence: for a disturbance that several outputs share and the estimates feel,
not for the noise of instruments.
"""

from __future__ import annotations

import sys
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest
from scipy.signal import lfilter
from scipy.stats import chi2

sys.path.insert(0, str(Path(__file__).parent))
from test_filter_error import NOISE, OUTPUTS, STARTS, flight
from test_filter_error import model as model  # the fixture

from flightmech.errors import AeromatchWarning
from flighttest.maximum_likelihood.linear.output_error import linear_output_error
from flighttest.maximum_likelihood.residual_covariance import (
    CHANCE,
    effect_on_motion,
    innovation_coupling,
    turbulence_warnings,
)


def coloured(seed, time, size, duration=20.0):
    """A record in calm air: noise with a time constant [s] and a size, of each output its own."""
    record = flight(seed, duration=duration, noise=0.0)
    pole = np.exp(-0.04 / time)
    white = np.random.default_rng(seed).standard_normal((record.sizes["time"] + 500, 3))
    e = lfilter([np.sqrt(1.0 - pole**2)], [1.0, -pole], white, axis=0)[500:]
    return record.assign(
        {name: record[name] + size * NOISE[k] * e[:, k] for k, name in enumerate(OUTPUTS)}
    )


def test_independent_innovations_are_not_coupled_and_a_delayed_copy_is():
    e = np.random.default_rng(1).standard_normal((250, 3))
    assert innovation_coupling(e, 0.08).max() < 0.8  # 0.4 in the median
    e[2:, 1] += 0.5 * e[:-2, 0]
    found = innovation_coupling(e, 0.08)
    assert found[0, 1] > 1.5
    assert max(found[0, 2], found[1, 2]) < 1.0
    np.testing.assert_allclose(found, found.T)


def test_the_statistic_is_that_of_the_formula():
    """Haugh's sum over lags of -2 to 2, by hand."""
    x, y = np.random.default_rng(2).standard_normal((2, 20))
    total = sum(
        20.0**2
        * (x[max(0, k) : 20 + min(0, k)] @ y[max(0, -k) : 20 + min(0, -k)]) ** 2
        / (x @ x)
        / (y @ y)
        / (20 - abs(k))
        for k in range(-2, 3)
    )
    assert innovation_coupling(np.column_stack([x, y]), 0.15)[0, 1] == pytest.approx(
        total / chi2.isf(CHANCE, 5)
    )


def test_no_residual_and_few_blocks_are_no_coupling():
    e = np.random.default_rng(3).standard_normal((40, 1))
    assert not innovation_coupling(np.column_stack([e, 0.0 * e]), 0.08).any()
    assert not innovation_coupling(np.column_stack([e, e])[:15], 0.08).any()
    assert not innovation_coupling(e, 0.08).any()


def test_the_effect_of_one_scale_is_its_relative_standard_error():
    """y = theta x in two outputs and two manoeuvres; one reading is missing."""
    rng = np.random.default_rng(4)
    slopes = [x - x.mean(axis=0) for x in rng.standard_normal((2, 50, 2))]
    measured = [3.0 * x for x in slopes]
    found = SimpleNamespace(
        slopes=[x[:, :, None] for x in slopes],
        noise=np.array([[0.1, 4.0]] * 2),
        active=np.array([False]),
    )
    columns = [np.array([0])] * 2
    assert effect_on_motion(found, columns, np.array([[0.09]]), measured) == pytest.approx(0.1)
    measured[0][7, 1], found.slopes[0][7, 1] = np.nan, 0.0
    assert effect_on_motion(found, columns, np.array([[0.09]]), measured) == pytest.approx(
        0.1, rel=1e-3
    )


@pytest.mark.slow
@pytest.mark.parametrize(("time", "size"), [(0.3, 1.0), (1.0, 5.0), (3.0, 5.0), (1.0, 15.0)])
def test_coloured_noise_of_instruments_is_no_turbulence(model, time, size):
    """Up to 15 times the noise of the instruments, which shakes an estimate by 7 % of the motion:
    the standard errors hold it.
    """
    fit = linear_output_error(model, coloured(7, time, size), STARTS)
    assert fit.warnings == ()
    assert float(fit.noise["coupling"].max()) < 0.8
    assert (fit.noise["slow"] > 2.0 * fit.noise["fast"]).all()


def test_gusts_that_the_estimates_hardly_feel_are_not_warned_of(model):
    fit = linear_output_error(model, flight(3, gust=0.2), STARTS)
    assert float(fit.noise["coupling"].max()) > 1.0
    assert fit.noise.attrs["effect"] < 0.02
    assert fit.warnings == ()


def test_the_decision_does_not_move_with_the_last_bits(model):
    record = flight(3, gust=1.0)
    nearly = (
        record + 1e-12 * np.random.default_rng(0).standard_normal(record.sizes["time"]) * record
    )
    with pytest.warns(AeromatchWarning, match="moves the outputs through each estimate by"):
        one, other = (linear_output_error(model, each, STARTS).noise for each in (record, nearly))
    np.testing.assert_allclose(one["coupling"], other["coupling"], rtol=1e-6)
    assert one.attrs["effect"] == pytest.approx(other.attrs["effect"], rel=1e-6)
    assert turbulence_warnings(one) == turbulence_warnings(other) != ()
