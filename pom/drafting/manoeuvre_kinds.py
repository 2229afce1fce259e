"""Which of the manoeuvres that a record lists fits a row: by the word of the manoeuvre, or by the control that moves."""

from __future__ import annotations

from collections.abc import Sequence

from flightmech.errors import SchemaError

from ..tolerances.parameter_channels import plain_id
from .event_detection import ELEVATOR, INPUTS, Manoeuvre, input_channels

WHOLE_RUNS = ("1.b", "1.e", "2.e")  # take-offs and landings, which a record lists part by part
_HELD = ("trim", "cruise", "steady_flight", "at_rest")
_DESCENTS = ("descent", "idle_descent", "emergency_descent", "glide")
WORDS: dict[str, tuple[str, ...]] = {
    "1.a": ("steering", "taxi"),
    "1.b": ("brakes_on", "ground_roll", "rotation", "takeoff", "take_off", "acceleration", "braking", "rejected", "engine_failure"),
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
CONTROL_WORDS = {"delta_e": "elevator", "delta_a": "aileron", "delta_r": "rudder", "delta_f": "flap"}
"""Channel: what a list of manoeuvres calls it."""
_ELEVATOR_INPUTS = ("2.b.4", "2.c.9", "2.c.10")


def fitting(test: str, listed: Sequence[Manoeuvre]) -> list[Manoeuvre]:
    """Return the manoeuvres that fit a row, in the order of the record; those of the likeliest control alone."""
    words = _of(test, WORDS)
    if words is None:
        dynamic = [each for each in listed if not each.word.startswith(QUASI_STEADY)]
        return next((found for name in input_channels(test) if (found := _moving(name, dynamic))), [])
    found = [each for each in listed if each.word.startswith(words)]
    moved = [each for each in found if any(_moving(name, [each]) for name in ELEVATOR)]
    return moved if moved and test.startswith(WHOLE_RUNS) else found  # the part in which the elevator moves holds the events


def demand_fitting(record: str, test: str, listed: Sequence[Manoeuvre]) -> None:
    """Check that a record that lists manoeuvres lists one that fits a row.

    Raises
    ------
    SchemaError
        None fits; with all that the record lists.
    """
    known = _of(test, WORDS) is not None or plain_id(test) in (*INPUTS, *_ELEVATOR_INPUTS)
    if not listed or not known or fitting(test, listed):
        return
    shown = ", ".join(f"{each.word}{f' ({each.control})' if each.control else ''} {each.start:g} ... {each.end:g} s" for each in listed)
    wanted = _of(test, WORDS) or [CONTROL_WORDS.get(name, name) for name in input_channels(test)]
    raise SchemaError(
        f"record {record}",
        [f"no manoeuvre that it lists fits {test} ({', '.join(wanted)}); it lists {shown}; give another record, or --window START STOP"],
    )


def _moving(name: str, listed: Sequence[Manoeuvre]) -> list[Manoeuvre]:
    return [each for each in listed if each.control and {name, CONTROL_WORDS.get(name)} & {each.control}]


def _of(test: str, table: dict[str, tuple[str, ...]]) -> tuple[str, ...] | None:
    """Return the entry of a row: that of its number, else of the longest beginning."""
    parts = plain_id(test).split(".")
    keys = (".".join(parts[:count]) for count in range(len(parts), 0, -1))
    return next((table[key] for key in keys if key in table), None)
