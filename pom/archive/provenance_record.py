"""Where a report comes from: the keys of its provenance."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any, TypedDict

from flightmech.errors import UnknownName


class Model(TypedDict, total=False):
    """A model file, its SHA-256 and its path."""

    file: str
    sha256: str
    path: str


class Provenance(TypedDict, total=False):
    """Where a report comes from; every key may be absent.

    ``date`` of the results (text), ``command`` line, ``versions`` (name to version), ``inputs`` (file to SHA-256),
    ``places`` (input to path), ``models`` (run to file, SHA-256 and path), ``records`` (part of the model or case to the names of the
    flight records it rests on), ``record_errors`` (name of a flight record to the errors that its check
    found), ``signatures`` (who signs the report, by role: name, date, organisation).
    """

    date: str
    command: str
    versions: Mapping[str, str]
    inputs: Mapping[str, str]
    places: Mapping[str, str]
    models: Mapping[str, Model]
    records: Mapping[str, str]
    record_errors: Mapping[str, str]
    signatures: Mapping[str, Mapping[str, str]]


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
