"""Screening of terms whose swap cannot matter in a case, without a run of each.

The contribution of every term to its coefficient is computed along the recorded flight from both
databases. The size of a swap is the rms of the difference, weighted by dynamic pressure. The two
largest terms of every coefficient are flown. Their runs give the sensitivity of the judged outputs
to a unit of the coefficient, as the largest ratio. A smaller term is not flown alone if it moves
the outputs by less than `LEAST_MOVED`, even with `SAFETY` times the sensitivity. Each run may raise
the sensitivity.

This is a linear sensitivity with a margin, not a proof. Therefore all terms that are not flown are
swapped together, in the a-priori model and in the final one. If that changes the verdict, or a
criterion by more than `LEAST_TOGETHER`, the larger half of them is flown. The bound of a term is
its estimate with the margin, or the effect of all together if that is larger: a term may act
through states that only the model has, for example a rudder that its trim moves. The check does
not find terms whose effects cancel in both models.
"""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

import aerodb
from aerodb.comparison.record_conditions import fill_missing_devices
from flightmech import terms as _terms
from flightmech.errors import UnknownName
from flightmech.support.arrays import rms
from flighttest.reconstruction.dynamics.propeller_loads import with_engine_channels
from flighttest.reconstruction.dynamics.reduced_rates import reduced_rates
from pom.cases.job import with_stated_inputs
from pom.diagnosis.swap_judgement import Judged
from pom.diagnosis.swap_runs import SwapBench

# Share of the mismatch, as `Judged.moved`: a term that moves the outputs less is not flown alone.
LEAST_MOVED = 0.005
SAFETY = 3.0  # margin: a term may act along the flight otherwise than the flown terms
LEAST_TOGETHER = 0.02  # of the mismatch: largest effect of all idle terms together
# [half widths] Changes of a criterion are compared with its gap, or with this if that is larger.
LEAST_MISMATCH = 0.1
SAMPLES = 200  # of the flight


def screen_idle_terms(bench: SwapBench) -> None:
    """Find the idle terms of a bench and store them in it.

    All other terms are flown alone in the a-priori model. All idle terms are flown together in
    both models.
    """
    if bench.idle:
        return
    bounds = _EffectBounds(_swap_sizes(bench), defaultdict(float))
    order = sorted(bounds.size, key=lambda name: -bounds.size[name])
    # Terms without a size and parts are always flown.
    single = [name for name in bench.names if name not in bounds.size]
    bench.judged([name] for name in single)
    new = _largest_of_coefficients(order, count=2)
    while new:
        for name, judged in zip(new, bench.judged([name] for name in new), strict=True):
            bounds.update(name, judged)
        single += new
        # A higher sensitivity raises the bounds of all terms of the coefficient.
        new = []
        for name in order:
            if name not in single and bounds.size[name] > 0.0 and bounds.of(name) >= LEAST_MOVED:
                new.append(name)
    idle = [name for name in order if name not in single]
    idle.sort(key=lambda name: -bounds.of(name))
    while idle and not _have_small_effect(bench, idle):
        half = (len(idle) + 1) // 2
        bench.judged([name] for name in idle[:half])
        idle = idle[half:]
    (together,) = bench.judged([idle], exact=True)
    bound = {name: max(bounds.of(name), together.moved) for name in idle}
    bench.idle = dict(sorted(bound.items(), key=lambda item: -item[1]))


@dataclass(frozen=True)
class _EffectBounds:
    """Bounds of the effect of each term on the judged outputs.

    Attributes
    ----------
    size : dict of str to float
        Size of the swap of each term.
    sensitivity : dict of str to float
        By coefficient: largest effect of a flown term over its size.
    """

    size: dict[str, float]
    sensitivity: dict[str, float]

    def update(self, name: str, judged: Judged) -> None:
        """Raise the sensitivity of a coefficient to that of a flown term."""
        if self.size[name] > 0.0:
            ratio = judged.moved / self.size[name]
            head = _coefficient_of(name)
            self.sensitivity[head] = max(self.sensitivity[head], ratio)

    def of(self, name: str) -> float:
        """Return the bound of a term, as `Judged.moved`."""
        if not self.size[name] > 0.0:
            return 0.0
        return SAFETY * self.sensitivity[_coefficient_of(name)] * self.size[name]


def _coefficient_of(name: str) -> str:
    return name.split("/")[0]


def _largest_of_coefficients(order: Sequence[str], *, count: int) -> list[str]:
    """Return the first terms of every coefficient in an order of terms."""
    by_coefficient: dict[str, list[str]] = defaultdict(list)
    for name in order:
        by_coefficient[_coefficient_of(name)].append(name)
    largest: list[str] = []
    for names in by_coefficient.values():
        largest += names[:count]
    return largest


def _have_small_effect(bench: SwapBench, idle: list[str]) -> bool:
    """Whether these terms together change neither the a-priori model nor the final one."""
    start, end = bench.judged([(), bench.names], exact=True)
    active = [name for name in bench.names if name not in idle]
    prior_with_idle, final_without_idle = bench.judged([idle, active], exact=True)
    criteria = list(start.mismatch)
    gap = np.abs(start.counted(criteria) - end.counted(criteria))
    limit = LEAST_TOGETHER * np.fmax(gap, LEAST_MISMATCH)
    for swapped, model in ((prior_with_idle, start), (final_without_idle, end)):
        if swapped.verdict != model.verdict:
            return False
        change = np.abs(swapped.counted(criteria) - model.counted(criteria))
        if not (change <= limit).all():
            return False
    return prior_with_idle.moved < LEAST_TOGETHER


def _swap_sizes(bench: SwapBench) -> dict[str, float]:
    """Return the rms change of its coefficient by the swap of each term along the flight.

    The result is empty if the record lacks a variable of a term.
    """
    prior, final = bench.models.prior, bench.models.final
    prior_terms, final_terms = aerodb.terms(prior), aerodb.terms(final)
    every = max(1, bench.states.sizes["time"] // SAMPLES)
    try:
        aircraft = bench.models.aircraft[1]
        flight = with_stated_inputs(bench.case, bench.states)
        states = with_engine_channels(reduced_rates(flight, aircraft), aircraft)
        states = states.isel(time=slice(None, None, every))
        complete, _ = fill_missing_devices(states, prior, final)
    except UnknownName:
        return {}
    variables = {"V"}
    for terms in (prior_terms, final_terms):
        for name in bench.terms:
            if name in terms:
                variables.update(_terms.list_model_variables(terms[name]))
    columns = {}
    counted = np.ones(complete.sizes["time"], bool)
    for name in sorted(variables):
        columns[name] = np.broadcast_to(complete[name].values, complete.sizes["time"])
        # Only samples at which all variables are finite.
        counted &= np.isfinite(columns[name])
    if not counted.any():
        return {}
    samples = {name: values[counted].astype(float) for name, values in columns.items()}
    # The dynamic pressure is proportional to V^2 at constant density.
    weight = np.square(samples["V"] / samples["V"].max())
    places = dict[Any, Any]()  # breakpoints of the samples, which terms over the same axes share
    sizes = {}
    for name in bench.terms:
        values: list[Any] = []
        for terms in (prior_terms, final_terms):
            if name in terms:
                values.append(_terms.evaluate_term(terms[name], samples, "clamp", places))
            else:
                values.append(0.0)
        sizes[name] = rms(weight * (values[1] - values[0]))
    return sizes
