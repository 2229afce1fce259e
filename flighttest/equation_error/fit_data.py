"""Estimates of one model with the samples behind them."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import xarray as xr

from .model import Model


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
