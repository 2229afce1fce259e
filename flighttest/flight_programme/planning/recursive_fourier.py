"""Estimates during a manoeuvre: equation error on recursive Fourier transforms.

The transform of every signal at fixed frequencies grows by one term per sample,

    F_k(f) = F_k-1(f) + x_k exp(-2 pi j f t_k) dt,

so that the work per sample does not grow with the record.  At any time the real parameters and
their standard errors follow from the transforms inside the band.  [Morelli2000] filters mean and
drift of the signals out.  Here a constant and a ramp are transformed too, and their parameters are
estimated with the others.

References
----------
.. [Morelli2000] Morelli, Real-time parameter estimation in the frequency domain, J. Guidance,
   Control, and Dynamics 23, 2000.
.. [Klein2006] Klein, Morelli, Aircraft System Identification, AIAA 2006, chapter 8.
"""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np
import xarray as xr

from flightmech.errors import IdentificationError, UnknownName
from flighttest.regression.equation_error.model import RegressionModel
from flighttest.regression.equation_error.transformed_stretches import stack_complex

# Spacing of the frequencies [Hz].
SPACING = 0.04
# Number of unknowns that are not reported: constant and ramp.
_NUISANCE = 2
# Largest condition number of the scaled regressors.
_LARGEST_CONDITION = 1e8


class RunningEstimate:
    """Running estimates of one model.

    Parameters
    ----------
    model : RegressionModel
        Coefficient and terms; the constant ``1`` is estimated and not reported.
    band : (low, high)
        Band of the excitation. [Hz]
    spacing : float
        Spacing of the frequencies. [Hz]

    Raises
    ------
    IdentificationError
        The band is empty, or has fewer frequencies than the model has terms.
    """

    def __init__(self, model: RegressionModel, band: tuple[float, float], spacing: float = SPACING):
        if not 0.0 < band[0] < band[1] or not spacing > 0.0:
            raise IdentificationError(
                f"band {band[0]:g} ... {band[1]:g} Hz, spacing {spacing:g} Hz; expected 0 < "
                f"low < high, as 0.1 ... 2, and a positive spacing"
            )
        self.model, self.spacing = model, spacing
        self.terms = [term for term in model.terms if term != "1"]
        self.frequencies = np.arange(band[0], band[1] + 1e-9, spacing)
        unknowns = len(self.terms) + _NUISANCE
        if 2 * len(self.frequencies) <= unknowns:
            raise IdentificationError(
                f"{len(self.frequencies)} frequencies for {unknowns} unknowns; widen the "
                f"band or space closer"
            )
        self._transforms = np.zeros((len(self.frequencies), 1 + unknowns), complex)
        self._start: float | None = None
        self.duration = 0.0

    def add(self, data: xr.Dataset) -> None:
        """Add samples to the transforms.

        Parameters
        ----------
        data : Dataset (time,)
            At least two samples, uniform in time, of the coefficient and the variables of the
            model.  Samples with NaN are ignored.

        Raises
        ------
        UnknownName
            The samples do not have a variable of the model.
        """
        coefficient = self.model.coefficient
        for name in (coefficient, *self.model.variables):
            if name not in data:
                raise UnknownName(
                    name, map(str, data.data_vars), "variable", f"{self.model} needs it"
                )
        data = data[[coefficient, *self.model.variables]]
        time = data["time"].values
        step = float(np.median(np.diff(time)))
        if self._start is None:
            self._start = float(time[0])
        since = time - self._start
        X = self.model.design(data)[:, [term != "1" for term in self.model.terms]]
        columns = np.column_stack([data[coefficient].values, X, np.ones_like(since), since])
        complete = np.isfinite(columns).all(axis=1)
        kernel = np.exp(-2j * np.pi * np.outer(self.frequencies, since[complete]))
        self._transforms += kernel @ columns[complete] * step
        self.duration += step * float(complete.sum())

    def estimate(self) -> tuple[np.ndarray, np.ndarray]:
        """Return estimates and standard errors of the terms, (terms,) each.

        Both are NaN while the samples do not determine them.

        Notes
        -----
        Covariance 1/2 s^2 [Re(X* X)]^-1 c with c = max(1, 1/(T df)), because frequencies closer
        than 1/T are not independent.  The disturbance is assumed to be white inside the band.
        """
        unknown = np.full(len(self.terms), np.nan)
        # number of independent frequencies, and the share of the data that is left for the residual
        independent = len(self.frequencies) * min(1.0, self.duration * self.spacing)
        freedom = 0.0
        if independent:
            freedom = 1.0 - (len(self.terms) + _NUISANCE) / (2.0 * independent)
        if freedom <= 0.0:
            return unknown, unknown
        rows = stack_complex(self._transforms / np.sqrt(self.duration))
        z, X = rows[:, 0], rows[:, 1:]
        # columns of unit length make the condition number independent of the units
        scale = np.linalg.norm(X, axis=0)
        if not (scale > 0.0).all() or np.linalg.cond(X / scale) > _LARGEST_CONDITION:
            return unknown, unknown
        Q, R = np.linalg.qr(X / scale)
        theta = np.linalg.solve(R, Q.T @ z) / scale
        v = z - X @ theta
        s2 = float(v @ v) / (2.0 * len(self.frequencies) * freedom)
        inverse = np.linalg.inv(R)
        dependence = max(1.0, 1.0 / (self.duration * self.spacing))
        stderr = np.sqrt(s2 * (inverse**2).sum(axis=1) * dependence) / scale
        return theta[: len(self.terms)], stderr[: len(self.terms)]


def running_estimate(
    model: RegressionModel,
    data: xr.Dataset,
    band: tuple[float, float],
    every: float = 0.5,
    spacing: float = SPACING,
) -> xr.Dataset:
    """Return the estimates of a model along a manoeuvre.

    Parameters
    ----------
    model : RegressionModel
    data : Dataset (time,)
        Coefficient and variables, uniform in time, as `flighttest.coefficients` returns them.
    band : (low, high)
        Band of the excitation. [Hz]
    every : float
        Interval between estimates. [s]
    spacing : float
        Spacing of the frequencies. [Hz]

    Returns
    -------
    Dataset (time, term)
        ``estimate`` and ``stderr`` at the end of each interval, NaN while the samples do not
        determine them.

    Raises
    ------
    IdentificationError, UnknownName
        As `RunningEstimate`.
    """
    running = RunningEstimate(model, band, spacing)
    time = data["time"].values
    edges = np.searchsorted(time, np.arange(time[0] + every, time[-1] + 1e-9, every), side="right")
    estimates, stderrs, times, first = [], [], [], 0
    for last in map(int, edges):
        # the sampling interval needs two samples
        if last - first < 2:
            continue
        running.add(data.isel(time=slice(first, last)))
        estimate, stderr = running.estimate()
        estimates.append(estimate)
        stderrs.append(stderr)
        times.append(float(time[last - 1]))
        first = last
    columns = {
        "estimate": (("time", "term"), np.array(estimates)),
        "stderr": (("time", "term"), np.array(stderrs)),
    }
    attributes = {"model": str(model), "band": f"{band[0]:g} ... {band[1]:g}", "spacing": spacing}
    return xr.Dataset(columns, {"time": times, "term": running.terms}, attributes)


def may_end(running: xr.Dataset, bounds: Mapping[str, float], settled: float = 2.0) -> float:
    """Return the time at which a manoeuvre may end.

    All standard errors have been below their bounds since `settled` seconds at that time.

    Parameters
    ----------
    running : Dataset (time, term)
        From `running_estimate`.
    bounds : mapping of str to float
        Largest standard error by term.
    settled : float
        Time below the bounds. [s]

    Returns
    -------
    float
        NaN if the standard errors do not stay below their bounds. [s]

    Raises
    ------
    UnknownName
        The model does not have a term of `bounds`.
    """
    terms = [str(term) for term in running["term"].values]
    for name in bounds:
        if name not in terms:
            raise UnknownName(name, terms, "term")
    time, below = running["time"].values, np.ones(running.sizes["time"], bool)
    for name, bound in bounds.items():
        below &= running["stderr"].sel(term=name).values <= bound
    since = np.nan
    for t, is_below in zip(time, below, strict=True):
        if not is_below:
            since = np.nan
            continue
        if np.isnan(since):
            since = t
        if t - since >= settled - 1e-9:
            return float(t)
    return float("nan")
