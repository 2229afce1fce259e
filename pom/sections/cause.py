"""The cause of a miss: the term swaps of `pom.diagnose` in words, numbers and bars, as LR-743 section 5.2 tells them."""

from __future__ import annotations

import math
from collections.abc import Hashable, Mapping, Sequence
from typing import Any

import pandas as pd

from pom.result import PomResult

from .quantities import MISSING, fixed
from .term_words import term_words
from .verdicts import Verdict, words

LEAST_SHOWN = 0.01  # a single term that closes less is counted only
MOST_SHOWN = 8  # single terms
_TITLES = {
    "prior": "a-priori model",
    "single": "a-priori model with one term taken from the final model",
    "sequence": "corrected a-priori model: terms of the final model taken one after the other",
    "final": "final model",
}
# the bars run from -20 to 120 % of the gap
_LOW, _HIGH = -0.2, 1.2


def cause(result: PomResult, table: pd.DataFrame | None) -> dict[str, Any] | None:
    """Return everything the template needs to tell the cause, or nothing without a diagnosis."""
    if table is None or table.empty:
        return None
    names = [str(c).removesuffix(" ratio") for c in table.columns if str(c).endswith(" ratio")]
    traces = {c.name for c in result.case.criteria if c.measure == "trace"}
    criteria: list[dict[str, Any]] = [{"name": name, "words": words(name), "is_trace": name in traces} for name in names]
    stages = []
    for stage, title in _TITLES.items():
        rows = table[table["stage"] == stage].to_dict("records")
        kept = [row for row in rows if stage != "single" or not abs(row["closes"]) < LEAST_SHOWN][:MOST_SHOWN]
        starts = [0.0, *(row["closes"] for row in rows)] if stage == "sequence" else [0.0] * (len(rows) + 1)
        shown = [_row(row, start, criteria) for row, start in zip(kept, starts, strict=False)]
        if rows:
            stages.append({"title": title, "named": stage in ("single", "sequence"), "rows": shown, "hidden": len(rows) - len(kept)})
    return {"criteria": criteria, "stages": stages, "story": story(table), "columns": 4 + sum(2 if c["is_trace"] else 1 for c in criteria)}


def story(table: pd.DataFrame) -> str:
    """Return the cause in a few sentences."""
    by = {stage: table[table["stage"] == stage].to_dict("records") for stage in _TITLES}
    if not by["prior"]:
        return ""
    if by["prior"][0]["verdict"] == "pass":
        return "The a-priori model is within tolerance; no term has to be taken from the final model."
    said = ["The a-priori model is out of tolerance."]
    singles = [row for row in by["single"] if row["closes"] >= LEAST_SHOWN]
    if not singles:
        return " ".join([*said, "No single term of the final model brings it nearer to the flight."])
    best = singles[0]
    said.append(f"Of single terms of the final model the {_called(best['term'])} closes most of the gap, {_percent(best['closes'])}.")
    if by["sequence"]:
        chosen, last = [row["term"] for row in by["sequence"]], by["sequence"][-1]
        state = "is within tolerance" if last["verdict"] == "pass" else f"closes {_percent(last['closes'])} and is still out of tolerance"
        taken = _called(chosen[0]) if len(chosen) == 1 else f"{', '.join(chosen[:-1])} and {chosen[-1]}"
        said.append(f"With {'the ' if len(chosen) == 1 else ''}{taken} from the final model, the corrected a-priori model {state}.")
    return " ".join(said)


def _called(term: str) -> str:
    said = term_words(term)
    return f"{said} ({term})" if said else f"term {term}"


def _percent(share: float) -> str:
    return f"{fixed(100.0 * share, 0)} %" if math.isfinite(share) else MISSING


def _row(row: Mapping[Hashable, Any], start: float, criteria: Sequence[Mapping[str, Any]]) -> dict[str, Any]:
    cells = [fixed(row[f"{c['name']} {what}"], 2) for c in criteria for what in (("miss", "ratio") if c["is_trace"] else ("ratio",))]
    term = str(row["term"])
    return {
        "term": term,
        "words": term_words(term),
        "closes": _percent(row["closes"]),
        "bar": _bar(start, row["closes"]) if term else None,
        "verdict": Verdict.of(row["verdict"]),
        "cells": cells,
    }


def _bar(start: float, stop: float) -> tuple[float, float] | None:
    """Return left end and width of a bar, in percent of the column; a sequence's bar begins where the one before ends."""
    if not (math.isfinite(start) and math.isfinite(stop)):
        return None
    a, b = (100.0 * (min(max(x, _LOW), _HIGH) - _LOW) / (_HIGH - _LOW) for x in sorted((start, stop)))
    return round(a, 1), round(max(b - a, 0.6), 1)
