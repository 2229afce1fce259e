"""The result of the assessment of a record, and its text."""

from __future__ import annotations

import json
from dataclasses import dataclass, field
from typing import Any

import numpy as np
import pandas as pd

from flightmech.quantities import time_text
from flightmech.short_text import ShortText
from flightmech.support.console import to_json_types
from flightmech.units import from_si
from flighttest.reconstruction.quality.checks.relation_check import RelationCheck
from flighttest.reconstruction.quality.checks.signals import ResampledChannels
from flighttest.reconstruction.quality.finding import SEVERITIES, Finding, iterate_rows

# Tables of a result with one dict per row in JSON.
_RECORD_TABLES = (
    "channels",
    "kinematics",
    "not_checked",
    "delays",
    "answers",
    "hands",
    "excitation",
)
# Correlation of two sides of a relation above which their slope is informative.
_CORRELATED = 0.95


def format_display_value(value: float, units: str) -> str:
    """Return the text of an SI value; angles are in degrees."""
    display = {"rad": "deg", "rad s-1": "deg/s"}.get(units, units)
    if display != units:
        value = from_si(value, display)
    if display == "1":
        return f"{value:.3g}"
    return f"{value:.3g} {display}"


def is_meaningful(moving: bool, correlation: float) -> bool:
    """Return whether slope and correlation of a comparison are informative."""
    return moving or correlation > _CORRELATED


@dataclass(frozen=True)
class Quality(ShortText):
    """The result of `assess`.

    Attributes
    ----------
    facts : dict
        Title, source file, start, purpose, begin and end [s], share in flight, aircraft.
    findings : list of Finding
        Errors first.
    channels, kinematics, delays, answers, hands, excitation, correlation : DataFrame
        Tables of the checks, SI, see the functions that return them.
    comparisons : dict of RelationCheck
        Both sides of every relation, without mistakes.
    as_read : dict of RelationCheck
        Both sides of every relation in the record as read.
    signals : ResampledChannels
        As recorded, on the slow clock of the checks.
    not_checked : DataFrame
        Relations that the record cannot check: ``relation title missing reason``.
    faults : DataFrame
        Faulty samples and gaps of the clock: ``leaf channel kind start stop samples note``. [s]
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
    faults: pd.DataFrame = field(default_factory=pd.DataFrame)

    def count(self, severity: str) -> int:
        """Return the number of findings of one severity."""
        return sum(finding.severity == severity for finding in self.findings)

    @property
    def usable(self) -> bool:
        """Whether no finding makes results wrong."""
        return self.count("error") == 0

    @property
    def verdict(self) -> str:
        """Fitness for use and the numbers of findings, in one line."""
        counts = []
        for severity in SEVERITIES:
            number = self.count(severity)
            plural = "s"
            if number == 1:
                plural = ""
            counts.append(f"{number} {severity}{plural}")
        return f"{self._fitness()}: {', '.join(counts)}"

    def _fitness(self) -> str:
        if not self.usable:
            return "not fit for identification as read"
        if self.count("warning"):
            return "fit for use, with care"
        return "sound"

    def to_dataframe(self) -> pd.DataFrame:
        """Return the table of findings: ``name severity kind channels text remedy start stop``."""
        columns = ["name", "severity", "kind", "channels", "text", "remedy", "start", "stop"]
        rows = [finding.as_dict() for finding in self.findings]
        return pd.DataFrame(rows, columns=columns)

    def report(self) -> str:
        """Return the findings and tables as text."""
        return format_quality(self)

    def as_dict(self) -> dict[str, Any]:
        """Return all results but the time histories, with types of JSON."""
        tables: dict[str, Any] = {}
        for name in _RECORD_TABLES:
            tables[name] = getattr(self, name).to_dict("records")
        tables["correlation"] = self.correlation.to_dict()
        return to_json_types(
            {
                "facts": self.facts,
                "verdict": self.verdict,
                "findings": [finding.as_dict() for finding in self.findings],
                **tables,
            }
        )

    def to_json(self) -> str:
        """Return `as_dict` as text."""
        return json.dumps(self.as_dict(), indent=2, ensure_ascii=False)


def format_quality(quality: Quality) -> str:
    """Return findings, kinematic consistency, delays, answers and excitation as text."""
    lines = [_head(quality)]
    lines += [_finding_text(finding) for finding in quality.findings]
    lines += ["", *_kinematic_lines(quality), *_unchecked_lines(quality)]
    lines += [*_delay_lines(quality), *_answer_lines(quality), *_excitation_lines(quality)]
    return "\n".join(lines)


def _head(quality: Quality) -> str:
    facts = quality.facts
    title = facts["title"]
    if facts["aircraft"]:
        title += f" of {facts['aircraft']}"
    return (
        f"{title}: {time_text(facts['begin'])} ... {time_text(facts['end'])} s, "
        f"{facts['in_flight']:.0%} in flight\n{quality.verdict}\n"
    )


def _finding_text(finding: Finding) -> str:
    head = f"{finding.severity:8s} {finding.name}"
    if finding.start is not None and finding.stop is not None:
        head += f" [{time_text(finding.start)} ... {time_text(finding.stop)} s]"
    text = f"{head}\n    {finding.text}"
    if finding.remedy:
        text += f"\n    {finding.remedy}"
    return text


def _kinematic_lines(quality: Quality) -> list[str]:
    lines = [
        "kinematic consistency, mistakes undone; disagreement 0 equal, 0.7 unrelated, 1 opposite:"
    ]
    for row in iterate_rows(quality.kinematics):
        symbol = "!"
        if row.consistent:
            symbol = " "
        slope = "too little motion to compare"
        if is_meaningful(row.moving, row.correlation):
            slope = (
                f"slope {row.slope:7.3f} ({row.slope_stderr:.3f})  "
                f"correlation {row.correlation:+.3f}"
            )
        offset = format_display_value(row.offset, row.units)
        lines.append(f"{symbol} {row.title:45s} {row.disagreement:5.2f}  {slope}  offset {offset}")
    return lines


def _unchecked_lines(quality: Quality) -> list[str]:
    if quality.not_checked.empty:
        return []
    lines = ["", "not checked:"]
    for row in iterate_rows(quality.not_checked):
        lines.append(f"  {row.title:45s} {row.reason}")
    return lines


def _delay_lines(quality: Quality) -> list[str]:
    if quality.delays.empty:
        return []
    lines = ["", "delays, positive when late:"]
    for row in iterate_rows(quality.delays):
        accuracy = f"standard error {1e3 * row.stderr:.1f} ms"
        if row.bound:
            accuracy = "at least"
        lines.append(
            f"  {row.channel:12s} against {row.against:14s} {1e3 * row.delay:+7.1f} ms ({accuracy})"
        )
    return lines


def _answer_lines(quality: Quality) -> list[str]:
    if quality.answers.empty:
        return []
    lines = ["", "answers to the surfaces (convention: all negative):"]
    for row in iterate_rows(quality.answers):
        lines.append(
            f"  {row.rate}_dot over {row.surface:8s} {row.effect:+8.2f} 1/s2 per rad "
            f"({row.stderr:.2f})  R2 {row.R2:.2f}, {_lead_text(row)}"
        )
    return lines


def _lead_text(row) -> str:
    """Return the time between record and effect of a surface."""
    direction = "late"
    if row.lead > 0.0:
        direction = "early"
    lead = f"{1e3 * abs(row.lead):.0f} ms {direction}"
    # The end of the search is a limit. A lead without standard error is not measured.
    if row.bound:
        return f"recorded at least {lead}"
    if not np.isfinite(row.lead_stderr):
        return "time not determined"
    return f"recorded {lead} (standard error {1e3 * row.lead_stderr:.0f} ms)"


def _excitation_lines(quality: Quality) -> list[str]:
    if quality.excitation.empty:
        return []
    lines = ["", "excitation:"]
    for row in iterate_rows(quality.excitation):
        motion = (
            f"{row.surface} {np.degrees(row.input):.2g} deg, {row.rate} "
            f"{np.degrees(row.response):.2g} deg/s rms at most"
        )
        lines.append(
            f"  {row.axis:6s} {motion}; {row.share:.0%} of the flight, nine tenths below "
            f"{row.frequency:.2g} Hz"
        )
    return lines
