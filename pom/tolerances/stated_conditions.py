"""Conditions that the rows of the tolerance table state for the flight, and who checks them.

A row states conditions in its columns ``condition``, ``flight_condition``, ``applies_from``,
``applies_to`` and ``note``.  `STATED` lists those of columns ``flight_condition`` and ``note`` by
test.  The reference page of the conditions is written from this module.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

from pom.tolerances.channels import plain_id


@dataclass(frozen=True)
class StatedCondition:
    """One condition on the flight of a test.

    Attributes
    ----------
    name : str
        Name of its check in `condition_checks`, `stall_checks` or `report_conditions` of
        `pom.judging.conditions`.
    text : str
        The condition as the row states it.
    how : str
        How it is evaluated; empty if it is not.
    over : str
        ``case``, ``report`` or ``model``: what the check looks at.
    """

    name: str
    text: str
    how: str = ""
    over: str = "case"


_ALL = (
    StatedCondition(
        "configuration",
        "the configuration of the column flight_condition",
        "flaps (more than 2 deg are out) and gear at the start of the window; ground: on the "
        "wheels. Another one is a departure, unless the case states itself as additional",
    ),
    StatedCondition(
        "taxi_speeds",
        "two or more taxi speeds, at least 5 kt of ground speed apart",
        "ground speeds at the captured instants of all cases of the test in the report",
        "report",
    ),
    StatedCondition(
        "no_brakes", "no brakes", "largest recorded brake of the window, at most 2 % of the pedal"
    ),
    StatedCondition("least_thrust", "minimum thrust"),
    StatedCondition("gear_radii", "radii of main and nose gear both recorded"),
    StatedCondition(
        "share_of_run",
        "at least 80 % of the run is recorded",
        "time between the two events of the row inside the window of the case",
    ),
    StatedCondition(
        "v1",
        "the take-off is rejected at 80 % of V1 or more",
        "highest calibrated airspeed of the window over the fact v1 of case or aircraft",
    ),
    StatedCondition(
        "maximum_braking",
        "maximum braking",
        "largest recorded brake after brake release, at least 95 % of the pedal",
    ),
    StatedCondition(
        "near_maximum_weight",
        "near maximum take-off weight",
        "rule R13: mass at the start, at least basic operating weight + 80 % of (mtow - basic "
        "operating weight)",
    ),
    StatedCondition(
        "hands_off",
        "free response, no pilot input",
        "elevator, ailerons and rudder within 1 deg of their position at the start of the row, or "
        "pilot forces within the 5 lbf and 3 lbf of the static rows where forces drive",
    ),
    StatedCondition(
        "bank_below_30",
        "the window ends at 30 deg of bank",
        "largest recorded bank inside the window",
    ),
    StatedCondition(
        "height_1000", "over an interval of 1000 ft or more", "recorded height over the segment"
    ),
    StatedCondition(
        "height_3000", "over an interval of 3000 ft or more", "recorded height over the segment"
    ),
    StatedCondition(
        "height_5000", "over a segment of 5000 ft or more", "recorded height over the segment"
    ),
    StatedCondition(
        "speed_change_50",
        "speed change of 50 kt or more",
        "recorded calibrated airspeed over the segment",
    ),
    StatedCondition(
        "input",
        "the control of the test moves",
        "largest change in the window of a recorded control of the test, means over 0.3 s: more "
        "than six standard deviations of the noise and 0.25 deg of a surface or wheel, 2.5 mm of "
        "column or pedal, or a quarter of the forces of the static rows; in a noisy channel four "
        "times these values are enough; more than 2 deg of the flaps, 10 % of the travel of gear "
        "and speed brake, or 5 % of the power",
    ),
    StatedCondition("power_setting", "maximum continuous thrust, or idle"),
    StatedCondition(
        "one_engine_out",
        "one engine inoperative",
        "smallest over largest mean thrust of the engines in the window, at most 10 %",
    ),
    StatedCondition("snapshot_interval", "one snapshot, or two at least 3 min apart"),
    StatedCondition("dry_runway", "dry runway", "drive.runway, or the state in the aircraft file"),
    StatedCondition("wet_runway", "wet runway", "drive.runway, or the state in the aircraft file"),
    StatedCondition("icy_runway", "icy runway", "drive.runway, or the state in the aircraft file"),
    StatedCondition("between_engines", "also between the engines"),
    StatedCondition(
        "small_input",
        "inputs that give 0.5 to 2 deg/s",
        "largest change of the recorded rate after the input",
    ),
    StatedCondition(
        "bank_of_turn",
        "up to 30 deg of bank in approach and landing, 45 deg in cruise",
        "recorded bank at the captured instant, with 1 deg of allowance",
    ),
    StatedCondition(
        "speeds_about_trim",
        "two speeds or more on each side of trim",
        "airspeeds at the captured instants of all cases of the test: four, at least 2 kt apart",
        "report",
    ),
    StatedCondition(
        "after_neutral",
        "until 10 s after the control is back at neutral",
        "recorded aileron or wheel: last time it is off by more than 10 % of its largest change",
    ),
    StatedCondition(
        "both_directions",
        "both directions",
        "signs of the bank at release of all cases of the test in the report",
        "report",
    ),
    StatedCondition(
        "pedal_step",
        "step of 20 to 30 % of the pedal",
        "largest change of the recorded pedal or rudder over its travel in the aircraft file",
    ),
    StatedCondition("augmentation", "augmentation on and off"),
    StatedCondition(
        "rudder_positions",
        "two rudder positions or more, one near maximum",
        "rudder at the captured instants of all cases of the test: two, 1 deg apart, and one of "
        "80 % of the travel",
        "report",
    ),
    StatedCondition("heights_over_ground", "three heights in ground effect and one out of it"),
    StatedCondition("rollout_guidance", "if the autopilot gives rollout guidance"),
    StatedCondition("yaw_damper_off", "yaw damper off"),
    StatedCondition("buffet_approach", "in the approach to the stall"),
    StatedCondition("demonstration", "recordings of a demonstration"),
    StatedCondition(
        "level_entry",
        "the stall is entered wings level at 1 g (read in Table B2A of 2014, p. 161)",
        "10 s before the first warning: bank within 5 deg, mean load factor within 0.15 of 1",
    ),
    StatedCondition(
        "idle_entry",
        "the stall is entered with thrust at or near idle (read in Table B2A of 2014, p. 161)",
        "10 s before the first warning: mean of every recorded lever, at most 10 % of its travel",
    ),
    StatedCondition(
        "entry_rate",
        "the speed falls by 1 kt/s at most, by 3 kt/s in a turn (14 CFR 25.201(c))",
        "line through the calibrated airspeed of the 10 s before the first warning, with 0.2 kt/s "
        "of allowance; a turn has more than 15 deg of bank",
    ),
    StatedCondition(
        "warning_first",
        "the warning precedes the stall",
        "events stall_warning or initial_buffet, and stall: order of time and of angle of attack",
    ),
    StatedCondition(
        "recovery_recorded",
        "recorded through the stall and the recovery",
        "after the stall the angle of attack falls below that of the first warning in the window",
    ),
    StatedCondition(
        "stall_entries",
        "wings level and turning entries (from memory; the row was not read)",
        "bank at stall_warning of all cases of the test in the report: one within 5 deg, one of 25 "
        "deg or more",
        "report",
    ),
    StatedCondition("high_cruise", "cruise at high altitude (from memory; the row was not read)"),
    StatedCondition(
        "valid_beyond_stall",
        "the model is valid to 10 deg beyond the stall identification (Attachment 7, p. 182)",
        "validity envelope of the model from the angle of attack at the event stall to 10 deg "
        "beyond it: extrapolation is a departure, an a-priori region a notice; without an envelope "
        "the ends of the tables over alpha",
        "model",
    ),
    StatedCondition(
        "upset",
        (
            "an upset: pitch above 25 deg up or 10 deg down, or bank above 45 deg (Attachment 7, "
            "p. 183)"
        ),
        "largest and smallest pitch and largest bank of the window; an upset by airspeed alone is "
        "not checked",
    ),
    StatedCondition(
        "clean_and_iced",
        "two runs, clean and iced (Attachment 7)",
        "device.ice.setting at the start of all cases of the test in the report: zero and more",
        "report",
    ),
    StatedCondition("gusts", "a crosswind with gusts (FSTD Directive 2, section IV, p. 180)"),
)
CONDITIONS = {item.name: item for item in _ALL}

_INPUT = ("input",)
_FREE = ("input", "hands_off")
_STALL = ("entry_rate", "warning_first", "recovery_recorded")
STATED: dict[str, tuple[str, ...]] = {
    "1.a.1": ("no_brakes", "least_thrust", "gear_radii"),
    "1.a.2": ("taxi_speeds",),
    "1.b.1": ("share_of_run",),
    "1.b.7": ("v1", "near_maximum_weight", "maximum_braking"),
    "1.b.8": ("hands_off", "bank_below_30"),
    "1.c.1": ("height_1000",),
    "1.c.2": ("height_1000", "one_engine_out"),
    "1.c.3": ("height_5000", "one_engine_out"),
    "1.c.4": ("height_1000", "one_engine_out"),
    "1.d.1": ("speed_change_50", "power_setting"),
    "1.d.2": ("speed_change_50", "power_setting"),
    "1.d.3": ("snapshot_interval",),
    "1.d.4": ("height_1000",),
    "1.d.5": ("height_3000",),
    **dict.fromkeys(("1.f.1", "1.f.2", "2.c.9", "2.c.10", "2.d.2"), _INPUT),
    "1.e.1": ("share_of_run", "dry_runway"),
    "1.e.2": ("share_of_run", "dry_runway"),
    "1.e.3": ("wet_runway",),
    "1.e.4": ("icy_runway",),
    "2.a.8": ("between_engines",),
    **dict.fromkeys(("2.b.4", "2.b.5", "2.b.6"), ("small_input",)),
    **dict.fromkeys(("2.c.1", "2.c.2", "2.c.3", "2.c.4"), _FREE),
    "2.c.6": ("bank_of_turn",),
    "2.c.7": ("speeds_about_trim",),
    "2.c.8": ("level_entry", "idle_entry", *_STALL),
    "2.c.8.a": (*_STALL, "stall_entries", "high_cruise", "valid_beyond_stall"),
    "2.c.8.b": ("entry_rate", "high_cruise"),
    "2.d.3": ("input", "after_neutral"),
    "2.d.4": ("both_directions",),
    "2.d.5": ("one_engine_out",),
    "2.d.6": ("pedal_step", "augmentation"),
    "2.d.7": ("input", "yaw_damper_off"),
    "2.d.8": ("rudder_positions",),
    "2.e.4": ("one_engine_out",),
    "2.e.5": ("rollout_guidance",),
    "2.e.7": ("one_engine_out",),
    "2.f": ("heights_over_ground",),
    "2.f.1": ("heights_over_ground",),
    "2.g": ("demonstration",),
    "2.i": ("demonstration", "clean_and_iced"),
    "3.f.5": ("buffet_approach",),
    "7.B": ("demonstration", "upset"),
    "IV": ("demonstration", "gusts"),
}
"""By test: the conditions of its notes and of its title."""


def conditions_of(test_id: str) -> Iterator[StatedCondition]:
    """Yield the conditions of a test, its configuration first."""
    yield CONDITIONS["configuration"]
    for name in STATED.get(plain_id(test_id), ()):
        yield CONDITIONS[name]


_CLEAN, _EXTENDED, _GROUND = ("clean",), ("extended",), ("ground",)
CONFIGURATIONS: dict[str, tuple[str, ...]] = {
    "ground": _GROUND,
    "takeoff": ("takeoff",),
    "clean": _CLEAN,
    "cruise": _CLEAN,
    "second_segment": ("gear_up",),
    "approach": _EXTENDED,
    "landing": ("landing",),
    "landing_min_flap": ("gear_down",),
    "approach_or_landing": _EXTENDED,
    "ground_and_approach": ("ground", "extended"),
    "takeoff_cruise_landing": ("takeoff", "clean", "landing"),
    "takeoff_to_flap_retraction_and_approach_to_landing": _EXTENDED,
    "takeoff_retraction_and_approach_extension": (),
    "cruise_approach_landing": ("clean", "extended"),
    "second_segment_and_approach_or_landing": ("gear_up", "extended"),
    "takeoff_or_landing": ("takeoff", "extended"),
    "cruise_and_approach_or_landing": ("clean", "extended"),
    "second_segment_cruise_approach_or_landing": ("gear_up", "clean", "extended"),
    "takeoff;cruise;approach_or_landing": ("takeoff", "clean", "extended"),
    "takeoff;cruise": ("takeoff", "clean"),
    "cruise;approach": ("clean", "extended"),
    "second_segment_climb;approach_or_landing": ("gear_up", "extended"),
    "takeoff_or_approach_or_landing": ("takeoff", "extended"),
    "takeoff_and_landing": ("takeoff", "landing"),
}
"""By flight condition of a row: the configurations of which one is enough; empty or missing: not
checked.

``clean``: flaps in, gear up; ``extended``: flaps out; ``landing``: flaps out, gear down;
``takeoff``: flaps not full, gear down; ``gear_up``, ``gear_down``; ``ground``: on the wheels.
"""

ANY = "flight"
"""Flight condition of a row that holds in every configuration."""
