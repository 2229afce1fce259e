"""Functions that perform the commands of `pom.cli.diagnose`."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import click
import pandas as pd

import aerodb
from flightmech.aircraft.aircraft import Aircraft, read_aircraft
from flightmech.aircraft.writing import write_aircraft
from flightmech.errors import SchemaError
from flightmech.support.console import (
    print_json,
    print_remark,
    print_table,
    show_progress,
)
from pom.archive.origins import file_sha256
from pom.cases.case import PomCase, read_case
from pom.cases.reference_states import recorded_states
from pom.checking.batch_check import check_batch
from pom.cli.actions.report import case_files, read_biases
from pom.diagnosis.corrected_model import corrected_aircraft, corrected_database, joint_terms
from pom.diagnosis.joint_correction import rank_all, swap_models
from pom.diagnosis.joint_search import join_tables
from pom.diagnosis.term_swaps import differing_terms
from pom.diagnosis.waterfall_steps import criteria_of
from pom.report.models.diagnosis import cause_sentences

_IDLE = 0.005  # share of the gap


_INTERACTING = 5  # pairs printed


def run_diagnose(
    cases: tuple[Path, ...],
    prior: str,
    final: str,
    apriori: str | None,
    groups: tuple[str, ...],
    players: int,
    replays: int,
    seed: int,
    output: str | None,
    aircraft_output: str | None,
    biases_file: str | None,
    jobs: int,
    as_json: bool,
) -> None:
    """Perform the command ``diagnose``."""
    if aircraft_output and not apriori:
        raise click.UsageError(
            "--aircraft-output needs --apriori: the aircraft file that is to be corrected"
        )
    wanted = _groups(groups)

    before, after = aerodb.open(prior), aerodb.open(final)
    old = read_aircraft(apriori) if apriori else None
    biases, read = read_biases(biases_file), _cases(cases)
    with show_progress("check the cases and their records"):
        checks = check_batch(read, None, jobs)
    for one in checks.values():
        for words in one.lines():
            print_remark(f"  {words}")
    new = {case.aircraft: read_aircraft(case.aircraft) for case in read}
    models = swap_models(before, after, {case.name: new[case.aircraft] for case in read}, old)
    with show_progress(f"swap terms on {len(read)} case{'s' if len(read) > 1 else ''}"):
        paths = {case.name: recorded_states(case, biases) for case in read}
        ranked = rank_all(
            read, models, paths, jobs, groups=wanted, players=players, replays=replays, seed=seed
        )
    found = {name: table for name, (_, table) in ranked.items()}
    if not as_json:
        for case in read:
            _print(case, found[case.name])
    if output or aircraft_output:
        with show_progress("join what the cases need"):
            found = join_tables(found, {name: bench for name, (bench, _) in ranked.items()}, jobs)
        if not as_json:
            _print_joint(found)
    written = _written(output, (before, after, final), found) if output else ""
    if aircraft_output and old is not None:
        _write_aircraft(aircraft_output, old, new, found)
    if as_json:
        print_json(
            [
                {"case": name, **row}
                for name, rows in found.items()
                for row in rows.to_dict("records")
            ]
        )
        return
    if written:
        click.echo(written)
    if aircraft_output:
        click.echo(f"written: {aircraft_output}")


def _cases(places: tuple[Path, ...]) -> list[PomCase]:

    found = [read_case(file) for file in case_files(places)]
    problems = [
        f"{case.path}: case.aircraft: missing; the kernel flies an aircraft, give its file"
        for case in found
        if not case.aircraft
    ]
    problems += [
        f"{case.path}: control_law: the kernel flies no FMU of a control law; leave the case out"
        for case in found
        if case.law
    ]
    names = [case.name for case in found]
    problems += [
        f"case name {name!r} is given twice"
        for name in dict.fromkeys(names)
        if names.count(name) > 1
    ]
    if problems:
        raise SchemaError("cases to diagnose", problems)
    return found


def _groups(texts: tuple[str, ...]) -> dict[str, list[str]]:
    found: dict[str, list[str]] = {}
    for text in texts:
        name, equals, members = text.partition("=")
        found[name.strip()] = [word.strip() for word in members.split(",") if word.strip()]
        if not equals or not name.strip() or not found[name.strip()]:
            raise click.UsageError(
                f"--group {text!r}: expected NAME=TERM,TERM such as ground=CL/ground,Cm/ground"
            )
    return found


def _written(output: str, databases: tuple[Any, Any, str], found: dict[str, pd.DataFrame]) -> str:

    before, after, final = databases
    corrected = corrected_database(before, after, found, _source(final))
    aerodb.save(corrected, output)
    return (
        f"written: {output}, with {' '.join(differing_terms(before, corrected)) or 'no term'} "
        f"of {final}"
    )


def _write_aircraft(
    output: str, old: Aircraft, new: dict[str, Aircraft], found: dict[str, pd.DataFrame]
) -> None:

    if len(new) > 1:
        raise SchemaError(
            "corrected aircraft",
            [
                f"the cases name {len(new)} aircraft files ({', '.join(new)}); diagnose them "
                f"one by one"
            ],
        )
    ((file, aircraft),) = new.items()
    write_aircraft(corrected_aircraft(old, aircraft, found, _source(file)), output)


def _source(file: str) -> str:
    """Return what the history calls a file: its name and the first half of its digest."""

    return f"{Path(file).name} (SHA-256 {file_sha256(file)[:32]})"


def _print(case: PomCase, ranked: pd.DataFrame) -> None:

    criteria = criteria_of(ranked)
    idle = ranked["stage"].isin(["single", "group"]) & (ranked["explained"].abs() < _IDLE)
    idle |= (ranked["stage"] == "without") & ((ranked["explained"] - 1.0).abs() < _IDLE)
    pairs = ranked[ranked["stage"] == "pair"]
    quiet = pairs.index.difference(pairs["interaction"].abs().nlargest(_INTERACTING).index)
    columns = [
        "stage",
        "term",
        "explained",
        "verdict",
        "interaction",
        *(f"{name} {what}" for name in criteria for what in ("explained", "ratio")),
    ]
    not_flown = ranked["stage"] == "idle"
    rows = [
        _cells(row, criteria) for row in ranked[~idle & ~not_flown].drop(quiet).to_dict("records")
    ]
    print_table(columns, rows, f"{case.id}  {case.title}", right=[columns[2], *columns[4:]])
    click.echo(cause_sentences(ranked))
    if not_flown.any():
        together, *alone = ranked.loc[not_flown, "bound"]
        click.echo(
            f"{len(alone)} terms not flown alone: each moves the judged outputs by less than "
            f"{100.0 * max(alone):.2g} % of their mismatch, "
            f"all together by {100.0 * together:.2g} %; --json has them all"
        )
    if idle.any():
        left_out = f"{int(idle.sum())} swaps that change less than {_IDLE:g} of the gap"
        left_out += f" and {len(quiet)} pairs that interact less" if len(quiet) else ""
        click.echo(f"{left_out} are left out; --json has them all\n")


def _print_joint(found: dict[str, pd.DataFrame]) -> None:

    for name, terms in joint_terms(found).items():
        click.echo(
            f"added for {name}, which does not pass with what each case needs alone: "
            f"{', '.join(terms)}"
        )


def _cells(row: dict[Any, Any], criteria: list[str]) -> list[str]:
    cells = [
        row["stage"],
        row["term"],
        _percent(row["explained"], row["stderr"]),
        "" if row["stage"] == "share" else row["verdict"],
    ]
    cells.append(_percent(row["interaction"]))
    for name in criteria:
        cells += [
            _percent(row[f"{name} explained"], row[f"{name} stderr"]),
            "" if row["stage"] == "share" else f"{row[f'{name} ratio']:.2f}",
        ]
    return cells


def _percent(share: float, stderr: float = 0.0) -> str:
    if share != share:
        return ""
    return f"{100.0 * share:.0f}{f' +- {100.0 * stderr:.0f}' if stderr > 0.0 else ''} %"
