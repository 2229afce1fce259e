"""x."""

from __future__ import annotations
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
import numpy as np
import pandas as pd
import xarray as xr
from flightmech.errors import IdentificationError
from flighttest.regression.combining.pooling import pool_fits
from flighttest.regression.equation_error.fit import Fit
from flighttest.regression.equation_error.frequency_domain import regress_frequency
from flighttest.regression.equation_error.model import RegressionModel
from flighttest.regression.equation_error.time_domain import regress
from flighttest.regression.model_structure.orthogonal_basis import OrthogonalBasis
from flighttest.regression.model_structure.candidates import CandidateEquations
from flighttest.regression.uncertainty.collinearity import VIF


CONTRIBUTION = 0.01  # rms of the term over rms of the coefficient below which a weak term is void


CORRELATION = 0.95


DETERMINED = 10.0  # standard errors above which a collinear term counts as determined


GAIN = 0.02  # relative rise of the validation error below which a term is not needed


def apply_deletion_rule(
    fits: Sequence[Fit],
    prior: Mapping[str, tuple[float, float]] | None = None,
    validation: Fit | None = None,
    keep: Sequence[str] = ("1",),
):
    """Decide for each term of a model whether the data have identified it.

    A term is not identified when one of these holds after pooling: (a) it is smaller than two
    standard errors and contributes less than 1 % of the coefficient's rms; (b) VIF above 10 or a
    correlation above 0.95 with a term of larger contribution, unless the pooled value, scatter
    between the fits included, stands above ten standard errors: then it is collinear and determined
    all the same; (c) the sign changes between fits, or their scatter exceeds the median; (d)
    leaving it out raises the error on validation data by less than 2 %; (e) the term with its
    a-priori value would not stand out of the residual.

    Parameters
    ----------
    fits : sequence of Fit
        Of one coefficient.
    prior : mapping of str to (value, stderr), optional
        A-priori values, for (e) and for the outcome "kept at the a-priori value".
    validation : Fit, optional
        A fit of the same model on data that are not in `fits`; only its samples are used, for (d):
        the models with and without the term are estimated from all samples of `fits`.
    keep : sequence of str
        Terms that are not judged.

    Returns
    -------
    DataFrame
        One row per term: ``decision`` (``identified``, ``embedded``, ``a priori``, ``deleted``),
        ``into`` (the term that takes it up), ``reasons`` (letters as above), the pooled ``value
        stderr scatter``, and the deciding numbers ``t contribution vif correlation sign_changes
        validation_rise prior_signal``.

    References
    ----------
    .. [LR743] Report LR-743, 1993, 4.5.
    """

    prior = prior or {}
    pooled = pool_fits(fits)
    rows = {}
    for term, row in pooled.iterrows():
        having = [fit for fit in fits if term in fit.estimates["term"].values]
        numbers = _numbers(str(term), having, prior, validation)
        reasons = "" if term in keep or str(term).startswith("1[") else _reasons(row, numbers)
        rows[term] = {
            "decision": _outcome(str(term), reasons, prior),
            "into": numbers["partner"] if "b" in reasons else "",
            "reasons": reasons,
        }
        rows[term] |= {
            "value": row["value"],
            "stderr": row["stderr"],
            "scatter": row["scatter"],
            **numbers,
        }
    return pd.DataFrame.from_dict(rows, orient="index").rename_axis("term")


def _numbers(
    term: str, fits: Sequence[Fit], prior: Mapping[str, tuple[float, float]], validation: Fit | None
) -> dict:
    values = np.array([float(fit.estimates["estimate"].sel(term=term)) for fit in fits])
    sizes = np.array([float(fit.estimates["contribution"].sel(term=term)) for fit in fits])
    pooled = pool_fits(fits).loc[term]
    partner, correlation = _partner(term, fits)
    return {
        "t": abs(pooled["value"]) / pooled["stderr"],
        "contribution": float(np.sqrt((sizes**2).mean())),
        "vif": float(np.median([fit.estimates["vif"].sel(term=term) for fit in fits])),
        "correlation": correlation,
        "partner": partner,
        "sign_changes": int((np.sign(values) != np.sign(np.median(values))).sum()),
        "validation_rise": _validation_rise(term, fits, validation),
        "prior_signal": _prior_signal(term, fits, prior),
    }


def _partner(term: str, fits: Sequence[Fit]) -> tuple[str, float]:
    """The term of larger contribution that moves most like `term`, and their correlation; largest
    over the fits.
    """
    best = ("", 0.0)
    for fit in fits:
        e = fit.estimates
        larger = e["contribution"].values > float(e["contribution"].sel(term=term))
        for other, rho in zip(
            e["term"].values[larger], e["regressor_correlation"].sel(term=term).values[larger]
        ):
            if abs(rho) > abs(best[1]):
                best = str(other), float(rho)
    return best


def _validation_rise(term: str, fits: Sequence[Fit], validation: Fit | None) -> float:
    """Relative rise of the rms error on the validation samples when the term is left out of the
    model.
    """
    if validation is None:
        return float("nan")
    terms = [str(name) for name in validation.regressors["term"].values]
    full = [fit for fit in fits if [str(name) for name in fit.regressors["term"].values] == terms]
    if term not in terms or len(terms) == 1 or not full:
        return float("nan")
    X = np.vstack([fit.regressors.values for fit in full])
    z = np.concatenate([fit.data[fit.model.coefficient].values for fit in full])
    X_new, z_new = (
        validation.regressors.values,
        validation.data[validation.model.coefficient].values,
    )
    rest = np.array([name != term for name in terms])

    def error(use):
        return np.sqrt(
            np.mean((z_new - X_new[:, use] @ np.linalg.lstsq(X[:, use], z, rcond=None)[0]) ** 2)
        )

    return float(error(rest) / error(np.ones(len(terms), bool)) - 1.0)


def _prior_signal(
    term: str, fits: Sequence[Fit], prior: Mapping[str, tuple[float, float]]
) -> float:
    """Rms of the term with its a-priori value over the rms of the residual; the largest of the
    fits.
    """
    if term not in prior:
        return float("nan")
    return max(
        float(np.std(fit.regressors.sel(term=term)))
        * abs(prior[term][0])
        / fit.estimates.attrs["residual_rms"]
        for fit in fits
    )


def _reasons(row, numbers: Mapping) -> str:
    found = ""
    if numbers["t"] < 2.0 and numbers["contribution"] < CONTRIBUTION:
        found += "a"
    collinear = numbers["vif"] > VIF or abs(numbers["correlation"]) > CORRELATION
    if numbers["partner"] and collinear and numbers["t"] < DETERMINED:
        found += "b"
    if row["count"] > 1 and (numbers["sign_changes"] > 0 or row["scatter"] > abs(row["value"])):
        found += "c"
    if numbers["validation_rise"] < GAIN:
        found += "d"
    if numbers["prior_signal"] < 1.0:
        found += "e"
    return found


def _outcome(term: str, reasons: str, prior: Mapping) -> str:
    if not reasons:
        return "identified"
    if "b" in reasons:
        return "embedded"
    return "a priori" if term in prior else "deleted"
