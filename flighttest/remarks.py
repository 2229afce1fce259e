"""Remarks on estimates as data, and the text of a result with its remarks."""

from __future__ import annotations

import warnings
from collections.abc import Iterable
from dataclasses import asdict, dataclass
from html import escape
from math import nan
from typing import TYPE_CHECKING, Any, Protocol

from flightmech.errors import AeromatchWarning
from flightmech.short_text import ShortText

if TYPE_CHECKING:
    import pandas as pd
    import xarray as xr

SEVERITIES = ("error", "warning", "note")
"""With an error the figure must not be used; a warning restricts its use; a note is worth knowing.
"""


@dataclass(frozen=True)
class Remark:
    """One remark on estimates.

    Attributes
    ----------
    kind : str
        ``no excitation``, ``not significant``, ``sign``, ``unexplained``, ``systematic``, ``rest``,
        ``spike``, ``collinear``, ``offset``, ``disturbance``, ``prior``, ``scatter``, ``bound``,
        ``convergence`` ...
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


@dataclass(frozen=True)
class Convergence:
    """End of an iteration, for results that state whether it converged.

    Attributes
    ----------
    converged : bool
        Whether the last change was within its tolerance.
    iterations : int
        Number of iterations.
    change : float
        Last change divided by its tolerance; infinite if the iteration diverged. [1]
    """

    converged: bool
    iterations: int
    change: float

    def remarks(
        self, subject: str, advice: str, term: str = "", severity: str = "error"
    ) -> list[Remark]:
        """Return a remark on an iteration that did not converge, or an empty list.

        Parameters
        ----------
        subject : str
            Name of the iteration.
        advice : str
            Consequence for the estimates, and what to do.
        term : str
            Term, parameter or channel of the remark.
        severity : str
            One of `SEVERITIES`.
        """
        if self.converged:
            return []
        text = (
            f"{subject}: not converged after {self.iterations} iterations, last change "
            f"{self.change:.3g} times its tolerance; {advice}"
        )
        return [
            Remark("convergence", text, term, value=self.change, threshold=1.0, severity=severity)
        ]

    def as_dict(self) -> dict[str, Any]:
        """Return all fields."""
        return asdict(self)


def warn_forbidden(remarks: Iterable[Remark], subject: str) -> None:
    """Warn of remarks that forbid the use of a figure when it is used in spite of them.

    Parameters
    ----------
    remarks : iterable of Remark
        Remarks on the estimates.
    subject : str
        Name of the result, at the beginning of each warning.

    Warns
    -----
    AeromatchWarning
        For each remark of the severity ``error``.
    """
    for remark in remarks:
        if remark.severity == "error":
            warnings.warn(f"{subject}: {remark.text}", AeromatchWarning, stacklevel=3)


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


class HasRemarks(Protocol):
    """A result from whose lines and remarks all its texts are formed."""

    @property
    def remarks(self) -> Iterable[Remark]:
        """Remarks that forbid or restrict the use of the figures."""

    def report_lines(self) -> list[str]:
        """Return heading and tables as lines."""

    def report(self) -> str:
        """Return the text."""


class TabledEstimates:
    """Base of a result whose Dataset ``estimates`` is a table too."""

    estimates: xr.Dataset

    def to_dataframe(self) -> pd.DataFrame:
        """Return the estimates as a table.

        Returns
        -------
        DataFrame
            One row per estimate, with the columns of `estimates` that have one number or word per
            estimate: ``estimate stderr`` ... The units are those of `estimates`.
        """
        return table_of_estimates(self.estimates)


def table_of_estimates(estimates: xr.Dataset) -> pd.DataFrame:
    """Return the variables of estimates that have one value per estimate, as a table."""
    import pandas as pd  # texts of remarks do without it

    (dimension,) = estimates["estimate"].dims
    columns = {}
    for name, item in estimates.data_vars.items():
        if item.dims == (dimension,):
            columns[str(name)] = item.values
    index = pd.Index(estimates[dimension].values, name=str(dimension))
    return pd.DataFrame(columns, index=index)


class PrintedResult(ShortText):
    """Base of a result that defines `HasRemarks.remarks` and `HasRemarks.report_lines`."""

    def report(self: HasRemarks) -> str:
        """Return the result as text, with one line for each remark at the end."""
        return "\n".join([*self.report_lines(), *remark_lines(self.remarks)]).rstrip()

    def _repr_html_(self: HasRemarks) -> str:
        """Return the text for a notebook."""
        return f"<pre>{escape(self.report())}</pre>"
