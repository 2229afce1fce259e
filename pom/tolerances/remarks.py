"""Remarks on a row of the verdict table, as data: what kind, of which quantity, with which values and unit, and their text."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import asdict, dataclass, field
from typing import Any

ALLOWED = "; allowed: "
"""Joins a trim beyond its limit and the reason of the case file, in a remark ``trim_allowed``."""


@dataclass(frozen=True)
class RowRemark:
    """One remark on a row of the verdict table.

    Attributes
    ----------
    kind : str
        ``reason`` (why a row is not judged), ``failure`` (of the model's run), ``values`` (what flight and model have), ``cycles``,
        ``no_mode``, ``stability``, ``bank``, ``window`` (a figure of the flight that a shorter window moves), ``outside``,
        ``steady``, ``method``, ``span``, ``event``, ``trend``, ``tick``,
        ``lacking``, ``precondition``, ``certified``, ``no_value`` (a sample without a number), ``trim`` (a trim quantity beyond its
        limit), ``trim_allowed`` (the same, allowed by the case file), ``trim_surface`` (a trim surface that was solved for),
        ``tables_left``, ``waived`` (what the model does without), ``record`` (an error that a check found in the flight record),
        ``watch`` (a channel without a tolerance that is off), ``evidence`` (distance of the model from what flight found),
        ``far_from_evidence`` (terms beyond three standard errors of it), ``row`` (note of the tolerance table), ``note``
        (text of a report that was written before remarks had kinds).
    text : str
        The remark for a reader, with its numbers.
    quantity : str
        Signal or measure it is about; empty for the whole row.
    values : mapping of str to float
        The numbers of the text at full precision, by name: ``flight``, ``model``, ``limit`` ...
    unit : str
        Unit of all `values`; ``1`` for ratios and counts, empty without values.
    """

    kind: str
    text: str
    quantity: str = ""
    values: Mapping[str, float] = field(default_factory=dict)
    unit: str = ""

    def as_dict(self) -> dict[str, Any]:
        """Return all fields."""
        return asdict(self)


def text_of(remarks: Iterable[RowRemark]) -> str:
    """Return remarks as one text.

    Examples
    --------
    >>> text_of([RowRemark("cycles", "6.2 cycles", values={"flight": 6.2}, unit="1"), RowRemark("stability", "stability differs")])
    '6.2 cycles; stability differs'
    """
    return "; ".join(remark.text for remark in remarks)


def reasons(text: str) -> tuple[RowRemark, ...]:
    """Return the remark on a row that is not judged."""
    return (RowRemark("reason", text),)


def row_remarks(row: Mapping[str, Any]) -> tuple[RowRemark, ...]:
    """Return the remarks of a stored row; that of an older report has one text, its ``note``."""
    if "remarks" in row:
        return tuple(item if isinstance(item, RowRemark) else RowRemark(**item) for item in row["remarks"])
    return (RowRemark("note", row["note"]),) if row.get("note") else ()
