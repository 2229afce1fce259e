"""Signals of a flight or a model by canonical name, and quantities derived from them.

The same formulas apply to flight and model.  Distances and deviations start at the first sample of
the replay in both.
"""

from __future__ import annotations

import re
from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass, field, replace
from functools import cached_property
from typing import Any

import numpy as np
import scipy
import xarray as xr

from flightmech.names import lookup
from flightmech.quantities import time_text
from flightmech.units import KNOT
from pom.cases.case import PomCase
from pom.tolerances.bands import Invalid, NotJudged, RowRemark, demand_finite, inside_window
from pom.tolerances.channels import SOURCES, channel_value_text, output_of
from pom.tolerances.conditions import sample_mask
from pom.tolerances.criteria import ACTS, DISCRETES, LEVELS, Criterion

Raw = Mapping[str, np.ndarray]

_FLOW = re.compile(r"^engine\d+\.fuel_flow$")


class RunSignals(Mapping[str, np.ndarray]):
    """Samples of one run by canonical name, recorded or derived from recorded signals. [SI]

    Parameters
    ----------
    raw : mapping of str to array (time,)
        Recorded signals. [SI]
    time : array (time,)
        [s]
    wheel_radius : float, optional
        Radius of the control wheel, which converts its torque into the force at the rim. [m]
    """

    def __init__(self, raw: Raw, time: np.ndarray, wheel_radius: float | None = None):
        self.raw: Raw = raw.raw if isinstance(raw, RunSignals) else raw
        self.time: np.ndarray = time
        self.wheel_radius: float | None = wheel_radius
        self._derived: dict[str, np.ndarray] = {}

    def __getitem__(self, name: str) -> np.ndarray:
        source = output_of(name, self.raw)
        if source in self.raw:
            return self.raw[source]
        if name not in self._derived:
            if name not in self:
                raise KeyError(name)
            self._derived[name] = _RECIPES[name](self)
        return self._derived[name]

    def __contains__(self, name: object) -> bool:
        if not isinstance(name, str):
            return False
        if output_of(name, self.raw) in self.raw:
            return True
        if name == "F_rim" and self.wheel_radius is None:
            return False
        # the sources may be derived signals themselves
        return name in _RECIPES and all(source in self for source in SOURCES[name])

    def __iter__(self) -> Iterator[str]:
        return iter(self.raw)

    def __len__(self) -> int:
        return len(self.raw)

    @cached_property
    def fuel_flow(self) -> dict[str, np.ndarray]:
        """Fuel flow by engine. [kg s-1]"""
        return {name: values for name, values in self.raw.items() if _FLOW.match(name)}


def signals_of_run(case: PomCase, raw: Raw, time: np.ndarray) -> RunSignals:
    """Return the signals of one run of a case.

    Signals of the same samples are returned unchanged, with the signals derived before.
    """
    radius = case.conditions.get("wheel_radius")
    if isinstance(raw, RunSignals) and raw.time is time and raw.wheel_radius == radius:
        return raw
    return RunSignals(raw, time, radius)


def traces_of(signals: xr.Dataset, run: str) -> dict[str, np.ndarray]:
    """Return the channels of one run of a result that have a finite sample. [SI]"""
    index = _run_index(signals, run)
    traces = {}
    for name in signals.data_vars:
        values = signals.variables[name].values[index]
        if np.isfinite(values).any():
            traces[str(name)] = values
    return traces


def trace_of(signals: xr.Dataset, run: str, name: str) -> np.ndarray:
    """Return a channel of one run of a result (time,). [SI]"""
    return signals.variables[name].values[_run_index(signals, run)]


def _run_index(signals: xr.Dataset, run: str) -> int:
    # `sel` of xarray takes longer than most measures
    return signals.variables["run"].values.tolist().index(run)


def _integral(rate: np.ndarray, time: np.ndarray) -> np.ndarray:
    return scipy.integrate.cumulative_trapezoid(rate, time, initial=0.0)


def _deviation(signals: RunSignals) -> np.ndarray:
    """Return the distance to the right of the line along which the run started (time,). [m]"""
    vn, ve = signals["vn"], signals["ve"]
    # The mean over the first second gives the direction of the runway.
    early = signals.time <= signals.time[0] + 1.0
    along_n, along_e = float(vn[early].mean()), float(ve[early].mean())
    speed = np.hypot(along_n, along_e) or 1.0
    # Velocity across: component along the unit vector (-along_e, along_n) / speed, right positive.
    return _integral((ve * along_n - vn * along_e) / speed, signals.time)


def _heading_rate(signals: RunSignals) -> np.ndarray:
    """Return the rate of heading (time,). [rad s-1]"""
    # psi' = (q sin phi + r cos phi) / cos theta
    q, r, phi = signals["q"], signals["r"], signals["phi"]
    return (q * np.sin(phi) + r * np.cos(phi)) / np.cos(signals["theta"])


_RECIPES: dict[str, Callable[[RunSignals], np.ndarray]] = {
    "time": lambda s: s.time,
    "V_ground": lambda s: np.hypot(s["vn"], s["ve"]),
    "distance": lambda s: _integral(s["V_ground"], s.time),
    "y_runway": _deviation,
    "psi_dot": _heading_rate,
    "fuel_used": lambda s: _integral(np.sum(list(s.fuel_flow.values()), axis=0), s.time),
    "F_rim": lambda s: s["F_wheel"] / s.wheel_radius,
}
WHO = ("flight", "the model")


@dataclass(frozen=True)
class Comparison:
    """Flight and one model on the clock of the record.

    Attributes
    ----------
    case : PomCase
        Source of events, features and certified values.
    time : array (time,)
        [s]
    flight, model : RunSignals
        [SI]
    """

    case: PomCase
    time: np.ndarray
    flight: RunSignals
    model: RunSignals
    _flight_results: dict[Any, Any] = field(default_factory=dict, repr=False, compare=False)

    @classmethod
    def of(cls, case: PomCase, time: np.ndarray, flight: Raw, model: Raw) -> Comparison:
        """Return the comparison of two runs by canonical name."""
        return cls(
            case,
            time,
            flight=signals_of_run(case, flight, time),
            model=signals_of_run(case, model, time),
        )

    def against(self, model: Raw) -> Comparison:
        """Return the comparison of the same flight and another model.

        Both comparisons share the results of `once`.
        """
        return replace(self, model=signals_of_run(self.case, model, self.time))

    def once(self, key: Any, compute: Callable[[], Any]) -> Any:
        """Return a result that depends on case and flight only, computed for the first model."""
        if key not in self._flight_results:
            self._flight_results[key] = compute()
        return self._flight_results[key]

    def both(
        self, criterion: Criterion, channel: str = ""
    ) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Return time, flight and model over the samples that a criterion counts.

        The arrays of time and flight are read-only, since all models share them.

        Raises
        ------
        Invalid
            The record is short, time does not rise, or a value is missing.
        """
        # Criteria with the same window and condition share the mask and the flight values.
        samples, channel = (criterion.window, criterion.condition), channel or criterion.channel
        mask = self.once(
            samples, lambda: inside_window(self.time, criterion.window) & self.counted(criterion)
        )
        time, flight = self.once((samples, channel), lambda: self._select_flight(mask, channel))
        model = self.model[channel][mask]
        demand_finite(WHO[1], time, model)
        return time, flight, model

    def _select_flight(self, mask: np.ndarray, channel: str) -> tuple[np.ndarray, np.ndarray]:
        time, flight = self.time[mask], self.flight[channel][mask]
        demand_finite(WHO[0], time, flight)
        time.flags.writeable = flight.flags.writeable = False
        return time, flight

    def over(self, mask: np.ndarray, channel: str) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Return time, flight and model over the samples of a mask."""
        time, flight, model = self.time[mask], self.flight[channel][mask], self.model[channel][mask]
        for who, values in zip(WHO, (flight, model), strict=True):
            demand_finite(who, time, values)
        return time, flight, model

    def counted(self, criterion: Criterion) -> np.ndarray:
        """Return the mask of the samples at which the flight meets the condition of the row.

        A row without a condition counts all samples.
        """
        if not criterion.condition:
            return np.ones(self.time.size, bool)
        mask = sample_mask(criterion.condition, self.case.events, self.time, self.flight)
        if not mask[inside_window(self.time, criterion.window)].any():
            raise NotJudged(f"no sample of the window has {criterion.condition}")
        return mask


STANDING = KNOT
"""Ground speed at standstill; the noise of an inertial unit is much smaller. [m s-1]"""


@dataclass(frozen=True)
class Instant:
    """Time of one event in flight and model [s], and remarks on its detection."""

    flight: float
    model: float
    remarks: tuple[RowRemark, ...] = ()


def event_time(match: Comparison, event: str) -> float:
    """Return the time of an event that the case has to give. [s]"""
    if event not in match.case.events:
        raise NotJudged(f"give the event {event} in [events]")
    return match.case.events[event]


def find_event(match: Comparison, event: str, excluded: str = "") -> Instant:
    """Return the time of an event in flight and model.

    Parameters
    ----------
    match : Comparison
    event : str
    excluded : str
        Channel that is compared and therefore may not indicate the event.

    Raises
    ------
    NotJudged
        The case does not give the event, or no signal indicates it.
    Invalid
        The event lies outside the replay, or the model does not reach it.
    """
    # the time of the case file, on the clock of both runs
    stated = match.case.events.get(event)
    if stated is not None and not match.time[0] - 1e-9 <= stated <= match.time[-1] + 1e-9:
        raise Invalid(
            f"{event} is at {time_text(stated)} s, outside the replay, {time_text(match.time[0])} "
            "... "
            f"{time_text(match.time[-1])} s"
        )
    # Pilot or record cause these events, so both runs have them at the same time.
    if event in ACTS:
        time = event_time(match, event)
        return Instant(time, time)
    if stated is not None and stated <= match.time[1]:
        remark = RowRemark("event", f"the replay starts at {event}", event)
        return Instant(stated, stated, (remark,))
    # A discrete of the model has priority over the level of a signal.
    names = DISCRETES.get(event, ())
    if names and all(name in match.model for name in names):
        return _find_discrete_event(match, event, names)
    return _find_level_event(match, event, names=names, excluded=excluded)


def _find_level_event(
    match: Comparison, event: str, *, names: tuple[str, ...], excluded: str
) -> Instant:
    """Return an event at which a channel passes the level that it has in flight."""
    channel, direction = LEVELS.get(event, ("", 0))
    is_common = channel in match.flight and channel in match.model
    if not channel or channel == excluded or not is_common:
        signals = [name for name in (*names, channel) if name and name != excluded]
        raise NotJudged(
            f"{event} is detected by {' or '.join(signals) or 'a signal'}, and flight and "
            f"model do not both have it"
        )
    time = event_time(match, event)
    level = level_at(match, event, time)
    passage = crossing_time(match.time, match.model[channel], level, direction=direction)
    text = channel_value_text(channel, level)
    if passage is None:
        raise Invalid(f"the model does not come to {event} ({text}) in the record")
    remark = RowRemark(
        "event",
        f"{event} at {text}",
        quantity=channel,
        values={"level": level},
        unit=lookup(channel).units,
    )
    return Instant(time, passage, (remark,))


def level_at(match: Comparison, event: str, time: float) -> float:
    """Return the level of the signal of an event: its flight value at the event. [SI]

    For a full stop it is the ground speed at standstill.
    """
    if event == "full_stop":
        return STANDING
    channel, _ = LEVELS[event]
    return float(np.interp(time, match.time, match.flight[channel]))


def _find_discrete_event(match: Comparison, event: str, names: tuple[str, ...]) -> Instant:
    """Return an event that discretes indicate; the case file may give the time of the flight."""
    flight = _first_switch_on(match, match.flight, names)
    model = _first_switch_on(match, match.model, names)
    if model is None:
        raise Invalid(
            f"the model does not come to {event} in the record ({' and '.join(names)} stay off)"
        )
    if flight is None or event in match.case.events:
        flight = event_time(match, event)
    return Instant(flight, model, (RowRemark("event", f"{event} by {' or '.join(names)}", event),))


def _first_switch_on(
    match: Comparison, signals: RunSignals, names: tuple[str, ...]
) -> float | None:
    """Return the time at which the first of several discretes turns on. [s]

    None if none turns on, or if a discrete is missing.
    """
    for name in names:
        if name not in signals:
            return None
    # the largest of the discretes jumps with the first one
    any_on = np.max([signals[name] for name in names], axis=0)
    return crossing_time(match.time, any_on, 0.5, direction=1)


def crossing_time(
    time: np.ndarray, y: np.ndarray, level: float, direction: int, start: float = -np.inf
) -> float | None:
    """Return the time at which `y` first passes `level`, linear between samples. [s]

    The direction is 1 for upwards, -1 for downwards.  None if `y` does not pass the level.  A
    signal beyond the level from the start does not pass it.
    """
    is_beyond = direction * (y - level) >= 0.0
    passes = np.flatnonzero(~is_beyond[:-1] & is_beyond[1:] & (time[1:] >= start - 1e-9))
    if not passes.size:
        return None
    # y passes the level between samples k and k + 1
    k = int(passes[0])
    return float(time[k] + (level - y[k]) / (y[k + 1] - y[k]) * (time[k + 1] - time[k]))
