"""Tolerance table of the user that a case names, or that a command gives to all its cases."""

from __future__ import annotations

from collections.abc import Iterable
from pathlib import Path
from typing import Any

from flightmech.errors import SchemaError, UnknownName
from pom.cases.case_file import CaseFile
from pom.cases.resolve import collect_case_problems, resolve_named_file
from pom.tolerances.own_tables import OwnTable, read_own_table


def find_own_table(
    path: Path, file: CaseFile, given: OwnTable | None, problems: list[str]
) -> OwnTable | None:
    """Return the tolerance table of the user for a case; None for ``tolerances.csv``."""
    if given is not None and given.holds(file.case.standard, file.case.edition):
        return given
    key = "case.tolerances"
    name = resolve_named_file(path, file.case.tolerances, key=key, problems=problems)
    if not name or not Path(name).is_file():
        return None
    return collect_case_problems(problems, key, read_own_table, name)


def table_excerpt(own: OwnTable | None, file: CaseFile) -> dict[str, Any]:
    """Return what a case keeps of a table of the user; empty without one."""
    if own is None:
        return {}
    try:
        return own.excerpt(file.case.id, file.case.standard, file.case.edition)
    except UnknownName:
        # an unknown test is already among the problems
        return {}


def demand_use(table: OwnTable | None, tables_of_cases: Iterable[str]) -> None:
    """Raise if no case uses a table that a command gives.

    Parameters
    ----------
    table : OwnTable or None
    tables_of_cases : iterable of str
        `PomCase.tolerances` of the cases.

    Raises
    ------
    SchemaError
        With the editions of the table.
    """
    if table is None or any(Path(name) == Path(table.path) for name in tables_of_cases if name):
        return
    editions = dict.fromkeys((row["standard"], row["edition"]) for row in table.rows)
    listed = "; ".join(f"{standard}, edition {edition}" for standard, edition in editions)
    raise SchemaError(
        "--tolerances",
        [
            f"{table.path}: no case uses this table; it holds {listed}: write them as "
            f"case.standard and case.edition"
        ],
    )
