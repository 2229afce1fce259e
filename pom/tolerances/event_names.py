"""Names of the instants of a manoeuvre: which the pilot brings about, which the aeroplane, and by what signal."""

from __future__ import annotations

ACTS = frozenset(
    {
        "brake_release",
        "throttle_movement",
        "control_release",
        "input_start",
        "input_end",
        "change_start",
        "change_end",
        "release",
        "reverse_thrust_initiation",
        "engine_failure",
        "before_engine_failure",
        "flare",
        "minimum_control_speed",
        "trim",
        "capture",
    }
)
"""Events that pilot or record bring about, at the same time in both."""

DISCRETES = {"stall_warning": ("stall_warning",), "initial_buffet": ("buffet",), "touchdown": ("wow_left", "wow_right")}
"""Signals that jump from 0 to 1 at an event."""

LEVELS = {
    "vr": ("V_cas", 1),
    "touchdown": ("h_agl", -1),
    "full_stop": ("V_ground", -1),
    "reverse_stow": ("V_ground", -1),
    "minimum_speed_full_reverse": ("V_ground", -1),
    "stall_warning": ("alpha", 1),
    "initial_buffet": ("alpha", 1),
    "stall": ("alpha", 1),
}
"""Channel and direction in which an event passes the level that the flight has at its time in the case file."""

OF_PARAMETER = {
    "engine_failure_speed": "engine_failure",
    "initial_buffet_speed": "initial_buffet",
    "stall_warning_speed": "stall_warning",
    "stall_speed": "stall",
    "buffet_onset_angle_of_attack": "initial_buffet",
    "airspeed": "minimum_control_speed",
    "flare_height": "flare",
    "descent_rate_at_touchdown": "touchdown",
}
"""The event at which a parameter is read."""

MEASURED = frozenset({*ACTS, *LEVELS, *DISCRETES, "g_break", "static_sweep_start", "static_sweep_end", "segment_start", "segment_end"})
"""Events that the measures need, in addition to those that bound the windows of rows."""

PARTS = {
    "approach_to_stall": ("", "stall_warning"),
    "warning_to_stall": ("stall_warning", "stall"),
    "stall_break_and_recovery": ("stall", ""),
    "before_g_break": ("", "g_break"),
}
"""Parts of a manoeuvre and the events between which they lie; an empty word is the end of the window."""
