"""Cause of a mismatch: the term swaps of `pom.diagnose` in sentences and tables.

The section follows LR-743 section 5.2.
"""

from __future__ import annotations

import math
from collections.abc import Hashable, Mapping, Sequence
from typing import Any

import pandas as pd
from markupsafe import Markup

from pom.diagnosis.swap_judgement import LEAST_GAP, MATCHED
from pom.diagnosis.waterfall_steps import OTHERS, criteria_of
from pom.report.models.waterfall_figure import cause_figure
from pom.report.presentation.quantities import MISSING, fixed_decimals
from pom.report.presentation.term_words import term_words
from pom.report.presentation.verdict_text import Verdict, criterion_words
from pom.result import PomResult

# Share of the gap below which a single term is only counted, and a group is left out.
LEAST_SHOWN = 0.01
LEAST_WORSE = 0.005  # half widths: a step that raises the mismatch by less is not mentioned
# Share of the gap below which the interaction of a pair is not mentioned in the text.
LEAST_INTERACTION = 0.1
_TITLES = {
    "prior": "a-priori model",
    "single": "a-priori model with one term taken from the final model",
    "group": "a-priori model with a group of terms taken from the final model",
    "pair": "a-priori model with two terms taken from the final model: "
    "the pairs that interact most",
    "sequence": "corrected a-priori model: terms of the final model taken one after the other",
    "joint": "corrected model of all cases: without the terms added for this one, then with one "
    "after the other",
    "without": "final model without a term or group",
    "share": "fair split of the gap: what each term explains on average over all orders of taking "
    "them",
    "final": "final model",
}
# Greatest number of printed rows of a stage.
_MOST = {"single": 8, "group": 4, "pair": 3, "without": 5}
# The column of bars covers -20 to 120 % of the gap.
_LOW, _HIGH = -0.2, 1.2

_Row = Mapping[Hashable, Any]


def cause_section(result: PomResult, table: pd.DataFrame | None) -> dict[str, Any] | None:
    """Return the data of the template that shows the cause; None without a diagnosis.

    Parameters
    ----------
    result : PomResult
    table : DataFrame or None
        Table of `pom.diagnose` of the case.
    """
    if table is None or table.empty:
        return None
    criteria = [{"name": name, "words": criterion_words(name)} for name in criteria_of(table)]
    stages = []
    for stage, title in _TITLES.items():
        rows, hidden = _shown_rows(table, stage, criteria)
        if rows or hidden:
            named = stage not in ("prior", "final")
            stages.append({"title": title, "named": named, "rows": rows, "hidden": hidden})
    # Terms of coefficients are linked to their figures; parts of submodels have none.
    singles = [row["term"] for row in _stage_rows(table, "single")]
    return {
        "criteria": criteria,
        "stages": stages,
        "idle": _describe_idle_terms(table),
        "story": cause_sentences(table),
        "figure": Markup(cause_figure(table)),
        "linked": [term for term in singles if str(term).startswith("C")],
        "columns": 4 + 2 * len(criteria),
    }


def _shown_rows(
    table: pd.DataFrame, stage: str, criteria: Sequence[Mapping[str, Any]]
) -> tuple[list[dict[str, Any]], int]:
    """Return the rows of a stage that are shown, and the number of single terms that are not."""
    rows = _stage_rows(table, stage)
    chosen = []
    for row in rows:
        is_small = abs(row["explained"]) < LEAST_SHOWN
        if stage not in ("single", "group") or not is_small:
            chosen.append(row)
    chosen = chosen[: _MOST.get(stage, len(rows))]
    content = []
    start = 0.0
    for row in chosen:
        content.append(_row_content(row, start, criteria))
        # The bar of a sequence begins where the one before ends.
        if stage == "sequence":
            start = row["explained"]
    hidden = len(rows) - len(chosen) if stage == "single" else 0
    return content, hidden


def _describe_idle_terms(table: pd.DataFrame) -> str:
    """Return the terms that were not flown alone with their bounds; empty if all were flown."""
    rows = _stage_rows(table, "idle")
    if not rows:
        return ""
    # The first row is that of all idle terms together.
    together, *alone = rows
    terms = ", ".join([f"{row['term']} {_format_bound(row['bound'])}" for row in alone])
    count = f"{len(alone)} terms were"
    if len(alone) == 1:
        count = "1 term was"
    return (
        f"{count} not flown alone, since no judged output moves by more than this share of "
        f"its mismatch, by the measured sensitivity of the "
        f"coefficient or by the flight with all of them: {terms}. All together move "
        f"{_format_bound(together['bound'])}."
    )


def _format_bound(share: float) -> str:
    # Shares that would be rounded to zero are not printed as zero.
    if share == 0.0 or share >= 5e-5:
        return f"{fixed_decimals(100.0 * share, 2)} %"
    return "below 0.01 %"


def _stage_rows(table: pd.DataFrame, stage: str) -> list[dict[Hashable, Any]]:
    """Return the rows of a stage; pairs by falling interaction."""
    rows = table[table["stage"] == stage].to_dict("records")
    if stage == "pair":
        rows.sort(key=lambda row: -abs(row["interaction"]))
    return rows


def cause_sentences(table: pd.DataFrame) -> str:
    """Return the cause in a few sentences.

    Parameters
    ----------
    table : DataFrame
        Table of `pom.diagnose` of a case.
    """
    stages = {stage: _stage_rows(table, stage) for stage in _TITLES}
    if not stages["prior"]:
        return ""
    verdict = stages["prior"][0]["verdict"]
    if verdict == "not_tested":
        return "No criterion of this case carries a verdict, so there is no mismatch to explain."
    joint = _describe_joint(stages["joint"])
    level = ""
    if stages["single"]:
        level = _describe_small_gap(stages["prior"], stages["final"])
    # Within tolerance the cause is not named, but the size of the gap counts.
    if verdict in MATCHED:
        sentence = (
            "The a-priori model is within tolerance; no term has to be taken from the final model."
        )
        return " ".join(filter(None, (sentence, level, joint)))

    state = "could not be judged" if verdict == "invalid" else "is out of tolerance"
    sentences = [f"The a-priori model {state}."]
    sentences.append(level or _describe_singles(stages["single"]))
    if stages["sequence"]:
        sentences.append(_describe_sequence(stages["sequence"]))
        start = stages["prior"][0]["mismatch"]
        sentences += _describe_worse_steps(stages["sequence"], start, stages["pair"])
    if joint:
        sentences.append(joint)
    pairs = stages["pair"]
    if pairs and abs(pairs[0]["interaction"]) >= LEAST_INTERACTION:
        alone = {row["term"]: row["explained"] for row in stages["single"]}
        sentences.append(_describe_interaction(pairs[0], alone))
    sentences += _describe_opposed_shares(stages["share"])
    return " ".join(sentences)


def _describe_small_gap(prior: Sequence[_Row], final: Sequence[_Row]) -> str:
    """Return why no shares are stated if both mismatches are nearly the same; else empty."""
    if not prior or not final:
        return ""
    start, stop = prior[0]["mismatch"], final[0]["mismatch"]
    if not abs(start - stop) < LEAST_GAP:
        return ""
    subject = "The final model is not clearly better"
    if prior[0]["verdict"] in MATCHED and final[0]["verdict"] in MATCHED:
        subject = "Both models match the flight"
    return (
        f"{subject}: the mismatches of {fixed_decimals(start, 2)} and {fixed_decimals(stop, 2)} "
        f"half widths differ by less than {LEAST_GAP:g}, so shares of the gap are not stated."
    )


def _describe_worse_steps(rows: Sequence[_Row], start: float, pairs: Sequence[_Row]) -> list[str]:
    """Return a sentence on every step of the sequence that makes the mismatch larger."""
    sentences = []
    for row in rows:
        # A rounding error is not a step back.
        if row["mismatch"] - start > LEAST_WORSE:
            text = (
                f"The sequence makes the match worse on the way: {row['term']} raises the mismatch "
                f"from {fixed_decimals(start, 2)} to {fixed_decimals(row['mismatch'], 2)} half "
                f"widths"
            )
            sentences.append(f"{text}{_describe_opposing_pair(str(row['term']), pairs)}.")
        start = row["mismatch"]
    return sentences


def _describe_opposing_pair(term: str, pairs: Sequence[_Row]) -> str:
    """Return the term whose effect opposes that of `term` most, with the correlation."""
    opposing: dict[str, float] = {}
    for row in pairs:
        names = str(row["term"]).split(" + ")
        correlation = row.get("correlation", math.nan)
        if term in names and correlation < 0.0:
            names.remove(term)
            opposing[names[0]] = correlation
    if not opposing:
        return ""
    partner = min(opposing, key=lambda name: opposing[name])
    return (
        f", because it and {partner} compensate each other (correlation of their effects on the "
        f"judged outputs {fixed_decimals(opposing[partner], 2)})"
    )


def _describe_opposed_shares(rows: Sequence[_Row]) -> list[str]:
    """Return a sentence on shares below 0 or above 100 %, with the effects that oppose."""
    shares = {row["term"]: row["explained"] for row in rows}
    sentences, named = [], set()
    for row in rows:
        partner = row.get("partner") or ""
        key = frozenset((row["term"], partner))
        if not partner or key in named:
            continue
        named.add(key)
        sentences.append(
            f"The shares of {row['term']} ({_format_share(row['explained'])}) and {partner} "
            f"({_format_share(shares[partner])}) belong together: their effects on the judged "
            f"outputs oppose each other (correlation {fixed_decimals(row['correlation'], 2)}), so "
            f"neither share alone states how wrong its term is."
        )
    return sentences


def _describe_singles(rows: Sequence[_Row]) -> str:
    """Return the sentence on the single term that explains most."""
    for row in rows:
        if row["explained"] >= LEAST_SHOWN:
            return (
                f"Of single terms of the final model the {_name_term(row['term'])} explains most "
                f"of the gap, {_format_share(row['explained'])}."
            )
    if rows:
        return "No single term of the final model brings it nearer to the flight."
    return "Nothing that this case feels differs between the two models."


def _describe_sequence(rows: Sequence[_Row]) -> str:
    """Return the sentence on the terms of the corrected model of this case."""
    last = rows[-1]
    if last["verdict"] in MATCHED:
        state = "is within tolerance"
        if last["verdict"] == "limits_exceeded":
            state += " with a trim beyond its limits"
    else:
        state = f"explains {_format_share(last['explained'])} and is still out of tolerance"
    terms = [row["term"] for row in rows]
    listed = _list_names(terms)
    if len(terms) == 1:
        listed = f"the {_name_term(terms[0])}"
    return f"With {listed} from the final model, the corrected a-priori model {state}."


def _describe_joint(rows: Sequence[_Row]) -> str:
    """Return the sentence on the terms that the corrected model of all cases takes for this one.

    Without such terms the text is empty.
    """
    if not rows:
        return ""
    # The first row is the model without the terms that were added for this case.
    before = {
        "pass": "within tolerance",
        "limits_exceeded": "within tolerance with a trim beyond its limits",
        "invalid": "not judged",
    }
    state = before.get(rows[0]["verdict"], "out of tolerance")
    added = [str(row["term"]) for row in rows if row["term"]]
    verb = "make" if len(added) > 1 else "makes"
    after = "as good as the final model"
    if rows[-1]["verdict"] == "pass":
        after = "pass"
    return (
        f"With the sequences of all cases together the corrected model is {state} here; "
        f"{_list_names(added)}, added for this case, {verb} it {after}."
    )


def _list_names(names: Sequence[str]) -> str:
    if len(names) == 1:
        return names[0]
    return f"{', '.join(names[:-1])} and {names[-1]}"


def _describe_interaction(pair: _Row, alone: Mapping[str, float]) -> str:
    """Return the sentence on the pair that interacts most."""
    first, second = str(pair["term"]).split(" + ")
    parts = f"{_format_share(alone[first])} and {_format_share(alone[second])}"
    return (
        f"Terms do not simply add up: {first} and {second} explain {parts} alone, "
        f"{_format_share(pair['explained'])} together."
    )


def _name_term(term: str) -> str:
    meaning = term_words(term)
    # An unknown name has no words.
    return f"{meaning} ({term})" if meaning else f"term {term}"


def _format_share(share: float, stderr: float = 0.0) -> str:
    """Return a share of the gap in percent; a dash if it is not finite."""
    if not math.isfinite(share):
        return MISSING
    text = fixed_decimals(100.0 * share, 0)
    if stderr > 0.0:
        text += f" ± {fixed_decimals(100.0 * stderr, 0)}"
    return f"{text} %"


def _row_content(row: _Row, start: float, criteria: Sequence[Mapping[str, Any]]) -> dict[str, Any]:
    """Return the cells of a row; its bar begins at `start`, a share of the gap."""
    term, is_share = str(row["term"]), row["stage"] == "share"
    cells = []
    for criterion in criteria:
        name = criterion["name"]
        cells.append(_format_share(row[f"{name} explained"], row[f"{name} stderr"]))
        # An average over all orders is not a flight, so it has neither ratio nor verdict.
        cells.append("" if is_share else fixed_decimals(row[f"{name} ratio"], 2))
    names = term.split(" + ")
    meanings = [term_words(name) for name in names]
    return {
        "term": term,
        "names": ["all others"] if term == OTHERS else names,
        "words": " and ".join([meaning for meaning in meanings if meaning]),
        "explained": _format_share(row["explained"], row["stderr"]),
        "bar": _bar_extent(start, row["explained"]) if term else None,
        "verdict": None if is_share else Verdict.of(row["verdict"]),
        "cells": cells,
    }


def _bar_extent(start: float, stop: float) -> tuple[float, float] | None:
    """Return left end and width of a bar, in percent of the column."""
    if not (math.isfinite(start) and math.isfinite(stop)):
        return None
    low, high = sorted((start, stop))
    left_end, right_end = _column_percent(low), _column_percent(high)
    # A bar has a width that is visible.
    return round(left_end, 1), round(max(right_end - left_end, 0.6), 1)


def _column_percent(share: float) -> float:
    return 100.0 * (min(max(share, _LOW), _HIGH) - _LOW) / (_HIGH - _LOW)
