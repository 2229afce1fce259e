"""Which terms of the final model explain the mismatch of the a-priori model: the term swap of
LR-743, section 5.2, made systematic.

Every term that differs and can matter in the case (`screening`) is put alone from the final
database into the a-priori one and the case is replayed by the kernel, with the inputs, the initial
state and the trim of the case; so are groups of terms and pairs.  Then terms are added one by one,
the best first, until the case passes or nothing helps any more.  Last, the gap between the two
models is split among the terms by their Shapley shares, which is fair where effects interact.

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
from pom.diagnosis.screening import screen_idle_terms, shapley_shares
from pom.diagnosis.swap_judgement import Judged, nearest_choice
from pom.diagnosis.swap_models import SwapModels
from pom.diagnosis.swap_runs import SwapBench
from pom.diagnosis.term_swaps import groups_of
from pom.diagnosis.waterfall import OTHERS

LEAST_SHARE = 0.02  # of the gap: an addition that explains less is not worth a correction
# half widths: a criterion whose mismatch differs by less between the two models has no meaningful
# shares
LEAST_GAP = 0.05
LEAST_FELT = 0.005  # of the gap: a term that changes less alone counts among the others
# single swaps that change most, for better or worse: they are tried again in every round of the
# sequence
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
    """Rank the terms, and the parts of the aircraft, by how much of the mismatch of `prior` each
    explains, in all and per criterion.

    Parameters
    ----------
    case : PomCase
    prior, final : DataTree
        Two databases of one aircraft.
    aircraft : Aircraft
        Of the final model.
    path : Path of flighttest.reconstruct or Dataset (time), optional
        As in `replay`.
    apriori : Aircraft, optional
        Of the a-priori model, when its engines, gear or control circuits are others.
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
        Of the sample.

    Returns
    -------
    DataFrame
        Columns ``stage term explained stderr interaction bound verdict mismatch`` and, for every
        judged criterion, its ``mismatch`` (rms of difference over half width for a time history,
        the ratio itself for a scalar), ``ratio`` (largest), ``explained`` and ``stderr``.
        ``explained`` is the share of the gap between the mismatches of `prior` and `final`; the
        total mismatch is the root mean square over the groups, of each group the best alternative,
        at most `CEILING`.  NaN when `final` is no better, for a criterion when it is better by less
        than `LEAST_GAP`.  Stages:

        - ``prior`` and ``final``;
        - ``single``, one row per term that was flown alone, best first; ``group``, best first;
        - ``idle``, the a-priori model with all terms together that were not flown alone (``term`` empty; ``bound``: how far that moves the
          judged outputs, as a share of their mismatch), then a row for each, with the ``bound`` of
          what it moves, the largest first;
        - ``pair``, terms ``A + B`` of those that change most, best first; ``interaction`` is what both explain beyond the sum of each;
        - ``sequence``, terms added one after the other, each row with all before it;
        - ``without``, the final model without one of the terms with a share of their own or a group, the worst first;
        - ``share``, the Shapley shares with their standard errors (zero when exact): first those that add to the mismatch, then those
          that reduce it, the largest first.  Their ``mismatch`` is the level after this share and
          those above it, from that of `prior` to that of `final`.

        The last four stages are not there when `prior` is within tolerance or `final` is no better,
        nor when `final` fails as well and is better by less than `LEAST_GAP`.
    """
    bench = SwapBench.of(case, SwapModels.of(prior, final, (apriori or aircraft, aircraft)), path)
    return diagnose_bench(bench, groups, players, replays, seed)


def diagnose_bench(
    bench: SwapBench,
    groups: Mapping[str, Sequence[str]] | None = None,
    players: int = 5,
    replays: int = 256,
    seed: int = 0,
) -> pd.DataFrame:
    """Return the table of `diagnose` of a bench; parameters as there."""
    screen_idle_terms(bench)
    start, end = bench.judged([(), bench.names])
    table = DiagnosisRows(start, end)
    table.add("prior", "", start)
    table.add("final", "", end)
    flown = [name for name in bench.names if name not in bench.idle]
    singles = sorted(
        zip(flown, bench.judged([name] for name in flown), strict=True),
        key=lambda row: _total(row[1]),
    )
    members = groups_of(bench.models.prior, bench.models.final, bench.names, groups)
    wholes = zip(members, _of_groups(bench, members.values(), members.values()), strict=True)
    for stage, rows in (
        ("single", singles),
        ("group", sorted(wholes, key=lambda row: _total(row[1]))),
    ):
        for name, found in rows:
            table.add(stage, name, found)
    if bench.idle:
        (together,) = bench.judged([bench.idle])
        table.add("idle", "", together, bound=together.moved)
        for name, bound in bench.idle.items():
            table.add_idle(name, bound)
    if not start.matched and table.gap > (0.0 if end.matched else LEAST_GAP):
        change = {name: abs(_total(found) - start.total) for name, found in singles}
        felt = sorted(change, key=lambda name: -change[name])
        needed = _needed(bench, felt, table.gap)
        further = [
            name for name in felt if name not in needed and change[name] > LEAST_FELT * table.gap
        ]
        separate = [*needed, *further][: max(players, len(needed))]
        _pairs(bench, table, sorted(separate, key=felt.index)[:PAIRED])
        for k, found in enumerate(bench.judged([needed[: k + 1] for k in range(len(needed))])):
            table.add("sequence", needed[k], found)
        _without(bench, table, {**{name: (name,) for name in separate}, **members})
        _shares(bench, table, separate, replays, seed)
    return pd.DataFrame(table.rows)


class DiagnosisRows:
    """The rows of a diagnosis, and the gaps they are shares of."""

    def __init__(self, start: Judged, end: Judged):
        self.rows: list[dict[str, Any]] = []
        self.criteria = list(start.mismatch)
        self.start, self.end = start.counted(self.criteria), end.counted(self.criteria)
        self.gap = start.total - end.total

    def explained(self, change: np.ndarray) -> np.ndarray:
        """Return changes of the mismatches (total, then criteria) as shares of their gaps."""
        gap = self.start - self.end
        gap[1:][gap[1:] < LEAST_GAP] = np.nan
        gap[0] = self.gap if self.gap > 0.0 else np.nan
        return change / gap

    def add(
        self,
        stage: str,
        term: str,
        found: Judged,
        interaction: float = np.nan,
        bound: float = np.nan,
    ) -> None:
        """Append a row of a choice that was flown."""
        explained = self.explained(self.start - found.counted(self.criteria))
        mismatch, ratio = (
            [each.get(name, np.nan) for name in self.criteria]
            for each in (found.mismatch, found.ratio)
        )
        nothing = np.full(len(explained), np.nan)
        self._append(
            stage,
            term,
            found.verdict,
            explained,
            nothing,
            interaction,
            bound,
            [found.total, *mismatch],
            ratio,
        )

    def add_idle(self, term: str, bound: float) -> None:
        """Append a term that was not flown alone, with the bound of what it moves."""
        nothing = np.full(len(self.criteria) + 1, np.nan)
        self._append(
            "idle",
            term,
            "not_tested",
            nothing,
            nothing,
            np.nan,
            bound,
            nothing.tolist(),
            nothing[1:].tolist(),
        )

    def add_share(
        self, term: str, change: np.ndarray, stderr: np.ndarray, left: np.ndarray
    ) -> None:
        """Append a share: changes of the mismatches, their standard errors, and the mismatches that
        remain.
        """
        nothing = [np.nan] * len(self.criteria)
        shares, errors = self.explained(-change), np.abs(self.explained(stderr))
        self._append(
            "share", term, "not_tested", shares, errors, np.nan, np.nan, left.tolist(), nothing
        )

    def _append(
        self, stage, term, verdict, explained, stderr, interaction, bound, mismatch, ratio
    ) -> None:
        row = {
            "stage": stage,
            "term": term,
            "explained": explained[0],
            "stderr": stderr[0],
            "interaction": interaction,
            "bound": bound,
        }
        row |= {"verdict": verdict, "mismatch": mismatch[0]}
        for k, name in enumerate(self.criteria):
            row |= {f"{name} mismatch": mismatch[k + 1], f"{name} ratio": ratio[k]}
            row |= {f"{name} explained": explained[k + 1], f"{name} stderr": stderr[k + 1]}
        self.rows.append(row)


def _total(found: Judged) -> float:
    return found.total if np.isfinite(found.total) else np.inf


def _pairs(bench: SwapBench, table: DiagnosisRows, names: Sequence[str]) -> None:
    """Append the pairs of the named terms, best first."""
    alone = {row["term"]: row["explained"] for row in table.rows if row["stage"] == "single"}
    pairs = list(combinations(names, 2))
    for (a, b), found in sorted(
        zip(pairs, bench.judged(pairs), strict=True), key=lambda row: _total(row[1])
    ):
        both = (table.start[0] - found.total) / table.gap
        table.add("pair", f"{a}{AND}{b}", found, both - alone[a] - alone[b])


def _needed(bench: SwapBench, felt: list[str], gap: float) -> list[str]:
    """Return the terms that make the case pass, found among those that change most alone.

    Where these do not suffice although the final model passes, the mismatch hides what other terms
    do, as that of a mode that is not even excited; then those are tried without which the final
    model is worst.
    """
    start, end = bench.judged([(), bench.names])
    found = _sequence(bench, start, gap, felt[:CANDIDATES])
    (reached,) = bench.judged([found])
    if reached.matched or not end.matched:
        return found
    left_out = bench.judged([[other for other in bench.names if other != name] for name in felt])
    loss = {name: _total(without) - end.total for name, without in zip(felt, left_out, strict=True)}
    second = _sequence(bench, start, gap, sorted(felt, key=lambda name: -loss[name])[:CANDIDATES])
    (better,) = bench.judged([second])
    return second if better.matched or better.total < reached.total else found


def _sequence(bench: SwapBench, start: Judged, gap: float, candidates: list[str]) -> list[str]:
    """Return the greedy sequence, cut where it is best, without the terms that turned out not to be
    needed.

    An addition that does not help by itself is taken all the same when nothing better is there,
    because the next may need it; what is gained has to be worth `LEAST_SHARE` of the gap for every
    term in the end.
    """
    names: list[str] = []
    path = [start]
    while not path[-1].matched and len(names) < len(candidates):
        free = [name for name in candidates if name not in names]
        trials = bench.judged([[*names, name] for name in free])
        best = min(range(len(free)), key=lambda k: _total(trials[k]))
        path.append(trials[best])
        names.append(free[best])
    best = min(range(len(path)), key=lambda k: (not path[k].matched, path[k].total))
    needed, reached = names[:best], path[best]
    bench.judged(
        [other for other in needed if other != name] for name in needed
    )  # side by side: most of them stay
    for name in reversed(names[:best]):
        (without,) = bench.judged([[other for other in needed if other != name]])
        if without.matched >= reached.matched and without.total - reached.total < LEAST_SHARE * gap:
            needed.remove(name)
    return needed


def _without(bench: SwapBench, table: DiagnosisRows, left_out: Mapping[str, Sequence[str]]) -> None:
    """Append the final model without each of these terms or groups, the worst first."""
    rests = [[other for other in bench.names if other not in names] for names in left_out.values()]
    flown = _of_groups(bench, left_out.values(), rests)
    for name, found in sorted(zip(left_out, flown, strict=True), key=lambda row: -_total(row[1])):
        table.add("without", name, found)


def _of_groups(
    bench: SwapBench, groups: Iterable[Collection[str]], choices: Iterable[Collection[str]]
) -> list[Judged]:
    """Return the judgements of choices that each take or leave out a group: as they are, but for a
    group of idle terms only.
    """
    meant = [
        nearest_choice(choice, bench.idle) if bench.idle.keys() >= set(group) else choice
        for group, choice in zip(groups, choices, strict=True)
    ]
    return bench.judged(meant, exact=True)


def _shares(
    bench: SwapBench, table: DiagnosisRows, separate: Sequence[str], replays: int, seed: int
) -> None:
    """Append the Shapley shares of the terms `separate` and of all others together."""
    others = [name for name in bench.names if name not in separate]
    players = [[name] for name in separate] + ([others] if others else [])
    labels = [*separate, *([OTHERS] if others else [])]

    def game(choices):
        flown = bench.judged(
            [[name for player in choice for name in players[player]] for choice in choices]
        )
        return np.stack([found.counted(table.criteria) for found in flown])

    found = shapley_shares(len(players), game, replays, seed)
    # what adds to the mismatch comes first: no level of the waterfall is below the mismatch of the
    # final model
    change = found.share[:, 0]
    order = sorted(
        range(len(players)), key=lambda k: (change[k] < 0.0, labels[k] == OTHERS, -abs(change[k]))
    )
    left = table.start + np.cumsum(found.share[order], axis=0)
    for k, player in enumerate(order):
        table.add_share(labels[player], found.share[player], found.stderr[player], left[k])
