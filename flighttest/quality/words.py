"""The quality of a record as plain text."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from flightmech.units import from_si

from .finding import rows

if TYPE_CHECKING:
    from .assessment import Quality
    from .finding import Finding


def shown(value: float, units: str) -> str:
    """Return an SI value in the unit in which people read it."""
    display = {"rad": "deg", "rad s-1": "deg/s"}.get(units, units)
    number = from_si(value, display) if display != units else value
    return f"{number:.3g} {display}" if display != "1" else f"{number:.3g}"


def told(moving: bool, correlation: float) -> bool:
    """Whether slope and correlation of a comparison say anything."""
    return moving or correlation > 0.95


def report(quality: Quality) -> str:
    """Return findings, kinematic consistency, delays, answers and excitation as text."""
    parts = [_head(quality), *(_entry(finding) for finding in quality.findings), "", *_kinematics(quality), *_delays(quality)]
    return "\n".join([*parts, *_answers(quality), *_excitation(quality)])


def _head(quality: Quality) -> str:
    facts = quality.facts
    name = f" of {facts['aircraft']}" if facts["aircraft"] else ""
    return f"{facts['title']}{name}: {facts['begin']:g} ... {facts['end']:g} s, {facts['in_flight']:.0%} in flight\n{quality.verdict}\n"


def _entry(finding: Finding) -> str:
    place = f" [{finding.start:g} ... {finding.stop:g} s]" if finding.start is not None else ""
    remedy = f"\n    {finding.remedy}" if finding.remedy else ""
    return f"{finding.severity:8s} {finding.name}{place}\n    {finding.text}{remedy}"


def _kinematics(quality: Quality) -> list[str]:
    lines = ["kinematic consistency, mistakes undone; disagreement 0 equal, 0.7 unrelated, 1 opposite:"]
    for row in rows(quality.kinematics):
        mark = " " if row.consistent else "!"
        what = (
            f"slope {row.slope:7.3f} ({row.slope_stderr:.3f})  correlation {row.correlation:+.3f}"
            if told(row.moving, row.correlation)
            else "too little motion to compare"
        )
        lines.append(f"{mark} {row.title:45s} {row.disagreement:5.2f}  {what}  offset {shown(row.offset, row.units)}")
    return lines


def _delays(quality: Quality) -> list[str]:
    if quality.delays.empty:
        return []
    lines = ["", "delays, positive when late:"]
    return lines + [
        f"  {row.channel:12s} against {row.against:14s} {1e3 * row.delay:+7.1f} ms (standard error {1e3 * row.stderr:.1f} ms)"
        for row in rows(quality.delays)
    ]


def _answers(quality: Quality) -> list[str]:
    if quality.answers.empty:
        return []
    lines = ["", "answers to the surfaces (house: all negative):"]
    return lines + [
        f"  {row.rate}_dot over {row.surface:8s} {row.effect:+8.2f} 1/s2 per rad ({row.stderr:.2f})  R2 {row.R2:.2f}, "
        f"recorded {1e3 * row.lead:+.0f} ms early"
        for row in rows(quality.answers)
    ]


def _excitation(quality: Quality) -> list[str]:
    if quality.excitation.empty:
        return []
    lines = ["", "excitation:"]
    for row in rows(quality.excitation):
        moved = f"{row.surface} {np.degrees(row.input):.2g} deg, {row.rate} {np.degrees(row.response):.2g} deg/s rms at most"
        lines.append(f"  {row.axis:6s} {moved}; {row.share:.0%} of the flight, nine tenths below {row.frequency:.2g} Hz")
    return lines
