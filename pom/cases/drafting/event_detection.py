"""Events that a flight record shows: movements of controls, wheels, brakes, heights, quiet flight.

They are proposals for the events of a case file (`pom.cases.drafting.draft`). The engineer who
signs the case checks them.
"""

from __future__ import annotations

import re
from collections.abc import Callable, Iterable
from dataclasses import dataclass, field
from typing import NamedTuple

import numpy as np

from flightmech.units import FOOT, KNOT

QUIET_LEAD = 0.5  # [s] at both ends of the searched stretch, in which the controls rest
# Share of the excursion that a floating control does not reach: it reaches 12 % in a phugoid of
# the Citation II.
MOVED = 0.2
LONGEST_RAMP = 10.0  # [s] Longest time from the corner to the passage of that share.
# Share of a movement: rest that has to follow it. A shorter rest is the rounding of a ramp that
# goes on.
RAMP = 0.1
NOISE = 6.0  # standard deviations of the noise: smaller excursions are not movements
# Share of the largest displacement: beyond it a control is still in the hand (2.b.1: P0 counts
# from here).
HELD = 0.9
PEDAL_UP = 0.02  # [1] Position of a released brake pedal.
# [s] Quiet time before the captured instant of a snapshot; one second follows it (rule R5 of the
# table).
HELD_STILL = 4.0
_SIGMA_OF_MEDIAN = 1.4826  # standard deviation over median absolute deviation, normal noise
_LEAST_SAMPLES = 20  # of a channel in which a movement is searched
_GROUND_HEIGHT = 6.0 * FOOT  # [m] Below it the wheels are on the runway.
_FAILED_DIFFERENCE = 0.2  # of the larger thrust or torque, after the failure of an engine
_QUIET_STEP = 0.1  # [s] Grid of the search for quiet flight.

ELEVATOR = ("delta_e", "column", "F_column")
AILERON = ("delta_a", "wheel", "F_wheel")
RUDDER = ("delta_r", "pedal", "F_pedal")
POWER = ("throttle", "n1", "torque", "manifold_pressure", "thrust")
INPUTS = {
    **dict.fromkeys(("1.f.1", "1.f.2", "2.c.1"), POWER),
    "2.c.2": ("delta_f",),
    "2.c.3": ("speedbrake", "delta_s"),
    "2.c.4": ("gear",),
    **dict.fromkeys(("2.b.2", "2.b.5", "2.d.2", "2.d.3", "2.d.4"), AILERON),
    **dict.fromkeys(("2.b.3", "2.b.6", "2.d.6"), RUDDER),
    "2.d.7": (*RUDDER, *AILERON),
}
_ENGINE = re.compile(r"^engine\d+\.(\w+)$")


class RecordedManoeuvre(NamedTuple):
    """A manoeuvre in the list of a record: start and end [s], moved control, and its word."""

    start: float
    end: float
    control: str
    word: str


@dataclass(frozen=True)
class Recorded:
    """Channels of a record, each on its own clock.

    Attributes
    ----------
    channels : dict of str to (array, array)
        Canonical name to time [s] and samples [SI].
    span : tuple of float
        Time that the reconstruction covers. [s]
    manoeuvres : list of Manoeuvre
        Manoeuvres as the record lists them.
    latitude : float, optional
        [rad]
    """

    channels: dict[str, tuple[np.ndarray, np.ndarray]]
    span: tuple[float, float]
    manoeuvres: list[RecordedManoeuvre] = field(default_factory=list)
    latitude: float | None = None

    def within(self, name: str, window: tuple[float, float]) -> tuple[np.ndarray, np.ndarray]:
        """Return time and samples of a channel inside a window."""
        time, y = self.channels[name]
        inside = (time >= window[0] - 1e-9) & (time <= window[1] + 1e-9)
        return time[inside], y[inside]

    def first(self, names: Iterable[str]) -> str:
        """Return the first of `names` that is recorded; empty without any.

        Engine quantities are those of the first engine.
        """
        for name in names:
            for choice in (name, f"engine1.{name}"):
                if choice in self.channels:
                    return choice
        return ""


@dataclass(frozen=True)
class Movement:
    """Time in which a channel leaves one rest and comes to the next. [s]"""

    channel: str
    start: float
    end: float


def input_channels(test: str) -> tuple[str, ...]:
    """Return the controls that may be the input of a test, likely ones first."""
    return INPUTS.get(test.replace("(", ".").replace(")", ""), ELEVATOR)


def find_movement(
    recorded: Recorded, names: Iterable[str], window: tuple[float, float]
) -> Movement | None:
    """Return the movement of the first channel that moves clearly; None if none does.

    A channel moves clearly if its excursion over its noise is at least half the largest one. It
    moves at all if the excursion is larger than six standard deviations of its noise. Rest is the
    median of the first and of the last half second. The movement begins and ends where the lines
    through the passages of 20 and 50 % of the excursion meet the rest.
    """
    movements = []
    for name in dict.fromkeys(recorded.first([name]) for name in names):
        if not name:
            continue
        time, y = recorded.within(name, window)
        stretch = _measure_movement(time, y)
        if stretch is not None:
            start, end, excursion = stretch
            movements.append((excursion, Movement(name, start, end)))
    largest = max((excursion for excursion, _ in movements), default=0.0)
    for excursion, movement in movements:
        if excursion >= 0.5 * largest:
            return movement
    return None


def sample_noise(samples: np.ndarray) -> float:
    """Return the standard deviation of the noise of a channel that rests most of the time.

    The channel (time,) has at least two samples and no NaN. [unit of the channel]
    """
    # The difference of two samples has sqrt(2) times their noise.
    return _SIGMA_OF_MEDIAN * float(np.median(np.abs(np.diff(samples)))) / np.sqrt(2.0)


def _measure_movement(time: np.ndarray, y: np.ndarray) -> tuple[float, float, float] | None:
    """Return start and end [s] of the movement of a channel, and its excursion over its noise."""
    if time.size < _LEAST_SAMPLES:
        return None
    before = float(np.median(y[time <= time[0] + QUIET_LEAD]))
    after = float(np.median(y[time >= time[-1] - QUIET_LEAD]))
    noise = sample_noise(y)
    excursion = float(np.max(np.abs(y - before)))
    if min(excursion, float(np.max(np.abs(y - after)))) <= max(NOISE * noise, 1e-9):
        return None
    start = _find_corner(time, np.abs(y - before) / excursion)
    # The end is the start of the same channel in reversed time.
    reversed_end = _find_corner(-time[::-1], np.abs(y - after)[::-1] / excursion)
    if start is None or reversed_end is None or not start < -reversed_end:
        return None
    return (
        max(start, float(time[0])),
        min(-reversed_end, float(time[-1])),
        excursion / max(noise, 1e-3 * excursion),
    )


def _find_corner(time: np.ndarray, away: np.ndarray) -> float | None:
    """Return the time at which a channel leaves its rest; `away` is in excursions. [s]

    It is on the line through the first passages of 20 and 50 % of the excursion.
    """
    slightly, half = np.flatnonzero(away > MOVED), np.flatnonzero(away > 0.5)
    if not slightly.size or not half.size:
        return None
    first, middle = float(time[slightly[0]]), float(time[half[0]])
    return first - min((middle - first) * MOVED / (0.5 - MOVED), LONGEST_RAMP)


def quiet_instant(recorded: Recorded, window: tuple[float, float]) -> float | None:
    """Return the instant of quietest flight, from 4 s before to 1 s after it. [s]

    The measure is the sum of the ranges of speed, attitude and rates, each over its largest range.
    """
    quantities = ("V_cas", "V", "theta", "phi", "p", "q", "r")
    names = [name for name in quantities if name in recorded.channels]
    samples = round((HELD_STILL + 1.0) / _QUIET_STEP)
    grid = np.arange(window[0], window[1] + 0.5 * _QUIET_STEP, _QUIET_STEP)
    if not names or grid.size <= samples:
        return None
    unrest = np.zeros(grid.size - samples)
    for name in names:
        y = np.interp(grid, *recorded.channels[name])
        spread = np.ptp(np.lib.stride_tricks.sliding_window_view(y, samples + 1), axis=1)
        unrest += spread / (float(spread.max()) or 1.0)
    return float(grid[int(np.argmin(unrest))] + HELD_STILL)


def on_ground(recorded: Recorded, time: float) -> bool:
    """Whether the wheels are on the ground: by the squat switches, else by the height."""
    switches = [name for name in ("wow_left", "wow_right") if name in recorded.channels]
    if switches:
        return all(float(np.interp(time, *recorded.channels[name])) > 0.5 for name in switches)
    if "h_agl" not in recorded.channels:
        return False
    return float(np.interp(time, *recorded.channels["h_agl"])) < _GROUND_HEIGHT


def find_events(
    names: Iterable[str],
    test: str,
    recorded: Recorded,
    manoeuvre: tuple[float, float],
    window: tuple[float, float],
) -> dict[str, float]:
    """Return the times of the requested events that the record shows. [s]

    Parameters
    ----------
    names : iterable of str
        Events of the tolerance table (`pom.tolerances.rows.window_events`).
    test : str
        Its number; determines which control is the input, and whether 200 ft are passed upward
        (take-off) or downward (landing).
    recorded : Recorded
    manoeuvre, window : tuple of float
        Where to search the input, and all other events. [s]
    """
    times = {}
    for name in names:
        if name not in _FINDERS:
            continue
        searched = manoeuvre if name in _OF_INPUT else window
        time = _FINDERS[name](recorded, test, searched)
        if time is not None and window[0] <= time <= window[1]:
            times[name] = round(float(time), 2)
    return times


Finder = Callable[[Recorded, str, tuple[float, float]], float | None]


def _find_input_start(recorded: Recorded, test: str, window: tuple[float, float]) -> float | None:
    movement = find_movement(recorded, input_channels(test), window)
    if movement is None:
        return None
    return movement.start


def _find_input_end(recorded: Recorded, test: str, window: tuple[float, float]) -> float | None:
    """Return the end of the input; None if the control still moves as the window ends."""
    movement = find_movement(recorded, input_channels(test), window)
    if movement is None:
        return None
    least_rest = max(2.0 * QUIET_LEAD, RAMP * (movement.end - movement.start))
    if window[1] - movement.end < least_rest:
        return None
    return movement.end


def _find_control_release(
    recorded: Recorded, test: str, window: tuple[float, float]
) -> float | None:
    """Return the time at which a displaced control is released; it moves freely afterwards."""
    movement = find_movement(recorded, input_channels(test), window)
    if movement is None:
        return None
    time, y = recorded.within(movement.channel, window)
    away = np.abs(y - float(np.median(y[time >= time[-1] - QUIET_LEAD])))
    displaced = np.flatnonzero(away > HELD * away.max())
    return float(time[displaced[-1]])


def _find_throttle_movement(
    recorded: Recorded, test: str, window: tuple[float, float]
) -> float | None:
    movement = find_movement(recorded, POWER, window)
    if movement is None:
        return None
    return movement.start


def _switch_finder(names: tuple[str, ...], *, to: bool, all_of: bool = False) -> Finder:
    """Return a finder of the time at which one, or all, of some switches turn on or off."""
    step = 1 if to else -1

    def find(recorded: Recorded, test: str, window: tuple[float, float]) -> float | None:
        times = []
        for name in names:
            if name not in recorded.channels:
                continue
            time, y = recorded.within(name, window)
            changes = np.flatnonzero(np.diff((y > 0.5).astype(int)) == step)
            if changes.size:
                times.append(float(time[changes[0] + 1]))
        if not times:
            return None
        return max(times) if all_of else min(times)

    return find


def _find_brake_release(recorded: Recorded, test: str, window: tuple[float, float]) -> float | None:
    name = recorded.first(("brake", "brake_left", "brake_right"))
    if not name:
        return None
    time, y = recorded.within(name, window)
    return _time_after(time, (y[:-1] > PEDAL_UP) & (y[1:] <= PEDAL_UP))


def _time_after(time: np.ndarray, passes: np.ndarray) -> float | None:
    """Return the time of the sample after the first pass; passes (time - 1,). [s]"""
    samples = np.flatnonzero(passes)
    if not samples.size:
        return None
    return float(time[samples[0] + 1])


def _height_finder(level: float) -> Finder:
    """Return a finder of the passage of a height: upward in tests 1, else downward."""

    def find(recorded: Recorded, test: str, window: tuple[float, float]) -> float | None:
        name = recorded.first(("h_agl", "h_radio"))
        if not name:
            return None
        time, y = recorded.within(name, window)
        above = y >= level
        if test.startswith("1."):
            return _time_after(time, above[1:] & ~above[:-1])
        return _time_after(time, ~above[1:] & above[:-1])

    return find


def _slowdown_finder(share: float | None) -> Finder:
    """Return a finder of the time at which the ground speed falls to a share, or to a stop.

    The share is of the speed at touchdown, or of the largest speed without a touchdown.
    """

    def find(recorded: Recorded, test: str, window: tuple[float, float]) -> float | None:
        if not {"vn", "ve"} <= set(recorded.channels):
            return None
        time, vn = recorded.within("vn", window)
        speed = np.hypot(vn, np.interp(time, *recorded.channels["ve"]))
        touchdown = _FINDERS["touchdown"](recorded, test, window)
        start = int(np.argmax(speed))
        if touchdown is not None:
            start = int(np.searchsorted(time, touchdown))
        if start >= speed.size:
            return None
        limit = share * speed[start] if share else KNOT
        below = np.flatnonzero(speed[start:] <= limit)
        if not below.size:
            return None
        return float(time[start + below[0]])

    return find


def _find_engine_failure(
    recorded: Recorded, test: str, window: tuple[float, float]
) -> float | None:
    """Return the time at which the engines differ by more than a fifth of the larger value.

    They are compared by thrust, or by torque or N1 where it is not recorded.
    """
    # The first quantity that two engines have.
    names: list[str] = []
    for quantity in ("thrust", "torque", "n1"):
        names = []
        for name in recorded.channels:
            match = _ENGINE.match(name)
            if match and match.group(1) == quantity:
                names.append(name)
        if len(names) >= 2:
            break
    else:
        return None
    time, first = recorded.within(names[0], window)
    second = np.interp(time, *recorded.channels[names[1]])
    limit = _FAILED_DIFFERENCE * np.max(np.abs([first, second]), initial=0.0)
    # An engine that is off from the start did not fail in the window.
    different = np.flatnonzero(np.abs(first - second) > limit)
    if not different.size or different[0] == 0:
        return None
    return float(time[max(different[0] - 1, 0)])


def _find_rotation(recorded: Recorded, test: str, window: tuple[float, float]) -> float | None:
    """Return the start of the elevator movement that ends the ground roll."""
    # The movement is searched while the wheels are on the ground.
    lift_off = _FINDERS["main_gear_liftoff"](recorded, test, window)
    if lift_off is None or lift_off - window[0] <= 2.0:
        return None
    movement = find_movement(recorded, ELEVATOR, (window[0], lift_off))
    if movement is None:
        return None
    return movement.start


def _find_release(recorded: Recorded, test: str, window: tuple[float, float]) -> float | None:
    """Return the start of a listed manoeuvre with free controls, else the end of the input."""
    for each in recorded.manoeuvres:
        if each.word in _FREE and window[0] <= each.start <= window[1]:
            return each.start
    return _find_input_end(recorded, test, window)


# Words of manoeuvres with free or fixed controls.
_FREE = ("controls_fixed", "controls_free", "release", "free_response")
# Events that are searched in the manoeuvre, not in the whole window.
_OF_INPUT = (
    "input_start",
    "input_end",
    "change_start",
    "change_end",
    "control_release",
    "throttle_movement",
)
_FINDERS: dict[str, Finder] = {
    "input_start": _find_input_start,
    "input_end": _find_input_end,
    "change_start": _find_input_start,
    "change_end": _find_input_end,
    "release": _find_release,
    "control_release": _find_control_release,
    "throttle_movement": _find_throttle_movement,
    "brake_release": _find_brake_release,
    "vr": _find_rotation,
    "main_gear_liftoff": _switch_finder(("wow_left", "wow_right"), to=False, all_of=True),
    "touchdown": _switch_finder(("wow_left", "wow_right"), to=True),
    "nosewheel_touchdown": _switch_finder(("wow_nose",), to=True),
    "200ft_agl": _height_finder(200.0 * FOOT),
    "full_stop": _slowdown_finder(None),
    "50pct_of_touchdown_speed": _slowdown_finder(0.5),
    "engine_failure": _find_engine_failure,
    "before_engine_failure": _find_engine_failure,
    "capture": lambda recorded, test, window: quiet_instant(recorded, window),
}
