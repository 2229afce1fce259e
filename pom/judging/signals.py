"""The signals of a flight or of a model by canonical name, and the quantities that are formed of
them.

Flight and model are formed alike: distances and deviations begin at the first sample of the replay
in both.
"""

from __future__ import annotations

import re
from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass, field, replace
from functools import cached_property
from typing import Any

import numpy as np
import xarray as xr
from scipy.integrate import cumulative_trapezoid

from flightmech.names import lookup
from flightmech.units import KNOT
from pom.cases.case import PomCase
from pom.tolerances.bands import Invalid, NotJudged, RowRemark, demand_finite, inside_window
from pom.tolerances.channels import SOURCES, channel_value_text, output_of
from pom.tolerances.conditions import sample_mask
from pom.tolerances.criteria import ACTS, DISCRETES, LEVELS, Criterion

Raw = Mapping[str, np.ndarray]

_FLOW = re.compile(r"^engine\d+\.fuel_flow$")


class RunSignals(Mapping[str, np.ndarray]):
    """Samples of one run by canonical name; what is not recorded but can be formed is formed. [SI]

    Parameters
    ----------
    raw : mapping of str to array (time,)
    time : array (time,)
        [s]
    wheel_radius : float, optional
        Turns the torque on the control wheel into the force at its rim. [m]
    """

    def __init__(self, raw: Raw, time: np.ndarray, wheel_radius: float | None = None):
        self.raw: Raw = raw.raw if isinstance(raw, RunSignals) else raw
        self.time: np.ndarray = time
        self.wheel_radius: float | None = wheel_radius
        self._formed: dict[str, np.ndarray] = {}

    def __getitem__(self, name: str) -> np.ndarray:
        source = output_of(name, self.raw)
        if source in self.raw:
            return self.raw[source]
        if name not in self._formed:
            if name not in self:
                raise KeyError(name)
            self._formed[name] = _RECIPES[name](self)
        return self._formed[name]

    def __contains__(self, name: object) -> bool:
        if not isinstance(name, str):
            return False
        if output_of(name, self.raw) in self.raw:
            return True
        if name == "F_rim" and self.wheel_radius is None:
            return False
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
    """Return the signals of one run of a case; those of the same samples as they are, with what was
    formed of them.
    """
    if (
        isinstance(raw, RunSignals)
        and raw.time is time
        and raw.wheel_radius == case.conditions.get("wheel_radius")
    ):
        return raw
    return RunSignals(raw, time, case.conditions.get("wheel_radius"))


def traces_of(signals: xr.Dataset, run: str) -> dict[str, np.ndarray]:
    """Return the channels of one run of a result that hold a number anywhere. [SI]"""
    place = signals.variables["run"].values.tolist().index(run)
    traces = {str(name): signals.variables[name].values[place] for name in signals.data_vars}
    return {name: values for name, values in traces.items() if np.isfinite(values).any()}


def trace_of(signals: xr.Dataset, run: str, name: str) -> np.ndarray:
    """Return a channel of one run of a result (time,); ``sel`` takes longer than most measures.
    [SI]
    """
    return signals.variables[name].values[signals.variables["run"].values.tolist().index(run)]


def _integral(rate: np.ndarray, time: np.ndarray) -> np.ndarray:

    return cumulative_trapezoid(rate, time, initial=0.0)


def _deviation(s: RunSignals) -> np.ndarray:
    """Return the distance to the right of the line along which the run started. [m]"""
    vn, ve = s["vn"], s["ve"]
    early = s.time <= s.time[0] + 1.0
    along_n, along_e = float(vn[early].mean()), float(ve[early].mean())
    size = np.hypot(along_n, along_e) or 1.0
    return _integral((ve * along_n - vn * along_e) / size, s.time)


_RECIPES: dict[str, Callable[[RunSignals], np.ndarray]] = {
    "time": lambda s: s.time,
    "V_ground": lambda s: np.hypot(s["vn"], s["ve"]),
    "distance": lambda s: _integral(s["V_ground"], s.time),
    "y_runway": _deviation,
    "psi_dot": lambda s: (
        (s["q"] * np.sin(s["phi"]) + s["r"] * np.cos(s["phi"])) / np.cos(s["theta"])
    ),
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
        Gives events, features and certified values.
    time : array (time,)
        [s]
    flight, model : Signals
        [SI]
    """

    case: PomCase
    time: np.ndarray
    flight: RunSignals
    model: RunSignals
    _of_flight: dict[Any, Any] = field(default_factory=dict, repr=False, compare=False)

    @classmethod
    def of(cls, case: PomCase, time: np.ndarray, flight: Raw, model: Raw) -> Comparison:
        """Return the match of two runs by canonical name."""
        return cls(
            case, time, signals_of_run(case, flight, time), signals_of_run(case, model, time)
        )

    def against(self, model: Raw) -> Comparison:
        """Return the match of the same flight and another model; what depends on the flight alone
        is not computed again.
        """
        return replace(self, model=signals_of_run(self.case, model, self.time))

    def once(self, key: Any, of_flight: Callable[[], Any]) -> Any:
        """Return what depends on case and flight alone, computed for the first of the models only."""
        if key not in self._of_flight:
            self._of_flight[key] = of_flight()
        return self._of_flight[key]

    def both(
        self, criterion: Criterion, channel: str = ""
    ) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Return time, flight and model over the samples that a criterion counts; those of the
        flight are not to be changed.

        Raises
        ------
        Invalid
            The record is short, time does not rise, or a value is missing.
        """
        place, channel = (criterion.window, criterion.condition), channel or criterion.channel
        mask = self.once(
            place, lambda: inside_window(self.time, criterion.window) & self.counted(criterion)
        )
        time, flight = self.once((place, channel), lambda: self._checked(mask, channel))
        model = self.model[channel][mask]
        demand_finite(WHO[1], time, model)
        return time, flight, model

    def _checked(self, mask: np.ndarray, channel: str) -> tuple[np.ndarray, np.ndarray]:
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
        """Return the samples at which the condition of the row holds in flight; all when it has
        none on samples.
        """
        if not criterion.condition:
            return np.ones(self.time.size, bool)
        mask = sample_mask(criterion.condition, self.case.events, self.time, self.flight)
        if not mask[inside_window(self.time, criterion.window)].any():
            raise NotJudged(f"no sample of the window has {criterion.condition}")
        return mask


STANDING = KNOT
"""Ground speed below which an aeroplane stands; the noise of an inertial unit lies well below. [m s-1]"""


@dataclass(frozen=True)
class Instant:
    """One event in both records [s], and how it was found."""

    flight: float
    model: float
    remarks: tuple[RowRemark, ...] = ()


def event_time(match: Comparison, event: str) -> float:
    """Return the time of an event that the case has to give. [s]"""
    if event not in match.case.events:
        raise NotJudged(f"give the event {event} in [events]")
    return match.case.events[event]


def find_event(match: Comparison, event: str, excluded: str = "") -> Instant:
    """Return when an event happens in flight and model.

    Parameters
    ----------
    match : Match
    event : str
    excluded : str
        Channel that is compared and therefore may not indicate the event.

    Raises
    ------
    NotJudged
        The case does not give the event, or no signal indicates it.
    Invalid
        It lies outside the replay, or the model does not come to it.
    """
    given = match.case.events.get(event)
    if given is not None and not match.time[0] - 1e-9 <= given <= match.time[-1] + 1e-9:
        raise Invalid(
            f"{event} is at {given:g} s, outside the replay, {match.time[0]:g} ... "
            f"{match.time[-1]:g} s"
        )
    if event in ACTS:
        time = event_time(match, event)
        return Instant(time, time)
    if given is not None and given <= match.time[1]:
        return Instant(given, given, (RowRemark("event", f"the replay starts at {event}", event),))
    names = DISCRETES.get(event, ())
    if names and all(name in match.model for name in names):
        return _by_discrete(match, event, names)
    channel, direction = LEVELS.get(event, ("", 0))
    if (
        not channel
        or channel == excluded
        or channel not in match.flight
        or channel not in match.model
    ):
        signals = [name for name in (*names, channel) if name and name != excluded]
        raise NotJudged(
            f"{event} is detected by {' or '.join(signals) or 'a signal'}, and flight and "
            f"model do not both have it"
        )
    time = event_time(match, event)
    level = level_at(match, event, time)
    reached = crossing_time(match.time, match.model[channel], level, direction)
    if reached is None:
        raise Invalid(
            f"the model does not come to {event} ({channel_value_text(channel, level)}) in "
            f"the record"
        )
    remark = RowRemark(
        "event",
        f"{event} at {channel_value_text(channel, level)}",
        channel,
        {"level": level},
        lookup(channel).units,
    )
    return Instant(time, reached, (remark,))


def level_at(match: Comparison, event: str, time: float) -> float:
    """Return the level of the signal of an event: what the flight has at the event; for a full stop
    that of standing still. [SI]
    """
    return (
        STANDING
        if event == "full_stop"
        else float(np.interp(time, match.time, match.flight[LEVELS[event][0]]))
    )


def _by_discrete(match: Comparison, event: str, names: tuple[str, ...]) -> Instant:
    """Return an event that a discrete indicates; the flight's is as given where the case gives it."""
    flight, model = (_jump(match, signals, names) for signals in (match.flight, match.model))
    if model is None:
        raise Invalid(
            f"the model does not come to {event} in the record ({' and '.join(names)} stay off)"
        )
    if flight is None or event in match.case.events:
        flight = event_time(match, event)
    return Instant(flight, model, (RowRemark("event", f"{event} by {' or '.join(names)}", event),))


def _jump(match: Comparison, signals: RunSignals, names: tuple[str, ...]) -> float | None:
    """Return when the first of several discretes comes on; None when none does, or one is not
    there. [s]
    """
    if not all(name in signals for name in names):
        return None
    return crossing_time(match.time, np.max([signals[name] for name in names], axis=0), 0.5, 1)


def crossing_time(
    time: np.ndarray, y: np.ndarray, level: float, direction: int, start: float = -np.inf
) -> float | None:
    """Return when `y` first passes `level` upwards (1) or downwards (-1), linear between samples;
    None when it does not. [s]

    A signal that is beyond the level from the start has not passed it.
    """
    beyond = direction * (y - level) >= 0.0
    passed = np.flatnonzero(~beyond[:-1] & beyond[1:] & (time[1:] >= start - 1e-9))
    if not passed.size:
        return None
    k = int(passed[0])
    return float(time[k] + (level - y[k]) / (y[k + 1] - y[k]) * (time[k + 1] - time[k]))
