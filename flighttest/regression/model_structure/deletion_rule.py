"""Rule by which a term of a local model counts as identified or is deleted.

References
----------
.. [LR743] Report LR-743, 1993, 4.5.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
import pandas as pd

from flighttest.regression.combining.pooling import pool_fits
from flighttest.regression.equation_error.fit import Fit
from flighttest.regression.uncertainty.collinearity import VIF

CONTRIBUTION = 0.01  # rms of the term over rms of the coefficient below which a weak term is void
CORRELATION = 0.95  # with a term of larger contribution, above which a term is collinear
DETERMINED = 10.0  # standard errors above which a collinear term counts as determined
GAIN = 0.02  # relative rise of the validation error below which a term is not needed
_WEAK = 2.0  # standard errors below which a term is weak
_NO_SIGNAL = 1.0  # rms of a term over that of the residual below which it does not stand out

Prior = Mapping[str, tuple[float, float]]


def apply_deletion_rule(
    fits: Sequence[Fit],
    prior: Prior | None = None,
    validation: Fit | None = None,
    keep: Sequence[str] = ("1",),
) -> pd.DataFrame:
    """Decide for each term of a model whether the data have identified it.

    A term is not identified if one of these conditions is true after pooling:

    (a) it is smaller than two standard errors and contributes less than 1 % of the coefficient's
        rms;
    (b) its VIF is above 10, or its correlation with a term of larger contribution is above 0.95.
        The pooled value, with the scatter between the fits, must also be below ten standard errors:
        a collinear term above this limit is determined;
    (c) its sign changes between fits, or their scatter exceeds the median;
    (d) the error on validation data rises by less than 2 % without it;
    (e) the term with its a-priori value would not stand out of the residual.

    The outcomes are those of [LR743]_ 4.5.

    Parameters
    ----------
    fits : sequence of Fit
        Fits of one coefficient.
    prior : mapping of str to (value, stderr), optional
        A-priori values, for (e) and for the decision "a priori".
    validation : Fit, optional
        A fit of the same model on data that are not in `fits`. Only its samples are used, for (d):
        the models with and without the term are estimated from all samples of `fits`.
    keep : sequence of str
        Terms that are not judged.

    Returns
    -------
    DataFrame
        One row per term: ``decision`` (``identified``, ``embedded``, ``a priori``, ``deleted``),
        ``into`` (the term in which it is embedded), ``reasons`` (letters as above), the pooled
        ``value stderr scatter``, and the deciding numbers ``t contribution vif correlation
        sign_changes validation_rise prior_signal``.

    References
    ----------
    .. [LR743] Report LR-743, 1993, 4.5.
    """
    prior = prior or {}
    rows = {}
    for term, pooled in pool_fits(fits).iterrows():
        name = str(term)
        with_term = [fit for fit in fits if name in fit.estimates["term"].values]
        numbers = _deciding_numbers(name, with_term, prior=prior, validation=validation)
        reasons = ""
        if name not in keep and not name.startswith("1["):
            reasons = _list_reasons(pooled, numbers)
        rows[term] = {
            "decision": _decide_term(name, reasons, prior),
            "into": numbers["partner"] if "b" in reasons else "",
            "reasons": reasons,
            "value": pooled["value"],
            "stderr": pooled["stderr"],
            "scatter": pooled["scatter"],
            **numbers,
        }
    return pd.DataFrame.from_dict(rows, orient="index").rename_axis("term")


def _deciding_numbers(
    term: str, fits: Sequence[Fit], prior: Prior, validation: Fit | None
) -> dict[str, Any]:
    """Return the numbers that decide about a term; all `fits` have it."""
    columns = {}
    for key in ("estimate", "contribution", "vif"):
        columns[key] = np.array([float(fit.estimates[key].sel(term=term)) for fit in fits])
    # Signs are compared with the median of the fits, which one wrong record does not change.
    values = columns["estimate"]
    pooled = pool_fits(fits).loc[term]
    partner, correlation = _find_partner(term, fits)
    return {
        "t": abs(pooled["value"]) / pooled["stderr"],
        "contribution": float(np.sqrt((columns["contribution"] ** 2).mean())),
        "vif": float(np.median(columns["vif"])),
        "correlation": correlation,
        "partner": partner,
        "sign_changes": int((np.sign(values) != np.sign(np.median(values))).sum()),
        "validation_rise": _validation_rise(term, fits, validation),
        "prior_signal": _prior_signal(term, fits, prior),
    }


def _find_partner(term: str, fits: Sequence[Fit]) -> tuple[str, float]:
    """Return the term of larger contribution with the largest correlation, over all fits."""
    partner, largest = "", 0.0
    for fit in fits:
        e = fit.estimates
        is_larger = e["contribution"].values > float(e["contribution"].sel(term=term))
        names = e["term"].values[is_larger]
        correlations = e["regressor_correlation"].sel(term=term).values[is_larger]
        for name, correlation in zip(names, correlations):
            if abs(correlation) > abs(largest):
                partner, largest = str(name), float(correlation)
    return partner, largest


def _validation_rise(term: str, fits: Sequence[Fit], validation: Fit | None) -> float:
    """Return the relative rise of the rms error on the validation samples without the term."""
    if validation is None:
        return float("nan")
    terms = _term_names(validation)
    same_model = [fit for fit in fits if _term_names(fit) == terms]
    if term not in terms or len(terms) == 1 or not same_model:
        return float("nan")
    X = np.vstack([fit.regressors.values for fit in same_model])
    z = np.concatenate([fit.data[fit.model.coefficient].values for fit in same_model])
    X_new = validation.regressors.values
    z_new = validation.data[validation.model.coefficient].values

    # Both models are estimated from the same samples, and judged on those of the validation.
    def rms_error(used: np.ndarray) -> float:
        theta = np.linalg.lstsq(X[:, used], z, rcond=None)[0]
        return np.sqrt(np.mean((z_new - X_new[:, used] @ theta) ** 2))

    is_other = np.array([name != term for name in terms])
    return float(rms_error(is_other) / rms_error(np.ones(len(terms), bool)) - 1.0)


def _term_names(fit: Fit) -> list[str]:
    return [str(name) for name in fit.regressors["term"].values]


def _prior_signal(term: str, fits: Sequence[Fit], prior: Prior) -> float:
    """Return the rms of the term with its a-priori value over the residual rms; the largest."""
    if term not in prior:
        return float("nan")
    value = abs(prior[term][0])
    signals = []
    for fit in fits:
        deviation = float(np.std(fit.regressors.sel(term=term)))
        signals.append(deviation * value / fit.estimates.attrs["residual_rms"])
    return max(signals)


def _list_reasons(pooled: pd.Series, numbers: Mapping[str, Any]) -> str:
    """Return the letters of the conditions that are true."""
    reasons = ""
    if numbers["t"] < _WEAK and numbers["contribution"] < CONTRIBUTION:
        reasons += "a"
    is_collinear = numbers["vif"] > VIF or abs(numbers["correlation"]) > CORRELATION
    if numbers["partner"] and is_collinear and numbers["t"] < DETERMINED:
        reasons += "b"
    scatters = numbers["sign_changes"] > 0 or pooled["scatter"] > abs(pooled["value"])
    if pooled["count"] > 1 and scatters:
        reasons += "c"
    # A number that is not available is NaN, for which the comparison is false.
    if numbers["validation_rise"] < GAIN:
        reasons += "d"
    if numbers["prior_signal"] < _NO_SIGNAL:
        reasons += "e"
    return reasons


def _decide_term(term: str, reasons: str, prior: Prior) -> str:
    if not reasons:
        return "identified"
    if "b" in reasons:
        return "embedded"
    return "a priori" if term in prior else "deleted"
