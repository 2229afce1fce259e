"""One thing that a reader of estimates must know, as data: what kind, of which term, how large,
beyond which threshold.
"""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import asdict, dataclass
from math import nan
from typing import Any

SEVERITIES = ("error", "warning", "note")
"""With an error the figure must not be used; a warning restricts its use; a note is worth knowing."""


@dataclass(frozen=True)
class Remark:
    """One remark on estimates.

    Attributes
    ----------
    kind : str
        ``no excitation``, ``not significant``, ``sign``, ``unexplained``, ``spike``, ``collinear``,
        ``offset``, ``disturbance``, ``prior``, ``scatter``, ``bound``, ``convergence`` ...
    text : str
        What was found, with numbers, and what to do.
    term : str
        Term, parameter or channel it is about; empty for the whole fit.
    value, threshold : float
        The figure and the level beyond which it is remarked; NaN where there is none.
    severity : str
        One of `SEVERITIES`.
    """

    kind: str
    text: str
    term: str = ""
    value: float = nan
    threshold: float = nan
    severity: str = "warning"

    def __post_init__(self):
        if self.severity not in SEVERITIES:
            raise ValueError(f"severity is {self.severity!r}; allowed: {', '.join(SEVERITIES)}")

    def __str__(self) -> str:
        return self.text

    def as_dict(self) -> dict[str, Any]:
        """Return all fields."""
        return asdict(self)


def is_forbidden(remarks: Iterable[Remark]) -> bool:
    """Return whether a remark forbids the use of a figure."""
    return any(remark.severity == "error" for remark in remarks)


def remark_lines(remarks: Iterable[Remark]) -> list[str]:
    """Return the remarks as lines of a report: ``!!`` where a figure must not be used, ``!``
    otherwise.
    """
    return [f"{'!!' if remark.severity == 'error' else '!'} {remark.text}" for remark in remarks]


def remarks_to_json(remarks: Iterable[Remark]) -> list[dict[str, Any]]:
    """Return the remarks for JSON."""
    return [remark.as_dict() for remark in remarks]
