"""``results.json``: every number that a report prints."""

from __future__ import annotations

import json
import os
from collections.abc import Sequence
from typing import Any

import pandas as pd

from flightmech.support.console import plain

from ..replaying.offsets import drift
from ..result import PomResult
from .archive import Archive
from .origins import case_seen_from


def results_document(archive: Archive, modes: Sequence[pd.DataFrame], folder: str | os.PathLike) -> dict[str, Any]:
    """Return every number that the report prints, as plain data.

    The samples are in ``results.nc``; files are named from `folder`.  `modes` holds the table of `pom.judging.mode_table` per result.
    """
    return {
        "title": archive.title,
        "revision": archive.revision,
        "provenance": plain(archive.provenance),
        "samples": "results.nc",
        "results": [_numbers(result, folder) for result in archive.results],
        "modes": {result.case.name: _records(table) for result, table in zip(archive.results, modes, strict=True) if len(table)},
        "diagnoses": {name: _records(table) for name, table in archive.diagnoses.items()},
        **({"tunings": plain(archive.tunings)} if archive.tunings else {}),
    }


def results_json(archive: Archive, modes: Sequence[pd.DataFrame], folder: str | os.PathLike) -> str:
    """Return the text of ``results.json``."""
    document = results_document(archive, modes, folder)
    return json.dumps(document, sort_keys=True, ensure_ascii=False, separators=(",", ":"), allow_nan=False) + "\n"


def _numbers(result: PomResult, folder: str | os.PathLike) -> dict[str, Any]:
    samples = {run: found.numbers() for run, found in result.samples.items()}
    return plain(
        {
            "case": case_seen_from(result.case, folder).to_dict(),
            "conditions": result.conditions,
            "status": {run: result.status(run) for run in result.runs},
            "attributes": dict(result.signals.attrs),
            "channels": [str(name) for name in result.signals.data_vars],
            "inputs": [str(name) for name in result.inputs.data_vars],
            "samples": int(result.signals.sizes["time"]),
            "trim": result.trim.to_dict("split"),
            "drift": drift(result).to_dict("records"),
            "verdict": result.verdict_records(),
            "failure": result.failure,
            **({"samples": samples} if samples else {}),
        }
    )


def _records(table: pd.DataFrame) -> list[dict[str, Any]]:
    return plain(table.to_dict("records"))
