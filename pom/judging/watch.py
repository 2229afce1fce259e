"""Channels without a tolerance, watched: what a verdict does not look at and a pilot would notice.

A row of the tolerance table judges a few channels.  A model may pass it and roll while it yaws, oscillate in the opposite phase or
drift away; the remark on such a channel stands next to the verdict and changes none.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import TYPE_CHECKING

import numpy as np

from flightmech.names import lookup
from flightmech.units import DEGREE, FOOT, KNOT, from_si

from ..tolerances.bands import difference
from ..tolerances.criteria import Criterion
from ..tolerances.remarks import RowRemark
from .verdict import unjudged

if TYPE_CHECKING:
    from ..cases.case import PomCase

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
"""Half width of every watched channel.  About twice the time-history tolerances of Table A2A; that of the heading is wide since
it integrates the smallest asymmetry.  The rule has no such numbers, these are ours. [SI]"""
SHARE = 0.25  # of the largest departure of the flight from its start, where that is wider
SLOWEST = 15.0  # [m s-1] below it the flow angles mean nothing


def watch(case: PomCase, time: np.ndarray, flight: Mapping[str, np.ndarray], model: Mapping[str, np.ndarray]) -> tuple[RowRemark, ...]:
    """Return a remark of kind ``watch`` for every channel without a tolerance that leaves its band.

    Parameters
    ----------
    case : PomCase
        Settled on the flight; what it judges by a time history is not watched.
    time : array (time,)
        [s]
    flight, model : mapping of str to array (time,)
        Signals by SI name; samples that are no number are not looked at. [SI]
    """
    if case.reference == "footprint":
        return ()
    judged = {c.channel for c in case.criteria if _judged(case, c)}
    airborne = np.asarray(flight["V_cas"]) > SLOWEST if "V_cas" in flight else np.ones(time.size, bool)
    found = []
    for name, least in BANDS.items():
        if name in judged or name not in flight or name not in model:
            continue
        trace, error = flight[name], np.abs(difference(name, flight[name], model[name]))
        counted = np.isfinite(error) & (airborne if name in ("alpha", "beta") else True)
        if not counted.any():
            continue
        band = max(least, SHARE * float(np.max(np.abs(trace[counted] - trace[counted][0]))))
        worst = int(np.argmax(np.where(counted, error, -1.0)))
        if error[worst] > band:
            found.append(_remark(name, float(error[worst]), band, float(time[worst])))
    return tuple(found)


def _judged(case: PomCase, criterion: Criterion) -> bool:
    return criterion.applies and criterion.measure == "trace" and not unjudged(case, criterion)


def _remark(name: str, error: float, band: float, at: float) -> RowRemark:
    unit = lookup(name).display_units
    values = {"off": float(from_si(error, unit)), "band": float(from_si(band, unit))}
    shown = "" if unit == "1" else f" {unit}"
    off = f"{lookup(name).long_name} off by {values['off']:.3g}{shown} at {at:.1f} s"
    text = f"{off}, without a tolerance, watched within {values['band']:.3g}{shown}"
    return RowRemark("watch", text, name, values, unit)
