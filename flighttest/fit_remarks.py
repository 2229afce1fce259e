"""What a regression's numbers do not say by themselves: collinear terms, constants that differ between manoeuvres."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from . import collinearity
from .remarks import Remark

if TYPE_CHECKING:
    from .fit import Fit


def remarks_of(fit: Fit) -> list[Remark]:
    """Return all remarks on a fit; errors first."""
    found = [*_collinear(fit), *_offset(fit)]
    return sorted(found, key=lambda remark: remark.severity != "error")


def _collinear(fit: Fit) -> list[Remark]:
    e = fit.estimates
    terms = [str(term) for term in e["term"].values]
    found = [
        Remark("collinear", f"VIF of {term} is {v:.0f} (above {collinearity.VIF:.0f})", term, float(v), collinearity.VIF)
        for term, v in zip(terms, e["vif"].values)
        if v > collinearity.VIF
    ]
    rho = e["regressor_correlation"].values
    for i, j in zip(*np.nonzero(np.triu(np.abs(rho) > collinearity.CORRELATED, 1))):
        words = f"regressors {terms[i]} and {terms[j]} are correlated by {rho[i, j]:.2f}"
        found.append(Remark("collinear", words, terms[i], float(rho[i, j]), collinearity.CORRELATED))
    for index, words in collinearity.pairs(e):
        found.append(Remark("collinear", f"condition index {index:.0f}: hardly told apart are {words}", "", index, collinearity.CONDITION))
    return found


def _offset(fit: Fit) -> list[Remark]:
    offset, rms = fit.estimates.attrs["offset"], fit.estimates.attrs["residual_rms"]
    if not offset > rms:  # both are NaN of published values
        return []
    words = f"manoeuvres differ by a constant of {offset:.2g} (1 sigma), more than the residual; consider separate intercepts"
    return [Remark("offset", words, "1", offset, rms)]
