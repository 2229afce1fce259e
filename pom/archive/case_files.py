"""Comparison of the cases of a report with their case files, and of its numbers with its signals.

Somebody who edits ``results.nc`` can write all other files and hashes of a report anew.  Its inputs
and the relations between its numbers remain.
"""

from __future__ import annotations

import tomllib
from collections.abc import Iterable, Iterator
from dataclasses import replace
from pathlib import Path

import numpy as np

from flightmech.errors import AeromatchError
from flightmech.quantities import time_text
from flightmech.support.console import to_json_types
from pom.archive.archive import Archive
from pom.archive.statements import list_differences
from pom.cases.case import PomCase, read_case
from pom.judging.applicability import FITTED, settle_case, settling_signals
from pom.judging.signals import traces_of
from pom.judging.verdict import band_widths
from pom.result import PomResult
from pom.tolerances.own_tables import read_own_table

_SAME = 1e-9
"""Relative difference of samples and times that is rounding."""
_FIRST = ("V", "h", "theta", "phi", "alpha", "beta")
"""Initial conditions that are the first sample; rates come from a line."""


def compare_case_files(
    archive: Archive, inputs: Iterable[Path] = ()
) -> Iterator[tuple[str, str, str]]:
    """Yield name, state and detail of every case against its case file.

    Parameters
    ----------
    archive : Archive
    inputs : iterable of Path
        Files that the manifest names.  A case file without a result is ``missing``.

    Yields
    ------
    (str, str, str)
        The state is ``same``, ``changed``, ``missing``, or ``unknown`` for a file that is not here,
        also the tolerance table of the user, and for a condition of the flight without its signal.
    """
    judged = {Path(result.case.path).resolve() for result in archive.results}
    for path in inputs:
        if path.suffix == ".toml" and path.resolve() not in judged and _is_case_file(path):
            yield path.name, "missing", "an input of the report, which has no result of this case"
    for result in archive.results:
        case = result.case
        name = case.name
        if not Path(case.path).is_file():
            yield name, "unknown", f"no file {case.path}"
        elif case.table and not Path(case.tolerances).is_file():
            yield name, "unknown", f"no tolerance table {case.tolerances or case.table['file']}"
        else:
            yield name, *_compare_case(result)


def _is_case_file(path: Path) -> bool:
    try:
        content = tomllib.loads(path.read_text(encoding="utf-8"))
    except (OSError, ValueError):
        return False
    return isinstance(content.get("case"), dict) and "record" in content["case"]


def _compare_case(result: PomResult) -> tuple[str, str]:
    """Return state and detail of the comparison of a case with its file, which is there."""
    case = result.case
    try:
        # a table that the command named replaces that of the case file
        own = read_own_table(case.tolerances) if case.table else None
        present = read_case(case.path, own)
    except (AeromatchError, OSError) as error:
        return "changed", f"the case file cannot be read: {error}"
    present, hidden = _settle_as_judged(present, result)
    # a tuple of the facts comes back from results.nc as a list
    judged, written = (to_json_types(item.to_dict()) for item in (case, present))
    texts = list(list_differences(judged, written, here="the case file"))
    if texts:
        more = f"; {len(texts) - 3} more" if len(texts) > 3 else ""
        return "changed", f"{'; '.join(texts[:3])}{more}"
    if hidden:
        text = f"whether the flight meets the conditions of {', '.join(hidden)}"
        return "unknown", f"{text}: results.nc has no channel of them"
    return "same", ""


def _settle_as_judged(present: PomCase, result: PomResult) -> tuple[PomCase, list[str]]:
    """Return a case with its criteria fitted to the flight of a result, as a replay fits them.

    The second value are the criteria that differ and whose signals the result has not: a criterion
    that does not apply has no channel there.  They are taken from the result.
    """
    time, flight = result.signals["time"].values.astype(float), traces_of(result.signals, "flight")
    present = settle_case(present, time, flight)
    judged = {criterion.name: criterion for criterion in result.case.criteria}
    criteria, hidden = [], []
    for criterion in present.criteria:
        other = judged.get(criterion.name, criterion)
        fitted = replace(criterion, **{name: getattr(other, name) for name in FITTED})
        if fitted != criterion and not settling_signals(present, criterion) <= flight.keys():
            hidden.append(criterion.name)
            criterion = fitted
        criteria.append(criterion)
    return replace(present, criteria=tuple(criteria)), hidden


def compare_signals(result: PomResult) -> Iterator[str]:
    """Yield contradictions between the signals of a result and its case, bands and conditions."""
    time = result.signals["time"].values.astype(float)
    start, stop = result.case.window
    if not time.size:
        yield "the signals have no sample"
        return
    step = float(np.median(np.diff(time))) if time.size > 1 else 0.0
    if abs(time[0] - start) > step + _SAME or abs(time[-1] - stop) > step + _SAME:
        yield (
            f"the signals have {time_text(time[0])} ... {time_text(time[-1])} s, the window of the "
            f"case has {time_text(start)} ... {time_text(stop)} s"
        )
    flight = traces_of(result.signals, "flight")
    expected = band_widths(result.case, time, flight)
    for name in {*map(str, expected.data_vars), *map(str, result.tolerance.data_vars)}:
        if name not in expected or name not in result.tolerance:
            yield f"drawn band of {name}: in one of criteria and signals only"
        elif not np.allclose(
            expected[name], result.tolerance[name], rtol=1e-6, atol=1e-12, equal_nan=True
        ):
            yield f"drawn band of {name}: not that of the criteria"
    if result.case.drive.trim == "ground":
        # the start on the wheels has no angles of the air, and another speed
        return
    for name in _FIRST:
        value = result.conditions.get(name, np.nan)
        if name in flight and name not in result.case.conditions and np.isfinite(value):
            first = float(flight[name][0])
            if abs(first - value) > 1e-6 * max(abs(first), 1.0):
                yield f"condition {name} {value:.9g}, the flight starts with {first:.9g}"
