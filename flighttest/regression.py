"""Equation error in time: a linear model of a coefficient fitted to measured coefficients by least squares.

Errors of the regressors bias the slopes towards zero by about var(noise)/var(signal): reconstruct the states first.
Standard errors are those of coloured residuals; the errors of dynamic pressure, mass, inertia and thrust, which are
common to all samples, are kept apart as systematic ones.
"""

from __future__ import annotations

from collections.abc import Sequence
from itertools import pairwise

import numpy as np
import xarray as xr

from flightmech.errors import IdentificationError, UnknownName
from flightmech.names import lookup

from . import collinearity
from .covariance import coloured
from .fit import Fit
from .model import Model, powers

SAMPLES_PER_TERM = 5
# smallest rms excursion that counts as movement, by unit; a reduced rate of 1e-5 is 0.1 deg/s on a small jet
LEAST_MOVEMENT = {"rad": 2e-4, "1": 2e-6}
# what tables may depend on: kept with the samples
_KEPT = (
    *("alpha", "beta", "mach", "V", "qbar", "h", "h_agl", "p", "q", "r", "phat", "qhat", "rhat", "alphadothat", "betadothat"),
    *("phi", "nz", "dnz", "CL", "delta_e", "delta_a", "delta_r", "delta_f", "delta_t", "delta_ta", "delta_tr", "gear", "speedbrake"),
)


def regress(
    model: Model, data: xr.Dataset | Sequence[xr.Dataset], name: str = "", intercepts: str = "common", lag: float | None = None
) -> Fit:
    """Fit a model to measured coefficients by least squares.

    Parameters
    ----------
    model : Model
        Coefficient and terms.
    data : Dataset (time,) or list of them
        Manoeuvres, as `coefficients` returns them; samples with NaN in the coefficient or a regressor are left out.
    name : str
        For reports and provenance.
    intercepts : {"common", "separate"}
        ``separate`` gives each manoeuvre its own constant, in place of the term ``1``: terms ``1[0]``, ``1[1]`` ...
    lag : float, optional
        Lag window of the residual autocorrelation; default a tenth of each manoeuvre, 0.5 to 5 s. [s]

    Returns
    -------
    Fit

    Raises
    ------
    IdentificationError
        Too few samples, a term without movement, or terms that the data cannot tell apart.
    UnknownName
        A variable that the data do not hold.
    """
    if intercepts not in ("common", "separate"):
        raise ValueError(f"intercepts is {intercepts!r}; allowed: common, separate")
    manoeuvres = [data] if isinstance(data, xr.Dataset) else list(data)
    samples, steps = _stack(model, manoeuvres)
    X, terms = model.design(samples), list(model.terms)
    if intercepts == "separate":
        X, terms = _separate(X, terms, samples["manoeuvre"].values)
    label = f"{name}: " if name else ""
    if len(X) < SAMPLES_PER_TERM * len(terms):
        raise IdentificationError(
            f"{label}{len(X)} samples for {len(terms)} terms of {model}; at least {SAMPLES_PER_TERM} per term are needed"
        )
    try:
        _demand_movement(samples[model.coefficient].values, X, terms)
        collinearity.demand_rank(X, terms)
    except IdentificationError as error:
        raise IdentificationError(f"{label}{model}: {error}") from None
    estimates = _solve(model, samples, X, terms, steps, lag)
    estimates.attrs.update(name=name, intercepts=intercepts)
    return Fit(name, model, estimates, samples, xr.DataArray(X, dims=("sample", "term"), coords={"term": terms}))


def _stack(model: Model, manoeuvres: Sequence[xr.Dataset]) -> tuple[xr.Dataset, list[float]]:
    """All samples along one dimension, and the sampling interval of each manoeuvre."""
    if not manoeuvres:
        raise IdentificationError(f"no manoeuvre for {model}; give at least one Dataset")
    kept = [name for name in _KEPT if all(name in one for one in manoeuvres)]
    names = list(dict.fromkeys([model.coefficient, *model.variables, *kept]))
    error = f"{model.coefficient}_error"
    with_errors = all(error in one and one["error"].equals(manoeuvres[0]["error"]) for one in manoeuvres)
    parts: dict[str, list[np.ndarray]] = {name: [] for name in (*names, "time", "manoeuvre", error)}
    for number, one in enumerate(manoeuvres):
        for name in (model.coefficient, *model.variables):
            if name not in one:
                raise UnknownName(name, map(str, one.data_vars), "variable", f"manoeuvre {number} does not hold it; {model} needs it")
        size = one.sizes["time"]
        columns = {name: np.broadcast_to(np.asarray(one[name].values, float), (size,)) for name in names}
        use = np.logical_and.reduce([np.isfinite(columns[name]) for name in (model.coefficient, *model.variables)])
        for name, column in columns.items():
            parts[name].append(column[use])
        parts["time"].append(one["time"].values.astype(float)[use])
        parts["manoeuvre"].append(np.full(int(use.sum()), number))
        if with_errors:
            parts[error].append(one[error].values[:, use])
    samples = xr.Dataset({name: ("sample", np.concatenate(found)) for name, found in parts.items() if name != error})
    if with_errors:
        samples = samples.assign_coords(error=manoeuvres[0]["error"].values)
        samples[error] = ("error", "sample"), np.concatenate(parts[error], axis=1)
    steps = [float(np.median(np.diff(one["time"].values))) if one.sizes["time"] > 1 else 1.0 for one in manoeuvres]
    return samples, steps


def _separate(X: np.ndarray, terms: list[str], manoeuvre: np.ndarray) -> tuple[np.ndarray, list[str]]:
    if "1" not in terms:
        raise IdentificationError("intercepts='separate' needs the term 1 in the model")
    numbers = np.unique(manoeuvre)
    columns = (manoeuvre[:, None] == numbers).astype(float)
    at = terms.index("1")
    return np.hstack([X[:, :at], columns, X[:, at + 1 :]]), [*terms[:at], *(f"1[{k}]" for k in numbers), *terms[at + 1 :]]


def _constants(terms: Sequence[str]) -> np.ndarray:
    return np.array([term == "1" or term.startswith("1[") for term in terms])


def _demand_movement(z: np.ndarray, X: np.ndarray, terms: Sequence[str]) -> None:
    """A single variable that stays where it is cannot carry a slope beside a constant."""
    if np.ptp(z) == 0.0:
        raise IdentificationError("the coefficient is constant; look at its accelerations")
    if not _constants(terms).any():
        return
    for column, term in zip(X.T, terms):
        factors = {} if _constants([term])[0] else powers(term)
        if list(factors.values()) != [1]:
            continue
        (name,) = factors
        least = LEAST_MOVEMENT.get(lookup(name).units, 0.0)
        if np.std(column) < least:
            raise IdentificationError(
                f"{name} does not move: rms {np.std(column):.2g} about its mean, {least:.2g} is needed; leave it out or add a manoeuvre"
            )


def _pieces(samples: xr.Dataset, steps: list[float]) -> tuple[list[slice], list[float]]:
    """Stretches without a gap, inside one manoeuvre."""
    manoeuvre, time = samples["manoeuvre"].values, samples["time"].values
    allowed = 1.5 * np.asarray(steps)[manoeuvre[1:]]
    cuts = np.flatnonzero((np.diff(manoeuvre) != 0) | (np.abs(np.diff(time)) > allowed)) + 1
    edges = [0, *cuts.tolist(), len(time)]
    return [slice(a, b) for a, b in pairwise(edges)], [steps[manoeuvre[a]] for a in edges[:-1]]


def _solve(model: Model, samples: xr.Dataset, X: np.ndarray, terms: list[str], steps: list[float], lag: float | None) -> xr.Dataset:
    z = samples[model.coefficient].values
    Q, R = np.linalg.qr(X)
    theta = np.linalg.solve(R, Q.T @ z)
    v = z - X @ theta
    inverse = np.linalg.solve(R, np.eye(len(terms)))
    s2 = float(v @ v) / (len(z) - len(terms))
    C, offset = coloured(X, v, *_pieces(samples, steps), lag)
    error = f"{model.coefficient}_error"
    sources = [str(name) for name in samples["error"].values] if error in samples else []
    systematic = np.linalg.solve(R, Q.T @ samples[error].values.T) if sources else np.zeros((len(terms), 0))
    constants = _constants(terms)
    correlation = collinearity.correlations(X, constants)
    vif = collinearity.inflation(correlation)
    stderr = np.sqrt(np.diag(C))
    spread = float(np.std(z))
    found = xr.Dataset(
        {
            "estimate": ("term", theta),
            "stderr": ("term", stderr, {"long_name": "standard error, coloured residuals"}),
            "stderr_white": ("term", np.sqrt(s2 * (inverse**2).sum(axis=1)), {"long_name": "standard error if residuals were white"}),
            "stderr_systematic": (
                "term",
                np.linalg.norm(systematic, axis=1),
                {"long_name": "standard error from the common errors of the measurement"},
            ),
            "covariance": (("term", "term_"), C),
            "correlation": (("term", "term_"), C / np.outer(stderr, stderr)),
            "systematic": (("term", "error"), systematic),
            "vif": ("term", np.where(constants, np.nan, vif)),
            "regressor_correlation": (("term", "term_"), correlation),
            "contribution": ("term", np.std(X, axis=0) * np.abs(theta) / spread),
        },
        coords={"term": terms, "term_": terms, "error": np.array(sources, dtype=str)},
    )
    found.attrs = {
        "coefficient": model.coefficient,
        "R2": 1.0 - float(v @ v) / float(((z - z.mean()) ** 2).sum()),
        "residual_rms": float(np.sqrt(v @ v / len(v))),
        "samples": len(z),
        "manoeuvres": len(steps),
        "offset": offset,
    }
    return found
