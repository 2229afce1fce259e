"""Criterion: one row of the tolerance table with its measure, channel and band."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

# By base of a percentage: its text behind the percentage.
_BASES = {
    "ref_local": "of the flight value",
    "ref_peak": "of the largest flight value",
    "ref_scalar": "of the flight value",
    "range_max": "of the largest value in service",
    "first_overshoot": "of the first overshoot",
}


@dataclass(frozen=True)
class Limit:
    """One half width as the table prints it.

    Examples are ``Limit("absolute", 1.5, "deg")`` and ``Limit("percent", 10.0, "%")``.
    ``quantity`` is ``absolute``, ``percent``, ``percent_times_n_plus_1`` (times the number of the
    cycle plus one) or ``floor`` (one sided, the value is in the case).
    """

    quantity: str
    value: float
    unit: str

    @property
    def text(self) -> str:
        """The limit as printed."""
        if self.quantity == "percent_times_n_plus_1":
            return f"{self.value:g}(n+1) %"
        # ratios and counts have no unit in print
        if self.unit in ("-", "1", ""):
            return f"{self.value:g}"
        return f"{self.value:g} {self.unit}"


@dataclass(frozen=True)
class Band:
    """One or two limits and the rule that joins them.

    ``rule`` is ``single``, ``greater_of`` or ``lesser_of``.  ``base`` is the value of which a
    percentage is taken: ``ref_local`` (flight value at the same instant or abscissa), ``ref_peak``
    (largest flight magnitude of the window), ``ref_scalar`` (flight value of the scalar measure),
    ``first_overshoot`` (of the flight), ``range_max`` (maximum of the normal operating range).
    """

    limits: tuple[Limit, ...] = ()
    rule: str = "single"
    base: str = ""

    @property
    def text(self) -> str:
        """The tolerance as printed, e.g. ``10 % of the flight value or 2 deg/s, the greater``."""
        if any(limit.quantity == "floor" for limit in self.limits):
            return "not below the certified value"
        texts = []
        for limit in self.limits:
            text = limit.text
            # a percentage states its base, an absolute limit has none
            if limit.unit == "%":
                text = f"{text} {_BASES.get(self.base, '')}".strip()
            texts.append(text)
        joined = " or ".join(texts)
        if self.rule == "greater_of":
            return f"{joined}, the greater"
        if self.rule == "lesser_of":
            return f"{joined}, the smaller"
        return joined


@dataclass(frozen=True)
class Criterion:
    """One tolerance on one parameter of one case.

    Attributes
    ----------
    name : str
        Unique within the case, e.g. ``pitch_angle`` or ``bank_angle trend``.
    parameter : str
        Name in the tolerance table; empty for a criterion of the case file.
    channel : str
        Canonical name of the judged quantity: a signal, or a quantity derived from signals such as
        ``distance``.  Empty for a demonstration, which people judge.
    measure : str
        ``trace``, ``steady``, ``period`` ...
    group : str
        Criteria of one group are alternatives, different groups must all pass.
    band : Band
        The tolerance as printed.
    window : tuple of float
        Start and end on the clock of the record. [s]
    applies : bool
        False if the case does not meet the condition of the row; ``reason`` states why.
    reason : str
        Reason why the row does not apply, or cannot be judged.
    kind, provenance, source, note : str
        As in the table; ``provenance`` is ``verified``, ``partial``, ``memory`` or ``case file``.
    condition : str
        Conditions of the row, joined by ``;``.
    fraction : float
        Share of the tolerance that is applied (rule R9).
    largest : float, optional
        Largest value in service, base of a lone percentage (rule R3). [SI]
    bounds : tuple of str
        Events between which the row counts; an empty text is a bound of the window of the case.
    abscissa : str
        Control on the abscissa of a curve, surface of a rate, or channel whose change bounds a
        segment.
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
        fields = {**item, "band": Band(limits, band["rule"], band["base"])}
        # JSON has lists in place of tuples; an older report has no `bounds`
        for key in ("window", "bounds"):
            if key in item:
                fields[key] = (item[key][0], item[key][1])
        return cls(**fields)


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
"""Events that pilot or record cause, so that flight and model have them at the same time."""

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
"""By event: a channel, and the direction in which it passes its flight value at the event."""

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
"""By part of a manoeuvre: its first and last event; an empty text is a bound of the window."""
