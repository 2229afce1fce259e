"""Remarks on propellers and engines identified from flight: units, separability, points, unknowns.

A record in wrong units converges: the points determine nothing then, and the estimates stay near
their a-priori values with a large noise.  The noise is therefore compared with what rough air and
instruments can make.
"""

from __future__ import annotations

import numpy as np

from flighttest.remarks import Remark
from flighttest.submodels.engine.propellers.equations import PropulsionEquations
from flighttest.submodels.engine.propellers.estimate import (
    SEPARABLE,
    PointEstimate,
    Separability,
)

# Remaining part of an a-priori standard error up to which the points determine an unknown.
_DETERMINED = 0.9
# Residual over its noise above which a point is remarked.
_OUTLIER = 4.0
# Noise of the residuals above which the records do not belong to the tables: of the force [m/s2],
# and of the equations that are relative to the largest power or fuel flow. Rough air makes 0.1
# m/s2 in means over 6 s, instruments 1 to 2 % (our judgement).
_MOST_FORCE, _MOST_RELATIVE = 0.3, 0.05
# Distance of an unknown from its a-priori value that is remarked, in a-priori standard errors.
_FAR = 2.0


def fit_remarks(
    equations: PropulsionEquations, estimate: PointEstimate, separability: Separability | None
) -> list[Remark]:
    """Return the remarks on an estimate at points.

    Parameters
    ----------
    equations : PropulsionEquations
    estimate : PointEstimate
    separability : Separability or None
        None if the polar is held.
    """
    advice = "the estimates must not be used; look at the residuals of the points"
    remarks = estimate.convergence.remarks("propulsion", advice)
    remarks += _misfit_remarks(estimate) + _separability_remarks(separability)
    remarks += _outlier_remarks(estimate)
    remarks += _far_remarks(equations, estimate) + _prior_remarks(equations, estimate)
    if "alpha" not in equations.columns:
        text = (
            "neither angle of attack nor pitch attitude is recorded: the thrust counts along the "
            "path, and its part in the lift is not subtracted; map alpha_vane or theta"
        )
        remarks.append(Remark("points", text, "alpha"))
    if equations.metered:
        text = (
            "fuel flow is not corrected: air and mixture make the power of this engine, so that "
            "a factor on the flow would change the power too"
        )
        remarks.append(Remark("prior", text, "fuel_flow", severity="note"))
    if equations.left_out:
        remarks.append(Remark("points", f"left out: {equations.left_out}", severity="note"))
    return remarks


def _misfit_remarks(estimate: PointEstimate) -> list[Remark]:
    """Return a remark on each equation whose noise no record of the right units has."""
    remarks = []
    for name, noise in estimate.noise.items():
        most = _MOST_FORCE if name == "force" else _MOST_RELATIVE
        if noise <= most:
            continue
        size = f"{noise:.3g} m/s2, above {most:g} m/s2"
        if name != "force":
            size = f"{noise:.1%} of the largest, above {most:.0%}"
        text = (
            f"{name}: the noise of the residuals is {size}; the records do not belong to these "
            f"tables and must not correct them; check the units of rpm, manifold_pressure, "
            f"torque, fuel_flow, and diameter and gear_ratio of the aircraft file"
        )
        remarks.append(Remark("unexplained", text, name, noise, most, severity="error"))
    return remarks


def _separability_remarks(found: Separability | None) -> list[Remark]:
    """Return a remark if the points do not separate thrust and drag."""
    if found is None:
        text = (
            "thrust and power stand on the polar that was given: an error of the drag is an equal "
            "error of the thrust; give standard errors of the polar"
        )
        return [Remark("collinear", text, "CT_prop")]
    if found.separable:
        return []
    name, error = next(iter(found.manoeuvres.items()))
    text = (
        f"thrust and drag are not separable: correlation {found.correlation:.3f}, above "
        f"{SEPARABLE:g}, and the points alone know the thrust to {found.error:.0%}, less well than "
        f"the a-priori tables ({found.prior_error:.0%}); the {found.posterior_error:.1%} of both "
        f"lean on the polar that was given; fly {name}, after which the points alone know the "
        f"thrust to {error:.1%}"
    )
    if error > found.prior_error:
        text += "; one such manoeuvre is not enough, fly full power and idle over the speed range"
    return [Remark("collinear", text, "CT_prop", found.error, found.prior_error)]


def _outlier_remarks(estimate: PointEstimate) -> list[Remark]:
    """Return a remark on each equation with residuals far beyond its noise."""
    remarks = []
    for name, v in estimate.residuals.items():
        far = np.flatnonzero(np.abs(v) > _OUTLIER * estimate.noise[name])
        if far.size:
            worst = float(np.max(np.abs(v)) / estimate.noise[name])
            text = (
                f"{name}: {far.size} of {len(v)} residuals exceed {_OUTLIER:g} times their noise, "
                f"the largest {worst:.1f}; look for gusts and wrong channels there"
            )
            remarks.append(Remark("spike", text, name, worst, _OUTLIER))
    return remarks


def _far_remarks(equations: PropulsionEquations, estimate: PointEstimate) -> list[Remark]:
    """Return a remark on the unknowns that are far from their a-priori values."""
    far = {}
    for (name, unknown), value in zip(equations.unknowns.items(), estimate.value):
        if unknown.stderr > 0.0:
            distance = float(value - unknown.value) / unknown.stderr
            if abs(distance) > _FAR:
                far[name] = distance
    if not far:
        return []
    words = ", ".join(f"{name} {distance:+.1f}" for name, distance in far.items())
    text = (
        f"further than {_FAR:g} a-priori standard errors from the a-priori value: {words}; check "
        f"units and calibration of the channels, and diameter and gear_ratio"
    )
    return [Remark("prior", text, next(iter(far)), max(map(abs, far.values())), _FAR)]


def _prior_remarks(equations: PropulsionEquations, estimate: PointEstimate) -> list[Remark]:
    """Return notes on unknowns that remain as a priori."""
    kept = []
    errors = np.sqrt(np.diag(estimate.covariance))
    for (name, unknown), error in zip(equations.unknowns.items(), errors):
        sigma = unknown.stderr
        if sigma > 0.0 and error > _DETERMINED * sigma and not name.startswith("error of"):
            kept.append(name)
    if not kept:
        return []
    text = f"as a priori, because the points do not show them: {', '.join(kept)}"
    return [Remark("prior", text, severity="note")]
