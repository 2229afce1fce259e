"""Half widths of a band and the judgement of a time history.

The band belongs to the flight value at its time.  Nothing is shifted in time, nothing is re-centred on the start value
of the model (rule R17 of the tolerance table): a trim residual and a delay use up tolerance.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from .channels import WRAPPED, factor
from .criteria import Criterion

NAN = float("nan")
_ROUNDING = 1e-9  # degrees to radians and back: a difference equal to the tolerance as printed passes


class NotJudged(Exception):
    """A criterion cannot be judged; the text says why.  Ends as a verdict, never at the user as an error."""


class Invalid(Exception):
    """The data cannot carry a judgement; the text says why.  Ends as a verdict, never at the user as an error."""


@dataclass(frozen=True)
class Outcome:
    """Judgement of one criterion on one model, in SI; times on the clock of the record."""

    verdict: str
    width: float = NAN
    worst: float = NAN
    worst_ratio: float = NAN
    at: float = NAN
    first_exit: float = NAN
    inside: float = NAN
    note: str = ""
    flight: float = NAN
    model: float = NAN
    applied: str = ""


def half_width(criterion: Criterion, flight: np.ndarray | float) -> np.ndarray:
    """Return the half width at every flight value.

    Parameters
    ----------
    criterion : Criterion
        Its band as printed.
    flight : array (time,) or float
        Flight values of the window, or the flight value of a scalar measure. [SI]

    Returns
    -------
    array (time,)
        ``max`` of the limits for ``greater_of``, ``min`` for ``lesser_of``. [SI]

    Raises
    ------
    NotJudged
        The percentage is of something the case does not know.
    """
    magnitude = np.abs(np.atleast_1d(np.asarray(flight, float)))
    widths = []
    for limit in criterion.band.limits:
        if limit.quantity == "absolute":
            widths.append(np.full_like(magnitude, limit.value * factor(criterion.measure, criterion.channel, limit.unit)))
        elif limit.quantity == "percent":
            widths.append(limit.value / 100.0 * _base(criterion.band.base, magnitude))
        else:
            raise NotJudged(f"a tolerance of kind {limit.quantity} is not evaluated yet")
    if not widths:
        raise NotJudged("the row prints no width")
    return np.min(widths, axis=0) if criterion.band.rule == "lesser_of" else np.max(widths, axis=0)


def _base(base: str, magnitude: np.ndarray) -> np.ndarray:
    if base in ("ref_local", "ref_scalar"):
        return magnitude
    if base == "ref_peak":
        return np.full_like(magnitude, magnitude.max())
    # rule R3: a lone percentage is of the largest value in service, which no record holds
    raise NotJudged("the percentage is of the largest value in service; give the width as an absolute value in [tolerance]")


def inside_window(time: np.ndarray, window: tuple[float, float]) -> np.ndarray:
    """Return the mask of the samples in a window.

    Raises
    ------
    Invalid
        Time does not rise, or the samples end before the window does (by more than one step).
    """
    if time.size < 2 or not (np.diff(time) > 0.0).all():
        raise Invalid("time does not rise from sample to sample")
    start, stop = window
    step = float(np.median(np.diff(time)))
    if time[0] > start + step or time[-1] < stop - step:
        raise Invalid(f"samples cover {time[0]:.2f} ... {time[-1]:.2f} s, the window is {start:.2f} ... {stop:.2f} s")
    return (time >= start - 1e-9) & (time <= stop + 1e-9)


def demand_finite(who: str, time: np.ndarray, values: np.ndarray) -> None:
    """Raise `Invalid` when `values` hold a NaN or an infinity."""
    bad = ~np.isfinite(values)
    if bad.all():
        raise Invalid(f"{who} has no value in the window")
    if bad.any():
        raise Invalid(f"{who} has no value in {int(bad.sum())} of {bad.size} samples, first at {time[bad][0]:.2f} s")


def difference(channel: str, flight: np.ndarray, model: np.ndarray) -> np.ndarray:
    """Return model minus flight; angles that wrap are unwrapped and start less than half a turn apart."""
    if channel not in WRAPPED:
        return model - flight
    error = np.unwrap(model) - np.unwrap(flight)
    return error - 2.0 * np.pi * np.round(error[0] / (2.0 * np.pi))


def trace(criterion: Criterion, time: np.ndarray, flight: np.ndarray, model: np.ndarray) -> Outcome:
    """Judge a time history: every flight sample of the window must lie within the half width.

    Parameters
    ----------
    criterion : Criterion
        Measure ``trace``.
    time : array (time,)
        Flight samples, rising. [s]
    flight, model : array (time,)
        Values at these samples. [SI]

    Raises
    ------
    Invalid, NotJudged
        See `inside_window`, `demand_finite`, `half_width`.
    """
    mask = inside_window(time, criterion.window)
    t, f, s = time[mask], flight[mask], model[mask]
    demand_finite("flight", t, f)
    demand_finite("the model", t, s)
    width = half_width(criterion, f)
    error = difference(criterion.channel, f, s)
    with np.errstate(divide="ignore", invalid="ignore"):
        ratio = np.where(error == 0.0, 0.0, np.abs(error) / width)
    out = ratio > 1.0 + _ROUNDING
    worst = int(np.argmax(ratio))
    return Outcome(
        verdict="fail" if out.any() else "pass",
        width=float(width.min()),
        worst=float(error[worst]),
        worst_ratio=float(ratio[worst]),
        at=float(t[worst]),
        first_exit=float(t[out][0]) if out.any() else NAN,
        inside=float(1.0 - out.mean()),
        note=f"longest run outside {_longest(t, out):.2f} s" if out.any() else "",
    )


def _longest(time: np.ndarray, out: np.ndarray) -> float:
    """Return the longest run of samples outside, each sample counting for one step. [s]"""
    edges = np.flatnonzero(np.diff(np.concatenate([[False], out, [False]]).astype(int)))
    return float(max(stop - start for start, stop in edges.reshape(-1, 2)) * np.median(np.diff(time)))


def scalar(criterion: Criterion, flight: float, model: float, at: float = NAN, note: str = "") -> Outcome:
    """Judge one number of the model against that of the flight."""
    width = float(half_width(criterion, flight)[0])
    error = model - flight
    ratio = 0.0 if error == 0.0 else abs(error) / width if width > 0.0 else float("inf")
    return Outcome("pass" if ratio <= 1.0 + _ROUNDING else "fail", width, error, ratio, at, note=note, flight=flight, model=model)
