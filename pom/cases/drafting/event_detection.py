"""Instants that a flight record shows by itself: where a control starts and stops moving, wheels,
brakes, heights, a quiet stretch.

They are proposals for the events of a case file (`pom.cases.drafting.draft`); the engineer who
signs the case looks at them.
"""

from __future__ import annotations

import re
from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass, field
from typing import NamedTuple

import numpy as np

from flightmech.errors import SchemaError
from flightmech.units import FOOT, KNOT
from pom.tolerances.channels import plain_id

QUIET_LEAD = 0.5  # [s] at the start of the searched stretch in which the controls still rest
# share of the excursion that a control free to float does not reach: 12 % in a phugoid of the
# Citation II
MOVED = 0.2
LONGEST_RAMP = 10.0  # [s] that a corner may lie before the passage of that share
RAMP = 0.1  # of a movement: rest that has to follow it; less is the rounding of a ramp that goes on
NOISE = 6.0  # standard deviations of its noise that a movement is larger than
# of the largest displacement: a control there is still in the hand (2.b.1: P0 counts from here)
HELD = 0.9
PEDAL_UP = 0.02  # [1]
HELD_STILL = (
    4.0  # [s] before the captured instant of a snapshot, one second after it (rule R5 of the table)
)

ELEVATOR = ("delta_e", "column", "F_column")
AILERON = ("delta_a", "wheel", "F_wheel")
RUDDER = ("delta_r", "pedal", "F_pedal")
POWER = ("throttle", "n1", "thrust")
INPUTS = {
    **dict.fromkeys(("1.f.1", "1.f.2", "2.c.1"), POWER),
    "2.c.2": ("delta_f",),
    "2.c.3": ("speedbrake",),
    "2.c.4": ("gear",),
    **dict.fromkeys(("2.b.2", "2.b.5", "2.d.2", "2.d.3", "2.d.4"), AILERON),
    **dict.fromkeys(("2.b.3", "2.b.6", "2.d.6"), RUDDER),
    "2.d.7": (*RUDDER, *AILERON),
}
_ENGINE = re.compile(r"^engine\d+\.(\w+)$")


class RecordedManoeuvre(NamedTuple):
    """A manoeuvre as a record lists it: start and end [s], the control that moves, the word for it."""

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
        What the reconstruction covers. [s]
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
        """Return the first of `names` that is recorded; of engine quantities that of the first
        engine.  Empty without any.
        """
        for name in names:
            for choice in (name, f"engine1.{name}"):
                if choice in self.channels:
                    return choice
        return ""


@dataclass(frozen=True)
class Movement:
    """The stretch in which a channel leaves its rest and comes to another, or back. [s]"""

    channel: str
    start: float
    end: float


def input_channels(test: str) -> tuple[str, ...]:
    """Return the controls whose movement is the input of a test, the likely ones first; elevator
    when nothing else is known.
    """
    return INPUTS.get(test.replace("(", ".").replace(")", ""), ELEVATOR)


def find_movement(
    recorded: Recorded, names: Iterable[str], window: tuple[float, float]
) -> Movement | None:
    """Return the movement of the first of `names` that moves, in its own noise, at least half as
    much as the one that moves most.

    Rest is the median of the first half second, and of the last; the movement begins and ends where
    the lines through the passages of 20 and 50 % of the excursion meet it.  None when nothing moves
    by more than six standard deviations of its noise.
    """
    found = []
    for name in dict.fromkeys(recorded.first([name]) for name in names):
        if name:
            time, y = recorded.within(name, window)
            stretch = _stretch(time, y)
            if stretch is not None:
                found.append((stretch[2], Movement(name, *stretch[:2])))
    most = max((excursion for excursion, _ in found), default=0.0)
    return next((moved for excursion, moved in found if excursion >= 0.5 * most), None)


def _stretch(time: np.ndarray, y: np.ndarray) -> tuple[float, float, float] | None:
    """Return start, end and excursion (in its noise) of the movement of a channel."""
    if time.size < 20:
        return None
    before, after = (
        float(np.median(y[part]))
        for part in (time <= time[0] + QUIET_LEAD, time >= time[-1] - QUIET_LEAD)
    )
    noise = 1.4826 * float(np.median(np.abs(np.diff(y)))) / np.sqrt(2.0)
    excursion = float(np.max(np.abs(y - before)))
    if min(excursion, float(np.max(np.abs(y - after)))) <= max(NOISE * noise, 1e-9):
        return None
    start, end = (
        _corner(time, np.abs(y - before) / excursion),
        _corner(-time[::-1], np.abs(y - after)[::-1] / excursion),
    )
    if start is None or end is None or not start < -end:
        return None
    return (
        max(start, float(time[0])),
        min(-end, float(time[-1])),
        excursion / max(noise, 1e-3 * excursion),
    )


def _corner(time: np.ndarray, away: np.ndarray) -> float | None:
    """Return where the way out of rest begins: on the line through its first passages of 20 and 50
    % of the excursion. [s]
    """
    slightly, half = np.flatnonzero(away > MOVED), np.flatnonzero(away > 0.5)
    if not slightly.size or not half.size:
        return None
    first, middle = float(time[slightly[0]]), float(time[half[0]])
    return first - min((middle - first) * MOVED / (0.5 - MOVED), LONGEST_RAMP)


def quiet_instant(recorded: Recorded, window: tuple[float, float]) -> float | None:
    """Return the instant about which speed, attitude and rates stand stillest, from 4 s before to 1
    s after it. [s]
    """
    names = [
        name for name in ("V_cas", "V", "theta", "phi", "p", "q", "r") if name in recorded.channels
    ]
    step, stretch = 0.1, round((HELD_STILL + 1.0) / 0.1)
    grid = np.arange(window[0], window[1] + 0.5 * step, step)
    if not names or grid.size <= stretch:
        return None
    unrest = np.zeros(grid.size - stretch)
    for name in names:
        y = np.interp(grid, *recorded.channels[name])
        spread = np.ptp(np.lib.stride_tricks.sliding_window_view(y, stretch + 1), axis=1)
        unrest += spread / (float(spread.max()) or 1.0)
    return float(grid[int(np.argmin(unrest))] + HELD_STILL)


def on_ground(recorded: Recorded, time: float) -> bool:
    """Whether the aeroplane stands or rolls on its wheels at an instant: by its squat switches,
    else by its height over the runway.
    """
    switches = [name for name in ("wow_left", "wow_right") if name in recorded.channels]
    if switches:
        return all(float(np.interp(time, *recorded.channels[name])) > 0.5 for name in switches)
    return (
        "h_agl" in recorded.channels
        and float(np.interp(time, *recorded.channels["h_agl"])) < 6.0 * FOOT
    )


def find_events(
    wanted: Iterable[str],
    test: str,
    recorded: Recorded,
    manoeuvre: tuple[float, float],
    window: tuple[float, float],
) -> dict[str, float]:
    """Return those of the wanted events that can be found. [s]

    Parameters
    ----------
    wanted : iterable of str
        Events of the tolerance table (`pom.tolerances.rows.window_events`).
    test : str
        Its number; determines which control is the input, and whether 200 ft are passed upward
        (take-off) or downward (landing).
    manoeuvre, window : tuple of float
        Where to look for the input, and for all else. [s]
    """
    found = {}
    for name in wanted:
        finder = _FINDERS.get(name)
        time = (
            finder(recorded, test, manoeuvre if name in _OF_INPUT else window) if finder else None
        )
        if time is not None and window[0] <= time <= window[1]:
            found[name] = round(float(time), 2)
    return found


Finder = Callable[[Recorded, str, tuple[float, float]], float | None]


def _input(end: str) -> Finder:
    """Return the finder of an end of the input; a control that still moves as the stretch ends has
    none.
    """

    def find(recorded: Recorded, test: str, window: tuple[float, float]) -> float | None:
        moved = find_movement(recorded, input_channels(test), window)
        if moved is None or (
            end == "end"
            and window[1] - moved.end < max(2.0 * QUIET_LEAD, RAMP * (moved.end - moved.start))
        ):
            return None
        return getattr(moved, end)

    return find


def _let_go(recorded: Recorded, test: str, window: tuple[float, float]) -> float | None:
    """Return the instant at which a control held away from neutral is released; what follows is its
    own motion.
    """
    moved = find_movement(recorded, input_channels(test), window)
    if moved is None:
        return None
    time, y = recorded.within(moved.channel, window)
    away = np.abs(y - float(np.median(y[time >= time[-1] - QUIET_LEAD])))
    held = np.flatnonzero(away > HELD * away.max())
    return float(time[held[-1]])


def _throttle(recorded: Recorded, test: str, window: tuple[float, float]) -> float | None:
    moved = find_movement(recorded, POWER, window)
    return None if moved is None else moved.start


def _switch(names: tuple[str, ...], to: bool, all_of: bool = False) -> Finder:
    """Return the finder of the instant at which the first (or the last) of some switches turns on
    or off.
    """

    def find(recorded: Recorded, test: str, window: tuple[float, float]) -> float | None:
        turned = []
        for name in (name for name in names if name in recorded.channels):
            time, y = recorded.within(name, window)
            at = np.flatnonzero(np.diff((y > 0.5).astype(int)) == (1 if to else -1))
            turned += [float(time[at[0] + 1])] if at.size else []
        return (max(turned) if all_of else min(turned)) if turned else None

    return find


def _brakes_off(recorded: Recorded, test: str, window: tuple[float, float]) -> float | None:
    name = recorded.first(("brake", "brake_left", "brake_right"))
    if not name:
        return None
    time, y = recorded.within(name, window)
    let_go = np.flatnonzero((y[:-1] > PEDAL_UP) & (y[1:] <= PEDAL_UP))
    return float(time[let_go[0] + 1]) if let_go.size else None


def _height(level: float) -> Finder:
    def find(recorded: Recorded, test: str, window: tuple[float, float]) -> float | None:
        name = recorded.first(("h_agl", "h_radio"))
        if not name:
            return None
        time, y = recorded.within(name, window)
        above = y >= level
        passed = (
            np.flatnonzero(above[1:] & ~above[:-1])
            if test.startswith("1.")
            else np.flatnonzero(~above[1:] & above[:-1])
        )
        return float(time[passed[0] + 1]) if passed.size else None

    return find


def _slow(share: float | None) -> Finder:
    """Return the finder of the instant, after touchdown or out of a roll, at which the ground speed
    has fallen to a share, or to a stop.
    """

    def find(recorded: Recorded, test: str, window: tuple[float, float]) -> float | None:
        if not {"vn", "ve"} <= set(recorded.channels):
            return None
        time, vn = recorded.within("vn", window)
        speed = np.hypot(vn, np.interp(time, *recorded.channels["ve"]))
        down = _FINDERS["touchdown"](recorded, test, window)
        start = int(np.searchsorted(time, down)) if down is not None else int(np.argmax(speed))
        if start >= speed.size:
            return None
        below = np.flatnonzero(speed[start:] <= (share * speed[start] if share else KNOT))
        return float(time[start + below[0]]) if below.size else None

    return find


def _engine_fails(recorded: Recorded, test: str, window: tuple[float, float]) -> float | None:
    """Return the instant at which the engines part by more than a fifth of what they give."""
    names = [
        name
        for name in recorded.channels
        if (match := _ENGINE.match(name)) and match.group(1) == "thrust"
    ]
    if len(names) < 2:
        return None
    time, first = recorded.within(names[0], window)
    other = np.interp(time, *recorded.channels[names[1]])
    parted = np.flatnonzero(
        np.abs(first - other) > 0.2 * np.max(np.abs([first, other]), initial=0.0)
    )
    return float(time[max(parted[0] - 1, 0)]) if parted.size and parted[0] > 0 else None


def _rotates(recorded: Recorded, test: str, window: tuple[float, float]) -> float | None:
    """Return the start of the elevator movement that ends the roll, which is looked for while the
    wheels are on the ground.
    """
    off = _FINDERS["main_gear_liftoff"](recorded, test, window)
    moved = (
        find_movement(recorded, ELEVATOR, (window[0], off))
        if off is not None and off - window[0] > 2.0
        else None
    )
    return None if moved is None else moved.start


def _released(recorded: Recorded, test: str, window: tuple[float, float]) -> float | None:
    """Return the start of a marked stretch of free controls, else the end of the input."""
    free = [
        each.start
        for each in recorded.manoeuvres
        if each.word in _FREE and window[0] <= each.start <= window[1]
    ]
    return free[0] if free else _input("end")(recorded, test, window)


_FREE = ("controls_fixed", "controls_free", "release", "free_response")  # words of manoeuvres
_OF_INPUT = (
    "input_start",
    "input_end",
    "change_start",
    "change_end",
    "control_release",
    "throttle_movement",
)
_FINDERS: dict[str, Finder] = {
    "input_start": _input("start"),
    "input_end": _input("end"),
    "change_start": _input("start"),
    "change_end": _input("end"),
    "release": _released,
    "control_release": _let_go,
    "throttle_movement": _throttle,
    "brake_release": _brakes_off,
    "vr": _rotates,
    "main_gear_liftoff": _switch(("wow_left", "wow_right"), to=False, all_of=True),
    "touchdown": _switch(("wow_left", "wow_right"), to=True),
    "nosewheel_touchdown": _switch(("wow_nose",), to=True),
    "200ft_agl": _height(200.0 * FOOT),
    "full_stop": _slow(None),
    "50pct_of_touchdown_speed": _slow(0.5),
    "engine_failure": _engine_fails,
    "before_engine_failure": _engine_fails,
    "capture": lambda recorded, test, window: quiet_instant(recorded, window),
}


WHOLE_RUNS = ("1.b", "1.e", "2.e")  # take-offs and landings, which a record lists part by part
_HELD = ("trim", "cruise", "steady_flight", "at_rest")
_DESCENTS = ("descent", "idle_descent", "emergency_descent", "glide")
WORDS: dict[str, tuple[str, ...]] = {
    "1.a": ("steering", "taxi"),
    "1.b": (
        "brakes_on",
        "ground_roll",
        "rotation",
        "takeoff",
        "take_off",
        "acceleration",
        "braking",
        "rejected",
        "engine_failure",
    ),
    "1.c": ("climb", "rotation_and_climb"),
    "1.d.1": ("level_acceleration",),
    "1.d.2": ("level_deceleration",),
    "1.d.3": _HELD,
    "1.d.4": _DESCENTS,
    "1.d.5": _DESCENTS,
    "1.e": ("landing", "braking", "roll_out", "stop"),
    "1.f": ("throttle", "power_lever", "lever"),
    "2.a.1": ("sweep_column", "sweep_elevator"),
    "2.a.2": ("sweep_wheel", "sweep_aileron"),
    "2.a.3": ("sweep_pedal", "sweep_rudder"),
    "2.a.4": ("sweep_tiller", "steering"),
    "2.a.5": ("sweep_pedal", "steering"),
    "2.a.6": ("tab", "sweep_trim"),
    "2.a.7": ("tab", "sweep_trim"),
    "2.a.8": _HELD,
    "2.a.9": ("sweep_brake", "braking"),
    "2.b.1": ("release_column", "release_elevator"),
    "2.b.2": ("release_wheel", "release_aileron"),
    "2.b.3": ("release_pedal", "release_rudder"),
    "2.c.5": _HELD,
    "2.c.6": ("steady_turn", "pull_up_push_down", "wind_up_turn"),
    "2.c.7": ("level_deceleration", "level_acceleration"),
    "2.c.8": ("stall",),
    "2.d.1": ("minimum_control_speed",),
    "2.d.5": (*_HELD, "engine_out", "one_engine"),
    "2.d.8": ("steady_sideslip", "sideslip"),
    "2.e": ("landing", "descent", "approach", "flare", "go_around", "glide", "reverse", "roll_out"),
    "2.f": ("low_pass", "descent"),
}
"""Beginnings of the words of the manoeuvres that fit a row, by its number or the beginning of that."""
QUASI_STEADY = (
    "trim",
    "recover",
    "tab",
    "pull_up_push_down",
    "level_",
    "steady_",
    "low_pass",
    "descent",
    "landing",
    "rotation",
    "to_neutral",
)
"""Beginnings of words of manoeuvres that are no input with a response, though a control moves."""
CONTROL_WORDS = {
    "delta_e": "elevator",
    "delta_a": "aileron",
    "delta_r": "rudder",
    "delta_f": "flap",
}
"""Channel: what a list of manoeuvres calls it."""
_ELEVATOR_INPUTS = ("2.b.4", "2.c.9", "2.c.10")


def matching_manoeuvres(test: str, listed: Sequence[RecordedManoeuvre]) -> list[RecordedManoeuvre]:
    """Return the manoeuvres that fit a row, in the order of the record; those of the likeliest
    control alone.
    """
    words = _of(test, WORDS)
    if words is None:
        dynamic = [each for each in listed if not each.word.startswith(QUASI_STEADY)]
        return next(
            (found for name in input_channels(test) if (found := _moving(name, dynamic))), []
        )
    found = [each for each in listed if each.word.startswith(words)]
    moved = [each for each in found if any(_moving(name, [each]) for name in ELEVATOR)]
    return (
        moved if moved and test.startswith(WHOLE_RUNS) else found
    )  # the part in which the elevator moves holds the events


def demand_fitting(record: str, test: str, listed: Sequence[RecordedManoeuvre]) -> None:
    """Check that a record that lists manoeuvres lists one that fits a row.

    Raises
    ------
    SchemaError
        None fits; with all that the record lists.
    """
    known = _of(test, WORDS) is not None or plain_id(test) in (*INPUTS, *_ELEVATOR_INPUTS)
    if not listed or not known or matching_manoeuvres(test, listed):
        return
    shown = ", ".join(
        f"{each.word}{f' ({each.control})' if each.control else ''} {each.start:g} ... "
        f"{each.end:g} s"
        for each in listed
    )
    wanted = _of(test, WORDS) or [CONTROL_WORDS.get(name, name) for name in input_channels(test)]
    raise SchemaError(
        f"record {record}",
        [
            f"no manoeuvre that it lists fits {test} ({', '.join(wanted)}); it lists "
            f"{shown}; give another record, or --window START STOP"
        ],
    )


def _moving(name: str, listed: Sequence[RecordedManoeuvre]) -> list[RecordedManoeuvre]:
    return [
        each for each in listed if each.control and {name, CONTROL_WORDS.get(name)} & {each.control}
    ]


def _of(test: str, table: dict[str, tuple[str, ...]]) -> tuple[str, ...] | None:
    """Return the entry of a row: that of its number, else of the longest beginning."""
    parts = plain_id(test).split(".")
    keys = (".".join(parts[:count]) for count in range(len(parts), 0, -1))
    return next((table[key] for key in keys if key in table), None)
