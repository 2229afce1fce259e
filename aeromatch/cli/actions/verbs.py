"""Functions that perform the commands of `aeromatch.cli.verbs`."""

from __future__ import annotations

import math
import warnings
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from itertools import chain
from pathlib import Path
from typing import Any

import click

from aeromatch.cli.actions.examples import example_folder
from aeromatch.cli.actions.plan import print_plan
from aeromatch.rebuilding.finished import Finished, Watched
from flightmech.errors import AeromatchWarning
from flightmech.support.console import (
    command_line,
    print_json,
    print_remark,
    print_table,
    timed_step,
    to_json_types,
)
from flightmech.support.kept_stages.store import StageStore, size_limit, store_folder

"""What a project starts from; aircraft file, name map, project file and cases are made from it."""


BUILD_FLAGS = ("--fresh", "--explain")
"""Flags that leave the bytes of the output as they are: the report does not state them."""


_DECISIVE = ("samples", "seed", "compare")  # options that decide the bytes of the output


_PLANNED = ("scheduler", "resume", "samples", "compare")  # options that the plan depends on


def run_demo(output: Path, jobs: int, fresh: bool, explain: bool, as_json: bool) -> None:
    """Perform the command ``demo``."""
    _match(
        example_folder("t37") / "aeromatch.toml",
        output,
        jobs,
        as_json=as_json,
        fresh=fresh,
        explain=explain,
        unplaced=None,
        options={},
    )


def run_match(
    project: Path,
    output: Path | None,
    jobs: int,
    scheduler: str | None,
    resume: Path | None,
    compare_tables: bool,
    actions: Path | None,
    unplaced: str | None,
    paths_only: bool,
    samples: int,
    seed: int,
    plan_only: bool,
    fresh: bool,
    explain: bool,
    as_json: bool,
) -> None:
    """Perform the command ``match``."""
    way: dict[str, Any] = {
        "as_json": as_json,
        "fresh": fresh,
        "explain": explain,
        "unplaced": unplaced,
    }
    options = {
        "scheduler": scheduler,
        "resume": resume,
        "samples": samples,
        "compare": compare_tables,
    }
    if plan_only:
        if actions is not None:
            raise click.UsageError(
                "--plan and --actions exclude each other; a plan carries out no action"
            )
        # nothing is written: without a folder that of a match next to the project is checked
        _plan(project, output or project.parent / "out", jobs, **way, options=options)
        return
    if output is None:
        raise click.UsageError("Missing option '-o' / '--output'; only --plan does without it.")
    if paths_only:
        ignored = {
            "--actions": actions is not None,
            "--scheduler": scheduler is not None,
            "--resume": resume is not None,
            "--compare-tables": compare_tables,
            "--unplaced": unplaced is not None,
            "--samples": samples > 0,
        }
        given = [option for option, is_given in ignored.items() if is_given]
        if given:
            raise click.UsageError(
                f"--paths and {', '.join(given)} exclude each other; --paths only reconstructs the "
                f"records of PROJECT as it is: leave out {'it' if len(given) == 1 else 'them'}, or "
                f"match without --paths"
            )
        _write_paths(project, output, jobs, as_json=as_json, fresh=fresh, explain=explain)
        return
    if actions is not None:
        if _replayed(project, output, actions):
            return
        output = output / "match"
    _match(project, output, jobs, **way, options=options | {"seed": seed})


def _write_paths(
    file: Path, folder: Path, jobs: int, as_json: bool, fresh: bool, explain: bool
) -> None:
    """Write the reconstructed records of a match, from the store where it has them."""
    # a match without a change loads nothing that computes
    from aeromatch.workflow.identification import find_paths
    from flighttest.reconstruction.flight_programme import save_path

    project = _project(file, None)
    with _stages(_store(), folder, fresh, explain) as stages:
        found = find_paths(project, jobs, timed_step, stages)
        with timed_step(f"write {len(found)} reconstructed records"):
            folder.mkdir(parents=True, exist_ok=True)
            for name, path in found.items():
                save_path(path.value, folder / f"{name}.nc")
        made = stages.computed["path"]
    if as_json:
        print_json({"folder": str(folder), "records": list(found), "reconstructed": made})
        return
    click.echo(
        f"written: {len(found)} reconstructed records in {folder}, {len(found) - made} of them "
        f"from the store"
    )


def _replayed(project: Path, output: Path, log: Path) -> bool:
    """Carry out the actions of a log, and return whether the match of the project as they leave it
    is one of them.
    """
    # a match without a change loads nothing that computes
    from aeromatch.workbench.actions import carry_out, last_match, read_action_log, to_do
    from aeromatch.workbench.allowed_actions import PlaceholderFolders

    output.mkdir(parents=True, exist_ok=True)
    places = PlaceholderFolders(project.resolve().parent, output.resolve())
    entries = read_action_log(log, places)
    left = to_do(entries, places)
    for text in carry_out(left, places, timed_step):
        print_remark(text)
    click.echo(f"{len(left)} of {len(entries)} actions carried out, the others were done already")
    last = last_match(entries)
    if last is not None:
        click.echo(f"the match is that of action {last.number}: {output / 'match'}")
    return last is not None


def _match(
    file: Path,
    output: Path,
    jobs: int,
    as_json: bool,
    fresh: bool,
    explain: bool,
    unplaced: str | None,
    options: Mapping[str, Any],
) -> None:
    """Perform a match, unless nothing changed since the last one, and print its outcome."""

    store, limit, command = _store(), size_limit(), command_line(without=BUILD_FLAGS)
    watched = Watched(file)
    decisive = {name: options[name] for name in _DECISIVE if name in options}
    settings = {
        "command": command,
        "project": str(file.resolve()),
        "unplaced": unplaced,
        **decisive,
    }
    finished = Finished(store.folder, output) if store is not None else None
    shown = finished.read(watched, settings) if finished is not None and not fresh else None
    if shown is not None:
        print_remark(
            f"nothing changed since the last match: {len(watched.files)} files read, every "
            f"file of {output} intact"
        )
        for text in shown["remarks"]:
            click.echo(f"warning: {text}", err=True)
    else:
        if finished is not None:
            finished.forget()
        shown = _performed(
            file,
            output,
            jobs,
            command=command,
            store=store,
            fresh=fresh,
            explain=explain,
            unplaced=unplaced,
            options=options,
        )
        if finished is not None and watched.unchanged():
            finished.write(
                watched, settings, [output.resolve() / name for name in shown["files"]], shown
            )
        if store is not None:
            store.shorten(limit)
    if as_json:
        print_json(shown["document"])
        return
    _print(shown)


def _store() -> Any:
    """Return the store of stages; None where it is switched off or cannot be made."""

    folder = store_folder()
    if folder is None:
        return None
    try:
        return StageStore(folder)
    except OSError as error:
        print_remark(f"nothing is kept of the stages: {folder}: {error.strerror}")
        return None


def _performed(
    file: Path,
    output: Path,
    jobs: int,
    command: str,
    store: Any,
    fresh: bool,
    explain: bool,
    unplaced: str | None,
    options: Mapping[str, Any],
) -> dict[str, Any]:
    """Perform a match, and return what is printed of it as plain data."""
    # a match without a change loads nothing that computes
    from aeromatch.workflow.steps import perform_match

    project = _project(file, unplaced)
    with _stages(store, output, fresh, explain) as stages:
        # what is not kept is computed again by the match, with its warnings
        with timed_step("check the project, its records and its cases"), warnings.catch_warnings():
            warnings.simplefilter("ignore", AeromatchWarning)
            plan = _made_plan(project, output, jobs, options, stages, keep_records=True)
        plan.demand()
        for text in dict.fromkeys(stages.remarks if store is not None else ()):
            warnings.warn(text, AeromatchWarning, stacklevel=2)
        outcome = perform_match(
            project, output, jobs, timed_step, command, stages=stages, **options
        )
    return to_json_types(
        {
            "document": outcome.to_dict(),
            "remarks": list(dict.fromkeys(stages.remarks)),
            **_summary(outcome),
        }
    )


def _project(file: Path, unplaced: str | None) -> Any:
    """Return a project, with the answer to terms without a place that the command gives."""
    # a match without a change loads nothing that computes
    from aeromatch.project.project import read_project

    project = read_project(file)
    return project if unplaced is None else project.with_changes(unplaced=unplaced)


def _made_plan(
    project: Any,
    output: Path,
    jobs: int,
    options: Mapping[str, Any],
    stages: Any,
    keep_records: bool = False,
) -> Any:

    # a match without a change loads nothing that computes
    from aeromatch.planning.match_plan import MatchOptions, make_plan

    chosen = MatchOptions(**{name: options[name] for name in _PLANNED if name in options})
    return make_plan(
        project, output, jobs, options=chosen, stages=stages, keep_records=keep_records
    )


@contextmanager
def _stages(store: Any, output: Path, fresh: bool, explain: bool) -> Iterator[Any]:
    """Give the stages of a job; when it is over, also by an error, state why stages were computed
    if that is wanted.
    """
    # a match without a change loads nothing that computes
    from flightmech.support.kept_stages.explanation import StageTrace
    from flightmech.support.kept_stages.stages import Stages

    reasons: list[str] = []
    trace = StageTrace.of(store.folder, output) if store is not None else None
    stages = Stages(store, trace, fresh, explain=reasons.append)
    try:
        yield stages
    finally:
        names = dict.fromkeys([*stages.reused, *stages.computed])
        counts = [
            f"{stage}: {stages.computed[stage]} computed, {stages.reused[stage]} reused"
            for stage in names
        ]
        for text in [*reasons, *counts] if explain else ():
            click.echo(text, err=True)


def _summary(outcome: Any) -> dict[str, Any]:
    """Return what is printed of a match: columns, rows of cases, lines, and the files that it
    wrote.
    """
    # a match without a change loads nothing that computes
    from pom.report.case.remarks import sampled_line

    runs = list(dict.fromkeys(chain.from_iterable(result.runs for result in outcome.results)))
    rows = [
        [result.case.id, result.case.title, *(_cell(result, run) for run in runs)]
        for result in outcome.results
    ]
    lines = []
    for run in runs:
        # a device has recorded some of the cases
        statuses = [result.status(run) for result in outcome.results if run in result.runs]
        departing = statuses.count("pass_with_departures")
        more = f", {departing} more with departures" if departing else ""
        beyond = statuses.count("limits_exceeded")
        more += f", {beyond} more with a trim beyond its limits (LIMITS)" if beyond else ""
        faulty = statuses.count("record_error")
        more += f", {faulty} more on a record with errors (RECORD)" if faulty else ""
        leaks = statuses.count("leak")
        more += f", {leaks} on a record that identified the model (LEAK)" if leaks else ""
        given = statuses.count("not_driven")
        more += f", {given} not driven by the inputs (NOT DRIVEN)" if given else ""
        shown = statuses.count("demonstration")
        more += f", {shown} demonstrations without a tolerance" if shown else ""
        lines.append(f"{run:>10}: {statuses.count('pass')} of {len(statuses)} pass{more}")
    for result in outcome.results:
        for run in result.samples:
            lines.append(
                f"{result.case.id:<8}{result.case.title:<44} {run}: {sampled_line(result, run)}"
            )
    lines.append(
        f"corrected = {outcome.prior_model} with {len(outcome.corrected_terms)} of the "
        f"{outcome.differing} terms and parts of final that differ"
    )
    lines += [
        f"{submodel:>15}: {', '.join(names)}"
        for submodel, names in outcome.corrected_submodels.items()
    ]
    for name, terms in outcome.joint_terms.items():
        lines.append(
            f"added for {name}, which does not pass with only the terms that the cases need one "
            f"by one: {', '.join(terms)}"
        )
    lines += outcome.ranking
    failures = [
        *outcome.record_errors,
        *outcome.left_out,
        *(f"{result.case.name}: {result.failure}" for result in outcome.results if result.failure),
    ]
    return {
        "columns": ["row", "case", *runs],
        "rows": rows,
        "lines": lines,
        "failures": failures,
        "files": outcome.files,
    }


def _plan(
    file: Path,
    output: Path,
    jobs: int,
    as_json: bool,
    fresh: bool,
    explain: bool,
    unplaced: str | None,
    options: Mapping[str, Any],
) -> None:
    """Print the plan of a match; raise its problems."""
    # the checks that it keeps are small: the next match shortens the store
    with _stages(_store(), output, fresh, explain) as stages:
        plan = _made_plan(_project(file, unplaced), output, jobs, options, stages)
    if as_json and not plan.problems:
        print_json(plan.to_dict())
        return
    if not as_json:
        print_plan(plan)
    plan.demand()


def _print(shown: Mapping[str, Any]) -> None:
    if shown["rows"]:
        title = "Verdicts: worst difference / tolerance, of the alternatives the better one"
        print_table(shown["columns"], [tuple(row) for row in shown["rows"]], title=title)
    for text in shown["lines"]:
        click.echo(text)
    for text in shown["failures"]:
        print_remark(text)
    report = shown["document"]["report"]
    if report:
        click.echo(f"report: {report}")
    else:
        click.echo("the project has no case: nothing was proven, and no report was written")


def _cell(result: Any, run: str) -> str:

    # a match without a change loads nothing that computes
    from pom.status import status_text

    if run not in result.runs:
        return "not run"
    row, text = result.deciding_row(run), status_text(result.status(run))
    if not row:
        return text
    # a row that is not judged has no ratio
    ratio = f"{row['worst_ratio']:.2f}" if math.isfinite(row["worst_ratio"]) else "\N{EN DASH}"
    return f"{text}  {ratio}  {row['criterion'].replace('_', ' ')}"
