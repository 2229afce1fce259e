"""The Proof-of-Match report: one self-contained HTML file and one JSON file with all its numbers.

The page asks for nothing outside itself; its content security policy forbids it.  Equal input gives equal bytes: dates
come from the input, keys are sorted, no host name or clock is read.
"""

from __future__ import annotations

import json
import os
from collections.abc import Mapping, Sequence
from contextlib import ExitStack
from pathlib import Path
from typing import TYPE_CHECKING, Any

from flightmech.console import plain
from flightmech.errors import SchemaError, UnknownName
from flightmech.whole import written_whole

from .modes import mode_table
from .page import html_page
from .sections import provenance as origin

if TYPE_CHECKING:
    import pandas as pd
    import xarray as xr

    from .result import PomResult


def write_report(
    results: Sequence[PomResult],
    folder: str | os.PathLike,
    *,
    title: str,
    provenance: origin.Provenance | None = None,
    databases: Mapping[str, xr.DataTree] | None = None,
    diagnoses: Mapping[str, pd.DataFrame] | None = None,
    support: Mapping[str, pd.DataFrame] | None = None,
    revision: str = "",
) -> Path:
    """Write ``report.html`` and ``results.json`` into a folder.

    Parameters
    ----------
    results : sequence of PomResult
        In the order of the report.
    folder : path
        Made when missing; both files are replaced whole, or neither.
    title : str
        Title of the report, e.g. the airplane and the model standard.
    provenance : Provenance, optional
        ``date`` of the results, ``command``, ``versions``, ``inputs`` (file to SHA-256) and ``models`` (run to ``file``
        and ``sha256``).
    databases : mapping of str to DataTree, optional
        Aero databases to set against each other, the prior first; names of runs take the line code of the runs.
    diagnoses : mapping of str to DataFrame, optional
        Case name to the table of `pom.diagnose`.
    support : mapping of str to DataFrame, optional
        Term (``CL/basic``) to the flight samples that support it, columns named after the axes of the term. [SI]
    revision : str
        Revision of the report, as the user counts them.

    Returns
    -------
    Path
        Of ``report.html``.

    Raises
    ------
    SchemaError
        No results.
    UnknownName
        A diagnosis for a case that is not there, or a misspelt key of `provenance`.
    """
    results, diagnoses = list(results), dict(diagnoses or {})
    made_from: dict[str, Any] = {**(provenance or {})}
    _check(results, made_from, diagnoses)
    modes = [mode_table(result) for result in results]
    document = _document(results, title, revision, made_from, diagnoses, modes)
    html = html_page(results, title, revision, made_from, dict(databases or {}), diagnoses, dict(support or {}), modes)
    folder = Path(folder)
    folder.mkdir(parents=True, exist_ok=True)
    text = json.dumps(document, sort_keys=True, ensure_ascii=False, separators=(",", ":"), allow_nan=False)
    _write_together({folder / "results.json": text + "\n", folder / "report.html": html})
    return folder / "report.html"


def _check(results: Sequence[PomResult], provenance: Mapping[str, Any], diagnoses: Mapping[str, Any]) -> None:
    if not results:
        raise SchemaError("report", ["no results came; give the outcome of at least one case"])
    origin.check(provenance)
    names = {result.case.name for result in results}
    for name in diagnoses:
        if name not in names:
            raise UnknownName(name, names, "case", "diagnoses are named after cases")


def _document(results, title, revision, provenance, diagnoses, modes) -> dict[str, Any]:
    """Return what ``results.json`` holds: every number of the report, signals included."""
    return {
        "title": title,
        "revision": revision,
        "provenance": plain(provenance),
        "results": [json.loads(result.to_json()) for result in results],
        "modes": {result.case.name: plain(table.to_dict("records")) for result, table in zip(results, modes, strict=True) if len(table)},
        "diagnoses": {name: plain(table.to_dict("records")) for name, table in diagnoses.items()},
    }


def _write_together(files: Mapping[Path, str]) -> None:
    """Write all files beside their places, then move them there: nobody finds half of one."""
    with ExitStack() as stack:
        for path, text in files.items():
            stack.enter_context(written_whole(path)).write_text(text, encoding="utf-8", newline="\n")
