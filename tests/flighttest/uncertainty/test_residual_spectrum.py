import importlib.util
from itertools import pairwise
from pathlib import Path

import numpy as np
import pytest
from flown_lift import coloured_noise
from scipy.linalg import toeplitz

from flighttest.regression.uncertainty import residual_spectrum as module
from flighttest.regression.uncertainty.coloured_residuals import (
    coloured_covariance_of,
    estimate_disturbances,
)
from flighttest.regression.uncertainty.residual_spectrum import (
    ROUGHNESS,
    UNKNOWN,
    Disturbance,
    RoofFunctions,
    SpectrumMaximum,
    residual_spectrum,
)


def residual(X, v):
    Q = np.linalg.qr(X)[0]
    return v - Q @ (Q.T @ v)


def slow_terms(samples):
    t = 0.08 * np.arange(samples)
    return np.stack([np.ones(samples), np.sin(0.5 * t), np.cos(0.5 * t), np.sin(1.1 * t)], axis=1)


@pytest.mark.nightly
def test_the_slow_part_that_a_fit_has_taken_up_is_found_again():
    """Memory of 1 s in 10 s, intercept and three slow regressors: the residual has lost most of the
    variance of its mean.
    """
    truth = Disturbance(
        np.array([-np.exp(-0.08)]), 1.0 - np.exp(-0.16)
    )  # 0.08 s per sample, variance one
    X = slow_terms(125)
    A = np.linalg.pinv(X)
    expected = (A @ toeplitz(truth.autocovariance(125)) @ A.T)[0, 0]
    found, naive = [], []
    for seed in range(60):
        v = residual(X, truth.sample(125, np.random.default_rng(seed)))
        r = residual_spectrum(X, v, [slice(0, 125)]).model.autocovariance(125)
        found.append((A @ toeplitz(r) @ A.T)[0, 0])
        windowed = np.array(
            [(v[: 125 - k] @ v[k:]) / 125 * max(0.0, 1 - k / 12) for k in range(125)]
        )
        naive.append((A @ toeplitz(windowed) @ A.T)[0, 0])
    assert np.median(found) > 0.35 * expected  # skewed: some of the sixty see hardly any slow part
    assert np.median(naive) < 0.6 * np.median(found)


@pytest.mark.parametrize("tau", [0.05, 0.3, 2.0])
def test_slopes_of_the_posterior_are_its_differences(tau):
    likelihood = module._Likelihood(
        slow_terms(200),
        residual(slow_terms(200), coloured_noise(np.random.default_rng(0), 200, tau)),
        [slice(0, 200)],
    )
    rng = np.random.default_rng(1)
    n = len(likelihood.knots)
    prior = np.diag(rng.uniform(0.1, 1.0, n))
    c = rng.normal(size=n) + 2.0  # hidden variance above one
    H, g = likelihood._derivatives(likelihood._evaluate(c, prior), prior)
    step = 1e-5 * np.eye(n)
    up, down = (
        [likelihood._evaluate(c + side * one, prior) for one in step] for side in (1.0, -1.0)
    )
    np.testing.assert_allclose(
        g, [(a.cost - b.cost) / 2e-5 for a, b in zip(up, down)], rtol=1e-5, atol=1e-6
    )
    slopes = [
        (likelihood._derivatives(a, prior)[1] - likelihood._derivatives(b, prior)[1]) / 2e-5
        for a, b in zip(up, down)
    ]
    np.testing.assert_allclose(H, slopes, rtol=1e-5, atol=1e-6)


@pytest.mark.nightly
@pytest.mark.parametrize("tau", [0.02, 0.3, 3.0])
@pytest.mark.parametrize("roughness", ROUGHNESS)
def test_every_start_leads_to_the_one_minimum(tau, roughness):
    """Forty starts over fifteen units of ln S, level, slope and scatter."""
    rng = np.random.default_rng(2)
    X = slow_terms(150)
    likelihood = module._Likelihood(X, residual(X, coloured_noise(rng, 150, tau)), [slice(0, 150)])
    n = len(likelihood.knots)
    best = likelihood.mode(np.zeros(n), roughness)
    for _ in range(40):
        start = (
            rng.normal(scale=4.0)
            + rng.normal(scale=5.0) * np.linspace(1.0, -1.0, n)
            + rng.normal(scale=2.0, size=n)
        )
        found = likelihood.mode(start, roughness)
        np.testing.assert_allclose(found.c, best.c, atol=1e-8)
        assert found.evidence == pytest.approx(best.evidence, abs=1e-8)


def test_the_hidden_variance_is_bounded_by_its_prior():
    """A fit that has taken up all that is slow, of a residual without any colour to see: not more
    than a few times the residual.
    """
    t = np.arange(100)
    X = np.stack(
        [np.cos(np.pi * k * (t + 0.5) / 100) for k in range(20)], axis=1
    )  # the 20 slowest transforms
    v = residual(X, np.cumsum(np.random.default_rng(3).normal(size=100)))
    assert 1.0 < residual_spectrum(X, v, [slice(0, 100)]).hidden < 20.0


def test_no_residual_is_no_disturbance():
    X = np.ones((50, 1))
    assert not residual_spectrum(X, np.zeros(50), [slice(0, 50)]).model.autocovariance(5).any()
    found = coloured_covariance_of(X, np.zeros(50), [slice(0, 50)], [0.02])
    assert found.covariance[0, 0] == 0.0
    assert found.offset == 0.0


@pytest.mark.parametrize("lengths", [(1, 1, 1), (2,), (3, 4), (1, 1, 2, 40)])
def test_very_short_pieces_have_a_covariance(lengths):
    edges = np.cumsum([0, *lengths])
    pieces = [slice(int(a), int(b)) for a, b in pairwise(edges)]
    v = np.random.default_rng(4).normal(size=edges[-1])
    found = residual_spectrum(np.ones((edges[-1], 1)), v - v.mean(), pieces)
    r = found.model.autocovariance(5)
    assert np.isfinite(r).all()
    assert r[0] > 0.0


def test_regressors_that_nearly_vanish_do_not_enlarge_rounding():
    """A column that differs from another by 1e-9 of it, both perturbed by 1e-12."""
    rng = np.random.default_rng(5)
    X = np.column_stack(
        [slow_terms(300), slow_terms(300)[:, 1] * (1.0 + 1e-9 * rng.normal(size=300))]
    )
    v = residual(X[:, :4], coloured_noise(rng, 300, 0.5))
    first = residual_spectrum(X, v, [slice(0, 300)]).model.autocovariance(50)
    again = residual_spectrum(
        X * (1.0 + 1e-12 * rng.normal(size=X.shape)), v, [slice(0, 300)]
    ).model.autocovariance(50)
    np.testing.assert_allclose(again, first, atol=1e-8 * first[0])


def test_what_differs_between_stretches_as_a_constant_is_no_slow_disturbance():
    rng = np.random.default_rng(2)
    pieces = [slice(500 * k, 500 * (k + 1)) for k in range(8)]
    v = rng.normal(size=4000) + np.repeat(5.0 * rng.normal(size=8), 500)
    found = estimate_disturbances(np.ones((4000, 1)), v - v.mean(), pieces, [0.02] * 8)
    slow = sum(found[0].model.autocovariance(100)) / found[0].model.autocovariance(1)[0]
    assert slow < 3.0  # white would be one; the offsets would make it near a hundred
    assert coloured_covariance_of(
        np.ones((4000, 1)), v - v.mean(), pieces, [0.02] * 8
    ).offset == pytest.approx(5.0, rel=0.6)


@pytest.mark.slow
@pytest.mark.parametrize(
    "case",
    [
        "one of 10 s",
        "five of 12 s with offsets",
        "25 s with gaps and noise of the regressors",
        "25 s, AR(1) of 1 s",
    ],
)
@pytest.mark.nightly
def test_two_standard_errors_cover_92_to_98_percent(case):
    """150 records of the study of 1000 in benchmarks/regression_coverage.py: the share of 150 x 4
    estimates, a quarter of them taken as independent, scatters by 0.02 about 0.94: two and a half
    of these on both sides of the band.
    """
    path = Path(__file__).parents[3] / "benchmarks" / "regression_coverage.py"
    spec = importlib.util.spec_from_file_location("regression_coverage", path)
    study = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(study)
    assert 0.89 < study.demanded(case, 150, 1).coverage < 0.99


def test_sums_over_the_two_knots_next_to_a_frequency_are_those_of_the_hat_functions():
    """Against the hat functions written out as a matrix."""
    rng = np.random.default_rng(5)
    knots, x = 7, rng.uniform(0.0, 6.0, 200)
    hats = RoofFunctions(
        knots, np.minimum(x.astype(int), knots - 2), 1.0 + np.minimum(x.astype(int), knots - 2) - x
    )
    B = np.maximum(0.0, 1.0 - np.abs(x[:, None] - np.arange(knots)))
    weights, c = rng.uniform(0.1, 2.0, len(x)), rng.normal(size=knots)
    np.testing.assert_allclose(hats.interpolate(c), B @ c, rtol=0.0, atol=1e-14)
    np.testing.assert_allclose(hats.sums(weights), weights @ B, rtol=1e-13)
    np.testing.assert_allclose(
        hats.products(weights), (B * weights[:, None]).T @ B, rtol=0.0, atol=1e-12
    )
    root = rng.normal(size=(knots, knots))
    mode = SpectrumMaximum(c, root @ root.T, 0.0)
    variance = ((B @ mode.covariance) * B).sum(axis=1)
    mean = np.exp(B @ c + 0.5 / np.sqrt(variance**-2.0 + np.log(UNKNOWN) ** -4.0))
    np.testing.assert_allclose(mode.mean(hats), mean, rtol=1e-11)
