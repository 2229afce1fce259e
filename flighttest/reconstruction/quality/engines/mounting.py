"""Places, inertias and stops that no aircraft has: a wrong unit, axis or origin."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from flightmech.aircraft.aircraft import Aircraft
from flighttest.reconstruction.quality.engines.usual_constants import UnusualSize

# Largest distance of an engine from the reference point, over the span and four chords.
_FARTHEST = 1.0
_CHORDS = 4.0
# Distance of the reference point from a datum at the nose, in mean chords, and that of the end of
# the tail from the reference point over it.
_NOSE, _TAIL = 2.5, 1.25
# Largest distance of the centre of gravity along x, over the mean chord.
_FARTHEST_CG = 1.5
# Least distance of an engine from the plane of symmetry that counts as a side, over the span.
_CENTRE = 0.01
# Least distance of an engine from the plane of symmetry that needs an engine opposite to it, and
# largest difference of the two places, over the span.
_ASIDE, _OPPOSITE = 0.05, 0.02
# Least part of a thrust along x.
_FORWARD = 0.7
# Least distance of a propeller behind the reference point that is behind the wing, in mean chords.
_BEHIND_WING = 0.5
_RIGHT_ANGLE = 0.5 * np.pi
# Largest flow of a transfer pump: those of large aircraft move some kg/s. [kg s-1]
_LARGEST_PUMP = 20.0


def unusual_mounting(aircraft: Aircraft) -> Iterator[UnusualSize]:
    """Yield places and directions that the engines and the centre of gravity cannot have.

    Parameters
    ----------
    aircraft : Aircraft
        Positions count from the moment reference point: x forward, y right, z down. [m]

    Yields
    ------
    UnusualSize
        An engine farther from the reference point than the aircraft is large, one that pushes
        backward, a propeller behind the wing, engines that are all on one side or without one
        opposite to them, and a centre of gravity more than 1.5 mean
        chords before or behind the reference point.
    """
    reach = _FARTHEST * max(aircraft.b, _CHORDS * aircraft.cbar)
    for number, engine in enumerate(aircraft.engines, 1):
        position = np.asarray(engine.position, float)
        if np.abs(position).max() > reach:
            yield UnusualSize(
                "engine_position",
                f"engine {number}: position = {_place(position)} m is outside of an aircraft with "
                f"a span of {aircraft.b:.4g} m",
                "count it from the moment reference point, and check its unit; a number without a "
                "unit is in m",
            )
        elif _is_behind_tail(float(position[0]), aircraft):
            yield UnusualSize(
                "engine_position",
                f"engine {number}: x = {position[0]:.4g} m lies behind the tail, if the drawing "
                f"datum is the nose: the moment reference point is {_datum(aircraft):.4g} m behind "
                f"it",
                "count it from the moment reference point, x forward, not from the drawing datum",
            )
        elif engine.propeller is not None and position[0] < -_BEHIND_WING * aircraft.cbar:
            yield from _pushing_propeller(float(position[0]), number, aircraft)
        if engine.direction[0] < 0.0:
            yield UnusualSize(
                "engine_direction",
                f"engine {number}: direction = {_place(engine.direction)} pushes the aircraft "
                f"backward",
                "give the direction of the thrust, x positive forward, such as [1.0, 0.0, 0.0]",
            )
        elif engine.direction[0] < _FORWARD * np.linalg.norm(engine.direction):
            yield UnusualSize(
                "engine_direction",
                f"engine {number}: direction = {_place(engine.direction)} pushes the aircraft more "
                f"to a side, up or down than forward",
                "check the order x, y, z: x forward, y right, z down, such as [1.0, 0.0, 0.0]; "
                "right for an engine that lifts",
            )
    yield from _unusual_sides(aircraft)
    x = aircraft.cg[0]
    if abs(x) > _FARTHEST_CG * aircraft.cbar:
        yield UnusualSize(
            "cg",
            f"cg: x = {x:.4g} m is {abs(x) / aircraft.cbar:.3g} mean chords from the moment "
            f"reference point; usual is less than 1",
            "count it from the moment reference point, x forward, not from the drawing datum and "
            "not in % of the chord; a number without a unit is in m",
        )


def _pushing_propeller(x: float, number: int, aircraft: Aircraft) -> Iterator[UnusualSize]:
    """Yield a propeller behind the wing of an aircraft that does not state pushers."""
    if aircraft.facts.pusher:
        return
    yield UnusualSize(
        "engine_position",
        f"engine {number}: its propeller stands at x = {x:.4g} m, {-x / aircraft.cbar:.2g} mean "
        f"chords behind the moment reference point: behind the wing",
        "turn the sign of x if it is before the wing, x is positive forward; give pusher = true in "
        "[facts] if it is behind it",
    )


def _unusual_sides(aircraft: Aircraft) -> Iterator[UnusualSize]:
    """Yield engines that are all on one side, and one without an engine opposite to it."""
    sides = np.array([engine.position[1] for engine in aircraft.engines]) / aircraft.b
    if not sides.size:
        return
    if sides.size > 1 and (sides.min() > _CENTRE or sides.max() < -_CENTRE):
        side = "right" if sides.min() > 0.0 else "left"
        yield UnusualSize(
            "engine_position",
            f"all {sides.size} engines are on the {side} side",
            "turn the sign of y of those on the other side; y is positive to the right",
        )
        return
    for number, side in enumerate(sides, 1):
        if abs(side) < _ASIDE or np.abs(sides + side).min() < _OPPOSITE:
            continue
        y = side * aircraft.b
        yield UnusualSize(
            "engine_position",
            f"engine {number}: y = {y:.4g} m, and no engine is opposite to it",
            "correct y, positive to the right, and the order x, y, z; in the plane of symmetry it "
            "is 0",
        )


def _datum(aircraft: Aircraft) -> float:
    """Return the distance of the moment reference point behind the drawing datum. [m]"""
    return 0.0 if aircraft.reference is None else -aircraft.reference[0]


def _is_behind_tail(x: float, aircraft: Aircraft) -> bool:
    """Return whether a place is farther behind the reference point than the tail can be.

    The reference point lies at 40 to 55 % of the length of an aeroplane. A datum that is nearer
    than the nose is another one, such as the firewall.
    """
    datum = _datum(aircraft)
    return datum > _NOSE * aircraft.cbar and x < -_TAIL * datum


def impossible_body(aircraft: Aircraft) -> Iterator[UnusualSize]:
    """Yield moments of inertia that no body has, and stops of surfaces beyond 90 deg.

    Parameters
    ----------
    aircraft : Aircraft
        Ixx, Iyy, Izz [kg m2] and limits [rad].

    Yields
    ------
    UnusualSize
        A moment of inertia larger than the sum of the two others, and a limit of a surface that is
        larger than a right angle.
    """
    moments = {"Ixx": aircraft.Ixx, "Iyy": aircraft.Iyy, "Izz": aircraft.Izz}
    largest = max(moments, key=lambda name: moments[name])
    others = sum(moments.values()) - moments[largest]
    if moments[largest] > others:
        yield UnusualSize(
            "inertia",
            f"{largest} {moments[largest]:.4g} kg m2 is larger than the sum of the two others, "
            f"{others:.4g} kg m2, which no body has",
            "check Ixx (roll), Iyy (pitch), Izz (yaw) and their units",
        )
    for name, limits in aircraft.limits.items():
        stop = max(abs(limit) for limit in limits)
        if name.startswith("delta_") and stop > _RIGHT_ANGLE:
            yield UnusualSize(
                "limits",
                f"limits of {name}: {stop:.4g} rad is {np.degrees(stop):.0f} deg, as if the number "
                f"were in deg",
                "write the unit with the number, such as '25 deg'; a number without one is in rad",
            )


def unusual_pumps(aircraft: Aircraft) -> Iterator[UnusualSize]:
    """Yield transfer pumps that move more than 20 kg/s: mostly kg/h or lb/h without the unit.

    Parameters
    ----------
    aircraft : Aircraft
        Rates of the pumps between its tanks. [kg s-1]
    """
    for pump in aircraft.fuel.transfers if aircraft.fuel is not None else ():
        if pump.rate > _LARGEST_PUMP:
            yield UnusualSize(
                "transfer",
                f"transfer from {pump.source} to {pump.target}: rate {pump.rate:.4g} kg/s is more "
                f"than a pump moves, usual is up to {_LARGEST_PUMP:g} kg/s",
                f"write the unit with the number, such as '{pump.rate:g} kg/h'; a number without "
                f"one is in kg/s",
            )


def _place(values: object) -> str:
    return "[" + ", ".join(f"{value:.4g}" for value in np.asarray(values, float)) + "]"
