"""Choice between friction that is developed by the rate and friction that builds up over a travel.

Both models have one width as an unknown; Coulomb's friction is the limit of either.  The likelihood
chooses.  Where it cannot, the difference of the estimates is one more error of them: an error of
the model that the records admit is part of the standard error.

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
from flighttest.submodels.control_loading.responses.circuit_fit import CircuitFit, fit_circuit
from flighttest.submodels.control_loading.responses.driven_rows import DrivenRows
from flighttest.submodels.control_loading.responses.free_response import FreeWindow
from flighttest.submodels.control_loading.responses.window_response import (
    BRISTLE_TRAVEL,
    FRICTION_RATE,
)

# Difference of two costs from which on the less likely model has a weight below 1e-8. [nats]
_HOPELESS = 20.0


class FrictionChoice(NamedTuple):
    """The likelier model of friction.

    Attributes
    ----------
    fit : CircuitFit
        Its estimates; the covariance contains the differences to the other model.
    weights : dict of str to float
        Weight of each model by the name of its width; their sum is 1.
    widened : float
        Largest factor by which the differences widen a standard error.
    """

    fit: CircuitFit
    weights: dict[str, float]
    widened: float


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
    records = (loading, windows, rows, start, prior)
    if "friction" not in start:
        return join_models({FRICTION_RATE: fit_circuit(*records)})
    # Where a control begins to slide, the likelihood of bristles has kinks whose places are known,
    # that of friction by the rate has sharp bends. The search with bristles comes first.
    # The other one is not searched to its end if it is hopeless: its weight would be zero.
    fits = {}
    limit = np.inf
    # If only one of the models cannot be searched, it does not explain these records.
    with suppress(IdentificationError):
        fits[BRISTLE_TRAVEL] = fit_circuit(*records, BRISTLE_TRAVEL)
        limit = fits[BRISTLE_TRAVEL].maximum.cost + _HOPELESS
    try:
        fits[FRICTION_RATE] = fit_circuit(*records, FRICTION_RATE, limit)
    except IdentificationError:
        if not fits:
            raise
    return join_models(fits)


def join_models(fits: Mapping[str, CircuitFit]) -> FrictionChoice:
    """Return the likeliest of fits, by the name of their width, with the spread of the models."""
    criteria = {width: _half_criterion(fit, width) for width, fit in fits.items()}
    least = min(criteria.values())
    likelihoods = {width: float(np.exp(least - value)) for width, value in criteria.items()}
    total = sum(likelihoods.values())
    weights = {width: value / total for width, value in likelihoods.items()}
    best = fits[max(weights, key=lambda width: weights[width])]
    covariance = best.covariance.copy()
    for width, fit in fits.items():
        change = np.zeros(len(best.names))
        for k, name in enumerate(best.names):
            if name in fit.names:
                change[k] = fit.theta[fit.names.index(name)] - best.theta[k]
        covariance += weights[width] * np.outer(change, change)
    before, after = np.diag(best.covariance), np.diag(covariance)
    ratio = np.divide(after, before, out=np.ones_like(after), where=before > 0.0)
    widened = float(np.sqrt(ratio.max(initial=1.0)))
    return FrictionChoice(replace(best, covariance=covariance), weights, widened)


def _half_criterion(fit: CircuitFit, width: str) -> float:
    """Return half the Bayesian information criterion, less what both models share.

    A width at its smallest value is Coulomb's friction, which has no width as an unknown.
    """
    k = fit.names.index(width)
    is_free = fit.theta[k] > fit.likelihood.layout.low[k]
    readings = sum(int(mask.sum()) for mask in fit.likelihood.has_reading)
    return fit.maximum.cost + 0.5 * is_free * float(np.log(readings))
