"""What the report was made from: inputs with hashes, versions, command, and what no source could give."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any, TypedDict

import xarray as xr

from flightmech.errors import UnknownName
from pom.result import PomResult

from .quantities import label


class Model(TypedDict, total=False):
    """A model file, its SHA-256 and its path."""

    file: str
    sha256: str
    path: str


class Provenance(TypedDict, total=False):
    """Where a report comes from; every key may be absent.

    ``date`` of the results (text), ``command`` line, ``versions`` (name to version), ``inputs`` (file to SHA-256),
    ``places`` (input to path), ``models`` (run to file, SHA-256 and path).
    """

    date: str
    command: str
    versions: Mapping[str, str]
    inputs: Mapping[str, str]
    places: Mapping[str, str]
    models: Mapping[str, Model]


def check(provenance: Mapping[str, Any]) -> None:
    """Refuse a misspelt key, which would silently leave a gap in the report.

    Raises
    ------
    UnknownName
        With the near ones.
    """
    for key in provenance:
        if key not in Provenance.__annotations__:
            raise UnknownName(key, Provenance.__annotations__, "key of provenance")


def page(provenance: Mapping[str, Any], results: Sequence[PomResult], databases: Mapping[str, xr.DataTree]) -> dict[str, Any]:
    """Return everything the template ``provenance.html`` needs."""
    channels = {str(name) for r in results for data in (r.signals, r.inputs) for name in data.data_vars}
    return {
        "date": provenance.get("date", ""),
        "command": provenance.get("command", ""),
        "versions": sorted(provenance.get("versions", {}).items()),
        "inputs": sorted(provenance.get("inputs", {}).items()),
        "models": list(provenance.get("models", {}).items()),
        "records": sorted({result.case.record for result in results}),
        "absent": [(name, str(db.attrs.get("absent", "")).split()) for name, db in databases.items()],
        "glossary": sorted((label(name) for name in channels), key=lambda x: x.name.lower()),
    }
