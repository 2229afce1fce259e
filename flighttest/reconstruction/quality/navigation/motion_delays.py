"""Delays of ground velocity, airspeed and vanes against inertial motion."""

from __future__ import annotations

from collections.abc import Collection

import numpy as np
import pandas as pd

from flighttest.reconstruction.quality.checks.signals import ResampledChannels
from flighttest.reconstruction.quality.navigation.inertial_fit import InertialFit
from flighttest.reconstruction.quality.navigation.inertial_motion import MotionFits

EXPLAINED = 0.9
"""Share of a channel that inertial motion must explain; gusts and noise remain below."""

_KNOWN, _KNOWN_FLOW = 0.15, 0.03  # s of standard error up to which a delay counts as checked
_SHORTEST = 10.0  # s of motion; the drift of a shorter stretch absorbs too much of it
_EXPLAINED_FLOW = 0.85  # the same share of a vane, whose own delay is in its reference
LARGEST_ERROR = 0.3
"""Standard error beyond which a delay is not determined. [s]"""

_AGAINST = {
    "vn": "ax ay az_imu",
    "ve": "ax ay az_imu",
    "vd": "ax ay az_imu",
    "alpha_vane": "q az_imu",
    "beta_vane": "r p ay_imu",
}
_AGAINST_AIR = "ax_imu az_imu"
_VANES = ("alpha_vane", "beta_vane")
# s of a vane whose place is not known: a boom of 12 m at 80 m/s looks as much early
_PLACE = 0.15
# s of an airspeed: gusts are in it and not in the accelerations, and a few of them look like a
# delay
_GUSTS = 0.15
# s, and standard errors, between the delays of two airspeeds that are reported both
_APART, _SIGMAS = 0.1, 3.0

Unchecked = list[tuple[str, str, tuple[str, ...], str]]


def motion_delays(fits: MotionFits, placed: Collection[str] = ()) -> pd.DataFrame:
    """Return the delays that inertial motion determines.

    Parameters
    ----------
    fits : MotionFits
    placed : collection of str
        Channels that were moved to the c.g.

    Returns
    -------
    DataFrame
        ``channel against delay stderr correlation bound margin``, as `find_lags` returns it. The
        margin is added to the delays that an instrument may have. [s]
    """
    rows = []
    for name, fit in {**fits.ground, **_distinct(fits.air), **fits.flow}.items():
        if not is_determined(fit, _least_share(name)):
            continue
        margin = 0.0
        if name in _VANES and not {name, "ax_imu"} <= set(placed):
            margin = _PLACE
        if name in fits.air:
            margin = _GUSTS
        against = _AGAINST.get(name, _AGAINST_AIR)
        correlation = float(np.sqrt(fit.explained))
        rows.append((name, against, fit.delay, fit.stderr, correlation, fit.bound, margin))
    columns = ["channel", "against", "delay", "stderr", "correlation", "bound", "margin"]
    return pd.DataFrame(rows, columns=columns)


def merge_delays(usual: pd.DataFrame, inertial: pd.DataFrame) -> pd.DataFrame:
    """Return the table of `find_lags` with its rows replaced where inertial motion gives a
    delay.
    """
    kept = usual[~usual["channel"].isin(inertial["channel"])].assign(margin=0.0)
    if inertial.empty:
        return kept
    if kept.empty:
        return inertial
    return pd.concat([kept, inertial], ignore_index=True)


def delays_not_checked(
    fits: MotionFits, signals: ResampledChannels, placed: Collection[str] = ()
) -> Unchecked:
    """Return the channels whose delay the motion does not show, with the reason."""
    rows: Unchecked = []
    for name in ("vn", "ve", "vd", *_first_airspeed(fits, signals), *_VANES):
        if name not in signals:
            continue
        fit = fits.all.get(name)
        reason = "too little motion, or accelerometers, attitude or rates are absent"
        if fit is not None and is_determined(fit, _least_share(name)):
            unplaced = name in _VANES and not {name, "ax_imu"} <= set(placed)
            if fit.bound or (fit.stderr < _known_to(name) and not unplaced):
                continue
            reason = f"known with a standard error of {1e3 * fit.stderr:.0f} ms only"
            if unplaced:
                reason = f"known to {_PLACE:g} s only: its place (instruments) is not stated"
        elif fit is not None:
            reason = (
                f"inertial motion explains {max(fit.explained, 0.0):.0%} of it, "
                f"{_least_share(name):.0%} are needed: a manoeuvre in calm air shows it"
            )
        rows.append((f"delay_{name}", f"delay of {name}", (), reason))
    return rows


def is_determined(fit: InertialFit, least: float = EXPLAINED) -> bool:
    """Return whether a fit explains enough of its channel."""
    known = fit.bound or fit.stderr < LARGEST_ERROR
    if fit.seconds < _SHORTEST:
        return False
    return known and fit.explained > least and bool(fit.scales[0] > 0.0)


def _known_to(name: str) -> float:
    """Return the standard error up to which a delay counts as checked. [s]"""
    return _KNOWN_FLOW if name in _VANES else _KNOWN


def _least_share(name: str) -> float:
    """Return the share of a channel that inertial motion must explain."""
    return _EXPLAINED_FLOW if name in _VANES else EXPLAINED


def _first_airspeed(fits: MotionFits, signals: ResampledChannels) -> list[str]:
    """Return the first airspeed with a fit, or else the first one of the record."""
    fitted = list(fits.air)
    recorded = [name for name in ("V", "q_c", "V_cas", "mach") if name in signals]
    return (fitted or recorded)[:1]


def _distinct(fits: dict[str, InertialFit]) -> dict[str, InertialFit]:
    """Return the fit of the first airspeed, and of those that are later or earlier than it."""
    distinct: dict[str, InertialFit] = {}
    for name, fit in fits.items():
        if not is_determined(fit):
            continue
        first = next(iter(distinct.values()), None)
        if first is None or _is_apart(first, fit):
            distinct[name] = fit
    return distinct


def _is_apart(first: InertialFit, second: InertialFit) -> bool:
    if first.bound or second.bound:
        return first.bound != second.bound
    # both fits have the same reference, so their errors are nearly the same
    limit = _APART + _SIGMAS * min(first.stderr, second.stderr)
    return abs(first.delay - second.delay) > limit
