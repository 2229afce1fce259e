"""Functions that perform the commands of `pom.cli.diagnose`."""

from __future__ import annotations

import math
from collections import Counter
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import click
import numpy as np
import pandas as pd
import xarray as xr

import aerodb
from flightmech.aircraft.aircraft import Aircraft
from flightmech.aircraft.aircraft_file import read_aircraft
from flightmech.aircraft.writing import write_aircraft
from flightmech.errors import SchemaError
from flightmech.support.console import (
    collect_options,
    count_text,
    print_json,
    print_table,
    show_progress,
)
from flightmech.support.input_files import file_sha256
from pom.cases.case import PomCase, read_case
from pom.cases.reference_states import recorded_states
from pom.checking.batch_check import check_batch
from pom.cli.actions.evidence import open_evidence
from pom.cli.actions.report import case_files, print_record_errors, read_biases
from pom.diagnosis.corrected_model import corrected_aircraft, corrected_database, joint_terms
from pom.diagnosis.culprits.project_ranking import (
    CAPTION,
    COLUMNS,
    ProjectRanking,
    rank_project,
)
from pom.diagnosis.joint_correction import rank_all, swap_models
from pom.diagnosis.joint_search import join_tables
from pom.diagnosis.swap_judgement import LEAST_GAP
from pom.diagnosis.term_swaps import differing_terms
from pom.diagnosis.waterfall_steps import criteria_of
from pom.report.models.diagnosis import cause_sentences

_IDLE = 0.005  # share of the gap: swaps that change less are not printed
_INTERACTING = 5  # number of printed pairs


@dataclass(frozen=True)
class DiagnosedModels:
    """Files of the models between which terms are swapped, by the names of `pom.cli.diagnose`.

    Attributes
    ----------
    prior, final : str
        A-priori database, and database with identified terms.
    apriori : str or None
        Aircraft of the a-priori model, if it has other parts than the identified one.
    evidence : str or None
        Identified database with standard errors; None for `final`.
    """

    prior: str
    final: str
    apriori: str | None
    evidence: str | None


@dataclass(frozen=True)
class SwapOptions:
    """Options of the swaps of terms, by the names of `pom.cli.diagnose`.

    Attributes
    ----------
    groups : tuple of str
        ``NAME=TERM,TERM`` of terms that are swapped together.
    players : int
        Least number of terms with a Shapley share.
    replays : int
        Largest number of replays for the shares.
    seed : int
        Seed of the sampled shares.
    """

    groups: tuple[str, ...]
    players: int
    replays: int
    seed: int

    def keywords(self) -> dict[str, Any]:
        """Return the keywords of `rank_all`."""
        return {
            "groups": _parse_groups(self.groups),
            "players": self.players,
            "replays": self.replays,
            "seed": self.seed,
        }


@collect_options(files=DiagnosedModels, swaps=SwapOptions)
def run_diagnose(
    cases: tuple[Path, ...],
    files: DiagnosedModels,
    swaps: SwapOptions,
    output: str | None,
    aircraft_output: str | None,
    biases_file: str | None,
    jobs: int,
    as_json: bool,
) -> None:
    """Perform the command ``diagnose``."""
    if aircraft_output and not files.apriori:
        raise click.UsageError(
            "--aircraft-output needs --apriori: the aircraft file that is to be corrected"
        )
    settings = swaps.keywords()
    before, after = aerodb.open(files.prior), aerodb.open(files.final)
    estimates = open_evidence(files.evidence) if files.evidence else after
    old = read_aircraft(files.apriori) if files.apriori else None
    biases, read = read_biases(biases_file), _read_cases(cases)
    with show_progress("check the cases and their records"):
        checks = check_batch(read, None, jobs=jobs)
    print_record_errors(checks)
    aircraft = {case.aircraft: read_aircraft(case.aircraft) for case in read}
    by_case = {case.name: aircraft[case.aircraft] for case in read}
    models = swap_models(before, after, by_case, old)
    with show_progress(f"swap terms on {count_text(len(read), 'case')}"):
        paths = {case.name: recorded_states(case, biases) for case in read}
        ranked = rank_all(read, models, paths, jobs=jobs, **settings)
    benches = {name: bench for name, (bench, _) in ranked.items()}
    tables = {name: table for name, (_, table) in ranked.items()}
    # the tables of single cases come before the slower joint search
    if not as_json:
        for case in read:
            _print_swaps(case, tables[case.name])
    with show_progress("rank the terms over all cases"):
        ranking = rank_project(benches, estimates, jobs)
    if not as_json:
        _print_ranking(ranking)
    if output or aircraft_output:
        with show_progress("join what the cases need"):
            tables = join_tables(tables, benches, jobs)
        if not as_json:
            _print_joint_terms(tables)
    lines = []
    if output:
        lines.append(_write_database(output, before, after, final=files.final, tables=tables))
    if aircraft_output and old is not None:
        _write_aircraft(aircraft_output, old, aircraft, tables=tables)
        lines.append(f"written: {aircraft_output}")
    if as_json:
        _print_rows_as_json(tables, ranking)
        return
    for line in lines:
        click.echo(line)


def _print_rows_as_json(tables: Mapping[str, pd.DataFrame], ranking: ProjectRanking) -> None:
    """Print the rows of all cases; rows over all cases have an empty ``case``."""
    rows = []
    for name, table in tables.items():
        rows += [{"case": name, **row} for row in table.to_dict("records")]
    for stage, table in (("culprit", ranking.culprits), ("correction", ranking.corrections)):
        joint = table.rename(columns={"case": "largest in"})
        rows += [{"case": "", "stage": stage, **row} for row in joint.to_dict("records")]
    print_json(rows)


def _print_ranking(ranking: ProjectRanking) -> None:
    """Print the terms of the sequence of corrections, with the state after each of them."""
    columns = list(COLUMNS)
    rows = [list(row) for row in ranking.rows()]
    print_table(columns, rows, CAPTION, right=[columns[1], *columns[3:]])
    for sentence in ranking.sentences:
        click.echo(sentence)


def _read_cases(paths: tuple[Path, ...]) -> list[PomCase]:
    """Read the cases; raise if the kernel cannot replay one of them."""
    cases = [read_case(file) for file in case_files(paths)]
    missing, controlled = [], []
    for case in cases:
        if not case.aircraft:
            missing.append(
                f"{case.path}: case.aircraft: missing; the kernel flies an aircraft, give its file"
            )
        if case.law:
            controlled.append(
                f"{case.path}: control_law: the kernel flies no FMU of a control law; leave the "
                f"case out"
            )
    # the tables of the diagnosis are stored by the name of the case
    counts = Counter(case.name for case in cases)
    repeated = [f"case name {name!r} is given twice" for name, count in counts.items() if count > 1]
    problems = [*missing, *controlled, *repeated]
    if problems:
        raise SchemaError("cases to diagnose", problems)
    return cases


def _parse_groups(texts: tuple[str, ...]) -> dict[str, list[str]]:
    """Return the terms of each group of ``--group NAME=TERM,TERM``."""
    groups: dict[str, list[str]] = {}
    for text in texts:
        name, equals, members = text.partition("=")
        terms = [term.strip() for term in members.split(",") if term.strip()]
        if not equals or not name.strip() or not terms:
            raise click.UsageError(
                f"--group {text!r}: expected NAME=TERM,TERM such as ground=CL/ground,Cm/ground"
            )
        groups[name.strip()] = terms
    return groups


def _write_database(
    output: str,
    before: xr.DataTree,
    after: xr.DataTree,
    *,
    final: str,
    tables: dict[str, pd.DataFrame],
) -> str:
    """Write the corrected database, and return a line on it."""
    corrected = corrected_database(before, after, tables, _source(final))
    aerodb.save(corrected, output)
    terms = " ".join(differing_terms(before, corrected)) or "no term"
    return f"written: {output}, with {terms} of {final}"


def _write_aircraft(
    output: str, old: Aircraft, new: dict[str, Aircraft], *, tables: dict[str, pd.DataFrame]
) -> None:
    """Write the corrected aircraft file."""
    if len(new) > 1:
        problem = (
            f"the cases name {len(new)} aircraft files ({', '.join(new)}); diagnose them one by one"
        )
        raise SchemaError("corrected aircraft", [problem])
    ((file, aircraft),) = new.items()
    write_aircraft(corrected_aircraft(old, aircraft, tables, _source(file)), output)


def _source(file: str) -> str:
    """Return the text of a file in a history: its name and the first half of its digest."""
    return f"{Path(file).name} (SHA-256 {file_sha256(file)[:32]})"


def _print_swaps(case: PomCase, ranked: pd.DataFrame) -> None:
    """Print the table of a case, without the swaps and pairs that change little."""
    criteria = criteria_of(ranked)
    # Alone, an idle swap explains nothing; without it, the others still explain all.
    idle = ranked["stage"].isin(["single", "group"]) & (ranked["explained"].abs() < _IDLE)
    idle |= (ranked["stage"] == "without") & ((ranked["explained"] - 1.0).abs() < _IDLE)
    unit = f"{_IDLE:g} of the gap"
    if ranked["explained"].isna().all():
        # Without a gap there are no shares: the change of the mismatch counts.
        mismatch = ranked["mismatch"].to_numpy(float)
        is_felt = np.abs(mismatch - mismatch[0]) >= LEAST_GAP
        idle = ranked["stage"].isin(["single", "group"]) & ~is_felt
        unit = f"{LEAST_GAP:g} half widths"
    pairs = ranked[ranked["stage"] == "pair"]
    strongest = pairs["interaction"].abs().nlargest(_INTERACTING).index
    weak_pairs = pairs.index.difference(strongest)
    columns = ["stage", "term", "explained", "verdict", "interaction", "correlation"]
    for name in criteria:
        columns += [f"{name} explained", f"{name} ratio"]
    # stage `idle`: terms with a bound so small that the kernel did not replay them
    not_replayed = ranked["stage"] == "idle"
    printed = ranked[~idle & ~not_replayed].drop(weak_pairs)
    rows = [_cells(row, criteria) for row in printed.to_dict("records")]
    print_table(columns, rows, f"{case.id}  {case.title}", right=[columns[2], *columns[4:]])
    click.echo(cause_sentences(ranked))
    if not_replayed.any():
        # the first row is the bound of all these terms together
        joint, *single = ranked.loc[not_replayed, "bound"]
        click.echo(
            f"{len(single)} terms not flown alone: each moves the judged outputs by less than "
            f"{100.0 * max(single):.2g} % of their mismatch, all together by "
            f"{100.0 * joint:.2g} %; --json has them all"
        )
    if idle.any():
        text = f"{int(idle.sum())} swaps that change less than {unit}"
        if len(weak_pairs):
            text += f" and {len(weak_pairs)} pairs that interact less"
        click.echo(f"{text} are left out; --json has them all\n")


def _print_joint_terms(tables: dict[str, pd.DataFrame]) -> None:
    for name, terms in joint_terms(tables).items():
        click.echo(
            f"added for {name}, which does not pass with only the terms that the cases need one "
            f"by one: {', '.join(terms)}"
        )


def _cells(row: dict[Any, Any], criteria: list[str]) -> list[str]:
    """Return the cells of a swap; a Shapley share has no verdict and no ratio."""
    is_share = row["stage"] == "share"
    cells = [
        row["stage"],
        row["term"],
        _percent(row["explained"], row["stderr"]),
        "" if is_share else row["verdict"],
        _percent(row["interaction"]),
        "" if math.isnan(row["correlation"]) else f"{row['correlation']:.2f}",
    ]
    for name in criteria:
        ratio = "" if is_share else f"{row[f'{name} ratio']:.2f}"
        cells += [_percent(row[f"{name} explained"], row[f"{name} stderr"]), ratio]
    return cells


def _percent(share: float, stderr: float = 0.0) -> str:
    """Return a share in percent with its standard error; empty for NaN."""
    if math.isnan(share):
        return ""
    error = f" +- {100.0 * stderr:.0f}" if stderr > 0.0 else ""
    return f"{100.0 * share:z.0f}{error} %"
