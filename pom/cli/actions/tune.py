"""Functions that perform the commands of `pom.cli.tune`."""

from __future__ import annotations

import json
from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import click
import xarray as xr

import aerodb
from flightmech.aircraft.aircraft import Aircraft
from flightmech.aircraft.aircraft_file import read_aircraft
from flightmech.aircraft.writing import write_aircraft
from flightmech.errors import SchemaError, UnknownName
from flightmech.fmu_export.fmu_file import write_fmu
from flightmech.simulation.compiler import compile as compile_model
from flightmech.simulation.compiler import compile_with_envelope
from flightmech.simulation.node_values import nodes_digest
from flightmech.support.atomic_write import folder_written_atomically, write_text
from flightmech.support.console import (
    InputFile,
    collect_options,
    count_text,
    print_json,
    print_table,
    show_progress,
)
from flightmech.support.toml_files import read_toml
from pom.archive.archive import Custody
from pom.cases.case import PomCase, read_case
from pom.cli.actions.evidence import open_evidence
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
from pom.replaying.batch_plans import paths_of_cases
from pom.replaying.caches import KeptStates
from pom.replaying.replay_case import ReplayPlan, plan_of

PARTS = ("tuned.nc", "tuned.toml", "tuned.fmu", "tuning.json", "tuning.txt")
RATIONALE = "rationale"


@dataclass(frozen=True)
class TuningInputs:
    """Input files of a tuning but for its cases, by the names of `pom.cli.tune`.

    Attributes
    ----------
    database : str
        Database of the model.
    aircraft : str or None
        Aircraft of the model; None for the file next to the database, or that of the cases.
    evidence : str or None
        Identified database with standard errors; None for the database of the model.
    rationale : tuple of str
        ``TERM=TEXT``, or a file with such lines.
    biases_file : str or None
        Instrument constants.
    """

    database: str
    aircraft: str | None
    evidence: str | None
    rationale: tuple[str, ...]
    biases_file: str | None


@dataclass(frozen=True)
class TuningOutputs:
    """Output files of a tuning, by the names of `pom.cli.tune`.

    Attributes
    ----------
    output : Path or None
        Folder of the tuned model.
    fmu : bool
        Whether the folder gets an FMU.
    log_file : str or None
        Log, which is also written if the tuning is refused.
    """

    output: Path | None
    fmu: bool
    log_file: str | None

    def check(self) -> None:
        """Raise UsageError for an FMU without a folder."""
        if self.fmu and self.output is None:
            raise click.UsageError("--fmu needs -o: the folder for the tuned model")


@collect_options(inputs=TuningInputs, outputs=TuningOutputs)
def run_tune(
    ctx: click.Context,
    cases: tuple[Path, ...],
    inputs: TuningInputs,
    wanted: tuple[str, ...],
    bound: float,
    outputs: TuningOutputs,
    resume: Path | None,
    jobs: int,
    as_json: bool,
) -> None:
    """Perform the command ``tune``."""
    outputs.check()
    database, evidence, biases = inputs.database, inputs.evidence, inputs.biases_file
    reasons, reasons_file = read_rationales(inputs.rationale)
    # Every file is hashed before it is read, so that the hash belongs to the results.
    custody, paths = Custody(), case_files(cases)
    custody.take([*paths, *filter(None, (database, evidence, reasons_file, biases))])
    read = [read_case(path) for path in paths]
    demand_cases(read, wanted)
    aircraft = inputs.aircraft or _aircraft_of(database, read)
    files = _input_files(read, (database, aircraft, evidence, reasons_file, biases))
    custody.take(files.values())
    model = aerodb.open(database)
    estimates = open_evidence(evidence) if evidence else None
    # without evidence, the standard errors of the model itself count
    demand_evidence(model, model if estimates is None else estimates, reasons)
    store = KeptStates(resume.resolve() if resume is not None else None, read_biases(biases))
    plans = _plan_cases(read, store, jobs)
    craft = read_aircraft(aircraft)
    with show_progress("search the least move"):
        tuning = search(
            plans,
            model,
            craft,
            wanted=list(wanted) or None,
            evidence=estimates,
            rationale=reasons,
            bound=bound,
            jobs=jobs,
        )
    digest = _model_digest(craft, tuning.database)
    custody.check()
    log = tuning.document(digest, _file_entries(files, custody))
    if outputs.output is not None and tuning.database is not None:
        _write_model(outputs.output, tuning.database, craft, log=log, fmu=outputs.fmu)
    if outputs.log_file:
        _write_log(Path(outputs.log_file), log)
    if as_json:
        print_json(log)
    else:
        _print_outcome(log, outputs)
    ctx.exit(1 if tuning.refusal else 0)


def _input_files(cases: Iterable[PomCase], bases: Iterable[str | None]) -> dict[str, str]:
    """Return the input files of a tuning by role, without absent ones."""
    files: dict[str, str] = {}
    for role, file in zip(BASES, bases, strict=True):
        if file:
            files[role] = file
    for case in cases:
        files[f"case {case.name}"] = case.path
        files[f"record of {case.name}"] = case.record
    return files


def _file_entries(files: Mapping[str, str], custody: Custody) -> dict[str, dict[str, str]]:
    """Return name and SHA-256 of the input files by role, for the log."""
    entries = {}
    for role, file in files.items():
        entries[role] = {"name": Path(file).name, "sha256": custody.sha256(file)}
    return entries


def _plan_cases(cases: list[PomCase], store: KeptStates, jobs: int) -> list[ReplayPlan]:
    with show_progress(f"read the flights of {count_text(len(cases), 'case')}"):
        paths = paths_of_cases(cases, {}, store, jobs)
        pairs = zip(cases, paths, strict=True)
        return [plan_of(case, states).demand() for case, states in pairs]


def _model_digest(aircraft: Aircraft, database: xr.DataTree | None) -> str:
    """Return the digest of a tuned model; empty if the tuning was refused."""
    # by this digest a report recognises an FMU of the tuned model
    if database is None:
        return ""
    return nodes_digest(compile_model(aircraft, database))


def _print_outcome(log: Mapping[str, Any], outputs: TuningOutputs) -> None:
    """Print the moves, the cases and the written files."""
    _print_log(log)
    if outputs.output is not None and log["refusal"]:
        click.echo(f"not written: {outputs.output}, the tuning was refused")
    elif outputs.output is not None:
        click.echo(f"written: {outputs.output}")
    if outputs.log_file:
        click.echo(f"written: {outputs.log_file}")


def read_rationales(texts: Iterable[str]) -> tuple[dict[str, str], str | None]:
    """Return the rationales by term from ``TERM=TEXT`` and from a file, and the file.

    Raises
    ------
    SchemaError
        With all problems: a second file, a file without the table ``[rationale]`` of texts, a term
        with two rationales.
    """
    rationales: dict[str, str] = {}
    file: str | None = None
    problems: list[str] = []
    for item in texts:
        term, equals, text = item.partition("=")
        if equals:
            entries: Mapping[str, Any] = {term.strip(): text.strip()}
        else:
            # an item without `=` is the name of a file
            if file:
                problems.append(
                    f"{item}: {file} is a file of rationales already; write all into one"
                )
            file = str(InputFile().convert(item, None, None))
            content = read_toml(item)
            entries = content.get(RATIONALE, {})
            if not isinstance(entries, dict) or not entries or set(content) != {RATIONALE}:
                problems.append(
                    f"{item}: one table [{RATIONALE}] is needed, with lines such as "
                    f'"Cm/elevator" = "why it may leave the bound"'
                )
                continue
        problems += [f"{term}: has two rationales" for term in entries if term in rationales]
        for term, reason in entries.items():
            if not isinstance(reason, str):
                problems.append(f"{term}: the rationale is {reason!r}; write a text")
        rationales |= entries
    if problems:
        raise SchemaError("--rationale", problems)
    return rationales, file


def tuning_logs(files: Mapping[str, Path], runs: Mapping[str, Path]) -> dict[str, dict[str, Any]]:
    """Return the logs of tuned models by name of the model.

    Raises
    ------
    UnknownName
        A log is of a model that is not replayed.
    SchemaError
        A file is not a log, or an FMU does not have the tables of its log; with all problems.
    """
    logs, problems = {}, []
    for run, file in files.items():
        if run not in runs:
            raise UnknownName(run, runs, "model", "a tuning is that of a model")
        logs[run] = read_log(file)
        model = flown_model(runs[run])
        if model is None or nodes_digest(model) != logs[run]["model"]:
            problems.append(
                f"{runs[run]} does not hold the tables that {file} states; write the FMU "
                f"with pom tune --fmu, or from its tuned.nc"
            )
    if problems:
        raise SchemaError("--tuning", problems)
    return logs


def _aircraft_of(database: str, cases: Iterable[PomCase]) -> str:
    """Return the aircraft file of a model: next to its database, else the file of all cases."""
    neighbour = Path(database).with_suffix(".toml")
    if neighbour.is_file():
        return str(neighbour)
    names = {case.aircraft for case in cases}
    if len(names) != 1 or "" in names:
        raise click.UsageError(
            f"no {neighbour}, and the cases do not name one aircraft file; give that of the "
            f"model, --aircraft FILE.toml"
        )
    return names.pop()


def _write_model(
    folder: Path, database: xr.DataTree, aircraft: Aircraft, *, log: Mapping[str, Any], fmu: bool
) -> None:
    """Write the tuned model and its log, the complete folder or nothing."""
    folder.parent.mkdir(parents=True, exist_ok=True)
    # files of an earlier tuning may be replaced, other files may not
    with (
        show_progress("write the tuned model"),
        folder_written_atomically(folder, _is_part) as new,
    ):
        aerodb.save(database, new / "tuned.nc")
        write_aircraft(aircraft, new / "tuned.toml")
        if fmu:
            write_fmu(compile_with_envelope(aircraft, database), new / "tuned.fmu")
        _write_log(new / "tuning.json", log)
        text = "\n".join(log_lines(log)) + "\n"
        (new / "tuning.txt").write_text(text, encoding="utf-8", newline="\n")


def _is_part(name: str) -> bool:
    """Return whether a file is one of a tuned model."""
    return name in PARTS or name.startswith("tuned_")


def _write_log(file: Path, log: Mapping[str, Any]) -> None:
    write_text(file, json.dumps(log, indent=1, ensure_ascii=False) + "\n")


def _print_log(log: Mapping[str, Any]) -> None:
    """Print the outcome, a table of the moves and a table of the cases."""
    click.echo(outcome_sentence(log))
    # a refused tuning states the moves that would be necessary
    moves_title, rows_title = "terms, in standard errors", "cases, ratio to the tolerance"
    if log["refusal"]:
        moves_title += ", as it would take"
        rows_title += ", with these moves"
    moves, remark = moves_of(log)
    if moves:
        print_table(MOVES, moves, moves_title, NUMBERS)
    if remark:
        click.echo(remark)
    print_table(ROWS, log_rows(log), rows_title, NUMBERS)
