"""Neutral points, manoeuvre points, elevator and stick force per g: longitudinal stability at
constant speed and thrust.

Moments are taken about the centre of gravity x, forces normal to the flight path; with n the load
factor there, in a pull-up dq = g dn / V and

    dL:  (CL_alpha + CT cos) dalpha + CL_q dqhat + CL_n dn + CL_de dde = CW dn
    dM:  Cm_alpha(x) dalpha + Cm_q(x) dqhat + Cm_n(x) dn + Cm_de(x) dde = 0
    dCh: Ch_alpha dalpha + Ch_q dqhat + Ch_n dn + Ch_de dde = 0                     elevator free

All derivatives come from the tables at the trimmed flight.  Neutral points have Cm_alpha(x) = 0,
with dde = -Ch_alpha/Ch_de dalpha when free; manoeuvre points have no elevator (fixed) or no hinge
moment (free) per g.  Alpha is that at the c.g., as in the kernel, so a moved c.g. changes moments
and no damping term.

References
----------
.. [Etkin] Etkin, Dynamics of Atmospheric Flight, 1972, chapters 6 and 7.
.. [LR743] Report LR-743, 1993, section 2.2.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence

import numpy as np
import xarray as xr
from scipy.optimize import root_scalar

from flightmech.names import quantity_attributes
from flightmech.steady_flight.flight_condition import Characteristic, absent_rows
from flightmech.steady_flight.trim_point import Point
from flightmech.units import G0

COEFFICIENT = {"delta_e": "Ch_e", "delta_a": "Ch_a", "delta_r": "Ch_r"}


def missing_for_force(point: Point, control: str) -> str:
    """Return in words what a force on column, wheel or pedals lacks, "" when nothing."""
    coefficient = COEFFICIENT[control]
    if coefficient not in point.compiled.hinges:
        return f"the database has no hinge moments {coefficient}"
    if control not in point.aircraft.controls:
        return f"the aircraft file has no [control.{control}] with S_hinge, c_hinge and gearing"
    return (
        f"the aircraft file gives no gearing in [control.{control}]"
        if point.aircraft.controls[control].gearing is None
        else ""
    )


def force_factor(point: Point, control: str) -> float:
    """Return the pilot force of a hinge-moment coefficient of one; `missing_for_force` has returned "". [N,
    or N m of the wheel]
    """
    geometry = point.aircraft.controls[control]
    return -float(geometry.gearing or 0.0) * point["qbar"] * geometry.S_hinge * geometry.c_hinge


def column_force_slope(point: Point, changes: Mapping[str, float]) -> tuple[float, str]:
    """Return the column force that small changes of model variables take at constant speed, or why
    there is none. [N]
    """
    reason = missing_for_force(point, "delta_e")
    if reason:
        return 0.0, reason
    change = sum(point.hinge_slope("Ch_e", name) * size for name, size in changes.items())
    return force_factor(point, "delta_e") * change, ""


GROUP = "longitudinal stability"
NO_ELEVATOR = (
    "the elevator has no effect on the pitching moment: the database has no such term here"
)
NO_HINGE = "the database has no hinge moments Ch_e over the elevator deflection"
_SMALL = 1e-9  # derivative that counts as zero


def longitudinal_rows(point: Point) -> list[Characteristic]:
    """Return c.g., neutral and manoeuvre points, margins, elevator and stick force per g as rows."""
    craft = point.aircraft
    here = craft.x_ref_mac - point.cg[0] / craft.cbar
    rows = [
        Characteristic(
            GROUP,
            "x_cg",
            here,
            "1",
            "centre of gravity, chords behind the leading edge of the mean chord",
        )
    ]
    fixed = _chords(point, lambda x: point.body_slopes("alpha", x)[4])
    rows += [
        Characteristic(
            GROUP,
            "neutral_point_fixed",
            fixed,
            "1",
            "elevator held, constant speed: Cm_alpha about it is zero",
        ),
        Characteristic(
            GROUP,
            "static_margin_fixed",
            fixed - here,
            "1",
            "neutral point minus c.g.: positive is stable",
        ),
    ]
    elevator = abs(point.body_slopes("delta_e")[4]) > _SMALL
    free = elevator and abs(hinge_moment_slope(point, "delta_e")) > _SMALL
    return [
        *rows,
        *_manoeuvre_fixed(point, here, elevator),
        *_free(point, here, elevator, free),
        *_stick_force(point, elevator),
    ]


def _manoeuvre_fixed(point: Point, here: float, elevator: bool) -> list[Characteristic]:
    fixed = _chords(point, lambda x: pull_up(point, x, "held")[2])
    rows = [
        Characteristic(
            GROUP,
            "manoeuvre_point_fixed",
            fixed,
            "1",
            "no elevator per g in a pull-up at constant speed and thrust",
        ),
        Characteristic(
            GROUP, "manoeuvre_margin_fixed", fixed - here, "1", "manoeuvre point minus c.g."
        ),
    ]
    names = {"elevator_per_g": "rad", "alpha_per_g": "rad"}
    if not elevator:
        return [*rows, *absent_rows(GROUP, names, NO_ELEVATOR)]
    alpha, elevator_angle, _ = pull_up(point, point.cg[0], "moved")
    return [
        *rows,
        Characteristic(
            GROUP,
            "elevator_per_g",
            elevator_angle,
            "rad",
            "per unit of load factor, pull-up; negative: trailing edge up pulls g",
        ),
        Characteristic(GROUP, "alpha_per_g", alpha, "rad", "per unit of load factor, pull-up"),
    ]


def _free(point: Point, here: float, elevator: bool, free: bool) -> list[Characteristic]:
    names = {
        "neutral_point_free": "1",
        "static_margin_free": "1",
        "manoeuvre_point_free": "1",
        "manoeuvre_margin_free": "1",
    }
    if not elevator or not free:
        return absent_rows(GROUP, names, NO_HINGE if elevator else NO_ELEVATOR)
    float_ = -hinge_moment_slope(point, "alpha") / hinge_moment_slope(point, "delta_e")
    neutral = _chords(
        point,
        lambda x: point.body_slopes("alpha", x)[4] + float_ * point.body_slopes("delta_e", x)[4],
    )
    manoeuvre = _chords(point, lambda x: pull_up(point, x, "free")[2])
    return [
        Characteristic(
            GROUP,
            "neutral_point_free",
            neutral,
            "1",
            f"elevator floats by {float_:.3g} rad per rad of alpha",
        ),
        Characteristic(
            GROUP, "static_margin_free", neutral - here, "1", "neutral point minus c.g."
        ),
        Characteristic(
            GROUP,
            "manoeuvre_point_free",
            manoeuvre,
            "1",
            "no hinge moment per g, without bobweight and springs",
        ),
        Characteristic(
            GROUP, "manoeuvre_margin_free", manoeuvre - here, "1", "manoeuvre point minus c.g."
        ),
    ]


def _stick_force(point: Point, elevator: bool) -> list[Characteristic]:
    names = {"stick_force_per_g": "N"}
    if not elevator:
        return absent_rows(GROUP, names, NO_ELEVATOR)
    alpha, delta_e, _ = pull_up(point, point.cg[0], "moved")
    qhat = G0 / point["V"] * 0.5 * point.aircraft.cbar / point["V"]
    force, reason = column_force_slope(
        point, {"alpha": alpha, "delta_e": delta_e, "qhat": qhat, "dnz": 1.0}
    )
    if reason:
        return absent_rows(GROUP, names, reason)
    return [
        Characteristic(
            GROUP,
            "stick_force_per_g",
            force,
            "N",
            "pull per unit of load factor, pull-up, without bobweight, springs and friction",
        )
    ]


def hinge_moment_slope(point: Point, variable: str) -> float:
    """Return the slope of Ch_e over a variable, 0 without hinge moments in the database."""
    return point.hinge_slope("Ch_e", variable)


def pull_up(point: Point, x_cg_b: float, elevator: str) -> tuple[float, float, float]:
    """Return what one g of pull-up takes: alpha [rad], elevator [rad], and the residual pitching
    moment [1].

    Parameters
    ----------
    point : Point
        The flight.
    x_cg_b : float
        Centre of gravity forward of the moment reference point. [m]
    elevator : {"moved", "held", "free"}
        Moved so that the moment vanishes, held, or floating without a hinge moment.
    """
    slopes = {name: point.body_slopes(name, x_cg_b) for name in ("alpha", "qhat", "dnz", "delta_e")}
    lift = {name: _lift(point, name, slope) for name, slope in slopes.items()}
    qhat = G0 / point["V"] * 0.5 * point.aircraft.cbar / point["V"]
    wanted = point.CW - lift["qhat"] * qhat - lift["dnz"]
    moment = slopes["qhat"][4] * qhat + slopes["dnz"][4]
    row, right = {
        "moved": ([slopes["alpha"][4], slopes["delta_e"][4]], -moment),
        "held": ([0.0, 1.0], 0.0),
        "free": (
            [hinge_moment_slope(point, "alpha"), hinge_moment_slope(point, "delta_e")],
            -hinge_moment_slope(point, "qhat") * qhat - hinge_moment_slope(point, "dnz"),
        ),
    }[elevator]
    alpha, delta_e = np.linalg.solve([[lift["alpha"], lift["delta_e"]], row], [wanted, right])
    return (
        float(alpha),
        float(delta_e),
        float(moment + slopes["alpha"][4] * alpha + slopes["delta_e"][4] * delta_e),
    )


def _lift(point: Point, variable: str, slope: np.ndarray) -> float:
    """Return the slope of the force normal to the flight path over qbar S."""
    alpha = point["alpha"]
    s, c = np.sin(alpha), np.cos(alpha)
    normal = slope[0] * s - slope[2] * c
    if variable != "alpha":
        return normal
    CX, _, CZ, *_ = point.body_coefficients()
    CX_T, CZ_T = thrust_coefficients(point)
    return normal + (CX + CX_T) * c + (CZ + CZ_T) * s


def thrust_coefficients(point: Point) -> tuple[float, float]:
    """Return the thrust over qbar S along body x and z."""
    force = np.zeros(3)
    for number, engine in enumerate(point.aircraft.engines, 1):
        force += point[f"engine{number}.thrust"] * np.array(engine.direction)
    x, _, z = force / (point["qbar"] * point.aircraft.S)
    return float(x), float(z)


def _chords(point: Point, residual: Callable[[float], float]) -> float:
    """Return the c.g. at which `residual` is zero, chords behind the leading edge; linear unless
    terms depend on the c.g.
    """
    craft = point.aircraft
    found = root_scalar(
        residual,
        x0=point.cg[0],
        x1=point.cg[0] - 0.1 * craft.cbar,
        method="secant",
        xtol=1e-10 * craft.cbar,
        maxiter=50,
    )
    return craft.x_ref_mac - float(found.root) / craft.cbar


TRIM_CURVES = "trim over speed"
_NUDGE = 1e-3  # of the speed, for slopes along trimmed flights


def trim_curves(point: Point, speeds: Sequence[float] | np.ndarray) -> xr.Dataset:
    """Return trimmed straight flights at the path angle and configuration of a point.

    Parameters
    ----------
    point : Point
        The flight.
    speeds : array (V,)
        True airspeeds, rising. [m s-1]

    Returns
    -------
    Dataset (V,)
        ``alpha theta delta_e`` [rad], ``thrust`` of all engines [N], ``throttle`` [1] when thrust
        comes from tables, ``CL``, ``CD``, ``F_column`` as the tab stands and ``F_column_trimmed``
        with the force trimmed out at the speed of the point [N], both absent without hinge moments;
        NaN where no steady flight is found.
    """
    flights = [point.retrim(init__V=float(V)) for V in speeds]
    columns: dict[str, list[float]] = {
        name: [flight[name] for flight in flights] for name in ("alpha", "theta", "CL", "CD")
    }
    columns["delta_e"] = [flight["applied.delta_e"] for flight in flights]
    columns["thrust"] = [flight.thrust for flight in flights]
    if _throttled(point):
        columns["throttle"] = [flight.variables["engine1.throttle"] for flight in flights]
    if not missing_for_force(point, "delta_e"):
        columns["F_column"] = [_force(flight, 0.0) for flight in flights]
        columns["F_column_trimmed"] = [_force(flight, _hinge(point)) for flight in flights]
    steady = np.array([flight.is_trimmed for flight in flights])
    named = {"F_column_trimmed": "F_column"}
    data = {
        name: ("V", np.where(steady, values, np.nan), quantity_attributes(named.get(name, name)))
        for name, values in columns.items()
    }
    return xr.Dataset(
        data,
        {"V": ("V", np.asarray(speeds, float), quantity_attributes("V"))},
        attrs={"title": point.aircraft.name},
    )


def speed_stability(point: Point) -> list[Characteristic]:
    """Return the slopes of elevator and column force over speed, and the neutral point that the
    trim curve shows, as rows.
    """
    slope = _elevator_slope(point)
    if abs(point.body_slopes("delta_e")[4]) < 1e-9:
        rows = absent_rows(
            TRIM_CURVES, {"delta_e_per_V": "rad s m-1", "neutral_point_trim": "1"}, NO_ELEVATOR
        )
    else:
        rows = [
            Characteristic(
                TRIM_CURVES,
                "delta_e_per_V",
                slope,
                "rad s m-1",
                "along trimmed flights; positive (trailing edge down to fly faster) is stable",
            )
        ]
        rows += _neutral_point(point)
    forces = {"F_column": "N", "F_column_per_V": "N s m-1"}
    reason = missing_for_force(point, "delta_e")
    if reason:
        return [*rows, *absent_rows(TRIM_CURVES, forces, reason)]
    low, high = (_force(flight, _hinge(point)) for flight in _neighbours(point))
    return [
        *rows,
        Characteristic(TRIM_CURVES, "F_column", _force(point, 0.0), "N", "pull, as the tab stands"),
        Characteristic(
            TRIM_CURVES,
            "F_column_per_V",
            (high - low) / (2.0 * _NUDGE * point["V"]),
            "N s m-1",
            "trimmed out at this speed; push to fly faster is negative",
        ),
    ]


def _neutral_point(point: Point) -> list[Characteristic]:
    craft = point.aircraft

    def residual(x: float) -> float:
        return _elevator_slope(point.retrim(mass__x_cg_b=x))

    found = root_scalar(
        residual,
        x0=point.cg[0],
        x1=point.cg[0] - 0.05 * craft.cbar,
        method="secant",
        xtol=1e-6 * craft.cbar,
        maxiter=30,
    )
    if not (found.converged and point.retrim(mass__x_cg_b=float(found.root)).is_trimmed):
        return absent_rows(
            TRIM_CURVES,
            {"neutral_point_trim": "1"},
            "no c.g. within trim makes the elevator independent of speed",
        )
    text = (
        "c.g. for which trimmed flights need no elevator over speed: with thrust, Mach number "
        "and drag"
    )
    return [
        Characteristic(
            TRIM_CURVES,
            "neutral_point_trim",
            craft.x_ref_mac - float(found.root) / craft.cbar,
            "1",
            text,
        )
    ]


def _elevator_slope(point: Point) -> float:
    low, high = _neighbours(point)
    return (high["applied.delta_e"] - low["applied.delta_e"]) / (2.0 * _NUDGE * point["V"])


def _neighbours(point: Point) -> tuple[Point, Point]:
    V = point["V"]
    return point.retrim(init__V=(1.0 - _NUDGE) * V), point.retrim(init__V=(1.0 + _NUDGE) * V)


def _hinge(point: Point) -> float:
    return point.hinge_moment("Ch_e") or 0.0


def _force(flight: Point, trimmed_out: float) -> float:
    return force_factor(flight, "delta_e") * (_hinge(flight) - trimmed_out)


def _throttled(point: Point) -> bool:
    return bool(point.aircraft.engines) and point.parameter("mode.engine") == 0.0
