"""Terms of the final model that explain the mismatch of the a-priori model.

This is the term swap of LR-743, section 5.2, made systematic. Every term that differs and can
matter in the case (`screening`) is put alone from the final database into the a-priori one. The
kernel replays the case with its inputs, initial state and trim. Groups of terms and pairs follow.
Then terms are added one by one, the best first, until the case passes or no term helps. Last, the
gap between the two models is split among the terms by their Shapley shares, which are fair where
effects interact.

Parts of the aircraft that differ (`flightmech.aircraft.parts`: tables of the engines, legs of the
gear ...) are exchanged in the same way.
"""

from __future__ import annotations

from collections.abc import Collection, Iterable, Mapping, Sequence
from itertools import combinations
from typing import Any

import numpy as np
import pandas as pd
import xarray as xr

from flightmech.aircraft.aircraft import Aircraft
from pom.cases.case import PomCase
from pom.diagnosis.screening import screen_idle_terms
from pom.diagnosis.shapley import shapley_shares
from pom.diagnosis.swap_judgement import (
    LEAST_GAP,
    DiagnosisRows,
    Judged,
    effect_correlation,
    effect_products,
    nearest_choice,
)
from pom.diagnosis.swap_models import SwapModels
from pom.diagnosis.swap_runs import SwapBench
from pom.diagnosis.term_swaps import groups_of
from pom.diagnosis.waterfall_steps import OTHERS

LEAST_SHARE = 0.02  # of the gap: an addition that explains less is not worth a correction
# A share below the negative of it, or as far above 1, is stated with the effect that opposes it.
LEAST_OPPOSED = 0.1
LEAST_FELT = 0.005  # of the gap: a term that changes less alone counts among the others
# Single swaps with the largest changes, better or worse. Every round of the sequence tries them.
CANDIDATES = 16
PAIRED = 6  # terms of which all pairs are tried
AND = " + "


def diagnose(
    case: PomCase,
    prior: xr.DataTree,
    final: xr.DataTree,
    aircraft: Aircraft,
    path: Any = None,
    apriori: Aircraft | None = None,
    groups: Mapping[str, Sequence[str]] | None = None,
    players: int = 5,
    replays: int = 256,
    seed: int = 0,
) -> pd.DataFrame:
    """Rank terms and parts of the aircraft by the mismatch of `prior` that each explains.

    The ranking is of the total mismatch and of every criterion.

    Parameters
    ----------
    case : PomCase
    prior, final : DataTree
        Two databases of one aircraft.
    aircraft : Aircraft
        Aircraft of the final model.
    path : Path of flighttest.reconstruct or Dataset (time), optional
        As in `replay`.
    apriori : Aircraft, optional
        Aircraft of the a-priori model, if its engines, gear or control circuits differ.
    groups : mapping of str to sequence of str, optional
        Groups to swap as a whole in addition to those of `groups_of`: names or patterns of terms
        and parts.
    players : int
        Terms with a share of their own: all that the sequence needed, and further ones that change
        most up to this number; the rest together are ``others``.
    replays : int
        Replays that the shares may take.  2**n for n terms are within it: exact; else a sample of
        orders, at least 16, with its standard error.
    seed : int
        Seed of the sample.

    Returns
    -------
    DataFrame
        Columns ``stage term explained stderr interaction correlation partner bound verdict
        mismatch`` and, for every judged criterion, its ``mismatch`` (rms of difference over half
        width for a time history, the ratio itself for a scalar), ``ratio`` (largest), ``explained``
        and ``stderr``. ``explained`` is the share of the gap between the mismatches of `prior` and
        `final`; the total mismatch is the root mean square over the groups, of each group the best
        alternative, at most `CEILING`.  NaN when `final` is not better by `LEAST_GAP`, of a
        criterion likewise. Stages:

        - ``prior`` and ``final``;
        - ``single``, one row per term that was flown alone, best first; ``group``, best first;
        - ``idle``, the a-priori model with all terms together that were not flown alone (``term``
          empty; ``bound``: how far that moves the judged outputs, as a share of their mismatch),
          then a row for each, with the ``bound`` of what it moves, the largest first;
        - ``pair``, terms ``A + B`` of those that change most, best first; ``interaction`` is what
          both explain beyond the sum of each, ``correlation`` that of their effects on the judged
          outputs: near -1 they compensate each other;
        - ``sequence``, terms added one after the other, each row with all before it;
        - ``without``, the final model without one of the terms with a share of their own or a
          group, the worst first;
        - ``share``, the Shapley shares with their standard errors (zero when exact): first those
          that add to the mismatch, then those that reduce it, the largest first.  Their
          ``mismatch`` is the level after this share and those above it, from that of `prior` to
          that of `final`.  A share that is negative or above 1 by more than `LEAST_OPPOSED` has the
          ``partner`` whose effect opposes it most, and the ``correlation`` of both effects.

        The last four stages are not there when `prior` is within tolerance or `final` is no better,
        nor when `final` fails as well and is better by less than `LEAST_GAP`.  The shares are not
        there whenever it is better by less.
    """
    models = SwapModels.of(prior, final, (apriori or aircraft, aircraft))
    bench = SwapBench.of(case, models, path)
    return diagnose_bench(bench, groups, players=players, replays=replays, seed=seed)


def diagnose_bench(
    bench: SwapBench,
    groups: Mapping[str, Sequence[str]] | None = None,
    players: int = 5,
    replays: int = 256,
    seed: int = 0,
) -> pd.DataFrame:
    """Return the table of `diagnose` for a bench; parameters as there."""
    screen_idle_terms(bench)
    start, end = bench.judged([(), bench.names])
    table = DiagnosisRows(start, end)
    table.add("prior", "", start)
    table.add("final", "", end)
    singles = _judge_singles(bench)
    for name, judged in singles:
        table.add("single", name, judged)
    members = groups_of(bench.models.prior, bench.models.final, bench.names, wanted=groups)
    group_runs = zip(members, _judge_groups(bench, members.values(), members.values()), strict=True)
    for name, judged in sorted(group_runs, key=lambda run: _rank_total(run[1])):
        table.add("group", name, judged)
    if bench.idle:
        (all_idle,) = bench.judged([bench.idle])
        table.add("idle", "", all_idle, bound=all_idle.moved)
        for name, bound in bench.idle.items():
            table.add_idle(name, bound)
    # A final model that fails as well has to be clearly better.
    least_gap = LEAST_GAP
    if end.matched:
        least_gap = 0.0
    if start.matched or not table.gap > least_gap:
        return pd.DataFrame(table.rows)
    change = {}
    for name, judged in singles:
        change[name] = abs(_rank_total(judged) - start.total)
    strongest = sorted(change, key=lambda name: -change[name])
    needed = _find_needed_terms(bench, strongest, table.gap)
    separate = list(needed)
    for name in strongest:
        if name not in needed and change[name] > LEAST_FELT * table.gap:
            separate.append(name)
    separate = separate[: max(players, len(needed))]
    _add_pairs(bench, table, sorted(separate, key=strongest.index)[:PAIRED])
    steps = [needed[: k + 1] for k in range(len(needed))]
    for name, judged in zip(needed, bench.judged(steps), strict=True):
        table.add("sequence", name, judged)
    # Single terms are omitted first, then the groups.
    omissions: dict[str, Sequence[str]] = {name: (name,) for name in separate}
    omissions |= members
    _add_omissions(bench, table, omissions)
    if table.has_gap:
        _add_shares(bench, table, separate, replays=replays, seed=seed)
    return pd.DataFrame(table.rows)


def _judge_singles(bench: SwapBench) -> list[tuple[str, Judged]]:
    """Return the judgement of every term that is flown alone, best first."""
    names = [name for name in bench.names if name not in bench.idle]
    runs = zip(names, bench.judged([name] for name in names), strict=True)
    return sorted(runs, key=lambda run: _rank_total(run[1]))


def _rank_total(judged: Judged) -> float:
    """Return the total mismatch; infinite without one, so that it ranks last."""
    if np.isfinite(judged.total):
        return judged.total
    return np.inf


def _add_pairs(bench: SwapBench, table: DiagnosisRows, names: Sequence[str]) -> None:
    """Append the pairs of the named terms, best first."""
    alone = {}
    for row in table.rows:
        if row["stage"] == "single":
            alone[row["term"]] = row["explained"]
    pairs = list(combinations(names, 2))
    runs = zip(pairs, bench.judged(pairs), strict=True)
    for (first, second), judged in sorted(runs, key=lambda run: _rank_total(run[1])):
        both = np.nan
        if table.has_gap:
            both = (table.start[0] - judged.total) / table.gap
        table.add(
            "pair",
            f"{first}{AND}{second}",
            judged,
            interaction=both - alone[first] - alone[second],
            correlation=_correlate_effects(bench, [first], [second]),
        )


def _correlate_effects(bench: SwapBench, first: Sequence[str], second: Sequence[str]) -> float:
    """Return the correlation of the effects of two choices on the judged outputs."""
    one, other, both = bench.judged([first, second, [*first, *second]])
    return effect_correlation(effect_products(one, other, both, bench.sizes))


def _find_needed_terms(bench: SwapBench, strongest: list[str], gap: float) -> list[str]:
    """Return the terms that make the case pass, from those that change most alone.

    Sometimes these do not suffice although the final model passes. A mismatch can hide the effect
    of other terms, for example if a mode is not excited. The candidates are then the terms without
    which the final model is worst.
    """
    start, end = bench.judged([(), bench.names])
    needed = _search_sequence(bench, start, gap, candidates=strongest[:CANDIDATES])
    (reached,) = bench.judged([needed])
    if reached.matched or not end.matched:
        return needed
    omissions = [_all_except(bench, [name]) for name in strongest]
    loss = {}
    for name, without in zip(strongest, bench.judged(omissions), strict=True):
        loss[name] = _rank_total(without) - end.total
    candidates = sorted(strongest, key=lambda name: -loss[name])[:CANDIDATES]
    second = _search_sequence(bench, start, gap, candidates=candidates)
    (better,) = bench.judged([second])
    if better.matched or better.total < reached.total:
        return second
    return needed


def _all_except(bench: SwapBench, names: Collection[str]) -> list[str]:
    """Return all terms and parts of a bench without the named ones."""
    return [name for name in bench.names if name not in names]


def _search_sequence(
    bench: SwapBench, start: Judged, gap: float, *, candidates: list[str]
) -> list[str]:
    """Return the greedy sequence, cut at its best step, without terms that are not needed.

    The best term is added even if it does not help by itself, because the next one may need it. In
    the end every term has to gain `LEAST_SHARE` of the gap.
    """
    names: list[str] = []
    steps = [start]
    while not steps[-1].matched and len(names) < len(candidates):
        free = [name for name in candidates if name not in names]
        trials = bench.judged([[*names, name] for name in free])
        best = min(range(len(free)), key=lambda k: _rank_total(trials[k]))
        steps.append(trials[best])
        names.append(free[best])
    best = min(range(len(steps)), key=lambda k: (not steps[k].matched, steps[k].total))
    needed, reached = names[:best], steps[best]
    # Fly all omissions together: the loop below needs most of them.
    bench.judged([_without_term(needed, name) for name in needed])
    for name in reversed(names[:best]):
        (without,) = bench.judged([_without_term(needed, name)])
        loss = without.total - reached.total
        if without.matched >= reached.matched and loss < LEAST_SHARE * gap:
            needed.remove(name)
    return needed


def _without_term(names: Sequence[str], omitted: str) -> list[str]:
    return [name for name in names if name != omitted]


def _add_omissions(
    bench: SwapBench, table: DiagnosisRows, omissions: Mapping[str, Sequence[str]]
) -> None:
    """Append the final model without each of these terms or groups, the worst first."""
    choices = [_all_except(bench, names) for names in omissions.values()]
    runs = zip(omissions, _judge_groups(bench, omissions.values(), choices), strict=True)
    for name, judged in sorted(runs, key=lambda run: -_rank_total(run[1])):
        table.add("without", name, judged)


def _judge_groups(
    bench: SwapBench, groups: Iterable[Collection[str]], choices: Iterable[Collection[str]]
) -> list[Judged]:
    """Return the judgements of choices that each contain or omit a group.

    A choice is judged exactly, except for a group of idle terms only.
    """
    exact_choices = []
    for group, choice in zip(groups, choices, strict=True):
        if bench.idle.keys() >= set(group):
            choice = nearest_choice(choice, bench.idle)
        exact_choices.append(choice)
    return bench.judged(exact_choices, exact=True)


def _add_shares(
    bench: SwapBench, table: DiagnosisRows, separate: Sequence[str], *, replays: int, seed: int
) -> None:
    """Append the Shapley shares of separate terms, and of all others together."""
    players = [[name] for name in separate]
    labels = list(separate)
    others = _all_except(bench, separate)
    if others:
        players.append(others)
        labels.append(OTHERS)

    def judge_choices(choices):
        swaps = []
        for choice in choices:
            names: list[str] = []
            for player in choice:
                names += players[player]
            swaps.append(names)
        return np.stack([judged.counted(table.criteria) for judged in bench.judged(swaps)])

    shares = shapley_shares(len(players), judge_choices, budget=replays, seed=seed)
    # Additions to the mismatch come first, so that no level of the waterfall is below the mismatch
    # of the final model. Then the largest reductions, the other terms last.
    change = shares.share[:, 0]
    order = sorted(
        range(len(players)), key=lambda k: (change[k] < 0.0, labels[k] == OTHERS, -abs(change[k]))
    )
    levels = table.start + np.cumsum(shares.share[order], axis=0)
    for level, player in zip(levels, order, strict=True):
        opposed = ("", np.nan)
        explained = table.explained(-shares.share[player])[0]
        if explained < -LEAST_OPPOSED or explained > 1.0 + LEAST_OPPOSED:
            opposed = _find_opposing(bench, players, player, labels=labels)
        table.add_share(
            labels[player],
            shares.share[player],
            stderr=shares.stderr[player],
            level=level,
            opposed=opposed,
        )


def _find_opposing(
    bench: SwapBench, players: Sequence[Sequence[str]], player: int, *, labels: Sequence[str]
) -> tuple[str, float]:
    """Return the player whose effect opposes that of `player` most, and the correlation."""
    lowest = ("", 0.0)
    for other in range(len(players)):
        if other == player:
            continue
        correlation = _correlate_effects(bench, players[player], players[other])
        if correlation < lowest[1]:
            lowest = (labels[other], correlation)
    if not lowest[0]:
        return "", np.nan
    return lowest
