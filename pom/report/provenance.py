"""What the report was made from: inputs with hashes, versions, command, and what no source could give."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import xarray as xr

from pom.cases.signatures import signature_rows
from pom.result import PomResult, results_name

from .presentation.quantities import label


def page(provenance: Mapping[str, Any], results: Sequence[PomResult], databases: Mapping[str, xr.DataTree]) -> dict[str, Any]:
    """Return everything the template ``provenance.html`` needs."""
    channels = {str(name) for r in results for data in (r.signals, r.inputs) for name in data.data_vars}
    return {
        "date": provenance.get("date", ""),
        "results": (name := results_name(results)),
        "command": provenance.get("command", ""),
        "versions": sorted(provenance.get("versions", {}).items()),
        "inputs": sorted(provenance.get("inputs", {}).items()),
        "models": list(provenance.get("models", {}).items()),
        "records": list(provenance.get("records", {}).items()),
        "record_errors": list(provenance.get("record_errors", {}).items()),
        "signatures": signature_rows(given, provenance.get("date", ""), name) if (given := provenance.get("signatures", {})) else [],
        "absent": [(name, str(db.attrs.get("absent", "")).split()) for name, db in databases.items()],
        "notices": [(name, notice) for name, db in databases.items() for notice in str(db.attrs.get("notices", "")).splitlines()],
        "glossary": sorted((label(name) for name in channels), key=lambda x: x.name.lower()),
    }
