"""Shapley shares against games whose shares are known by hand."""

import numpy as np
import pytest

from pom.diagnosis.shapley import shapley_shares


def one_value(rule):
    """A game of one quantity from a rule of one choice."""
    return lambda choices: np.array([[float(rule(choice))] for choice in choices])


def test_the_glove_game():
    """Player 0 has the left glove, 1 and 2 a right one each; a pair is worth 1: shares 2/3, 1/6,
    1/6.
    """
    found = shapley_shares(3, one_value(lambda s: 0 in s and bool(s & {1, 2})), 8)
    assert found.share[:, 0] == pytest.approx([2 / 3, 1 / 6, 1 / 6])
    assert found.orders == 0
    assert (found.stderr == 0.0).all()


def test_the_majority_of_weights():
    """Weights 3, 2, 1, 1, quota 4: by counting the 24 orders, the pivots are 12, 4, 4, 4."""
    weights = (3, 2, 1, 1)
    found = shapley_shares(4, one_value(lambda s: sum(weights[i] for i in s) >= 4), 16)
    assert found.share[:, 0] == pytest.approx([12 / 24, 4 / 24, 4 / 24, 4 / 24])


def test_several_quantities_at_once():
    found = shapley_shares(
        2, lambda choices: np.array([[len(c), 5.0 * (c == {0, 1}) + 7.0] for c in choices]), 4
    )
    assert found.share == pytest.approx(np.array([[1.0, 2.5], [1.0, 2.5]]))


def test_pairs_of_orders_are_exact_when_players_interact_in_pairs():
    rng = np.random.default_rng(3)
    alone, both = rng.normal(size=9), np.triu(rng.normal(size=(9, 9)), 1)
    game = one_value(lambda s: sum(alone[i] for i in s) + sum(both[i, j] for i in s for j in s))
    found = shapley_shares(9, game, 60)
    assert found.orders == 16
    assert found.share[:, 0] == pytest.approx(alone + 0.5 * (both + both.T).sum(axis=1))
    assert np.abs(found.stderr).max() < 1e-12


@pytest.mark.slow
def test_sampled_shares_lie_within_their_standard_errors():
    rng = np.random.default_rng(5)
    value = {}
    game = one_value(lambda s: value.setdefault(s, float(rng.normal())))
    exact = shapley_shares(8, game, 256)
    deviations = []
    for seed in range(30):
        found = shapley_shares(8, game, 200, seed)
        assert found.share.sum() == pytest.approx(value[frozenset(range(8))] - value[frozenset()])
        deviations += list(((found.share - exact.share) / found.stderr)[:, 0])
    # 240 deviations of about a dozen pairs each; Student's spread is 1.1, the shares of a seed are
    # tied by their sum
    assert 0.85 < np.std(deviations) < 1.35
    assert shapley_shares(8, game, 200, 4).share == pytest.approx(
        shapley_shares(8, game, 200, 4).share, abs=0.0
    )


def test_the_budget_is_kept():
    asked = []

    def game(choices):
        asked.extend(choices)
        return np.zeros((len(choices), 1))

    shapley_shares(12, game, 300)
    assert 250 < len(asked) <= 300
    asked.clear()
    assert shapley_shares(12, game, 1).orders == 16  # for a standard error
    assert len(asked) == len(set(asked)) <= 16 * 11 + 2
