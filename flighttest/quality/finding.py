"""One thing that is wrong, or worth knowing, with a flight record: named, placed, measured, and with what to do."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import asdict, dataclass, field
from typing import Any

import pandas as pd
import xarray as xr

SEVERITIES = ("error", "warning", "note")
"""An error makes numbers wrong; a warning spoils some, or should be looked at; a note is worth knowing."""


@dataclass(frozen=True)
class Finding:
    """One finding.

    Attributes
    ----------
    severity : str
        One of `SEVERITIES`.
    kind : str
        What it is, in one word: ``sign unit axis definition inconsistent range scale lag`` of consistency, ``gap stray duplicate reset
        missing outside held spike jump wrap saturation stuck noise`` of samples, ``excitation collinear`` of the flying, ``absent
        coarse offset minimum_speed`` of what is worth knowing.
    channels : tuple of str
        Canonical names it concerns; the first one is at fault.
    text : str
        What was found, with numbers.
    remedy : str
        What to do; an entry of the name map where that corrects it.
    start, stop : float or None
        Where, on the record's clock; None for the whole record. [s]
    evidence : dict
        Figures behind it, SI.
    """

    severity: str
    kind: str
    channels: tuple[str, ...]
    text: str
    remedy: str = ""
    start: float | None = None
    stop: float | None = None
    evidence: dict[str, Any] = field(default_factory=dict)

    @property
    def name(self) -> str:
        """Kind and channels in one word: ``sign:delta_r``."""
        return f"{self.kind}:{'+'.join(self.channels)}"

    def as_dict(self) -> dict[str, Any]:
        """Return all fields, with the name."""
        return {"name": self.name, **asdict(self)}


def map_entry(record: xr.DataTree, name: str, change: str) -> str:
    """Return the line of the name map that makes a change to a channel, with what stands there now.

    Parameters
    ----------
    record : DataTree
        The record; its channels determine their column and calibration.
    name : str
        Canonical name.
    change : str
        Keys of the entry, such as ``sign = -1``.
    """
    leaf = next(leaf for leaf, node in record.children.items() if name in node.data_vars)
    about = record[leaf][name].attrs
    calibration = str(about.get("calibration", ""))
    if "column" not in about:
        return f"{change} on what {name} is made of: {calibration or 'see the name map'}"
    column = str(about["column"]).rpartition("/")[2]
    plain = calibration.split(" [")[0]
    if plain == f"- {column}" and change == "sign = -1":
        change = "sign = 1"
    elif plain not in ("", column):
        return f"{change} on top of what stands in the name map now: {name} = {calibration}"
    return f'{name} = {{ column = "{column}", {change} }} in the name map (now: {calibration or column})'


def rows(table: pd.DataFrame) -> Iterator[Any]:
    """Yield the rows of a table as named tuples."""
    yield from table.itertuples()


_CAUSES = {  # what follows from another fault of the same channel
    "noise": ("sign", "unit", "axis", "definition", "spike", "held"),
    "excitation": ("unit",),
    "scale": ("unit", "lag"),
    "range": ("unit", "axis", "definition", "spike"),
    "jump": ("held", "spike", "missing", "wrap"),
    "saturation": ("held", "unit"),
    "inconsistent": ("lag", "held", "spike", "wrap", "jump"),
}


def without_consequences(findings: list[Finding]) -> list[Finding]:
    """Return the findings that do not merely follow from another one of the same channel."""
    causes = {(finding.kind, channel) for finding in findings for channel in finding.channels}
    return [
        finding
        for finding in findings
        if not any((cause, channel) in causes for cause in _CAUSES.get(finding.kind, ()) for channel in _concerned(finding))
    ]


def _concerned(finding: Finding) -> tuple[str, ...]:
    return finding.channels if finding.kind in ("inconsistent", "scale") else finding.channels[:1]


def by_severity(findings: list[Finding]) -> list[Finding]:
    """Return errors first, notes last; the order within stays."""
    return sorted(findings, key=lambda finding: SEVERITIES.index(finding.severity))
