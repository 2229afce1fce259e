"""What a fit predicts of other data, and where these leave the range of the samples that were fitted."""

from __future__ import annotations

import warnings
from collections.abc import Callable
from functools import partial
from typing import TYPE_CHECKING

import numpy as np
import xarray as xr

from aerodb.store.number_text import plain_number, readable
from flightmech.errors import AeromatchWarning, IdentificationError, SchemaError, UnknownName
from flightmech.names import attrs

from . import least_squares
from .model import regressors

if TYPE_CHECKING:
    from .fit_data import FitData

_ROUNDING = 1e-9  # of the ends of a range: what the conversion of units may add


def predicted(fit: FitData, data: xr.Dataset, manoeuvre: int | None) -> xr.Dataset:
    """Return coefficient and standard error at the samples of `data`; see `Fit.predict`."""
    samples = _samples(fit, data)
    X = _design(fit, samples, manoeuvre)
    e = fit.estimates
    variance = np.einsum("ij,jk,ik->i", X, e["covariance"].values, X) + ((X @ e["systematic"].values) ** 2).sum(axis=1)
    found = outside(fit, samples, X)
    if found:
        name = f"{fit.name}: " if fit.name else ""
        warnings.warn(f"{name}{fit.model} is used outside the fitted range: {'; '.join(found)}", AeromatchWarning, stacklevel=3)
    (dim,) = samples.sizes
    columns = {
        fit.model.coefficient: (dim, X @ e["estimate"].values, attrs(fit.model.coefficient)),
        "stderr": (dim, np.sqrt(variance), {"long_name": "standard error of the fitted coefficient"}),
    }
    return xr.Dataset(columns, samples.coords)


def outside(fit: FitData, samples: xr.Dataset, X: np.ndarray) -> list[str]:
    """Return in words which variables and which further terms leave the range of the samples that were fitted.

    Parameters
    ----------
    fit : FitData
    samples : Dataset (sample,)
        Variables of the model.
    X : array (sample, term)
        Regressors of the estimates there.
    """
    variables = fit.model.variables
    found = [_beyond(name, samples[name].values, fit.data[name].values, partial(readable, name)) for name in variables]
    for term, x, known in zip(fit.estimates["term"].values, X.T, fit.regressors.values.T):
        if str(term) not in variables and not least_squares.constants([str(term)])[0]:
            found.append(_beyond(str(term), x, known, plain_number))
    return [text for text in found if text]


def _beyond(name: str, x: np.ndarray, known: np.ndarray, words: Callable[[float], str]) -> str:
    x, low, high = x[np.isfinite(x)], float(known.min()), float(known.max())
    margin = _ROUNDING * max(abs(low), abs(high))
    out = (x < low - margin) | (x > high + margin)
    if not out.any():
        return ""
    span, fitted = (f"{words(a)} ... {words(b)}" for a, b in ((float(x.min()), float(x.max())), (low, high)))
    return f"{name} is {span}, fitted over {fitted} ({int(out.sum())} of {len(x)} samples outside)"


def _design(fit: FitData, samples: xr.Dataset, manoeuvre: int | None) -> np.ndarray:
    """Return the regressors of the estimates (sample, term): of separate intercepts, that of `manoeuvre` is one, the others zero."""
    terms = [str(term) for term in fit.estimates["term"].values]
    separate = [term for term in terms if term.startswith("1[")]
    if manoeuvre is None and separate:
        raise IdentificationError(f"{fit.model} has a constant for each manoeuvre, {', '.join(separate)}; choose one with manoeuvre=")
    if manoeuvre is not None and f"1[{manoeuvre}]" not in separate:
        raise UnknownName(f"1[{manoeuvre}]", separate, "intercept", f"manoeuvre={manoeuvre} is none of those with a constant of their own")
    rows = regressors(["1" if term in separate else term for term in terms], samples, fit.model.reference)
    away = [term in separate and term != f"1[{manoeuvre}]" for term in terms]
    return np.where(away, 0.0, rows.T)


def _samples(fit: FitData, data: xr.Dataset) -> xr.Dataset:
    """Return the variables of the model along the one dimension that they have; other variables may have dimensions of their own."""
    for name in fit.model.variables:
        if name not in data:
            raise UnknownName(name, map(str, data.data_vars), "model variable", f"the data do not hold it; {fit.model} needs it")
    own = data[list(fit.model.variables)]
    sizes = dict(own.sizes) or {dim: data.sizes[dim] for dim in ("time", "sample") if dim in data.sizes} or {"sample": 1}
    if len(sizes) > 1:
        raise SchemaError("data", [f"the variables of {fit.model} have the dimensions {', '.join(map(str, sizes))}; one is allowed"])
    ((dim, size),) = sizes.items()
    columns = {name: (dim, np.broadcast_to(own[name].values.astype(float), (size,))) for name in fit.model.variables}
    return xr.Dataset(columns, {dim: data[dim] if dim in data.coords else np.arange(size)})
