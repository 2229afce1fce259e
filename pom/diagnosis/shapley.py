"""Shapley shares of the players of a game: exact, or from a sample of orders."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from itertools import combinations
from math import comb

import numpy as np

LEAST_PAIRS = 8  # pairs of orders: the standard error of eight has itself an error of 27 %
Choice = frozenset[int]
Game = Callable[[Sequence[Choice]], np.ndarray]


@dataclass(frozen=True)
class ShapleyShares:
    """Shapley shares with their standard errors.

    Attributes
    ----------
    share, stderr : array (player, quantity)
        The standard error is zero for exact shares.
    orders : int
        Number of drawn orders; zero for exact shares.
    """

    share: np.ndarray
    stderr: np.ndarray
    orders: int


def shapley_shares(players: int, game: Game, budget: int, seed: int = 0) -> ShapleyShares:
    """Return the Shapley share of every player.

    Parameters
    ----------
    players : int
        Number of players n.
    game : callable
        Choices of players to the values (choice, quantity), any number of quantities at once.
    budget : int
        Largest number of evaluated choices. The shares are exact if 2**n is within it. Else pairs
        of orders are drawn up to it, but at least `LEAST_PAIRS`: fewer pairs do not determine
        their scatter.
    seed : int
        Seed of the generator that draws the orders.
    """
    if 2**players <= budget:
        return _exact_shares(players, game)
    return _sampled_shares(players, game, budget, random=np.random.default_rng(seed))


def _exact_shares(players: int, game: Game) -> ShapleyShares:
    """Return the mean gain of each player over all choices, weighted by their size."""
    choices: list[Choice] = []
    for size in range(players + 1):
        choices += map(frozenset, combinations(range(players), size))
    value = dict(zip(choices, game(choices), strict=True))
    share = np.zeros((players, len(value[frozenset()])))
    for choice in choices:
        # The complete choice has no player left, and so no weight.
        if len(choice) == players:
            continue
        weight = 1.0 / (players * comb(players - 1, len(choice)))
        for player in set(range(players)) - choice:
            share[player] += weight * (value[choice | {player}] - value[choice])
    return ShapleyShares(share, np.zeros_like(share), orders=0)


def _sampled_shares(
    players: int, game: Game, budget: int, *, random: np.random.Generator
) -> ShapleyShares:
    """Return the mean gains over drawn orders, each with its reverse."""
    orders: list[list[int]] = []
    needed: dict[Choice, None] = {}
    while True:
        order = random.permutation(players).tolist()
        pair = [order, order[::-1]]
        choices: dict[Choice, None] = {}
        for each in pair:
            choices |= dict.fromkeys(_growing_choices(each))
        choices |= needed
        if len(choices) > budget and len(orders) >= 2 * LEAST_PAIRS:
            break
        orders, needed = orders + pair, choices
    value = dict(zip(needed, game(list(needed)), strict=True))
    gains = np.stack([_gains_in_order(order, value) for order in orders])
    # The two orders of a pair are not independent, so the scatter is that of the pairs.
    pairs = gains.reshape(-1, 2, *gains.shape[1:]).mean(axis=1)
    stderr = pairs.std(axis=0, ddof=1) / np.sqrt(len(pairs))
    return ShapleyShares(pairs.mean(axis=0), stderr, orders=len(orders))


def _growing_choices(order: list[int]) -> list[Choice]:
    """Return the choices of the first 0, 1, 2 ... players of an order."""
    return [frozenset(order[:k]) for k in range(len(order) + 1)]


def _gains_in_order(order: list[int], value: dict[Choice, np.ndarray]) -> np.ndarray:
    """Return the gain of each player that joins in this order (player, quantity)."""
    levels = np.stack([value[choice] for choice in _growing_choices(order)])
    gains = np.empty_like(levels[1:])
    gains[order] = np.diff(levels, axis=0)
    return gains
