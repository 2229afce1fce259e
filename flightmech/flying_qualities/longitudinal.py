"""Neutral points, manoeuvre points, elevator and stick force per g, at constant speed and thrust.

Moments are taken about the centre of gravity x, forces normal to the flight path.  With n the load
factor there, in a pull-up dq = g dn / V and

    dL:  (CL_alpha + CT cos) dalpha + CL_q dqhat + CL_n dn + CL_de dde = CW dn
    dM:  Cm_alpha(x) dalpha + Cm_q(x) dqhat + Cm_n(x) dn + Cm_de(x) dde = 0
    dCh: Ch_alpha dalpha + Ch_q dqhat + Ch_n dn + Ch_de dde = 0                     elevator free

All derivatives come from the tables at the trimmed flight.  Neutral points have Cm_alpha(x) = 0,
with dde = -Ch_alpha/Ch_de dalpha if the elevator is free.  Manoeuvre points have no elevator
(fixed) or no hinge moment (free) per g.  Alpha is that at the c.g., as in the kernel.  Another c.g.
therefore changes moments, but no damping term.

References
----------
.. [Etkin] Etkin, Dynamics of Atmospheric Flight, 1972, chapters 6 and 7.
.. [LR743] Report LR-743, 1993, section 2.2.
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import scipy

from flightmech.flying_qualities.control_forces import column_force_slope
from flightmech.steady_flight.flight_condition import Characteristic, absent_rows
from flightmech.steady_flight.trim_point import Point
from flightmech.units import G0

GROUP = "longitudinal stability"
NO_ELEVATOR = (
    "the elevator has no effect on the pitching moment: the database has no such term here"
)
NO_HINGE = "the database has no hinge moments Ch_e over the elevator deflection"
NO_CONVERGENCE = "the search for the c.g. without this moment did not converge"
SMALL = 1e-9  # derivative that counts as zero
# Search of a c.g.: first step and tolerance, in mean chords.
_CG_STEP, _CG_TOLERANCE = 0.1, 1e-10
# Indices of the pitching moment and of the body forces among the six coefficients.
_CX, _CZ, _CM = 0, 2, 4


def longitudinal_rows(point: Point) -> list[Characteristic]:
    """Return c.g., neutral and manoeuvre points, margins, elevator and force per g as rows."""
    craft = point.aircraft
    # body x is forward, chords count backwards
    cg = craft.x_ref_mac - point.cg[0] / craft.cbar
    neutral_point = _find_cg(point, lambda x: point.body_slopes("alpha", x)[_CM])
    # without an effect of the elevator the rows of control are absent
    has_elevator = abs(point.body_slopes("delta_e")[_CM]) > SMALL
    rows = [
        Characteristic(
            GROUP,
            "x_cg",
            cg,
            units="1",
            remark="centre of gravity, chords behind the leading edge of the mean chord",
        ),
        Characteristic(
            GROUP,
            "neutral_point_fixed",
            neutral_point,
            units="1",
            remark="elevator held, constant speed: Cm_alpha about it is zero",
        ),
        Characteristic(
            GROUP,
            "static_margin_fixed",
            neutral_point - cg,
            units="1",
            remark="neutral point minus c.g.: positive is stable",
        ),
        *_manoeuvre_fixed_rows(point, cg, has_elevator),
        *_free_rows(point, cg, has_elevator),
        *_stick_force_rows(point, has_elevator),
    ]
    return _mark_undetermined(rows)


def _manoeuvre_fixed_rows(point: Point, cg: float, has_elevator: bool) -> list[Characteristic]:
    """Return manoeuvre point and margin stick fixed, elevator and angle of attack per g."""
    manoeuvre_point = _find_cg(point, lambda x: pull_up(point, x, "held")[2])
    rows = [
        Characteristic(
            GROUP,
            "manoeuvre_point_fixed",
            manoeuvre_point,
            units="1",
            remark="no elevator per g in a pull-up at constant speed and thrust",
        ),
        Characteristic(
            GROUP,
            "manoeuvre_margin_fixed",
            manoeuvre_point - cg,
            units="1",
            remark="manoeuvre point minus c.g.",
        ),
    ]
    if not has_elevator:
        names = {"elevator_per_g": "rad", "alpha_per_g": "rad"}
        return [*rows, *absent_rows(GROUP, names, NO_ELEVATOR)]
    alpha, delta_e, _ = pull_up(point, point.cg[0], "moved")
    return [
        *rows,
        Characteristic(
            GROUP,
            "elevator_per_g",
            delta_e,
            units="rad",
            remark="per unit of load factor, pull-up; negative: trailing edge up pulls g",
        ),
        Characteristic(
            GROUP, "alpha_per_g", alpha, units="rad", remark="per unit of load factor, pull-up"
        ),
    ]


def _free_rows(point: Point, cg: float, has_elevator: bool) -> list[Characteristic]:
    """Return neutral and manoeuvre points and margins stick free."""
    names = {
        "neutral_point_free": "1",
        "static_margin_free": "1",
        "manoeuvre_point_free": "1",
        "manoeuvre_margin_free": "1",
    }
    if not has_elevator:
        return absent_rows(GROUP, names, NO_ELEVATOR)
    if not abs(hinge_moment_slope(point, "delta_e")) > SMALL:
        return absent_rows(GROUP, names, NO_HINGE)
    # Elevator per angle of attack without a hinge moment: -Ch_alpha / Ch_de.
    floating = -hinge_moment_slope(point, "alpha") / hinge_moment_slope(point, "delta_e")

    def free_slope(x: float) -> float:
        by_alpha = point.body_slopes("alpha", x)[_CM]
        return by_alpha + floating * point.body_slopes("delta_e", x)[_CM]

    neutral_point = _find_cg(point, free_slope)
    manoeuvre_point = _find_cg(point, lambda x: pull_up(point, x, "free")[2])
    return [
        Characteristic(
            GROUP,
            "neutral_point_free",
            neutral_point,
            units="1",
            remark=f"elevator floats by {floating:.3g} rad per rad of alpha",
        ),
        Characteristic(
            GROUP,
            "static_margin_free",
            neutral_point - cg,
            units="1",
            remark="neutral point minus c.g.",
        ),
        Characteristic(
            GROUP,
            "manoeuvre_point_free",
            manoeuvre_point,
            units="1",
            remark="no hinge moment per g, without bobweight and springs",
        ),
        Characteristic(
            GROUP,
            "manoeuvre_margin_free",
            manoeuvre_point - cg,
            units="1",
            remark="manoeuvre point minus c.g.",
        ),
    ]


def _stick_force_rows(point: Point, has_elevator: bool) -> list[Characteristic]:
    names = {"stick_force_per_g": "N"}
    if not has_elevator:
        return absent_rows(GROUP, names, NO_ELEVATOR)
    alpha, delta_e, _ = pull_up(point, point.cg[0], "moved")
    changes = {"alpha": alpha, "delta_e": delta_e, "qhat": _pitch_rate_per_g(point), "dnz": 1.0}
    # hinge moments change with all four quantities of the pull-up
    force, reason = column_force_slope(point, changes)
    if reason:
        return absent_rows(GROUP, names, reason)
    return [
        Characteristic(
            GROUP,
            "stick_force_per_g",
            force,
            units="N",
            remark="pull per unit of load factor, pull-up, without bobweight, springs and friction",
        )
    ]


def hinge_moment_slope(point: Point, variable: str) -> float:
    """Return the slope of Ch_e over a variable, 0 without hinge moments in the database."""
    return point.hinge_slope("Ch_e", variable)


def _pitch_rate_per_g(point: Point) -> float:
    """Return dqhat per unit of load factor: g/V times cbar/2V. [1]"""
    return G0 / point["V"] * 0.5 * point.aircraft.cbar / point["V"]


def pull_up(point: Point, x_cg_b: float, elevator: str) -> tuple[float, float, float]:
    """Return angle of attack and elevator per g [rad], and the residual pitching moment [1].

    Parameters
    ----------
    point : Point
        The flight.
    x_cg_b : float
        Centre of gravity forward of the moment reference point. [m]
    elevator : {"moved", "held", "free"}
        The elevator moves so that the moment vanishes, is fixed, or floats without a hinge moment.
    """
    slopes, lift = {}, {}
    for name in ("alpha", "qhat", "dnz", "delta_e"):
        slopes[name] = point.body_slopes(name, x_cg_b)
        lift[name] = _lift_slope(point, name, slopes[name])
    qhat = _pitch_rate_per_g(point)
    # terms of the equations dL and dM of the module that do not depend on alpha and elevator
    lift_change = point.CW - lift["qhat"] * qhat - lift["dnz"]
    moment = slopes["qhat"][_CM] * qhat + slopes["dnz"][_CM]
    if elevator == "moved":  # dM
        condition = [slopes["alpha"][_CM], slopes["delta_e"][_CM]]
        condition_change = -moment
    elif elevator == "held":
        condition = [0.0, 1.0]
        condition_change = 0.0
    elif elevator == "free":  # dCh
        condition = [hinge_moment_slope(point, "alpha"), hinge_moment_slope(point, "delta_e")]
        condition_change = -hinge_moment_slope(point, "qhat") * qhat
        condition_change -= hinge_moment_slope(point, "dnz")
    else:
        raise ValueError(f"elevator is {elevator!r}; allowed: moved, held, free")
    matrix = [[lift["alpha"], lift["delta_e"]], condition]
    alpha, delta_e = np.linalg.solve(matrix, [lift_change, condition_change])
    residual = moment + slopes["alpha"][_CM] * alpha + slopes["delta_e"][_CM] * delta_e
    return float(alpha), float(delta_e), float(residual)


def _lift_slope(point: Point, variable: str, slope: np.ndarray) -> float:
    """Return the slope of the force normal to the flight path over qbar S."""
    alpha = point["alpha"]
    s, c = np.sin(alpha), np.cos(alpha)
    normal = slope[_CX] * s - slope[_CZ] * c
    if variable != "alpha":
        return normal
    # with alpha the body axes turn against the path, and with them aerodynamic force and thrust
    CX, _, CZ, *_ = point.body_coefficients()
    CX_T, CZ_T = thrust_coefficients(point)
    return normal + (CX + CX_T) * c + (CZ + CZ_T) * s


def thrust_coefficients(point: Point) -> tuple[float, float]:
    """Return the thrust over qbar S along body x and z."""
    force = np.zeros(3)
    for number, engine in enumerate(point.aircraft.engines, 1):
        force += point[f"engine{number}.thrust"] * np.array(engine.direction)
    # thrust along body y does not act in the plane of symmetry
    x, _, z = force / (point["qbar"] * point.aircraft.S)
    return float(x), float(z)


def _find_cg(point: Point, residual: Callable[[float], float]) -> float:
    """Return the c.g. at which `residual` is zero, in chords behind the leading edge.

    The residual is linear in the c.g. unless terms depend on it. The result is NaN if the search
    does not converge, for example because the residual does not depend on the c.g.
    """
    craft = point.aircraft
    search = scipy.optimize.root_scalar(
        residual,
        x0=point.cg[0],
        x1=point.cg[0] - _CG_STEP * craft.cbar,
        method="secant",
        xtol=_CG_TOLERANCE * craft.cbar,
        maxiter=50,
    )
    if not search.converged:
        return np.nan
    return craft.x_ref_mac - float(search.root) / craft.cbar


def _mark_undetermined(rows: list[Characteristic]) -> list[Characteristic]:
    """Return rows in which a value that the search for the c.g. did not find is absent."""
    marked = []
    for row in rows:
        if np.isnan(row.value) and not row.absent:
            row = row._replace(remark="", absent=NO_CONVERGENCE)
        marked.append(row)
    return marked
