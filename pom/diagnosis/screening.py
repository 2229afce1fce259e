"""Terms whose swap cannot matter in a case, found without flying each of them.

The contribution of every term to its coefficient is known along the recorded flight from both
databases, so the size of a swap is known before it is flown: the rms of the difference, weighted by
dynamic pressure.  Of every coefficient the two largest are flown. What a unit of the coefficient
moves the judged outputs is then measured, as the largest found; a smaller term that moves them by
less than `LEAST_MOVED` even with `SAFETY` times that is not flown alone.  Each term that is flown
may raise the measure.

Outputs are linear in small swaps, so this is a linear sensitivity with a margin, no proof.
Therefore all terms that are not flown are swapped together, in the a-priori model and in the final
one: where that changes the verdict or a criterion by more than `LEAST_TOGETHER`, the larger half of
them is flown.  The bound of a term is its estimate with the margin, or what all move together if
that is more: a term may act through states that only the model has, as a rudder that its trim
moves.  Terms whose effects cancel in both models are not found by this check.
"""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from itertools import combinations
from math import comb
from typing import Any

import numpy as np

import aerodb
from aerodb.comparison.conditions import fill_missing_devices
from flightmech import terms as _terms
from flightmech.errors import UnknownName
from flightmech.support.arrays import rms
from flighttest.reconstruction.dynamics.force_coefficients import reduced_rates
from pom.diagnosis.swap_runs import SwapBench

LEAST_MOVED = (
    0.005  # of the mismatch, as `Judged.moved`: a term that moves less than this is not flown alone
)
SAFETY = 3.0  # for how a term acts along the flight otherwise than those that were flown
LEAST_TOGETHER = 0.02  # of the mismatch: what all terms that are not flown alone may move together
LEAST_MISMATCH = (
    0.1  # half widths: changes of a criterion are held against its gap, or against this
)
SAMPLES = 200  # of the flight


def screen_idle_terms(bench: SwapBench) -> None:
    """Find the idle terms of a bench, fly all other terms alone in the a-priori model, and all idle
    ones together in both models.
    """
    if bench.idle:
        return
    size = _sizes(bench)
    unit: dict[str, float] = defaultdict(
        float
    )  # of a coefficient: how far a swap of rms one moves the outputs
    order = sorted(size, key=lambda name: -size[name])
    felt = [name for name in bench.names if name not in size]
    by_coefficient: dict[str, list[str]] = defaultdict(list)
    for name in order:
        by_coefficient[_head(name)].append(name)
    new = [name for names in by_coefficient.values() for name in names[:2]]
    bench.judged([name] for name in felt)
    while new:
        for name, found in zip(new, bench.judged([name] for name in new), strict=True):
            if size[name] > 0.0:
                unit[_head(name)] = max(unit[_head(name)], found.moved / size[name])
        felt += new
        new = [
            name
            for name in order
            if name not in felt and size[name] > 0.0 and _bound(unit, size, name) >= LEAST_MOVED
        ]
    idle = sorted(
        (name for name in order if name not in felt), key=lambda name: -_bound(unit, size, name)
    )
    while idle and not _small(bench, idle):
        half = (len(idle) + 1) // 2
        bench.judged([name] for name in idle[:half])
        idle = idle[half:]
    (together,) = bench.judged([idle], exact=True)
    bound = {name: max(_bound(unit, size, name), together.moved) for name in idle}
    bench.idle = dict(sorted(bound.items(), key=lambda item: -item[1]))


def _head(name: str) -> str:
    return name.split("/")[0]


def _bound(unit: dict[str, float], size: dict[str, float], name: str) -> float:
    return SAFETY * unit[_head(name)] * size[name] if size[name] > 0.0 else 0.0


def _small(bench: SwapBench, idle: list[str]) -> bool:
    """Whether these terms together change neither the a-priori model nor the final one."""
    start, end = bench.judged([(), bench.names], exact=True)
    added, taken = bench.judged(
        [idle, [name for name in bench.names if name not in idle]], exact=True
    )
    criteria = list(start.mismatch)
    most = LEAST_TOGETHER * np.fmax(
        np.abs(start.counted(criteria) - end.counted(criteria)), LEAST_MISMATCH
    )
    same = all(
        one.verdict == other.verdict
        and (np.abs(one.counted(criteria) - other.counted(criteria)) <= most).all()
        for one, other in ((added, start), (taken, end))
    )
    return same and added.moved < LEAST_TOGETHER


def _sizes(bench: SwapBench) -> dict[str, float]:
    """Return the rms by which the swap of each term changes its coefficient along the recorded
    flight; none where that is not known.
    """
    prior, final = bench.models.prior, bench.models.final
    both = aerodb.terms(prior), aerodb.terms(final)
    leaves = [terms[name] for terms in both for name in bench.terms if name in terms]
    every = max(1, bench.states.sizes["time"] // SAMPLES)
    try:
        states = reduced_rates(bench.states, bench.models.aircraft[1]).isel(
            time=slice(None, None, every)
        )
        whole, _ = fill_missing_devices(states, prior, final)
    except UnknownName:  # the record does not hold what a table is over
        return {}
    wanted = {"V", *(variable for leaf in leaves for variable in _terms.list_model_variables(leaf))}
    columns = {
        name: np.broadcast_to(whole[name].values, whole.sizes["time"]) for name in sorted(wanted)
    }
    counted = np.all([np.isfinite(values) for values in columns.values()], axis=0)
    if not counted.any():
        return {}
    samples = {name: values[counted].astype(float) for name, values in columns.items()}
    weight = np.square(samples["V"] / samples["V"].max())
    found, places = {}, dict[Any, Any]()
    for name in bench.terms:
        before, after = (
            _terms.evaluate_term(terms[name], samples, "clamp", places) if name in terms else 0.0
            for terms in both
        )
        found[name] = rms(weight * (after - before))
    return found


LEAST_PAIRS = 8  # the standard error of eight has itself an error of 27 %
Choice = frozenset[int]
Game = Callable[[Sequence[Choice]], np.ndarray]


@dataclass(frozen=True)
class ShapleyShares:
    """Shares (player, quantity), their standard errors, zero when exact, and the number of orders
    drawn, zero when exact.
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
        Choices that may be evaluated.  Exact when 2**n are within it, else as many pairs of orders
        as are, but at least `LEAST_PAIRS`: fewer give no estimate of their own scatter.
    seed : int
        Of the generator that draws the orders.
    """
    return (
        _exact(players, game)
        if 2**players <= budget
        else _sampled(players, game, budget, np.random.default_rng(seed))
    )


def _exact(players: int, game: Game) -> ShapleyShares:
    choices = [
        frozenset(c) for size in range(players + 1) for c in combinations(range(players), size)
    ]
    value = dict(zip(choices, game(choices), strict=True))
    share = np.zeros((players, len(value[frozenset()])))
    for choice in choices:
        weight = 1.0 / (players * comb(players - 1, len(choice))) if len(choice) < players else 0.0
        for player in set(range(players)) - choice:
            share[player] += weight * (value[choice | {player}] - value[choice])
    return ShapleyShares(share, np.zeros_like(share), 0)


def _sampled(players: int, game: Game, budget: int, rng: np.random.Generator) -> ShapleyShares:
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
    return ShapleyShares(
        pairs.mean(axis=0), pairs.std(axis=0, ddof=1) / np.sqrt(len(pairs)), len(orders)
    )


def _growing(order: list[int]) -> list[Choice]:
    return [frozenset(order[:k]) for k in range(len(order) + 1)]


def _gains(order: list[int], value: dict[Choice, np.ndarray]) -> np.ndarray:
    """Return what each player adds when it comes in this order (player, quantity)."""
    levels = np.stack([value[choice] for choice in _growing(order)])
    gains = np.empty_like(levels[1:])
    gains[order] = np.diff(levels, axis=0)
    return gains
