"""Channels without a tolerance: a model that leaves their bands is reported.

A case judges few channels.  A model can pass them and leave the flight in another one.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace

import numpy as np
import scipy

from flightmech.names import lookup, value_text
from flightmech.units import DEGREE, FOOT, KNOT, from_si
from pom.cases.case import PomCase
from pom.judging.applicability import reason_not_judged
from pom.tolerances.bands import RowRemark, unwrapped_difference
from pom.tolerances.criteria import Criterion

BANDS = {
    "V_cas": 5.0 * KNOT,
    "h": 100.0 * FOOT,
    "theta": 3.0 * DEGREE,
    "phi": 4.0 * DEGREE,
    "psi": 15.0 * DEGREE,
    "alpha": 2.0 * DEGREE,
    "beta": 2.0 * DEGREE,
    "p": 4.0 * DEGREE,
    "q": 3.0 * DEGREE,
    "r": 3.0 * DEGREE,
    "nz": 0.15,
}
"""Half width of every watched channel. [SI]

They are about twice the time-history tolerances of Table A2A.  The band of the heading is wide,
since the heading integrates the smallest asymmetry.  The table has no such numbers; the values are
our choice.
"""
SHARE = 0.25  # of the largest departure of the flight from its start, if that is wider
SLOWEST = 15.0  # [m s-1] at a smaller airspeed the flow angles are not meaningful


def watch_channels(
    case: PomCase,
    time: np.ndarray,
    flight: Mapping[str, np.ndarray],
    model: Mapping[str, np.ndarray],
) -> tuple[RowRemark, ...]:
    """Return a ``watch`` remark for every channel without a tolerance that leaves its band.

    Parameters
    ----------
    case : PomCase
        Case after `settle_case`.  Channels with a judged time history are not watched.
    time : array (time,)
        [s]
    flight, model : mapping of str to array (time,)
        Signals by canonical name; samples that are not finite are ignored. [SI]
    """
    if case.reference == "footprint":
        return ()
    judged = {item.channel for item in case.criteria if _is_judged_trace(case, item)}
    airborne = np.ones(time.size, bool)
    if "V_cas" in flight:
        airborne = np.asarray(flight["V_cas"]) > SLOWEST
    remarks = []
    for name, least in BANDS.items():
        if name in judged or name not in flight or name not in model:
            continue
        trace, error = flight[name], np.abs(unwrapped_difference(name, flight[name], model[name]))
        # at low speed the flow angles have no meaning
        counted = np.isfinite(error)
        if name in ("alpha", "beta"):
            counted = counted & airborne
        if not counted.any():
            continue
        # a flight far from its start has a wider band
        band = max(least, SHARE * float(np.max(np.abs(trace[counted] - trace[counted][0]))))
        worst = int(np.argmax(np.where(counted, error, -1.0)))
        if error[worst] > band:
            remark = _watch_remark(name, float(error[worst]), band=band, time=float(time[worst]))
            is_gross = counted & (error > GROSS * band)
            if float(np.sum(np.gradient(time)[is_gross])) >= GROSS_TIME:
                remark = replace(remark, kind="departure", text=f"departure: {remark.text}")
            remarks.append(remark)
    return tuple(remarks)


GROUND_VELOCITY = ("vn", "ve")
GROSS = 3.0  # times its band: a watched channel so far off is a departure; our choice
GROSS_TIME = 0.5  # [s] for so long in all; the peak of a touchdown is shorter
TRACK = 10.0 * FOOT
"""Half width of the position across the flown track on the ground: the lateral deviation of the
automatic landing, 2.e.5. [m]"""
_MOVING = 1.0  # [m s-1] a slower motion over the ground has no direction


def watch_track(
    case: PomCase,
    time: np.ndarray,
    flight: Mapping[str, np.ndarray],
    model: Mapping[str, np.ndarray],
) -> tuple[RowRemark, ...]:
    """Return the remark on a model that leaves the flown track on the ground.

    The position is the integral of the velocity over the ground.  Across is square to the flown
    direction of that instant.  Beyond `GROSS` bands the remark is a departure.

    Parameters
    ----------
    case : PomCase
        A case that starts on its wheels (``drive.trim = "ground"``) or lands.
    time : array (time,)
        [s]
    flight, model : mapping of str to array (time,)
        Signals by canonical name, with ``vn`` and ``ve``. [SI]
    """
    on_ground = case.drive.trim == "ground"
    has_velocity = all(name in flight and name in model for name in GROUND_VELOCITY)
    if case.reference == "footprint" or not on_ground or not has_velocity:
        return ()
    # the row of the lateral deviation is stricter
    if any(item.channel == "y_runway" and _is_judged_trace(case, item) for item in case.criteria):
        return ()
    velocity = np.stack([flight["vn"], flight["ve"]])
    offset = scipy.integrate.cumulative_trapezoid(
        np.stack([model["vn"], model["ve"]]) - velocity, time, initial=0.0
    )
    moving = np.hypot(*velocity) > _MOVING
    if not np.isfinite(offset).all() or not moving.any():
        return ()
    # before the first and after the last motion the nearest direction counts
    course = np.unwrap(np.arctan2(velocity[1], velocity[0])[moving])
    course = np.interp(time, time[moving], course)
    across = offset[1] * np.cos(course) - offset[0] * np.sin(course)
    worst = int(np.argmax(np.abs(across)))
    error = float(abs(across[worst]))
    if error <= TRACK:
        return ()
    side = "right" if across[worst] > 0.0 else "left"
    text = (
        f"the model is {error / FOOT:.0f} ft to the {side} of the flown track over the ground at "
        f"{time[worst]:.1f} s, without a tolerance, watched within {TRACK / FOOT:.0f} ft"
    )
    values = {"off": error, "band": TRACK}
    if error > GROSS * TRACK:
        return (RowRemark("departure", f"departure: {text}", "y_runway", values, "m"),)
    return (RowRemark("watch", text, "y_runway", values, "m"),)


def _is_judged_trace(case: PomCase, criterion: Criterion) -> bool:
    if not criterion.applies or criterion.measure != "trace":
        return False
    return not reason_not_judged(case, criterion)


def _watch_remark(name: str, error: float, *, band: float, time: float) -> RowRemark:
    unit = lookup(name).display_units
    values = {"off": float(from_si(error, unit)), "band": float(from_si(band, unit))}
    off = f"{lookup(name).long_name} off by {value_text(name, error, '.3g')} at {time:.1f} s"
    text = f"{off}, without a tolerance, watched within {value_text(name, band, '.3g')}"
    return RowRemark("watch", text, name, values=values, unit=unit)
