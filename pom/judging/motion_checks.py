"""Channels of a flight record that follow from each other by kinematics.

A reconstruction makes attitude, rates, velocity and height consistent.  A record that is taken as
it is may have a rate of the wrong gain, a clock that is too fast, or a channel that was held: a
model passes then inside its tolerance.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
import scipy

from flightmech.names import value_text
from flightmech.support.arrays import rms
from flightmech.units import DEGREE, G0
from pom.cases.case import PomCase
from pom.judging.signals import RunSignals
from pom.tolerances.bands import RowRemark
from pom.tolerances.channels import quantity_words

QUANTITY = "kinematics"
ANGLE, HEIGHT, LOAD = 0.06 * DEGREE, 0.3, 0.02
"""Least differences that are named, rms: [rad], [m], load factor [1].

The largest in the shipped cases are 0.023 deg, 0.01 m and 0.0001.
"""
SHARE = 0.03
"""Share of the motion, rms without its trend.  It is 0.05 for a clock that is 5 % too fast."""


class _Pair(NamedTuple):
    """A channel, the integral that it follows from, and what that integral is of."""

    channel: str
    integral: np.ndarray
    source: str
    least: float


def motion_remarks(case: PomCase, flight: RunSignals) -> tuple[RowRemark, ...]:
    """Return the departures of a flight whose channels contradict each other.

    Parameters
    ----------
    case : PomCase
    flight : RunSignals
        Over the window of the case. [SI]

    Returns
    -------
    tuple of RowRemark
        Kind ``departure`` beyond the least difference and `SHARE` of the motion.  Channels with
        missing samples are not compared.
    """
    if case.reference != "flight" or flight.time.size < 3:
        return ()
    remarks = []
    for pair in _integrals(flight):
        difference = _without_trend(flight.time, _unwrapped(flight, pair.channel) - pair.integral)
        motion = _without_trend(flight.time, pair.integral)
        size = rms(difference)
        if size <= max(pair.least, SHARE * rms(motion)):
            continue
        text = (
            f"departure: {quantity_words(pair.channel)} and {pair.source} of the record contradict "
            f"each other by {value_text(pair.channel, size, '.2g')} rms, "
            f"{100.0 * size / max(rms(motion), 1e-12):.2g} % of the motion. Check their gains, "
            f"clock and missing samples"
        )
        remarks.append(RowRemark("departure", text, QUANTITY))
    remarks += _load_factor(flight)
    return tuple(remarks)


def _integrals(flight: RunSignals) -> list[_Pair]:
    """Return the channels that are recorded with the rates that they follow from."""
    pairs = []
    if _are_known(flight, ("phi", "theta", "p", "q", "r")):
        phi, theta = flight["phi"], flight["theta"]
        p, q, r = (flight[name] for name in "pqr")
        # theta' = q cos phi - r sin phi;  phi' = p + tan theta (q sin phi + r cos phi)
        turn = q * np.sin(phi) + r * np.cos(phi)
        rates = {
            "theta": q * np.cos(phi) - r * np.sin(phi),
            "phi": p + np.tan(theta) * turn,
            "psi": turn / np.cos(theta),
        }
        for name, rate in rates.items():
            if _are_known(flight, (name,)):
                pairs.append(_Pair(name, _integrate(rate, flight.time), "the rates", ANGLE))
    if _are_known(flight, ("h", "vd")):
        pairs.append(_Pair("h", _integrate(-flight["vd"], flight.time), "vertical speed", HEIGHT))
    return pairs


def _load_factor(flight: RunSignals) -> list[RowRemark]:
    """Return the departure of a load factor that is not that of the normal acceleration."""
    if not _are_known(flight, ("nz", "az")):
        return []
    size = rms(flight["nz"] + flight["az"] / G0)
    if size <= LOAD:
        return []
    text = (
        f"departure: {quantity_words('nz')} and the normal acceleration of the record contradict "
        f"each other by {value_text('nz', size, '.2g')} rms. Check their gains and positions"
    )
    return [RowRemark("departure", text, QUANTITY)]


def _are_known(flight: RunSignals, names: tuple[str, ...]) -> bool:
    return all(name in flight and bool(np.isfinite(flight[name]).all()) for name in names)


def _unwrapped(flight: RunSignals, name: str) -> np.ndarray:
    return flight[name] if name == "h" else np.unwrap(flight[name])


def _integrate(rate: np.ndarray, time: np.ndarray) -> np.ndarray:
    return scipy.integrate.cumulative_trapezoid(rate, time, initial=0.0)


def _without_trend(time: np.ndarray, values: np.ndarray) -> np.ndarray:
    """Return values less their line, which a bias of a rate makes."""
    line = np.polynomial.polynomial.polyfit(time - time[0], values, 1)
    return values - np.polynomial.polynomial.polyval(time - time[0], line)
