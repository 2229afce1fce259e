"""Wrong terms of a model, ranked over all cases of a project together.

Two wrong terms can compensate each other: the case passes with both, and the correction of one
makes it worse. A sequence that starts at the wrong model and stops when a case passes does not
name both. The ranking therefore starts at the other end. In the final model one term after the
other is put back as it was a priori, with all other terms right. No other error can then hide the
effect of the term. The gain of the term in a case with the mismatches m of the final model and m'
without the term is

    log((m'^2 + LEAST_GAP^2) / (m^2 + LEAST_GAP^2)),

the logarithm of a likelihood ratio with the residual of the final model as its noise: a case that
the final model itself matches badly counts less. The gains of all cases are added.

The distance from the flight evidence is the prior knowledge. A term that is wrong differs from the
flight estimates by many standard errors. A term that is right has the distance of a normal
variable. The odds are even at `FAR` standard errors, so a term has the weight

    w = 1 / (1 + exp((FAR^2 - d^2) / 2)),

which follows from the likelihood exp(-d^2/2) of a right term. The score of a term is the sum over
the cases of its gain times its weight, with the distance along the flight of that case.
"""

from __future__ import annotations

from collections.abc import Collection, Mapping, Sequence
from itertools import chain
from typing import Any

import numpy as np
import pandas as pd
import xarray as xr
from joblib import Parallel, delayed

import aerodb
from flightmech.errors import UnknownName
from flightmech.support.arrays import rms
from flighttest.reconstruction.dynamics.propeller_loads import with_engine_channels
from flighttest.reconstruction.dynamics.reduced_rates import reduced_rates
from pom.cases.job import with_stated_inputs
from pom.diagnosis.kept_diagnosis import LateBench
from pom.diagnosis.screening import screen_idle_terms
from pom.diagnosis.swap_judgement import (
    CEILING,
    LEAST_GAP,
    Judged,
    effect_correlation,
    effect_products,
)
from pom.diagnosis.swap_runs import SwapBench
from pom.judging.beyond_the_bands import FAR, Evidence, nodes_from_flight

UNKNOWN_WEIGHT = 0.5  # of a term without flight evidence: even odds
MOST_CORRECTED = 8  # terms of the sequence of corrections
LEAST_WORSE = 0.005  # half widths: a correction that raises the mismatch by less is not worse
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
        The highest score first. ``term``; ``score``;
        ``effect``, the mismatch that the wrong term adds to the final model, as the root of the
        difference of squares, in the ``case`` where that is largest [half widths]; ``distance``
        from the evidence in that case, or that of the nodes for a term that the case does not use
        [standard errors], NaN without evidence;
        ``alone``, the mismatch of the a-priori model with only this term corrected, and
        ``without``, that of the final model with only this term wrong, both as the rms over all
        cases [half widths]; ``felt``, the number of cases with an effect of at least `LEAST_GAP`.
    """
    calls = [delayed(_measure_case)(bench, evidence) for bench in benches.values()]
    measured = list(Parallel(n_jobs=jobs, backend="threading")(calls))
    counted = [one for one in measured if one is not None]
    cases = [name for name, one in zip(benches, measured, strict=True) if one is not None]
    names = dict.fromkeys(chain.from_iterable(one.names for one in counted))
    by_nodes: dict[str, float] = {}
    if counted and evidence is not None:
        by_nodes = node_distances(counted[0].model, evidence)
    rows = []
    for name in names:
        changes = np.array([one.square_change(name) for one in counted])
        largest = int(np.argmax(changes))
        gains = np.array([one.gain(name) for one in counted])
        distances = []
        for one in counted:
            distances.append(one.distances.get(name, by_nodes.get(name, np.nan)))
        weights = np.array([evidence_weight(distance) for distance in distances])
        rows.append(
            {
                "term": name,
                # A term that improves the final model is not wrong. The sign of the sum decides.
                "score": max(float(gains @ weights), 0.0),
                "effect": float(np.sqrt(max(changes[largest], 0.0))),
                "distance": distances[largest],
                "alone": rms(np.array([one.alone.get(name, one.prior) for one in counted])),
                "without": rms(np.array([one.without.get(name, one.final) for one in counted])),
                "case": cases[largest],
                "felt": int((changes >= LEAST_GAP**2).sum()),
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
        without = []
        for name in active:
            without.append([other for other in bench.names if other != name])
        start, end = bench.judged([(), bench.names])
        self.prior, self.final = _counted_total(start), _counted_total(end)
        # Terms that are not flown alone move the case by less than their bound: no effect.
        self.alone = _totals(active, bench.judged([name] for name in active))
        self.without = _totals(active, bench.judged(without, exact=True))
        self.distances = distances
        self.model = bench.whole.models.prior

    def square_change(self, name: str) -> float:
        """Return by how much the wrong term changes the squared mismatch of the final model."""
        return self.without.get(name, self.final) ** 2 - self.final**2

    def gain(self, name: str) -> float:
        """Return the gain of a term."""
        return float(np.log1p(self.square_change(name) / (self.final**2 + LEAST_GAP**2)))


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
    if evidence is None:
        return _MeasuredCase(whole, {})
    return _MeasuredCase(whole, _flown_distances(whole, evidence))


def _flown_distances(bench: SwapBench, evidence: xr.DataTree) -> dict[str, float]:
    """Return the distances of the a-priori model from the evidence along a flight.

    They are empty if the record lacks a variable of a term. The nodes are then compared.
    """
    aircraft = bench.models.aircraft[1]
    flight = with_stated_inputs(bench.case, bench.states)
    states = with_engine_channels(reduced_rates(flight, aircraft), aircraft)
    hinges = bench.case.drive.level != "recorded"
    try:
        flown = Evidence(evidence, states, hinges=hinges)
    except UnknownName:
        return {}
    # The compiled model has both versions of a term; the a-priori one has the plain name.
    return flown.distances(bench.models.compiled(frozenset()))


def node_distances(model: xr.DataTree, evidence: xr.DataTree) -> dict[str, float]:
    """Return the distance of every term whose nodes are from flight, by its nodes.

    It is the rms of the differences over the standard errors. It serves terms whose contribution
    to a case is so small that a distance along the flight is not meaningful.

    Parameters
    ----------
    model : DataTree
    evidence : DataTree
        A term on other breakpoints than that of the model has no distance.

    Returns
    -------
    dict of str to float
        [standard errors]
    """
    leaves, distances = aerodb.terms(model), {}
    for name, leaf in aerodb.terms(evidence).items():
        counted = nodes_from_flight(leaf)
        if not counted.any() or name not in leaves:
            continue
        counted &= leaf["stderr"].values > 0.0
        value = leaves[name]["value"]
        if (
            value.dims == leaf["value"].dims
            and value.shape == leaf["value"].shape
            and counted.any()
        ):
            # rms of the differences in standard errors, over the nodes from flight.
            difference = (value.values - leaf["value"].values)[counted]
            distances[name] = rms(difference / leaf["stderr"].values[counted])
    return distances


def order_corrections(benches: Benches, ranked: pd.DataFrame) -> pd.DataFrame:
    """Return the joint mismatch as the ranked terms are corrected one after the other.

    The sequence does not stop when a case passes, because a case may pass by errors that
    compensate each other. It has every term with a score and an effect of at least `LEAST_GAP` in
    a case, at most `MOST_CORRECTED` terms.

    Parameters
    ----------
    benches : mapping of str to SwapBench or LateBench
    ranked : DataFrame
        Of `rank_culprits`.

    Returns
    -------
    DataFrame
        The first row is the a-priori model (``term`` empty), the last one the final model (``term``
        ``final``). ``mismatch`` over all cases with this term and those before it [half widths];
        ``matched``, the number of cases within tolerance, and ``cases``, all of them that are
        judged; ``partner`` and ``correlation``, for a term that makes the mismatch larger: the
        later term whose effect on the judged outputs opposes its effect most, and their
        correlation.
    """
    felt = ranked[(ranked["felt"] > 0) & (ranked["score"] > 0.0)]
    names = list(felt["term"][:MOST_CORRECTED])
    judged_benches = {name: bench for name, bench in benches.items() if _is_judged(bench)}
    rows = [_state_row("", judged_benches, ())]
    for k, name in enumerate(names):
        row = _state_row(name, judged_benches, names[: k + 1])
        if row["mismatch"] - rows[-1]["mismatch"] > LEAST_WORSE:
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
