"""Correction of a drafted name map by the checks of the records."""

from __future__ import annotations

import tomllib
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import xarray as xr

import flighttest
from aeromatch.drafting.name_map.name_rows import NameMapRow
from aeromatch.drafting.name_map.names import NamesDraft
from flightmech.errors import SchemaError
from flighttest.records.readers.name_map import Channel

# Kinds of findings whose remedy is a line of the name map.
_REPAIRED = ("sign", "unit", "axis", "definition")
# Greatest number of corrections of one record, and number of records that are checked.
_ROUNDS, _RECORDS = 4, 4


@dataclass(frozen=True)
class MapFinding:
    """An error of a record that no line of the draft corrects, and the channels that it names."""

    channels: tuple[str, ...]
    text: str
    line: str

    @classmethod
    def of(cls, file: Path, finding: Any) -> MapFinding:
        """Return a finding of the check of a record."""
        line = f"{file.name}: {finding.name}: {finding.text}; {finding.remedy}"
        # Where no single channel is at fault, no column is marked.
        channels = () if _is_open(finding) else tuple(finding.channels)
        return cls(channels, finding.text, line)


def check_draft(
    draft: NamesDraft, files: Sequence[Path]
) -> tuple[NamesDraft, dict[str, xr.DataTree], list[MapFinding]]:
    """Return a corrected map, the records read with it, and the remaining findings.

    The largest records are checked. A map of the author is not corrected.

    Notes
    -----
    The remedy of a finding is a line of the name map. It replaces the line that it names, if no
    other remedy explains the record as well. So columns without a stated unit and sign are
    corrected. The reason of a corrected line states the finding.
    """
    remaining: list[MapFinding] = []
    largest = sorted(files, key=lambda file: -file.stat().st_size)[:_RECORDS]
    for file in largest:
        if draft.own is not None:
            remaining += [MapFinding.of(file, finding) for finding in _find_errors(draft, file)]
        else:
            draft = _repair_by_record(draft, file, remaining)
    records = {file.stem: flighttest.read(file, draft.mapping()) for file in files}
    return draft, records, remaining


def _repair_by_record(draft: NamesDraft, file: Path, remaining: list[MapFinding]) -> NamesDraft:
    """Return the draft after the corrections that one record gives.

    A correction may reveal a further error, so the record is checked again after each.
    """
    for _ in range(_ROUNDS):
        findings = _find_errors(draft, file)
        # A finding with an alternative remedy is left to the author.
        certain = []
        for finding in findings:
            if finding.kind in _REPAIRED and not finding.evidence.get("instead"):
                certain.append(finding)
        repaired = _apply_remedies(draft, certain)
        if repaired is None:
            remaining += [MapFinding.of(file, finding) for finding in findings]
            break
        draft = repaired
    return draft


def _find_errors(draft: NamesDraft, file: Path) -> list[Any]:
    """Return the errors and contradictions of a record; none without a channel of motion."""
    record = flighttest.read(file, draft.mapping())
    try:
        findings = flighttest.assess(record).findings
    except SchemaError:
        return []
    return [finding for finding in findings if finding.severity == "error" or _is_open(finding)]


def _is_open(finding: Any) -> bool:
    """Return whether channels contradict each other, and no single line of a map resolves it.

    Two signs that are wrong together, such as those of bank and roll rate, show only here.
    """
    return finding.kind == "inconsistent"


def _apply_remedies(draft: NamesDraft, findings: Sequence[Any]) -> NamesDraft | None:
    """Return the draft with the lines of the findings, or None if no line changes."""
    corrections: dict[str, tuple[Channel, str]] = {}
    for finding in findings:
        try:
            lines = tomllib.loads(finding.remedy)
        except tomllib.TOMLDecodeError:
            # The remedy is a sentence and not a line.
            continue
        for name, entry in _flatten_engines(lines).items():
            keys = entry if isinstance(entry, dict) else {"column": entry}
            corrections[name] = Channel(**keys), finding.text.split(" (")[0]
    rows = tuple(_correct_row(row, corrections) for row in draft.rows)
    if rows == draft.rows:
        return None
    # A unit that waited for the author is known now.
    answered = tuple(f"{name} from column " for name in corrections)
    remarks = tuple(text for text in draft.remarks if not text.startswith(answered))
    return replace(draft, rows=rows, remarks=remarks)


def _correct_row(row: NameMapRow, corrections: Mapping[str, tuple[Channel, str]]) -> NameMapRow:
    if row.name not in corrections:
        return row
    channel, text = corrections[row.name]
    return replace(
        row,
        channel=channel.changed(optional=row.channel.optional),
        reason=f"by the check of the record: {text}",
        unit=str(channel.unit or row.unit),
        confidence="by the check",
    )


def _flatten_engines(lines: Mapping[str, Any]) -> dict[str, Any]:
    """Return the channels of lines by name; TOML reads ``engine1.n1`` as a table in a table."""
    channels: dict[str, Any] = {}
    for name, entry in lines.items():
        is_table = isinstance(entry, dict) and "column" not in entry
        if name.startswith("engine") and is_table:
            for key, item in entry.items():
                channels[f"{name}.{key}"] = item
        else:
            channels[name] = entry
    return channels
