"""Data package of a project: models, database in every format, aircraft, roadmap, cases, report,
check cases, manifest.
"""

from __future__ import annotations

import csv
import io
import json
import shutil
import zipfile
from collections.abc import Callable, Iterable
from contextlib import AbstractContextManager
from dataclasses import dataclass
from importlib.metadata import version
from pathlib import Path
from typing import Any

from jinja2 import PackageLoader

import aerodb
import flightmech
import pom
from aerodb.exchange.tables.csv_checks import export_checkcases
from aeromatch.delivery.flown_checks import flight_conditions_of, write_flown_checks
from aeromatch.delivery.package_documents import (
    compare_model,
    format_roadmap,
    judged_files,
    readme_text,
)
from aeromatch.delivery.package_numbers import export_formats
from aeromatch.delivery.places import (
    CONTENT,
    FLOWN,
    LICENCE,
    MANIFEST,
    README,
    RECORDINGS,
    ROADMAP,
    SIGNATURE,
    STATE_COUNT,
    STATES,
)
from aeromatch.delivery.signing import read_private_key, signature_text
from aeromatch.project.project import Project
from aeromatch.workflow.match_inputs import demand_match_of_project
from aeromatch.workflow.outputs import REPORT
from flightmech.errors import SchemaError
from flightmech.support.atomic_write import folder_written_atomically, written_atomically
from flightmech.support.figures import make_template_environment
from flightmech.support.input_files import file_sha256
from flightmech.support.temporary_names import remove_leftovers, temporary_name

# Folder in a zip.
_FOLDER = "data_package"
# Time stamp of every file in a zip, so that a repetition gives the same bytes.
_EPOCH = (1980, 1, 1, 0, 0, 0)

Step = Callable[[str], AbstractContextManager[None]]


@dataclass(frozen=True)
class PackageOptions:
    """Options of a data package.

    Attributes
    ----------
    recordings : bool
        Whether the package has the recordings, or only their SHA-256.
    licence : Path or None
        Text of the licence. Without it the package states that no licence is given.
    revision : str
        Revision of the package.
    sign : Path or None
        Private key that signs the manifest (`aeromatch.delivery.signing`).
    """

    recordings: bool = False
    licence: Path | None = None
    revision: str = ""
    sign: Path | None = None


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
        Folder to write, or a file ``.zip``. It is written completely or not at all. A repetition
        gives the same bytes.
    wishes : PackageOptions
    step : callable
        ``with step("text"):`` surrounds every step.

    Returns
    -------
    dict of str to str
        Reason for each file that the package lacks.

    Raises
    ------
    SchemaError
        The folder is not the output of a complete match, or a file of the project is not the one
        that the match used.
    """
    problems = []
    if wishes.sign:
        # A wrong key is reported before the work.
        read_private_key(wishes.sign)
    for name in ("final.nc", "final.toml", "final.fmu", f"{REPORT}/manifest.json"):
        if not (match / name).is_file():
            problems.append(
                f"no {name}; give the folder that `aeromatch match` wrote for a project with cases"
            )
    if problems:
        raise SchemaError(str(match), problems)
    if target.suffix.lower() != ".zip":
        with folder_written_atomically(target, lambda name: True) as new:
            return _fill(new, project, match, wishes=wishes, step=step)
    with written_atomically(target) as part:
        # that of a process that was killed here is removed
        remove_leftovers(part.parent, f".{target.name}", "part.d")
        folder = part.with_name(temporary_name(f".{target.name}", "part.d"))
        try:
            folder.mkdir()
            refused = _fill(folder, project, match, wishes=wishes, step=step)
            with step("pack"):
                _pack(folder, part)
        finally:
            shutil.rmtree(folder, ignore_errors=True)
    return refused


def _fill(
    folder: Path, project: Project, match: Path, wishes: PackageOptions, step: Step
) -> dict[str, str]:
    """Write the content of a package into a folder."""
    demand_match_of_project(project, match)
    demand_proven_models(project.own_models, match)
    database = aerodb.open(match / "final.nc")
    aircraft = flightmech.read_aircraft(match / "final.toml")
    archive = pom.read_archive(match / REPORT)
    with step("copy models, aircraft, cases and report"):
        _copy_files(folder, project, match, wishes)
    with step("write the database in every format"):
        refused = export_formats(folder / "database", database, aircraft)
    with step("write the check cases"):
        export_checkcases(database, _make_parent(folder / STATES), STATE_COUNT)
        (folder / FLOWN).mkdir(parents=True)
        flown = write_flown_checks(
            database, aircraft, flight_conditions_of(archive.results), folder / FLOWN
        )
    if not flown:
        refused[FLOWN] = "no case starts from a trimmed flight in the air"
    _write_text(folder / ROADMAP, format_roadmap(archive.results))
    _write_text(folder / RECORDINGS, _recordings_text(project, archive))
    facts = {
        "title": project.title,
        "revision": wishes.revision,
        "version": version("aeromatch"),
        "refused": refused,
        "platforms": list_fmu_platforms(match / "final.fmu"),
    }
    _write_text(folder / README, readme_text(folder, facts, archive.results))
    if wishes.licence:
        licence = wishes.licence.read_text(encoding="utf-8")
    else:
        pages = make_template_environment(PackageLoader("aeromatch.delivery", "."))
        licence = pages.get_template(f"{LICENCE}.j2").render(facts)
    _write_text(folder / LICENCE, licence)
    # The manifest is last, because it has the hashes of all other files.
    manifest = manifest_text(folder, facts)
    _write_text(folder / MANIFEST, manifest)
    if wishes.sign:
        key = read_private_key(wishes.sign)
        _write_text(folder / SIGNATURE, signature_text(manifest.encode(), key))
    return refused


def demand_proven_models(names: Iterable[str], match: Path) -> None:
    """Raise if a model of a match is not the one that its report judged.

    Parameters
    ----------
    names : iterable of str
        Models of the project; one without an FMU in the folder is not compared.
    match : Path
        Folder of `aeromatch match`.

    Raises
    ------
    SchemaError
        FMUs that were replaced, and FMUs whose database or aircraft file was changed after them.
    """
    judged = judged_files(match / REPORT)
    problems = []
    for name in names:
        file = match / f"{name}.fmu"
        if not file.is_file():
            continue
        parts = match / f"{name}.toml", match / f"{name}.nc"
        text, is_proven = compare_model(file, parts, judged, version("aeromatch"))
        if not is_proven:
            problems.append(f"{file.name}: {text} ({parts[0].name}, {parts[1].name})")
    if problems:
        problems.append(
            "a file was changed after the match: run `aeromatch match` again, and give changes of "
            "the database in the project file"
        )
        raise SchemaError(str(match), problems)


def _copy_files(folder: Path, project: Project, match: Path, wishes: PackageOptions) -> None:
    """Copy models, aircraft, databases, cases, report, and the recordings if requested."""
    folders = {".fmu": "models", ".toml": "aircraft", ".nc": "aircraft"}
    for name in project.own_models:
        for file in sorted(match.glob(f"{name}*")):
            if file.name == f"{name}.nc":
                _copy_file(file, folder / "database" / file.name)
            elif file.suffix in folders:
                # Further netCDF files are tables of the aircraft, such as engine decks.
                _copy_file(file, folder / folders[file.suffix] / file.name)
    for file in project.cases:
        _copy_file(file, folder / "cases" / file.name)
    for file in sorted(item for item in (match / REPORT).rglob("*") if item.is_file()):
        _copy_file(file, folder / "report" / file.relative_to(match / REPORT))
    if wishes.recordings:
        for file in project.flights.values():
            _copy_file(file, folder / "recordings" / file.name)


def _copy_file(source: Path, target: Path) -> None:
    shutil.copyfile(source, _make_parent(target))


def _recordings_text(project: Project, archive: Any) -> str:
    """Return the list of the recordings as CSV: what each identifies, and the cases it proves."""
    proves: dict[str, list[str]] = {}
    for result in archive.results:
        proves.setdefault(Path(result.case.record).stem, []).append(result.case.name)
    identifies: dict[str, list[str]] = {}
    for part, names in archive.provenance.get("records", {}).items():
        if part.startswith("case "):
            continue
        for name in filter(None, names.split(", ")):
            identifies.setdefault(name, []).append(part)
    target = io.StringIO()
    rows = csv.writer(target, lineterminator="\n")
    rows.writerow(("file", "sha256", "proves", "identifies"))
    for name, file in project.flights.items():
        used = ["; ".join(table.get(name, ())) for table in (proves, identifies)]
        rows.writerow((file.name, file_sha256(file), *used))
    return target.getvalue()


def list_fmu_platforms(fmu: Path) -> list[str]:
    """Return the platforms for which an FMU has a library."""
    platforms = set()
    with zipfile.ZipFile(fmu) as content:
        for name in content.namelist():
            # FMI 2 and 3: binaries/PLATFORM/LIBRARY
            if name.startswith("binaries/") and name.count("/") > 1:
                platforms.add(name.split("/")[1])
    return sorted(platforms)


def manifest_text(folder: Path, about: dict[str, Any]) -> str:
    """Return the manifest of a folder: the SHA-256 of every file except the manifest itself."""
    files: dict[str, str] = {}
    for file in sorted(folder.rglob("*")):
        name = file.relative_to(folder).as_posix()
        if file.is_file() and name not in (MANIFEST, SIGNATURE):
            files[name] = file_sha256(file)
    keys = ("title", "revision", "version", "refused", "platforms")
    content = {"content": CONTENT, "files": files}
    content |= {key: about[key] for key in keys if key in about}
    return json.dumps(content, indent=1, sort_keys=True, ensure_ascii=False) + "\n"


def _pack(folder: Path, target: Path) -> None:
    """Write a folder into a zip with fixed order, time stamps and permissions."""
    with zipfile.ZipFile(target, "w", zipfile.ZIP_DEFLATED, compresslevel=6) as content:
        for file in sorted(item for item in folder.rglob("*") if item.is_file()):
            entry = zipfile.ZipInfo(f"{_FOLDER}/{file.relative_to(folder).as_posix()}", _EPOCH)
            entry.compress_type = zipfile.ZIP_DEFLATED
            # rw-r--r-- in the Unix part of the attributes
            entry.external_attr = 0o644 << 16
            content.writestr(entry, file.read_bytes())


def _make_parent(path: Path) -> Path:
    path.parent.mkdir(parents=True, exist_ok=True)
    return path


def _write_text(path: Path, text: str) -> None:
    _make_parent(path).write_text(text, encoding="utf-8", newline="\n")
