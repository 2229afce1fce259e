"""Waterfall of a diagnosis for paper: Shapley shares as steps of the total mismatch."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
import pandas as pd

from flightmech.support.figures import (
    WIDTH,
    choose_ticks,
    draw_line,
    draw_rectangle,
    draw_text,
    tick_text,
)
from pom.diagnosis.waterfall_steps import OTHERS, waterfall
from pom.report.pdf.style import Drawing, svg_drawing
from pom.report.presentation.quantities import fixed_decimals
from pom.report.presentation.term_words import term_words

# Width of the names and of the shares next to the bars, height of a row and of the scale.
WATERFALL_LEFT, WATERFALL_RIGHT, ROW, WATERFALL_HEAD = 350.0, 96.0, 16.0, 16.0
_MOST_CHARACTERS = 72  # of a name, in the width of the names


@dataclass(frozen=True)
class _PrintedBar:
    """One row: its name, its ends [half widths], its class, and its share as a text."""

    name: str
    start: float
    stop: float
    css: str
    share: str

    @property
    def number(self) -> str:
        """Text next to the bar: the share, or the mismatch of a model."""
        return self.share or fixed_decimals(self.stop, 2)


def draw_waterfall(table: pd.DataFrame) -> Drawing | None:
    """Draw the Shapley shares of a diagnosis as steps of the total mismatch.

    Parameters
    ----------
    table : DataFrame
        Table of `pom.diagnose`.

    Returns
    -------
    Drawing or None
        None if the diagnosis has no shares: the a-priori model passes, or the final model is not
        better.
    """
    bars = _list_bars(table)
    if not bars:
        return None
    edges = np.array([(bar.start, bar.stop) for bar in bars])
    low, high = float(min(edges.min(), 0.0)), float(edges.max()) * 1.02
    scale = (WIDTH - WATERFALL_LEFT - WATERFALL_RIGHT) / ((high - low) or 1.0)

    def to_x(mismatch: float) -> float:
        return WATERFALL_LEFT + (mismatch - low) * scale

    bottom, marks = WATERFALL_HEAD + ROW * len(bars), choose_ticks(low, high, 5)
    parts = []
    for mark in marks:
        parts.append(draw_line(to_x(mark), WATERFALL_HEAD - 3, to_x(mark), bottom, "grid"))
    for mark, text in zip(marks, tick_text(marks), strict=True):
        parts.append(draw_text(to_x(mark), WATERFALL_HEAD - 5, text, "tick", "middle"))
    caption = "total mismatch, in half widths"
    parts.append(draw_text(WATERFALL_LEFT - 20, WATERFALL_HEAD - 5, caption, "caption", "end"))
    for i, bar in enumerate(bars):
        y = WATERFALL_HEAD + ROW * i
        left, right = sorted((to_x(bar.start), to_x(bar.stop)))
        parts += [
            draw_text(WATERFALL_LEFT - 8, y + 11.5, _shorten(bar.name), "", "end"),
            draw_rectangle(left, y + 2.5, max(right - left, 1.0), ROW - 5.0, bar.css),
            draw_text(right + 5, y + 11.5, bar.number, "tick"),
        ]
        # A short line joins the end of a bar to the start of the next one.
        if i + 1 < len(bars):
            x = to_x(bar.stop)
            parts.append(draw_line(x, y + ROW - 2.5, x, y + ROW + 2.5, "joint"))
    steps = "; ".join([f"{bar.name}: {bar.number}" for bar in bars])
    alternative = f"Shares of the terms in the total mismatch, in half widths. {steps}."
    return Drawing(svg_drawing(bottom + 3.0, "".join(parts)), bottom + 3.0, alternative)


def _list_bars(table: pd.DataFrame) -> list[_PrintedBar]:
    """Return the rows from the a-priori model to the final one; empty without shares."""
    steps = waterfall(table).dropna(subset=["start", "stop"]).to_dict("records")
    if not steps:
        return []
    bars = [_PrintedBar("a-priori model", 0.0, steps[0]["start"], css="total", share="")]
    for step in steps:
        css = "bar" if step["stop"] <= step["start"] else "rise"
        share = _describe_share(step["explained"], step["stderr"])
        name = _describe_term(str(step["term"]))
        bars.append(_PrintedBar(name, step["start"], step["stop"], css=css, share=share))
    bars.append(_PrintedBar("final model", 0.0, steps[-1]["stop"], css="total", share=""))
    return bars


def _describe_term(term: str) -> str:
    if term == OTHERS:
        return "all other terms together"
    meaning = term_words(term)
    return f"{term}  ({meaning})" if meaning else term


def _describe_share(explained: float, stderr: float) -> str:
    """Return the explained share of the gap, with its standard error if it was sampled."""
    if not math.isfinite(explained):
        return ""
    error = ""
    if math.isfinite(stderr) and stderr > 0.0:
        error = f" ± {fixed_decimals(100.0 * stderr, 0)}"
    return f"explains {fixed_decimals(100.0 * explained, 0)}{error} %"


def _shorten(name: str) -> str:
    if len(name) <= _MOST_CHARACTERS:
        return name
    return f"{name[: _MOST_CHARACTERS - 1]}…"
