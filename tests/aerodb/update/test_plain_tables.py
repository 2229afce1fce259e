"""Probability that a table has the shape of the handbook, and what it does to the weights."""

import numpy as np
import pytest
from scipy.linalg import block_diag

from aerodb.update.correlation import LENGTHS, PARTS, SHARES, prior_parts
from aerodb.update.weights.weight_learning import learn_weights
from aerodb.update.weights.weight_likelihood import (
    PLAIN,
    SHAPE,
    plain_probabilities,
    plain_shares,
    without_shapes,
)
from flightmech import terms
from flightmech.units import DEGREE

ALPHA = np.arange(-4.0, 15.0, 2.0)
STDERR, NOISE = 0.05, 0.002
ERRORS = {
    "zero": 0.0 * ALPHA,
    "level": np.full(len(ALPHA), 0.08),
    "slope": 0.05 + 0.006 * ALPHA,
    "wave": 0.05 * np.sin(0.4 * ALPHA),
}


def table_parts(alpha):
    """Parts of the covariance of measured nodes."""
    leaf = terms.make_term(
        np.ones(len(alpha)), {"alpha": alpha * DEGREE}, stderr=np.full(len(alpha), STDERR)
    )
    return prior_parts(leaf, np.ones(len(alpha)), LENGTHS)


def probability(y, parts):
    fixed = np.zeros((len(y), len(y)))
    _, u = learn_weights(y, parts, fixed, None)
    tables = (len(parts) - 1) // len(PARTS)
    return plain_probabilities(y, parts, fixed, u, np.full(tables, PLAIN)), u


@pytest.mark.parametrize("kind", ERRORS)
def test_the_shape_of_the_error_decides(kind):
    noise = NOISE * np.random.default_rng(1).standard_normal(len(ALPHA))
    parts = np.concatenate([table_parts(ALPHA), NOISE**2 * np.eye(len(ALPHA))[None]])
    y = ERRORS[kind] + noise
    plain, _ = probability(y, parts)
    expected = {"zero": 0.97, "level": 0.97, "slope": 0.0, "wave": 0.0}[kind]
    assert plain == pytest.approx([expected], abs=0.03)
    moved = y * (1.0 + 1e-12 * np.random.default_rng(2).standard_normal(len(y)))
    assert probability(moved, parts)[0] == pytest.approx(plain, rel=1e-6, abs=1e-12)


@pytest.mark.parametrize(("noise", "expected"), [(1e-7, 1.0), (1e-9, 0.0)])
def test_a_covariance_that_is_singular_without_a_shape_keeps_it(noise, expected):
    """Fits almost without noise: `level` alone has rank one, and no Cholesky factor at 1e-9."""
    parts = np.concatenate([table_parts(ALPHA), noise**2 * np.eye(len(ALPHA))[None]])
    y = ERRORS["level"] + noise * np.random.default_rng(1).standard_normal(len(ALPHA))
    assert probability(y, parts)[0] == pytest.approx([expected], abs=1e-6)


def test_each_table_has_its_own_probability_and_one_node_has_no_shape():
    """Three tables, seen by fits of their own: level, wave, and one number."""
    blocks = [table_parts(ALPHA), table_parts(ALPHA), table_parts(ALPHA[:1])]
    sizes = [len(block[0]) for block in blocks]
    parts = []
    for number, block in enumerate(blocks):
        for part in block:
            zeros = [np.zeros((size, size)) for size in sizes]
            zeros[number] = part
            parts.append(block_diag(*zeros))
    parts.append(NOISE**2 * np.eye(sum(sizes)))
    noise = NOISE * np.random.default_rng(3).standard_normal(sum(sizes))
    y = np.concatenate([ERRORS["level"], ERRORS["wave"], [0.03]]) + noise
    plain = probability(y, np.array(parts))[0]
    assert plain[0] > 0.7
    assert plain[1] < 0.01
    assert plain[2] == 0.0


def test_parts_that_the_estimates_cannot_distinguish_keep_their_weights():
    """One estimate at one node: shape and level have the same effect."""
    H = np.zeros((1, len(ALPHA)))
    H[0, 4] = 1.0
    parts = np.concatenate([H @ table_parts(ALPHA) @ H.T, np.array([[[NOISE**2]]])])
    assert probability(np.array([0.04]), parts)[0] == [0.0]


def test_the_weights_of_the_shape_have_the_remaining_share():
    factors = np.append(np.tile(list(SHARES.values()), 2), 1.3)
    new = without_shapes(factors, np.array([0.75, 0.0]))
    for k, name in enumerate(PARTS):
        share = 0.25 if name in SHAPE else 1.0
        assert new[k] == pytest.approx(share * SHARES[name])
    np.testing.assert_array_equal(new[5:], factors[5:])


def test_a_table_without_regressor_is_not_plain():
    axes = {"alpha": ALPHA * DEGREE}
    value, stderr = np.ones(len(ALPHA)), np.full(len(ALPHA), STDERR)
    leaves = [
        terms.make_term(value, axes, regressors, stderr=stderr) for regressors in ((), ("qhat",))
    ]
    assert plain_shares(leaves).tolist() == [0.0, PLAIN]
