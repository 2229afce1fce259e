"""Waterfall of a diagnosis in the HTML page, as SVG and in words."""

from __future__ import annotations

import math
from collections.abc import Collection, Sequence
from dataclasses import dataclass
from html import escape

import pandas as pd

from flightmech.support import figures as svg_chart
from flightmech.support.figures import Frame
from pom.diagnosis.waterfall_steps import OTHERS, criteria_of, waterfall
from pom.report.presentation.quantities import fixed_decimals

MOST_PANELS = 4  # criteria next to the total
LEAST_NAMED = 0.005  # of the gap: smaller shares are left out of the alternative text
# Widths of the names and of the panel of the total with its numbers, and the gap between panels.
_NAMES, _TOTAL, _GAP = 116.0, 210.0, 10.0
_NUMBER, _WITH_ERROR = 36.0, 58.0  # width of the numbers next to a panel
_HEAD, _ROW, _BAR = 36.0, 17.0, 10.0  # heights of the head, of a row, and of a bar
_LEGEND = (
    ("run-2-area", "explains, taken by the corrected model"),
    ("band", "explains, not needed"),
    ("exit", "adds to the mismatch"),
)


@dataclass(frozen=True)
class _Bar:
    """One row of a panel: a bar from `start` to `stop` [half widths] with its number."""

    start: float
    stop: float
    css: str
    number: str
    stderr: float = 0.0


def cause_figure(table: pd.DataFrame) -> str:
    """Return the waterfall as SVG with its alternative text; empty without shares.

    The rows are the a-priori model, every term, and the final model.  A bar begins at the end of
    the bar above it.  Solid bars are terms that the corrected model takes.  Open bars are not
    needed.  Hatched bars add to the mismatch.  Whiskers are one standard error of a sampled share.

    Parameters
    ----------
    table : DataFrame
        Table of `pom.diagnose`.
    """
    total = waterfall(table)
    if total.empty:
        return ""
    needed = set(table.loc[table["stage"].isin(["sequence", "joint"]), "term"])
    bottom = _HEAD + _ROW * (len(total) + 2)
    body = [
        _draw_names(total, needed),
        *_draw_panels(table, total, needed, bottom),
        _draw_legend(bottom + 38.0),
    ]
    return svg_chart.make_svg_figure(bottom + 44.0, "".join(body), waterfall_text(table))


def waterfall_text(table: pd.DataFrame) -> str:
    """Return the waterfall in words, as its alternative text."""
    sentences = []
    # The empty name is that of the total mismatch.
    for name in ("", *_choose_criteria(table)):
        steps = waterfall(table, name)
        shares = []
        for step in steps.to_dict("records"):
            if abs(step["explained"]) >= LEAST_NAMED:
                share = _format_share(step["explained"], step["stderr"])
                shares.append(f"{_bar_name(step['term'])} {share}")
        start = fixed_decimals(steps["start"].iloc[0], 2)
        stop = fixed_decimals(steps["stop"].iloc[-1], 2)
        sentences.append(
            f"{name.replace('_', ' ') or 'all criteria'}, from {start} to {stop} half widths: "
            f"{', '.join(shares) or 'no share of half a percent'}"
        )
    return (
        f"Waterfall of the mismatch from the a-priori to the final model. {'. '.join(sentences)}."
    )


def _choose_criteria(table: pd.DataFrame) -> list[str]:
    """Return the criteria that have a panel, the largest a-priori mismatch first.

    These are the criteria with a gap.  A single criterion is the total, and has no separate panel.
    """
    steps = {name: waterfall(table, name) for name in criteria_of(table)}
    if len(steps) <= 1:
        return []
    with_gap = [name for name in steps if steps[name]["explained"].notna().all()]
    return sorted(with_gap, key=lambda name: -steps[name]["start"].iloc[0])[:MOST_PANELS]


def _draw_panels(
    table: pd.DataFrame, total: pd.DataFrame, needed: Collection[str], bottom: float
) -> list[str]:
    """Return the panel of the total, and those of the criteria next to it."""
    chosen, names = _choose_criteria(table), criteria_of(table)
    number = _WITH_ERROR if (total["stderr"] > 0.0).any() else _NUMBER
    # Without criteria the total takes the whole width.
    width = _TOTAL if chosen else svg_chart.WIDTH - _NAMES
    title = "all criteria" if len(names) > 1 else names[0].replace("_", " ")
    extent = (_NAMES, width - number - _GAP, bottom)
    panels = [_draw_panel(title, total, needed=needed, extent=extent, main=True)]
    each = (svg_chart.WIDTH - _NAMES - width) / max(len(chosen), 1)
    for k, name in enumerate(chosen):
        extent = (_NAMES + width + k * each, each - _NUMBER - _GAP, bottom)
        title, steps = name.replace("_", " "), waterfall(table, name)
        panels.append(_draw_panel(title, steps, needed=needed, extent=extent, main=False))
    return panels


def _draw_panel(
    title: str,
    steps: pd.DataFrame,
    needed: Collection[str],
    extent: tuple[float, float, float],
    main: bool,
) -> str:
    """Return one column: title, scale and bars; `extent` is left edge, width and lower edge."""
    bars = _list_bars(steps, needed, with_error=main)
    ends = []
    for bar in bars:
        ends += [bar.start - bar.stderr, bar.stop - bar.stderr]
        ends += [bar.start + bar.stderr, bar.stop + bar.stderr]
    left, width, bottom = extent
    x_limits = (min(0.0, *ends), 1.02 * max(ends))
    frame = Frame(left, _HEAD, width, height=bottom - _HEAD, x=x_limits, y=(0.0, 1.0))
    # 5.6 units are about the width of a character.
    lines = _two_lines(title, 20 if main else max(int((width + _NUMBER) / 5.6), 8))
    parts = []
    for k, line in enumerate(lines):
        parts.append(svg_chart.draw_text(left, _HEAD - 8.0 - 12.0 * (len(lines) - 1 - k), line))
    parts.append(_draw_scale(frame))
    for k, bar in enumerate(bars):
        parts.append(_draw_bar(frame, k, bar))
    parts.append(_draw_joints(frame, bars))
    if main:
        caption = "mismatch, in half widths of the tolerance"
        parts.append(svg_chart.draw_text(left, bottom + 26.0, caption, "caption"))
    return "".join(parts)


def _list_bars(steps: pd.DataFrame, needed: Collection[str], with_error: bool) -> list[_Bar]:
    """Return the rows of a panel; only the panel of the total prints standard errors."""
    first, last = steps["start"].iloc[0], steps["stop"].iloc[-1]
    bars = [_Bar(0.0, first, "run-1-area", fixed_decimals(first, 2))]
    for step in steps.to_dict("records"):
        start, stop, stderr = step["start"], step["stop"], step["stderr"]
        css = "band"
        if stop > start:
            css = "exit"
        elif step["term"] in needed:
            css = "run-2-area"
        number = _format_share(step["explained"], stderr if with_error else 0.0)
        # The standard error of a share is a part of the gap.
        bars.append(_Bar(start, stop, css, number, stderr=stderr * abs(first - last)))
    bars.append(_Bar(0.0, last, "run-3-area", fixed_decimals(last, 2)))
    return bars


def _draw_scale(frame: Frame) -> str:
    """Return grid, numbers and zero line of a panel."""
    marks = svg_chart.choose_ticks(*frame.x, max(2, int(frame.width / 40)))
    lines, numbers = [], []
    for mark, text in zip(marks, svg_chart.tick_text(marks), strict=True):
        lines.append(f"M{frame.px(mark):.1f},{frame.top:.1f}v{frame.height:.1f}")
        numbers.append(svg_chart.draw_text(float(frame.px(mark)), frame.bottom + 12, text))
    zero = float(frame.px(0.0))
    axis = svg_chart.draw_line(zero, frame.top, zero, frame.bottom, "frame")
    grid, labels = "".join(lines), "".join(numbers)
    return f'<path class="grid" d="{grid}"/>{axis}<g class="tick" text-anchor="middle">{labels}</g>'


def _draw_bar(frame: Frame, k: int, bar: _Bar) -> str:
    """Return the bar of row `k`, its whisker, and the number next to the panel."""
    left, right = sorted((float(frame.px(bar.start)), float(frame.px(bar.stop))))
    middle = frame.top + _ROW * (k + 0.5)
    top, width = middle - 0.5 * _BAR, max(right - left, 0.8)
    parts = [svg_chart.draw_rectangle(left, top, width, _BAR, _bar_class(bar.css))]
    if bar.stderr > 0.0:
        low = float(frame.px(bar.stop - bar.stderr))
        high = float(frame.px(bar.stop + bar.stderr))
        parts.append(
            f'<path class="frame" d="M{low:.1f},{middle - 3:.1f}v6m0,-3H{high:.1f}m0,-3v6"/>'
        )
    parts.append(svg_chart.draw_text(frame.right + _GAP - 4.0, middle + 3.8, bar.number, "tick"))
    return "".join(parts)


def _bar_class(css: str) -> str:
    """Return the classes of a bar; an open one has an edge."""
    return f"{css} frame" if css == "band" else css


def _draw_joints(frame: Frame, bars: Sequence[_Bar]) -> str:
    """Return the short lines from the end of each bar to the next one."""
    lines = []
    for k, bar in enumerate(bars[:-1]):
        x = float(frame.px(bar.stop))
        y = frame.top + _ROW * (k + 0.5) + 0.5 * _BAR
        lines.append(f"M{x:.1f},{y:.1f}v{_ROW - _BAR:.1f}")
    return f'<path class="frame" d="{"".join(lines)}"/>'


def _draw_names(steps: pd.DataFrame, needed: Collection[str]) -> str:
    """Return the names of the rows; those of needed terms are bold."""
    names = [("a-priori model", False)]
    for term in steps["term"]:
        names.append((_bar_name(term), term in needed))
    names.append(("final model", False))
    lines = []
    for k, (text, is_needed) in enumerate(names):
        style = ' style="font-weight:600"' if is_needed else ""
        position = (
            f'x="{_NAMES - 7:.0f}" y="{_HEAD + _ROW * (k + 0.5) + 3.8:.1f}" text-anchor="end"'
        )
        lines.append(f"<text {position}><tspan{style}>{escape(text)}</tspan></text>")
    return "".join(lines)


def _draw_legend(y: float) -> str:
    """Return the meaning of the bars, from the right edge to the left."""
    parts, x = [], svg_chart.WIDTH
    for css, label in reversed(_LEGEND):
        # 6.6 units are the width of a character of a wide font, as DejaVu Sans.
        x -= 6.6 * len(label) + 22.0
        parts += [
            svg_chart.draw_rectangle(x, y - 9.0, 14.0, _BAR, _bar_class(css)),
            svg_chart.draw_text(x + 18.0, y, label, "caption"),
        ]
    return "".join(parts)


def _bar_name(term: str) -> str:
    return "all others" if term == OTHERS else term


def _format_share(explained: float, stderr: float) -> str:
    """Return a share of the gap in percent; empty if it is not finite."""
    if not math.isfinite(explained):
        return ""
    error = f" ± {fixed_decimals(100.0 * stderr, 0)}" if stderr > 0.0 else ""
    return f"{fixed_decimals(100.0 * explained, 0)}{error} %"


def _two_lines(title: str, most: int) -> list[str]:
    """Return a title, broken once at the space nearest to its middle if it is too long."""
    if len(title) <= most or " " not in title:
        return [title]
    spaces = [k for k, letter in enumerate(title) if letter == " "]
    cut = min(spaces, key=lambda k: abs(k - len(title) / 2.0))
    return [title[:cut], title[cut + 1 :]]
