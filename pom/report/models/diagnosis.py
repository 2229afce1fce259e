"""The cause of a mismatch: the term swaps of `pom.diagnose` in words, numbers and bars, after
LR-743 section 5.2.
"""

from __future__ import annotations

import math
from collections.abc import Collection, Hashable, Mapping, Sequence
from dataclasses import dataclass
from html import escape
from typing import Any

import pandas as pd
from markupsafe import Markup

from flightmech.support import figures as svg_chart
from flightmech.support.figures import Frame
from pom.diagnosis.swap_judgement import MATCHED
from pom.diagnosis.tuning.tuning_log import (
    BASES,
    MOVES,
    NUMBERS,
    ROWS,
    log_rows,
    moves_of,
    outcome_sentence,
)
from pom.diagnosis.waterfall import OTHERS, criteria_of, waterfall
from pom.report.presentation.quantities import MISSING, fixed_decimals, term_words
from pom.report.presentation.verdict_text import Verdict, criterion_words
from pom.report.submodels.section import SectionTable
from pom.result import PomResult, status_text

MOST_PANELS = 4  # criteria next to the total
LEAST_NAMED = 0.005  # of the gap: smaller shares are left out of the alternative text
_NAMES, _TOTAL, _GAP = (
    116.0,
    210.0,
    10.0,
)  # widths of the names, of the panel of the total with its numbers, between panels
_NUMBER, _WITH_ERROR = 36.0, 58.0  # width of the numbers next to a panel
_HEAD, _ROW, _BAR = 36.0, 17.0, 10.0
_LEGEND = (
    ("run-2-area", "explains, taken by the corrected model"),
    ("band", "explains, not needed"),
    ("exit", "adds to the mismatch"),
)


@dataclass(frozen=True)
class _Bar:
    """One row of a panel: from `start` to `stop`, with what stands next to it."""

    start: float
    stop: float
    css: str
    words: str
    stderr: float = 0.0


def cause_figure(table: pd.DataFrame) -> str:
    """Return the waterfall as SVG with its alternative text; empty when the diagnosis has no
    shares.

    One row per term, first the a-priori model, last the final one.  A bar begins where the one
    above it ends; solid: a term that the corrected model takes; open: not needed; hatched: it adds
    to the mismatch.  Whiskers: one standard error of a sampled share.
    """
    total = waterfall(table)
    if total.empty:
        return ""
    needed = set(table.loc[table["stage"].isin(["sequence", "joint"]), "term"])
    bottom = _HEAD + _ROW * (len(total) + 2)
    body = [_names(total, needed), *_panels(table, total, needed, bottom), _legend(bottom + 38.0)]
    return svg_chart.make_svg_figure(bottom + 44.0, "".join(body), waterfall_text(table))


def waterfall_text(table: pd.DataFrame) -> str:
    """Return the waterfall in words, for those who cannot see it."""
    sentences = []
    for name in ("", *_shown(table)):
        steps = waterfall(table, name)
        large = [step for step in steps.to_dict("records") if abs(step["explained"]) >= LEAST_NAMED]
        parts = [
            f"{_bar_name(step['term'])} {_share(step['explained'], step['stderr'])}"
            for step in large
        ]
        way = (
            f"{fixed_decimals(steps['start'].iloc[0], 2)} to "
            f"{fixed_decimals(steps['stop'].iloc[-1], 2)} half widths"
        )
        sentences.append(
            f"{name.replace('_', ' ') or 'all criteria'}, from {way}: "
            f"{', '.join(parts) or 'no share of half a percent'}"
        )
    return (
        f"Waterfall of the mismatch from the a-priori to the final model. {'. '.join(sentences)}."
    )


def _shown(table: pd.DataFrame) -> list[str]:
    """Return the criteria that have a gap, the largest mismatch of the a-priori model first; none
    when there is but one criterion.
    """
    found = {name: waterfall(table, name) for name in criteria_of(table)}
    shown = [
        name for name, steps in found.items() if len(found) > 1 and steps["explained"].notna().all()
    ]
    return sorted(shown, key=lambda name: -found[name]["start"].iloc[0])[:MOST_PANELS]


def _panels(
    table: pd.DataFrame, total: pd.DataFrame, needed: Collection[str], bottom: float
) -> list[str]:
    shown = _shown(table)
    number = _WITH_ERROR if (total["stderr"] > 0.0).any() else _NUMBER
    width = _TOTAL if shown else svg_chart.WIDTH - _NAMES
    names = criteria_of(table)
    title = "all criteria" if len(names) > 1 else names[0].replace("_", " ")
    drawn = [_panel(title, total, needed, (_NAMES, width - number - _GAP, bottom), True)]
    each = (svg_chart.WIDTH - _NAMES - width) / max(len(shown), 1)
    for k, name in enumerate(shown):
        place = _NAMES + width + k * each, each - _NUMBER - _GAP, bottom
        drawn.append(_panel(name.replace("_", " "), waterfall(table, name), needed, place, False))
    return drawn


def _panel(
    title: str,
    steps: pd.DataFrame,
    needed: Collection[str],
    place: tuple[float, float, float],
    main: bool,
) -> str:
    """Return one column: title, scale and bars; `place` is left edge, width and lower edge."""
    first, last = steps["start"].iloc[0], steps["stop"].iloc[-1]
    bars = [_Bar(0.0, first, "run-1-area", fixed_decimals(first, 2))]
    for step in steps.to_dict("records"):
        start, stop, stderr = step["start"], step["stop"], step["stderr"]
        css = "exit" if stop > start else "run-2-area" if step["term"] in needed else "band"
        bars.append(
            _Bar(
                start,
                stop,
                css,
                _share(step["explained"], stderr if main else 0.0),
                stderr * abs(first - last),
            )
        )
    bars.append(_Bar(0.0, last, "run-3-area", fixed_decimals(last, 2)))
    left, width, bottom = place
    ends = [
        end
        for bar in bars
        for end in (
            bar.start - bar.stderr,
            bar.stop - bar.stderr,
            bar.start + bar.stderr,
            bar.stop + bar.stderr,
        )
    ]
    frame = Frame(
        left, _HEAD, width, bottom - _HEAD, (min(0.0, *ends), 1.02 * max(ends)), (0.0, 1.0)
    )
    lines = _two_lines(title, 20 if main else max(int((width + _NUMBER) / 5.6), 8))
    heading = [
        svg_chart.draw_text(left, _HEAD - 8.0 - 12.0 * (len(lines) - 1 - k), line)
        for k, line in enumerate(lines)
    ]
    below = (
        svg_chart.draw_text(
            left, bottom + 26.0, "mismatch, in half widths of the tolerance", "caption"
        )
        if main
        else ""
    )
    return "".join(
        [
            *heading,
            _scale(frame),
            *(_bar_row(frame, k, bar) for k, bar in enumerate(bars)),
            _joints(frame, bars),
            below,
        ]
    )


def _scale(frame: Frame) -> str:
    marks = svg_chart.choose_ticks(*frame.x, max(2, int(frame.width / 40)))
    grid = "".join(f"M{frame.px(mark):.1f},{frame.top:.1f}v{frame.height:.1f}" for mark in marks)
    words = "".join(
        svg_chart.draw_text(float(frame.px(v)), frame.bottom + 12, w)
        for v, w in zip(marks, svg_chart.tick_text(marks), strict=True)
    )
    zero = float(frame.px(0.0))
    axis = svg_chart.draw_line(zero, frame.top, zero, frame.bottom, "frame")
    return f'<path class="grid" d="{grid}"/>{axis}<g class="tick" text-anchor="middle">{words}</g>'


def _bar_row(frame: Frame, k: int, bar: _Bar) -> str:
    """Return the bar of row `k`, its whisker, and the number next to the panel."""
    a, b = sorted((float(frame.px(bar.start)), float(frame.px(bar.stop))))
    middle = frame.top + _ROW * (k + 0.5)
    parts = [
        svg_chart.draw_rectangle(
            a,
            middle - 0.5 * _BAR,
            max(b - a, 0.8),
            _BAR,
            f"{bar.css} frame" if bar.css == "band" else bar.css,
        )
    ]
    if bar.stderr > 0.0:
        low, high = (float(frame.px(bar.stop + side * bar.stderr)) for side in (-1.0, 1.0))
        parts.append(
            f'<path class="frame" d="M{low:.1f},{middle - 3:.1f}v6m0,-3H{high:.1f}m0,-3v6"/>'
        )
    parts.append(svg_chart.draw_text(frame.right + _GAP - 4.0, middle + 3.8, bar.words, "tick"))
    return "".join(parts)


def _joints(frame: Frame, bars: list[_Bar]) -> str:
    """Return the short lines from the end of each bar to the next one."""
    places = [
        (float(frame.px(bar.stop)), frame.top + _ROW * (k + 0.5) + 0.5 * _BAR)
        for k, bar in enumerate(bars[:-1])
    ]
    return (
        f'<path class="frame" '
        f'd="{"".join(f"M{x:.1f},{y:.1f}v{_ROW - _BAR:.1f}" for x, y in places)}"/>'
    )


def _names(steps: pd.DataFrame, needed: Collection[str]) -> str:
    words = [
        ("a-priori model", False),
        *((_bar_name(term), term in needed) for term in steps["term"]),
        ("final model", False),
    ]
    lines = []
    for k, (text, strong) in enumerate(words):
        style = ' style="font-weight:600"' if strong else ""
        place = f'x="{_NAMES - 7:.0f}" y="{_HEAD + _ROW * (k + 0.5) + 3.8:.1f}" text-anchor="end"'
        lines.append(f"<text {place}><tspan{style}>{escape(text)}</tspan></text>")
    return "".join(lines)


def _legend(y: float) -> str:
    parts, x = [], svg_chart.WIDTH
    for css, label in reversed(_LEGEND):
        x -= 6.6 * len(label) + 22.0  # a wide font, as DejaVu Sans
        parts.append(
            svg_chart.draw_rectangle(
                x, y - 9.0, 14.0, _BAR, f"{css} frame" if css == "band" else css
            )
        )
        parts.append(svg_chart.draw_text(x + 18.0, y, label, "caption"))
    return "".join(parts)


def _bar_name(term: str) -> str:
    return "all others" if term == OTHERS else term


def _share(explained: float, stderr: float) -> str:
    error = f" ± {fixed_decimals(100.0 * stderr, 0)}" if stderr > 0.0 else ""
    return f"{fixed_decimals(100.0 * explained, 0)}{error} %" if math.isfinite(explained) else ""


def _two_lines(words: str, most: int) -> list[str]:
    """Return a title broken once, at a space, when it is longer than `most` characters."""
    if len(words) <= most or " " not in words:
        return [words]
    cuts = [k for k, letter in enumerate(words) if letter == " "]
    cut = min(cuts, key=lambda k: abs(k - len(words) / 2.0))
    return [words[:cut], words[cut + 1 :]]


FLOWN = "in this report"
NOTE = (
    "Standard errors are those of the evidence. The tuned model is the one at the least "
    "Mahalanobis distance from it with which the wanted "
    "cases pass and no other ceases to; a term goes beyond the bound only where a rationale "
    "is written. moved: largest change of a node "
    "against the model before; share: of the squared distance from that model; nodes: those "
    "that moved by more than 0.01; ratio: of the "
    "criterion that decides, to its tolerance."
)


def tuning_context(
    tunings: Mapping[str, Mapping[str, Any]], results: Sequence[PomResult]
) -> list[dict[str, Any]]:
    """Return per tuned model its outcome in a sentence, what moved, the rows, and further words."""
    return [_of(run, log, results) for run, log in tunings.items()]


def _of(run: str, log: Mapping[str, Any], results: Sequence[PomResult]) -> dict[str, Any]:
    moves, rest = moves_of(log)
    flown = {result.case.name: _flown(result, run) for result in results if run in result.runs}
    rows = tuple((*cells, flown.get(cells[1], MISSING)) for cells in log_rows(log))
    grids = [SectionTable("What moved", MOVES, tuple(moves))] if moves else []
    grids.append(SectionTable("What it did to every case", (*ROWS, FLOWN), rows))
    files = ", ".join(
        f"{role} {file['name']} ({file['sha256'][:16]})"
        for role, file in log["files"].items()
        if role in BASES
    )
    remarks = [*([rest] if rest else []), f"files, SHA-256: {files}"]
    return {
        "run": run,
        "headline": outcome_sentence(log),
        "grids": grids,
        "remarks": remarks,
        "numbers": {*NUMBERS, FLOWN},
    }


def _flown(result: PomResult, run: str) -> str:
    worst = result.worst(run)
    return (
        f"{fixed_decimals(worst['worst_ratio'], 2)} {status_text(result.status(run))}"
        if worst is not None
        else status_text(result.status(run))
    )


LEAST_SHOWN = 0.01  # a single term that explains less is counted only, a group is left out
LEAST_INTERACTION = 0.1  # of the gap: a pair with less interaction is not mentioned in the text
_TITLES = {
    "prior": "a-priori model",
    "single": "a-priori model with one term taken from the final model",
    "group": "a-priori model with a group of terms taken from the final model",
    "pair": "a-priori model with two terms taken from the final model: the pairs that interact most",
    "sequence": "corrected a-priori model: terms of the final model taken one after the other",
    "joint": "corrected model of all cases: without the terms added for this one, then with one "
    "after the other",
    "without": "final model without a term or group",
    "share": "fair split of the gap: what each term explains on average over all orders of taking "
    "them",
    "final": "final model",
}
_MOST = {"single": 8, "group": 4, "pair": 3, "without": 5}  # rows shown
# the bars run from -20 to 120 % of the gap
_LOW, _HIGH = -0.2, 1.2


def cause_section(result: PomResult, table: pd.DataFrame | None) -> dict[str, Any] | None:
    """Return everything the template needs to show the cause, or nothing without a diagnosis."""
    if table is None or table.empty:
        return None
    criteria = [{"name": name, "words": criterion_words(name)} for name in criteria_of(table)]
    by_stage = {stage: _rows(table, stage) for stage in _TITLES}
    stages = []
    for stage, title in _TITLES.items():
        rows = by_stage[stage]
        felt = [
            row
            for row in rows
            if stage not in ("single", "group") or not abs(row["explained"]) < LEAST_SHOWN
        ]
        kept = felt[: _MOST.get(stage, len(rows))]
        starts = (
            [0.0, *(row["explained"] for row in rows)]
            if stage == "sequence"
            else [0.0] * (len(rows) + 1)
        )
        shown = [_row(row, start, criteria) for row, start in zip(kept, starts, strict=False)]
        hidden = len(rows) - len(kept) if stage == "single" else 0
        if shown or hidden:
            stages.append(
                {
                    "title": title,
                    "named": stage not in ("prior", "final"),
                    "rows": shown,
                    "hidden": hidden,
                }
            )
    return {
        "criteria": criteria,
        "stages": stages,
        "idle": _idle(table),
        "story": cause_sentences(table),
        "figure": Markup(cause_figure(table)),
        "linked": [
            row["term"] for row in by_stage["single"] if str(row["term"]).startswith("C")
        ],  # terms of coefficients, no parts
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
        f"{some} not flown alone, since no judged output moves by more than this share of "
        f"its mismatch, by the measured sensitivity of the "
        f"coefficient or by the flight with all of them: {terms}. All together move "
        f"{_bounded(together['bound'])}."
    )


def _bounded(share: float) -> str:
    return (
        f"{fixed_decimals(100.0 * share, 2)} %" if share == 0.0 or share >= 5e-5 else "below 0.01 %"
    )


def _rows(table: pd.DataFrame, stage: str) -> list[dict[Hashable, Any]]:
    rows = table[table["stage"] == stage].to_dict("records")
    return sorted(rows, key=lambda row: -abs(row["interaction"])) if stage == "pair" else rows


def cause_sentences(table: pd.DataFrame) -> str:
    """Return the cause in a few sentences."""
    by = {stage: _rows(table, stage) for stage in _TITLES}
    if not by["prior"]:
        return ""
    if by["prior"][0]["verdict"] in MATCHED:
        more = f" {_joint(by['joint'])}" if by["joint"] else ""
        return (
            f"The a-priori model is within tolerance; no term has to be taken from the final "
            f"model.{more}"
        )
    if by["prior"][0]["verdict"] == "not_tested":
        return "No criterion of this case carries a verdict, so there is no mismatch to explain."
    sentences = [
        f"The a-priori model "
        f"{'could not be judged' if by['prior'][0]['verdict'] == 'invalid' else 'is out of tolerance'}."
    ]
    singles = [row for row in by["single"] if row["explained"] >= LEAST_SHOWN]
    if singles:
        best = singles[0]
        sentences.append(
            f"Of single terms of the final model the {_called(best['term'])} explains most "
            f"of the gap, {_percent(best['explained'])}."
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
        sentences.append(
            f"With {'the ' if len(chosen) == 1 else ''}{taken} from the final model, the "
            f"corrected a-priori model {state}."
        )
    if by["joint"]:
        sentences.append(_joint(by["joint"]))
    if by["pair"] and abs(by["pair"][0]["interaction"]) >= LEAST_INTERACTION:
        sentences.append(
            _interaction(by["pair"][0], {row["term"]: row["explained"] for row in by["single"]})
        )
    return " ".join(sentences)


def _joint(rows: Sequence[Mapping[Hashable, Any]]) -> str:
    """Return the sentence about what the corrected model of all cases takes for this one."""
    added = [str(row["term"]) for row in rows if row["term"]]
    before = {
        "pass": "within tolerance",
        "limits_exceeded": "within tolerance with a trim beyond its limits",
        "invalid": "not judged",
    }
    made = "make" if len(added) > 1 else "makes"
    after = (
        f"{made} it pass"
        if rows[-1]["verdict"] == "pass"
        else f"{made} it as good as the final model"
    )
    state = before.get(rows[0]["verdict"], "out of tolerance")
    return (
        f"With the sequences of all cases together the corrected model is {state} here; "
        f"{_listed(added)}, added for this case, {after}."
    )


def _listed(names: Sequence[str]) -> str:
    return f"{', '.join(names[:-1])} and {names[-1]}" if len(names) > 1 else names[0]


def _interaction(pair: Mapping[Hashable, Any], alone: Mapping[str, float]) -> str:
    """Return the sentence about the pair that interacts most."""
    one, other = str(pair["term"]).split(" + ")
    parts = f"{_percent(alone[one])} and {_percent(alone[other])}"
    return (
        f"Terms do not simply add up: {one} and {other} explain {parts} alone, "
        f"{_percent(pair['explained'])} together."
    )


def _called(term: str) -> str:
    meaning = term_words(term)
    return f"{meaning} ({term})" if meaning else f"term {term}"


def _percent(share: float, stderr: float = 0.0) -> str:
    error = f" ± {fixed_decimals(100.0 * stderr, 0)}" if stderr > 0.0 else ""
    return f"{fixed_decimals(100.0 * share, 0)}{error} %" if math.isfinite(share) else MISSING


def _row(
    row: Mapping[Hashable, Any], start: float, criteria: Sequence[Mapping[str, Any]]
) -> dict[str, Any]:
    term, is_share = str(row["term"]), row["stage"] == "share"
    cells = []
    for c in criteria:
        cells += [
            _percent(row[f"{c['name']} explained"], row[f"{c['name']} stderr"]),
            "" if is_share else fixed_decimals(row[f"{c['name']} ratio"], 2),
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
    """Return left end and width of a bar, in percent of the column; a sequence's bar begins where
    the one before ends.
    """
    if not (math.isfinite(start) and math.isfinite(stop)):
        return None
    a, b = (
        100.0 * (min(max(x, _LOW), _HIGH) - _LOW) / (_HIGH - _LOW) for x in sorted((start, stop))
    )
    return round(a, 1), round(max(b - a, 0.6), 1)
