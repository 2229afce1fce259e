"""Whether a record can determine anything about an axis: what moved, how fast, and whether the inputs moved independently."""

from __future__ import annotations

from itertools import combinations

import numpy as np
import pandas as pd

from flightmech.units import DEGREE

from ..finding import Finding, rows
from .signals import BAND, Signals, smooth

COLLINEAR = 0.9  # correlation of two inputs, or multiple correlation of one with the others
_TRIM_BAND = 0.05  # Hz, slower than any manoeuvre
_AXES = (("pitch", "delta_e", "q"), ("roll", "delta_a", "p"), ("yaw", "delta_r", "r"))
_INPUT, _RATE = 0.25 * DEGREE, 0.4 * DEGREE  # rms over a second that count as movement: surface [rad], rate [rad s-1]
_LEVER = 0.02
_SECOND = 1.0  # s
_CONTROLS = {"elevator": "delta_e", "aileron": "delta_a", "rudder": "delta_r"}
_INPUTS = ("delta_e", "delta_a", "delta_r", "delta_s", "delta_d", "throttle")


def excitation(signals: Signals) -> pd.DataFrame:
    """Return what moved about each axis.

    Returns
    -------
    DataFrame
        ``axis surface rate input response share frequency``: largest rms over one second of surface [rad] and rate [rad s-1] without
        trim and slow drift, share of the flight in which both move [1], frequency below which nine tenths of the surface's movement
        lie [Hz].
    """
    table: list = []
    for axis, surface, rate in _AXES:
        if not {surface, rate} <= set(signals.values):
            continue
        mask = signals.mask((surface, rate))
        if not mask.any():
            continue
        moved = [_quick(signals, name) for name in (surface, rate)]
        x, y = (_rms(part, signals.step)[mask] for part in moved)
        share = float(np.mean((_held(x > _INPUT, signals.step)) & (y > _RATE)))
        table.append((axis, surface, rate, float(x.max()), float(y.max()), share, _frequency(moved[0][mask], signals.step)))
    return pd.DataFrame(table, columns=["axis", "surface", "rate", "input", "response", "share", "frequency"])


def correlations(signals: Signals) -> pd.DataFrame:
    """Return the correlation of the inputs that move, without trim; the throttles count as one."""
    columns, mask = _inputs(signals)
    if len(columns) < 2:
        return pd.DataFrame()
    return pd.DataFrame(np.corrcoef([x[mask] for x in columns.values()]), index=list(columns), columns=list(columns))


def excitation_findings(table: pd.DataFrame, matrix: pd.DataFrame, signals: Signals, flown: pd.DataFrame, purpose: str) -> list[Finding]:
    """Return what was not excited, manoeuvres whose control did not move, and inputs that moved together.

    Parameters
    ----------
    table, matrix : DataFrame
        Of `excitation` and `correlations`.
    signals : Signals
    flown : DataFrame
        Of `flighttest.manoeuvres`.
    purpose : str
        ``validation`` records need no excitation.
    """
    found = _unexcited(table, purpose)
    for row in rows(flown):
        found += _unflown(row, signals)
    return found + _collinear(matrix)


def _unexcited(table: pd.DataFrame, purpose: str) -> list[Finding]:
    still = [row for row in rows(table) if row.share == 0.0]
    if not still:
        return []
    needed = len(still) == len(table) and purpose != "validation"
    text = "{0.axis}: {0.surface} moves by {1:.2g} deg rms, {0.rate} by {2:.2g} deg/s"
    what = "; ".join(text.format(row, row.input / DEGREE, row.response / DEGREE) for row in still)
    head = "no axis is excited" if len(still) == len(table) else f"not excited: {', '.join(row.axis for row in still)}"
    text = f"{head} ({what})"
    remedy = "no derivative of these axes can be identified from this record; fly doublets, 3-2-1-1 or multisines"
    return [Finding("warning" if needed else "note", "excitation", tuple(row.surface for row in still), text, remedy)]


def _unflown(row, signals: Signals) -> list[Finding]:
    """A manoeuvre whose control does not move was not flown there."""
    found = []
    for word in str(row.control).split():
        name = _CONTROLS.get(word, word)
        if name not in signals or name not in _CONTROLS.values():
            continue
        inside = (signals.time >= row.start) & (signals.time <= row.end)
        movement = float(np.ptp(signals[name][inside])) if inside.sum() * signals.step > 1.0 else np.inf
        if movement < 2.0 * _INPUT:
            text = f"{row.manoeuvre} at {row.start:g} ... {row.end:g} s: {name} moves by {movement / DEGREE:.2g} deg only"
            remedy = "check the times of the list of manoeuvres, and the pick-up"
            found.append(Finding("warning", "excitation", (name,), text, remedy, float(row.start), float(row.end)))
    return found


def _collinear(matrix: pd.DataFrame) -> list[Finding]:
    found, paired = [], set()
    names, values = [str(name) for name in matrix.columns], matrix.to_numpy()
    for (i, one), (j, other) in combinations(enumerate(names), 2):
        correlation = float(values[i, j])
        if abs(correlation) > COLLINEAR:
            paired |= {one, other}
            text = f"{one} and {other} move together (correlation {correlation:+.3f}): their effects cannot be distinguished"
            remedy = "fly them one after the other, or as orthogonal multisines; else fix one at its a-priori value"
            found.append(Finding("warning", "collinear", (one, other), text, remedy, evidence={"correlation": correlation}))
    if len(names) > 2 and not paired:
        multiple = np.sqrt(np.maximum(0.0, 1.0 - 1.0 / np.diag(np.linalg.pinv(values))))
        worst = int(np.argmax(multiple))
        if multiple[worst] > COLLINEAR:
            others = (*names[:worst], *names[worst + 1 :])
            text = f"{names[worst]} is a combination of {', '.join(others)} (multiple correlation {multiple[worst]:.3f})"
            remedy = "fly the inputs one after the other, or as orthogonal multisines"
            found.append(Finding("warning", "collinear", (names[worst], *others), text, remedy))
    return found


def _inputs(signals: Signals) -> tuple[dict[str, np.ndarray], np.ndarray]:
    """Return the inputs that move, and where they all are whole."""
    levers = [name for name in signals.values if name.endswith(".throttle")]
    names = [name for name in _INPUTS if name in signals]
    mask = signals.mask((*names, *levers))
    columns = {name: _quick(signals, name) for name in names}
    if levers:
        columns["throttle"] = np.mean([_quick(signals, name) for name in levers], axis=0)
    sizes = {name: _LEVER if name == "throttle" else _INPUT for name in columns}
    return {name: x for name, x in columns.items() if mask.any() and _rms(x, signals.step)[mask].max() > sizes[name]}, mask


def _quick(signals: Signals, name: str) -> np.ndarray:
    x = smooth(signals[name], signals.step, BAND)
    slow = smooth(x, signals.step, _TRIM_BAND)
    return x - (slow if slow is not x else x.mean())


def _rms(x: np.ndarray, step: float) -> np.ndarray:
    """Return the rms over a second around each sample."""
    width = max(round(_SECOND / step), 1)
    return np.sqrt(np.maximum(np.convolve(x**2, np.ones(width) / width, mode="same"), 0.0))


def _held(moving: np.ndarray, step: float) -> np.ndarray:
    """Return a mask that stays true for the three seconds in which an input is answered."""
    return np.convolve(moving, np.ones(max(round(3.0 / step), 1)), mode="full")[: len(moving)] > 0.5


def _frequency(x: np.ndarray, step: float) -> float:
    power = np.cumsum(np.abs(np.fft.rfft(x - x.mean())) ** 2)
    return float(np.searchsorted(power, 0.9 * power[-1]) / (len(x) * step)) if power[-1] > 0.0 else float("nan")
