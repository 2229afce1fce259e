"""Lateral-directional control: steady sideslips, the highest roll rate of full ailerons, the
minimum control speed.

References
----------
.. [Etkin] Etkin, Dynamics of Atmospheric Flight, 1972, sections 7.6 and 10.7.
.. [CS25] CS-25.149 (b): one engine inoperative, no more than 5 degrees of bank.
"""

from __future__ import annotations

import numpy as np
import xarray as xr
from scipy.optimize import least_squares

from flightmech.flying_qualities.longitudinal import COEFFICIENT, force_factor, missing_for_force
from flightmech.simulation.run import simulate
from flightmech.steady_flight.engine_thrust import NO_THRUST, full_thrust, has_thrust
from flightmech.steady_flight.flight_condition import Characteristic, absent_rows
from flightmech.steady_flight.trim_point import Point
from flightmech.units import DEGREE

SIDESLIP, ROLL = "steady sideslip", "roll control"
NO_RUDDER = "the rudder has no effect on the yawing moment: the database has no such term here"
NO_AILERON = "the ailerons have no effect on the rolling moment: the database has no such term here"
_SMALL = 1e-9
_BANK = 5.0 * DEGREE  # [CS25]
_FASTEST = 3.0  # of the stall: where the minimum control speed is looked for
_HELD = 5.0  # s of full aileron
_RAMP = 0.1  # s to full aileron


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
    if abs(slopes["delta_r"][5]) < _SMALL:
        return absent_rows(SIDESLIP, names, NO_RUDDER)
    if abs(slopes["delta_a"][3]) < _SMALL:
        return absent_rows(SIDESLIP, names, NO_AILERON)
    gravity = np.array([point.CW * np.cos(point["theta"]), 0.0, 0.0])  # along body y per bank
    side = [1, 3, 5]
    unknown = np.column_stack([slopes["delta_a"][side], slopes["delta_r"][side], gravity])
    delta_a, delta_r, phi = np.linalg.solve(unknown, -slopes["beta"][side])
    rows = [
        Characteristic(SIDESLIP, "delta_a_per_beta", delta_a, "1", "straight flight"),
        Characteristic(
            SIDESLIP,
            "delta_r_per_beta",
            delta_r,
            "1",
            "straight flight; positive (trailing edge left for wind from the right) is stable",
        ),
        Characteristic(
            SIDESLIP,
            "phi_per_beta",
            phi,
            "1",
            "straight flight; positive (right wing down for wind from the right) is stable",
        ),
    ]
    for control, quantity, size, units in (
        ("delta_a", "F_wheel_per_beta", delta_a, "N m rad-1"),
        ("delta_r", "F_pedal_per_beta", delta_r, "N rad-1"),
    ):
        reason = missing_for_force(point, control)
        if reason:
            rows += absent_rows(SIDESLIP, {quantity: units}, reason)
            continue
        coefficient = COEFFICIENT[control]
        hinge = (
            point.hinge_slope(coefficient, "beta") + point.hinge_slope(coefficient, control) * size
        )
        rows.append(
            Characteristic(
                SIDESLIP,
                quantity,
                force_factor(point, control) * hinge,
                units,
                "straight flight, without springs and friction",
            )
        )
    return rows


def roll_rate(point: Point) -> list[Characteristic]:
    """Return roll rate of full ailerons, by the rolling moment alone and of the whole aircraft, and
    the wheel force, as rows.
    """
    names = {"roll_rate_one_degree": "rad s-1", "roll_rate_peak": "rad s-1", "F_wheel_full": "N m"}
    if abs(point.body_slopes("delta_a")[3]) < _SMALL:
        return absent_rows(ROLL, names, NO_AILERON)
    if "delta_a" not in point.aircraft.limits:
        return absent_rows(ROLL, names, "the aircraft file gives no limits of delta_a")
    if abs(point.body_slopes("phat")[3]) < _SMALL:
        return absent_rows(ROLL, names, "the database has no roll damping here")
    full = point.aircraft.limits["delta_a"][0]  # negative: right wing down
    damping = point.body_slopes("phat")[3]
    rolling = point.body_coefficients(delta_a=full)[3] - point.body_coefficients()[3]
    p = -rolling / damping * 2.0 * point["V"] / point.aircraft.b
    angle = f"delta_a {full / DEGREE:.3g} deg"
    rows = [
        Characteristic(
            ROLL,
            "roll_rate_one_degree",
            p,
            "rad s-1",
            f"{angle}: rolling moment over roll damping, one degree of freedom",
        ),
        Characteristic(
            ROLL,
            "roll_rate_peak",
            _flown(point, full),
            "rad s-1",
            f"{angle}: highest within {_HELD:g} s or one turn, six degrees of freedom",
        ),
    ]
    reason = missing_for_force(point, "delta_a")
    if reason:
        return [*rows, *absent_rows(ROLL, {"F_wheel_full": "N m"}, reason)]
    hinge = (point.hinge_moment("Ch_a", delta_a=full) or 0.0) - (point.hinge_moment("Ch_a") or 0.0)
    return [
        *rows,
        Characteristic(
            ROLL,
            "F_wheel_full",
            force_factor(point, "delta_a") * hinge,
            "N m",
            f"{angle}, before the roll, without springs and friction",
        ),
    ]


def _flown(point: Point, full: float) -> float:
    """Return the highest roll rate after a ramp of the ailerons in a simulation from the trimmed
    flight. [rad s-1]
    """
    time = np.round(np.arange(0.0, _HELD + 0.01, 0.02), 6)
    start = point.parameters.get("delta_a", 0.0)
    delta_a = np.interp(
        time, [0.0, _RAMP], [start, full - point["trim.delta_a"] - point.parameter("bias.delta_a")]
    )
    inputs = xr.Dataset({"delta_a": ("time", delta_a)}, {"time": time})
    mode = 2.0 if point.aircraft.engines and point.parameter("mode.engine") == 0.0 else 1.0
    flown = simulate(point.sim, inputs, {"mode.trim": mode, **point.parameters})
    p = flown["p"].values
    turned = np.concatenate([[0.0], np.cumsum(0.5 * (p[1:] + p[:-1]) * np.diff(time))])
    return float(p[turned <= 2.0 * np.pi].max())


def minimum_control_speed(point: Point, slowest: float) -> list[Characteristic]:
    """Return the lowest speed at which rudder and ailerons hold the loss of the critical engine at
    5 degrees of bank, as a row.

    Parameters
    ----------
    point : Point
        The flight; height and configuration are taken from it.
    slowest : float
        Lowest trimmed speed, e.g. the stall. [m s-1]
    """
    names = {"minimum_control_speed": "m s-1"}
    arms = [engine.position[1] - point.cg[1] for engine in point.aircraft.engines]
    if len(arms) < 2 or max(map(abs, arms)) < 0.01 * point.aircraft.b:
        return absent_rows(ROLL, names, "no engines off the centre line")
    if not has_thrust(point.aircraft):
        return absent_rows(ROLL, names, NO_THRUST)
    if (
        abs(point.body_slopes("delta_r")[5]) < _SMALL
        or abs(point.body_slopes("delta_a")[3]) < _SMALL
    ):
        return absent_rows(
            ROLL, names, NO_RUDDER if abs(point.body_slopes("delta_r")[5]) < _SMALL else NO_AILERON
        )
    if not {"delta_a", "delta_r"} <= set(point.aircraft.limits):
        return absent_rows(ROLL, names, "the aircraft file gives no limits of delta_a and delta_r")
    failed = int(np.argmax(np.abs(arms)))
    text = (
        f"engine {failed + 1} gives no thrust, the others full; bank 5 deg towards them; "
        f"without windmilling drag"
    )

    def holds(V: float) -> bool:
        return _used(point.trim_level(V), failed) <= 1.0

    speeds = [V for V in np.geomspace(slowest, _FASTEST * slowest, 25).tolist() if not holds(V)]
    if not speeds:
        return absent_rows(
            ROLL,
            names,
            f"below the stall, {slowest:.4g} m/s: the controls are enough at all speeds "
            f"above it ({text})",
        )
    if speeds[-1] >= _FASTEST * slowest:
        return absent_rows(
            ROLL, names, f"above {speeds[-1]:.4g} m/s: the controls are not enough there ({text})"
        )
    low, high = speeds[-1], speeds[-1] * _FASTEST ** (1.0 / 24.0)
    while high - low > 1e-4 * low:
        middle = 0.5 * (low + high)
        low, high = (low, middle) if holds(middle) else (middle, high)
    return [Characteristic(ROLL, "minimum_control_speed", high, "m s-1", text)]


def _used(flight: Point, failed: int) -> float:
    """Return the larger share of aileron and rudder travel that the asymmetric thrust takes;
    infinite when nothing balances it.
    """
    craft = flight.aircraft
    side = (
        -1.0 if craft.engines[failed].position[1] > flight.cg[1] else 1.0
    )  # the live engines are on this side, and so is the bank
    live = full_thrust(flight)
    live[failed] = 0.0
    moment = np.zeros(3)
    for engine, thrust in zip(craft.engines, live, strict=True):
        moment += np.cross(
            np.array(engine.position) - flight.cg, thrust * np.array(engine.direction)
        )
    power = flight.thrust_variables(live)
    qS = flight["qbar"] * craft.S
    given = np.array(
        [
            flight.CW * np.cos(flight["theta"]) * np.sin(side * _BANK),
            moment[0] / (qS * craft.b),
            moment[2] / (qS * craft.b),
        ]
    )

    def residual(z: np.ndarray) -> np.ndarray:
        beta, delta_a, delta_r = z
        return (
            flight.body_coefficients(**power, beta=beta, delta_a=delta_a, delta_r=delta_r)[
                [1, 3, 5]
            ]
            + given
        )

    found = least_squares(residual, np.zeros(3), xtol=1e-12, ftol=1e-12, gtol=1e-12)
    if np.abs(found.fun).max() > _SMALL:
        return float("inf")
    _, delta_a, delta_r = found.x
    return max(_share(delta_a, craft.limits["delta_a"]), _share(delta_r, craft.limits["delta_r"]))


def _share(angle: float, limits: tuple[float, float]) -> float:
    return float(angle / (limits[1] if angle > 0.0 else limits[0]))
