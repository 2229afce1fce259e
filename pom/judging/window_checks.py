"""Checks of the window of a case against the recorded motion and the recorded controls.

The model is trimmed to the start of the window, so the flight has to be steady there.  A window
that ends inside the input leaves its return out.  Period and damping are measured from the end of
the input on: a later instant leaves the first, largest oscillation out, an earlier one measures the
answer to the input as a free response.
"""

from __future__ import annotations

from collections.abc import Collection
from dataclasses import dataclass

import numpy as np
import scipy
import xarray as xr

from flightmech.quantities import time_text
from flightmech.support.arrays import true_runs
from flightmech.units import DEGREE
from pom.cases.case import PomCase
from pom.cases.drafting.event_detection import input_channels
from pom.judging.conditions.condition_checks import FORCED, MOVED, SMOOTH
from pom.judging.signals import RunSignals
from pom.status import CASE_WINDOW
from pom.tolerances.bands import RowRemark
from pom.tolerances.channels import channel_value_text, plain_id, quantity_words

INPUT_END = "input_end"
_MODES = ("period", "t_half", "damping_ratio", "period_n", "overshoot_n", "overshoot_count")
_CONTROLS = {"delta_e": "elevator", "delta_a": "aileron", "delta_r": "rudder"}
SHARE = 0.2
"""Share of the largest deflection within which a control has come to rest.

The pilot of a real record holds a control within some tenths of its pulse.
"""
LATE = (1.0, 0.1)
"""Time that a stated end may come after the rest: [s], and share of the free response."""
WINDOW = "window_departures"
"""Attribute of flight states: departures of the window, which need the whole record."""
WINDOW_UNCHECKED = "window_unchecked"
"""Attribute of flight states: what the record does not show of the window."""
_ATTITUDE = ("phi", "theta", "p", "q", "r")
_FORCES = ("F_column", "F_wheel", "F_rim", "F_pedal")
MOTION = (*_ATTITUDE, *_CONTROLS, "wheel", *_FORCES)
"""Channels that the checks of a window use, as far as a record has them."""
_LIMITS = {**dict.fromkeys((*_CONTROLS, "wheel"), MOVED), **FORCED}
_RESPONSES = ("2.b.4", "2.b.5", "2.b.6", "2.c.10", "2.c.9", "2.d.2", "2.d.3", "2.d.6", "2.d.7")
"""Tests that start from a trim and are excited by an input, which the pilot takes back."""
BEFORE = 0.5  # [s] of flight before the window that has to be steady
STEADY = 1.0 * DEGREE
"""Steady rates of attitude [rad s-1] and changes of the yaw rate in `BEFORE`.

Our number: the largest at the starts of the shipped cases is 0.5 deg/s.
"""
OF_WINDOW = 0.1  # share of the largest in the window: turbulence before a large input is allowed
PAUSE = 0.5  # [s] a control that passes its trim position within this time is still moved
RETURN = 2.0  # [s] a later return belongs to this input only if the input has lasted as long


def input_end_remarks(case: PomCase, flight: RunSignals) -> tuple[RowRemark, ...]:
    """Return the departure of a stated end of the input; empty if it fits or nothing shows it.

    Parameters
    ----------
    case : PomCase
    flight : RunSignals
        Over the window of the case. [SI]
    """
    stated = case.events.get(INPUT_END)
    is_used = any(
        item.applies and item.measure in _MODES and INPUT_END in item.bounds
        for item in case.criteria
    )
    if stated is None or not is_used or case.reference != "flight":
        return ()
    found = _find_rest(flight)
    if found is None:
        return ()
    control, rest = found
    stop = float(flight.time[-1])
    allowed = max(LATE[0], LATE[1] * (stop - rest))
    if stated < rest - SMOOTH:
        text = (
            f"the input ends at {time_text(stated)} s in the case, the {control} moves until "
            f"{rest:.1f} s: "
            f"what is measured is not a free response"
        )
    elif stated > rest + allowed:
        text = (
            f"the input ends at {time_text(stated)} s in the case, the {control} is at rest from "
            f"{rest:.1f} s on: the first part of the free response is left out"
        )
    else:
        return ()
    return (RowRemark("departure", f"departure: {text}", INPUT_END),)


def _find_rest(flight: RunSignals) -> tuple[str, float] | None:
    """Return the control that moves most, and when it comes to rest [s]; None if none moves."""
    time = flight.time
    if time.size < 2:
        return None
    width = max(1, round(SMOOTH / float(np.median(np.diff(time)))))
    best: tuple[str, np.ndarray] | None = None
    most = MOVED
    for name, control in _CONTROLS.items():
        if name not in flight:
            continue
        values = np.asarray(flight[name], float)
        smooth = scipy.ndimage.uniform_filter1d(values, width, mode="nearest")
        # from the position in the last part of the window
        away = np.abs(smooth - np.median(smooth[-max(1, time.size // 4) :]))
        if np.isfinite(away).all() and away.max() > most:
            best, most = (control, away), float(away.max())
    if best is None:
        return None
    control, away = best
    return control, float(time[np.flatnonzero(away > SHARE * most)[-1]])


@dataclass(frozen=True)
class WindowCheck:
    """What a flight record shows of the window of a case.

    Attributes
    ----------
    departures : tuple of str
        Departures from normal practice.
    unchecked : tuple of str
        What the record does not show, with the reason.
    """

    departures: tuple[str, ...] = ()
    unchecked: tuple[str, ...] = ()


@dataclass(frozen=True)
class _Motion:
    """Motion and controls of a record.

    Attributes
    ----------
    time : array (time,)
        [s]
    channels : dict of str to array (time,)
        Means over `SMOOTH`, interpolated where samples are missing. [SI]
    missing : dict of str to array of bool (time,)
        Samples in a hole longer than `SMOOTH`.
    """

    time: np.ndarray
    channels: dict[str, np.ndarray]
    missing: dict[str, np.ndarray]

    def known(self, name: str, start: float, stop: float) -> bool:
        """Return whether a channel has samples throughout a time."""
        part = (self.time >= start - 1e-9) & (self.time <= stop + 1e-9)
        return name in self.channels and not self.missing[name][part].any()

    def recorded(self, name: str) -> np.ndarray:
        """Return the samples (time,) with a channel; an attitude rate has all that give it."""
        if name in ("theta", "phi"):
            return ~np.logical_or.reduce([self.missing[x] for x in _ATTITUDE])
        return ~self.missing[name]


def check_window(case: PomCase, states: xr.Dataset) -> WindowCheck:
    """Return whether a window starts in steady flight and ends after the input of a response.

    Parameters
    ----------
    case : PomCase
    states : Dataset (time,)
        Motion and controls of the whole record, those of `MOTION` that it has. [SI]

    Returns
    -------
    WindowCheck
        The model is trimmed to the start of the window, so that only flights that start from a
        trim are checked.
    """
    time = np.asarray(states["time"].values, float)
    if case.reference != "flight" or case.drive.trim is not True or time.size < 2:
        return WindowCheck()
    motion = _read_motion(case, states)
    departures: list[str] = []
    unchecked: list[str] = []
    for check in (_unsteady_start, _open_input):
        found = check(case, motion)
        departures += found.departures
        unchecked += found.unchecked
    return WindowCheck(tuple(departures), tuple(unchecked))


def window_departures(case: PomCase, states: xr.Dataset) -> tuple[str, ...]:
    """Return the departures of `check_window`."""
    return check_window(case, states).departures


def with_window_check(states: xr.Dataset, case: PomCase, record: xr.Dataset) -> xr.Dataset:
    """Return flight states with the check of the window against the whole record as attributes."""
    check = check_window(case, record)
    return states.assign_attrs({WINDOW: check.departures, WINDOW_UNCHECKED: check.unchecked})


def window_remarks(states: xr.Dataset) -> tuple[RowRemark, ...]:
    """Return the attributes of `with_window_check` as remarks."""
    remarks = []
    for text in states.attrs.get(WINDOW, ()):
        remarks.append(RowRemark("departure", f"departure: {text}", CASE_WINDOW))
    for text in states.attrs.get(WINDOW_UNCHECKED, ()):
        remarks.append(RowRemark("not_checked", f"not checked: {text}", CASE_WINDOW))
    return tuple(remarks)


def _read_motion(case: PomCase, states: xr.Dataset) -> _Motion:
    """Return the channels of `MOTION` that a record has, with the wheel force at the rim."""
    time = np.asarray(states["time"].values, float)
    width = max(1, round(SMOOTH / float(np.median(np.diff(time)))))
    recorded = {}
    for name in MOTION:
        if name in states and states.variables[name].dims == ("time",):
            recorded[name] = np.asarray(states.variables[name].values, float)
    # the limits are forces, which a torque gives with the radius of the wheel
    torque, radius = recorded.pop("F_wheel", None), case.conditions.get("wheel_radius")
    if torque is not None and radius:
        recorded.setdefault("F_rim", torque / radius)
    channels, missing = {}, {}
    for name, values in recorded.items():
        finite = np.isfinite(values)
        if not finite.any():
            continue
        filled = np.interp(time, time[finite], values[finite])
        channels[name] = scipy.ndimage.uniform_filter1d(filled, width, mode="nearest")
        missing[name] = np.zeros(len(time), bool)
        for first, end in true_runs(~finite):
            # the mean bridges a shorter hole
            missing[name][first:end] = end - first > width
    return _Motion(time, channels, missing)


def _unsteady_start(case: PomCase, motion: _Motion) -> WindowCheck:
    """Return whether a window starts in unsteady flight."""
    start, stop = case.window
    time, channels = motion.time, motion.channels
    rates = _attitude_rates(channels)
    inside = (time >= start) & (time <= stop)
    if not inside.any():
        return WindowCheck()
    limits: dict[str, float] = {}
    for name, rate in rates.items():
        limits[name] = max(STEADY, OF_WINDOW * float(np.abs(rate[inside]).max()))
    if "r" in channels:
        limits["r"] = max(STEADY, OF_WINDOW * float(np.ptp(channels["r"][inside])))
    for name, least in _LIMITS.items():
        if name in channels:
            limits[name] = max(least, OF_WINDOW * float(np.ptp(channels[name][inside])))

    def movements(instant: float) -> list[str]:
        first, last = _time_before(instant, motion)
        part = (time >= first - 1e-9) & (time <= last + 1e-9)
        texts = []
        for name, limit in limits.items():
            # the line through missing samples does not show the movement
            shown = part & motion.recorded(name)
            if not shown.any():
                continue
            values = rates[name][shown] if name in rates else channels[name][shown]
            size = float(np.abs(values).max() if name in rates else np.ptp(values))
            if size > limit:
                texts.append(_movement_text(name, size))
        return texts

    def is_steady(instant: float) -> bool:
        # The attitude shows whether the flight is steady.  A hole in a control only leaves this
        # control unchecked.
        needed = [name for name in _ATTITUDE if name in channels]
        known = all(motion.known(name, *_time_before(instant, motion)) for name in needed)
        return known and not movements(instant)

    names = [*_ATTITUDE, *(name for name in _LIMITS if name in channels)]
    unchecked = _missing_at(start, f"{time_text(start)} s, where the window starts", names, motion)
    moving = movements(start)
    if not moving:
        return WindowCheck((), unchecked)
    text = (
        f"the window starts at {time_text(start)} s in unsteady flight, to which the model is "
        "trimmed: "
        f"{', '.join(moving)}; "
    )
    before, after = start, start
    while before > time[0] and not is_steady(before):
        before -= 0.1
    # a movement begins before it is larger than its limit
    before -= 0.1
    while after < stop and not is_steady(after):
        after += 0.1
    is_later = after < stop and _holds_input(case, motion, after)
    # channels that the record never has are already listed for the start of the window
    names = list(channels)
    if before > time[0]:
        unchecked += _missing_at(before, f"{before:.1f} s, the earlier start", names, motion)
    if is_later:
        unchecked += _missing_at(after, f"{after:.1f} s, the later start", names, motion)
    if before > time[0] and is_later:
        text += f"the flight is steady until {before:.1f} s, and from {after:.1f} s on"
    elif before > time[0]:
        text += f"the flight is steady until {before:.1f} s: start there or earlier"
    elif is_later:
        text += f"the flight is steady from {after:.1f} s on: start there or later"
    else:
        text += "choose a record with steady flight before the input"
    return WindowCheck((text,), unchecked)


def _missing_at(
    instant: float, place: str, names: Collection[str], motion: _Motion
) -> tuple[str, ...]:
    """Return what missing samples of some channels leave unchecked at an instant; empty if none."""
    unknown = [name for name in names if not motion.known(name, *_time_before(instant, motion))]
    if not unknown:
        return ()
    text = (
        f"whether the flight is steady at {place}: the record has no {', '.join(unknown)} there; "
        f"only the other channels are checked"
    )
    return (text,)


def _time_before(instant: float, motion: _Motion) -> tuple[float, float]:
    """Return start and end of the flight that shows whether an instant is steady. [s]"""
    if instant - BEFORE < motion.time[0]:
        # a record that starts with the window shows its first samples only
        return instant, instant + SMOOTH
    return instant - BEFORE, instant


def _holds_input(case: PomCase, motion: _Motion, start: float) -> bool:
    """Return whether a window that starts later still has the input of its response."""
    if not plain_id(case.id).startswith(_RESPONSES):
        return True
    time = motion.time
    earlier = (time >= case.window[0] - BEFORE) & (time <= case.window[1])
    later = (time >= start) & (time <= case.window[1])
    for name in _input_names(case):
        if name not in motion.channels or not later.any():
            continue
        values = motion.channels[name]
        # more than half of the movement of the control is still to come
        size = float(np.ptp(values[later]))
        if size > max(_LIMITS[name], 0.5 * float(np.ptp(values[earlier]))):
            return True
    return False


def _input_names(case: PomCase) -> list[str]:
    """Return the controls that may be the input of a test and have a limit."""
    names = ["F_rim" if name == "F_wheel" else name for name in input_channels(case.id)]
    return [name for name in names if name in _LIMITS]


def _attitude_rates(channels: dict[str, np.ndarray]) -> dict[str, np.ndarray]:
    """Return the rates of pitch attitude and bank angle, which are zero in a steady turn."""
    if not {"phi", "theta", "p", "q", "r"} <= channels.keys():
        return {}
    phi, theta = channels["phi"], channels["theta"]
    p, q, r = (channels[name] for name in "pqr")
    # theta' = q cos phi - r sin phi;  phi' = p + tan theta (q sin phi + r cos phi)
    return {
        "theta": q * np.cos(phi) - r * np.sin(phi),
        "phi": p + np.tan(theta) * (q * np.sin(phi) + r * np.cos(phi)),
    }


def _movement_text(name: str, size: float) -> str:
    """Return a movement before the start of a window in words."""
    if name in ("theta", "phi"):
        return f"{quantity_words(name)} changes by {size / DEGREE:.2g} deg/s"
    if name == "r":
        return f"the yaw rate changes by {size / DEGREE:.2g} deg/s in {BEFORE:g} s"
    return f"{channel_value_text(name, size)} in {BEFORE:g} s"


def _open_input(case: PomCase, motion: _Motion) -> WindowCheck:
    """Return whether a window ends before its input does."""
    start, stop = case.window
    time, channels = motion.time, motion.channels
    judged = [item for item in case.criteria if item.applies and item.parameter]
    reaches_end = any(item.window[1] >= stop - SMOOTH for item in judged)
    if not plain_id(case.id).startswith(_RESPONSES) or not reaches_end:
        return WindowCheck()
    inside = (time >= start) & (time <= stop)
    before = (time >= start - BEFORE) & (time <= start + 0.5 * SMOOTH)
    names = _input_names(case)
    known = [name for name in names if motion.known(name, start - BEFORE, stop + RETURN)]
    unchecked: tuple[str, ...] = ()
    if not known:
        unchecked = (
            f"whether the window ends before the input does: the record has none of "
            f"{', '.join(names)} from {time_text(start - BEFORE)} to {time_text(stop + RETURN)} s "
            f"throughout",
        )
    for name in known:
        if not before.any():
            continue
        away = np.abs(channels[name] - np.median(channels[name][before]))
        largest = float(away[inside].max())
        if largest <= _LIMITS[name]:
            continue
        found = _input_around(time, away > SHARE * largest, stop)
        if found is None:
            continue
        first, last = found
        # the middle of the return, which is less blurred by the mean than its end
        last = float(time[(away > 0.5 * largest) & (time <= last)][-1])
        # a control that stays away for good is a step or a new trim
        if last - stop > SMOOTH and last - stop <= max(RETURN, stop - max(first, start)):
            control = _CONTROLS.get(name, quantity_words(name))
            text = (
                f"the window ends at {time_text(stop)} s, {last - stop:.1f} s before the input of "
                "the "
                f"{control} ends; the return is not judged"
            )
            return WindowCheck((text,), unchecked)
    return WindowCheck((), unchecked)


def _input_around(time: np.ndarray, away: np.ndarray, instant: float) -> tuple[float, float] | None:
    """Return start and end of the input at an instant [s]; None without one, or without an end."""
    samples = time[away]
    # passages of the trim position within an input are shorter than a pause
    breaks = np.flatnonzero(np.diff(samples) > PAUSE) + 1
    for part in np.split(samples, breaks):
        if part.size and part[0] <= instant <= part[-1]:
            if part[-1] > time[-1] - PAUSE:
                return None
            return float(part[0]), float(part[-1])
    return None
