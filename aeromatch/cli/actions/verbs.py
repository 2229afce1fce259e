"""Functions that perform the commands ``demo`` and ``match``.

A match of which nothing changed must end at once. The numerical modules are therefore imported
inside the functions that compute.
"""

from __future__ import annotations

import warnings
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import click

from aeromatch.cli.actions.examples import example_folder
from aeromatch.cli.actions.match_summary import print_summary, summarise_match
from aeromatch.cli.actions.plan import print_plan
from aeromatch.rebuilding.finished import Finished, Watched
from aeromatch.rebuilding.match_options import MatchOptions
from flightmech.errors import AeromatchWarning
from flightmech.support.console import (
    collect_options,
    command_line,
    print_json,
    print_remark,
    timed_step,
    to_json_types,
)
from flightmech.support.kept_stages.store import StageStore, size_limit, store_folder

BUILD_FLAGS = ("--fresh", "--explain")
"""Flags that do not change the bytes of the output. The report does not state them."""


@dataclass(frozen=True)
class MatchRequest:
    """Project and folder of a match, and how it runs.

    Attributes
    ----------
    project : Path
        Project file.
    output : Path
        Folder to write.
    jobs : int
        Number of processes.
    unplaced : {"raise", "warn"} or None
        Action on a significant term without a table; None for the key of the project file.
    fresh : bool
        Whether all stages are computed again.
    explain : bool
        Whether the reason of each computed stage is printed.
    as_json : bool
        Whether one JSON document is printed.
    """

    project: Path
    output: Path
    jobs: int
    unplaced: str | None
    fresh: bool
    explain: bool
    as_json: bool


def run_demo(output: Path, jobs: int, fresh: bool, explain: bool, as_json: bool) -> None:
    """Perform the command ``demo``."""
    project = example_folder("t37") / "aeromatch.toml"
    request = MatchRequest(
        project,
        output,
        jobs,
        unplaced=None,
        fresh=fresh,
        explain=explain,
        as_json=as_json,
    )
    _match(request, MatchOptions())


@collect_options(request=MatchRequest, options=MatchOptions)
def run_match(
    request: MatchRequest,
    options: MatchOptions,
    actions: Path | None,
    paths_only: bool,
    plan_only: bool,
) -> None:
    """Perform the command ``match``."""
    if plan_only:
        if actions is not None:
            raise click.UsageError(
                "--plan and --actions exclude each other; a plan carries out no action"
            )
        _print_match_plan(request, options)
        return
    if paths_only:
        _demand_paths_alone(request, options, actions)
        _write_paths(request)
        return
    if actions is not None:
        if _carry_out_actions(request.project, request.output, actions):
            return
        # With a log, the output is the working folder of the workbench.
        request = replace(request, output=request.output / "match")
    _match(request, options)


def _demand_paths_alone(request: MatchRequest, options: MatchOptions, actions: Path | None) -> None:
    """Raise for options that ``--paths`` would ignore."""
    ignored = {
        "--actions": actions is not None,
        "--scheduler": options.scheduler is not None,
        "--resume": options.resume is not None,
        "--compare-tables": options.compare_tables,
        "--unplaced": request.unplaced is not None,
        "--samples": options.samples > 0,
    }
    given = [option for option, is_given in ignored.items() if is_given]
    if given:
        raise click.UsageError(
            f"--paths and {', '.join(given)} exclude each other; --paths only reconstructs the "
            f"records of PROJECT as it is: leave out {'it' if len(given) == 1 else 'them'}, or "
            f"match without --paths"
        )


def _write_paths(request: MatchRequest) -> None:
    """Write the reconstructed records of a match. Stored reconstructions are not repeated."""
    from aeromatch.workflow.identification import find_paths
    from flighttest.reconstruction.flight_programme import save_path

    folder, project = request.output, _read_project(request)
    with _open_stages(_open_store(), request) as stages:
        paths = find_paths(project, request.jobs, timed_step, stages)
        with timed_step(f"write {len(paths)} reconstructed records"):
            folder.mkdir(parents=True, exist_ok=True)
            for name, path in paths.items():
                save_path(path.value, folder / f"{name}.nc")
        computed = stages.computed["path"]
    if request.as_json:
        print_json({"folder": str(folder), "records": list(paths), "reconstructed": computed})
        return
    click.echo(
        f"written: {len(paths)} reconstructed records in {folder}, {len(paths) - computed} of them "
        f"from the store"
    )


def _carry_out_actions(project: Path, output: Path, log: Path) -> bool:
    """Carry out the actions of a log.

    Return whether the last match of the log is that of the project as the actions leave it.
    """
    from aeromatch.workbench.actions import carry_out, last_match, read_action_log, to_do
    from aeromatch.workbench.allowed_actions import PlaceholderFolders

    output.mkdir(parents=True, exist_ok=True)
    places = PlaceholderFolders(project.resolve().parent, output.resolve())
    entries = read_action_log(log, places)
    # Actions whose results exist are not repeated.
    remaining = to_do(entries, places)
    for text in carry_out(remaining, places, timed_step):
        print_remark(text)
    click.echo(
        f"{len(remaining)} of {len(entries)} actions carried out, the others were done already"
    )
    last = last_match(entries)
    if last is not None:
        click.echo(f"the match is that of action {last.number}: {output / 'match'}")
    return last is not None


def _match(request: MatchRequest, options: MatchOptions) -> None:
    """Perform a match, unless nothing changed since the last one, and print its outcome."""
    store = _open_store()
    if store is None:
        _match_alone(request, options, None, None)
        return
    finished = Finished(store.folder, request.output)

    def announce() -> None:
        print_remark(f"another match writes into {request.output}; this one waits for its end")

    with finished.alone(announce):
        _match_alone(request, options, store, finished)


def _match_alone(
    request: MatchRequest,
    options: MatchOptions,
    store: StageStore | None,
    finished: Finished | None,
) -> None:
    """Perform `_match`, while no other match with the store writes into the output folder."""
    command = command_line(without=BUILD_FLAGS)
    # All inputs are hashed before the match reads them.
    watched = Watched(request.project)
    settings = {
        "command": command,
        "project": str(request.project.resolve()),
        "unplaced": request.unplaced,
        **options.decisive(),
    }
    summary = None
    if finished is not None and not request.fresh:
        summary = finished.read(watched, settings)
    if summary is not None:
        print_remark(
            f"nothing changed since the last match: {len(watched.files)} files read, every "
            f"file of {request.output} intact"
        )
        for text in summary["remarks"]:
            click.echo(f"warning: {text}", err=True)
    else:
        if finished is not None:
            finished.forget()
        summary = _perform_match(request, options, store=store, command=command)
        # The outcome does not belong to inputs that changed during the match.
        if finished is not None and watched.unchanged():
            files = [request.output.resolve() / name for name in summary["files"]]
            finished.write(watched, settings, files, summary)
        if store is not None:
            store.shorten(size_limit())
    if request.as_json:
        print_json(summary["document"])
        return
    print_summary(summary)


def _perform_match(
    request: MatchRequest, options: MatchOptions, *, store: Any, command: str
) -> dict[str, Any]:
    """Perform a match, and return its summary as plain data."""
    from aeromatch.workflow.steps import perform_match

    project = _read_project(request)
    with _open_stages(store, request) as stages:
        # The match itself computes what is not stored, and then gives the warnings.
        with timed_step("check the project, its records and its cases"), warnings.catch_warnings():
            warnings.simplefilter("ignore", AeromatchWarning)
            plan = _make_plan(project, request, options, stages=stages, keep_records=True)
        # A remark, such as a code of missing values, often explains a problem.
        for text in plan.remarks:
            warnings.warn(text, AeromatchWarning, stacklevel=2)
        plan.demand()
        for text in dict.fromkeys(stages.remarks if store is not None else ()):
            warnings.warn(text, AeromatchWarning, stacklevel=2)
        outcome = perform_match(
            project,
            request.output,
            request.jobs,
            timed_step,
            command=command,
            options=options,
            stages=stages,
        )
    return to_json_types(
        {
            "document": outcome.to_dict(),
            "remarks": list(dict.fromkeys(stages.remarks)),
            **summarise_match(outcome),
        }
    )


def _print_match_plan(request: MatchRequest, options: MatchOptions) -> None:
    """Print the plan of a match; raise its problems."""
    # The plan stores small checks only. The next match shortens the store.
    with _open_stages(_open_store(), request) as stages:
        plan = _make_plan(_read_project(request), request, options, stages=stages)
    if request.as_json and not plan.problems:
        print_json(plan.to_dict())
        return
    if not request.as_json:
        print_plan(plan)
    plan.demand()


def _read_project(request: MatchRequest) -> Any:
    """Return the project, with the option ``--unplaced`` in place of its own key."""
    from aeromatch.project.project import read_project

    project = read_project(request.project)
    if request.unplaced is None:
        return project
    return project.with_changes(unplaced=request.unplaced)


def _make_plan(
    project: Any,
    request: MatchRequest,
    options: MatchOptions,
    *,
    stages: Any,
    keep_records: bool = False,
) -> Any:
    """Return the plan of a match."""
    from aeromatch.planning.match_plan import make_plan

    return make_plan(
        project,
        request.output,
        request.jobs,
        options=options,
        stages=stages,
        keep_records=keep_records,
    )


def _open_store() -> StageStore | None:
    """Return the store of stages; None if it is switched off or cannot be made."""
    folder = store_folder()
    if folder is None:
        return None
    # A text that is not a size is an error before the computation, not after it.
    size_limit()
    try:
        return StageStore(folder)
    except OSError as error:
        print_remark(f"nothing is kept of the stages: {folder}: {error.strerror}")
        return None


@contextmanager
def _open_stages(store: StageStore | None, request: MatchRequest) -> Iterator[Any]:
    """Yield the stages of a job; at its end, also by an error, print why stages were computed."""
    from flightmech.support.kept_stages.explanation import StageTrace
    from flightmech.support.kept_stages.stages import Stages

    reasons: list[str] = []
    trace = StageTrace.of(store.folder, request.output) if store is not None else None
    stages = Stages(store, trace, request.fresh, explain=reasons.append)
    try:
        yield stages
    finally:
        if request.explain:
            for stage in dict.fromkeys([*stages.reused, *stages.computed]):
                computed, reused = stages.computed[stage], stages.reused[stage]
                reasons.append(f"{stage}: {computed} computed, {reused} reused")
            for text in reasons:
                click.echo(text, err=True)
