"""Steps and products of a match, in words."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping, Sequence
from typing import Any, TypeVar

from aeromatch.project.project import Project
from aeromatch.workflow.steps import COMPARED, FLOWN, REPORT, WAYS
from flightmech.errors import AeromatchError, SchemaError

Result = TypeVar("Result")


def texts_of(error: Exception) -> list[str]:
    """Return the problems of an error, a line each."""
    if isinstance(error, SchemaError):
        return list(error.problems)
    if isinstance(error, OSError) and error.filename and error.strerror:
        return [f"{error.filename}: {error.strerror}"]
    return [str(error)]


def run_collecting_problems(
    problems: list[str], place: str, act: Callable[..., Result], *items: Any
) -> Result | None:
    """Return ``act(*items)``; None if it raises an error of the package or of the disk, whose texts
    are added to `problems`.
    """
    try:
        return act(*items)
    except (AeromatchError, OSError) as error:
        problems += [f"{place}: {text}" if place else text for text in texts_of(error)]
        return None


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
    models = 3 + len(project.models)
    steps = [
        f"read {sum(map(len, project.listings.values()))} DATCOM listings, build the "
        f"a-priori database",
        f"read and check {len(records)} flight records",
        f"reconstruct {len(records)} paths; {identifying} records determine the constants of "
        f"the instruments",
    ]
    steps += ["identify the engine"] if project.engine is not None else []
    steps += (
        [f"identify the control loading of {', '.join(project.controls)}"]
        if project.controls
        else []
    )
    steps += [
        f"fit {_count_fits(project)} local models, read {len(project.published)} files of "
        f"published ones"
    ]
    steps += [_TABLES[project.tabulation]]
    steps += [f"make the tables in all {len(WAYS)} ways and compare them"] if compare else []
    steps += ["identify the ground effect"] if project.ground_effect is not None else []
    steps += ["identify the landing gear"] if project.gear is not None else []
    steps += [
        f"swap terms on {cases} cases, build the corrected database",
        "write three databases, aircraft and FMUs",
        f"replay {cases} cases by {models} FMUs",
        "write the report",
    ]
    return steps


def _count_fits(project: Project) -> int:
    return sum(len(fit.records) * len(fit.models) for fit in project.fits)


def products_of(project: Project, cases: Sequence[Any], compare: bool) -> list[str]:
    """Return the files of a match, relative to its folder."""
    names = ("datcom", "corrected", "final")
    files = [f"{name}{ending}" for name in names for ending in (".nc", ".toml", ".fmu")]
    files += [FLOWN, *([COMPARED] if compare else [])]
    report = (
        "report.html",
        "report.pdf",
        "results.json",
        "results.nc",
        "results.xml",
        "manifest.json",
    )
    return [*files, *_inside(REPORT, report), f"{REPORT}/csv/ ({len(cases)} files)"]


def _inside(folder: str, names: Iterable[str]) -> list[str]:
    return [f"{folder}/{name}" for name in names]
