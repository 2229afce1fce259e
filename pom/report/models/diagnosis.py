"""The cause of a mismatch: the term swaps of `pom.diagnose` in words, numbers and bars, after LR-743 section 5.2."""

from __future__ import annotations

import math
from collections.abc import Hashable, Mapping, Sequence
from typing import Any

import pandas as pd
from markupsafe import Markup

from pom.diagnosis.swap_table import MATCHED, OTHERS, criteria_of
from pom.result import PomResult

from ..presentation.quantities import MISSING, fixed
from ..presentation.term_names import term_words
from ..presentation.verdict_text import Verdict, words
from .waterfall import cause_figure

LEAST_SHOWN = 0.01  # a single term that explains less is counted only, a group is left out
LEAST_INTERACTION = 0.1  # of the gap: a pair with less interaction is not mentioned in the text
_TITLES = {
    "prior": "a-priori model",
    "single": "a-priori model with one term taken from the final model",
    "group": "a-priori model with a group of terms taken from the final model",
    "pair": "a-priori model with two terms taken from the final model: the pairs that interact most",
    "sequence": "corrected a-priori model: terms of the final model taken one after the other",
    "joint": "corrected model of all cases: without the terms added for this one, then with one after the other",
    "without": "final model without a term or group",
    "share": "fair split of the gap: what each term explains on average over all orders of taking them",
    "final": "final model",
}
_MOST = {"single": 8, "group": 4, "pair": 3, "without": 5}  # rows shown
# the bars run from -20 to 120 % of the gap
_LOW, _HIGH = -0.2, 1.2


def cause(result: PomResult, table: pd.DataFrame | None) -> dict[str, Any] | None:
    """Return everything the template needs to show the cause, or nothing without a diagnosis."""
    if table is None or table.empty:
        return None
    criteria = [{"name": name, "words": words(name)} for name in criteria_of(table)]
    by_stage = {stage: _rows(table, stage) for stage in _TITLES}
    stages = []
    for stage, title in _TITLES.items():
        rows = by_stage[stage]
        felt = [row for row in rows if stage not in ("single", "group") or not abs(row["explained"]) < LEAST_SHOWN]
        kept = felt[: _MOST.get(stage, len(rows))]
        starts = [0.0, *(row["explained"] for row in rows)] if stage == "sequence" else [0.0] * (len(rows) + 1)
        shown = [_row(row, start, criteria) for row, start in zip(kept, starts, strict=False)]
        hidden = len(rows) - len(kept) if stage == "single" else 0
        if shown or hidden:
            stages.append({"title": title, "named": stage not in ("prior", "final"), "rows": shown, "hidden": hidden})
    return {
        "criteria": criteria,
        "stages": stages,
        "idle": _idle(table),
        "story": story(table),
        "figure": Markup(cause_figure(table)),
        "linked": [row["term"] for row in by_stage["single"] if str(row["term"]).startswith("C")],  # terms of coefficients, no parts
        "columns": 4 + 2 * len(criteria),
    }


def _idle(table: pd.DataFrame) -> str:
    """Return which terms were not flown alone, and what they can move; empty where all were."""
    rows = _rows(table, "idle")
    if not rows:
        return ""
    together, *alone = rows
    terms = ", ".join(f"{row['term']} {_bounded(row['bound'])}" for row in alone)
    some = "1 term was" if len(alone) == 1 else f"{len(alone)} terms were"
    return (
        f"{some} not flown alone, since no judged output moves by more than this share of its mismatch, by the measured sensitivity of the "
        f"coefficient or by the flight with all of them: {terms}. All together move {_bounded(together['bound'])}."
    )


def _bounded(share: float) -> str:
    return f"{fixed(100.0 * share, 2)} %" if share == 0.0 or share >= 5e-5 else "below 0.01 %"


def _rows(table: pd.DataFrame, stage: str) -> list[dict[Hashable, Any]]:
    rows = table[table["stage"] == stage].to_dict("records")
    return sorted(rows, key=lambda row: -abs(row["interaction"])) if stage == "pair" else rows


def story(table: pd.DataFrame) -> str:
    """Return the cause in a few sentences."""
    by = {stage: _rows(table, stage) for stage in _TITLES}
    if not by["prior"]:
        return ""
    if by["prior"][0]["verdict"] in MATCHED:
        more = f" {_joint(by['joint'])}" if by["joint"] else ""
        return f"The a-priori model is within tolerance; no term has to be taken from the final model.{more}"
    if by["prior"][0]["verdict"] == "not_tested":
        return "No criterion of this case carries a verdict, so there is no mismatch to explain."
    sentences = [f"The a-priori model {'could not be judged' if by['prior'][0]['verdict'] == 'invalid' else 'is out of tolerance'}."]
    singles = [row for row in by["single"] if row["explained"] >= LEAST_SHOWN]
    if singles:
        best = singles[0]
        sentences.append(
            f"Of single terms of the final model the {_called(best['term'])} explains most of the gap, {_percent(best['explained'])}."
        )
    elif by["single"]:
        sentences.append("No single term of the final model brings it nearer to the flight.")
    else:
        sentences.append("Nothing that this case feels differs between the two models.")
    if by["sequence"]:
        chosen, last = [row["term"] for row in by["sequence"]], by["sequence"][-1]
        beyond = " with a trim beyond its limits" if last["verdict"] == "limits_exceeded" else ""
        missed = f"explains {_percent(last['explained'])} and is still out of tolerance"
        state = f"is within tolerance{beyond}" if last["verdict"] in MATCHED else missed
        taken = _called(chosen[0]) if len(chosen) == 1 else _listed(chosen)
        sentences.append(f"With {'the ' if len(chosen) == 1 else ''}{taken} from the final model, the corrected a-priori model {state}.")
    if by["joint"]:
        sentences.append(_joint(by["joint"]))
    if by["pair"] and abs(by["pair"][0]["interaction"]) >= LEAST_INTERACTION:
        sentences.append(_interaction(by["pair"][0], {row["term"]: row["explained"] for row in by["single"]}))
    return " ".join(sentences)


def _joint(rows: Sequence[Mapping[Hashable, Any]]) -> str:
    """Return the sentence about what the corrected model of all cases takes for this one."""
    added = [str(row["term"]) for row in rows if row["term"]]
    before = {"pass": "within tolerance", "limits_exceeded": "within tolerance with a trim beyond its limits", "invalid": "not judged"}
    made = "make" if len(added) > 1 else "makes"
    after = f"{made} it pass" if rows[-1]["verdict"] == "pass" else f"{made} it as good as the final model"
    state = before.get(rows[0]["verdict"], "out of tolerance")
    return f"With the sequences of all cases together the corrected model is {state} here; {_listed(added)}, added for this case, {after}."


def _listed(names: Sequence[str]) -> str:
    return f"{', '.join(names[:-1])} and {names[-1]}" if len(names) > 1 else names[0]


def _interaction(pair: Mapping[Hashable, Any], alone: Mapping[str, float]) -> str:
    """Return the sentence about the pair that interacts most."""
    one, other = str(pair["term"]).split(" + ")
    parts = f"{_percent(alone[one])} and {_percent(alone[other])}"
    return f"Terms do not simply add up: {one} and {other} explain {parts} alone, {_percent(pair['explained'])} together."


def _called(term: str) -> str:
    meaning = term_words(term)
    return f"{meaning} ({term})" if meaning else f"term {term}"


def _percent(share: float, stderr: float = 0.0) -> str:
    error = f" ± {fixed(100.0 * stderr, 0)}" if stderr > 0.0 else ""
    return f"{fixed(100.0 * share, 0)}{error} %" if math.isfinite(share) else MISSING


def _row(row: Mapping[Hashable, Any], start: float, criteria: Sequence[Mapping[str, Any]]) -> dict[str, Any]:
    term, is_share = str(row["term"]), row["stage"] == "share"
    cells = []
    for c in criteria:
        cells += [
            _percent(row[f"{c['name']} explained"], row[f"{c['name']} stderr"]),
            "" if is_share else fixed(row[f"{c['name']} ratio"], 2),
        ]
    return {
        "term": term,
        "names": ["all others"] if term == OTHERS else term.split(" + "),
        "words": " and ".join(filter(None, map(term_words, term.split(" + ")))),
        "explained": _percent(row["explained"], row["stderr"]),
        "bar": _bar(start, row["explained"]) if term else None,
        "verdict": None if is_share else Verdict.of(row["verdict"]),
        "cells": cells,
    }


def _bar(start: float, stop: float) -> tuple[float, float] | None:
    """Return left end and width of a bar, in percent of the column; a sequence's bar begins where the one before ends."""
    if not (math.isfinite(start) and math.isfinite(stop)):
        return None
    a, b = (100.0 * (min(max(x, _LOW), _HIGH) - _LOW) / (_HIGH - _LOW) for x in sorted((start, stop)))
    return round(a, 1), round(max(b - a, 0.6), 1)
