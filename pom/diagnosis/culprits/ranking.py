"""Wrong terms of a model, ranked over all cases of a project together.

Two wrong terms can compensate each other: the case passes with both, and the correction of one
makes it worse. A sequence that starts at the wrong model and stops when a case passes does not
name both. The ranking therefore starts at the other end. In the final model one term after the
other is put back as it was a priori, with all other terms right. No other error can then hide the
effect of the term. The effects of all cases are added.

The distance from the flight evidence is the prior knowledge. A term that is wrong differs from the
flight estimates by many standard errors. A term that is right has the distance of a normal
variable. The odds are even at `FAR` standard errors, so a term has the weight

    w = 1 / (1 + exp((FAR^2 - d^2) / 2)),

which follows from the likelihood exp(-d^2/2) of a right term. The score of a term is its effect
times its weight.
"""

from __future__ import annotations

from collections.abc import Collection, Mapping, Sequence
from typing import Any

import numpy as np
import pandas as pd
import xarray as xr
from joblib import Parallel, delayed

from flightmech.support.arrays import rms
from pom.diagnosis.diagnosis import LEAST_GAP
from pom.diagnosis.kept_diagnosis import LateBench
from pom.diagnosis.screening import screen_idle_terms
from pom.diagnosis.swap_judgement import (
    CEILING,
    Judged,
    effect_correlation,
    effect_products,
)
from pom.diagnosis.swap_runs import SwapBench
from pom.judging.beyond_the_bands import FAR, Evidence

UNKNOWN_WEIGHT = 0.5  # of a term without flight evidence: even odds
MOST_CORRECTED = 8  # terms of the sequence of corrections
_LARGEST_EXPONENT = 700.0  # exp() of more is beyond double precision
_COLUMNS = ["term", "score", "effect", "distance", "alone", "without", "case", "felt"]

Benches = Mapping[str, SwapBench | LateBench]


def rank_culprits(
    benches: Benches, evidence: xr.DataTree | None = None, jobs: int = 1
) -> pd.DataFrame:
    """Rank the differing terms and parts by how likely they are wrong in the a-priori model.

    Parameters
    ----------
    benches : mapping of str to SwapBench or LateBench
        By name of the case.
    evidence : DataTree, optional
        Identified database with standard errors, for example the final one. The tables of a bench
        have none. Without it all terms have the same weight.
    jobs : int
        Cases flown at the same time.

    Returns
    -------
    DataFrame
        The highest score first. ``term``; ``score``, the effect times the weight of the distance;
        ``effect``, the mismatch that the term causes in the final model, as the root of the mean
        square over the cases [half widths]; ``distance`` from the evidence in the case where it is
        largest [standard errors], NaN without evidence; ``alone``, the mismatch of the a-priori
        model with only this term corrected, and ``without``, that of the final model with only
        this term wrong, both over all cases [half widths]; ``case``, where the effect is largest;
        ``felt``, the number of cases in which it is at least `LEAST_GAP`.
    """
    calls = [delayed(_measure_case)(bench, evidence) for bench in benches.values()]
    measured = list(Parallel(n_jobs=jobs, backend="threading")(calls))
    counted = [one for one in measured if one is not None]
    cases = [name for name, one in zip(benches, measured, strict=True) if one is not None]
    names = dict.fromkeys(name for one in counted for name in one.names)
    rows = []
    for name in names:
        effects = np.array([one.effect(name) for one in counted])
        # A term that improves the final model is not wrong. The sign of the sum decides.
        effect = float(np.sqrt(max(np.mean(effects), 0.0)))
        distances = [one.distances[name] for one in counted if name in one.distances]
        distance = max(distances, default=np.nan)
        rows.append(
            {
                "term": name,
                "score": effect * evidence_weight(distance),
                "effect": effect,
                "distance": distance,
                "alone": rms(np.array([one.alone.get(name, one.prior) for one in counted])),
                "without": rms(np.array([one.without.get(name, one.final) for one in counted])),
                "case": cases[int(np.argmax(effects))],
                "felt": int((effects >= LEAST_GAP**2).sum()),
            }
        )
    table = pd.DataFrame(rows, columns=_COLUMNS)
    return table.sort_values("score", ascending=False, kind="stable", ignore_index=True)


def evidence_weight(distance: float) -> float:
    """Return the weight of a distance from the evidence [standard errors], between 0 and 1."""
    if np.isnan(distance):
        return UNKNOWN_WEIGHT
    exponent = 0.5 * (FAR**2 - distance**2)
    return float(1.0 / (1.0 + np.exp(min(exponent, _LARGEST_EXPONENT))))


class _MeasuredCase:
    """Mismatches of one case: of both models, and of both with one term exchanged."""

    def __init__(self, bench: SwapBench | LateBench, distances: Mapping[str, float]):
        self.names = bench.names
        active = [name for name in bench.names if name not in bench.idle]
        without = [[one for one in bench.names if one != name] for name in active]
        start, end = bench.judged([(), bench.names])
        self.prior, self.final = _counted_total(start), _counted_total(end)
        # Terms that are not flown alone move the case by less than their bound: no effect.
        self.alone = _totals(active, bench.judged([name] for name in active))
        self.without = _totals(active, bench.judged(without, exact=True))
        self.distances = distances

    def effect(self, name: str) -> float:
        """Return the square of the mismatch that a term causes in the final model."""
        return self.without.get(name, self.final) ** 2 - self.final**2


def _totals(names: Sequence[str], judgements: Sequence[Judged]) -> dict[str, float]:
    totals = {}
    for name, judged in zip(names, judgements, strict=True):
        totals[name] = _counted_total(judged)
    return totals


def _counted_total(judged: Judged) -> float:
    """Return the total mismatch, at most `CEILING`, which also counts for a failed run."""
    return float(np.fmin(judged.total, CEILING))


def _measure_case(
    bench: SwapBench | LateBench, evidence: xr.DataTree | None
) -> _MeasuredCase | None:
    """Return the mismatches of a case; None if nothing of it is judged."""
    (start,) = bench.judged([()])
    if not start.mismatch:
        return None
    whole = bench.whole
    screen_idle_terms(whole)
    distances: dict[str, float] = {}
    if evidence is not None:
        hinges = whole.case.drive.level != "recorded"
        # The compiled model has both versions of a term; the a-priori one has the plain name.
        model = whole.models.compiled(frozenset())
        distances = Evidence(evidence, whole.states, hinges=hinges).distances(model)
    return _MeasuredCase(whole, distances)


def order_corrections(benches: Benches, ranked: pd.DataFrame) -> pd.DataFrame:
    """Return the joint mismatch as the ranked terms are corrected one after the other.

    The sequence does not stop when a case passes, because a case may pass by errors that
    compensate each other. It has every term with an effect of at least `LEAST_GAP`, at most
    `MOST_CORRECTED`.

    Parameters
    ----------
    benches : mapping of str to SwapBench or LateBench
    ranked : DataFrame
        Of `rank_culprits`.

    Returns
    -------
    DataFrame
        The first row is the a-priori model (``term`` empty), the last one the final model
        (``term`` ``final``). ``mismatch`` over all cases with this term and those before it
        [half widths]; ``matched``, the number of cases within tolerance, and ``cases``, all of
        them; ``partner`` and ``correlation``, for a term that makes the mismatch larger: the later
        term whose effect on the judged outputs opposes its effect most, and their correlation.
    """
    felt = ranked[ranked["effect"] >= LEAST_GAP]
    names = list(felt["term"][:MOST_CORRECTED])
    judged_benches = {name: bench for name, bench in benches.items() if _is_judged(bench)}
    rows = [_state_row("", judged_benches, ())]
    for k, name in enumerate(names):
        row = _state_row(name, judged_benches, names[: k + 1])
        if row["mismatch"] > rows[-1]["mismatch"]:
            # All ranked terms may be the counterpart, also those after the last correction.
            others = [other for other in felt["term"] if other != name]
            row |= _opposing_term(judged_benches, name, others[:MOST_CORRECTED])
        rows.append(row)
    rows.append(_state_row("final", judged_benches, None))
    return pd.DataFrame(rows)


def _is_judged(bench: SwapBench | LateBench) -> bool:
    (start,) = bench.judged([()])
    return bool(start.mismatch)


def _state_row(term: str, benches: Benches, corrected: Collection[str] | None) -> dict[str, Any]:
    """Return the row of the a-priori model with some final terms; of the final model for None."""
    totals, matched = [], 0
    for bench in benches.values():
        choice = bench.names
        if corrected is not None:
            choice = tuple(name for name in bench.names if name in corrected)
        (judged,) = bench.judged([choice])
        totals.append(_counted_total(judged))
        matched += judged.matched
    return {
        "term": term,
        "mismatch": rms(np.array(totals)),
        "matched": matched,
        "cases": len(totals),
        "partner": "",
        "correlation": np.nan,
    }


def _opposing_term(benches: Benches, name: str, others: Sequence[str]) -> dict[str, Any]:
    """Return the term with the most negative correlation of its effect with that of `name`."""
    correlations = {}
    for other in others:
        parts = np.zeros(3)
        for bench in benches.values():
            active = {*bench.names}.difference(bench.idle)
            if {name, other} <= active:
                first, second, both = bench.judged([[name], [other], [name, other]])
                parts += effect_products(first, second, both, bench.whole.sizes)
        correlations[other] = effect_correlation(parts)
    opposing = {term: value for term, value in correlations.items() if value < 0.0}
    if not opposing:
        return {}
    partner = min(opposing, key=lambda term: opposing[term])
    return {"partner": partner, "correlation": opposing[partner]}
