"""What the assessment of a record found, and its text."""

from __future__ import annotations

import json
from dataclasses import dataclass
from typing import Any

import numpy as np
import pandas as pd

from flightmech.support.console import to_json_types
from flightmech.units import from_si
from flighttest.reconstruction.quality.checks.relation_check import RelationCheck
from flighttest.reconstruction.quality.checks.signals import ResampledChannels
from flighttest.reconstruction.quality.finding import SEVERITIES, Finding, iterate_rows


def format_display_value(value: float, units: str) -> str:
    """Return an SI value in the unit in which people read it."""
    display = {"rad": "deg", "rad s-1": "deg/s"}.get(units, units)
    number = from_si(value, display) if display != units else value
    return f"{number:.3g} {display}" if display != "1" else f"{number:.3g}"


def is_meaningful(moving: bool, correlation: float) -> bool:
    """Whether slope and correlation of a comparison mean anything."""
    return moving or correlation > 0.95


@dataclass(frozen=True)
class Quality:
    """What `assess` found.

    Attributes
    ----------
    facts : dict
        Title, source file, start, purpose, duration [s], share in flight, aircraft.
    findings : list of Finding
        Errors first.
    channels, kinematics, delays, answers, hands, excitation, correlation : DataFrame
        The figures behind them, SI, see the functions that make them.
    comparisons : dict of Comparison
        Both sides of every relation, mistakes undone.
    as_read : dict of Comparison
        The same before any mistake is undone.
    signals : Signals
        As recorded, on the slow clock of the checks.
    not_checked : DataFrame
        Relations that the record cannot speak to: ``relation title missing reason``.
    """

    facts: dict[str, Any]
    findings: list[Finding]
    channels: pd.DataFrame
    kinematics: pd.DataFrame
    delays: pd.DataFrame
    answers: pd.DataFrame
    hands: pd.DataFrame
    excitation: pd.DataFrame
    correlation: pd.DataFrame
    comparisons: dict[str, RelationCheck]
    as_read: dict[str, RelationCheck]
    signals: ResampledChannels
    not_checked: pd.DataFrame

    def count(self, severity: str) -> int:
        """Return the number of findings of one severity."""
        return sum(finding.severity == severity for finding in self.findings)

    @property
    def usable(self) -> bool:
        """Whether nothing was found that makes numbers wrong."""
        return self.count("error") == 0

    @property
    def verdict(self) -> str:
        """The whole in one line."""
        counts = ", ".join(
            f"{self.count(s)} {s}{'s' if self.count(s) != 1 else ''}" for s in SEVERITIES
        )
        head = (
            "not fit for identification as read"
            if not self.usable
            else "fit for use, with care"
            if self.count("warning")
            else "sound"
        )
        return f"{head}: {counts}"

    def report(self) -> str:
        """Return the findings and figures as text."""
        return format_quality(self)

    def as_dict(self) -> dict[str, Any]:
        """Return everything but the time histories, made of types that JSON knows."""
        tables = (
            "channels",
            "kinematics",
            "not_checked",
            "delays",
            "answers",
            "hands",
            "excitation",
            "correlation",
        )
        found = {
            name: getattr(self, name).to_dict("records") for name in tables if name != "correlation"
        }
        found["correlation"] = self.correlation.to_dict()
        return to_json_types(
            {
                "facts": self.facts,
                "verdict": self.verdict,
                "findings": [f.as_dict() for f in self.findings],
                **found,
            }
        )

    def to_json(self) -> str:
        """Return `as_dict` as text."""
        return json.dumps(self.as_dict(), indent=2, ensure_ascii=False)


def format_quality(quality: Quality) -> str:
    """Return findings, kinematic consistency, delays, answers and excitation as text."""
    parts = [
        _head(quality),
        *(_entry(finding) for finding in quality.findings),
        "",
        *_kinematics(quality),
        *_not_checked(quality),
        *_delays(quality),
    ]
    return "\n".join([*parts, *_answers(quality), *_excitation(quality)])


def _head(quality: Quality) -> str:
    facts = quality.facts
    name = f" of {facts['aircraft']}" if facts["aircraft"] else ""
    return (
        f"{facts['title']}{name}: {facts['begin']:g} ... {facts['end']:g} s, "
        f"{facts['in_flight']:.0%} in flight\n{quality.verdict}\n"
    )


def _entry(finding: Finding) -> str:
    place = f" [{finding.start:g} ... {finding.stop:g} s]" if finding.start is not None else ""
    remedy = f"\n    {finding.remedy}" if finding.remedy else ""
    return f"{finding.severity:8s} {finding.name}{place}\n    {finding.text}{remedy}"


def _kinematics(quality: Quality) -> list[str]:
    lines = [
        "kinematic consistency, mistakes undone; disagreement 0 equal, 0.7 unrelated, 1 opposite:"
    ]
    for row in iterate_rows(quality.kinematics):
        symbol = " " if row.consistent else "!"
        what = (
            f"slope {row.slope:7.3f} ({row.slope_stderr:.3f})  correlation {row.correlation:+.3f}"
            if is_meaningful(row.moving, row.correlation)
            else "too little motion to compare"
        )
        lines.append(
            f"{symbol} {row.title:45s} {row.disagreement:5.2f}  {what}  offset "
            f"{format_display_value(row.offset, row.units)}"
        )
    return lines


def _not_checked(quality: Quality) -> list[str]:
    if quality.not_checked.empty:
        return []
    return [
        "",
        "not checked:",
        *(f"  {row.title:45s} {row.reason}" for row in iterate_rows(quality.not_checked)),
    ]


def _delays(quality: Quality) -> list[str]:
    if quality.delays.empty:
        return []
    lines = ["", "delays, positive when late:"]
    return lines + [
        f"  {row.channel:12s} against {row.against:14s} {1e3 * row.delay:+7.1f} ms "
        f"({'at least' if row.bound else f'standard error {1e3 * row.stderr:.1f} ms'})"
        for row in iterate_rows(quality.delays)
    ]


def _answers(quality: Quality) -> list[str]:
    if quality.answers.empty:
        return []
    lines = ["", "answers to the surfaces (convention: all negative):"]
    return lines + [
        f"  {row.rate}_dot over {row.surface:8s} {row.effect:+8.2f} 1/s2 per rad "
        f"({row.stderr:.2f})  R2 {row.R2:.2f}, {_recorded(row)}"
        for row in iterate_rows(quality.answers)
    ]


def _recorded(row) -> str:
    """Return when a surface is recorded; the end of the search is a limit, and one without a
    standard error is not measured.
    """
    when = f"{1e3 * abs(row.lead):.0f} ms {'early' if row.lead > 0.0 else 'late'}"
    if row.bound:
        return f"recorded at least {when}"
    return (
        f"recorded {when} (standard error {1e3 * row.lead_stderr:.0f} ms)"
        if np.isfinite(row.lead_stderr)
        else "time not determined"
    )


def _excitation(quality: Quality) -> list[str]:
    if quality.excitation.empty:
        return []
    lines = ["", "excitation:"]
    for row in iterate_rows(quality.excitation):
        moved = (
            f"{row.surface} {np.degrees(row.input):.2g} deg, {row.rate} "
            f"{np.degrees(row.response):.2g} deg/s rms at most"
        )
        lines.append(
            f"  {row.axis:6s} {moved}; {row.share:.0%} of the flight, nine tenths below "
            f"{row.frequency:.2g} Hz"
        )
    return lines
