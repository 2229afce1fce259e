"""Start of the filter error of a simulation: output error, then flights linearised there."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from flightmech.errors import IdentificationError
from flighttest.maximum_likelihood.constrained_unknowns import (
    ConstrainedUnknowns,
    constrain_unknowns,
)
from flighttest.maximum_likelihood.likelihood import Likelihood
from flighttest.maximum_likelihood.linear.innovation_likelihood import (
    ConstrainedFilter,
    InnovationLikelihood,
    intensity_starts,
    search_from_starts,
)
from flighttest.maximum_likelihood.nonlinear.filtered_flight import FilteredFlight, is_of_filter
from flighttest.maximum_likelihood.nonlinear.linearised_flights import LinearisedPiece
from flighttest.maximum_likelihood.search import maximise_likelihood
from flighttest.maximum_likelihood.time_domain import SimulatedRecord
from flighttest.maximum_likelihood.unknowns import UnknownVector

_LINEAR_ITERATIONS = 12  # of each search with linearised flights
_STEP, _SIZE = 1e-4, 1e-2  # step of the differences there, in sizes; least size without a prior


def start_by_output_error(
    runs: Sequence[SimulatedRecord],
    natural: UnknownVector,
    layout: UnknownVector,
    groups: np.ndarray,
    iterations: int,
    constraints: Sequence[str],
) -> np.ndarray:
    """Return the start of the search, with the parameters of the simulation by output error.

    The start stays as given if output error fails, as of an unstable aircraft.

    Parameters
    ----------
    runs : sequence of SimulatedRecord
    natural : UnknownVector
        All unknowns.
    layout : UnknownVector
        Free unknowns of the search; those of the simulation are as in `natural`.
    groups : array of int (manoeuvre,)
        Manoeuvres of one group have one noise.
    iterations : int
    constraints : sequence of str
        Among parameters of the simulation.
    """
    start = layout.start.copy()
    chosen = np.array([not is_of_filter(name) for name in natural.names])
    if not chosen.any():
        return start
    constrained = constrain_unknowns(_pick_unknowns(natural, chosen), constraints)
    target = Likelihood(constrained.wrap(runs), constrained.layout, groups)
    try:
        found = maximise_likelihood(target, iterations)
    except IdentificationError:
        return start
    values = dict(zip(constrained.layout.names, found.theta))
    return np.array([values.get(name, given) for name, given in zip(layout.names, start)])


def start_by_linear_model(
    pieces: Sequence[FilteredFlight],
    constrained: ConstrainedUnknowns,
    layout: UnknownVector,
    start: np.ndarray,
) -> tuple[np.ndarray, int]:
    """Return the best end of searches with the flights linearised about a start.

    Also the number of searches that ended above it. Intensities start from several values.

    Parameters
    ----------
    pieces : sequence of FilteredFlight
    constrained : ConstrainedUnknowns
        Relation of the free unknowns to all, in the form of the search.
    layout : UnknownVector
        Free unknowns.
    start : array (free unknown,)
    """
    full, values = constrained.full, constrained.elimination.expand(start)
    steps = _STEP * np.where(np.isfinite(full.sigma), full.sigma, np.maximum(abs(values), _SIZE))
    linear = []
    for piece, columns in zip(pieces, full.columns):
        linear.append(LinearisedPiece(piece, values[columns], steps[columns]))
    starts = []
    for given in intensity_starts(layout):
        # of the parameters of the simulation all starts are the same
        first = np.where([is_of_filter(name) for name in layout.names], given, start)
        starts.append(first)
    try:
        likelihood = InnovationLikelihood(constrained.wrap(linear, ConstrainedFilter), layout)
        best, worse = search_from_starts(likelihood, starts, iterations=_LINEAR_ITERATIONS)
    except (IdentificationError, np.linalg.LinAlgError):
        return start, 0
    return best.theta, worse


def _pick_unknowns(layout: UnknownVector, chosen: np.ndarray) -> UnknownVector:
    """Return the vector of some unknowns."""
    position = np.cumsum(chosen) - 1
    bases, columns = [], []
    for names, places in zip(layout.bases, layout.columns):
        kept = chosen[places]
        bases.append(tuple(np.array(names, object)[kept]))
        columns.append(position[places[kept]])
    return replace(
        layout,
        names=tuple(np.array(layout.names, object)[chosen]),
        bases=tuple(bases),
        columns=tuple(columns),
        start=layout.start[chosen],
        sigma=layout.sigma[chosen],
        low=layout.low[chosen],
        high=layout.high[chosen],
    )
