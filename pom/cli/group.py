"""``aeromatch pom``: check cases, run them against models, name the terms behind a mismatch."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import click

from flightmech.support.console import (
    InputFile,
    NewFile,
    NewFolder,
    command_line,
    jobs_option,
    json_option,
    print_json,
    print_remark,
    print_table,
    show_progress,
)
from pom.cli.actions.report import (
    biases_option,
    case_files,
    cases_argument,
    read_biases,
    signatures_of,
)
from pom.cli.actions.tune import tuning_logs
from pom.cli.diagnose import diagnose_command
from pom.cli.report import (
    samples_options,
    case_schema_command,
    init_case_command,
    report_options,
    verify_report_command,
    write_report_command,
)
from pom.cli.tune import tune_command


@click.group()
def pom() -> None:
    """Replay recorded inputs and judge the match."""


pom.add_command(init_case_command)
pom.add_command(case_schema_command)
pom.add_command(diagnose_command)
pom.add_command(write_report_command)
pom.add_command(verify_report_command)
pom.add_command(tune_command)


@pom.command("check")
@cases_argument
@json_option
def check_cases_command(cases: tuple[Path, ...], as_json: bool) -> None:
    """Read CASES (files, or folders of them) and print their criteria as they will be judged.

    All that is wrong with any of them is reported at once, windows beyond their records too.
    """
    from flightmech.errors import AeromatchError, SchemaError
    from pom.cases.case import read_case
    from pom.cases.reference_states import window_problem
    from pom.fmu.description import demand_platform, read_fmu_interface

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
    from pom.judging.verdict import reason_not_judged

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


@pom.command("run")
@cases_argument
@click.option(
    "--model",
    "models",
    multiple=True,
    required=True,
    metavar="NAME=FILE.fmu",
    help="A model; as often as wanted.",
)
@click.option(
    "-o", "--output", type=NewFolder(), help="Folder for the report: pages, numbers, manifest."
)
@click.option("--title", default="Proof of Match", show_default=True, help="Title of the report.")
@report_options
@click.option(
    "--junit", type=NewFile(), help="JUnit XML for a build server, with or without a report."
)
@click.option(
    "--names",
    "tables",
    multiple=True,
    metavar="NAME=FILE.toml",
    help="Table of names, units and signs of a model.",
)
@click.option(
    "--timeout", default=60.0, show_default=True, help="Wall time per model and case. [s]"
)
@jobs_option
@click.option(
    "--scheduler",
    metavar="tcp://HOST:PORT",
    help="Fly on the workers of a dask.distributed cluster that see the same files.",
)
@click.option(
    "--resume",
    type=click.Path(file_okay=False, path_type=Path),
    help="Folder that keeps flights; what is there is not flown again.",
)
@biases_option
@click.option(
    "--evidence",
    type=InputFile(),
    help="Identified database with standard errors, with which the terms of each model are "
    "compared.",
)
@samples_options
@click.option(
    "--database",
    "databases",
    multiple=True,
    metavar="NAME=FILE.nc",
    help="Database that a model was made from, with standard errors; needs --samples.",
)
@click.option(
    "--tuning",
    "tunings",
    multiple=True,
    metavar="NAME=FILE.json",
    help="Log by which a model was tuned, of aeromatch pom tune; needs -o.",
)
@click.option(
    "-v", "--verbose", is_flag=True, help="Print trim, math pilot and drift of every model as well."
)
@json_option
@click.pass_context
def run_cases_command(
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
    """Replay CASES (files, or folders of them) by models and print one line per case and model.

    All cases and records are checked before the first flight. Exit code 0 when all pass, 1 when one
    does not; a pass with a trim beyond its limits (LIMITS) is not enough, unless [rationale] of the
    case file states why the bias is allowed, and neither is a pass against a flight record with an
    error (RECORD).
    """
    import aerodb
    from flightmech.errors import SimulationError
    from flightmech.support.kept_stages.sharing import demand_scheduler
    from pom.archive.archive import Custody
    from pom.cases.case import read_case
    from pom.checking.batch_check import check_batch
    from pom.checking.case_check import checks_text, with_record_checks
    from pom.fmu.simulate import Models
    from pom.replaying.batch import replay_all
    from pom.replaying.replay_case import files_by_name
    from pom.result import status_text

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
            from pom.diagnosis.sampling.sampled_replay import replay_sampled

            results = replay_sampled(read, runs, stated, samples, seed, **given)
        else:
            results = replay_all(read, runs, **given)
    if not flown:
        raise SimulationError("no model could be replayed: " + results[0].failure)
    results = with_record_checks(results, checks)
    custody.check()
    written = None
    if output is not None:
        from pom.archive.origins import provenance
        from pom.report.writer import write_report

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
        from pom.report.exports import write_junit

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
    from pom.report.case.remarks import run_notes, sampled_line
    from pom.result import PASSED, run_notices, status_text, trim_remarks
    from pom.tolerances.bands import remarks_text

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
    from pom.replaying.run_remarks import calibration, drift, pilot_activity

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
