"""``manifest.json``: what a report was made from and what it consists of, every file by its SHA-256.

An in-toto statement (https://in-toto.io/Statement/v1) whose predicate follows SLSA provenance v1, so that general tools read it.
No host name and no clock: equal input gives equal bytes.  Whoever wants it signed signs this one file.
"""

from __future__ import annotations

import json
import os
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any
from urllib.parse import quote, unquote

from flightmech.errors import ParseError, SchemaError
from flightmech.support.console import plain
from flightmech.support.input_files.text import json_content

from ..result import PomResult
from .origins import case_seen_from, seen_from

NAME = "manifest.json"
STATEMENT = "https://in-toto.io/Statement/v1"
PREDICATE = "https://slsa.dev/provenance/v1"
BUILD = "urn:aeromatch:proof-of-match:v1"


def manifest(
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
    given = {"title": title, "revision": revision, "paper": paper or "", "command": provenance.get("command", "")}
    given |= {"date": provenance.get("date", ""), "cases": [result.case.name for result in results]}
    statement = {
        "_type": STATEMENT,
        "subject": [{"name": name, "digest": {"sha256": digest}} for name, digest in sorted(outputs.items())],
        "predicateType": PREDICATE,
        "predicate": {
            "buildDefinition": {
                "buildType": BUILD,
                "externalParameters": given,
                "internalParameters": {"cases": [case_seen_from(result.case, folder).to_dict() for result in results]},
                "resolvedDependencies": _inputs(provenance, Path(folder)),
            },
            "runDetails": {"builder": {"id": BUILD, "version": dict(provenance.get("versions", {}))}},
        },
    }
    return text_of(statement)


def text_of(statement: Mapping[str, Any]) -> str:
    """Return a statement as it is written: equal content gives equal bytes."""
    return json.dumps(plain(statement), indent=1, sort_keys=True, ensure_ascii=False, allow_nan=False) + "\n"


def _inputs(provenance: Mapping[str, Any], folder: Path) -> list[dict[str, Any]]:
    """Return every input with its digest; its place is given from the report where it is known."""
    places, found = provenance.get("places", {}), []
    for name, digest in sorted(provenance.get("inputs", {}).items()):
        found.append(_dependency(name, digest, Path(places[name]) if name in places else None, folder))
    for run, model in provenance.get("models", {}).items():
        path = model.get("path", "")
        found.append(_dependency(model.get("file", run), model.get("sha256", ""), Path(path) if path else None, folder))
        found[-1]["annotations"] = {"run": run}
    return found


def _dependency(name: str, digest: str, path: Path | None, folder: Path) -> dict[str, Any]:
    item: dict[str, Any] = {"name": name, "digest": {"sha256": digest}}
    if path is not None:
        item["uri"] = quote(seen_from(path, folder))
    return item


def place(dependency: Mapping[str, Any], folder: str | os.PathLike) -> Path | None:
    """Return where an input of a manifest lies, seen from the folder of the report; None when the manifest does not state it."""
    uri = dependency.get("uri", "")
    return Path(os.path.normpath(Path(folder) / unquote(uri))) if uri else None


def read_manifest(folder: str | os.PathLike) -> dict[str, Any]:
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
        raise FileNotFoundError(2, "no manifest.json here; give the folder that `aeromatch pom run -o` wrote", str(path))
    try:
        statement = json_content(path.read_text(encoding="utf-8"), path, "a manifest")
        definition = statement["predicate"]["buildDefinition"]
        known = definition["buildType"] == BUILD and isinstance(statement["subject"], list)
        known = known and isinstance(definition["resolvedDependencies"], list)
    except (ParseError, ValueError, KeyError, TypeError) as error:
        raise SchemaError(str(path), [f"not a manifest ({type(error).__name__}: {error}); write the report again"]) from None
    if not known:
        raise SchemaError(str(path), [f"a statement of another kind than {BUILD}; write the report again"])
    return statement
