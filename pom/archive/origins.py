"""``manifest.json``: what a report was made from and what it consists of, every file by its
SHA-256.

An in-toto statement (https://in-toto.io/Statement/v1) whose predicate follows SLSA provenance v1,
so that general tools read it. No host name and no clock: equal input gives equal bytes.  Whoever
wants it signed signs this one file.
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
from flightmech.support.input_files import file_sha256, json_content
from pom.cases.case import PomCase
from pom.result import PomResult


class ModelFile(TypedDict, total=False):
    """A model file, its SHA-256 and its path."""

    file: str
    sha256: str
    path: str


class ReportProvenance(TypedDict, total=False):
    """Where a report comes from; every key may be absent.

    ``date`` of the results (text), ``command`` line, ``versions`` (name to version), ``inputs``
    (file to SHA-256), ``places`` (input to path), ``models`` (run to file, SHA-256 and path),
    ``records`` (part of the model or case to the names of the flight records it rests on),
    ``record_errors`` (name of a flight record to the errors that its check found), ``signatures``
    (who signs the report, by role: name, date, organisation).
    """

    date: str
    command: str
    versions: Mapping[str, str]
    inputs: Mapping[str, str]
    places: Mapping[str, str]
    models: Mapping[str, ModelFile]
    records: Mapping[str, str]
    record_errors: Mapping[str, str]
    signatures: Mapping[str, Mapping[str, str]]


def check_provenance(provenance: Mapping[str, Any]) -> None:
    """Refuse a misspelt key, which would silently leave a gap in the report.

    Raises
    ------
    UnknownName
        With the near ones.
    """
    for key in provenance:
        if key not in ReportProvenance.__annotations__:
            raise UnknownName(key, ReportProvenance.__annotations__, "key of provenance")


FILES = ("path", "record", "names", "aircraft", "law", "law_names")
SOFTWARE = ("aeromatch", "fmpy", "numpy", "scipy", "typst", "xarray")


def provenance(
    inputs: Iterable[str | Path],
    models: Mapping[str, str | Path],
    command: str = "",
    date: str = "",
    digest: Callable[[str | Path], str] | None = None,
) -> ReportProvenance:
    """Return what a report states about the origin of its numbers.

    Parameters
    ----------
    inputs : iterable of path
        Files the results rest on; they are named from the folder they have in common.
    models : mapping of str to path
        Name of a run to its FMU.
    command : str
        Command line that made the results.
    date : str
        Of the results, ``2026-11-21``; no clock is read.
    digest : callable, optional
        Gives the SHA-256 of a file: ``Custody.sha256`` of files that were taken before they were
        read.  Without it they are hashed now.

    Returns
    -------
    dict
        For `write_report`: ``command``, ``date``, ``versions``, ``inputs`` with their SHA-256, the
        ``places`` where they lie, ``models`` with file, SHA-256 and path.
    """
    digest = digest or file_sha256
    files = sorted({Path(file).resolve() for file in inputs})
    folder = os.path.commonpath([file.parent for file in files]) if files else ""
    return {
        "command": command,
        "date": date,
        "versions": _versions(),
        "inputs": {file.relative_to(folder).as_posix(): digest(file) for file in files},
        "places": {file.relative_to(folder).as_posix(): str(file) for file in files},
        "models": {
            name: {
                "file": Path(file).name,
                "sha256": digest(file),
                "path": str(Path(file).resolve()),
            }
            for name, file in models.items()
        },
    }


def _versions() -> dict[str, str]:
    found = {}
    for name in SOFTWARE:
        with suppress(PackageNotFoundError):
            found[name] = version(name)
    return found


def without_places(provenance: Mapping[str, Any]) -> dict[str, Any]:
    """Return what a report prints of its provenance: names and hashes, no folder of the machine it
    was made on.
    """
    models = {
        run: {key: text for key, text in model.items() if key != "path"}
        for run, model in provenance.get("models", {}).items()
    }
    kept = {key: item for key, item in provenance.items() if key != "places"}
    return {**kept, "models": models} if models else kept


def seen_from(path: str | os.PathLike, folder: str | os.PathLike) -> str:
    """Return a path as it is seen from a folder, so that a report discloses nothing of the machine
    it was made on.
    """
    try:
        return Path(os.path.relpath(Path(path).resolve(), Path(folder).resolve())).as_posix()
    except ValueError:  # another drive
        return Path(path).as_posix()


def case_seen_from(case: PomCase, folder: str | os.PathLike) -> PomCase:
    """Return a case whose files are named as seen from `folder`."""
    names: dict[str, Any] = {
        name: seen_from(getattr(case, name), folder) for name in FILES if getattr(case, name)
    }
    return replace(case, **names)


def with_full_places(result: PomResult) -> PomResult:
    """Return a result whose case names its files by full paths, for processes that may have another
    working directory.
    """
    names: dict[str, Any] = {
        name: str(Path(getattr(result.case, name)).resolve())
        for name in FILES
        if getattr(result.case, name)
    }
    return replace(result, case=replace(result.case, **names))


def case_found_from(case: PomCase, folder: str | os.PathLike) -> PomCase:
    """Return a case of `case_seen_from` with its files found again."""
    names: dict[str, Any] = {
        name: os.path.normpath(Path(folder, getattr(case, name)))
        for name in FILES
        if getattr(case, name)
    }
    return replace(case, **names)


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
        Their resolved cases are the configuration.
    outputs : mapping of str to str
        Name of a file, from the folder of the report, to its SHA-256.
    folder : path
        Of the report; inputs are located from it.
    title, revision, paper
        As given to `pom.write_report`.
    provenance : mapping
        From `pom.provenance`.
    """
    given = {
        "title": title,
        "revision": revision,
        "paper": paper or "",
        "command": provenance.get("command", ""),
    }
    given |= {"date": provenance.get("date", ""), "cases": [result.case.name for result in results]}
    statement = {
        "_type": STATEMENT,
        "subject": [
            {"name": name, "digest": {"sha256": digest}} for name, digest in sorted(outputs.items())
        ],
        "predicateType": PREDICATE,
        "predicate": {
            "buildDefinition": {
                "buildType": BUILD,
                "externalParameters": given,
                "internalParameters": {
                    "cases": [case_seen_from(result.case, folder).to_dict() for result in results]
                },
                "resolvedDependencies": _inputs(provenance, Path(folder)),
            },
            "runDetails": {
                "builder": {"id": BUILD, "version": dict(provenance.get("versions", {}))}
            },
        },
    }
    return statement_text(statement)


def statement_text(statement: Mapping[str, Any]) -> str:
    """Return a statement as it is written: equal content gives equal bytes."""
    return (
        json.dumps(
            to_json_types(statement), indent=1, sort_keys=True, ensure_ascii=False, allow_nan=False
        )
        + "\n"
    )


def _inputs(provenance: Mapping[str, Any], folder: Path) -> list[dict[str, Any]]:
    """Return every input with its digest; its place is given from the report where it is known."""
    places, found = provenance.get("places", {}), []
    for name, digest in sorted(provenance.get("inputs", {}).items()):
        found.append(
            _dependency(name, digest, Path(places[name]) if name in places else None, folder)
        )
    for run, model in provenance.get("models", {}).items():
        path = model.get("path", "")
        found.append(
            _dependency(
                model.get("file", run),
                model.get("sha256", ""),
                Path(path) if path else None,
                folder,
            )
        )
        found[-1]["annotations"] = {"run": run}
    return found


def _dependency(name: str, digest: str, path: Path | None, folder: Path) -> dict[str, Any]:
    item: dict[str, Any] = {"name": name, "digest": {"sha256": digest}}
    if path is not None:
        item["uri"] = quote(seen_from(path, folder))
    return item


def dependency_path(dependency: Mapping[str, Any], folder: str | os.PathLike) -> Path | None:
    """Return where an input of a manifest lies, seen from the folder of the report; None when the
    manifest does not state it.
    """
    uri = dependency.get("uri", "")
    return Path(os.path.normpath(Path(folder) / unquote(uri))) if uri else None


def read_report_manifest(folder: str | os.PathLike) -> dict[str, Any]:
    """Return the manifest of a report.

    Raises
    ------
    FileNotFoundError
        The folder holds none.
    SchemaError
        It is not one of ours.
    """
    path = Path(folder) / NAME
    if not path.is_file():
        raise FileNotFoundError(
            2, "no manifest.json here; give the folder that `aeromatch pom run -o` wrote", str(path)
        )
    try:
        statement = json_content(path.read_text(encoding="utf-8"), path, "a manifest")
        definition = statement["predicate"]["buildDefinition"]
        known = definition["buildType"] == BUILD and isinstance(statement["subject"], list)
        known = known and isinstance(definition["resolvedDependencies"], list)
    except (ParseError, ValueError, KeyError, TypeError) as error:
        raise SchemaError(
            str(path), [f"not a manifest ({type(error).__name__}: {error}); write the report again"]
        ) from None
    if not known:
        raise SchemaError(
            str(path), [f"a statement of another kind than {BUILD}; write the report again"]
        )
    return statement
