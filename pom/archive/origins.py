"""Manifest of a report, ``manifest.json``: its inputs and its files, each with its SHA-256.

The manifest is an in-toto statement (https://in-toto.io/Statement/v1) with a predicate of SLSA
provenance v1, so that general tools read it.  It has no host name and no time of day, so equal
input gives equal bytes.  A signature of this one file covers the whole report.
"""

from __future__ import annotations

import json
import os
from collections.abc import Callable, Iterable, Mapping, Sequence
from contextlib import suppress
from dataclasses import replace
from importlib.metadata import PackageNotFoundError, version
from pathlib import Path
from typing import Any, TypedDict
from urllib.parse import quote, unquote

from flightmech.errors import ParseError, SchemaError, UnknownName
from flightmech.support.console import to_json_types
from flightmech.support.foreign_code.sandbox import name_sandbox
from flightmech.support.input_files import file_sha256, json_content
from pom.archive.program_files import list_program, program_digests
from pom.cases.case import PomCase
from pom.result import PomResult


class ModelFile(TypedDict, total=False):
    """A model file, its SHA-256 and its path."""

    file: str
    sha256: str
    path: str


class ReportProvenance(TypedDict, total=False):
    """Origin of a report; every key may be absent.

    ``program`` (tolerance table and package to SHA-256), ``date`` of the results (text),
    ``command`` line, ``versions`` (name to version), ``inputs`` (file to SHA-256), ``places``
    (input to path), ``models`` (run to file, SHA-256 and path), ``units`` (set of units that the
    pages show, `pom.report.presentation.unit_sets`), ``records`` (part of the model or case to the
    names of its flight records), ``record_errors`` (name of a flight record to its errors),
    ``signatures`` (role to name, date, organisation).
    """

    date: str
    command: str
    units: str
    versions: Mapping[str, str]
    program: Mapping[str, str]
    inputs: Mapping[str, str]
    places: Mapping[str, str]
    models: Mapping[str, ModelFile]
    records: Mapping[str, str]
    record_errors: Mapping[str, str]
    signatures: Mapping[str, Mapping[str, str]]


def check_provenance(provenance: Mapping[str, Any]) -> None:
    """Raise on an unknown key, since a misspelt key leaves a gap in the report.

    Raises
    ------
    UnknownName
        A key is unknown.  The error names the nearest keys.
    """
    for key in provenance:
        if key not in ReportProvenance.__annotations__:
            raise UnknownName(key, ReportProvenance.__annotations__, "key of provenance")


FILES = ("path", "record", "names", "aircraft", "law", "law_names", "tolerances")
SOFTWARE = ("aeromatch", "fmpy", "numpy", "scipy", "typst", "xarray")


def provenance(
    inputs: Iterable[str | Path],
    models: Mapping[str, str | Path],
    command: str = "",
    date: str = "",
    digest: Callable[[str | Path], str] | None = None,
) -> ReportProvenance:
    """Return the origin of the results for `pom.write_report`.

    Parameters
    ----------
    inputs : iterable of path
        Input files of the results.  Their names are relative to their common folder.
    models : mapping of str to path
        Name of a run to its FMU.
    command : str
        Command line of the run.
    date : str
        Date of the results, ``2026-11-21``.  The function does not read a clock.
    digest : callable, optional
        Function from a file to its SHA-256: ``Custody.sha256`` for files that were hashed before
        they were read.  Default: hash the files now.

    Returns
    -------
    dict
        ``command``, ``date``, ``versions`` and the sandbox of the FMUs, ``program``, ``inputs``
        with their SHA-256, ``places`` with their
        paths, ``models`` with file, SHA-256 and path.
    """
    # Names relative to the common folder are unique and do not disclose the folders above.
    digest = digest or file_sha256
    files = sorted({Path(file).resolve() for file in inputs})
    folder = Path()
    if files:
        folder = Path(os.path.commonpath([file.parent for file in files]))
    names = {file: file.relative_to(folder).as_posix() for file in files}
    model_files: dict[str, ModelFile] = {}
    for run, model in models.items():
        path = Path(model)
        model_files[run] = {
            "file": path.name,
            "sha256": digest(model),
            "path": str(path.resolve()),
        }
    versions = _read_versions()
    if model_files:
        versions["sandbox of the FMUs"] = name_sandbox()
    return {
        "command": command,
        "date": date,
        "versions": versions,
        "program": program_digests(),
        "inputs": {name: digest(file) for file, name in names.items()},
        "places": {name: str(file) for file, name in names.items()},
        "models": model_files,
    }


def _read_versions() -> dict[str, str]:
    versions = {}
    for package in SOFTWARE:
        # optional packages may be missing
        with suppress(PackageNotFoundError):
            versions[package] = version(package)
    return versions


def without_places(provenance: Mapping[str, Any]) -> dict[str, Any]:
    """Return a provenance without the paths of this machine, as a report prints it."""
    public = {key: item for key, item in provenance.items() if key != "places"}
    models = {}
    for run, model in provenance.get("models", {}).items():
        models[run] = {key: text for key, text in model.items() if key != "path"}
    if models:
        public["models"] = models
    return public


def seen_from(path: str | os.PathLike, folder: str | os.PathLike) -> str:
    """Return a path relative to a folder, so that a report does not disclose this machine."""
    try:
        return Path(os.path.relpath(Path(path).resolve(), Path(folder).resolve())).as_posix()
    except ValueError:
        # Windows: a path on another drive has no relative form
        return Path(path).as_posix()


def case_seen_from(case: PomCase, folder: str | os.PathLike) -> PomCase:
    """Return a case with the names of its files relative to `folder`."""
    return _rename_files(case, lambda name: seen_from(name, folder))


def with_full_places(result: PomResult) -> PomResult:
    """Return a result whose case has full paths, for processes in another working directory."""
    case = _rename_files(result.case, lambda name: str(Path(name).resolve()))
    return replace(result, case=case)


def case_found_from(case: PomCase, folder: str | os.PathLike) -> PomCase:
    """Return a case of `case_seen_from` with its files relative to the working directory."""
    return _rename_files(case, lambda name: os.path.normpath(Path(folder, name)))


def _rename_files(case: PomCase, rename: Callable[[str], str]) -> PomCase:
    """Return a case with each of its files renamed; a file that the case lacks stays empty."""
    names: dict[str, Any] = {}
    for key in FILES:
        name = getattr(case, key)
        if name:
            names[key] = rename(name)
    models = {model: rename(table) for model, table in case.models.items()}
    return replace(case, **names, models=models)


NAME = "manifest.json"
STATEMENT = "https://in-toto.io/Statement/v1"
PREDICATE = "https://slsa.dev/provenance/v1"
BUILD = "urn:aeromatch:proof-of-match:v1"


def report_manifest_text(
    results: Sequence[PomResult],
    outputs: Mapping[str, str],
    folder: str | os.PathLike,
    *,
    title: str,
    revision: str,
    paper: str | None,
    provenance: Mapping[str, Any],
) -> str:
    """Return the text of ``manifest.json``.

    Parameters
    ----------
    results : sequence of PomResult
        Results of the report; their resolved cases are the configuration.
    outputs : mapping of str to str
        Name of a file, relative to the folder of the report, to its SHA-256.
    folder : path
        Folder of the report; the paths of inputs are relative to it.
    title, revision, paper
        As given to `pom.write_report`.
    provenance : mapping
        From `pom.provenance`.
    """
    subject = []
    for name, digest in sorted(outputs.items()):
        subject.append({"name": name, "digest": {"sha256": digest}})
    external = {
        "title": title,
        "revision": revision,
        "paper": paper or "",
        "command": provenance.get("command", ""),
        "date": provenance.get("date", ""),
        "cases": [result.case.name for result in results],
    }
    cases = [case_seen_from(result.case, folder).to_dict() for result in results]
    # the keys of in-toto Statement v1 and of SLSA provenance v1
    builder: dict[str, Any] = {"id": BUILD, "version": dict(provenance.get("versions", {}))}
    program = list_program(provenance)
    if program:
        builder["builderDependencies"] = program
    predicate = {
        "buildDefinition": {
            "buildType": BUILD,
            "externalParameters": external,
            "internalParameters": {"cases": cases},
            "resolvedDependencies": _list_dependencies(provenance, Path(folder)),
        },
        "runDetails": {"builder": builder},
    }
    return statement_text(
        {
            "_type": STATEMENT,
            "subject": subject,
            "predicateType": PREDICATE,
            "predicate": predicate,
        }
    )


def statement_text(statement: Mapping[str, Any]) -> str:
    """Return the text of a statement; equal content gives equal bytes."""
    text = json.dumps(
        to_json_types(statement), indent=1, sort_keys=True, ensure_ascii=False, allow_nan=False
    )
    return text + "\n"


def _list_dependencies(provenance: Mapping[str, Any], folder: Path) -> list[dict[str, Any]]:
    """Return every input and model with its digest, and with its path if it is known."""
    paths = provenance.get("places", {})
    dependencies = []
    for name, digest in sorted(provenance.get("inputs", {}).items()):
        dependencies.append(_dependency(name, digest, path=paths.get(name), folder=folder))
    for run, model in provenance.get("models", {}).items():
        item = _dependency(
            model.get("file", run),
            model.get("sha256", ""),
            path=model.get("path") or None,
            folder=folder,
        )
        # an item with a run is a model, an item without is an input
        item["annotations"] = {"run": run}
        dependencies.append(item)
    return dependencies


def _dependency(name: str, digest: str, *, path: str | None, folder: Path) -> dict[str, Any]:
    item: dict[str, Any] = {"name": name, "digest": {"sha256": digest}}
    if path is not None:
        item["uri"] = quote(seen_from(path, folder))
    return item


def dependency_path(dependency: Mapping[str, Any], folder: str | os.PathLike) -> Path | None:
    """Return the path of an input of a manifest in `folder`, or None if it is not stated."""
    # a URI quotes blanks and other characters of a path
    uri = dependency.get("uri", "")
    if not uri:
        return None
    return Path(os.path.normpath(Path(folder) / unquote(uri)))


def read_report_manifest(folder: str | os.PathLike) -> dict[str, Any]:
    """Return the manifest of a report.

    Raises
    ------
    FileNotFoundError
        The folder has no manifest.
    SchemaError
        The file is not a manifest of this program.
    """
    path = Path(folder) / NAME
    if not path.is_file():
        raise FileNotFoundError(
            2, "no manifest.json here; give the folder that `aeromatch pom run -o` wrote", str(path)
        )
    try:
        statement = json_content(path.read_text(encoding="utf-8"), path, "a manifest")
        definition = statement["predicate"]["buildDefinition"]
        # `verify` iterates over both lists
        lists = (statement["subject"], definition["resolvedDependencies"])
        is_ours = definition["buildType"] == BUILD and all(isinstance(item, list) for item in lists)
    except (ParseError, ValueError, KeyError, TypeError) as error:
        raise SchemaError(
            str(path), [f"not a manifest ({type(error).__name__}: {error}); write the report again"]
        ) from None
    if not is_ours:
        raise SchemaError(
            str(path), [f"a statement of another kind than {BUILD}; write the report again"]
        )
    return statement
