"""Digests of the program that made a report, and their comparison with this installation.

A pass is worth what the program is worth that judged it.  An edited tolerance table or module of
the installation that wrote a report shows in a clean installation of the same version.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from functools import cache
from importlib.metadata import PackageNotFoundError, version
from pathlib import Path
from typing import Any

from flightmech.support.input_files import file_sha256
from flightmech.support.kept_stages.program import hash_sources
from pom.tolerances import rows

TABLE = "pom/tolerances/tolerances.csv"
PROGRAM = "aeromatch"


@cache
def program_digests() -> dict[str, str]:
    """Return the SHA-256 of the tolerance table and of the files of each package, by name."""
    table = Path(rows.__file__).with_name(Path(TABLE).name)
    return {TABLE: file_sha256(table), **hash_sources()}


def list_program(provenance: Mapping[str, Any]) -> list[dict[str, Any]]:
    """Return the digests of a provenance as ``builderDependencies`` of a manifest."""
    items = []
    for name, digest in sorted(provenance.get("program", {}).items()):
        items.append({"name": name, "digest": {"sha256": digest}})
    return items


def compare_program(statement: Mapping[str, Any]) -> Iterator[tuple[str, str, str]]:
    """Yield name, state and detail of every digest of a manifest against this installation.

    The state is ``same``, ``changed`` or ``unknown``: the manifest is from before it stated its
    program, or another version wrote it, whose files differ anyway.

    Parameters
    ----------
    statement : mapping
        The manifest (`read_report_manifest`).
    """
    builder = statement["predicate"].get("runDetails", {}).get("builder", {})
    stated = {}
    for item in builder.get("builderDependencies", []):
        stated[item["name"]] = item["digest"]["sha256"]
    if not stated:
        yield PROGRAM, "unknown", "the manifest does not state the files of the program"
        return
    written_by = builder.get("version", {}).get(PROGRAM, "")
    is_same_version = written_by == _installed()
    for name, present in program_digests().items():
        digest = stated.get(name, "")
        if digest == present:
            yield name, "same", ""
        elif name == TABLE:
            detail = "the tolerance table that judged is not that of this installation"
            yield name, "changed", f"{detail}; SHA-256 was {digest}, is {present}"
        elif is_same_version:
            detail = f"files of the program differ from those of this installation ({written_by})"
            yield name, "changed", f"{detail}; SHA-256 was {digest}, is {present}"
        else:
            detail = f"written by version {written_by or 'unknown'}, this is {_installed()}"
            yield name, "unknown", f"{detail}; verify with that version"


def _installed() -> str:
    """Return the version of this installation; empty for a checkout that is not installed."""
    try:
        return version(PROGRAM)
    except PackageNotFoundError:
        return ""
