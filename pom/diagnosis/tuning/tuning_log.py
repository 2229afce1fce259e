"""Log of a tuning: moved terms and outcome of every case, as data for files and as text."""

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
from flightmech.short_text import ShortText
from flightmech.support.console import to_json_types
from pom.status import status_text

KIND = "log of aeromatch pom tune, 1"
BASES = ("database", "aircraft", "evidence", "rationale", "biases")
MISSING = "\N{EN DASH}"
USUAL_BOUND = 3.0  # standard errors: a larger bound is a departure
# A term is listed if it has so much of the squared distance, moved by so many standard errors, or
# has a rationale. The others are counted in the text.
LEAST_SHARE = 0.01
LEAST_MOVE = 0.5  # standard errors, of the model or from the evidence
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
class Tuning(ShortText):
    """Outcome of `tune`.

    Attributes
    ----------
    database : DataTree or None
        The tuned database, with its moves in history and undo history; None for a refusal.
    moves : DataFrame
        Index term: ``moved`` and ``from_evidence``, the largest change of a node against model and
        evidence, ``share`` of the term in the squared distance from the model, ``nodes``, the
        number of moved nodes, ``at``, the place of the largest change, in SI, ``rationale``.
        [standard errors, 1]
    rows : DataFrame
        Index case: ``id``, ``title``, ``wanted``, ``before`` and ``after`` (status),
        ``ratio_before`` and ``ratio_after`` of the criteria that decide, ``criterion_before`` and
        ``criterion_after``. [1]
    distance : float
        Mahalanobis distance of the tuned model from the evidence.
    bound : float
        Of every node of a term without a rationale. [standard errors]
    refusal : str
        Why the rows cannot pass inside the bound, with the necessary moves; empty if they pass.
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
            SHA-256 of the tables of the tuned model (`flightmech.simulation.nodes_digest`), which
            identifies an FMU of the model.
        files : mapping of str to mapping, optional
            ``name`` and ``sha256`` of the input files: `BASES`, ``case NAME`` and ``record of
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
        """Return the log as lines of text."""
        return list(log_lines(self.document()))


def outcome_sentence(log: Mapping[str, Any]) -> str:
    """Return the outcome of a tuning in one sentence."""
    if log["refusal"]:
        return f"refused: {log['refusal']}"
    requested = ", ".join(row["case"] for row in log["rows"] if row["wanted"])
    # Cases without a judgement are named, because nothing can be tuned for them.
    if not log["moves"]:
        reason = "the wanted rows pass as they are" if requested else "no row fails"
        parts = [f"nothing moved: {reason}"]
        for row in log["rows"]:
            if row["before"] in ("invalid", "not_tested"):
                parts.append(f"{status_text(row['before'])} {row['case']}")
        return "; ".join(parts)
    # The term that is farthest from the evidence.
    largest = max(log["moves"], key=lambda move: move["from_evidence"])
    size = f"{largest['from_evidence']:.2f} standard errors, {largest['term']}"
    wide = ""
    if log["bound"] > USUAL_BOUND:
        wide = (
            f" is a departure: beyond {USUAL_BOUND:g} standard errors flight contradicts a move, "
            f"and no term needed a rationale"
        )
    return (
        f"tuned for {requested}: distance {log['distance']:.2f} from the evidence, largest move "
        f"from it {size}; bound {log['bound']:g}{wide}"
    )


MOVES = ("term", "moved", "from evidence", "share", "nodes", "largest at", "rationale")
ROWS = ("test", "case", "wanted", "before", "ratio before", "after", "ratio after", "decided by")
NUMBERS = ("moved", "from evidence", "share", "nodes", "ratio before", "ratio after")


def moves_of(log: Mapping[str, Any]) -> tuple[list[tuple[str, ...]], str]:
    """Return the cells of `MOVES` for every term that a reader has to judge.

    These have at least `LEAST_SHARE` of the distance, a move of at least `LEAST_MOVE`, or a
    rationale. The largest move is always listed. The second result is a sentence on the other
    terms, empty if there are none.
    """
    largest = max((move["moved"] for move in log["moves"]), default=0.0)
    rows: list[tuple[str, ...]] = []
    others: list[Mapping[str, Any]] = []
    for move in log["moves"]:
        if _is_listed(move) or move["moved"] == largest:
            rows.append(_move_cells(move))
        else:
            others.append(move)
    if not others:
        return rows, ""
    terms = "terms" if len(others) > 1 else "term"
    each = "each " if len(others) > 1 else ""
    # The other terms together, so that no move is hidden.
    most = max(others, key=lambda move: move["moved"])
    share = sum(move["share"] for move in others)
    return rows, (
        f"{len(others)} further {terms}, {each}with less than {100.0 * LEAST_SHARE:g} % of the "
        f"distance and less than {LEAST_MOVE:g} standard errors: the largest move is "
        f"{most['moved']:.2f} standard errors ({most['term']}), together they have "
        f"{100.0 * share:.1f} % of the distance"
    )


def _is_listed(move: Mapping[str, Any]) -> bool:
    """Return whether a move is large enough for a row, or has a rationale."""
    size = max(move["moved"], move["from_evidence"])
    return abs(move["share"]) >= LEAST_SHARE or size >= LEAST_MOVE or bool(move["rationale"])


def _move_cells(move: Mapping[str, Any]) -> tuple[str, ...]:
    return (
        move["term"],
        f"{move['moved']:.2f}",
        f"{move['from_evidence']:.2f}",
        _share_text(move["share"]),
        str(move["nodes"]),
        move["at"],
        move["rationale"],
    )


def _share_text(share: float) -> str:
    """Return a share in percent; a small one is not printed as zero."""
    if abs(share) < LEAST_SHARE:
        return f"<{100.0 * LEAST_SHARE:g} %"
    return f"{round(100.0 * share)} %"


def log_rows(log: Mapping[str, Any]) -> list[tuple[str, ...]]:
    """Return the cells of `ROWS` for every case."""
    rows: list[tuple[str, ...]] = []
    for row in log["rows"]:
        cells = (
            row["id"],
            row["case"],
            "wanted" if row["wanted"] else "",
            status_text(row["before"]),
            _ratio_text(row["ratio_before"]),
            status_text(row["after"]),
            _ratio_text(row["ratio_after"]),
            row["criterion_after"] or row["criterion_before"],
        )
        rows.append(cells)
    return rows


def log_lines(log: Mapping[str, Any]) -> Iterator[str]:
    """Yield the text of a log (`Tuning.document`)."""
    yield outcome_sentence(log)
    moves, remark = moves_of(log)
    verb = "would move" if log["refusal"] else "moved"
    for term, size, from_evidence, share, count, position, rationale in moves:
        nodes = f"{count} nodes"
        if position:
            nodes = f"{count} nodes, most at {position}"
        text = (
            f"{term}: {verb} by {size} standard errors at most ({nodes}), "
            f"{from_evidence} from the evidence, {share} of the distance"
        )
        if rationale:
            text = f"{text}; rationale: {rationale}"
        yield text
    if remark:
        yield remark
    for test, case, mark, before, ratio_before, after, ratio_after, criterion in log_rows(log):
        suffix = f", {mark}" if mark else ""
        yield (
            f"{test} {case}: {before} -> {after}, {ratio_before} -> {ratio_after} x tolerance "
            f"({criterion}){suffix}"
        )


def read_log(path: str | os.PathLike) -> dict[str, Any]:
    """Return a log of ``aeromatch pom tune`` from its file.

    Raises
    ------
    FileNotFoundError
    SchemaError
        The file is not a log, lacks a part of it, or is the log of a refusal.
    """
    expected = "give tuning.json, as aeromatch pom tune writes it"
    try:
        log = json.loads(Path(path).read_text(encoding="utf-8"))
    except ValueError as error:
        raise SchemaError(str(path), [f"no JSON text ({error}); {expected}"]) from error
    kind = log.get("kind") if isinstance(log, dict) else None
    if kind != KIND:
        text = f"no log of a tuning (kind is {kind!r}, {KIND!r} is needed); {expected}"
        raise SchemaError(str(path), [text])
    # All missing parts in one error.
    problems = [f"{name} is missing" for name in sorted(_NEEDED - set(log))]
    for part, columns in (("moves", _OF_MOVES), ("rows", _OF_ROWS)):
        for k, item in enumerate(log.get(part, ())):
            missing = columns - set(item)
            if missing:
                problems.append(f"{part}[{k}] lacks {', '.join(sorted(missing))}")
    if problems:
        advice = "write the log again with aeromatch pom tune"
        raise SchemaError(str(path), [f"{problem}; {advice}" for problem in problems])
    if log["refusal"]:
        text = f"the log of a refusal, no model was tuned: {log['refusal']}"
        raise SchemaError(str(path), [text])
    return log


def _ratio_text(value: float | None) -> str:
    """Return a ratio with two decimals, or a dash if it is not finite."""
    if value is None or not math.isfinite(value):
        return MISSING
    return f"{value:.2f}"
