"""Table of all columns of the recordings: what each one is taken for, and why."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import asdict, dataclass

from aeromatch.drafting.name_map.name_repair import MapFinding
from aeromatch.drafting.name_map.name_rows import NameMapRow
from aeromatch.drafting.name_map.names import NamesDraft
from flightmech.names import lookup

# Confidence of a column whose channel a check contradicts, and of a column without a channel.
_CONTRADICTS, _NOT_TAKEN = "contradicts", "not taken"

# Rate that shows the sign of a surface in the record.
_SIGN_BY = {
    "delta_e": "q",
    "delta_a": "p",
    "delta_a_left": "p",
    "delta_a_right": "p",
    "delta_r": "r",
}


@dataclass(frozen=True)
class ColumnRow:
    """One column of the recordings.

    Attributes
    ----------
    column : str
    quantity : str
        Canonical name, or ``-``.
    unit, sign : str
        Unit of the column, and ``-`` if its positive sense is the opposite one.
    confidence : str
        As of `NameMapRow`; ``contradicts`` if a check of the record contradicts the line, or
        ``not taken``.
    reason : str
    """

    column: str
    quantity: str
    unit: str
    sign: str
    confidence: str
    reason: str

    def to_dict(self) -> dict[str, str]:
        """Return the row as plain data."""
        return asdict(self)


def describe_columns(
    names: NamesDraft, findings: Sequence[MapFinding], left_out: Sequence[str]
) -> list[ColumnRow]:
    """Return a row for each column of the recordings.

    Parameters
    ----------
    names : NamesDraft
    findings : sequence of MapFinding
        Errors of the records that remain with the map.
    left_out : sequence of str
        Columns without a channel.
    """
    contradictions: dict[str, str] = {}
    for finding in findings:
        # The first channel of a finding is at fault.
        for name in finding.channels[:1]:
            contradictions.setdefault(name, finding.text)
    rows = []
    known = {row.name for row in names.all_rows()}
    for row in names.all_rows():
        needed = _SIGN_BY.get(row.name, "")
        is_sign_open = needed != "" and needed not in known and row.confidence == "stated"
        rows.append(_describe_row(row, contradictions.get(row.name, ""), is_sign_open))
    reasons = {item.column: item.reason for item in names.left_out}
    for column in left_out:
        reason = reasons.get(column, "not in your map")
        rows.append(ColumnRow(column, "-", "", sign="", confidence=_NOT_TAKEN, reason=reason))
    return rows


def _describe_row(row: NameMapRow, contradiction: str, is_sign_open: bool) -> ColumnRow:
    confidence, reason = row.confidence, row.reason or lookup(row.name).long_name
    if is_sign_open and not row.reason:
        confidence = "CONFIRM"
        reason = f"its sign is not stated, and without {_SIGN_BY[row.name]} not checked"
    if contradiction:
        confidence, reason = _CONTRADICTS, contradiction
    return ColumnRow(
        column=", ".join(row.channel.columns),
        quantity=row.name,
        unit=row.unit,
        sign="-" if row.channel.sign < 0 else "+",
        confidence=confidence,
        reason=reason.removeprefix("CONFIRM: "),
    )
