"""What a regression's numbers do not show by themselves: whether they mean anything, and what may
have spoilt them.

Every threshold is a named constant with its reason next to it; docs/evidence/identification.md states how often
each speaks by chance.
"""

from __future__ import annotations

from collections.abc import Collection
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
import scipy
import xarray as xr

from flightmech.errors import IdentificationError
from flightmech.support.figures import new_figure
from flighttest.regression.equation_error import least_squares
from flighttest.regression.equation_error.model import RegressionModel
from flighttest.regression.uncertainty import collinearity
from flighttest.regression.uncertainty.residual_spectrum import HIDDEN
from flighttest.remarks import Remark

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
        ``estimate``, ``stderr`` (coloured residuals), ``stderr_white``, ``stderr_systematic``,
        ``covariance`` and ``correlation`` of the estimates (coloured), ``systematic`` (term,
        error): change of the estimates for one standard error of each source, ``stderr_window`` (by
        a lag window of a tenth of the longest stretch, in time), ``contribution`` (rms of the term
        about its mean over the rms of the coefficient about its mean); of the regressors ``vif``,
        ``regressor_correlation``, ``condition_index`` (component) and ``proportion`` (component,
        term).  Attributes: ``coefficient``, ``name``, ``domain`` (time, frequency or published),
        ``R2``, ``residual_rms``, ``samples``, ``manoeuvres``, ``offset`` (standard deviation of a
        constant between manoeuvres); of a frequency fit ``R2`` is that inside ``band``.  Tests and
        intervals are those of `significance.add_tests` (``t``, ``p_value``, ``dof``, ``low``, ``high``;
        ``F``, ``F_terms``, ``F_dof``, ``F_probability``), the colour of the residual that of
        `significance.residual_whiteness` (``portmanteau``, ``portmanteau_lags``,
        ``portmanteau_probability``, ``correlation_time`` [s]).
    data : Dataset (sample,)
        The samples used: coefficient, model variables, what tables may depend on, ``time`` and
        ``manoeuvre`` (from 0).
    design : DataArray (sample, term)
        The regressors whose ordinary least squares over the samples the estimate is: those of the
        model, but for weights, ridge and frequency, where it makes the estimate the same linear
        function of the measurements.
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


# probability of F above which a fit is no better than noise: one noise record in a hundred passes
EXCITED = 0.01
SIGNIFICANT = 0.05  # probability of t above which a term is called not significant
WRONG = 0.01  # probability of t below which a wrong sign is no chance
EXPLAINED = (
    0.5  # of the variance, that a model must explain for its terms to be what moves the coefficient
)
SIGN_KNOWN = 2.0  # standard errors by which a prior must differ from zero to have a sign
# robust standard deviations of a departure from its neighbours: never by chance in 10^6 Gaussian
# samples
SPIKE = 8.0
OUTSIDE = 5.0  # and of the residual itself
SMOOTH = 0.1  # least scatter about the neighbours, of that of the residual
NEIGHBOURS = 4  # samples on each side that determine what a sample should be; spikes are shorter
APART = (
    3.0  # standard error over that of a lag window: four fifths of real fits lie between 1 and 2
)
SIGNS = {
    ("CL", "delta_e"): 1,
    ("CZ", "delta_e"): -1,
    ("Cm", "delta_e"): -1,
    ("CL", "delta_f"): 1,
    ("CZ", "delta_f"): -1,
    ("CY", "delta_r"): 1,
    ("Cn", "delta_r"): -1,
    ("Cl", "delta_a"): -1,
    ("Cl", "delta_d"): -1,
    ("Cl", "delta_s"): -1,
    ("Cl", "delta_sp"): -1,
}
"""Sign of a control derivative by the definition of the control (`flightmech.names`): trailing edge down lifts, elevator at the tail."""


def remarks_of(fit: FitData) -> list[Remark]:
    """Return all remarks on a fit; errors first."""
    found = [
        *_insignificant(fit),
        *_unexplained(fit),
        *_signs(fit),
        *_spike(fit),
        *_collinear(fit),
        *_offset(fit),
        *_disturbance(fit),
    ]
    return sorted(found, key=lambda remark: remark.severity != "error")


def against_prior(terms, estimate, variance, dof, prior, prior_stderr) -> list[Remark]:
    """Return the terms whose sign contradicts a prior that is confident of its own.

    Parameters
    ----------
    terms : sequence of str
    estimate, variance, dof : array (terms,)
        Of flight alone, systematic errors included in the variance.
    prior, prior_stderr : array (terms,)
        NaN where there is none.
    """
    found = []
    for term, value, var, free, before, sigma in zip(
        terms, estimate, variance, dof, prior, prior_stderr
    ):
        t = value / np.sqrt(var)
        if (
            abs(before) > SIGN_KNOWN * sigma
            and value * before < 0.0
            and 2.0 * scipy.stats.t.sf(abs(t), free) < WRONG
        ):
            words = (
                f"sign against the prior: {term} is {value:.3g} at {abs(t):.1f} standard "
                f"errors, the prior {before:.3g} +- {sigma:.2g}; "
                "check the sign of the channel, and what else moved with it"
            )
            found.append(Remark("sign", words, str(term), float(t), _quantile(free), "error"))
    return found


def _quantile(dof: float) -> float:
    return float(scipy.stats.t.ppf(1.0 - WRONG / 2.0, dof))


def _insignificant(fit: FitData) -> list[Remark]:
    """The F test of all slopes; where it holds, the t test of each."""
    e, a = fit.estimates, fit.estimates.attrs
    if not a.get("F_terms"):
        return []
    if a["F_probability"] > EXCITED:
        words = (
            f"no excitation: the slopes together do not differ from zero, F({a['F_terms']}, "
            f"{a['F_dof']:.0f}) {a['F']:.2g}, probability "
            f"{a['F_probability']:.2g} (limit {EXCITED:g}), R2 {a['R2']:.3g}; no figure of "
            f"this fit may be used: give a manoeuvre that "
            "moves the terms"
        )
        return [Remark("no excitation", words, "", a["F_probability"], EXCITED, "error")]
    names, p, t = e["term"].values, e["p_value"].values, e["t"].values
    idle = [
        k
        for k in np.flatnonzero(p > SIGNIFICANT)
        if not least_squares.intercept_mask([str(names[k])])[0]
    ]
    return [
        Remark(
            "not significant",
            f"not significant: {names[k]}, t {t[k]:.1f}, probability {p[k]:.2g}",
            str(names[k]),
            p[k],
            SIGNIFICANT,
        )
        for k in idle
    ]


def _unexplained(fit: FitData) -> list[Remark]:
    R2, probability = fit.estimates.attrs["R2"], fit.estimates.attrs.get("F_probability", np.nan)
    if not R2 < EXPLAINED or not probability <= EXCITED:
        return []
    words = (
        f"the model explains {R2:.1%} of the movement of {fit.model.coefficient}, less than "
        f"{EXPLAINED:.0%}: something else moves it"
    )
    return [Remark("unexplained", words, "", R2, EXPLAINED)]


def _signs(fit: FitData) -> list[Remark]:
    """Control derivatives, at the mean of the samples, against the definition of the control."""
    found, e = [], fit.estimates
    if "dof" not in e:
        return []
    D = e["systematic"].values
    C = e["covariance"].values + D @ D.T
    for (coefficient, control), sign in SIGNS.items():
        if coefficient != fit.model.coefficient or control not in fit.model.variables:
            continue
        slope = _slope(fit, control)
        value, sigma = (
            float(slope @ e["estimate"].values),
            float(np.sqrt(max(0.0, slope @ C @ slope))),
        )
        free = float(e["dof"].values[slope != 0.0].min(initial=np.inf))
        if (
            sign * value < 0.0
            and 2.0 * scipy.stats.t.sf(abs(value) / max(sigma, np.finfo(float).tiny), free) < WRONG
        ):
            words = (
                f"sign against the convention: d{coefficient}/d{control} is {value:.3g} at "
                f"{abs(value) / sigma:.1f} standard errors, "
                f"{'positive' if sign > 0 else 'negative'} by the definition of {control}; "
                f"check the sign of the channel, its delay, and "
                "what else moved with it"
            )
            found.append(
                Remark("sign", words, control, value / sigma, -sign * _quantile(free), "error")
            )
    return found


def _slope(fit: FitData, control: str) -> np.ndarray:
    """Derivative of the model by a control at the mean of the samples, as weights of the terms."""
    data = fit.data
    step = 1e-3 * float(np.ptp(data[control].values)) or 1e-6
    up, down = (
        fit.model.design(data.assign({control: data[control] + side * step}))
        for side in (1.0, -1.0)
    )
    mean = dict(zip(fit.model.terms, ((up - down) / (2.0 * step)).mean(axis=0)))
    return np.array([mean.get(str(term), 0.0) for term in fit.estimates["term"].values])


def _spike(fit: FitData) -> list[Remark]:
    """The largest residual that its neighbours do not share, and what the fit is without it."""
    if (
        fit.estimates.attrs.get("weights") == "robust"
        or fit.data.sizes.get("sample", 0) <= 2 * NEIGHBOURS + 1
    ):
        return []
    v = fit.residual
    apart = v - np.median(
        np.lib.stride_tricks.sliding_window_view(
            np.pad(v, NEIGHBOURS, mode="reflect"), 2 * NEIGHBOURS + 1
        ),
        axis=1,
    )
    # a smooth residual is its own running median almost everywhere
    sizes = np.abs(apart) / max(_robust(apart), SMOOTH * _robust(v), np.finfo(float).tiny)
    far = np.abs(v - np.median(v)) / max(_robust(v), np.finfo(float).tiny)
    spikes = np.flatnonzero(
        (sizes > SPIKE)
        & (far > OUTSIDE)
        & (np.abs(v) > _ROUNDING * np.abs(fit.data[fit.model.coefficient].values).max())
    )
    if not len(spikes):
        return []
    worst = int(spikes[np.argmax(np.abs(apart[spikes]))])
    time, number = float(fit.data["time"].values[worst]), int(fit.data["manoeuvre"].values[worst])
    where = (
        f"{time:g} s"
        if fit.estimates.attrs["manoeuvres"] == 1
        else f"{time:g} s of manoeuvre {number}"
    )
    words = (
        f"spike of {apart[worst]:.3g} in {fit.model.coefficient} at {where}, "
        f"{sizes[worst]:.0f} times the scatter of the residual"
        f"{f' ({len(spikes)} samples stand out)' if len(spikes) > 1 else ''}{_without(fit, spikes)}; "
        f"take it out of the record, or use "
        "weights='robust'"
    )
    return [Remark("spike", words, "", float(sizes[worst]), SPIKE)]


_ROUNDING = 1e-9


def _without(fit: FitData, spikes: Collection[int]) -> str:
    """How the estimate that moves most would change, in words; empty where the fit is no plain one."""
    e, a = fit.estimates, fit.estimates.attrs
    if a["domain"] != "time" or a["weights"] != "equal" or a["ridge"]:
        return ""
    kept = np.setdiff1d(np.arange(fit.data.sizes["sample"]), list(spikes))
    z = fit.data[fit.model.coefficient].values
    theta = np.linalg.lstsq(fit.regressors.values[kept], z[kept], rcond=None)[0]
    change = np.abs(theta - e["estimate"].values) / np.maximum(
        e["stderr"].values, np.finfo(float).tiny
    )
    k = int(np.argmax(change))
    return (
        f"; without it {e['term'].values[k]} is {theta[k]:.4g} and not "
        f"{float(e['estimate'].values[k]):.4g}"
    )


def _robust(x: np.ndarray) -> float:
    return float(1.4826 * np.median(np.abs(x - np.median(x))))


def _collinear(fit: FitData) -> list[Remark]:
    e = fit.estimates
    terms = [str(term) for term in e["term"].values]
    found = [
        Remark(
            "collinear",
            f"VIF of {term} is {v:.0f} (above {collinearity.VIF:.0f})",
            term,
            float(v),
            collinearity.VIF,
        )
        for term, v in zip(terms, e["vif"].values)
        if v > collinearity.VIF
    ]
    rho = e["regressor_correlation"].values
    for i, j in zip(*np.nonzero(np.triu(np.abs(rho) > collinearity.CORRELATED, 1))):
        words = f"regressors {terms[i]} and {terms[j]} are correlated by {rho[i, j]:.2f}"
        found.append(
            Remark("collinear", words, terms[i], float(rho[i, j]), collinearity.CORRELATED)
        )
    for index, words in collinearity.collinear_terms(e):
        text = f"condition index {index:.0f}: hardly distinguishable are {words}"
        found.append(Remark("collinear", text, "", index, collinearity.CONDITION))
    return found


def _offset(fit: FitData) -> list[Remark]:
    offset, rms = fit.estimates.attrs["offset"], fit.estimates.attrs["residual_rms"]
    if not offset > rms:  # both are NaN of published values
        return []
    words = (
        f"manoeuvres differ by a constant of {offset:.2g} (1 sigma), more than the residual; "
        f"consider separate intercepts"
    )
    return [Remark("offset", words, "1", offset, rms)]


def _disturbance(fit: FitData) -> list[Remark]:
    """What the standard errors rest on: how much of the disturbance is hidden in the fit, and what
    a lag window states.
    """
    e = fit.estimates
    if "hidden" not in e.attrs:
        return []
    found = []
    hidden, edge = e.attrs["hidden"], e.attrs["edge"]
    if hidden > HIDDEN**2:
        words = (
            f"the disturbance has {hidden:.0f} times the variance of the residual: the fit "
            f"has taken up most of it; standard errors "
            "rest on assumptions about slow disturbances, add manoeuvres"
        )
        found.append(Remark("disturbance", words, "", hidden, HIDDEN**2))
    if edge > 0.5:
        words = (
            "the spectrum of the residual is rougher than all that were allowed: look for "
            "lines in it; standard errors may be too small"
        )
        found.append(Remark("disturbance", words, "", edge, 0.5))
    for term, own, window in zip(e["term"].values, e["stderr"].values, e["stderr_window"].values):
        ratio = float(own / window) if window > 0.0 else 1.0
        if not 1.0 / APART <= ratio <= APART:
            words = (
                f"{term}: the standard error is {ratio:.2g} times that of a lag window "
                f"({window:.2g}); the disturbance is slow or rough"
            )
            found.append(
                Remark(
                    "disturbance", words, str(term), ratio, APART if ratio > 1.0 else 1.0 / APART
                )
            )
    return found
