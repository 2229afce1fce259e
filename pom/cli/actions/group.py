"""Functions that perform the commands of `pom.cli.group`."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import click

import aerodb
from flightmech.errors import AeromatchError, SchemaError, SimulationError
from flightmech.support.console import (
    InputFile,
    command_line,
    print_json,
    print_remark,
    print_table,
    show_progress,
)
from flightmech.support.kept_stages.sharing import demand_scheduler
from pom.archive.archive import Custody
from pom.archive.origins import provenance
from pom.cases.case import read_case
from pom.cases.reference_states import window_problem
from pom.checking.batch_check import check_batch
from pom.checking.case_check import checks_text, with_record_checks
from pom.cli.actions.report import (
    case_files,
    read_biases,
    signatures_of,
)
from pom.cli.actions.tune import tuning_logs
from pom.diagnosis.sampling.sampled_replay import replay_sampled
from pom.fmu.description import demand_platform, read_fmu_interface
from pom.fmu.models import Models
from pom.judging.applicability import reason_not_judged
from pom.replaying.batch import replay_all
from pom.replaying.replay_case import files_by_name
from pom.replaying.run_remarks import calibration, drift, pilot_activity
from pom.report.case.remarks import run_notes, sampled_line
from pom.report.exports import write_junit
from pom.report.writer import write_report
from pom.result import PASSED, run_notices, status_text, trim_remarks
from pom.tolerances.bands import remarks_text


def check_cases(cases: tuple[Path, ...], as_json: bool) -> None:
    """Perform the command ``check``."""
    found, problems = [], []
    files = case_files(cases)
    with show_progress(f"read {len(files)} case{'s' if len(files) > 1 else ''} and their records"):
        for file in files:
            try:
                case = read_case(file)
            except AeromatchError as error:
                problems.append(str(error))
                continue
            found.append(case)
            if problem := window_problem(case):
                problems.append(problem)
            if case.law:
                try:
                    demand_platform(read_fmu_interface(case.law))
                except AeromatchError as error:
                    problems.append(f"case {case.path}: control_law: {error}")
    if as_json and not problems:
        print_json([case.to_dict() for case in found] if len(found) > 1 else found[0].to_dict())
        return
    for case in found if not as_json else ():
        _print_criteria(case)
    if problems:
        raise SchemaError("cases", problems)


def _print_criteria(case: Any) -> None:

    rows = [
        (
            c.name,
            c.channel,
            c.measure,
            c.group,
            c.band.text,
            f"{c.window[0]:g} ... {c.window[1]:g}",
            reason_not_judged(case, c) or c.provenance,
        )
        for c in case.criteria
    ]
    title = f"{case.id}  {case.title}  ({case.standard}, {case.edition})"
    print_table(
        ("criterion", "channel", "measure", "group", "tolerance", "window [s]", "remark"),
        rows,
        title,
    )


def run_cases(
    ctx: click.Context,
    cases: tuple[Path, ...],
    models: tuple[str, ...],
    output: Path | None,
    title: str,
    revision: str,
    date: str,
    paper: str,
    no_pdf: bool,
    signed: tuple[tuple[str, str, str], ...],
    junit: str | None,
    tables: tuple[str, ...],
    timeout: float,
    jobs: int,
    scheduler: str | None,
    resume: Path | None,
    biases_file: str | None,
    evidence: str | None,
    samples: int,
    seed: int,
    databases: tuple[str, ...],
    tunings: tuple[str, ...],
    verbose: bool,
    as_json: bool,
):
    """Perform the command ``run``."""
    runs, names = (
        files_by_name("--model", models, "final=out/final.fmu"),
        files_by_name("--names", tables, "simulator=names.toml"),
    )
    stated = files_by_name("--database", databases, "final=out/final.nc")
    if bool(samples) != bool(stated):
        raise click.UsageError(
            "--samples and --database go together: the number of draws, and the database of "
            "each model to draw from"
        )
    signatures = signatures_of(signed)
    tuned = files_by_name("--tuning", tunings, "tuned=out/tuning.json")
    if tuned and output is None:
        raise click.UsageError("--tuning needs -o: the log is a chapter of the report")
    custody = Custody()
    named = case_files(cases)
    for file in (*runs.values(), *names.values(), *stated.values(), *tuned.values()):
        InputFile().convert(file, None, None)
    custody.take([*named, *runs.values()])
    with show_progress(f"read {len(named)} case{'s' if len(named) > 1 else ''}"):
        read = [read_case(file) for file in named]
    files = [
        *(file for case in read for file in case.files()),
        *map(str, (*names.values(), *stated.values(), *tuned.values())),
    ]
    files += filter(None, (evidence, biases_file))
    custody.take(files)
    logs = tuning_logs(tuned, runs)
    if scheduler:
        demand_scheduler(scheduler)
    with show_progress("check the cases and their records"):
        offered = Models(runs, names)
        if not scheduler:  # the workers of a cluster load the FMUs
            offered.demand_platform()
        checks = check_batch(read, offered, jobs, resume)
    for one in checks.values():
        for words in one.lines():
            print_remark(f"  {words}")
    waiting: list[str] = []
    flown = False

    def finished(result: Any) -> None:
        nonlocal flown
        (result,) = with_record_checks([result], checks)
        flown = (
            flown or not result.failure or any(result.status(name) != "invalid" for name in runs)
        )
        waiting.extend(_lines(result, verbose))
        if flown and not as_json:
            click.echo("\n".join(waiting))
            waiting.clear()

    found = aerodb.store.open(evidence) if evidence else None
    shared: dict[str, Any] = {
        "jobs": jobs,
        "scheduler": scheduler,
        "resume": resume,
        "evidence": found,
    }
    biases = read_biases(biases_file)
    text = (
        f"replay {len(read)} case{'s' if len(read) > 1 else ''} by {len(runs)} "
        f"model{'s' if len(runs) > 1 else ''}"
    )
    with show_progress(text, lines=not as_json):
        given: dict[str, Any] = {
            "names": names,
            "biases": biases,
            "timeout": timeout,
            "progress": finished,
            **shared,
        }
        if samples:
            results = replay_sampled(read, runs, stated, samples, seed, **given)
        else:
            results = replay_all(read, runs, **given)
    if not flown:
        raise SimulationError("no model could be replayed: " + results[0].failure)
    results = with_record_checks(results, checks)
    custody.check()
    written = None
    if output is not None:
        made_from = provenance(files, runs, command_line(), date, custody.sha256)
        if signatures:
            made_from["signatures"] = signatures
        if wrong := checks_text(checks.values()):
            made_from["record_errors"] = wrong
        with show_progress("write the report"):
            written = write_report(
                results,
                output,
                title=title,
                provenance=made_from,
                tunings=logs,
                revision=revision,
                paper=None if no_pdf else paper,
                jobs=jobs,
            )
    if junit is not None:
        write_junit(junit, results, title)
    statuses = [r.status(name) for r in results for name in runs]
    if as_json:
        print_json([_summary(r) for r in results])
    else:
        counts = ", ".join(
            f"{statuses.count(word)} {status_text(word)}" for word in dict.fromkeys(statuses)
        )
        click.echo(
            f"{len(runs)} model{'s' if len(runs) > 1 else ''} x {len(results)} "
            f"case{'s' if len(results) > 1 else ''}: {counts}"
        )
        if written is not None:
            click.echo(f"written: {written}")
    ctx.exit(0 if set(statuses) == {"pass"} else 1)


def _lines(result: Any, verbose: bool = False) -> list[str]:
    """Return one line per model, e.g. ``2.c.10  Short period  datcom  FAIL  1.6 x tolerance  theta
    +2.41 deg at 4.3 s (1.5 deg)``.
    """

    case, lines = result.case, []
    for name in result.runs:
        status = result.status(name)
        worst = result.worst(name)
        text = status_text(status)
        if worst is not None:
            at = f" at {worst['at']:.1f} s" if worst["measure"] == "trace" else ""
            unit = "" if worst["unit"] == "1" else f" {worst['unit']}"
            text += f"  {worst['worst_ratio']:.2f} x tolerance"
            text += (
                f"  {worst['criterion']} {worst['worst']:+.3g}{unit}{at} "
                f"({worst['tolerance_text']})"
            )
            text += (
                "".join(f"; {words}" for words in trim_remarks(result, name))
                if status in ("limits_exceeded", "record_error")
                else ""
            )
        elif status not in PASSED:
            rows = result.verdict[
                (result.verdict["run"] == name) & (result.verdict["verdict"] == status)
            ]
            text += f"  {remarks_text(rows.iloc[0]['remarks'])}" if len(rows) else ""
        lines.append(f"{case.id:<8}{case.title:<44} {name:<12} {text}")
        lines += (
            [f"{'':8}notice {text}" for text in run_notices(result, name)]
            if status != "fail" or verbose
            else []
        )
        lines += [f"{'':8}{sampled_line(result, name)}"] if name in result.samples else []
        lines += [f"{'':8}{text}" for text in run_notes(result, name)] if verbose else []
    return lines


def _summary(result: Any) -> dict[str, Any]:

    return {
        "case": result.case.name,
        "id": result.case.id,
        "standard": result.case.standard,
        "edition": result.case.edition,
        "status": {name: result.status(name) for name in result.runs},
        "failure": result.failure,
        "verdict": result.verdict_records(),
        "trim": result.trim,
        "pilot": pilot_activity(result),
        "drift": drift(result),
        "calibration": calibration(result),
        "samples": {name: samples.numbers() for name, samples in result.samples.items()},
    }
