"""Delays between channels that show one motion in two ways."""

from __future__ import annotations

from collections.abc import Iterable

import numpy as np
import pandas as pd
import xarray as xr

from flightmech.errors import IdentificationError

from ...sensors.instruments import Instruments
from ...signals.delays import Delay, time_delay
from ..finding import Finding, later, rows
from .relations import RELATIONS
from .signals import Signals

SLOW = 0.4  # s that air data and satellite receivers may be late without a specification
FAST = 0.06  # s that may lie between attitude, rates and vanes
_SHARE = 0.95  # correlation below which two channels differ in more than time
_LONGEST = 60.0  # s of one stretch
_SEARCHED = 2.0  # s of delay, either way
_PAIRS = {  # relation -> the channel that is late when its first side is, against what
    "phi_rate": ("phi", "p q r"),
    "theta_rate": ("theta", "q r"),
    "psi_rate": ("psi", "q r"),
    "force_z": ("vn", "az_imu"),
    "slip": ("beta_vane", "r p ay_imu"),
    "heave": ("alpha_vane", "q az_imu"),
    "along": ("V", "ax_imu az_imu"),
    "climb": ("h_baro", "vd"),
}
_REVERSED = {"force_z", "climb"}  # the late channel stands on the second side
_VANES = ("alpha_vane", "beta_vane")
_SLOW_CHANNELS = ("vn", "V", "h_gps", "h_baro", "q_c")


def lags(signals: Signals, placed: Iterable[str] = ()) -> pd.DataFrame:
    """Return the delays that the record can determine.

    Parameters
    ----------
    signals : Signals
        With right signs and units.
    placed : iterable of str
        Channels whose place on the aeroplane was taken into account; a vane far ahead of the c.g. seems to be early or late otherwise.

    Returns
    -------
    DataFrame
        ``channel against delay stderr correlation bound``; positive when the channel is late [s].  Where `bound`, the delay lies at the end
        of the search: it is at least so long, and has no standard error (infinite).
    """
    table: list = []
    for relation in RELATIONS:
        if relation.name not in _PAIRS or relation.missing(signals):
            continue
        if _PAIRS[relation.name][0] in _VANES and not {_PAIRS[relation.name][0], "ax_imu"} <= set(placed):
            continue
        mask = signals.mask(relation.channels(signals))
        first, second = relation.sides(signals.completed(relation.formed))
        late, other = (second, first) if relation.name in _REVERSED else (first, second)
        found = [delay for piece in _stretches(mask, late, signals.step) if (delay := _delay(other[piece], late[piece], signals.step))]
        if found:
            table.append((*_PAIRS[relation.name], *_pooled(found)))
    return pd.DataFrame(table, columns=["channel", "against", "delay", "stderr", "correlation", "bound"])


def lag_findings(table: pd.DataFrame, specification: Instruments | None, record: xr.DataTree) -> list[Finding]:
    """Return delays that are longer than the aircraft file, or habit, allows."""
    found = []
    for row in rows(table):
        low, high, origin = _allowed(row.channel, specification)
        margin = 0.0 if row.bound else 3.0 * row.stderr
        if low - margin <= row.delay <= high + margin:
            continue
        measured = f"{1e3 * abs(row.delay):.0f} ms {'late' if row.delay > 0 else 'early'} against {row.against}"
        allowed = f"{origin} allows {1e3 * low:.0f} to {1e3 * high:.0f} ms"
        if row.bound:
            text = f"{row.channel} is at least {measured}, the end of the search; {allowed}"
            remedy = "compare the clocks of the two instruments, and put the time between them into the name map"
        else:
            text = f"{row.channel} is {measured} (standard error {1e3 * row.stderr:.1f} ms); {allowed}"
            remedy = f"{later(record, row.channel, delay=row.delay)}, and the same delay for the other channels of that instrument"
        evidence = {"delay": row.delay, "stderr": None if row.bound else row.stderr, "bound": bool(row.bound)}
        found.append(Finding("warning", "lag", (row.channel,), text, remedy, evidence=evidence))
    return found


def _allowed(channel: str, specification: Instruments | None) -> tuple[float, float, str]:
    given = specification.of(channel) if specification is not None else None
    for pair in (given.delay, given.lag) if given is not None else ():
        if pair is not None:
            mean, sigma = pair
            return min(0.0, mean - 3.0 * sigma) - FAST, mean + 3.0 * sigma + FAST, "the aircraft file"
    limit = SLOW if channel in _SLOW_CHANNELS else FAST
    return -limit, limit, "habit"


def _stretches(mask: np.ndarray, motion: np.ndarray, step: float) -> list[slice]:
    """Return the whole stretches of at most a minute with the most motion in them, up to eight."""
    edges = np.flatnonzero(np.diff(np.concatenate([[False], mask, [False]]).astype(np.int8)))
    longest = round(_LONGEST / step)
    pieces = [slice(a, min(a + longest, b)) for start, b in zip(edges[::2], edges[1::2]) for a in range(start, b, longest)]
    pieces = [piece for piece in pieces if piece.stop - piece.start >= 256]
    return sorted(pieces, key=lambda piece: -float(np.var(motion[piece])))[:8]


def _delay(reference: np.ndarray, late: np.ndarray, step: float) -> Delay | None:
    try:
        found = time_delay(reference, late, step, _SEARCHED)
    except IdentificationError:
        return None
    return found if found.correlation > _SHARE else None


def _pooled(found: list[Delay]) -> tuple[float, float, float, bool]:
    """Return the weighted mean, its standard error inflated by the scatter, the median correlation, and whether it is only a bound."""
    correlation = float(np.median([one.correlation for one in found]))
    inside = [one for one in found if not one.bound]
    if 2 * len(inside) < len(found):
        nearest = min((one.estimate for one in found if one.bound), key=abs)
        return nearest, np.inf, correlation, True
    values, errors = np.array([one.estimate for one in inside]), np.array([one.stderr for one in inside])
    errors = np.maximum(errors, 1e-4)
    weight = errors**-2 / np.sum(errors**-2)
    mean = float(weight @ values)
    birge = np.sqrt(np.sum(((values - mean) / errors) ** 2) / max(len(values) - 1, 1))
    return mean, float(max(1.0, birge) / np.sqrt(np.sum(errors**-2))), correlation, False
