"""One row of the tolerance table as an object: what is measured, on which channel, and how wide the
band is.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

_BASES = {
    "ref_local": "of the flight value",
    "ref_peak": "of the largest flight value",
    "ref_scalar": "of the flight value",
    "range_max": "of the largest value in service",
    "first_overshoot": "of the first overshoot",
}


@dataclass(frozen=True)
class Limit:
    """One half width as the table prints it, e.g. ``Limit("absolute", 1.5, "deg")`` or
    ``Limit("percent", 10.0, "%")``.

    ``quantity`` is ``absolute``, ``percent``, ``percent_times_n_plus_1`` (times the number of the
    cycle plus one) or ``floor`` (one sided, the value is in the case).
    """

    quantity: str
    value: float
    unit: str

    @property
    def text(self) -> str:
        """The limit as a person reads it."""
        if self.quantity == "percent_times_n_plus_1":
            return f"{self.value:g}(n+1) %"
        return f"{self.value:g}" if self.unit in ("-", "1", "") else f"{self.value:g} {self.unit}"


@dataclass(frozen=True)
class Band:
    """One or two limits and the rule that joins them.

    ``rule`` is ``single``, ``greater_of`` or ``lesser_of``; ``base`` states of what a percentage is
    taken: ``ref_local`` (flight value at the same instant or abscissa), ``ref_peak`` (largest
    flight magnitude of the window), ``ref_scalar`` (flight value of the scalar measure),
    ``first_overshoot`` (that of the flight), ``range_max`` (maximum of the normal operating range).
    """

    limits: tuple[Limit, ...] = ()
    rule: str = "single"
    base: str = ""

    @property
    def text(self) -> str:
        """The tolerance as printed, e.g. ``10 % of the flight value or 2 deg/s, the greater``."""
        if any(limit.quantity == "floor" for limit in self.limits):
            return "not below the certified value"
        words = [
            f"{x.text} {_BASES.get(self.base, '')}".strip() if x.unit == "%" else x.text
            for x in self.limits
        ]
        tail = {"greater_of": ", the greater", "lesser_of": ", the smaller"}.get(self.rule, "")
        return " or ".join(words) + tail


@dataclass(frozen=True)
class Criterion:
    """One tolerance on one parameter of one case.

    Attributes
    ----------
    name : str
        Unique within the case, e.g. ``pitch_angle`` or ``bank_angle trend``.
    parameter : str
        Name in the tolerance table; empty when the case file added the criterion.
    channel : str
        Quantity it is judged on, canonical name: a signal, or one formed of signals such as
        ``distance``; empty for what is shown and judged by people.
    measure : str
        ``trace``, ``steady``, ``period`` ...
    group : str
        Criteria of one group are alternatives, different groups must all pass.
    band : Band
        The tolerance as printed.
    window : tuple of float
        Start and end on the clock of the record. [s]
    applies : bool
        False when the row's condition does not hold for the case; ``reason`` states why.
    reason : str
        Why the row does not apply, or why it cannot be judged.
    kind, provenance, source, note : str
        As in the table; ``provenance`` is ``verified``, ``partial``, ``memory`` or ``case file``.
    condition : str
        Condition of the row, words joined by ``;``.
    fraction : float
        Share of the tolerance that is applied (rule R9).
    largest : float, optional
        Largest value in service, base of a lone percentage (rule R3). [SI]
    bounds : tuple of str
        Events between which the row counts; empty words for the window of the case.
    abscissa : str
        Control over which a curve is drawn, surface whose rate is taken, or channel whose change
        bounds a segment.
    """

    name: str
    parameter: str
    channel: str
    measure: str
    group: str
    band: Band
    window: tuple[float, float]
    applies: bool = True
    reason: str = ""
    kind: str = ""
    provenance: str = ""
    source: str = ""
    note: str = ""
    condition: str = ""
    fraction: float = 1.0
    largest: float | None = None
    bounds: tuple[str, str] = ("", "")
    abscissa: str = ""

    @classmethod
    def from_dict(cls, item: Mapping[str, Any]) -> Criterion:
        """Rebuild a criterion from ``dataclasses.asdict``."""
        band = item["band"]
        limits = tuple(Limit(**limit) for limit in band["limits"])
        pairs = {key: (item[key][0], item[key][1]) for key in ("window", "bounds") if key in item}
        return cls(**{**item, **pairs, "band": Band(limits, band["rule"], band["base"])})


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

DISCRETES = {
    "stall_warning": ("stall_warning",),
    "initial_buffet": ("buffet",),
    "touchdown": ("wow_left", "wow_right"),
}
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

MEASURED = frozenset(
    {
        *ACTS,
        *LEVELS,
        *DISCRETES,
        "g_break",
        "static_sweep_start",
        "static_sweep_end",
        "segment_start",
        "segment_end",
    }
)
"""Events that the measures need, in addition to those that bound the windows of rows."""

PARTS = {
    "approach_to_stall": ("", "stall_warning"),
    "warning_to_stall": ("stall_warning", "stall"),
    "stall_break_and_recovery": ("stall", ""),
    "before_g_break": ("", "g_break"),
}
"""Parts of a manoeuvre and the events between which they lie; an empty word is the end of the window."""
