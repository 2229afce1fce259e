"""Findings of the check of plausibility: one quantity outside its range, or one that is missing."""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from dataclasses import dataclass, replace

import numpy as np


@dataclass(frozen=True)
class PlausibilityFinding:
    """One quantity outside its range, or one that is missing.

    Attributes
    ----------
    subject : str
        Quantity as it is acknowledged, such as ``Cm/qhat`` or ``static margin``.
    kind : str
        ``implausible``, ``missing``, ``not checked``, or ``unused``: an acknowledgement of a
        subject that no finding has.
    value, low, high : float
        Worst value and its range; NaN where there is none.
    place : str
        Mach numbers, or empty.
    source : str
        Where the range comes from, or why nothing was checked.
    reason : str
        Acknowledgement in the aircraft file, empty without one.
    """

    subject: str
    kind: str
    value: float = np.nan
    low: float = np.nan
    high: float = np.nan
    place: str = ""
    source: str = ""
    reason: str = ""

    @property
    def stops(self) -> bool:
        """Whether the database is implausible: nobody has acknowledged the finding."""
        return self.kind == "implausible" and not self.reason

    def __str__(self) -> str:
        text = f"{self.subject} is {self.kind}"
        if np.isfinite(self.value):
            text = f"{self.subject} = {self.value:.4g} is {self.kind}"
        if self.place:
            text += f" at {self.place}"
        if np.isfinite(self.low) or np.isfinite(self.high):
            text += f"; the range is {self.low:.4g} to {self.high:.4g}"
        if self.source:
            text += f" ({self.source})"
        if self.reason:
            text += f"; acknowledged: {self.reason}"
        return text


def find_outside(
    subject: str, value: float, low: float, high: float, why: str, mach: float
) -> Iterator[tuple[PlausibilityFinding, float]]:
    """Yield a finding, with its Mach number, if a value lies outside its range."""
    if not low <= value <= high:
        yield PlausibilityFinding(subject, "implausible", value, low, high, source=why), mach


def merge_findings(
    found: Iterable[tuple[PlausibilityFinding, float]], machs: np.ndarray
) -> list[PlausibilityFinding]:
    """Return one finding for each subject: the value farthest outside, with all Mach numbers."""
    worst: dict[str, PlausibilityFinding] = {}
    places: dict[str, list[float]] = {}
    for finding, mach in found:
        places.setdefault(finding.subject, []).append(mach)
        earlier = worst.get(finding.subject)
        if earlier is None or _excess(finding) > _excess(earlier):
            worst[finding.subject] = finding
    merged = []
    for subject, finding in worst.items():
        place = "every Mach number"
        if len(places[subject]) < machs.size:
            place = "Mach " + " ".join(f"{mach:g}" for mach in places[subject])
        merged.append(replace(finding, place=place))
    return merged


def _excess(finding: PlausibilityFinding) -> float:
    """Return how far a value lies outside its range."""
    if np.isnan(finding.value):
        return np.inf
    return max(finding.low - finding.value, finding.value - finding.high)
