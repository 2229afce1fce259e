"""Checks of the flight records behind a report: a pass against a faulty record does not count as a pass."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import dataclass, replace
from pathlib import Path

import xarray as xr

import flighttest
from flightmech import Aircraft
from flightmech.errors import AeromatchError

from ..result import PomResult, verdict_table
from ..tolerances.remarks import RowRemark


@dataclass(frozen=True)
class RecordError:
    """An error that a check found in a flight record.

    Attributes
    ----------
    name : str
        Kind and channels, ``sign:delta_e``.
    text : str
        What was found, and the remedy.
    start, stop : float or None
        Part of the record; None for the whole record. [s]
    """

    name: str
    text: str
    start: float | None = None
    stop: float | None = None

    def concerns(self, window: tuple[float, float]) -> bool:
        """Return whether the error lies inside a window of the record, or concerns all of it."""
        if self.start is None or self.stop is None:
            return True
        return self.start <= window[1] and window[0] <= self.stop


@dataclass(frozen=True)
class RecordCheck:
    """The check of one flight record (`flighttest.assess`).

    Attributes
    ----------
    record : str
        Name of the record.
    verdict : str
        The result in one line.
    errors : tuple of RecordError
    """

    record: str
    verdict: str
    errors: tuple[RecordError, ...] = ()

    @classmethod
    def of(cls, name: str, record: xr.DataTree, aircraft: Aircraft | None) -> RecordCheck:
        """Return the check of a record; of one that cannot be checked the reason as its verdict."""
        try:
            quality = flighttest.assess(record, aircraft)
        except AeromatchError as error:
            return cls(name, f"not checked: {error}")
        found = [
            RecordError(item.name, _in_one_line(item.text, item.remedy), item.start, item.stop)
            for item in quality.findings
            if item.severity == "error"
        ]
        return cls(name, quality.verdict, tuple(found))

    def lines(self) -> list[str]:
        """Return the errors, a line each."""
        return [f"record {self.record}: {error.name}{_place(error)}: {error.text}" for error in self.errors]


def check_records(records: Mapping[str, xr.DataTree], aircraft: Aircraft | None, jobs: int = 1) -> dict[str, RecordCheck]:
    """Return the check of every record by name; the same for any number of processes.

    Parameters
    ----------
    records : mapping of str to DataTree
        As `flighttest.read` returns them.
    aircraft : Aircraft or None
        With its instruments.
    jobs : int
        Processes; -1 for one per core.
    """
    from joblib import Parallel, delayed

    calls = (delayed(RecordCheck.of)(name, record, aircraft) for name, record in records.items())
    return dict(zip(records, Parallel(n_jobs=jobs if len(records) > 1 else 1)(calls), strict=True))


def with_record_checks(results: Iterable[PomResult], checks: Mapping[str, RecordCheck]) -> list[PomResult]:
    """Return results whose rows carry the errors of their record.

    Parameters
    ----------
    results : iterable of PomResult
    checks : mapping of str to RecordCheck
        By the path of a record, or by its file name without extension.

    Returns
    -------
    list of PomResult
        A result without an error in its window as it is. In another one every row has a remark of kind ``record``, so that a
        pass becomes ``record_error`` (`PomResult.status`).
    """
    return [_remarked(result, checks) for result in results]


def _remarked(result: PomResult, checks: Mapping[str, RecordCheck]) -> PomResult:
    case = result.case
    check = checks.get(case.record) or checks.get(Path(case.record).stem)
    errors = [error for error in check.errors if error.concerns(case.window)] if check else []
    if not errors:
        return result
    more = tuple(RowRemark("record", f"error of the flight record: {error.name}: {error.text}", error.name) for error in errors)
    rows = [{**row, "remarks": (*row["remarks"], *more)} for row in result.rows]
    return replace(result, verdict=verdict_table(rows))  # type: ignore[arg-type]


def checks_text(checks: Iterable[RecordCheck]) -> dict[str, str]:
    """Return the errors of records that have any, by the name of the record, for the provenance of a report."""
    return {
        check.record: "; ".join(f"{error.name}{_place(error)}: {error.text}" for error in check.errors) for check in checks if check.errors
    }


def _place(error: RecordError) -> str:
    return "" if error.start is None or error.stop is None else f" [{error.start:g} ... {error.stop:g} s]"


def _in_one_line(text: str, remedy: str) -> str:
    joined = f"{text}; {remedy}" if remedy else text
    return " ".join(joined.split())
