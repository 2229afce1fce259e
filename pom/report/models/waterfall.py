"""The waterfall of a diagnosis: from the mismatch of the a-priori to that of the final model, share by share, in all and per criterion."""

from __future__ import annotations

import math
from collections.abc import Collection
from dataclasses import dataclass
from html import escape

import pandas as pd

from flightmech.support import svg_chart
from flightmech.support.svg_chart import Frame
from pom.diagnosis.swap_table import OTHERS, criteria_of, waterfall

from ..presentation.quantities import fixed

MOST_PANELS = 4  # criteria next to the total
LEAST_NAMED = 0.005  # of the gap: smaller shares are left out of the alternative text
_NAMES, _TOTAL, _GAP = 116.0, 210.0, 10.0  # widths of the names, of the panel of the total with its numbers, between panels
_NUMBER, _WITH_ERROR = 36.0, 58.0  # width of the numbers next to a panel
_HEAD, _ROW, _BAR = 36.0, 17.0, 10.0
_LEGEND = (("run-2-area", "explains, taken by the corrected model"), ("band", "explains, not needed"), ("exit", "adds to the mismatch"))


@dataclass(frozen=True)
class _Bar:
    """One row of a panel: from `start` to `stop`, with what stands next to it."""

    start: float
    stop: float
    css: str
    words: str
    stderr: float = 0.0


def cause_figure(table: pd.DataFrame) -> str:
    """Return the waterfall as SVG with its alternative text; empty when the diagnosis has no shares.

    One row per term, first the a-priori model, last the final one.  A bar begins where the one above it ends; solid: a term that
    the corrected model takes; open: not needed; hatched: it adds to the mismatch.  Whiskers: one standard error of a sampled share.
    """
    total = waterfall(table)
    if total.empty:
        return ""
    needed = set(table.loc[table["stage"].isin(["sequence", "joint"]), "term"])
    bottom = _HEAD + _ROW * (len(total) + 2)
    body = [_names(total, needed), *_panels(table, total, needed, bottom), _legend(bottom + 38.0)]
    return svg_chart.svg(bottom + 44.0, "".join(body), alternative(table))


def alternative(table: pd.DataFrame) -> str:
    """Return the waterfall in words, for those who cannot see it."""
    sentences = []
    for name in ("", *_shown(table)):
        steps = waterfall(table, name)
        large = [step for step in steps.to_dict("records") if abs(step["explained"]) >= LEAST_NAMED]
        parts = [f"{_bar_name(step['term'])} {_share(step['explained'], step['stderr'])}" for step in large]
        way = f"{fixed(steps['start'].iloc[0], 2)} to {fixed(steps['stop'].iloc[-1], 2)} half widths"
        sentences.append(f"{name.replace('_', ' ') or 'all criteria'}, from {way}: {', '.join(parts) or 'no share of half a percent'}")
    return f"Waterfall of the mismatch from the a-priori to the final model. {'. '.join(sentences)}."


def _shown(table: pd.DataFrame) -> list[str]:
    """Return the criteria that have a gap, the largest mismatch of the a-priori model first; none when there is but one criterion."""
    found = {name: waterfall(table, name) for name in criteria_of(table)}
    shown = [name for name, steps in found.items() if len(found) > 1 and steps["explained"].notna().all()]
    return sorted(shown, key=lambda name: -found[name]["start"].iloc[0])[:MOST_PANELS]


def _panels(table: pd.DataFrame, total: pd.DataFrame, needed: Collection[str], bottom: float) -> list[str]:
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


def _panel(title: str, steps: pd.DataFrame, needed: Collection[str], place: tuple[float, float, float], main: bool) -> str:
    """Return one column: title, scale and bars; `place` is left edge, width and lower edge."""
    first, last = steps["start"].iloc[0], steps["stop"].iloc[-1]
    bars = [_Bar(0.0, first, "run-1-area", fixed(first, 2))]
    for step in steps.to_dict("records"):
        start, stop, stderr = step["start"], step["stop"], step["stderr"]
        css = "exit" if stop > start else "run-2-area" if step["term"] in needed else "band"
        bars.append(_Bar(start, stop, css, _share(step["explained"], stderr if main else 0.0), stderr * abs(first - last)))
    bars.append(_Bar(0.0, last, "run-3-area", fixed(last, 2)))
    left, width, bottom = place
    ends = [end for bar in bars for end in (bar.start - bar.stderr, bar.stop - bar.stderr, bar.start + bar.stderr, bar.stop + bar.stderr)]
    frame = Frame(left, _HEAD, width, bottom - _HEAD, (min(0.0, *ends), 1.02 * max(ends)), (0.0, 1.0))
    lines = _two_lines(title, 20 if main else max(int((width + _NUMBER) / 5.6), 8))
    heading = [svg_chart.text(left, _HEAD - 8.0 - 12.0 * (len(lines) - 1 - k), line) for k, line in enumerate(lines)]
    below = svg_chart.text(left, bottom + 26.0, "mismatch, in half widths of the tolerance", "caption") if main else ""
    return "".join([*heading, _scale(frame), *(_bar_row(frame, k, bar) for k, bar in enumerate(bars)), _joints(frame, bars), below])


def _scale(frame: Frame) -> str:
    marks = svg_chart.ticks(*frame.x, max(2, int(frame.width / 40)))
    grid = "".join(f"M{frame.px(mark):.1f},{frame.top:.1f}v{frame.height:.1f}" for mark in marks)
    words = "".join(
        svg_chart.text(float(frame.px(v)), frame.bottom + 12, w) for v, w in zip(marks, svg_chart.tick_text(marks), strict=True)
    )
    zero = float(frame.px(0.0))
    axis = svg_chart.line(zero, frame.top, zero, frame.bottom, "frame")
    return f'<path class="grid" d="{grid}"/>{axis}<g class="tick" text-anchor="middle">{words}</g>'


def _bar_row(frame: Frame, k: int, bar: _Bar) -> str:
    """Return the bar of row `k`, its whisker, and the number next to the panel."""
    a, b = sorted((float(frame.px(bar.start)), float(frame.px(bar.stop))))
    middle = frame.top + _ROW * (k + 0.5)
    parts = [svg_chart.rect(a, middle - 0.5 * _BAR, max(b - a, 0.8), _BAR, f"{bar.css} frame" if bar.css == "band" else bar.css)]
    if bar.stderr > 0.0:
        low, high = (float(frame.px(bar.stop + side * bar.stderr)) for side in (-1.0, 1.0))
        parts.append(f'<path class="frame" d="M{low:.1f},{middle - 3:.1f}v6m0,-3H{high:.1f}m0,-3v6"/>')
    parts.append(svg_chart.text(frame.right + _GAP - 4.0, middle + 3.8, bar.words, "tick"))
    return "".join(parts)


def _joints(frame: Frame, bars: list[_Bar]) -> str:
    """Return the short lines from the end of each bar to the next one."""
    places = [(float(frame.px(bar.stop)), frame.top + _ROW * (k + 0.5) + 0.5 * _BAR) for k, bar in enumerate(bars[:-1])]
    return f'<path class="frame" d="{"".join(f"M{x:.1f},{y:.1f}v{_ROW - _BAR:.1f}" for x, y in places)}"/>'


def _names(steps: pd.DataFrame, needed: Collection[str]) -> str:
    words = [("a-priori model", False), *((_bar_name(term), term in needed) for term in steps["term"]), ("final model", False)]
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
        parts.append(svg_chart.rect(x, y - 9.0, 14.0, _BAR, f"{css} frame" if css == "band" else css))
        parts.append(svg_chart.text(x + 18.0, y, label, "caption"))
    return "".join(parts)


def _bar_name(term: str) -> str:
    return "all others" if term == OTHERS else term


def _share(explained: float, stderr: float) -> str:
    error = f" ± {fixed(100.0 * stderr, 0)}" if stderr > 0.0 else ""
    return f"{fixed(100.0 * explained, 0)}{error} %" if math.isfinite(explained) else ""


def _two_lines(words: str, most: int) -> list[str]:
    """Return a title broken once, at a space, when it is longer than `most` characters."""
    if len(words) <= most or " " not in words:
        return [words]
    cuts = [k for k, letter in enumerate(words) if letter == " "]
    cut = min(cuts, key=lambda k: abs(k - len(words) / 2.0))
    return [words[:cut], words[cut + 1 :]]
