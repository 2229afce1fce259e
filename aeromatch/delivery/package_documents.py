"""Documents of a data package against its results: README, roadmap, and what its report judged.

A package whose hashes hold can still hold the models of another match next to its report, or a
README with other verdicts. Each file that states results, but for page and PDF of the report, is
therefore written again from the results of the report, and each file that the report hashed is
compared with the one of the package.
"""

from __future__ import annotations

import csv
import io
import math
import zipfile
from collections.abc import Iterable, Iterator, Mapping, Sequence
from importlib.metadata import version
from pathlib import Path, PurePosixPath
from typing import Any

from jinja2 import PackageLoader

import aerodb
import flightmech
from aeromatch.delivery.flown_checks import configuration_text
from aeromatch.delivery.places import FLOWN, README, RECORDINGS, ROADMAP
from flightmech.errors import AeromatchError, UnknownName
from flightmech.fmu_export.fmu_file import BLOCK
from flightmech.simulation.compiler import compile_with_envelope
from flightmech.support.figures import make_template_environment
from flightmech.support.input_files import file_sha256
from pom.archive.archive import Archive
from pom.archive.origins import read_report_manifest
from pom.archive.statements import run_of
from pom.report.case.page import case_keys
from pom.report.case_parts import CSV
from pom.report.exports import case_csv, junit_xml
from pom.report.overview import departure_table
from pom.report.presentation.unit_sets import shown_in
from pom.report.writer import JUNIT
from pom.result import PomResult
from pom.result_notices import departure_remarks, run_notices

_LARGEST_BLOCK = 1_000_000_000  # byte
"""Largest model block of an FMU."""


def readme_text(folder: Path, manifest: Mapping[str, Any], results: Sequence[PomResult]) -> str:
    """Return the README of a package.

    Parameters
    ----------
    folder : Path
        The package, whose other files exist.
    manifest : mapping
        ``title``, ``revision``, ``version``, ``platforms`` and ``refused``.
    results : sequence of PomResult
        Results of its report.
    """
    rows = []
    for result in results:
        statuses = [(run, result.status(run)) for run in result.runs]
        rows.append((result.case.id, result.case.title, statuses))
    keys = [result.case.name for result in results]
    facts = {
        **manifest,
        # the manifest that `compare_documents` reads has sorted keys
        "refused": dict(sorted(manifest["refused"].items())),
        "results": rows,
        "departures": departure_table(keys, results),
        "notices": _notice_lines(results),
        "flown": sorted(file.name for file in (folder / FLOWN).glob("*.csv")),
        "recordings": (folder / "recordings").is_dir(),
    }
    pages = make_template_environment(PackageLoader("aeromatch.delivery", "."))
    return pages.get_template(f"{README}.j2").render(facts)


def _notice_lines(results: Sequence[PomResult]) -> list[tuple[str, str, str]]:
    """Return case, model and text of the notices that are not departures."""
    lines = []
    for result in results:
        for run in result.runs:
            departures = set(departure_remarks(result, run))
            for text in run_notices(result, run):
                if text not in departures:
                    lines.append((result.case.name, run, text))
    return lines


def format_roadmap(results: Sequence[Any]) -> str:
    """Return the validation data roadmap as CSV.

    A line has the row of the standard, the record that proves it, the configuration, and the
    verdicts.
    """
    runs: dict[str, None] = {}
    for result in results:
        runs |= dict.fromkeys(result.runs)
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
        "c.g. [% MAC]",
        "flight condition of the row",
        "source of data",
        *_SOURCE_COLUMNS,
        "departures",
    )
    verdicts = [f"{run}: verdict" for run in runs]
    ratios = [f"{run}: worst ratio" for run in runs]
    rows.writerow([*columns, *verdicts, *ratios])
    for result in results:
        rows.writerow([*_case_cells(result), *_verdict_cells(result, runs)])
    return target.getvalue()


_SOURCES = {
    "flight": "flight test",
    "engineering": "engineering simulator",
    "footprint": "footprint of the device",
}
_SOURCE_COLUMNS = {
    "document": "document",
    "pages": "pages",
    "revision": "revision",
    "date": "date",
    "engine standard": "engine",
    "avionics standard": "avionics",
}
"""By column of the roadmap: key of ``[source]`` of a case."""


def _case_cells(result: Any) -> list[str]:
    """Return the cells of a case in the roadmap: its row, record, window, condition and source."""
    case, condition = result.case, dict(result.conditions)
    cells = [case.id, case.title, case.standard, case.edition, case.name, Path(case.record).name]
    cells += [f"{time:g}" for time in case.window]
    cells.append(configuration_text(condition))
    for name in ("mass", "h", "V"):
        cells.append(f"{condition[name]:.1f}" if name in condition else "")
    cells.append(f"{100.0 * condition['x_cg']:.1f}" if "x_cg" in condition else "")
    cells.append(_row_condition(case))
    cells.append(_SOURCES.get(case.reference, case.reference))
    cells += [case.source.get(key, "") for key in _SOURCE_COLUMNS.values()]
    # what all models share is printed once
    departures: dict[str, None] = {}
    for run in result.runs:
        departures |= dict.fromkeys(departure_remarks(result, run))
    cells.append("; ".join(text.removeprefix("departure: ") for text in departures))
    return cells


def _row_condition(case: Any) -> str:
    """Return the flight condition of the row of a case; empty for a test of another table."""
    try:
        return case.printed_rows()[0]["flight_condition"].replace("_", " ")
    except UnknownName:
        return ""


def _verdict_cells(result: Any, runs: Iterable[str]) -> list[str]:
    """Return the verdicts of all runs, then their worst ratios; empty where there is none."""
    verdicts, ratios = [], []
    for run in runs:
        verdict, ratio = "", math.nan
        if run in result.runs:
            verdict = result.status(run)
            ratio = result.deciding_row(run).get("worst_ratio", math.nan)
        verdicts.append(verdict)
        ratios.append(f"{ratio:.3f}" if math.isfinite(ratio) else "")
    return verdicts + ratios


def compare_documents(
    folder: Path, manifest: Mapping[str, Any], results: Sequence[PomResult]
) -> Iterator[tuple[str, str, bool]]:
    """Yield name, result in words, and whether it is good, of each document of a package.

    Parameters
    ----------
    folder : Path
    manifest : mapping
        Of the package.
    results : sequence of PomResult
        Results of its report.
    """
    texts = {
        README: readme_text(folder, manifest, results),
        ROADMAP: format_roadmap(results),
    }
    for name, text in texts.items():
        yield (name, *_compare_text(folder / name, text, manifest["version"]))
    judged = judged_files(folder / "report")
    for file in sorted((folder / "models").glob("*.fmu")):
        name = file.relative_to(folder).as_posix()
        parts = folder / f"aircraft/{file.stem}.toml", folder / f"database/{file.stem}.nc"
        yield (name, *compare_model(file, parts, judged, manifest["version"]))
    for file in sorted((folder / "cases").glob("*")):
        digests = judged.get(file.name, {})
        is_judged = file_sha256(file) in digests.values()
        text = "as judged" if is_judged else "the report judged no case file with this content"
        yield file.relative_to(folder).as_posix(), text, is_judged
    yield (RECORDINGS, *_compare_recordings(folder, judged))


def compare_exports(
    report: Path, archive: Archive, made_by: str
) -> Iterator[tuple[str, str, bool]]:
    """Yield name, result in words, and whether it is good, of the files of a report that other
    programs read.

    Its page and its PDF are not compared.

    Parameters
    ----------
    report : Path
        The report of a package.
    archive : Archive
        Its results.
    made_by : str
        Version of the program that wrote the report.
    """
    results = archive.results
    texts = {}
    with shown_in(archive.provenance.get("units", "")):
        texts[JUNIT] = junit_xml(results, archive.title)
        for key, result in zip(case_keys(results), results, strict=True):
            texts[f"{CSV}/{key}.csv"] = "".join(case_csv(result))
    for name, text in texts.items():
        yield f"{report.name}/{name}", *_compare_text(report / name, text, made_by)
    for file in sorted((report / CSV).glob("*")):
        name = f"{CSV}/{file.name}"
        if name not in texts:
            yield f"{report.name}/{name}", "the results have no case of this name", False


def _compare_text(file: Path, expected: str, made_by: str) -> tuple[str, bool]:
    """Return the result of comparing a text with the one that this installation writes."""
    if not file.is_file():
        return "missing", False
    found = file.read_bytes()
    if found == expected.encode():
        return "follows from the results of the report", True
    installed = version("aeromatch")
    if made_by == installed:
        return "does not follow from the results of the report", False
    # Another version words its README in another way, but states itself.
    if file.name != README or f"Made by aeromatch {made_by}.".encode() in found:
        return f"not compared: written by version {made_by}, this is {installed}", True
    return f"is not of version {made_by}, which the manifest states", False


def judged_files(report: Path) -> dict[str, dict[str, str]]:
    """Return the SHA-256 of the files that a report judged, by file name and by run or path."""
    judged: dict[str, dict[str, str]] = {}
    statement = read_report_manifest(report)
    for item in statement["predicate"]["buildDefinition"]["resolvedDependencies"]:
        name = PurePosixPath(item["name"]).name
        judged.setdefault(name, {})[run_of(item) or item["name"]] = item["digest"]["sha256"]
    return judged


def compare_model(
    file: Path, parts: tuple[Path, Path], judged: Mapping[str, Mapping[str, str]], made_by: str
) -> tuple[str, bool]:
    """Return whether an FMU is the judged one, and has the model of its database and aircraft.

    Parameters
    ----------
    file : Path
        The FMU.
    parts : (Path, Path)
        Its aircraft and its database.
    judged : mapping
        Result of `judged_files`.
    made_by : str
        Version of the program that wrote the FMU.

    Returns
    -------
    str
        The result in words.
    bool
        Whether it is good.
    """
    name = file.stem
    # The report calls a run by the name of its FMU.
    if judged.get(file.name, {}).get(name) != file_sha256(file):
        return f"is not the FMU that the report judged as {name}", False
    try:
        with zipfile.ZipFile(file) as content:
            if content.getinfo(BLOCK).file_size > _LARGEST_BLOCK:
                return "its model is too large", False
            block = content.read(BLOCK)
        aircraft = flightmech.read_aircraft(parts[0])
        sim = compile_with_envelope(aircraft, aerodb.open(parts[1]))
    except (AeromatchError, OSError, KeyError, zipfile.BadZipFile) as error:
        return f"cannot be compared with its database and aircraft: {error}", False
    if bytes(sim.block) == block:
        return "the judged FMU, with the model of its database and aircraft", True
    if made_by == version("aeromatch"):
        return "its model is not that of its database and aircraft", False
    return f"the judged FMU; its model, of version {made_by}, is not compared", True


def _compare_recordings(folder: Path, judged: Mapping[str, Mapping[str, str]]) -> tuple[str, bool]:
    """Return whether the list of recordings states the hashes of the report and of its files."""
    try:
        text = (folder / RECORDINGS).read_text(encoding="utf-8")
        listed = {row["file"]: row["sha256"] for row in csv.DictReader(io.StringIO(text))}
    except (OSError, ValueError, KeyError, csv.Error) as error:
        return f"cannot be read: {error}", False
    faults = []
    for name, digest in listed.items():
        # A recording that no part of the match uses is not an input of the report.
        if name in judged and digest not in judged[name].values():
            faults.append(f"{name}: not the recording that the report used")
    for file in sorted((folder / "recordings").glob("*")):
        if listed.get(file.name) != file_sha256(file):
            faults.append(f"{file.name}: its file has another SHA-256")
    if faults:
        return "; ".join(faults), False
    return f"{len(listed)} recordings, as the report used them", True
