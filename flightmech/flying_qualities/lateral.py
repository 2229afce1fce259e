"""Lateral-directional control: steady sideslips, roll rate and minimum control speed.

References
----------
.. [Etkin] Etkin, Dynamics of Atmospheric Flight, 1972, sections 7.6 and 10.7.
.. [CS25] CS-25.149 (b): one engine inoperative, no more than 5 degrees of bank.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
import scipy
import xarray as xr

from flightmech.flying_qualities.control_forces import (
    COEFFICIENT,
    force_factor,
    missing_for_force,
)
from flightmech.simulation.run import simulate
from flightmech.steady_flight.engine_thrust import (
    NO_THRUST,
    full_thrust,
    has_thrust,
    thrust_variables,
)
from flightmech.steady_flight.flight_condition import Characteristic, absent_rows
from flightmech.steady_flight.trim_point import Point
from flightmech.steady_flight.trim_search import find_trim
from flightmech.support.arrays import integrate_trapezoids
from flightmech.units import DEGREE

SIDESLIP, ROLL = "steady sideslip", "roll control"
NO_RUDDER = "the rudder has no effect on the yawing moment: the database has no such term here"
NO_AILERON = "the ailerons have no effect on the rolling moment: the database has no such term here"
_SMALL = 1e-9  # derivative or residual that counts as zero
# Side force, rolling and yawing moment among the six coefficients.
_CY, _CL, _CN = 1, 3, 5
_LATERAL = [_CY, _CL, _CN]
_BANK = 5.0 * DEGREE  # at the minimum control speed [CS25]
_AILERON_TIME = 5.0  # of the roll with full ailerons [s]
_AILERON_RAMP = 0.1  # from the trimmed to full ailerons [s]
_SAMPLE_TIME = 0.02  # of the roll [s]
# Search of the minimum control speed: last speed in stall speeds, speeds, relative tolerance.
_FASTEST, _SPEED_COUNT, _SPEED_TOLERANCE = 3.0, 25, 1e-4
# Least distance of an engine from the centre line that matters, in spans.
_LEAST_ARM = 0.01
# Relative difference of the arms of engines that are equally far from the centre line.
_SAME_ARM = 0.01
# Lateral controls whose stop ends the flight with a failed propeller.
_LATERAL_CONTROLS = {"delta_a", "delta_r", "wheel", "pedal"}


def sideslip_rows(point: Point) -> list[Characteristic]:
    """Return aileron, rudder, bank and pilot forces per sideslip of a straight flight, as rows."""
    names = {
        "delta_a_per_beta": "1",
        "delta_r_per_beta": "1",
        "phi_per_beta": "1",
        "F_wheel_per_beta": "N m rad-1",
        "F_pedal_per_beta": "N rad-1",
    }
    slopes = {name: point.body_slopes(name) for name in ("beta", "delta_a", "delta_r")}
    if abs(slopes["delta_r"][_CN]) < _SMALL:
        return absent_rows(SIDESLIP, names, NO_RUDDER)
    if abs(slopes["delta_a"][_CL]) < _SMALL:
        return absent_rows(SIDESLIP, names, NO_AILERON)
    # Side force and both moments vanish in a straight flight. Gravity along body y grows with bank.
    gravity = np.array([point.CW * np.cos(point["theta"]), 0.0, 0.0])
    matrix = np.column_stack([slopes["delta_a"][_LATERAL], slopes["delta_r"][_LATERAL], gravity])
    delta_a, delta_r, phi = np.linalg.solve(matrix, -slopes["beta"][_LATERAL])
    return [
        Characteristic(SIDESLIP, "delta_a_per_beta", delta_a, units="1", remark="straight flight"),
        Characteristic(
            SIDESLIP,
            "delta_r_per_beta",
            delta_r,
            units="1",
            remark="straight flight; positive (trailing edge left for wind from the right) is "
            "stable",
        ),
        Characteristic(
            SIDESLIP,
            "phi_per_beta",
            phi,
            units="1",
            remark="straight flight; positive (right wing down for wind from the right) is stable",
        ),
        *_force_per_sideslip(point, "delta_a", delta_a, {"F_wheel_per_beta": "N m rad-1"}),
        *_force_per_sideslip(point, "delta_r", delta_r, {"F_pedal_per_beta": "N rad-1"}),
    ]


def _force_per_sideslip(
    point: Point, control: str, deflection: float, names: dict[str, str]
) -> list[Characteristic]:
    """Return the pilot force per sideslip of one control as a row.

    `deflection` is that per sideslip, `names` the name of the row with its unit.
    """
    reason = missing_for_force(point, control)
    if reason:
        return absent_rows(SIDESLIP, names, reason)
    coefficient = COEFFICIENT[control]
    by_sideslip = point.hinge_slope(coefficient, "beta")
    by_control = point.hinge_slope(coefficient, control) * deflection
    force = force_factor(point, control) * (by_sideslip + by_control)
    ((name, units),) = names.items()
    remark = "straight flight, without springs and friction"
    return [Characteristic(SIDESLIP, name, force, units=units, remark=remark)]


def roll_rate(point: Point) -> list[Characteristic]:
    """Return the roll rate of full ailerons and the wheel force as rows.

    One roll rate is that of the rolling moment alone, the other that of the aircraft with six
    degrees of freedom.
    """
    names = {"roll_rate_one_degree": "rad s-1", "roll_rate_peak": "rad s-1", "F_wheel_full": "N m"}
    damping = point.body_slopes("phat")[_CL]
    if abs(point.body_slopes("delta_a")[_CL]) < _SMALL:
        return absent_rows(ROLL, names, NO_AILERON)
    if "delta_a" not in point.aircraft.limits:
        return absent_rows(ROLL, names, "the aircraft file gives no limits of delta_a")
    if abs(damping) < _SMALL:
        return absent_rows(ROLL, names, "the database has no roll damping here")
    # the lower limit is negative: right wing down
    full = point.aircraft.limits["delta_a"][0]
    rolling = point.body_coefficients(delta_a=full)[_CL] - point.body_coefficients()[_CL]
    # Cl_phat phat + Cl = 0 with phat = p b / 2V
    p = -rolling / damping * 2.0 * point["V"] / point.aircraft.b
    angle = f"delta_a {full / DEGREE:.3g} deg"
    rows = [
        Characteristic(
            ROLL,
            "roll_rate_one_degree",
            p,
            units="rad s-1",
            remark=f"{angle}: rolling moment over roll damping, one degree of freedom",
        ),
        Characteristic(
            ROLL,
            "roll_rate_peak",
            _simulate_roll(point, full),
            units="rad s-1",
            remark=f"{angle}: highest within {_AILERON_TIME:g} s or one turn, six degrees of "
            f"freedom",
        ),
    ]
    reason = missing_for_force(point, "delta_a")
    if reason:
        return [*rows, *absent_rows(ROLL, {"F_wheel_full": "N m"}, reason)]
    full_moment = point.hinge_moment("Ch_a", delta_a=full) or 0.0
    change = full_moment - (point.hinge_moment("Ch_a") or 0.0)
    force = force_factor(point, "delta_a") * change
    remark = f"{angle}, before the roll, without springs and friction"
    return [*rows, Characteristic(ROLL, "F_wheel_full", force, units="N m", remark=remark)]


def _simulate_roll(point: Point, full: float) -> float:
    """Return the highest roll rate after a ramp of the ailerons from the trim. [rad s-1]"""
    time = np.round(np.arange(0.0, _AILERON_TIME + 0.01, _SAMPLE_TIME), 6)
    # trim and bias are added to the input, so that the ailerons end at `full`
    start = point.parameters.get("delta_a", 0.0)
    end = full - point["trim.delta_a"] - point.parameter("bias.delta_a")
    delta_a = np.interp(time, [0.0, _AILERON_RAMP], [start, end])
    inputs = xr.Dataset({"delta_a": ("time", delta_a)}, {"time": time})
    # mode.trim 2 solves for the throttle, 1 for the thrust
    has_levers = point.aircraft.engines and point.parameter("mode.engine") == 0.0
    trim_mode = 2.0 if has_levers else 1.0
    response = simulate(point.sim, inputs, {"mode.trim": trim_mode, **point.parameters})
    p = response["p"].values
    angles = integrate_trapezoids(time, p)
    return float(p[angles <= 2.0 * np.pi].max())


def minimum_control_speed(point: Point, slowest: float) -> list[Characteristic]:
    """Return the minimum control speed with the critical engine inoperative, as a row.

    It is the lowest speed at which rudder and ailerons balance the asymmetric thrust with 5 degrees
    of bank. With propellers each speed is a straight flight on one engine at full throttle
    (``engine_out`` of `flightmech.trim`): the failed propeller windmills, and torque, P-factor and
    force in the disk of all are balanced too.

    Parameters
    ----------
    point : Point
        The flight. Height and configuration are those of the flight.
    slowest : float
        Lowest trimmed speed, e.g. the stall. [m s-1]
    """
    names = {"minimum_control_speed": "m s-1"}
    arms = [engine.position[1] - point.cg[1] for engine in point.aircraft.engines]
    reason = _missing_for_control_speed(point, arms)
    if reason:
        return absent_rows(ROLL, names, reason)
    farthest = float(np.max(np.abs(arms)))
    failed = int(np.argmax(np.abs(arms)))
    outer = [k for k, arm in enumerate(arms) if abs(arm) > (1.0 - _SAME_ARM) * farthest]
    propellers = point.aircraft.engines[0].propeller is not None
    text = (
        f"engine {failed + 1} gives no thrust, the others full; bank 5 deg towards them; "
        f"without windmilling drag"
    )
    if propellers:
        text = "one engine windmills without power, the others full; bank 5 deg towards them"

    # what prevents the flight at a speed at which rudder and ailerons do not
    untrimmed: dict[float, str] = {}

    def is_controllable(V: float) -> bool:
        obstacles = []
        # torque and P-factor make one of two engines at equal arms the critical one
        for k in outer if propellers else [failed]:
            if propellers:
                share, obstacle = _fly_on_one_engine(point, V, k)
            else:
                share, obstacle = _balance_level_flight(point.trim_level(V), k)
            if share > 1.0:
                return False
            if obstacle:
                obstacles.append(obstacle)
        if obstacles:
            untrimmed[V] = obstacles[0]
        return True

    # the highest speed of a grid at which the controls are not enough, and the next speed
    highest = _FASTEST * slowest
    speeds = []
    for V in np.geomspace(slowest, highest, _SPEED_COUNT).tolist():
        if not is_controllable(V):
            speeds.append(V)
    if not speeds:
        reason = (
            f"below the stall, {slowest:.4g} m/s: the controls are enough at all speeds "
            f"above it ({text})"
        )
        if untrimmed:
            reason = (
                f"the controls are enough at all speeds at which the flight trims ({text})"
                f"{_describe_untrimmed(untrimmed)}"
            )
        return absent_rows(ROLL, names, reason)
    if speeds[-1] >= highest:
        reason = f"above {speeds[-1]:.4g} m/s: the controls are not enough there ({text})"
        return absent_rows(ROLL, names, reason)
    low, high = speeds[-1], speeds[-1] * _FASTEST ** (1.0 / (_SPEED_COUNT - 1.0))
    while high - low > _SPEED_TOLERANCE * low:
        middle = 0.5 * (low + high)
        if is_controllable(middle):
            high = middle
        else:
            low = middle
    if propellers:
        critical = max(outer, key=lambda k: _fly_on_one_engine(point, high, k).share)
        text = text.replace("one engine", f"engine {critical + 1}")
    text += _describe_untrimmed({V: obstacle for V, obstacle in untrimmed.items() if low < V})
    return [Characteristic(ROLL, "minimum_control_speed", high, units="m s-1", remark=text)]


class _EngineOut(NamedTuple):
    """Flight with an engine inoperative.

    Attributes
    ----------
    share : float
        Larger share of aileron and rudder travel, infinite if they do not balance the moments. [1]
    obstacle : str
        What else prevents the flight, "" if it trims. The share is then where the search ended.
    """

    share: float
    obstacle: str


def _describe_untrimmed(untrimmed: dict[float, str]) -> str:
    """Return in words up to which speed the flight does not trim, or ""."""
    if not untrimmed:
        return ""
    V = max(untrimmed)
    return f"; not trimmed up to {V:.4g} m/s: {untrimmed[V]}"


def _missing_for_control_speed(point: Point, arms: list[float]) -> str:
    """Return in words what is missing for a minimum control speed, or "".

    `arms` are the distances of the engines from the c.g. along body y. [m]
    """
    if len(arms) < 2 or max(map(abs, arms)) < _LEAST_ARM * point.aircraft.b:
        return "no engines off the centre line"
    if not has_thrust(point.aircraft):
        return NO_THRUST
    if abs(point.body_slopes("delta_r")[_CN]) < _SMALL:
        return NO_RUDDER
    if abs(point.body_slopes("delta_a")[_CL]) < _SMALL:
        return NO_AILERON
    if not {"delta_a", "delta_r"} <= set(point.aircraft.limits):
        return "the aircraft file gives no limits of delta_a and delta_r"
    return ""


def _fly_on_one_engine(point: Point, V: float, failed: int) -> _EngineOut:
    """Return the flight with a failed propeller.

    A flight that does not trim with aileron or rudder at the stop has an infinite share.
    """
    craft = point.aircraft
    side = -1.0 if craft.engines[failed].position[1] > point.cg[1] else 1.0
    _, highest_lever = craft.limits.get("throttle", (0.0, 1.0))
    lever = highest_lever - point.parameter("bias.throttle")
    fixed = {f"engine{failed + 1}.failed": 1.0, "phi": side * _BANK}
    for k in range(len(craft.engines)):
        if k != failed:
            fixed[f"engine{k + 1}.throttle"] = lever
    # the climb angle follows from the power
    start = {**point.parameters, "init.V": V, "mode.engine": 0.0}
    for name in ("init.gamma", "init.phi"):
        start.pop(name, None)
    flown = find_trim(point.sim, start, "engine_out", fixed=fixed)
    stopped = set(flown.attrs["at_limit"].split())
    obstacle = ""
    if not flown.attrs["converged"]:
        if _LATERAL_CONTROLS & stopped:
            return _EngineOut(float("inf"), "")
        obstacle = "no unknown is at its limit"
        if stopped:
            obstacle = f"{', '.join(sorted(stopped))} at the limit"
    shares = []
    for name in ("delta_a", "delta_r"):
        shares.append(_travel_share(float(flown[f"applied.{name}"]), craft.limits[name]))
    return _EngineOut(max(shares), obstacle)


def _balance_level_flight(flight: Point, failed: int) -> _EngineOut:
    """Return the flight whose aileron and rudder balance a jet without thrust."""
    craft = flight.aircraft
    # the bank is towards the running engines
    side = -1.0 if craft.engines[failed].position[1] > flight.cg[1] else 1.0
    thrusts = full_thrust(flight)
    thrusts[failed] = 0.0
    moment = np.zeros(3)
    for engine, thrust in zip(craft.engines, thrusts, strict=True):
        arm = np.array(engine.position) - flight.cg
        moment += np.cross(arm, thrust * np.array(engine.direction))
    power = thrust_variables(flight, thrusts)
    # side force of gravity and moments of the thrust over qbar S and qbar S b
    qS = flight["qbar"] * craft.S
    gravity = flight.CW * np.cos(flight["theta"]) * np.sin(side * _BANK)
    disturbance = np.array([gravity, moment[0] / (qS * craft.b), moment[2] / (qS * craft.b)])

    def residual(z: np.ndarray) -> np.ndarray:
        beta, delta_a, delta_r = z
        controls = {"beta": beta, "delta_a": delta_a, "delta_r": delta_r}
        return flight.body_coefficients(**power, **controls)[_LATERAL] + disturbance

    search = scipy.optimize.least_squares(residual, np.zeros(3), xtol=1e-12, ftol=1e-12, gtol=1e-12)
    if np.abs(search.fun).max() > _SMALL:
        return _EngineOut(float("inf"), "")
    _, delta_a, delta_r = search.x
    aileron = _travel_share(delta_a, craft.limits["delta_a"])
    share = max(aileron, _travel_share(delta_r, craft.limits["delta_r"]))
    return _EngineOut(share, "" if flight.is_trimmed else "level flight without failure")


def _travel_share(angle: float, limits: tuple[float, float]) -> float:
    """Return a deflection over the limit on its side."""
    limit = limits[1] if angle > 0.0 else limits[0]
    return float(angle / limit)
