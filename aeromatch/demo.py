"""``aeromatch match PROJECT`` and ``aeromatch demo``: the whole job from listings and flights to the report."""

from __future__ import annotations

import warnings
from dataclasses import replace
from pathlib import Path
from typing import Any

import click

from flightmech.errors import AeromatchWarning
from flightmech.support.console import InputFile, NewFolder, command_line, document, jobs_option, json_option, remark, step, table
from pom.cli.arguments import samples_options


@click.command()
@click.option("-o", "--output", type=NewFolder(), default=Path("out/t37"), show_default=True, help="Folder to write.")
@jobs_option
@json_option
def demo(output: Path, jobs: int, as_json: bool) -> None:
    """Perform the whole job on the shipped T-37 example."""
    from .examples import example_folder

    _match(example_folder("t37") / "aeromatch.toml", output, jobs, as_json)


@click.command()
@click.argument("project", type=InputFile(path_type=Path))
@click.option("-o", "--output", type=NewFolder(), required=True, help="Folder to write.")
@jobs_option
@click.option("--scheduler", metavar="tcp://HOST:PORT", help="Replay on the workers of a dask.distributed cluster that see the same files.")
@click.option(
    "--resume", type=click.Path(file_okay=False, path_type=Path), help="Folder that keeps flights; what is there is not flown again."
)
@click.option("--compare-tables", is_flag=True, help="Make the tables in all ways and write tables_compared.csv, node by node.")
@click.option(
    "--actions",
    type=InputFile(path_type=Path),
    help="Log of aeromatch view: its actions are carried out first; OUTPUT is then its working folder, with the match in OUTPUT/match.",
)
@click.option(
    "--unplaced",
    type=click.Choice(["raise", "warn"]),
    help="Stop, or go on with a warning, if no table of the database carries a significant term of a fit; as in PROJECT unless given.",
)
@samples_options
@click.option("--plan", "plan_only", is_flag=True, help="Print steps, records, fits, cases, products and all problems; compute nothing.")
@json_option
def match(
    project: Path,
    output: Path,
    jobs: int,
    scheduler: str | None,
    resume: Path | None,
    compare_tables: bool,
    actions: Path | None,
    unplaced: str | None,
    samples: int,
    seed: int,
    plan_only: bool,
    as_json: bool,
) -> None:
    """Perform the whole job of a PROJECT file: databases, FMUs and the Proof-of-Match report.

    Everything is checked before the first computation: windows, channels, drives, manoeuvres, terms, models and folders. Exit code 0
    when the job was done: failed rows are its result.
    """
    if plan_only:
        if actions is not None:
            raise click.UsageError("--plan and --actions exclude each other; a plan carries out no action")
        _plan(project, output, jobs, as_json, scheduler=scheduler, resume=resume, samples=samples, compare=compare_tables)
        return
    if actions is not None:
        if _replayed(project, output, actions):
            return
        output = output / "match"
    options = {"scheduler": scheduler, "resume": resume, "samples": samples, "seed": seed, "compare": compare_tables}
    _match(project, output, jobs, as_json, unplaced, **options)


def _replayed(project: Path, output: Path, log: Path) -> bool:
    """Carry out the actions of a log, and return whether the match of the project as they leave it is one of them."""
    from .workbench.actions import Places, carry_out, matched, read_log, to_do

    output.mkdir(parents=True, exist_ok=True)
    places, entries = Places(project.resolve().parent, output.resolve()), read_log(log)
    left = to_do(entries, places)
    for text in carry_out(left, places, step):
        remark(text)
    click.echo(f"{len(left)} of {len(entries)} actions carried out, the others were done already")
    last = matched(entries)
    if last is not None:
        click.echo(f"the match is that of action {last.number}: {output / 'match'}")
    return last is not None


def _match(file: Path, output: Path, jobs: int, as_json: bool, unplaced: str | None = None, **options: Any) -> None:
    from .planning.match_plan import MatchOptions, make_plan
    from .project import read_project
    from .workflow import perform

    project = read_project(file)
    if unplaced is not None:
        project = replace(project, unplaced=unplaced)
    # what is read or built here is read and built again, with its warnings
    with step("check the project, its records and its cases"), warnings.catch_warnings():
        warnings.simplefilter("ignore", AeromatchWarning)
        plan = make_plan(project, output, jobs, MatchOptions(**{name: options[name] for name in _PLANNED if name in options}))
    plan.demand()
    outcome = perform(project, output, jobs, step, command_line(), **options)
    if as_json:
        document(outcome.to_dict())
        return
    _print(outcome)


_PLANNED = ("scheduler", "resume", "samples", "compare")


def _plan(file: Path, output: Path, jobs: int, as_json: bool, **options: Any) -> None:
    """Print the plan of a match; raise its problems."""
    from .planning.match_plan import MatchOptions, make_plan
    from .project import read_project

    plan = make_plan(read_project(file), output, jobs, MatchOptions(**options))
    if as_json and not plan.problems:
        document(plan.to_dict())
        return
    if not as_json:
        _print_plan(plan)
    plan.demand()


def _print_plan(plan: Any) -> None:
    table(("", "step"), list(enumerate(plan.steps, 1)), title=f"{plan.project.title}: {plan.project.file}", right=("",))
    rows = [(row["record"], f"{row['start']:g} ... {row['end']:g}", row["channels"], row["for"]) for row in plan.record_rows()]
    table(("record", "time [s]", "channels", "for"), rows, title="\nFlight records", right=("channels",))
    fits = [(row["fit"], row["records"], row["windows"], f"{row['seconds']:.0f}", "; ".join(row["models"])) for row in plan.fit_rows()]
    table(("fit", "records", "windows", "time [s]", "models"), fits, title="\nFits", right=("records", "windows", "time [s]"))
    cases = [
        (row["id"], row["case"], row["record"], f"{row['start']:g} ... {row['end']:g}", row["drive"], row["criteria"])
        for row in plan.case_rows()
    ]
    table(("row", "case", "record", "window [s]", "drive", "criteria"), cases, title="\nCases", right=("criteria",))
    click.echo("\nProducts\n" + "\n".join(plan.products))
    count = len(plan.problems)
    click.echo(f"\n{count} problem{'' if count == 1 else 's'}" + ("" if count else "; nothing was computed or written"))


def _print(outcome: Any) -> None:
    from pom.report.run_notes import sampled_line

    runs = list(outcome.results[0].runs)
    rows = [(result.case.id, result.case.title, *(_cell(result, run) for run in runs)) for result in outcome.results]
    table(("row", "case", *runs), rows, title="Verdicts: worst difference / tolerance, of the alternatives the better one")
    for run in runs:
        statuses = [result.status(run) for result in outcome.results]
        beyond = statuses.count("limits_exceeded")
        more = f", {beyond} more with a trim beyond its limits (LIMITS)" if beyond else ""
        faulty = statuses.count("record_error")
        more += f", {faulty} more on a record with errors (RECORD)" if faulty else ""
        click.echo(f"{run:>10}: {statuses.count('pass')} of {len(statuses)} pass{more}")
    for result in outcome.results:
        for run in result.samples:
            click.echo(f"{result.case.id:<8}{result.case.title:<44} {run}: {sampled_line(result, run)}")
    click.echo(f"corrected = datcom with {len(outcome.corrected_terms)} of the {outcome.differing} terms and parts of final that differ")
    for submodel, names in outcome.corrected_submodels.items():
        click.echo(f"{submodel:>15}: {', '.join(names)}")
    for name, terms in outcome.joint_terms.items():
        click.echo(f"added for {name}, which does not pass with what each case needs alone: {', '.join(terms)}")
    for line in outcome.record_errors:
        remark(line)
    for result in outcome.results:
        if result.failure:
            remark(f"{result.case.name}: {result.failure}")
    click.echo(f"report: {outcome.report}")


def _cell(result: Any, run: str) -> str:
    from pom.result import status_text

    worst = result.worst(run)
    status = result.status(run)
    ratio = "" if worst is None else f"  {worst['worst_ratio']:.2f}  {worst['criterion'].replace('_', ' ')}"
    return status_text(status) + ratio
