"""Marks of a panel besides its traces: judged values with their bands, and the fitted mode.

A criterion that judges one value, such as a distance, has no band along the record.  Its half width
is drawn around the value of the flight instead.
"""

from __future__ import annotations

from collections.abc import Hashable, Mapping, Sequence
from typing import Any, NamedTuple

import numpy as np

from flightmech.errors import UnitError, UnknownName
from flightmech.names import WRAPPED, lookup
from flightmech.units import parse_unit
from pom.judging.measures.damped_sine import fit_linear_part
from pom.judging.measures.modal import mode_table
from pom.judging.watched_channels import SLOWEST
from pom.report.presentation.quantities import QuantityLabel, fixed_decimals, pretty_unit
from pom.result import PomResult, to_records

FLOW_ANGLES = ("alpha", "beta", "gamma")
"""Angles without a meaning on an aeroplane at rest or on a slow one."""
# Measures of the value at one instant, and of the mean over the window.
_OF_INSTANT = ("end_value", "steady", "low_speed_end", "elapsed", "event_value")
_OF_WINDOW = ("segment_mean",)


class JudgedValue(NamedTuple):
    """Value of the flight that a criterion judges, with its half width. [display unit]

    ``start`` and ``stop`` [s] are equal for a value of one instant.
    """

    start: float
    stop: float
    centre: float
    half: float


class ModeMark(NamedTuple):
    """Fitted mode of the flight in a panel.

    Attributes
    ----------
    start, stop : float
        Window of the fit. [s]
    offset, slope, amplitude : float
        Mean of the oscillation at ``start``, its rate, and the amplitude there. [display unit]
    sigma : float
        Decay of the amplitude. [1/s]
    peaks : list of float
        The first two maxima of the fit, one period apart, or the first two minima if the window
        has one maximum.  Empty if it has neither. [s]
    words : str
        Period and damping as printed.
    """

    start: float
    stop: float
    offset: float
    slope: float
    amplitude: float
    sigma: float
    peaks: list[float]
    words: str

    def envelope(self, time: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Return the lower and the upper envelope (time,), NaN outside the window."""
        t = np.where((time >= self.start) & (time <= self.stop), time - self.start, np.nan)
        middle = self.offset + self.slope * t
        excursion = self.amplitude * np.exp(-self.sigma * t)
        return middle - excursion, middle + excursion


def judged_values(
    rows: Sequence[Mapping[Hashable, Any]],
    label: QuantityLabel,
    time: np.ndarray,
    flight: np.ndarray | None,
) -> list[JudgedValue]:
    """Return the judged values of a channel, each once.

    Parameters
    ----------
    rows : sequence of mapping
        Verdict rows of the channel.
    label : QuantityLabel
    time : array (time,)
        Clock of the record. [s]
    flight : array (time,) or None
        Trace of the flight. [display unit]
    """
    if flight is None:
        return []
    marks: dict[str, JudgedValue] = {}
    for row in rows:
        scale, measure = _scale_to_display(str(row["unit"]), label), row["measure"]
        # a width of another kind, such as a share of the distance, is not one of this panel
        if scale is None or not np.isfinite(row["width"]):
            continue
        half = scale * float(row["width"])
        instant = float(row["at"])
        if measure in _OF_INSTANT and np.isfinite(instant):
            value = float(np.interp(instant, time, flight))
            mark = JudgedValue(instant, instant, value, half)
        elif measure in _OF_WINDOW and np.isfinite(row["flight_value"]):
            window = (float(row["window_start"]), float(row["window_stop"]))
            mark = JudgedValue(*window, scale * float(row["flight_value"]), half)
        else:
            continue
        # A run of a model that ends after the flight's has a later instant: that of the flight is
        # the earliest.
        earlier = marks.get(row["criterion"], mark)
        marks[row["criterion"]] = min(earlier, mark)
    return sorted(set(marks.values()))


def _scale_to_display(unit: str, label: QuantityLabel) -> float | None:
    """Return the factor from the unit of a row to the unit of a panel; None for another kind."""
    if pretty_unit(unit) == label.unit:
        return 1.0
    try:
        dimension, factor, _ = parse_unit(unit)
        own, _, _ = parse_unit(lookup(label.name.rpartition(".")[2]).units)
    except (UnknownName, UnitError):
        return None
    # a share has the dimension of an angle, but it is not one
    if dimension != own or (not any(dimension) and unit not in ("deg", "rad")):
        return None
    return factor * label.factor


def flight_mode(
    result: PomResult, label: QuantityLabel, time: np.ndarray, flight: np.ndarray | None
) -> ModeMark | None:
    """Return the fitted mode of the flight in a channel; None without one."""
    if flight is None or label.name in WRAPPED:
        return None
    table = mode_table(result)
    is_flight = (table["channel"] == label.name) & (table["run"] == "flight")
    for row in to_records(table[is_flight]):
        if not np.isfinite(row["period"]) or not row["t_half"]:
            continue
        start, stop = float(row["window_start"]), float(row["window_stop"])
        inside = (time >= start) & (time <= stop)
        t, y = time[inside], flight[inside]
        if not len(t) or not np.isfinite(y).all():
            continue
        # Decay rate and damped frequency of the fitted mode; the linear part is fitted again.
        sigma, wd = np.log(2.0) / row["t_half"], 2.0 * np.pi / row["period"]
        offset, slope, amplitude, phase = fit_linear_part(t - t[0], y, sigma=sigma, wd=wd)
        words = (
            f"flight: period {fixed_decimals(row['period'], 2)} s, damping ratio "
            f"{fixed_decimals(row['damping_ratio'], 3)}"
        )
        return ModeMark(
            float(t[0]),
            float(t[-1]),
            offset=offset,
            slope=slope,
            amplitude=amplitude,
            sigma=float(sigma),
            peaks=_find_peaks(t, wd, phase),
            words=words,
        )
    return None


def _find_peaks(t: np.ndarray, wd: float, phase: float) -> list[float]:
    """Return two maxima or two minima of cos(wd (t - t[0]) + phase) inside the window. [s]"""
    period = 2.0 * np.pi / wd
    for extreme in (0.0, np.pi):
        first = float(t[0]) + float(np.mod(extreme - phase, 2.0 * np.pi)) / wd
        if first + period <= t[-1]:
            return [first, float(first + period)]
    return []


def is_too_slow(result: PomResult) -> dict[str, np.ndarray]:
    """Return where flow angles have no meaning, (time,) by run.

    A run without a speed has the samples of the flight.
    """
    signals = result.signals
    runs = list(map(str, signals["run"].values))
    for name in ("V_cas", "V"):
        if name not in signals:
            continue
        speeds = dict(zip(runs, signals.variables[name].values, strict=True))
        slow = {}
        for run, speed in speeds.items():
            known = speed if np.isfinite(speed).any() else speeds.get("flight", speed)
            # NaN compares as not slow
            with np.errstate(invalid="ignore"):
                slow[run] = known < SLOWEST
        return slow
    return {}
