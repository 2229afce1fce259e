"""Choice between friction that is developed by the rate and friction that builds up over a travel.

Both models have one width as an unknown; Coulomb's friction is the limit of either.  The likelihood
chooses.  Where it cannot, the difference of the estimates is one more error of them: an error of
the model that the records admit is part of the standard error.

A likelihood with kinks has neighbouring maxima.  The likelier model is searched from several
starts, which depend on the records alone.  The best maximum is the result, and others that are
nearly as likely are treated as further models.

References
----------
.. [Dahl1968] P. R. Dahl, A solid friction model, Aerospace Corporation TOR-0158(3107-18)-1, 1968.
.. [Canudas1995] Canudas de Wit, Olsson, Astrom, Lischinsky, A new model for control of systems with
   friction, IEEE Trans. Automatic Control 40, 1995 (LuGre; here without Stribeck effect).
.. [Schwarz1978] G. Schwarz, Estimating the dimension of a model, Annals of Statistics 6, 1978.
.. [Buckland1997] Buckland, Burnham, Augustin, Model selection: an integral part of inference,
   Biometrics 53, 1997.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from contextlib import suppress
from dataclasses import replace
from typing import NamedTuple

import numpy as np

from flightmech.errors import IdentificationError
from flighttest.submodels.control_loading.loading import ControlLoading
from flighttest.submodels.control_loading.responses.circuit_fit import (
    WIDE,
    CircuitFit,
    CircuitStart,
    fit_circuit,
)
from flighttest.submodels.control_loading.responses.driven_rows import DrivenRows
from flighttest.submodels.control_loading.responses.free_response import FreeWindow
from flighttest.submodels.control_loading.responses.window_response import (
    BRISTLE_TRAVEL,
    FRICTION_RATE,
    WIDTHS,
)

# Difference of two costs from which on the less likely model has a weight below 1e-8. [nats]
_HOPELESS = 20.0
# Difference of two costs up to which another maximum of the same model counts. [nats]
_NEARLY = 5.0
# First widths of further searches over those of the first one: of friction, and of the preload.
_NARROW, _SOFT = 0.1, 10.0
# Largest difference of two ends, in standard errors, that are one maximum.
_SAME = 1e-3


class FrictionChoice(NamedTuple):
    """The likelier model of friction.

    Attributes
    ----------
    fit : CircuitFit
        Its estimates; the covariance contains the differences to the other model, and to other
        maxima.
    weights : dict of str to float
        Weight of each model by the name of its width; their sum is 1.
    widened : float
        Largest factor by which the other model widens the standard error of a constant.
    maxima : int
        Maxima of the likelier model whose costs are within 5 of the best.
    widened_by_maxima : float
        Largest factor by which these widen the standard error of a constant.
    unfinished : tuple of str
        Widths of models whose search did not reach a maximum: their likelihood may be higher.
    """

    fit: CircuitFit
    weights: dict[str, float]
    widened: float
    maxima: int
    widened_by_maxima: float
    unfinished: tuple[str, ...]


class _CircuitArguments(NamedTuple):
    """First arguments of `fit_circuit`."""

    loading: ControlLoading
    windows: Sequence[FreeWindow]
    rows: Sequence[DrivenRows]
    start: Mapping[str, float]
    prior: Mapping[str, tuple[float, float]]


def fit_friction_models(
    loading: ControlLoading,
    windows: Sequence[FreeWindow],
    rows: Sequence[DrivenRows],
    start: Mapping[str, float],
    prior: Mapping[str, tuple[float, float]],
) -> FrictionChoice:
    """Return the likelier of both models of friction.

    The arguments are those of `fit_circuit`.  The weights are those of the Bayesian information
    criterion [Schwarz1978] and add up to 1.  The covariance contains the weighted squares of the
    differences of the estimates [Buckland1997].  Without friction there is one model.

    Raises
    ------
    IdentificationError
        As `fit_circuit`.
    """
    records = _CircuitArguments(loading, windows, rows, start, prior)
    if "friction" not in start:
        return join_models({FRICTION_RATE: [fit_circuit(*records)]})
    # A wide preload and a narrow one lead to different maxima.
    first = [CircuitStart()]
    if "preload" in start:
        first.append(CircuitStart(preload_width=_SOFT * WIDE))
    # Where a control begins to slide, the likelihood of bristles has kinks whose places are known,
    # that of friction by the rate has sharp bends. The search with bristles comes first.
    # The other one is not searched to its end if it is hopeless: its weight would be zero.
    ends: dict[str, list[CircuitFit]] = {}
    limit = np.inf
    # If only one of the models cannot be searched, it does not explain these records.
    with suppress(IdentificationError):
        ends[BRISTLE_TRAVEL] = _search_from(first, records, BRISTLE_TRAVEL)
        limit = _least_cost(ends[BRISTLE_TRAVEL]) + _HOPELESS
    try:
        ends[FRICTION_RATE] = _search_from(first, records, FRICTION_RATE, limit)
    except IdentificationError:
        if not ends:
            raise
    return join_models(_search_again(records, ends))


def _search_from(
    starts: Sequence[CircuitStart],
    records: _CircuitArguments,
    width: str,
    limit: float = np.inf,
    known: Sequence[CircuitFit] = (),
) -> list[CircuitFit]:
    """Return the known ends of one model, and those of searches from several starts.

    A search that comes near neither the best end nor the limit ends early.

    Raises
    ------
    IdentificationError
        From no start the records can be simulated, and no end is known.
    """
    ends = list(known)
    for begin in starts:
        beyond = min(limit, _least_cost(ends) + _NEARLY)
        try:
            ends.append(fit_circuit(*records, width, beyond, begin))
        except IdentificationError:
            if not ends and begin is starts[-1]:
                raise
    return ends


def _least_cost(ends: Sequence[CircuitFit]) -> float:
    return min((end.maximum.cost for end in ends), default=np.inf)


def _search_again(
    records: _CircuitArguments, ends: Mapping[str, Sequence[CircuitFit]]
) -> dict[str, list[CircuitFit]]:
    """Return all ends of searches by the name of their width.

    A model that may become the likelier one is searched again: from a narrow width of friction, and
    from the best end of the other model.
    """
    least = min(_least_cost(found) for found in ends.values())
    all_ends = {}
    for width, found in ends.items():
        all_ends[width] = list(found)
        if _least_cost(found) > least + _HOPELESS:
            continue
        starts = [CircuitStart(_NARROW * WIDE)]
        for name, others in ends.items():
            if name != width:
                starts.append(CircuitStart.at(min(others, key=lambda end: end.maximum.cost)))
        all_ends[width] = _search_from(starts, records, width, known=found)
    return all_ends


def join_models(ends: Mapping[str, Sequence[CircuitFit]]) -> FrictionChoice:
    """Return the likeliest of fits, by the name of their width, with the spread of all.

    A model has the weight of its best end, however many it has.
    """
    maxima = {width: _distinct(fits) for width, fits in ends.items()}
    criteria = [_half_criterion(fits[0], width) for width, fits in maxima.items()]
    weights = dict(zip(maxima, _weights(criteria).tolist()))
    chosen = max(weights, key=lambda width: weights[width])
    best = maxima[chosen][0]
    own = best.covariance + weights[chosen] * _spread(best, maxima[chosen])
    covariance = own.copy()
    for width, fits in maxima.items():
        if width != chosen:
            covariance += weights[width] * _spread(best, fits)
    unfinished = [width for width, fits in maxima.items() if not fits[0].maximum.is_proven]
    return FrictionChoice(
        fit=replace(best, covariance=covariance),
        weights=weights,
        widened=_growth(best.names, own, covariance),
        maxima=len(maxima[chosen]),
        widened_by_maxima=_growth(best.names, best.covariance, own),
        unfinished=tuple(unfinished),
    )


def _distinct(fits: Sequence[CircuitFit]) -> list[CircuitFit]:
    """Return the ends of one model that are maxima of their own, best first.

    The best end is kept even if its search did not converge: the likelihood is as high as there.
    """
    ordered = sorted(fits, key=lambda fit: fit.maximum.cost)
    kept = ordered[:1]
    variances = np.diag(kept[0].covariance)
    stderr = np.sqrt(np.where(variances > 0.0, variances, np.inf))
    for fit in ordered[1:]:
        if not fit.maximum.is_proven or fit.maximum.cost > kept[0].maximum.cost + _NEARLY:
            continue
        apart = [float(np.max(np.abs(fit.theta - one.theta) / stderr)) for one in kept]
        if min(apart) > _SAME:
            kept.append(fit)
    return kept


def _spread(best: CircuitFit, fits: Sequence[CircuitFit]) -> np.ndarray:
    """Return the mean square of the differences from the best fit, weighted by the likelihoods."""
    spread = np.zeros_like(best.covariance)
    for weight, fit in zip(_weights([fit.maximum.cost for fit in fits]), fits):
        change = np.zeros(len(best.names))
        for k, name in enumerate(best.names):
            if name in fit.names:
                change[k] = fit.theta[fit.names.index(name)] - best.theta[k]
        spread += weight * np.outer(change, change)
    return spread


def _weights(costs: Sequence[float]) -> np.ndarray:
    """Return likelihoods that add up to 1, from their negative logarithms."""
    likelihoods = np.exp(min(costs) - np.array(costs))
    return likelihoods / likelihoods.sum()


def _growth(names: Sequence[str], before: np.ndarray, after: np.ndarray) -> float:
    """Return the largest factor between the standard errors of two covariances, widths left out.

    Maxima differ mostly by the widths, on which a constant of the circuit may hardly depend.
    """
    is_constant = np.array([name not in WIDTHS for name in names])
    first, second = np.diag(before)[is_constant], np.diag(after)[is_constant]
    ratio = np.divide(second, first, out=np.ones_like(second), where=first > 0.0)
    return float(np.sqrt(ratio.max(initial=1.0)))


def _half_criterion(fit: CircuitFit, width: str) -> float:
    """Return half the Bayesian information criterion, less what both models share.

    A width at its smallest value is Coulomb's friction, which has no width as an unknown.
    """
    k = fit.names.index(width)
    is_free = fit.theta[k] > fit.likelihood.layout.low[k]
    readings = sum(int(mask.sum()) for mask in fit.likelihood.has_reading)
    return fit.maximum.cost + 0.5 * is_free * float(np.log(readings))
