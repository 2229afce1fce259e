"""The data package of a project: models, database in every format, aircraft, roadmap, cases,
report, check cases, manifest.
"""

from __future__ import annotations

import csv
import hashlib
import io
import json
import shutil
import zipfile
from collections.abc import Callable, Sequence
from contextlib import AbstractContextManager
from dataclasses import dataclass
from importlib.metadata import version
from pathlib import Path
from typing import Any

import xarray as xr
from jinja2 import PackageLoader

import aerodb
import flightmech
import pom
from aerodb.edit.ground_effect import with_height_table
from aerodb.exchange.daveml.exporter import export_daveml
from aerodb.exchange.jsbsim.write import export_jsbsim
from aerodb.exchange.tables.csv_checks import export_checkcases
from aerodb.exchange.tables.csv_terms import export_csv
from aerodb.exchange.tables.matlab import export_matlab
from aeromatch.delivery.flown_checks import conditions_of, write_flown_checks
from aeromatch.project.project import Project
from aeromatch.workflow.steps import REPORT
from flightmech.aircraft.aircraft import Aircraft
from flightmech.errors import AeromatchError, SchemaError
from flightmech.names import lookup
from flightmech.support.atomic_write import folder_written_atomically, written_atomically
from flightmech.support.figures import make_template_environment
from flightmech.terms import power_factor

MANIFEST = "manifest.json"
MODELS = ("datcom", "corrected", "final")
FLOWN, STATES = "check_cases/flown", "check_cases/states.csv"
# [m] to which tables replace formulas of the ground effect, in formats that take tables only
_HIGHEST = 1000.0
_STATES = 200  # check cases of the database
_INSIDE = "data_package"  # folder in a zip
_EPOCH = (1980, 1, 1, 0, 0, 0)  # of every file in a zip: the same bytes when made again

Step = Callable[[str], AbstractContextManager[None]]


@dataclass(frozen=True)
class PackageOptions:
    """What the customer gets besides models, database and report.

    Attributes
    ----------
    recordings : bool
        The recordings themselves; without it their SHA-256 only.
    licence : Path or None
        Text of the licence; without it the package states that none is given.
    revision : str
        Of the package.
    """

    recordings: bool = False
    licence: Path | None = None
    revision: str = ""


def write_package(
    project: Project, match: Path, target: Path, wishes: PackageOptions, step: Step
) -> dict[str, str]:
    """Write the data package of a matched project.

    Parameters
    ----------
    project : Project
    match : Path
        Folder of `aeromatch match`: databases, aircraft, FMUs, report.
    target : Path
        Folder to write, or a file ``.zip``; written completely or not at all, the same bytes when
        made again.
    wishes : Wishes
    step : callable
        ``with step("text"):`` surrounds every step.

    Returns
    -------
    dict of str to str
        What is not in it and why, by file.

    Raises
    ------
    SchemaError
        The folder is not that of a finished match.
    """
    wanted = [match / f"final.{kind}" for kind in ("nc", "toml", "fmu")] + [
        match / REPORT / "manifest.json"
    ]
    if missing := [str(file.relative_to(match)) for file in wanted if not file.is_file()]:
        raise SchemaError(
            str(match),
            [f"no {name}; give the folder that `aeromatch match` wrote" for name in missing],
        )
    if target.suffix.lower() != ".zip":
        with folder_written_atomically(target, lambda name: True) as new:
            return _fill(new, project, match, wishes, step)
    with written_atomically(target) as part:
        folder = part.with_name(part.name + ".d")
        try:
            folder.mkdir()
            found = _fill(folder, project, match, wishes, step)
            with step("pack"):
                _pack(folder, part)
        finally:
            shutil.rmtree(folder, ignore_errors=True)
    return found


def _fill(
    folder: Path, project: Project, match: Path, wishes: PackageOptions, step: Step
) -> dict[str, str]:
    database, aircraft = (
        aerodb.open(match / "final.nc"),
        flightmech.read_aircraft(match / "final.toml"),
    )
    archive = pom.read_archive(match / REPORT)
    with step("copy models, aircraft, cases and report"):
        _copy(folder, project, match, wishes)
    with step("write the database in every format"):
        refused = _database(folder / "database", database, aircraft)
    with step("write the check cases"):
        export_checkcases(database, _made(folder / STATES), _STATES)
        (folder / FLOWN).mkdir(parents=True)
        flown = write_flown_checks(
            database, aircraft, conditions_of(archive.results), folder / FLOWN
        )
    if not flown:
        refused[FLOWN] = "no case starts from a trimmed flight in the air"
    _write(folder / "roadmap.csv", format_roadmap(archive.results))
    _write(folder / "recordings.csv", _recordings(project, archive.results))
    about = {
        "title": project.title,
        "revision": wishes.revision,
        "version": version("aeromatch"),
        "results": [
            (r.case.id, r.case.title, [(run, r.status(run)) for run in r.runs])
            for r in archive.results
        ],
        "refused": refused,
        "flown": [file.name for file in flown],
        "recordings": wishes.recordings,
        "platforms": list_fmu_platforms(match / "final.fmu"),
        "licence": wishes.licence is not None,
    }
    pages = make_template_environment(PackageLoader("aeromatch.delivery", "."))
    _write(folder / "README.md", pages.get_template("README.md.j2").render(about))
    licence = (
        wishes.licence.read_text(encoding="utf-8")
        if wishes.licence
        else pages.get_template("LICENCE.md.j2").render(about)
    )
    _write(folder / "LICENCE.md", licence)
    _write(folder / MANIFEST, manifest_text(folder, about | {"results": None}))
    return refused


def _copy(folder: Path, project: Project, match: Path, wishes: PackageOptions) -> None:
    for name in MODELS:
        for file in sorted(match.glob(f"{name}*")):
            kind = {
                ".fmu": "models",
                ".toml": "aircraft",
                ".nc": "database" if file.stem == name else "aircraft",
            }.get(file.suffix)
            if kind:
                shutil.copyfile(file, _made(folder / kind / file.name))
    for file in project.cases:
        shutil.copyfile(file, _made(folder / "cases" / file.name))
    for file in sorted(item for item in (match / REPORT).rglob("*") if item.is_file()):
        shutil.copyfile(file, _made(folder / "report" / file.relative_to(match / REPORT)))
    if wishes.recordings:
        for file in project.flights.values():
            shutil.copyfile(file, _made(folder / "recordings" / file.name))


def _database(folder: Path, database: xr.DataTree, aircraft: Aircraft) -> dict[str, str]:
    """Write the final database in the formats of other programs, and return why some are not there."""
    tables = _with_height_tables(database)
    writers: dict[str, Callable[[Path], None]] = {
        "final.mat": lambda path: export_matlab(database, path),
        "final_csv": lambda path: export_csv(database, path),
        "final.dml": lambda path: export_daveml(tables, path, aircraft, _STATES),
        "final_jsbsim.xml": lambda path: export_jsbsim(tables, path, aircraft),
    }
    refused = {}
    for name, write in writers.items():
        try:
            write(_made(folder / name))
        except (
            AeromatchError
        ) as error:  # one format cannot hold this database: the package states it
            refused[f"database/{name}"] = "; ".join(getattr(error, "problems", ()) or [str(error)])
    return refused


def _with_height_tables(database: xr.DataTree) -> xr.DataTree:
    leaves = aerodb.terms(database)
    closed = [
        name
        for name, leaf in leaves.items()
        if (factor := power_factor(leaf)) is not None and lookup(factor.variable).units == "m"
    ]
    return aerodb.replace_terms(
        database,
        {name: with_height_table(leaves[name], _HIGHEST) for name in closed},
        "tables for formulas over the height",
    )


def format_roadmap(results: Sequence[Any]) -> str:
    """Return the validation data roadmap as CSV: row of the standard, record that proves it,
    configuration, verdicts.
    """
    runs = list(dict.fromkeys(run for result in results for run in result.runs))
    target = io.StringIO()
    rows = csv.writer(target, lineterminator="\n")
    columns = (
        "row",
        "title",
        "standard",
        "edition",
        "case",
        "record",
        "start [s]",
        "end [s]",
        "configuration",
        "mass [kg]",
        "h [m]",
        "V [m/s]",
    )
    rows.writerow(
        [*columns, *(f"{run}: verdict" for run in runs), *(f"{run}: worst ratio" for run in runs)]
    )
    for result in results:
        case, at = result.case, dict(result.conditions)
        worst = {run: result.worst(run) for run in result.runs}
        rows.writerow(
            [
                *(
                    case.id,
                    case.title,
                    case.standard,
                    case.edition,
                    case.name,
                    Path(case.record).name,
                    *(f"{t:g}" for t in case.window),
                ),
                f"flaps {at.get('delta_f', 0.0) * 57.29577951308232:.1f} deg; gear "
                f"{'down' if at.get('gear', 0.0) > 0.5 else 'up'}",
                *(f"{at[name]:.1f}" if name in at else "" for name in ("mass", "h", "V")),
                *(result.status(run) if run in result.runs else "" for run in runs),
                *(
                    f"{found['worst_ratio']:.3f}" if (found := worst.get(run)) else ""
                    for run in runs
                ),
            ]
        )
    return target.getvalue()


def _recordings(project: Project, results: Sequence[Any]) -> str:
    proved = {Path(result.case.record).stem: result.case.name for result in results}
    lines = ["file,sha256,proves"]
    lines += [
        f"{file.name},{file_sha256(file)},{proved.get(name, '')}"
        for name, file in project.flights.items()
    ]
    return "\n".join([*lines, ""])


def list_fmu_platforms(fmu: Path) -> list[str]:
    """Return the platforms that an FMU brings a library for."""
    with zipfile.ZipFile(fmu) as content:
        return sorted(
            {
                name.split("/")[1]
                for name in content.namelist()
                if name.startswith("binaries/") and name.count("/") > 1
            }
        )


def manifest_text(folder: Path, about: dict[str, Any]) -> str:
    """Return the manifest of a folder: every file with its SHA-256, but for the manifest itself."""
    files = {
        file.relative_to(folder).as_posix(): file_sha256(file)
        for file in sorted(folder.rglob("*"))
        if file.is_file()
    }
    files.pop(MANIFEST, None)
    head = {
        key: item
        for key, item in about.items()
        if key in ("title", "revision", "version", "refused", "platforms")
    }
    return (
        json.dumps(
            {"content": "aeromatch data package, format 1", **head, "files": files},
            indent=1,
            sort_keys=True,
            ensure_ascii=False,
        )
        + "\n"
    )


def file_sha256(file: Path) -> str:
    """Return the SHA-256 of a file."""
    with file.open("rb") as content:
        return hashlib.file_digest(content, "sha256").hexdigest()


def _pack(folder: Path, target: Path) -> None:
    with zipfile.ZipFile(target, "w", zipfile.ZIP_DEFLATED, compresslevel=6) as content:
        for file in sorted(item for item in folder.rglob("*") if item.is_file()):
            entry = zipfile.ZipInfo(f"{_INSIDE}/{file.relative_to(folder).as_posix()}", _EPOCH)
            entry.compress_type, entry.external_attr = zipfile.ZIP_DEFLATED, 0o644 << 16
            content.writestr(entry, file.read_bytes())


def _made(path: Path) -> Path:
    path.parent.mkdir(parents=True, exist_ok=True)
    return path


def _write(path: Path, text: str) -> None:
    _made(path).write_text(text, encoding="utf-8", newline="\n")
