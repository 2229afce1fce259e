"""Manoeuvres that a record lists, matched with the rows of the tolerance table."""

from __future__ import annotations

from collections.abc import Sequence

from flightmech.errors import SchemaError
from flightmech.quantities import time_text
from pom.cases.drafting.event_detection import ELEVATOR, INPUTS, RecordedManoeuvre, input_channels
from pom.tolerances.channels import plain_id

# Tests of take-offs and landings. A record lists the parts of such a run separately.
WHOLE_RUNS = ("1.b", "1.e", "2.e")
_STEADY = ("trim", "cruise", "steady_flight", "at_rest")
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
    "1.d.3": _STEADY,
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
    "2.a.8": _STEADY,
    "2.a.9": ("sweep_brake", "braking"),
    "2.b.1": ("release_column", "release_elevator"),
    "2.b.2": ("release_wheel", "release_aileron"),
    "2.b.3": ("release_pedal", "release_rudder"),
    "2.c.5": _STEADY,
    "2.c.6": ("steady_turn", "pull_up_push_down", "wind_up_turn"),
    "2.c.7": ("level_deceleration", "level_acceleration"),
    "2.c.8": ("stall",),
    "2.d.1": ("minimum_control_speed",),
    "2.d.5": (*_STEADY, "engine_out", "one_engine"),
    "2.d.8": ("steady_sideslip", "sideslip"),
    "2.e": ("landing", "descent", "approach", "flare", "go_around", "glide", "reverse", "roll_out"),
    "2.f": ("low_pass", "descent"),
}
"""By number of a row, or start of its number: prefixes of the manoeuvres that fit."""

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
"""Prefixes of manoeuvres without a dynamic response, although a control moves."""

CONTROL_WORDS = {
    "delta_e": "elevator",
    "delta_a": "aileron",
    "delta_r": "rudder",
    "delta_f": "flap",
}
"""Name of a control in a list of manoeuvres, by channel."""

_ELEVATOR_INPUTS = ("2.b.4", "2.c.9", "2.c.10")


def matching_manoeuvres(test: str, listed: Sequence[RecordedManoeuvre]) -> list[RecordedManoeuvre]:
    """Return the manoeuvres that fit a row, in the order of the record.

    If a row has several inputs, only the manoeuvres of the likeliest one that moves are returned.
    """
    prefixes = _entry_of_row(test, WORDS)
    if prefixes is None:
        # A row without an entry needs an input: the first of its controls that a manoeuvre moves.
        dynamic = [each for each in listed if not each.word.startswith(QUASI_STEADY)]
        for channel in input_channels(test):
            inputs = _manoeuvres_of_control(channel, dynamic)
            if inputs:
                return inputs
        return []
    fitting = [each for each in listed if each.word.startswith(prefixes)]
    if not test.startswith(WHOLE_RUNS):
        return fitting
    # The part of a run in which the elevator moves holds the events.
    with_elevator = []
    for each in fitting:
        if any(_manoeuvres_of_control(channel, [each]) for channel in ELEVATOR):
            with_elevator.append(each)
    return with_elevator or fitting


def demand_fitting(record: str, test: str, listed: Sequence[RecordedManoeuvre]) -> None:
    """Check that a record with a list of manoeuvres has one that fits a row.

    Raises
    ------
    SchemaError
        None fits. The error states all that the record lists.
    """
    prefixes = _entry_of_row(test, WORDS)
    has_rule = prefixes is not None or plain_id(test) in (*INPUTS, *_ELEVATOR_INPUTS)
    if not listed or not has_rule or matching_manoeuvres(test, listed):
        return
    texts = []
    for each in listed:
        control = f" ({each.control})" if each.control else ""
        texts.append(f"{each.word}{control} {time_text(each.start)} ... {time_text(each.end)} s")
    # the words of the rule, or the controls of the input
    expected = prefixes or [CONTROL_WORDS.get(name, name) for name in input_channels(test)]
    raise SchemaError(
        f"record {record}",
        [
            f"no manoeuvre that it lists fits {test} ({', '.join(expected)}); it lists "
            f"{', '.join(texts)}; give another record, or --window START STOP"
        ],
    )


def _manoeuvres_of_control(
    channel: str, listed: Sequence[RecordedManoeuvre]
) -> list[RecordedManoeuvre]:
    """Return the manoeuvres whose control is a channel, by its name or by its word."""
    names = {channel, CONTROL_WORDS.get(channel)}
    return [each for each in listed if each.control and each.control in names]


def _entry_of_row(test: str, table: dict[str, tuple[str, ...]]) -> tuple[str, ...] | None:
    """Return the entry of a row, by its number or by the longest start of the number."""
    parts = plain_id(test).split(".")
    for count in range(len(parts), 0, -1):
        entry = table.get(".".join(parts[:count]))
        if entry is not None:
            return entry
    return None
