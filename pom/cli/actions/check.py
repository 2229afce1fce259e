"""Function that performs the command ``check`` of `pom.cli.group`."""

from __future__ import annotations

import warnings
from pathlib import Path

from flightmech.errors import AeromatchError, AeromatchWarning, SchemaError
from flightmech.quantities import time_text
from flightmech.support.console import count_text, print_json, print_table, show_progress
from pom.cases.case import PomCase, read_case
from pom.cases.fact_agreement import contradictions
from pom.cases.own_table import demand_use
from pom.cases.reference_states import join_channels, record_leaves, window_problem
from pom.cli.actions.report import case_files
from pom.fmu.description import demand_platform, read_fmu_interface
from pom.judging.applicability import reason_not_judged
from pom.judging.departures import size_departures
from pom.judging.window_checks import MOTION, check_window
from pom.tolerances.own_tables import read_own_table


def check_cases(cases: tuple[Path, ...], tolerances_file: str | None, as_json: bool) -> None:
    """Perform the command ``check``."""
    table = read_own_table(tolerances_file) if tolerances_file else None
    checked: list[PomCase] = []
    problems: list[str] = []
    departures: list[str] = []
    files = case_files(cases)
    with show_progress(f"read {count_text(len(files), 'case')} and their records"):
        for file in files:
            try:
                case = read_case(file, table)
            except AeromatchError as error:
                problems.append(str(error))
                continue
            checked.append(case)
            found, departing = _check_record(case)
            problems += found
            departures += [f"case {case.name}: {text}" for text in size_departures(case)]
            departures += departing
    problems += contradictions(checked)
    if not problems:
        demand_use(table, [case.tolerances for case in checked])
    for text in departures:
        warnings.warn(text, AeromatchWarning, stacklevel=2)
    # one case is an object, several cases are an array
    if as_json and not problems:
        documents = [case.to_dict() for case in checked]
        print_json(documents if len(documents) > 1 else documents[0])
        return
    if not as_json:
        for case in checked:
            _print_criteria(case)
    if problems:
        raise SchemaError("cases", problems)


def _check_record(case: PomCase) -> tuple[list[str], list[str]]:
    """Return the problems of a valid case with its record and its control law, and the departures
    of its window.
    """
    problems, departures = [], []
    leaves = record_leaves(case)
    problem = window_problem(case, leaves)
    motion = join_channels(leaves, MOTION)
    if problem:
        problems.append(problem)
    elif motion is not None:
        found = check_window(case, motion)
        departures += [f"case {case.name}: {text}" for text in found.departures]
        departures += [f"case {case.name}: not checked: {text}" for text in found.unchecked]
    # a control law without a library for this machine cannot run
    if case.law:
        try:
            demand_platform(read_fmu_interface(case.law))
        except AeromatchError as error:
            problems.append(f"case {case.path}: control_law: {error}")
    return problems, departures


def _print_criteria(case: PomCase) -> None:
    rows = []
    for criterion in case.criteria:
        row = (
            criterion.name,
            criterion.channel,
            criterion.measure,
            criterion.group,
            criterion.band.text,
            f"{time_text(criterion.window[0])} ... {time_text(criterion.window[1])}",
            reason_not_judged(case, criterion) or criterion.provenance,
        )
        rows.append(row)
    title = f"{case.id}  {case.title}  ({case.standard}, {case.edition_words})"
    columns = ("criterion", "channel", "measure", "group", "tolerance", "window [s]", "remark")
    print_table(columns, rows, title)
