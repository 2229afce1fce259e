"""Stall and trimmed drag polar, power off, and the 1 g line of level flight.

References
----------
.. [Ruijgrok] Ruijgrok, Elements of Airplane Performance, 1996, chapters 8 to 13.
.. [LR743] Report LR-743, 1993, section 2.2.
"""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np
import xarray as xr

from flightmech.air import Air, atmosphere
from flightmech.errors import SimulationError
from flightmech.names import quantity_attributes
from flightmech.steady_flight.engine_thrust import power_off
from flightmech.steady_flight.flight_condition import Characteristic, absent_rows
from flightmech.steady_flight.trim_point import Point
from flightmech.units import DEGREE

STALL, POLAR = "stall", "drag polar"
_POLAR_POINTS = 121
# Steps to the elevator without a pitching moment, and the moment coefficient that counts as zero.
_MOST_STEPS, _BALANCED = 60, 1e-14
_STALL_PASSES = 20  # of the Mach number of the stall
_MACH_TOLERANCE = 1e-6
_DEFAULT_ALPHA = 15.0 * DEGREE  # range of alpha if the lift tables do not depend on it, each side
_LOWEST_ALPHA = -5.0 * DEGREE  # of the polar
_DEFAULT_ELEVATOR = (-45.0 * DEGREE, 45.0 * DEGREE)  # travel if the aircraft file has no limits
# Lift coefficients of the fit of the parabola, of the largest one.
_FIT_RANGE = (0.1, 0.7)


class Stall(NamedTuple):
    """Largest trimmed lift coefficient, power off, and the speed that belongs to it."""

    CL: float
    alpha: float
    V: float
    why: str


def ambient_air(point: Point, h: float | None = None) -> Air:
    """Return the air of a flight, or the air at another height [m] on the same day."""
    if h is None:
        h = point["h"]
    return atmosphere(h, point.parameter("env.delta_T"), point.parameter("env.qnh"))


def polar(point: Point, mach: float | None = None) -> xr.Dataset:
    """Return the trimmed drag polar, power off, over the angles of attack of the lift tables.

    Parameters
    ----------
    point : Point
        The flight. The polar has its configuration, c.g. and height.
    mach : float, optional
        Mach number. Default: that of the flight.

    Returns
    -------
    Dataset (alpha,)
        ``CL``, ``CD``, ``delta_e`` [rad] without a pitching moment about the c.g., ``L_D``. The
        rows end at the limits of the elevator.

    Raises
    ------
    SimulationError
        The elevator does not balance the pitching moment at any angle of attack.
    """
    if mach is None:
        mach = point["mach"]
    steady = {**power_off(point), "mach": mach, "dnz": 0.0, "qhat": 0.0}
    lowest, highest = alpha_range(point)
    alpha = np.linspace(max(lowest, _LOWEST_ALPHA), highest, _POLAR_POINTS)
    delta_e = _balance_elevator(point, alpha, steady)
    balanced = np.isfinite(delta_e)
    alpha, delta_e = alpha[balanced], delta_e[balanced]
    if not alpha.size:
        raise SimulationError(
            "the elevator balances the pitching moment at no angle of attack; check the c.g. "
            "and the limits of delta_e"
        )
    # about the moment reference point, but forces do not depend on it
    CL, CD = point.coefficients(**steady, alpha=alpha, delta_e=delta_e)[:2]
    data: dict[str, Any] = {}
    for name, values in (("CL", CL), ("CD", CD), ("delta_e", delta_e)):
        data[name] = ("alpha", values, quantity_attributes(name))
    data["L_D"] = ("alpha", CL / CD, {"units": "1"})
    coords = {"alpha": ("alpha", alpha, quantity_attributes("alpha"))}
    return xr.Dataset(data, coords, attrs={"mach": steady["mach"]})


def alpha_range(point: Point) -> tuple[float, float]:
    """Return the ends of the lift tables, -15 to 15 degrees if alpha is not an axis. [rad]"""
    return point.compiled.lift_range.get("alpha", (-_DEFAULT_ALPHA, _DEFAULT_ALPHA))


def _balance_elevator(point: Point, alpha: np.ndarray, steady: dict[str, float]) -> np.ndarray:
    """Return the elevator (alpha,) without a pitching moment about the c.g.

    It is NaN beyond its limits, and where the search does not reach a moment below `_BALANCED`.

    If the elevator has no effect, its angle is that of the flight.
    """
    travel = point.aircraft.limits.get("delta_e", _DEFAULT_ELEVATOR)
    low, high = np.full(alpha.shape, travel[0]), np.full(alpha.shape, travel[1])

    def moment(delta_e: np.ndarray) -> np.ndarray:
        return point.body_coefficients(**steady, alpha=alpha, delta_e=delta_e)[4]

    moment_low, moment_high = moment(low), moment(high)
    if (moment_low == moment_high).all():
        return np.full(alpha.shape, point.variables["delta_e"])
    inside = np.sign(moment_low) * np.sign(moment_high) <= 0.0
    # False position for all angles of attack at once. `high` is the last step. An end that stays
    # counts with half its moment (Illinois), so that both ends approach the root.
    for _ in range(_MOST_STEPS):
        difference = moment_high - moment_low
        has_slope = moment_high != moment_low
        secant = high - moment_high * (high - low) / np.where(has_slope, difference, 1.0)
        trial = np.where(inside & has_slope, secant, high)
        moment_trial = moment(trial)
        stays = np.sign(moment_trial) == np.sign(moment_high)
        low = np.where(stays, low, high)
        moment_low = np.where(stays, 0.5 * moment_low, moment_high)
        high, moment_high = trial, moment_trial
        if np.abs(moment_high[inside]).max(initial=0.0) < _BALANCED:
            break
    balanced = inside & (np.abs(moment_high) < _BALANCED)
    return np.where(balanced, high, np.nan)


def stall(point: Point) -> Stall:
    """Return the stall, power off, in one-g flight at the height and mass of a point.

    It is the largest trimmed lift coefficient of the tables.
    """
    air = ambient_air(point)
    a_sound = float(air.a_sound)
    mach = point["mach"]
    # the largest lift depends on the Mach number, and the Mach number on the stall speed
    for _ in range(_STALL_PASSES):
        curve = polar(point, mach)
        best = int(np.argmax(curve["CL"].values))
        CL = float(curve["CL"][best])
        V = float(np.sqrt(2.0 * point.weight / (air.rho * point.aircraft.S * CL)))
        change = V / a_sound - mach
        if abs(change) < _MACH_TOLERANCE:
            break
        mach = V / a_sound
    alpha = float(curve["alpha"][best])
    if best < curve.sizes["alpha"] - 1:
        why = "maximum of the lift table"
    elif alpha < alpha_range(point)[1] - 1e-9:
        why = "end of the elevator travel: the table would give more"
    else:
        why = "end of the lift table, no maximum inside: the true one lies higher"
    if abs(change) >= _MACH_TOLERANCE:
        why += f"; not converged, the Mach number of the stall still changes by {change:.2g}"
    return Stall(CL, alpha, V, why)


def stall_rows(slowest: Stall) -> list[Characteristic]:
    """Return the stall as rows."""
    lift_remark = f"trimmed, power off; {slowest.why}"
    speed_remark = "true airspeed, one g, power off"
    return [
        Characteristic(STALL, "CL_max", slowest.CL, units="1", remark=lift_remark),
        Characteristic(STALL, "alpha_stall", slowest.alpha, units="rad", remark=slowest.why),
        Characteristic(STALL, "V_stall", slowest.V, units="m s-1", remark=speed_remark),
    ]


def polar_rows(point: Point, curve: xr.Dataset) -> list[Characteristic]:
    """Return the parabola through the polar and the best glide as rows."""
    return [*_parabola_rows(point, curve), *_best_glide_rows(point, curve)]


def _parabola_rows(point: Point, curve: xr.Dataset) -> list[Characteristic]:
    """Return CD0, k and the Oswald factor of CD = CD0 + k CL^2 through the middle of a polar."""
    CL, CD = curve["CL"].values, curve["CD"].values
    low, high = _FIT_RANGE[0] * CL.max(), _FIT_RANGE[1] * CL.max()
    # points below the stall with a lift coefficient in the range
    inside = (np.clip(CL, low, high) == CL) & (np.arange(CL.size) <= np.argmax(CL))
    if inside.sum() < 3:
        names = {"CD0": "1", "k": "1", "oswald": "1"}
        return absent_rows(POLAR, names, "the polar has fewer than three points in its middle")
    X = np.column_stack([np.ones(inside.sum()), CL[inside] ** 2])
    (CD0, k), *_ = np.linalg.lstsq(X, CD[inside])
    rms = float(np.sqrt(np.mean((X @ [CD0, k] - CD[inside]) ** 2)))
    oswald = point.aircraft.S / (np.pi * point.aircraft.b**2 * k)
    condition = _describe_polar(curve)
    fit = f"CD = CD0 + k CL^2 over CL {low:.2f} ... {high:.2f}, rms {rms:.2g}; {condition}"
    return [
        Characteristic(POLAR, "CD0", float(CD0), units="1", remark=fit),
        Characteristic(POLAR, "k", float(k), units="1", remark=condition),
        Characteristic(POLAR, "oswald", float(oswald), units="1", remark="1/(pi A k)"),
    ]


def _best_glide_rows(point: Point, curve: xr.Dataset) -> list[Characteristic]:
    """Return ratio, speed and path angle of the glide with the largest lift over drag."""
    best = int(np.argmax(curve["L_D"].values))
    CL, CD = curve["CL"].values[best], curve["CD"].values[best]
    # in a glide the resultant of lift and drag is equal to the weight
    pressure_area = point["rho"] * point.aircraft.S * np.hypot(CL, CD)
    V = float(np.sqrt(2.0 * point.weight / pressure_area))
    gamma = -float(np.arctan(1.0 / curve["L_D"][best]))
    ratio_remark = f"{_describe_polar(curve)}; at CL {CL:.3f}"
    speed_remark = "true airspeed, power off"
    return [
        Characteristic(POLAR, "L_D_max", float(curve["L_D"][best]), units="1", remark=ratio_remark),
        Characteristic(POLAR, "V_best_glide", V, units="m s-1", remark=speed_remark),
        Characteristic(POLAR, "gamma_best_glide", gamma, units="rad", remark="power off"),
    ]


def _describe_polar(curve: xr.Dataset) -> str:
    return f"trimmed, power off, Mach {curve.attrs['mach']:.3g}"


def one_g(point: Point, mach: np.ndarray) -> xr.Dataset:
    """Return level flight over Mach numbers: the 1 g line of a mass, height and configuration.

    Parameters
    ----------
    point : Point
        The flight. The line has its mass, c.g., configuration and height.
    mach : array (mach,)
        Rising.

    Returns
    -------
    Dataset (mach,)
        ``alpha``, ``delta_e`` [rad], ``V``, ``V_cas`` [m s-1] with the thrust of level flight. NaN
        where level flight is not steady, as below the stall.

    References
    ----------
    .. [LR743] Fig. 9.
    """
    a_sound = float(ambient_air(point).a_sound)
    flights = [point.trim_level(float(number) * a_sound) for number in mach]
    steady = np.array([flight.is_trimmed for flight in flights])
    outputs = {"alpha": "alpha", "delta_e": "applied.delta_e", "V": "V", "V_cas": "V_cas"}
    data = {}
    for name, output in outputs.items():
        values = np.array([flight[output] for flight in flights])
        data[name] = ("mach", np.where(steady, values, np.nan), quantity_attributes(name))
    coords = {"mach": ("mach", np.asarray(mach, float), quantity_attributes("mach"))}
    return xr.Dataset(data, coords)
