"""Functions that perform the commands of `pom.cli.tune`."""

from __future__ import annotations

import json
from collections.abc import Iterable, Mapping
from pathlib import Path
from typing import Any

import click
import xarray as xr

import aerodb
from flightmech.aircraft.aircraft import Aircraft, read_aircraft
from flightmech.aircraft.writing import write_aircraft
from flightmech.errors import SchemaError, UnknownName
from flightmech.fmu_export.fmu_file import write_fmu
from flightmech.simulation.compiler import compile as compile_model
from flightmech.simulation.node_values import nodes_digest
from flightmech.support.atomic_write import folder_written_atomically, write_text
from flightmech.support.console import (
    InputFile,
    print_json,
    print_table,
    show_progress,
)
from flightmech.support.input_files import read_toml
from pom.archive.archive import Custody
from pom.cases.case import PomCase, read_case
from pom.cli.actions.report import case_files, read_biases
from pom.diagnosis.tuning.demands import demand_cases, demand_evidence
from pom.diagnosis.tuning.search import tune as search
from pom.diagnosis.tuning.tuning_log import (
    BASES,
    MOVES,
    NUMBERS,
    ROWS,
    log_lines,
    log_rows,
    moves_of,
    outcome_sentence,
    read_log,
)
from pom.judging.beyond_the_bands import flown_model
from pom.replaying.batch import paths_of_cases
from pom.replaying.caches import KeptStates
from pom.replaying.replay_case import plan_of

PARTS = ("tuned.nc", "tuned.toml", "tuned.fmu", "tuning.json", "tuning.txt")


RATIONALE = "rationale"


def run_tune(
    ctx: click.Context,
    cases: tuple[Path, ...],
    database: str,
    aircraft: str | None,
    evidence: str | None,
    wanted: tuple[str, ...],
    rationale: tuple[str, ...],
    bound: float,
    output: Path | None,
    fmu: bool,
    log_file: str | None,
    resume: Path | None,
    jobs: int,
    biases_file: str | None,
    as_json: bool,
) -> None:
    """Perform the command ``tune``."""
    if fmu and output is None:
        raise click.UsageError("--fmu needs -o: the folder for the tuned model")

    reasons, written = read_rationales(rationale)
    custody, named = Custody(), case_files(cases)
    custody.take([*named, *filter(None, (database, evidence, written, biases_file))])
    read = [read_case(file) for file in named]
    demand_cases(read, wanted)
    aircraft = aircraft or _aircraft_of(database, read)
    files = dict(zip(BASES, (database, aircraft, evidence, written, biases_file), strict=True))
    for case in read:
        files |= {f"case {case.name}": case.path, f"record of {case.name}": case.record}
    custody.take(filter(None, files.values()))
    model, found = aerodb.open(database), aerodb.open(evidence) if evidence else None
    demand_evidence(model, model if found is None else found, reasons)
    kept = KeptStates(resume.resolve() if resume is not None else None, read_biases(biases_file))
    with show_progress(f"read the flights of {len(read)} case{'s' if len(read) > 1 else ''}"):
        plans = [
            plan_of(case, states)
            for case, states in zip(read, paths_of_cases(read, {}, kept, jobs), strict=True)
        ]
    airplane = read_aircraft(aircraft)
    with show_progress("search the least move"):
        tuning = search(plans, model, airplane, list(wanted) or None, found, reasons, bound, jobs)
    tuned = (
        nodes_digest(compile_model(airplane, tuning.database))
        if tuning.database is not None
        else ""
    )
    custody.check()
    log = tuning.document(
        tuned,
        {
            role: {"name": Path(file).name, "sha256": custody.sha256(file)}
            for role, file in files.items()
            if file
        },
    )
    if output is not None and tuning.database is not None:
        with show_progress("write the tuned model"):
            _write(output, tuning.database, airplane, log, fmu)
    if log_file:
        _write_log(Path(log_file), log)
    if as_json:
        print_json(log)
    else:
        _print(log)
        if output is not None:
            click.echo(
                f"written: {output}"
                if tuning.database is not None
                else f"not written: {output}, the tuning was refused"
            )
        if log_file:
            click.echo(f"written: {log_file}")
    ctx.exit(1 if tuning.refusal else 0)


def read_rationales(words: Iterable[str]) -> tuple[dict[str, str], str | None]:
    """Return the rationales by term of words ``TERM=TEXT`` and of a file, and the file.

    Raises
    ------
    SchemaError
        Two files, one without the table ``[rationale]`` of texts, a term with two rationales; all
        of them.
    """

    found: dict[str, str] = {}
    file: str | None = None
    problems: list[str] = []
    for word in words:
        term, equals, text = word.partition("=")
        if equals:
            given: Mapping[str, Any] = {term.strip(): text.strip()}
        else:
            problems += (
                [f"{word}: {file} is a file of rationales already; write all into one"]
                if file
                else []
            )
            file = str(InputFile().convert(word, None, None))
            content = read_toml(word)
            given = content.get(RATIONALE, {})
            if not isinstance(given, dict) or not given or set(content) != {RATIONALE}:
                problems.append(
                    f"{word}: one table [{RATIONALE}] is needed, with lines such as "
                    f'"Cm/elevator" = "why it may leave the bound"'
                )
                continue
        problems += [f"{term}: has two rationales" for term in given if term in found]
        problems += [
            f"{term}: the rationale is {why!r}; write a text"
            for term, why in given.items()
            if not isinstance(why, str)
        ]
        found |= given
    if problems:
        raise SchemaError("--rationale", problems)
    return found, file


def tuning_logs(files: Mapping[str, Path], runs: Mapping[str, Path]) -> dict[str, dict[str, Any]]:
    """Return the logs by which models were tuned.

    Raises
    ------
    UnknownName
        A log for a model that is not flown.
    SchemaError
        A file that is not a log, or an FMU that does not hold the tables of its log; all of these.
    """

    found, problems = {}, []
    for run, file in files.items():
        if run not in runs:
            raise UnknownName(run, runs, "model", "a tuning is that of a model")
        found[run] = read_log(file)
        model = flown_model(runs[run])
        if model is None or nodes_digest(model) != found[run]["model"]:
            problems.append(
                f"{runs[run]} does not hold the tables that {file} states; write the FMU "
                f"with pom tune --fmu, or from its tuned.nc"
            )
    if problems:
        raise SchemaError("--tuning", problems)
    return found


def _aircraft_of(database: str, cases: Iterable[PomCase]) -> str:
    """Return the aircraft file of a model: the one next to its database, else the one that all
    cases name.
    """
    near = Path(database).with_suffix(".toml")
    if near.is_file():
        return str(near)
    named = {case.aircraft for case in cases}
    if len(named) != 1 or "" in named:
        raise click.UsageError(
            f"no {near}, and the cases do not name one aircraft file; give that of the "
            f"model, --aircraft FILE.toml"
        )
    return named.pop()


def _write(
    folder: Path, database: xr.DataTree, aircraft: Aircraft, log: Mapping[str, Any], fmu: bool
) -> None:
    """Write the tuned model and its log, the whole folder or nothing."""

    folder.parent.mkdir(parents=True, exist_ok=True)
    with folder_written_atomically(
        folder, lambda name: name in PARTS or name.startswith("tuned_")
    ) as new:
        aerodb.save(database, new / "tuned.nc")
        write_aircraft(aircraft, new / "tuned.toml")
        if fmu:
            write_fmu(compile_model(aircraft, database), new / "tuned.fmu")
        _write_log(new / "tuning.json", log)
        (new / "tuning.txt").write_text(
            "\n".join(log_lines(log)) + "\n", encoding="utf-8", newline="\n"
        )


def _write_log(file: Path, log: Mapping[str, Any]) -> None:

    write_text(file, json.dumps(log, indent=1, ensure_ascii=False) + "\n")


def _print(log: Mapping[str, Any]) -> None:
    """Print what moved and what it did, a table each."""

    click.echo(outcome_sentence(log))
    moves, rest = moves_of(log)
    if moves:
        print_table(
            MOVES,
            moves,
            "terms, in standard errors" + (", as it would take" if log["refusal"] else ""),
            NUMBERS,
        )
    if rest:
        click.echo(rest)
    print_table(
        ROWS,
        log_rows(log),
        "cases, ratio to the tolerance" + (", with these moves" if log["refusal"] else ""),
        NUMBERS,
    )
