"""Remarks on a regression: significance of its figures, and faults of its data.

Every threshold is a named constant with its reason next to it. docs/evidence/identification.md
states how often each remark occurs by chance.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
import scipy

from flightmech.errors import IdentificationError
from flightmech.names import lookup
from flightmech.support.figures import new_figure
from flightmech.units import DEGREE
from flighttest.parameter_constraints import constraint_remarks
from flighttest.regression.equation_error import least_squares
from flighttest.regression.equation_error.fit_data import FitData
from flighttest.regression.equation_error.movement import (
    MOVED_LEAST,
    judged_variable,
    ranges_in_spans,
)
from flighttest.regression.equation_error.spike_remarks import TINY, remark_spikes
from flighttest.regression.equation_error.structure_remarks import (
    remark_growth,
    remark_noise,
    remark_structure,
)
from flighttest.regression.uncertainty import collinearity
from flighttest.regression.uncertainty.residual_spectrum import HIDDEN
from flighttest.remarks import Convergence, Remark

if TYPE_CHECKING:
    from matplotlib.figure import Figure

# probability of F above which a fit is no better than noise: one noise record in a hundred passes
EXCITED = 0.01
SIGNIFICANT = 0.05  # probability of t above which a term is not significant
LOST = 1.0  # systematic standard error over the estimate above which a slope has no value
WRONG = 0.01  # probability of t below which a wrong sign is not a chance result
# share of the variance that a model must explain for its terms to be the cause of the movement
EXPLAINED = 0.5
SIGN_KNOWN = 2.0  # standard errors by which a prior must differ from zero to have a sign
# standard error over that of a lag window: four fifths of real fits lie between 1 and 2
APART = 3.0
# Change of weights or spectrum, in tolerances, above which a fit must not be used: a hundredth of
# a weight, or of the variance at a frequency.
FAR = 100.0
_EDGE = 0.5  # posterior probability of the largest roughness above which the spectrum is too rough
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
"""Sign of a control derivative by the definition of the control (`flightmech.names`).

Trailing edge down increases lift; the elevator is at the tail.
"""


def fit_figure(fit: FitData) -> Figure:
    """Return the figure of a fit, without gaps in time, with a line between two manoeuvres.

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
        for boundary in along[1:][np.diff(manoeuvre) != 0]:
            ax.axvline(boundary, color="0.3", linewidth=0.8, linestyle=":")
    upper.set_ylabel(name)
    lower.set_ylabel("residual")
    lower.set_xlabel("time of the samples [s]")
    upper.legend(frameon=False, fontsize="small")
    upper.set_title(f"{fit.name}: {fit.model}" if fit.name else str(fit.model), fontsize="medium")
    return figure


def remarks_of(fit: FitData) -> list[Remark]:
    """Return all remarks on a fit; errors first."""
    remarks = [
        *_remark_significance(fit),
        *_remark_systematic(fit),
        *_remark_rest(fit),
        *_remark_unexplained(fit),
        *_remark_signs(fit),
        *remark_spikes(fit),
        *_remark_collinearity(fit),
        *_remark_offset(fit),
        *_remark_disturbance(fit),
        *_remark_convergence(fit),
        *remark_structure(fit.estimates),
        *remark_growth(fit.estimates),
        *constraint_remarks(fit.estimates.attrs.get("constraints", "")),
        *remark_noise(fit.estimates),
    ]
    return sorted(remarks, key=lambda remark: remark.severity != "error")


def unsettled_attributes(iteration: str, convergence: Convergence) -> dict[str, float]:
    """Return the attributes of an iteration that did not converge; none if it did.

    Parameters
    ----------
    iteration : {"weights", "spectrum"}
    convergence : Convergence
    """
    if convergence.converged:
        return {}
    return {
        f"{iteration}_rounds": convergence.iterations,
        f"{iteration}_change": convergence.change,
    }


def _remark_convergence(fit: FitData) -> list[Remark]:
    """Return the iterations of the fit that did not converge."""
    a = fit.estimates.attrs
    advice = {
        "weights": "estimates and standard errors belong to weights that still change; take equal "
        "weights, or leave out the samples that the model does not explain",
        "spectrum": "standard errors belong to a spectrum of the residual that still changes; "
        "widen the band, or give longer manoeuvres",
    }
    remarks = []
    for iteration, text in advice.items():
        if f"{iteration}_change" not in a:
            continue
        rounds, change = int(a[f"{iteration}_rounds"]), float(a[f"{iteration}_change"])
        severity = "error" if change > FAR else "warning"
        remarks += Convergence(False, rounds, change).remarks(iteration, text, severity=severity)
    return remarks


def against_prior(terms, estimate, variance, dof, prior, prior_stderr) -> list[Remark]:
    """Return the terms whose sign contradicts a prior with a certain sign.

    Parameters
    ----------
    terms : sequence of str
    estimate, variance, dof : array (terms,)
        Of flight alone, systematic errors included in the variance.
    prior, prior_stderr : array (terms,)
        NaN for a term without prior.
    """
    remarks = []
    for k, term in enumerate(terms):
        value, expected, sigma = estimate[k], prior[k], prior_stderr[k]
        t = value / np.sqrt(variance[k])
        has_sign = abs(expected) > SIGN_KNOWN * sigma
        if has_sign and value * expected < 0.0 and _probability(t, dof[k]) < WRONG:
            text = (
                f"sign against the prior: {term} is {value:.3g} at {abs(t):.1f} standard "
                f"errors, the prior {expected:.3g} +- {sigma:.2g}; "
                "check the sign of the channel, and what else moved with it"
            )
            remarks.append(
                Remark(
                    "sign",
                    text,
                    str(term),
                    value=float(t),
                    threshold=_quantile(dof[k]),
                    severity="error",
                )
            )
    return remarks


def _probability(t: float, dof: float) -> float:
    """Return the two-sided probability of Student's t."""
    return 2.0 * scipy.stats.t.sf(abs(t), dof)


def _quantile(dof: float) -> float:
    """Return the value of t with the two-sided probability `WRONG`."""
    return float(scipy.stats.t.ppf(1.0 - WRONG / 2.0, dof))


def _remark_significance(fit: FitData) -> list[Remark]:
    """Return the F test of all slopes; if it is significant, the t test of each."""
    e, a = fit.estimates, fit.estimates.attrs
    if not a.get("F_terms"):
        return []
    # Without a significant slope the single tests have no meaning.
    if a["F_probability"] > EXCITED:
        text = (
            f"no excitation: the slopes together do not differ from zero, F({a['F_terms']}, "
            f"{a['F_dof']:.0f}) {a['F']:.2g}, probability "
            f"{a['F_probability']:.2g} (limit {EXCITED:g}), R2 {a['R2']:.3g}; no figure of "
            f"this fit may be used: give a manoeuvre that moves the terms"
        )
        return [
            Remark(
                "no excitation",
                text,
                "",
                value=a["F_probability"],
                threshold=EXCITED,
                severity="error",
            )
        ]
    names, p, t = [str(term) for term in e["term"].values], e["p_value"].values, e["t"].values
    # An intercept may be zero.
    is_idle = (p > SIGNIFICANT) & ~least_squares.intercept_mask(names)
    remarks = []
    for k in np.flatnonzero(is_idle):
        text = f"not significant: {names[k]}, t {t[k]:.1f}, probability {p[k]:.2g}"
        remarks.append(Remark("not significant", text, names[k], p[k], SIGNIFICANT))
    return remarks


def _remark_systematic(fit: FitData) -> list[Remark]:
    """Return the slopes that the common errors of the measurement leave without a value.

    Neither t nor F contains these errors: with a wrong size of one, every test still passes.
    """
    e = fit.estimates
    if not e.sizes.get("error"):
        return []
    names = [str(term) for term in e["term"].values]
    sizes, stderr = np.abs(e["estimate"].values), e["stderr_systematic"].values
    # a term that noise alone hides has its remark already
    is_significant = (
        e["p_value"].values <= SIGNIFICANT if "p_value" in e else np.ones(len(names), bool)
    )
    is_lost = is_significant & (stderr > LOST * sizes) & ~least_squares.intercept_mask(names)
    remarks = []
    for k in np.flatnonzero(is_lost):
        largest = str(e["error"].values[np.abs(e["systematic"].values[k]).argmax()])
        text = (
            f"{names[k]} has no value: its systematic standard error {stderr[k]:.3g} is larger "
            f"than the estimate {e['estimate'].values[k]:.3g}, mostly by {largest}; correct the "
            f"size of that error, or measure its source better"
        )
        remarks.append(Remark("systematic", text, names[k], stderr[k] / sizes[k], LOST))
    return remarks


def _remark_rest(fit: FitData) -> list[Remark]:
    """Return the angles of the model that move in none of its manoeuvres."""
    data = fit.data
    if not {"time", "manoeuvre"} <= set(data.variables) or not data.sizes.get("sample"):
        return []
    names = [name for name in fit.model.variables if judged_variable(name) == name]
    names = [name for name in names if lookup(name).units == "rad"]
    columns = {name: data[name].values for name in names if name in data}
    largest = dict.fromkeys(columns, 0.0)
    for index in np.unique(data["manoeuvre"].values):
        inside = data["manoeuvre"].values == index
        time = data["time"].values[inside]
        within = {name: values[inside] for name, values in columns.items()}
        for name, size in ranges_in_spans(time, within, [(time[0], time[-1])])[0].items():
            largest[name] = max(largest[name], size)
    remarks = []
    for name, size in largest.items():
        if size < MOVED_LEAST:
            text = (
                f"{name} hardly moves: range {size / DEGREE:.2g} deg inside a manoeuvre, "
                f"{MOVED_LEAST / DEGREE:g} deg is a movement; its estimate is noise, or the "
                f"difference between manoeuvres: give a manoeuvre that moves it"
            )
            remarks.append(Remark("rest", text, name, size, MOVED_LEAST))
    return remarks


def _remark_unexplained(fit: FitData) -> list[Remark]:
    """Return a remark if the model explains less than half of the movement."""
    R2, probability = fit.estimates.attrs["R2"], fit.estimates.attrs.get("F_probability", np.nan)
    if not R2 < EXPLAINED or not probability <= EXCITED:
        return []
    text = (
        f"the model explains {R2:.1%} of the movement of {fit.model.coefficient}, less than "
        f"{EXPLAINED:.0%}: something else moves it"
    )
    return [Remark("unexplained", text, "", R2, EXPLAINED)]


def _remark_signs(fit: FitData) -> list[Remark]:
    """Return the control derivatives, at the mean of the samples, with the wrong sign."""
    e = fit.estimates
    if "dof" not in e:
        return []
    D = e["systematic"].values
    # Covariance of the noise, and of the common errors D of the instruments.
    C = e["covariance"].values + D @ D.T
    remarks = []
    for (coefficient, control), sign in SIGNS.items():
        if coefficient != fit.model.coefficient or control not in fit.model.variables:
            continue
        slope = _control_slope(fit, control)
        value = float(slope @ e["estimate"].values)
        sigma = float(np.sqrt(max(0.0, slope @ C @ slope)))
        dof = float(e["dof"].values[slope != 0.0].min(initial=np.inf))
        if not sigma > 0.0 and "constraints" in e.attrs:
            continue  # a value that a constraint gives is not an estimate
        if not (sign * value < 0.0 and _probability(value / max(sigma, TINY), dof) < WRONG):
            continue
        expected = "positive" if sign > 0 else "negative"
        text = (
            f"sign against the convention: d{coefficient}/d{control} is {value:.3g} at "
            f"{abs(value) / sigma:.1f} standard errors, {expected} by the definition of "
            f"{control}; check the sign of the channel, its delay, and what else moved with it"
        )
        limit = -sign * _quantile(dof)
        remarks.append(
            Remark("sign", text, control, value=value / sigma, threshold=limit, severity="error")
        )
    return remarks


def _control_slope(fit: FitData, control: str) -> np.ndarray:
    """Return the mean derivative of the model by a control, as weights of the terms."""
    data = fit.data
    # central difference; a thousandth of the range of the control, or 1e-6 if it does not move
    step = 1e-3 * float(np.ptp(data[control].values)) or 1e-6
    up = fit.model.design(data.assign({control: data[control] + 1.0 * step}))
    down = fit.model.design(data.assign({control: data[control] + -1.0 * step}))
    slope_of = dict(zip(fit.model.terms, ((up - down) / (2.0 * step)).mean(axis=0)))
    return np.array([slope_of.get(str(term), 0.0) for term in fit.estimates["term"].values])


def _remark_collinearity(fit: FitData) -> list[Remark]:
    """Return large VIF, correlated pairs of regressors, and large condition indexes."""
    e = fit.estimates
    terms = [str(term) for term in e["term"].values]
    remarks = []
    for term, vif in zip(terms, e["vif"].values):
        if vif > collinearity.VIF:
            text = f"VIF of {term} is {vif:.0f} (above {collinearity.VIF:.0f})"
            remarks.append(Remark("collinear", text, term, float(vif), collinearity.VIF))
    rho = e["regressor_correlation"].values
    limit = collinearity.CORRELATED
    for i, j in zip(*np.nonzero(np.triu(np.abs(rho) > limit, 1))):
        text = f"regressors {terms[i]} and {terms[j]} are correlated by {rho[i, j]:.2f}"
        remarks.append(Remark("collinear", text, terms[i], float(rho[i, j]), limit))
    for index, involved in collinearity.collinear_terms(e):
        text = f"condition index {index:.0f}: hardly distinguishable are {involved}"
        remarks.append(Remark("collinear", text, "", index, collinearity.CONDITION))
    return remarks


def _remark_offset(fit: FitData) -> list[Remark]:
    """Return a remark if a constant differs between manoeuvres by more than the residual."""
    offset, rms = fit.estimates.attrs["offset"], fit.estimates.attrs["residual_rms"]
    if not offset > rms:  # both are NaN for published values
        return []
    text = (
        f"manoeuvres differ by a constant of {offset:.2g} (1 sigma), more than the residual; "
        f"consider separate intercepts"
    )
    return [Remark("offset", text, "1", offset, rms)]


def _remark_disturbance(fit: FitData) -> list[Remark]:
    """Return assumptions of the standard errors: the hidden disturbance, and the lag window."""
    e = fit.estimates
    if "hidden" not in e.attrs:
        return []
    remarks = []
    hidden, edge = e.attrs["hidden"], e.attrs["edge"]
    # Ratio of the variances of the disturbance and of the residual that is left of it.
    if hidden > HIDDEN**2:
        text = (
            f"the disturbance has {hidden:.0f} times the variance of the residual: the fit "
            f"has taken up most of it; standard errors "
            "rest on assumptions about slow disturbances, add manoeuvres"
        )
        remarks.append(Remark("disturbance", text, "", hidden, HIDDEN**2))
    if edge > _EDGE:
        text = (
            "the spectrum of the residual is rougher than all that were allowed: look for "
            "lines in it; standard errors may be too small"
        )
        remarks.append(Remark("disturbance", text, "", edge, _EDGE))
    for term, stderr, window in zip(
        e["term"].values, e["stderr"].values, e["stderr_window"].values
    ):
        ratio = float(stderr / window) if window > 0.0 else 1.0
        if not 1.0 / APART <= ratio <= APART:
            text = (
                f"{term}: the standard error is {ratio:.2g} times that of a lag window "
                f"({window:.2g}); the disturbance is slow or rough"
            )
            limit = APART if ratio > 1.0 else 1.0 / APART
            remarks.append(Remark("disturbance", text, str(term), ratio, limit))
    return remarks
