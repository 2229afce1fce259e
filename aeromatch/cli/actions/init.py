"""Functions that perform the commands of `aeromatch.cli.init`."""

from __future__ import annotations

import sys
from pathlib import Path
from typing import Any

import click

from aeromatch.drafting.folder import Drafted, StatedFacts, draft_project
from aeromatch.drafting.previous import read_answers
from aeromatch.planning.match_plan import make_plan
from aeromatch.project.project import read_project
from flightmech.support.console import (
    print_json,
    print_remark,
    print_table,
    show_progress,
)
from flightmech.support.toml_files import read_toml
from flightmech.support.toml_quantities import UNFILLED

_ASKED = {
    "mass": "Gross mass, such as 2400 kg",
    "Ixx": "Moment of inertia in roll, such as 10826 kg m2",
    "Iyy": "Moment of inertia in pitch, such as 8135 kg m2",
    "Izz": "Moment of inertia in yaw, such as 15162 kg m2",
}


def init_project(
    folder: Path,
    datcom: tuple[Path, ...],
    records: tuple[Path, ...],
    force: bool,
    as_json: bool,
    own_map: str | None,
    **stated,
) -> None:
    """Perform the command ``init``."""
    answered = read_answers(folder).facts.values | _filled_values(folder / "aircraft.toml")
    if sys.stdin.isatty() and not as_json:
        for key, text in _ASKED.items():
            # Each answer is requested once.
            if not stated[key] and key not in answered:
                stated[key] = click.prompt(text, default="", show_default=False)
    name, prove, cg, imu = (stated.pop(key) for key in ("name", "prove", "cg", "imu"))
    known = StatedFacts(
        name, {key: value for key, value in stated.items() if value}, cg or None, imu or None
    )
    done = draft_project(
        folder,
        datcom,
        records,
        known=known,
        prove=prove,
        force=force,
        step=show_progress,
        own_map=own_map,
    )
    project, output = folder / "aeromatch.toml", folder / "out"
    plan = None
    if done.complete:
        with show_progress("check the project as match --plan does"):
            plan = make_plan(read_project(project), output)
    if as_json:
        problems = plan.problems if plan else []
        is_accepted = plan is not None and not problems
        print_json({**done.to_dict(), "complete": is_accepted, "problems": problems})
        return
    _print_draft(done)
    if plan is None:
        click.echo(
            'next: replace each "?" in the files as listed above, '
            f"then aeromatch init {folder} again"
        )
    elif plan.problems:
        click.echo(f"aeromatch match refuses the project for {len(plan.problems)} reasons:")
        for text in plan.problems:
            click.echo(f"  - {text}")
        click.echo(f"next: correct them, then aeromatch init {folder} again")
    elif not plan.project.fit and not plan.cases:
        click.echo(
            f"no record identifies or proves the model yet; next: correct names.toml or "
            f"aircraft.toml as listed above, then aeromatch init {folder} again"
        )
    elif plan.gaps:
        click.echo("aeromatch match would run, but a part of it has nothing to do:")
        for text in plan.gaps:
            click.echo(f"  - {text}")
        click.echo(
            f"next: correct names.toml or aircraft.toml as listed above, then aeromatch init "
            f"{folder} again; or aeromatch match {project} -o {output} as it is"
        )
    else:
        click.echo(
            f"aeromatch match accepts the project; next: aeromatch match {project} -o {output}"
        )


def _filled_values(file: Path) -> dict[str, Any]:
    """Return the values of an aircraft file that do not wait for their author."""
    if not file.exists():
        return {}
    content = read_toml(file)
    return {key: value for key, value in content.items() if value != UNFILLED}


def _print_draft(done: Drafted) -> None:
    """Print what was read, what each column was taken for, the remarks and the files."""
    if done.roles:
        print_table(["listing", "case", "name", "taken for", "because"], done.roles)
    if done.columns:
        rows = [tuple(row.to_dict().values()) for row in done.columns]
        print_table(["column", "taken as", "unit", "sign", "confidence", "because"], rows)
    if done.records:
        manoeuvres = []
        for name, about in done.records.items():
            found = ", ".join(about["manoeuvres"]) or "-"
            manoeuvres.append((name, about["channels"], found))
        print_table(["record", "channels", "manoeuvres"], manoeuvres, right=["channels"])
    for text in done.remarks:
        print_remark(f"  - {text}")
    for file in done.files:
        click.echo(f"written: {file}")
