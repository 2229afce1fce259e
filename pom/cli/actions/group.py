"""Functions that perform the commands of `pom.cli.group`."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import click

import aerodb
from flightmech.errors import AeromatchError, SchemaError, SimulationError, UnknownName
from flightmech.support.console import (
    InputFile,
    command_line,
    count_text,
    print_json,
    print_table,
    show_progress,
)
from flightmech.support.kept_stages.sharing import demand_scheduler
from pom.archive.archive import Custody
from pom.archive.origins import ReportProvenance, provenance
from pom.cases.case import PomCase, read_case
from pom.cases.fact_agreement import contradictions
from pom.cases.own_table import demand_use
from pom.cases.reference_states import window_problem
from pom.checking.batch_check import check_batch
from pom.checking.case_check import RecordCheck, checks_text, with_record_checks
from pom.checking.report_checks import with_report_checks
from pom.cli.actions.recordings import (
    RecordingFiles,
    is_recording,
    parse_starts,
    read_recorded_runs,
    recording_files,
)
from pom.cli.actions.report import (
    case_files,
    print_record_errors,
    read_biases,
    signatures_of,
)
from pom.cli.actions.tune import tuning_logs
from pom.diagnosis.sampling.sampled_replay import replay_sampled
from pom.fmu.description import demand_platform, read_fmu_interface
from pom.fmu.models import Models
from pom.judging.applicability import reason_not_judged
from pom.judging.report_conditions import has_report_conditions
from pom.replaying.batch import replay_all
from pom.replaying.recorded_runs import RecordedRuns
from pom.replaying.replay_case import files_by_name
from pom.replaying.run_remarks import calibration, drift, pilot_activity
from pom.report.case.remarks import run_notes, sampled_line
from pom.report.exports import write_junit
from pom.report.writer import write_report
from pom.result import (
    NO_EVIDENCE,
    PASSED,
    PomResult,
    departure_remarks,
    is_beyond_master,
    lacks_evidence,
    run_notices,
    spread_notice,
    status_text,
    trim_remarks,
)
from pom.tolerances.bands import remarks_text
from pom.tolerances.own_tables import read_own_table


def check_cases(cases: tuple[Path, ...], tolerances_file: str | None, as_json: bool) -> None:
    """Perform the command ``check``."""
    table = read_own_table(tolerances_file) if tolerances_file else None
    checked: list[PomCase] = []
    problems: list[str] = []
    files = case_files(cases)
    with show_progress(f"read {count_text(len(files), 'case')} and their records"):
        for file in files:
            try:
                case = read_case(file, table)
            except AeromatchError as error:
                problems.append(str(error))
                continue
            checked.append(case)
            problems += _case_problems(case)
    problems += contradictions(checked)
    if not problems:
        demand_use(table, [case.tolerances for case in checked])
    # one case is an object, several cases are an array
    if as_json and not problems:
        documents = [case.to_dict() for case in checked]
        print_json(documents if len(documents) > 1 else documents[0])
        return
    if not as_json:
        for case in checked:
            _print_criteria(case)
    if problems:
        raise SchemaError("cases", problems)


def _case_problems(case: PomCase) -> list[str]:
    """Return the problems of a valid case with its record and its control law."""
    problems = []
    problem = window_problem(case)
    if problem:
        problems.append(problem)
    # a control law without a library for this machine cannot run
    if case.law:
        try:
            demand_platform(read_fmu_interface(case.law))
        except AeromatchError as error:
            problems.append(f"case {case.path}: control_law: {error}")
    return problems


def _print_criteria(case: PomCase) -> None:
    rows = []
    for criterion in case.criteria:
        row = (
            criterion.name,
            criterion.channel,
            criterion.measure,
            criterion.group,
            criterion.band.text,
            f"{criterion.window[0]:g} ... {criterion.window[1]:g}",
            reason_not_judged(case, criterion) or criterion.provenance,
        )
        rows.append(row)
    title = f"{case.id}  {case.title}  ({case.standard}, {case.edition_words})"
    columns = ("criterion", "channel", "measure", "group", "tolerance", "window [s]", "remark")
    print_table(columns, rows, title)


_REASONS = ("reason", "no_value", "failure")
"""Kinds of remarks that state why a row has no judgement."""


@dataclass(frozen=True)
class _Batch:
    """Cases and files of the command ``run``.

    Attributes
    ----------
    cases : list of PomCase
    runs, names, databases : dict of str to Path
        By model: its FMU, its table of names, and the database of its draws.
    recordings : RecordingFiles
        Recordings of devices and masters.
    recorded : dict of str to RecordedRuns
        By case: what they hold.
    logs : dict of str to dict
        By model: the log of its tuning.
    files : list of str
        Every input file but the FMUs, with repetitions.
    custody : Custody
        Hashes of all files, computed before they were read.
    """

    cases: list[PomCase]
    runs: dict[str, Path]
    names: dict[str, Path]
    recordings: RecordingFiles
    recorded: dict[str, RecordedRuns]
    databases: dict[str, Path]
    logs: dict[str, dict[str, Any]]
    files: list[str]
    custody: Custody

    @property
    def models(self) -> list[str]:
        """Models that are judged: FMUs and recordings, without the masters."""
        return [*self.runs, *self.recordings.runs]


def run_cases(
    ctx: click.Context,
    cases: tuple[Path, ...],
    models: tuple[str, ...],
    starts: tuple[str, ...],
    masters: tuple[str, ...],
    recurrent_share: float | None,
    output: Path | None,
    title: str,
    revision: str,
    date: str,
    paper: str,
    units: str | None,
    no_pdf: bool,
    signed: tuple[tuple[str, str, str], ...],
    junit: str | None,
    tables: tuple[str, ...],
    timeout: float,
    jobs: int,
    scheduler: str | None,
    resume: Path | None,
    biases_file: str | None,
    tolerances_file: str | None,
    evidence: str | None,
    samples: int,
    seed: int,
    databases: tuple[str, ...],
    tunings: tuple[str, ...],
    verbose: bool,
    as_json: bool,
):
    """Perform the command ``run``."""
    _demand_pairs(samples, databases, tunings=tunings, output=output)
    signatures = signatures_of(signed)
    batch = _read_batch(
        cases,
        models,
        tables,
        databases=databases,
        tunings=tunings,
        tolerances=tolerances_file,
        recorded=(starts, masters, recurrent_share),
        others=(evidence, biases_file),
    )
    checks = _check_batch(batch, jobs=jobs, scheduler=scheduler, resume=resume)
    options: dict[str, Any] = {
        "names": batch.names,
        "biases": read_biases(biases_file),
        "timeout": timeout,
        "jobs": jobs,
        "scheduler": scheduler,
        "resume": resume,
        "evidence": aerodb.store.open(evidence) if evidence else None,
        "recorded": batch.recorded,
    }
    # the printer gets every result as soon as it is complete
    printer = _ProgressPrinter(checks, batch.models, verbose=verbose, silent=as_json)
    results = _replay_batch(batch, printer, samples=samples, seed=seed, options=options)
    results = with_report_checks(results)
    printer.print_rest(results)
    results = with_record_checks(results, checks)
    # a file that changed during the batch does not belong to the results
    batch.custody.check()
    report = None
    if output is not None:
        origin = _origin(batch, checks, date=date, signatures=signatures)
        if units:
            origin["units"] = units
        head: dict[str, Any] = {"title": title, "revision": revision, "provenance": origin}
        head["paper"] = None if no_pdf else paper
        with show_progress("write the report"):
            report = write_report(results, output, tunings=batch.logs, jobs=jobs, **head)
    if junit is not None:
        write_junit(junit, results, title)
    _print_results(batch, results, report=report, as_json=as_json)
    # a departure is stated, not a failure: every row passes
    passed = {"pass", "pass_with_departures"}
    is_recurring = not any(map(is_beyond_master, results))
    ctx.exit(int(not (is_recurring and set(_statuses(batch, results)) <= passed)))


def _demand_pairs(
    samples: int, databases: tuple[str, ...], *, tunings: tuple[str, ...], output: Path | None
) -> None:
    """Raise if an option is without the option that it requires."""
    if bool(samples) != bool(databases):
        raise click.UsageError(
            "--samples and --database go together: the number of draws, and the database of "
            "each model to draw from"
        )
    if tunings and output is None:
        raise click.UsageError("--tuning needs -o: the log is a chapter of the report")


def _print_results(
    batch: _Batch, results: Sequence[PomResult], *, report: Path | None, as_json: bool
) -> None:
    if as_json:
        print_json([_summary(result) for result in results])
        return
    models, cases = _size_texts(batch)
    click.echo(f"{models} x {cases}: {_counts_text(_statuses(batch, results))}")
    if any(map(lacks_evidence, results)):
        click.echo(f"notice {NO_EVIDENCE} (--evidence DATABASE.nc)")
    if report is not None:
        click.echo(f"written: {report}")


def _read_batch(
    cases: tuple[Path, ...],
    models: tuple[str, ...],
    tables: tuple[str, ...],
    *,
    databases: tuple[str, ...],
    tunings: tuple[str, ...],
    tolerances: str | None,
    recorded: tuple[tuple[str, ...], tuple[str, ...], float | None],
    others: Sequence[str | None],
) -> _Batch:
    """Hash and read the cases and files of a batch."""
    given = files_by_name("--model", models, "final=out/final.fmu")
    runs = {name: file for name, file in given.items() if not is_recording(file)}
    recordings = _recordings_of(given, runs, recorded)
    names = files_by_name("--names", tables, "simulator=names.toml")
    sources = files_by_name("--database", databases, "final=out/final.nc")
    log_files = files_by_name("--tuning", tunings, "tuned=out/tuning.json")
    paths = case_files(cases)
    named = [*names.values(), *sources.values(), *log_files.values()]
    for file in (*runs.values(), *named, *recordings.runs.values(), *recordings.masters.values()):
        # raises if the file is missing
        if not file.is_dir() or file in (*runs.values(), *named):
            InputFile().convert(file, None, None)
    # Every file is hashed before it is read, so that the hash belongs to the results.
    custody = Custody()
    custody.take([*paths, *runs.values()])
    if tolerances:
        custody.take([tolerances])
    with show_progress(f"read {count_text(len(paths), 'case')}"):
        table = read_own_table(tolerances) if tolerances else None
        read = [read_case(path, table) for path in paths]
    demand_use(table, [case.tolerances for case in read])
    files: list[str] = []
    for case in read:
        files += case.files()
    files += [*map(str, named), *filter(None, others)]
    files += [str(file) for file in recording_files(recordings, read)]
    custody.take(files)
    recorded_runs = read_recorded_runs(recordings, names, read)
    return _Batch(
        cases=read,
        runs=runs,
        names={name: table for name, table in names.items() if name not in recordings.runs},
        recordings=recordings,
        recorded=recorded_runs,
        databases=sources,
        logs=tuning_logs(log_files, runs),
        files=files,
        custody=custody,
    )


def _recordings_of(
    given: Mapping[str, Path],
    runs: Mapping[str, Path],
    options: tuple[tuple[str, ...], tuple[str, ...], float | None],
) -> RecordingFiles:
    """Return the recordings among the models, with the masters of all models."""
    starts, masters, share = options
    recordings = {name: file for name, file in given.items() if name not in runs}
    reports = files_by_name("--master", masters, "device=master/results.nc")
    for name in reports:
        if name not in given:
            raise UnknownName(name, given, "model", "--master names a run of --model")
    if share is not None and not reports:
        raise click.UsageError("--recurrent-share needs --master: the report to compare with")
    return RecordingFiles(recordings, parse_starts(starts, recordings), reports, share)


def _check_batch(
    batch: _Batch, *, jobs: int, scheduler: str | None, resume: Path | None
) -> dict[str, RecordCheck]:
    """Check the cases and records of a batch, and print the errors of the records."""
    if scheduler:
        demand_scheduler(scheduler)
    with show_progress("check the cases and their records"):
        models = Models(batch.runs, batch.names)
        # the workers of a cluster load the FMUs, so this machine need not
        if not scheduler:
            models.demand_platform()
        checks = check_batch(batch.cases, models, jobs=jobs, folder=resume)
    print_record_errors(checks)
    return checks


NOTICE_INDENT = " " * 8


class _ProgressPrinter:
    """Printer of the results of a batch as they come.

    Lines wait until the first model is replayed.  If none is, the error alone is printed.

    Attributes
    ----------
    is_replayed : bool
        A model was replayed in at least one case.

    Notes
    -----
    What only all cases together show follows at the end, for cases that were printed before.
    """

    def __init__(
        self, checks: Mapping[str, RecordCheck], runs: list[str], *, verbose: bool, silent: bool
    ):
        self.checks, self.runs = checks, runs
        self.verbose, self.silent = verbose, silent
        self.is_replayed = False
        self._waiting: list[str] = []
        self._shown: dict[tuple[str, str], list[str]] = {}

    def print_result(self, result: PomResult) -> None:
        """Print the lines of one result."""
        # cases of one test may have to show a condition together: they wait for the others
        if has_report_conditions(result.case):
            self.is_replayed = self.is_replayed or not result.failure
            return
        self._add(result)

    def print_rest(self, results: Sequence[PomResult]) -> None:
        """Print the lines of the results that waited for the others."""
        for result in results:
            if has_report_conditions(result.case):
                self._add(result)
            else:
                self._add_late_notices(result)

    def _add_late_notices(self, result: PomResult) -> None:
        """Print the notices of a result that came with the other cases."""
        (result,) = with_record_checks([result], self.checks)
        case, lines = result.case, []
        for run in result.runs:
            shown = self._shown.get((case.path, run), [])
            late = [text for text in run_notices(result, run) if text not in shown]
            if late and (result.status(run) != "fail" or self.verbose):
                lines.append(f"{case.id:<8}{case.title:<44} {run:<12} with all cases:")
                lines += [f"{NOTICE_INDENT}notice {text}" for text in late]
        if lines and self.is_replayed and not self.silent:
            click.echo("\n".join(lines))

    def _add(self, result: PomResult) -> None:
        (result,) = with_record_checks([result], self.checks)
        # a model that fails to run has an invalid case
        if not result.failure or any(result.status(run) != "invalid" for run in self.runs):
            self.is_replayed = True
        for run in result.runs:
            self._shown[result.case.path, run] = run_notices(result, run)
        self._waiting += _result_lines(result, self.verbose)
        if self.is_replayed and not self.silent:
            click.echo("\n".join(self._waiting))
            self._waiting.clear()


def _replay_batch(
    batch: _Batch,
    printer: _ProgressPrinter,
    *,
    samples: int,
    seed: int,
    options: Mapping[str, Any],
) -> list[PomResult]:
    """Replay the cases of a batch, with draws if samples are requested.

    Raises
    ------
    SimulationError
        No model was replayed in any case.
    """
    models, cases = _size_texts(batch)
    options = {**options, "progress": printer.print_result}
    with show_progress(f"replay {cases} by {models}", lines=not printer.silent):
        if samples:
            results = replay_sampled(
                batch.cases, batch.runs, batch.databases, count=samples, seed=seed, **options
            )
        else:
            results = replay_all(batch.cases, batch.runs, **options)
    if not printer.is_replayed:
        raise SimulationError("no model could be replayed: " + results[0].failure)
    return results


def _origin(
    batch: _Batch,
    checks: Mapping[str, RecordCheck],
    *,
    date: str,
    signatures: Mapping[str, Mapping[str, str]],
) -> ReportProvenance:
    """Return the provenance of the report of a batch."""
    origin = provenance(
        batch.files,
        {**batch.runs, **_single_recordings(batch)},
        command=command_line(),
        date=date,
        digest=batch.custody.sha256,
    )
    if signatures:
        origin["signatures"] = signatures
    record_errors = checks_text(checks.values())
    if record_errors:
        origin["record_errors"] = record_errors
    return origin


def _single_recordings(batch: _Batch) -> dict[str, Path]:
    """Return the recordings of one file; those of a folder are among the inputs alone."""
    return {name: file for name, file in batch.recordings.runs.items() if not file.is_dir()}


def _size_texts(batch: _Batch) -> tuple[str, str]:
    """Return the number of models and of cases as texts."""
    return count_text(len(batch.models), "model"), count_text(len(batch.cases), "case")


def _statuses(batch: _Batch, results: Sequence[PomResult]) -> list[str]:
    """Return the status of every result and model."""
    statuses: list[str] = []
    for result in results:
        statuses += [result.status(run) for run in batch.models]
    return statuses


def _counts_text(statuses: Sequence[str]) -> str:
    """Return the number of cases by status, in the order of their first case."""
    counts = []
    for status in dict.fromkeys(statuses):
        counts.append(f"{statuses.count(status)} {status_text(status)}")
    return ", ".join(counts)


def _result_lines(result: PomResult, verbose: bool = False) -> list[str]:
    """Return one line per model, and its notices.

    For example ``2.c.10  Short period  datcom  FAIL  1.6 x tolerance  theta +2.41 deg at 4.3 s
    (1.5 deg)``.
    """
    case, lines = result.case, []
    indent = NOTICE_INDENT
    for run in result.runs:
        lines.append(f"{case.id:<8}{case.title:<44} {run:<12} {_verdict_text(result, run)}")
        # a failed case needs no notices to be looked at
        if result.status(run) != "fail" or verbose:
            lines += [f"{indent}notice {text}" for text in run_notices(result, run)]
        if run in result.samples:
            lines.append(f"{indent}{sampled_line(result, run)}")
            unexplained = spread_notice(result, run)
            # A failed case needs it too: its probability may be that of a pass.
            if unexplained:
                lines.append(f"{indent}notice {unexplained}")
        if verbose:
            lines += [f"{indent}{text}" for text in run_notes(result, run)]
    return lines


def _verdict_text(result: PomResult, run: str) -> str:
    """Return the status of a model and the row that decides."""
    status, worst = result.status(run), result.worst(run)
    text = status_text(status)
    if worst is not None:
        # only a time history has an instant
        instant = f" at {worst['at']:.1f} s" if worst["measure"] == "trace" else ""
        unit = "" if worst["unit"] == "1" else f" {worst['unit']}"
        text += (
            f"  {worst['worst_ratio']:.2f} x tolerance  {worst['criterion']} "
            f"{worst['worst']:+.3g}{unit}{instant} ({worst['tolerance_text']})"
        )
        if status in ("limits_exceeded", "record_error", "leak", "not_driven"):
            text += "".join(f"; {remark}" for remark in trim_remarks(result, run))
        elif status in ("invalid", "not_tested"):
            # the ratio is that of another row than the one that has no judgement
            text += f"; {_unjudged_text(result, run, status)}"
    elif status not in PASSED:
        # without a judged row, the first row with the status gives the reason
        for row in result.rows:
            if row["run"] == run and row["verdict"] == status:
                return f"{text}  {remarks_text(row['remarks'])}"
    return text


def _unjudged_text(result: PomResult, run: str, status: str) -> str:
    """Return the first row whose group has a status of a case without judgement, and why."""
    groups = result.groups(run)
    for row in result.rows:
        is_of_status = groups.get(row["group"]) == row["verdict"] == status
        if row["run"] == run and is_of_status:
            reasons = [item for item in row["remarks"] if item.kind in _REASONS]
            return f"{row['criterion']} {status.replace('_', ' ')}: {remarks_text(reasons)}"
    return ""


def _summary(result: PomResult) -> dict[str, Any]:
    """Return the numbers of a result for ``--json``."""
    return {
        "case": result.case.name,
        "id": result.case.id,
        "standard": result.case.standard,
        "edition": result.case.edition,
        "status": {run: result.status(run) for run in result.runs},
        "departures": {run: departure_remarks(result, run) for run in result.runs},
        "failure": result.failure,
        "verdict": result.verdict_records(),
        "trim": result.trim,
        "pilot": pilot_activity(result),
        "drift": drift(result),
        "calibration": calibration(result),
        "samples": {
            run: {**replay.numbers(), "unexplained": spread_notice(result, run)}
            for run, replay in result.samples.items()
        },
    }
