"""Functions that perform the commands of `aeromatch.cli.init`."""

from __future__ import annotations

import sys
from pathlib import Path

import click

from aeromatch.drafting.folder import StatedFacts, draft_project
from flightmech.support.console import (
    print_json,
    print_remark,
    print_table,
    show_progress,
)

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
    if sys.stdin.isatty() and not as_json:
        stated |= {
            key: click.prompt(text, default="", show_default=False)
            for key, text in _ASKED.items()
            if not stated[key]
        }
    name, prove, cg, imu = (stated.pop(key) for key in ("name", "prove", "cg", "imu"))
    known = StatedFacts(
        name, {key: value for key, value in stated.items() if value}, cg or None, imu or None
    )
    done = draft_project(folder, datcom, records, known, prove, force, show_progress, own_map)
    if as_json:
        print_json(done.to_dict())
        return
    if done.roles:
        print_table(["listing", "case", "name", "taken for", "because"], done.roles)
    if done.records:
        rows = [
            (name, about["channels"], ", ".join(about["manoeuvres"]) or "-")
            for name, about in done.records.items()
        ]
        print_table(["record", "channels", "manoeuvres"], rows, right=["channels"])
    for text in done.remarks:
        print_remark(f"  - {text}")
    for file in done.files:
        click.echo(f"written: {file}")
    if done.complete:
        click.echo(f"next: aeromatch match {folder / 'aeromatch.toml'} -o {folder / 'out'}")
    else:
        click.echo("next: give what is listed above")
