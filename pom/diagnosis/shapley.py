"""Shapley shares: what each player adds to a whole, on average over every order in which the players may come.

The share of player i in a game v of n players is the mean of v(S + i) - v(S) over all orders, S those who came before it
[Shapley1953].  The shares sum to v(all) - v(none), so they are a fair split where effects interact.  Few players: all 2**n
choices.  Many: orders drawn at random, each together with its reverse, which halves the scatter of players that interact in pairs
[Mitchell2022].

References
----------
.. [Shapley1953] L. S. Shapley, A value for n-person games, Contributions to the Theory of Games II, 1953, pp. 307-317.
.. [Mitchell2022] R. Mitchell et al., Sampling permutations for Shapley value estimation, J. Mach. Learn. Res. 23(43), 2022,
   section 2.2, antithetic sampling.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from itertools import combinations
from math import comb

import numpy as np

LEAST_PAIRS = 8  # the standard error of eight has itself an error of 27 %
Choice = frozenset[int]
Game = Callable[[Sequence[Choice]], np.ndarray]


@dataclass(frozen=True)
class Shares:
    """Shares (player, quantity), their standard errors, zero when exact, and the number of orders drawn, zero when exact."""

    share: np.ndarray
    stderr: np.ndarray
    orders: int


def shares(players: int, game: Game, budget: int, seed: int = 0) -> Shares:
    """Return the Shapley share of every player.

    Parameters
    ----------
    players : int
        Number of players n.
    game : callable
        Choices of players to the values (choice, quantity), any number of quantities at once.
    budget : int
        Choices that may be evaluated.  Exact when 2**n are within it, else as many pairs of orders as are, but at least
        `LEAST_PAIRS`: fewer give no estimate of their own scatter.
    seed : int
        Of the generator that draws the orders.
    """
    return _exact(players, game) if 2**players <= budget else _sampled(players, game, budget, np.random.default_rng(seed))


def _exact(players: int, game: Game) -> Shares:
    choices = [frozenset(c) for size in range(players + 1) for c in combinations(range(players), size)]
    value = dict(zip(choices, game(choices), strict=True))
    share = np.zeros((players, len(value[frozenset()])))
    for choice in choices:
        weight = 1.0 / (players * comb(players - 1, len(choice))) if len(choice) < players else 0.0
        for player in set(range(players)) - choice:
            share[player] += weight * (value[choice | {player}] - value[choice])
    return Shares(share, np.zeros_like(share), 0)


def _sampled(players: int, game: Game, budget: int, rng: np.random.Generator) -> Shares:
    orders: list[list[int]] = []
    known: dict[Choice, None] = {}
    while True:
        order = rng.permutation(players).tolist()
        pair = [order, order[::-1]]
        new = {choice: None for one in pair for choice in _growing(one)} | known
        if len(new) > budget and len(orders) >= 2 * LEAST_PAIRS:
            break
        orders, known = orders + pair, new
    value = dict(zip(known, game(list(known)), strict=True))
    gains = np.stack([_gains(order, value) for order in orders])
    pairs = gains.reshape(-1, 2, *gains.shape[1:]).mean(axis=1)
    return Shares(pairs.mean(axis=0), pairs.std(axis=0, ddof=1) / np.sqrt(len(pairs)), len(orders))


def _growing(order: list[int]) -> list[Choice]:
    return [frozenset(order[:k]) for k in range(len(order) + 1)]


def _gains(order: list[int], value: dict[Choice, np.ndarray]) -> np.ndarray:
    """Return what each player adds when it comes in this order (player, quantity)."""
    levels = np.stack([value[choice] for choice in _growing(order)])
    gains = np.empty_like(levels[1:])
    gains[order] = np.diff(levels, axis=0)
    return gains
