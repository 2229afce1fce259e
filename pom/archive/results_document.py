"""``results.json``: every number that a report prints."""

from __future__ import annotations

import json
import os
from collections.abc import Sequence
from typing import Any, NamedTuple

import pandas as pd

from flightmech.support.console import plain

from ..replaying.offsets import drift
from ..result import PomResult, records, split
from .archive import Archive
from .origins import case_seen_from


class CaseText(NamedTuple):
    """JSON of one case: its name, all numbers, and the table of its modes, empty where it has none."""

    name: str
    numbers: str
    modes: str


def case_text(result: PomResult, modes: pd.DataFrame, folder: str | os.PathLike) -> CaseText:
    """Return what ``results.json`` holds of a case; files are named from `folder`, `modes` is its `pom.judging.mode_table`."""
    return CaseText(result.case.name, _json(_numbers(result, folder)), _json(_records(modes)) if len(modes) else "")


def results_json(archive: Archive, cases: Sequence[CaseText]) -> str:
    """Return the text of ``results.json``, the keys of every object in their order; the samples are in ``results.nc``."""
    parts = {
        "title": _json(archive.title),
        "revision": _json(archive.revision),
        "provenance": _json(plain(archive.provenance)),
        "samples": '"results.nc"',
        "results": f"[{','.join(case.numbers for case in cases)}]",
        "modes": _joined({case.name: case.modes for case in cases if case.modes}),
        "diagnoses": _json({name: _records(table) for name, table in archive.diagnoses.items()}),
        **({"tunings": _json(plain(archive.tunings))} if archive.tunings else {}),
    }
    return _joined(parts) + "\n"


def _json(item: Any) -> str:
    return json.dumps(item, sort_keys=True, ensure_ascii=False, separators=(",", ":"), allow_nan=False)


def _joined(texts: dict[str, str]) -> str:
    """Return an object of JSON texts, as `_json` writes it."""
    return f"{{{','.join(f'{_json(name)}:{text}' for name, text in sorted(texts.items()))}}}"


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
            "trim": split(result.trim),
            "drift": records(drift(result)),
            "verdict": result.verdict_records(),
            "failure": result.failure,
            **({"samples": samples} if samples else {}),
        }
    )


def _records(table: pd.DataFrame) -> list[dict[str, Any]]:
    return plain(records(table))
