"""Master runs: runs of an earlier report, with which recurrent tests compare."""

from __future__ import annotations

import math
from collections.abc import Sequence
from pathlib import Path

import numpy as np

from flightmech.errors import SchemaError, UnknownName
from flightmech.quantities import time_text
from flightmech.support.input_files import file_sha256
from pom.archive.archive import Archive, read_archive
from pom.cases.case import PomCase
from pom.judging.signals import traces_of
from pom.replaying.recorded_runs import OF_EARLIER, MasterRun, RecordedRun
from pom.result import PomResult
from pom.tolerances.rows import usual_fraction

_ROUNDING = 1e-9  # [s]


def archive_file(path: str | Path) -> Path:
    """Return the ``results.nc`` of a report, given as file or folder."""
    path = Path(path)
    return path / "results.nc" if path.is_dir() else path


def read_masters(
    path: str | Path, run: str, cases: Sequence[PomCase], share: float | None = None
) -> dict[str, MasterRun]:
    """Return the master of a run for every case.

    Parameters
    ----------
    path : path
        Folder of the earlier report, or its ``results.nc``.
    run : str
        Name of the run that is compared.  The master is the run of this name, else the only run.
    cases : sequence of PomCase
    share : float, optional
        Criterion: share of each tolerance, about the master.  Default: that of the rule for data
        of an engineering simulator (0.2 before 2016, 0.4 from then on).

    Raises
    ------
    SchemaError
        With every case that the report lacks, or that has another test or window there.
    UnknownName
        The report has several runs, none of this name.
    """
    file = archive_file(path)
    archive = read_archive(file)
    digest = file_sha256(file)
    by_name = {result.case.name: result for result in archive.results}
    masters, problems = {}, []
    for case in cases:
        result = by_name.get(case.name)
        if result is None:
            error = UnknownName(case.name, by_name, "case of the master report")
            problems.append(f"{error}; leave the case out, or make a master of it")
            continue
        problem = _case_problem(case, result)
        if problem:
            problems.append(problem)
            continue
        applied = share if share is not None else usual_fraction("engineering", case.edition)
        if math.isnan(applied):
            problems.append(
                f"case {case.name}: edition {case.edition!r} does not begin with its year, from "
                f"which the share follows; give --recurrent-share"
            )
            continue
        name = _run_of(result, run)
        source = f"{name} {OF_EARLIER}, {archive.title or file.parent.name}"
        date = archive.provenance.get("date", "")
        source += f", results of {date}" if date else ""
        origin = f"{file.name}, run {name} {OF_EARLIER}, sha256 {digest}"
        recorded = _recorded(result, name, origin, source)
        flight = _recorded(result, "flight")
        remarks = tuple(_differences(case, result, archive))
        masters[case.name] = MasterRun(f"{run}-master", recorded, applied, remarks, flight)
    if problems:
        raise SchemaError(f"master {file}", problems)
    return masters


def _recorded(result: PomResult, line: str, origin: str = "", source: str = "") -> RecordedRun:
    """Return one line of a result as a recorded run."""
    time = result.signals["time"].values
    channels = {name: (time, values) for name, values in traces_of(result.signals, line).items()}
    return RecordedRun(channels, origin, source, has_inputs=False)


def _case_problem(case: PomCase, result: PomResult) -> str:
    """Return why a case cannot be compared with the case of the master; empty if it can."""
    other = result.case
    if (other.id, other.standard) != (case.id, case.standard):
        return f"case {case.name}: test {case.id}, the master has {other.id} of {other.standard}"
    if not np.allclose(other.window, case.window, rtol=0.0, atol=_ROUNDING):
        return (
            f"case {case.name}: window {time_text(case.window[0])} ... {time_text(case.window[1])} "
            "s, the master has "
            f"{time_text(other.window[0])} ... {time_text(other.window[1])} s; judge both in one "
            "window"
        )
    return ""


def _run_of(result: PomResult, run: str) -> str:
    if run in result.runs:
        return run
    if len(result.runs) != 1:
        raise UnknownName(run, result.runs, f"run of case {result.case.name} in the master report")
    return result.runs[0]


def _differences(case: PomCase, result: PomResult, archive: Archive) -> list[str]:
    """Return what differs between the case of a master and the present case."""
    texts = []
    if result.case.edition_words != case.edition_words:
        texts.append(
            f"the master was judged by edition {result.case.edition_words}, the run by "
            f"{case.edition_words}"
        )
    bands = {c.name: c.band for c in result.case.criteria}
    changed = [c.name for c in case.criteria if bands.get(c.name, c.band) != c.band]
    if changed:
        texts.append(f"tolerances of {', '.join(changed)} are not those of the master")
    if result.case.drive != case.drive or result.case.conditions != case.conditions:
        texts.append("drive or conditions of the case are not those of the master")
    # the hash of the record shows another flight under the same name
    stem = Path(case.record).name
    inputs = archive.provenance.get("inputs", {}).items()
    hashes = {Path(name).name: digest for name, digest in inputs}
    is_known = stem in hashes and Path(case.record).is_file()
    if is_known and hashes[stem] != file_sha256(case.record):
        texts.append(f"the flight record {stem} is not that of the master")
    return texts
