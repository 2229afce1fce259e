"""Functions that perform the commands of `aeromatch.cli.delivery`."""

from __future__ import annotations

import webbrowser
from collections.abc import Mapping
from math import isnan
from pathlib import Path
from typing import Any

import click

from aeromatch.delivery.contents import PackageOptions, write_package
from aeromatch.delivery.flown_checks import configuration_text
from aeromatch.delivery.package_difference import package_difference
from aeromatch.delivery.package_files import PackageCheck
from aeromatch.delivery.package_opening import unpack_package
from aeromatch.delivery.signing import check_signature, make_key
from aeromatch.delivery.verification import (
    check_package_signature,
    describe_verdict,
    verify_package,
)
from aeromatch.project.project import read_project
from aeromatch.workbench.opened import OpenProject
from flightmech.errors import AeromatchError
from flightmech.support.console import print_json, print_table, timed_step
from flightmech.support.foreign_code.sandbox import describe_sandbox
from flightmech.units import FOOT, KNOT
from pom.report.presentation.term_words import term_words

NOT_COMPARED = (
    "not compared: page and PDF of the report, but for their hashes; "
    "aeromatch pom report PACKAGE/report -o NEW writes them again from the results"
)
"""What a verified package can still state wrongly."""


def make_package(
    project: Path,
    match: Path,
    output: Path,
    recordings: bool,
    licence: Path | None,
    revision: str,
    sign: Path | None,
    as_json: bool,
) -> None:
    """Perform the command ``make``."""
    refused = write_package(
        read_project(project),
        match.resolve(),
        output,
        PackageOptions(recordings, licence, revision, sign),
        timed_step,
    )
    if as_json:
        print_json({"package": str(output), "refused": refused})
        return
    for name, why in refused.items():
        click.echo(f"not in the package: {name}: {why}")
    click.echo(f"written: {output}")


def write_key(path: Path, as_json: bool) -> None:
    """Perform the command ``key``."""
    # the file of an interrupted run
    was_there = path.exists()
    public, fingerprint = make_key(path)
    if as_json:
        print_json({"private": str(path), "public": str(public), "fingerprint": fingerprint})
        return
    click.echo(f"{'read' if was_there else 'written'}: {path}, which signs: keep it secret")
    click.echo(f"written: {public}, which your customers give to --trusted-key")
    click.echo(f"fingerprint: {fingerprint}")


def run_verify_package(
    ctx: click.Context,
    package_file: Path,
    trusted_keys: tuple[Path, ...],
    fly_foreign: bool,
    as_json: bool,
) -> None:
    """Perform the command ``verify``."""
    with unpack_package(package_file) as folder:
        signature = check_signature(folder, trusted_keys)
        found = [*check_package_signature(signature, bool(trusted_keys))]
        found += verify_package(folder, fly_foreign)
    bad = [item for item in found if not item.good]
    verdict = describe_verdict(found, signature)
    if as_json:
        print_json(
            {
                "holds": not bad,
                "maker_proven": signature.state == "known",
                "verdict": verdict,
                "signature": signature.state,
                "isolation": describe_sandbox(),
                "not_compared": NOT_COMPARED,
                "findings": [vars(item) for item in found],
            }
        )
    else:
        click.echo(verdict)
        for kind in dict.fromkeys(item.kind for item in found):
            own = [item for item in found if item.kind == kind]
            click.echo(f"{kind:>9}: {sum(item.good for item in own)} of {len(own)} hold")
        stages = {item.kind for item in found}
        if "flown" not in stages:
            click.echo("not computed: numbers and flights, because an earlier stage does not hold")
        else:
            click.echo(f"read and flown in child processes {describe_sandbox()}")
            click.echo(NOT_COMPARED)
        shown = bad + [item for item in found if item.good and _is_shown(item)]
        print_table(
            ["", "what", "found"],
            [
                ("" if item.good else "DIFFERS", f"{item.kind}: {item.name}", item.detail)
                for item in shown
            ],
        )
    ctx.exit(1 if bad else 0)


def _is_shown(item: PackageCheck) -> bool:
    """Return whether a good result is printed: numbers, flights, and what was not compared."""
    return item.kind in ("states", "flown") or item.detail.startswith("not compared")


def compare_packages(
    one: Path, other: Path, model: str, against: str | None, as_json: bool
) -> None:
    """Perform the command ``diff``."""
    with unpack_package(one) as first, unpack_package(other) as second:
        found = package_difference(first, second, model, against)
    if as_json:
        print_json(found)
        return
    names = f"{one.name}, {model} -> {other.name}, {against or model}"
    _print_felt(found, names)
    _print_terms(found, names)
    _print_verdicts(found)
    for row in found["files"]:
        click.echo(f"{row['state']:>8}: {row['file']}")


def _print_felt(found: Mapping[str, Any], names: str) -> None:
    """Print what a pilot feels of a difference."""
    if found["felt"]:
        at = found["condition"]
        where = (
            f"{at['V'] / KNOT:.0f} kt true, {at['h'] / FOOT:.0f} ft, {at['mass']:.0f} kg, "
            f"{configuration_text(at).replace(';', ',')}"
        )
        felt = []
        for row in found["felt"]:
            felt.append((row["words"], row["unit"], _digits(row["before"]), _digits(row["after"])))
        print_table(
            ["what a pilot feels", "unit", "before", "after"],
            felt,
            f"{names}: at {where}",
            right=["before", "after"],
        )


def _print_terms(found: Mapping[str, Any], names: str) -> None:
    """Print the coefficients, terms and parts that differ."""
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
            _digits(row["before"]),
            _digits(row["after"]),
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


def _print_verdicts(found: Mapping[str, Any]) -> None:
    """Print the verdicts of both packages."""
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


def _digits(value: float, digits: int = 4) -> str:
    return "" if isnan(value) else f"{value:.{digits}g}"


def _ratio(value: float | None) -> str:
    return "" if value is None else f"{value:.2f}"


def open_workbench(project: Path, output: Path | None, port: int, no_browser: bool) -> None:
    """Perform the command ``view``."""
    try:
        import starlette  # noqa: F401
        import uvicorn  # noqa: F401
    except ImportError as missing:
        raise AeromatchError(
            "the workbench needs starlette and uvicorn: pip install 'aeromatch[view]'"
        ) from missing

    if project.is_dir():
        # the page of a new project shows the faults of its files
        project = project / "aeromatch.toml"
    else:
        read_project(project)  # faults of the project are reported here
    from aeromatch.workbench.server import Workbench

    bench = Workbench(OpenProject(project, output or project.resolve().parent / "workbench"), port)
    click.echo(f"workbench: {bench.address}")
    click.echo("end with Ctrl-C")
    if not no_browser:
        webbrowser.open(bench.address)
    bench.serve()
