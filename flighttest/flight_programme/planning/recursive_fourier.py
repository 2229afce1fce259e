"""Estimates while a manoeuvre is flown: equation error on recursive Fourier transforms, with a
standard error over time.

The transform of every signal at fixed frequencies grows by one term per sample,

    F_k(f) = F_k-1(f) + x_k exp(-2 pi j f t_k) dt,

so that the work per sample does not grow with the record.  At any time the real parameters follow
from the transforms inside the band. Mean and drift of the signals are transformed along as a
constant and a ramp and solved for, where [Morelli2000] filters them out.

References
----------
.. [Morelli2000] Morelli, Real-time parameter estimation in the frequency domain, J. Guidance, Control, and Dynamics 23, 2000.
.. [Klein2006] Klein, Morelli, Aircraft System Identification, AIAA 2006, chapter 8.
"""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np
import xarray as xr

from flightmech.errors import IdentificationError, UnknownName
from flighttest.regression.equation_error.model import RegressionModel
from flighttest.regression.equation_error.transformed_stretches import stack_complex

SPACING = 0.04  # of the frequencies [Hz]
_NUISANCE = 2  # constant and ramp


class RunningEstimate:
    """Estimates of one model from samples as they come.

    Parameters
    ----------
    model : Model
        Coefficient and terms; the constant ``1`` is solved for and not reported.
    band : (low, high)
        Where the excitation is. [Hz]
    spacing : float
        Of the frequencies. [Hz]

    Raises
    ------
    IdentificationError
        A band that is none, or with fewer frequencies than terms.
    """

    def __init__(self, model: RegressionModel, band: tuple[float, float], spacing: float = SPACING):
        if not 0.0 < band[0] < band[1] or not spacing > 0.0:
            raise IdentificationError(
                f"band {band[0]:g} ... {band[1]:g} Hz, spacing {spacing:g} Hz; expected 0 < "
                f"low < high, as 0.1 ... 2"
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
        """Take further samples.

        Parameters
        ----------
        data : Dataset (time,)
            Two samples at least, uniform in time: the coefficient and the variables of the model;
            samples with NaN are left out.

        Raises
        ------
        UnknownName
            A variable that the samples do not hold.
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
        known = np.isfinite(columns).all(axis=1)
        self._transforms += (
            np.exp(-2j * np.pi * np.outer(self.frequencies, since[known])) @ columns[known] * step
        )
        self.duration += step * float(known.sum())

    def estimate(self) -> tuple[np.ndarray, np.ndarray]:
        """Return estimates and standard errors of the terms, (terms,) each; NaN while the samples
        do not determine them.

        Notes
        -----
        Covariance 1/2 s^2 [Re(X* X)]^-1 c with c = max(1, 1/(T df)): frequencies closer than 1/T are not independent.  The disturbance is
        taken as white inside the band.
        """
        unknown = np.full(len(self.terms), np.nan)
        independent = len(self.frequencies) * min(1.0, self.duration * self.spacing)
        freedom = 1.0 - (len(self.terms) + _NUISANCE) / (2.0 * independent) if independent else 0.0
        if freedom <= 0.0:
            return unknown, unknown
        rows = stack_complex(self._transforms / np.sqrt(self.duration))
        z, X = rows[:, 0], rows[:, 1:]
        scale = np.linalg.norm(X, axis=0)
        if not (scale > 0.0).all() or np.linalg.cond(X / scale) > 1e8:
            return unknown, unknown
        Q, R = np.linalg.qr(X / scale)
        theta = np.linalg.solve(R, Q.T @ z) / scale
        v = z - X @ theta
        s2 = float(v @ v) / (2.0 * len(self.frequencies) * freedom)
        inverse = np.linalg.inv(R)
        spread = (
            np.sqrt(s2 * (inverse**2).sum(axis=1) * max(1.0, 1.0 / (self.duration * self.spacing)))
            / scale
        )
        return theta[: len(self.terms)], spread[: len(self.terms)]


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
    model : Model
    data : Dataset (time,)
        Coefficient and variables, uniform in time, as `flighttest.coefficients` returns them.
    band : (low, high)
        Where the excitation is. [Hz]
    every : float
        Interval between estimates. [s]
    spacing : float
        Of the frequencies. [Hz]

    Returns
    -------
    Dataset (time, term)
        ``estimate`` and ``stderr`` at the end of each interval, NaN as long as the samples do not
        determine them.

    Raises
    ------
    IdentificationError, UnknownName
        As `RunningEstimate`.
    """
    running = RunningEstimate(model, band, spacing)
    time = data["time"].values
    edges = np.searchsorted(time, np.arange(time[0] + every, time[-1] + 1e-9, every), side="right")
    found, at, first = [], [], 0
    for last in map(int, edges):
        if last - first < 2:
            continue
        running.add(data.isel(time=slice(first, last)))
        found.append(running.estimate())
        at.append(float(time[last - 1]))
        first = last
    columns = {
        name: (("time", "term"), np.array([pair[k] for pair in found]))
        for k, name in enumerate(("estimate", "stderr"))
    }
    about = {"model": str(model), "band": f"{band[0]:g} ... {band[1]:g}", "spacing": spacing}
    return xr.Dataset(columns, {"time": at, "term": running.terms}, about)


def may_end(running: xr.Dataset, bounds: Mapping[str, float], settled: float = 2.0) -> float:
    """Return the time at which a manoeuvre may end: all standard errors have been below their
    bounds for a while.

    Parameters
    ----------
    running : Dataset (time, term)
        From `running_estimate`.
    bounds : mapping of str to float
        Largest standard error by term.
    settled : float
        For how long. [s]

    Returns
    -------
    float
        NaN when they are not. [s]

    Raises
    ------
    UnknownName
        A term that the model does not have.
    """
    terms = [str(term) for term in running["term"].values]
    for name in bounds:
        if name not in terms:
            raise UnknownName(name, terms, "term")
    time, below = running["time"].values, np.ones(running.sizes["time"], bool)
    for name, bound in bounds.items():
        below &= running["stderr"].sel(term=name).values <= bound
    since = np.nan
    for t, good in zip(time, below, strict=True):
        since = (t if np.isnan(since) else since) if good else np.nan
        if t - since >= settled - 1e-9:
            return float(t)
    return float("nan")
