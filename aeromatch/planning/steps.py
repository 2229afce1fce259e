"""Texts of the steps and products of a match, and the collection of problems."""

from __future__ import annotations

import re
from collections.abc import Callable, Iterable, Mapping, Sequence
from typing import Any, TypeVar

from aerodb.figures.lr743_set.flown import FLOWN
from aeromatch.project.project import Project
from aeromatch.workflow.aerodynamics import WAYS, prior_step
from aeromatch.workflow.outputs import COMPARED, REPORT, replay_step
from flightmech.errors import AeromatchError, SchemaError

Result = TypeVar("Result")


def texts_of(error: Exception) -> list[str]:
    """Return the problems of an error, a line each."""
    if isinstance(error, SchemaError):
        return list(error.problems)
    if isinstance(error, OSError) and error.filename and error.strerror:
        return [f"{error.filename}: {error.strerror}"]
    return [str(error)]


_NAMED = 4  # records or cases that a common line names
_OF_ONE = re.compile(r"(record|case) ([^\s:,]+): (.*)", re.DOTALL)


def join_equal_lines(lines: Iterable[str]) -> list[str]:
    """Return lines with those joined that say the same of several records or cases.

    One wrong key of the name map is a problem of every record.

    Examples
    --------
    >>> join_equal_lines(["record a: no p", "case c: late", "record b: no p"])
    ['records a, b: no p', 'case c: late']
    """
    groups: dict[tuple[str, str], list[str]] = {}
    for line in lines:
        match = _OF_ONE.fullmatch(line)
        kind, name, text = match.groups() if match else ("", "", line)
        names = groups.setdefault((kind, text), [])
        if name not in names:
            names.append(name)
    joined = []
    for (kind, text), names in groups.items():
        if not kind:
            joined.append(text)
        elif len(names) == 1:
            joined.append(f"{kind} {names[0]}: {text}")
        else:
            more = f" and {len(names) - _NAMED} more" if len(names) > _NAMED else ""
            joined.append(f"{kind}s {', '.join(names[:_NAMED])}{more}: {text}")
    return joined


def run_collecting_problems(
    problems: list[str], place: str, act: Callable[..., Result], *items: Any
) -> Result | None:
    """Return ``act(*items)``, or None if it raises an error of the package or of the disk.

    The texts of the error are added to `problems`, after `place` if it is not empty.
    """
    prefix = f"{place}: " if place else ""
    try:
        return act(*items)
    except (AeromatchError, OSError) as error:
        problems += [prefix + text for text in texts_of(error)]
        return None


_REPORT_FILES = (
    "report.html",
    "report.pdf",
    "results.json",
    "results.nc",
    "results.xml",
    "manifest.json",
)
_TABLES = {
    "tabulate": "project local models on the nodes of the tables",
    "direct": "estimate the nodes of the tables from the samples",
    "join": "join local models by regression",
}


def steps_of(project: Project, records: Mapping[str, bool], cases: int, compare: bool) -> list[str]:
    """Return the steps of a match in their order.

    Parameters
    ----------
    project : Project
    records : mapping of str to bool
        Records, and whether each identifies something.
    cases : int
        Number of cases.
    compare : bool
        Whether the tables are made in all ways.
    """
    identifying = sum(records.values())
    models = 3 + len(project.fmus)
    steps = [
        prior_step(project),
        f"read and check {len(records)} flight records",
        f"reconstruct {len(records)} paths; {identifying} records determine the constants of "
        f"the instruments",
    ]
    # The engine precedes the aerodynamics, which require the thrust; ground effect and landing gear
    # follow, because they require the lift.
    if project.engine is not None:
        steps.append("identify the engine")
    if project.controls.sections:
        steps.append(f"identify the control loading of {', '.join(project.controls.sections)}")
    steps.append(
        f"fit {_count_fits(project)} local models, read {len(project.published)} files of "
        f"published ones"
    )
    steps.append(_TABLES[project.tabulation])
    if compare:
        steps.append(f"make the tables in all {len(WAYS)} ways and compare them")
    if project.ground_effect is not None:
        steps.append("identify the ground effect")
    if project.stall is not None:
        steps.append("identify the stall")
    if project.gear is not None:
        steps.append("identify the landing gear")
    steps += [
        f"swap terms on {cases} cases, build the corrected database",
        "write three databases, aircraft and FMUs",
    ]
    if cases:
        steps += [replay_step(cases, models, len(project.devices)), "write the report"]
    return steps


def _count_fits(project: Project) -> int:
    return sum(len(fit.records) * len(fit.models) for fit in project.fit)


def products_of(project: Project, cases: Sequence[Any], compare: bool) -> list[str]:
    """Return the files of a match, relative to its folder."""
    files: list[str] = []
    for name in project.own_models:
        files += [f"{name}.nc", f"{name}.toml", f"{name}.fmu"]
    if project.fit or project.ground_effect is not None or project.stall is not None:
        files.append(FLOWN)
    if compare:
        files.append(COMPARED)
    if cases:
        files += [f"{REPORT}/{name}" for name in _REPORT_FILES]
        files.append(f"{REPORT}/csv/ ({len(cases)} files)")
    return files
