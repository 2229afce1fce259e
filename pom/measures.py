"""Measures that turn a record into one number: snapshot, value at the end, engine response, trend; and their judgement.

Every function takes the criterion, the flight samples and a mapping of channels for flight and model, and returns an
`Outcome`.  Data that cannot carry a judgement raise `Invalid`.
"""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from flightmech.names import lookup
from flightmech.units import parse

from .criteria import Criterion
from .tolerance import Invalid, Outcome, demand_finite, difference, half_width, inside_window, scalar

Signals = Mapping[str, np.ndarray]
BEFORE, AFTER = 4.0, 1.0  # rule R5: a steady state from 4 s before to 1 s after the captured instant
_LEVEL = 1.0  # [s] over which the end level of an engine response is averaged


def steady(criterion: Criterion, time: np.ndarray, flight: Signals, model: Signals, capture: float) -> Outcome:
    """Judge a snapshot: means over the capture window, after a check that both records stand still.

    Parameters
    ----------
    capture : float
        Captured instant. [s]

    Notes
    -----
    The rule gives no number for "steady".  Ours: over the 5 s the drift of the fitted line and the standard deviation
    about it stay below one third of the tolerance.
    """
    mask = inside_window(time, (capture - BEFORE, capture + AFTER))
    t = time[mask]
    values = []
    for who, signals in (("flight", flight), ("the model", model)):
        y = signals[criterion.channel][mask]
        demand_finite(who, t, y)
        values.append(y)
    width = float(half_width(criterion, values[0].mean())[0])
    for who, y in zip(("flight", "the model"), values, strict=True):
        line = np.polynomial.Polynomial.fit(t, y, 1)
        drift, spread = abs(float(line(t[-1]) - line(t[0]))), float(np.std(y - line(t)))
        if max(drift, spread) > width / 3.0:
            raise Invalid(f"{who} is not steady: drift {drift / width:.2f}, spread {spread / width:.2f} of the tolerance (1/3 allowed)")
    return scalar(criterion, float(values[0].mean()), float(values[1].mean()), capture)


def end_value(criterion: Criterion, time: np.ndarray, flight: Signals, model: Signals) -> Outcome:
    """Judge the value at the end of the window, e.g. the bank angle 20 s after release."""
    mask = inside_window(time, criterion.window)
    t, f, s = time[mask], flight[criterion.channel][mask], model[criterion.channel][mask]
    demand_finite("flight", t, f)
    demand_finite("the model", t, s)
    error = difference(criterion.channel, f, s)
    return scalar(criterion, float(f[-1]), float(f[-1] + error[-1]), float(t[-1]), "judged at the end of the window")


def response(criterion: Criterion, time: np.ndarray, flight: Signals, model: Signals) -> Outcome:
    """Judge the engine response Ti or Tt after a slam movement of the lever.

    Ti is the time to 10 % of the change, each record between its own levels.  Tt is the time to 90 % of the go-around
    power of the *flight*, or, when power falls, to a 90 % decay of its starting power.  Levels: the value at the lever
    movement, and the mean of the last second of the window.
    """
    mask = inside_window(time, criterion.window)
    t = time[mask]
    f, s = flight[criterion.channel][mask], model[criterion.channel][mask]
    demand_finite("flight", t, f)
    demand_finite("the model", t, s)
    if criterion.measure == "response_initial":
        times = [_crossing(t, y, y[0] + 0.1 * (_end(t, y) - y[0])) for y in (f, s)]
    else:
        level = 0.9 * _end(t, f) if _end(t, f) > f[0] else 0.1 * f[0]
        times = [_crossing(t, y, level) for y in (f, s)]
    for who, found in zip(("flight", "the model"), times, strict=True):
        if found is None:
            raise Invalid(f"{who} does not reach the level in the window")
    flight_time, model_time = (float(found) - float(t[0]) for found in times if found is not None)
    return scalar(criterion, flight_time, model_time, float(t[0]), f"flight {flight_time:.2f} s, model {model_time:.2f} s")


def _end(time: np.ndarray, y: np.ndarray) -> float:
    return float(y[time >= time[-1] - _LEVEL].mean())


def _crossing(time: np.ndarray, y: np.ndarray, level: float) -> float | None:
    """Return when `y` first passes `level`, linear between samples; None when it does not. [s]"""
    beyond = (y >= level) if y[0] < level else (y <= level)
    if not beyond.any() or beyond[0]:
        return None
    k = int(np.argmax(beyond))
    return float(time[k - 1] + (level - y[k - 1]) / (y[k] - y[k - 1]) * (time[k] - time[k - 1]))


def trend(criterion: Criterion, time: np.ndarray, flight: Signals, model: Signals) -> Outcome:
    """Compare direction and size of a change; the outcome is advice, the verdict an engineer's tick (rule R16)."""
    mask = inside_window(time, criterion.window)
    t, f, s = time[mask], flight[criterion.channel][mask], model[criterion.channel][mask]
    demand_finite("flight", t, f)
    demand_finite("the model", t, s)
    s = f + difference(criterion.channel, f, s)
    changes = [_shown(criterion.channel, float(y[-1] - y[0])) for y in (f, s)]
    correlation = float(np.corrcoef(f, s)[0, 1]) if np.ptp(f) > 0.0 and np.ptp(s) > 0.0 else float("nan")
    said = f"change of flight {changes[0]}, of model {changes[1]}, correlation {correlation:.2f}"
    return Outcome("advisory", note=f"{said}; to be ticked by an engineer")


def _shown(channel: str, value: float) -> str:
    unit = lookup(channel).display_units
    return f"{value / parse(unit)[1]:+.3g} {unit}"
