"""Files that hold two flights with a gap of the clock between them.

A flight burns little fuel and climbs little while its recorder stands still.  Another flight begins
with another mass, height and speed, also in a file without position.
"""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np
import pandas as pd
import xarray as xr

from flightmech.names import lookup
from flightmech.quantities import time_text
from flighttest.reconstruction.quality.finding import Finding

_SIDE, _LINE = 10.0, 60.0  # s on either side that give a level, and a slope
_FEWEST = 5  # samples of a side
_SIGMAS, _TO_SIGMA = 3.0, 1.4826  # of the scatter; standard deviation over median absolute value
_FASTER = 3.0  # times the slopes on both sides by which a channel may change in a gap
_BURNT = 10.0  # the same of fuel that leaves: full power in the gap, idle on both sides
_LEAST = 0.005  # of the largest mass or fuel: rounding, and fuel that moves in its tanks


class _Course(NamedTuple):
    """How far a channel goes in a gap: at once, and per second. [SI]"""

    step: float
    rate: float


# height and speed of the quickest aeroplanes; our numbers
_QUICKEST = {
    "h_baro": _Course(20.0, 150.0),
    "h_gps": _Course(20.0, 150.0),
    "V": _Course(5.0, 15.0),
    "V_cas": _Course(5.0, 15.0),
}
# sign of the change by fuel that leaves
_TANKS = {"mass": -1.0, "fuel": -1.0, "fuel_used": 1.0}


def gap_jumps(record: xr.DataTree, faults: pd.DataFrame) -> list[Finding]:
    """Return a warning for each gap across which no single flight goes on.

    Parameters
    ----------
    record : DataTree
    faults : DataFrame
        Result of `faults_of`.

    Returns
    -------
    list of Finding
        Of kind ``gap``, with the channels that jump.
    """
    jumps: dict[tuple[float, float], dict[str, str]] = {}
    gaps = faults[(faults["kind"] == "gap") & (faults["channel"] == "")]
    for row in gaps.to_dict("records"):
        gap = float(row["start"]), float(row["stop"])
        variables = record.children[str(row["leaf"])].variables
        time = variables["time"].values
        for name in (*_TANKS, *_QUICKEST):
            if name in variables:
                text = _jump_text(name, time, variables[name].values, gap)
                if text:
                    jumps.setdefault(gap, {})[name] = text
    findings = []
    for gap, texts in jumps.items():
        text = (
            f"across the gap from {time_text(gap[0])} to {time_text(gap[1])} s "
            f"{', '.join(texts.values())}: more "
            f"than one flight changes in this time, so another flight begins there"
        )
        if set(texts) <= set(_TANKS):
            text += ", or fuel was taken or a load dropped"
        remedy = (
            "split the file there, and give each flight its own mass; wind, offsets and drift "
            "are those of one flight"
        )
        evidence: dict[str, Any] = {"duration": gap[1] - gap[0]}
        finding = Finding("warning", "gap", tuple(texts), text, remedy, *gap, evidence=evidence)
        findings.append(finding)
    return findings


def _jump_text(name: str, time: np.ndarray, x: np.ndarray, gap: tuple[float, float]) -> str:
    """Return the jump of a channel across a gap in words, empty if a flight may make it."""
    start, stop = gap
    x = x.astype(float)
    before = np.isfinite(x) & (time <= start) & (time > start - _LINE)
    after = np.isfinite(x) & (time >= stop) & (time < stop + _LINE)
    near_before, near_after = before & (time > start - _SIDE), after & (time < stop + _SIDE)
    if min(near_before.sum(), near_after.sum()) < _FEWEST:
        return ""
    jump = float(np.median(x[near_after]) - np.median(x[near_before]))
    scatter = max(_scatter(x[near_before]), _scatter(x[near_after]))
    seconds = stop - start + _SIDE
    slope = max(_slope(time[side], x[side]) for side in (before, after))
    if name in _TANKS:
        faster = _BURNT if _TANKS[name] * jump > 0.0 else _FASTER
        step, rate = _LEAST * float(np.nanmax(np.abs(x))), faster * slope
    else:
        step, rate = _QUICKEST[name].step, max(_QUICKEST[name].rate, _FASTER * slope)
    if abs(jump) <= step + _SIGMAS * scatter + rate * seconds:
        return ""
    return f"{name} jumps by {jump:+.4g} {lookup(name).units.replace(' s-1', '/s')}"


def _scatter(x: np.ndarray) -> float:
    return _TO_SIGMA * float(np.median(np.abs(x - np.median(x))))


def _slope(time: np.ndarray, x: np.ndarray) -> float:
    """Return the size of the mean slope of samples; 0 for too few."""
    if len(x) < _FEWEST or not np.ptp(time) > 0.0:
        return 0.0
    return abs(float(np.polyfit(time - time[0], x, 1)[0]))
