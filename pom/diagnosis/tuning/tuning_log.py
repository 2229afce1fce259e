"""The log of a tuning: what moved, by how much, and what became of every row; plain data for a file
and the report, and text.
"""

from __future__ import annotations

import json
import math
import os
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import pandas as pd
import xarray as xr

from flightmech.errors import SchemaError
from flightmech.support.console import to_json_types
from pom.result import status_text

KIND = "log of aeromatch pom tune, 1"
BASES = ("database", "aircraft", "evidence", "rationale", "biases")
MISSING = "\N{EN DASH}"
LEAST = 0.05  # standard errors: what moved less is counted in the text, not listed
_NEEDED = {"kind", "refusal", "bound", "distance", "model", "files", "moves", "rows"}
_OF_MOVES = {"term", "moved", "from_evidence", "share", "nodes", "at", "rationale"}
_OF_ROWS = {
    "case",
    "id",
    "title",
    "wanted",
    "before",
    "after",
    "ratio_before",
    "ratio_after",
    "criterion_before",
    "criterion_after",
}


@dataclass(frozen=True)
class Tuning:
    """Outcome of `tune`.

    Attributes
    ----------
    database : DataTree or None
        The tuned one, with its moves in history and undo history; None when it was refused.
    moves : DataFrame
        Index term: ``moved`` and ``from_evidence``, the largest change of a node against model and
        evidence, ``share`` of the squared distance from the model that the term takes, ``nodes``
        that moved, ``at``, where the largest change is, in SI, ``rationale``. [standard errors, 1]
    rows : DataFrame
        Index case: ``id``, ``title``, ``wanted``, ``before`` and ``after`` (status),
        ``ratio_before`` and ``ratio_after`` of the criteria that decide, ``criterion_before`` and
        ``criterion_after``. [1]
    distance : float
        Mahalanobis distance of the tuned model from the evidence.
    bound : float
        Of every node of a term without a rationale. [standard errors]
    refusal : str
        Why the rows cannot pass inside the bound, with what it would take; empty when they pass.
    """

    database: xr.DataTree | None
    moves: pd.DataFrame
    rows: pd.DataFrame
    distance: float
    bound: float
    refusal: str = ""

    def document(
        self, model: str = "", files: Mapping[str, Mapping[str, str]] | None = None
    ) -> dict[str, Any]:
        """Return the log as plain data.

        Parameters
        ----------
        model : str
            SHA-256 of the tables of the tuned model (`flightmech.simulation.nodes_digest`), by
            which an FMU of it is known.
        files : mapping of str to mapping, optional
            ``name`` and ``sha256`` of the files it rests on: `BASES`, ``case NAME`` and ``record of
            NAME``.
        """
        return to_json_types(
            {
                "kind": KIND,
                "refusal": self.refusal,
                "bound": self.bound,
                "distance": self.distance,
                "model": model,
                "files": dict(files or {}),
                "moves": self.moves.rename_axis("term").reset_index().to_dict("records"),
                "rows": self.rows.rename_axis("case").reset_index().to_dict("records"),
            }
        )

    def log(self) -> list[str]:
        """Return what moved and what it did, line by line."""
        return list(log_lines(self.document()))


def outcome_sentence(log: Mapping[str, Any]) -> str:
    """Return the outcome of a tuning in one sentence."""
    if log["refusal"]:
        return f"refused: {log['refusal']}"
    wanted = ", ".join(row["case"] for row in log["rows"] if row["wanted"])
    if not log["moves"]:
        found = "the wanted rows pass as they are" if wanted else "no row fails"
        left = [
            f"{status_text(row['before'])} {row['case']}"
            for row in log["rows"]
            if row["before"] in ("invalid", "not_tested")
        ]
        return "; ".join([f"nothing moved: {found}", *left])
    far = max(log["moves"], key=lambda move: move["from_evidence"])
    largest = f"largest move from it {far['from_evidence']:.2f} standard errors, {far['term']}"
    return (
        f"tuned for {wanted}: distance {log['distance']:.2f} from the evidence, {largest}; "
        f"bound {log['bound']:g}"
    )


MOVES = ("term", "moved", "from evidence", "share", "nodes", "largest at", "rationale")
ROWS = ("test", "case", "wanted", "before", "ratio before", "after", "ratio after", "decided by")
NUMBERS = ("moved", "from evidence", "share", "nodes", "ratio before", "ratio after")


def moves_of(log: Mapping[str, Any]) -> tuple[list[tuple[str, ...]], str]:
    """Return the cells of `MOVES` for every term that moved by more than `LEAST`, and a sentence on
    the others.
    """
    found: list[tuple[str, ...]] = [
        (
            move["term"],
            f"{move['moved']:.2f}",
            f"{move['from_evidence']:.2f}",
            f"{round(100.0 * move['share'])} %",
            str(move["nodes"]),
            move["at"],
            move["rationale"],
        )
        for move in log["moves"]
        if move["moved"] >= LEAST
    ]
    rest = len(log["moves"]) - len(found)
    return (
        found,
        f"{rest} further term{'s' if rest > 1 else ''} by less than {LEAST:g} standard errors"
        if rest
        else "",
    )


def log_rows(log: Mapping[str, Any]) -> list[tuple[str, ...]]:
    """Return the cells of `ROWS` for every case."""
    return [
        (
            row["id"],
            row["case"],
            "wanted" if row["wanted"] else "",
            status_text(row["before"]),
            _ratio(row["ratio_before"]),
            status_text(row["after"]),
            _ratio(row["ratio_after"]),
            row["criterion_after"] or row["criterion_before"],
        )
        for row in log["rows"]
    ]


def log_lines(log: Mapping[str, Any]) -> Iterator[str]:
    """Yield the text of a log (`Tuning.document`)."""
    yield outcome_sentence(log)
    moves, rest = moves_of(log)
    for term, moved, away, share, nodes, at, why in moves:
        verb, place = "would move" if log["refusal"] else "moved", f", most at {at}" if at else ""
        text = (
            f"{term}: {verb} by {moved} standard errors at most ({nodes} nodes{place}), "
            f"{away} from the evidence, {share} of the distance"
        )
        yield f"{text}; rationale: {why}" if why else text
    if rest:
        yield rest
    for test, case, wanted, before, ratio, after, now, criterion in log_rows(log):
        yield f"{test} {case}: {before} -> {after}, {ratio} -> {now} x tolerance ({criterion}){wanted and ', wanted'}"


def read_log(path: str | os.PathLike) -> dict[str, Any]:
    """Return a log of ``aeromatch pom tune`` from its file.

    Raises
    ------
    FileNotFoundError
    SchemaError
        The file is not a log of a tuning that was done.
    """
    expected = "give tuning.json, as aeromatch pom tune writes it"
    try:
        log = json.loads(Path(path).read_text(encoding="utf-8"))
    except ValueError as error:
        raise SchemaError(str(path), [f"no JSON text ({error}); {expected}"]) from error
    kind = log.get("kind") if isinstance(log, dict) else None
    if kind != KIND:
        raise SchemaError(
            str(path), [f"no log of a tuning (kind is {kind!r}, {KIND!r} is needed); {expected}"]
        )
    problems = [f"{name} is missing" for name in sorted(_NEEDED - set(log))]
    for part, needed in (("moves", _OF_MOVES), ("rows", _OF_ROWS)):
        problems += [
            f"{part}[{k}] lacks {', '.join(sorted(needed - set(item)))}"
            for k, item in enumerate(log.get(part, ()))
            if needed - set(item)
        ]
    if problems:
        raise SchemaError(
            str(path),
            [f"{problem}; write the log again with aeromatch pom tune" for problem in problems],
        )
    if log["refusal"]:
        raise SchemaError(
            str(path), [f"the log of a refusal, no model was tuned: {log['refusal']}"]
        )
    return log


def _ratio(value: float | None) -> str:
    return f"{value:.2f}" if value is not None and math.isfinite(value) else MISSING
