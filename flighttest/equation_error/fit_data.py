"""Estimates of one model with the samples behind them."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
import xarray as xr

from flightmech.errors import IdentificationError
from flightmech.support.display import new_figure

from .model import Model

if TYPE_CHECKING:
    from matplotlib.figure import Figure


@dataclass(frozen=True)
class FitData:
    """Estimates of one model from one or several manoeuvres.

    Attributes
    ----------
    name : str
    model : Model
    estimates : Dataset (term, term_, error)
        ``estimate``, ``stderr`` (coloured residuals), ``stderr_white``, ``stderr_systematic``, ``covariance`` and
        ``correlation`` of the estimates (coloured), ``systematic`` (term, error): change of the estimates for one
        standard error of each source, ``stderr_window`` (by a lag window of a tenth of the longest stretch, in time),
        ``contribution`` (rms of the term about its mean over the rms of the coefficient
        about its mean); of the regressors ``vif``, ``regressor_correlation``, ``condition_index`` (component) and
        ``proportion`` (component, term).  Attributes: ``coefficient``, ``name``, ``domain`` (time, frequency or published), ``R2``,
        ``residual_rms``, ``samples``, ``manoeuvres``, ``offset`` (standard deviation of a constant between manoeuvres);
        of a frequency fit ``R2`` is that inside ``band``.  Tests and intervals are those of `significance.added` (``t``,
        ``p_value``, ``dof``, ``low``, ``high``; ``F``, ``F_terms``, ``F_dof``, ``F_probability``), the colour of the residual that of
        `significance.whiteness` (``portmanteau``, ``portmanteau_lags``, ``portmanteau_probability``, ``correlation_time`` [s]).
    data : Dataset (sample,)
        The samples used: coefficient, model variables, what tables may depend on, ``time`` and ``manoeuvre`` (from 0).
    design : DataArray (sample, term)
        The regressors whose ordinary least squares over the samples the estimate is: those of the model, but for
        weights, ridge and frequency, where it makes the estimate the same linear function of the measurements.
    regressors : DataArray (sample, term)
        The regressors of the model.
    """

    name: str
    model: Model
    estimates: xr.Dataset
    data: xr.Dataset
    design: xr.DataArray
    regressors: xr.DataArray

    @property
    def residual(self) -> np.ndarray:
        """Measured minus fitted coefficient, (sample,)."""
        return self.data[self.model.coefficient].values - self.regressors.values @ self.estimates["estimate"].values

    @property
    def time_along(self) -> np.ndarray:
        """Time of the samples from the first one on, gaps left out, (sample,). [s]"""
        step = np.diff(self.data["time"].values)
        ordinary = float(np.median(step)) if len(step) else 0.0
        same = (np.diff(self.data["manoeuvre"].values) == 0) & (step < 1.5 * ordinary)
        return np.concatenate([[0.0], np.cumsum(np.where(same, step, ordinary))])


def fit_figure(fit: FitData) -> Figure:
    """Return the figure of a fit; gaps of time are left out, a line stands between two manoeuvres.

    Raises
    ------
    IdentificationError
        Published values, which have no samples.
    AeromatchError
        matplotlib is not installed.
    """
    if not fit.data.sizes.get("sample"):
        raise IdentificationError(f"{fit.model}: published values have no samples to draw")
    name = fit.model.coefficient
    measured, residual = fit.data[name].values, fit.residual
    manoeuvre, along = fit.data["manoeuvre"].values, fit.time_along
    figure = new_figure(9.0, 4.2)
    upper, lower = figure.subplots(2, 1, sharex=True, height_ratios=(2, 1))
    upper.plot(along, measured, color="0.5", linewidth=0.9, label="measured")
    upper.plot(along, measured - residual, color="tab:red", linewidth=1.0, label="fitted")
    lower.plot(along, residual, color="tab:blue", linewidth=0.8)
    for ax in (upper, lower):
        ax.grid(linewidth=0.3)
        for at in along[1:][np.diff(manoeuvre) != 0]:
            ax.axvline(at, color="0.3", linewidth=0.8, linestyle=":")
    upper.set_ylabel(name)
    lower.set_ylabel("residual")
    lower.set_xlabel("time of the samples [s]")
    upper.legend(frameon=False, fontsize="small")
    upper.set_title(f"{fit.name}: {fit.model}" if fit.name else str(fit.model), fontsize="medium")
    return figure
