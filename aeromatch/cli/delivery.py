"""``aeromatch package make | verify | diff``: the data package of a project."""

from __future__ import annotations

import webbrowser
from math import isnan
from pathlib import Path

import click

from flightmech.support.console import InputFile, json_option, print_json, print_table, timed_step

_PACKAGE = click.Path(exists=True, path_type=Path)
_MODEL = click.Choice(["datcom", "corrected", "final"])


@click.group()
def package() -> None:
    """Make, verify and compare data packages: models, database, aircraft, proof and check cases in
    one folder or zip.
    """


@package.command("make")
@click.argument("project", type=InputFile(path_type=Path))
@click.argument("match", type=click.Path(exists=True, file_okay=False, path_type=Path))
@click.option(
    "-o",
    "--output",
    type=click.Path(path_type=Path),
    required=True,
    help="Folder to write, or a file ending in .zip.",
)
@click.option(
    "--recordings",
    is_flag=True,
    help="Put the flight recordings into the package; without it their SHA-256 only.",
)
@click.option("--licence", type=InputFile(path_type=Path), help="Text of the licence.")
@click.option("--revision", default="", help="Revision of the package.")
@json_option
def make_package_command(
    project: Path,
    match: Path,
    output: Path,
    recordings: bool,
    licence: Path | None,
    revision: str,
    as_json: bool,
) -> None:
    """Write the data package of a PROJECT file from the folder that aeromatch MATCH wrote; the same
    bytes when made again.
    """
    from aeromatch.delivery.contents import PackageOptions, write_package
    from aeromatch.project.project import read_project

    refused = write_package(
        read_project(project),
        match.resolve(),
        output,
        PackageOptions(recordings, licence, revision),
        timed_step,
    )
    if as_json:
        print_json({"package": str(output), "refused": refused})
        return
    for name, why in refused.items():
        click.echo(f"not in the package: {name}: {why}")
    click.echo(f"written: {output}")


@package.command("verify")
@click.argument("package_file", metavar="PACKAGE", type=_PACKAGE)
@json_option
@click.pass_context
def verify_package_command(ctx: click.Context, package_file: Path, as_json: bool) -> None:
    """Verify a PACKAGE (folder or zip): hashes, verdicts judged again, check cases through every
    format; exit code 1 on a difference.
    """
    from aeromatch.delivery.verification import unpack_package, verify_package

    with unpack_package(package_file) as folder:
        found = list(verify_package(folder))
    bad = [item for item in found if not item.good]
    if as_json:
        print_json({"holds": not bad, "findings": [vars(item) for item in found]})
    else:
        for kind in dict.fromkeys(item.kind for item in found):
            own = [item for item in found if item.kind == kind]
            click.echo(f"{kind:>8}: {sum(item.good for item in own)} of {len(own)} hold")
        shown = bad + [item for item in found if item.good and item.kind in ("states", "flown")]
        print_table(
            ["", "what", "found"],
            [
                ("" if item.good else "DIFFERS", f"{item.kind}: {item.name}", item.detail)
                for item in shown
            ],
        )
    ctx.exit(1 if bad else 0)


@package.command("diff")
@click.argument("one", metavar="A", type=_PACKAGE)
@click.argument("other", metavar="B", type=_PACKAGE)
@click.option("--model", type=_MODEL, default="final", show_default=True, help="Model of A.")
@click.option("--against", type=_MODEL, help="Model of B.  [default: that of A]")
@json_option
def compare_packages_command(
    one: Path, other: Path, model: str, against: str | None, as_json: bool
) -> None:
    """State what changed from package A to B, or between two models of one: terms, parts, cases,
    verdicts.
    """
    from aeromatch.delivery.verification import package_difference, unpack_package
    from flightmech.units import DEGREE, FOOT, KNOT
    from pom.report.presentation.quantities import term_words

    with unpack_package(one) as first, unpack_package(other) as second:
        found = package_difference(first, second, model, against)
    if as_json:
        print_json(found)
        return
    names = f"{one.name}, {model} -> {other.name}, {against or model}"
    if found["felt"]:
        at = found["condition"]
        where = (
            f"{at['V'] / KNOT:.0f} kt true, {at['h'] / FOOT:.0f} ft, {at['mass']:.0f} kg, "
            f"flaps {at.get('delta_f', 0.0) / DEGREE:.0f} deg"
        )
        gear = "down" if at.get("gear", 0.0) > 0.5 else "up"
        felt = [
            (row["words"], row["unit"], *(_digits(row[key]) for key in ("before", "after")))
            for row in found["felt"]
        ]
        print_table(
            ["what a pilot feels", "unit", "before", "after"],
            felt,
            f"{names}: at {where}, gear {gear}",
            right=["before", "after"],
        )
    head = [
        "",
        "state",
        "before",
        "after",
        "where they differ most",
        "rms",
        "in standard errors",
        "in words",
    ]
    rows = [
        (
            row["name"],
            row["state"],
            *(_digits(row[key]) for key in ("before", "after")),
            row["where"] or row["note"],
            _digits(row["rms"], 3),
            "" if isnan(row["in_standard_errors"]) else f"{row['in_standard_errors']:.1f}",
            term_words(row["name"]) if "/" in row["name"] else "",
        )
        for row in (*found["coefficients"], *found["terms"])
    ]
    print_table(
        head, rows, f"{names}: {len(found['terms'])} terms differ", right=[*head[2:4], *head[5:7]]
    )
    click.echo(f"parts of the aircraft that differ: {', '.join(found['parts']) or 'none'}")
    cases = [
        (
            r["row"],
            r["case"],
            r["before"],
            r["after"],
            _ratio(r["worst_before"]),
            _ratio(r["worst_after"]),
        )
        for r in found["cases"]
    ]
    head = ["row", "case", "before", "after", "worst before", "worst after"]
    print_table(head, cases, "Verdicts, worst difference / tolerance", right=head[4:])
    for row in found["files"]:
        click.echo(f"{row['state']:>8}: {row['file']}")


def _digits(value: float, digits: int = 4) -> str:
    return "" if isnan(value) else f"{value:.{digits}g}"


def _ratio(value: float | None) -> str:
    return "" if value is None else f"{value:.2f}"


@click.command("view")
@click.argument("project", type=InputFile(path_type=Path))
@click.option(
    "-o",
    "--output",
    type=click.Path(file_okay=False, path_type=Path),
    help="Working folder: reconstructed records, fits, match, log of the actions.  [default: "
    "workbench, next to the project file]",
)
@click.option(
    "--port",
    type=click.IntRange(0, 65535),
    default=0,
    help="Port on 127.0.0.1.  [default: a free one]",
)
@click.option("--no-browser", is_flag=True, help="Print the address only.")
def open_workbench_command(project: Path, output: Path | None, port: int, no_browser: bool) -> None:
    """Open the workbench of a PROJECT in the browser: records, identification, database, match.

    It is served on this machine alone, to who has the printed address. What changes a file is a
    verb of this command line; the log actions.jsonl in the working folder is replayed by aeromatch
    match --actions.
    """
    from flightmech.errors import AeromatchError

    try:
        import starlette  # noqa: F401
        import uvicorn  # noqa: F401
    except ImportError as missing:
        raise AeromatchError(
            "the workbench needs starlette and uvicorn: pip install 'aeromatch[view]'"
        ) from missing
    from aeromatch.project.project import read_project
    from aeromatch.workbench.opened import OpenProject
    from aeromatch.workbench.server import Workbench

    read_project(project)  # faults of the project are reported here
    bench = Workbench(OpenProject(project, output or project.resolve().parent / "workbench"), port)
    click.echo(f"workbench: {bench.address}")
    click.echo("end with Ctrl-C")
    if not no_browser:
        webbrowser.open(bench.address)
    bench.serve()
