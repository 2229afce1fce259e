"""Data of a fit, as its remarks and files read them."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import xarray as xr

from flighttest.regression.equation_error.model import RegressionModel


@dataclass(frozen=True)
class FitData:
    """Estimates of one model from one or several manoeuvres.

    Attributes
    ----------
    name : str
    model : RegressionModel
    estimates : Dataset (term, term_, error)
        ``estimate``, ``stderr`` (coloured residuals), ``stderr_white``, ``stderr_systematic``,
        ``covariance`` and ``correlation`` of the estimates (coloured), ``systematic`` (term,
        error): change of the estimates for one standard error of each source, ``stderr_window`` (by
        a lag window of a tenth of the longest stretch, in time), ``contribution`` (rms of the term
        about its mean over the rms of the coefficient about its mean). Of the regressors: ``vif``,
        ``regressor_correlation``, ``condition_index`` (component) and ``proportion`` (component,
        term). Attributes: ``coefficient``, ``name``, ``domain`` (time, frequency or published),
        ``R2``, ``residual_rms``, ``samples``, ``manoeuvres``, ``offset`` (standard deviation of a
        constant between manoeuvres). ``R2`` of a frequency fit is that inside ``band``. Tests and
        intervals are those of `significance.add_tests` (``t``, ``p_value``, ``dof``, ``low``,
        ``high``; ``F``, ``F_terms``, ``F_dof``, ``F_probability``). The colour of the residual is
        that of `significance.residual_whiteness` (``portmanteau``, ``portmanteau_lags``,
        ``portmanteau_probability``, ``correlation_time`` [s]). An iteration that did not converge
        has its rounds and its last change over its tolerance (``weights_rounds``,
        ``weights_change``, ``spectrum_rounds``, ``spectrum_change``).
    data : Dataset (sample,)
        The fitted samples: coefficient, model variables, other variables of tables, ``time`` and
        ``manoeuvre`` (from 0).
    design : DataArray (sample, term)
        Equivalent regressors: the estimate is their ordinary least squares over the samples. They
        differ from the regressors of the model for weights, ridge and frequency. The estimate is
        then the same linear function of the measurements. Of total least squares they are the
        regressors: a model without error is then returned from its values at the samples.
    regressors : DataArray (sample, term)
        The regressors of the model.
    """

    name: str
    model: RegressionModel
    estimates: xr.Dataset
    data: xr.Dataset
    design: xr.DataArray
    regressors: xr.DataArray

    @property
    def residual(self) -> np.ndarray:
        """Measured minus fitted coefficient, (sample,)."""
        return (
            self.data[self.model.coefficient].values
            - self.regressors.values @ self.estimates["estimate"].values
        )

    @property
    def time_along(self) -> np.ndarray:
        """Time of the samples from the first one on, without gaps, (sample,). [s]"""
        step = np.diff(self.data["time"].values)
        ordinary = 0.0
        if len(step):
            ordinary = float(np.median(step))
        # A gap, or the step to the next manoeuvre, becomes one sampling interval.
        is_same = np.diff(self.data["manoeuvre"].values) == 0
        is_continuous = is_same & (step < 1.5 * ordinary)
        return np.concatenate([[0.0], np.cumsum(np.where(is_continuous, step, ordinary))])
