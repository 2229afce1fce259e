"""The cause of a mismatch as a waterfall: from the mismatch of the a-priori model, share by share, to that of the final model."""

from __future__ import annotations

import math

import numpy as np
import pandas as pd

from flightmech.support.svg_chart import WIDTH, line, rect, text, tick_text, ticks
from pom.diagnosis.swap_table import OTHERS
from pom.diagnosis.swap_table import waterfall as steps_of
from pom.report.presentation.quantities import fixed
from pom.report.presentation.term_names import term_words

from .panels import Drawing, svg

WATERFALL_LEFT, WATERFALL_RIGHT, ROW, WATERFALL_HEAD = 350.0, 96.0, 16.0, 16.0


def waterfall(table: pd.DataFrame) -> Drawing | None:
    """Draw the Shapley shares of a diagnosis as steps of the total mismatch.

    Parameters
    ----------
    table : DataFrame
        From `pom.diagnose`.

    Returns
    -------
    Drawing or None
        None when the diagnosis has no shares: the a-priori model passes, or the final one is no better.
    """
    steps = steps_of(table).dropna(subset=["start", "stop"]).to_dict("records")
    if not steps:
        return None
    bars = [("a-priori model", 0.0, steps[0]["start"], "total", "")]
    for step in steps:
        css = "bar" if step["stop"] <= step["start"] else "rise"
        bars.append((_called(str(step["term"])), step["start"], step["stop"], css, _share(step["explained"], step["stderr"])))
    bars.append(("final model", 0.0, steps[-1]["stop"], "total", ""))
    edges = np.array([(start, stop) for _, start, stop, _, _ in bars])
    low, high = float(min(edges.min(), 0.0)), float(edges.max()) * 1.02
    scale = (WIDTH - WATERFALL_LEFT - WATERFALL_RIGHT) / ((high - low) or 1.0)

    def at(mismatch: float) -> float:
        return WATERFALL_LEFT + (mismatch - low) * scale

    bottom, marks = WATERFALL_HEAD + ROW * len(bars), ticks(low, high, 5)
    parts = [line(at(x), WATERFALL_HEAD - 3, at(x), bottom, "grid") for x in marks]
    parts += [text(at(x), WATERFALL_HEAD - 5, word, "tick", "middle") for x, word in zip(marks, tick_text(marks), strict=True)]
    parts.append(text(WATERFALL_LEFT - 20, WATERFALL_HEAD - 5, "total mismatch, in half widths", "caption", "end"))
    for i, (name, start, stop, css, share) in enumerate(bars):
        y = WATERFALL_HEAD + ROW * i
        a, b = sorted((at(start), at(stop)))
        parts += [text(WATERFALL_LEFT - 8, y + 11.5, _fit(name), "", "end"), rect(a, y + 2.5, max(b - a, 1.0), ROW - 5.0, css)]
        parts.append(text(b + 5, y + 11.5, share or fixed(stop, 2), "tick"))
        if i + 1 < len(bars):
            parts.append(line(at(stop), y + ROW - 2.5, at(stop), y + ROW + 2.5, "joint"))
    steps_in_words = "; ".join(f"{name}: {share or fixed(stop, 2)}" for name, _, stop, _, share in bars)
    alternative = f"Shares of the terms in the total mismatch, in half widths. {steps_in_words}."
    return Drawing(svg(bottom + 3.0, "".join(parts)), bottom + 3.0, alternative)


def _called(term: str) -> str:
    if term == OTHERS:
        return "all other terms together"
    meaning = term_words(term)
    return f"{term}  ({meaning})" if meaning else term


def _share(explained: float, stderr: float) -> str:
    """Return the share of the gap that a term explains, with its standard error when it was sampled."""
    if not math.isfinite(explained):
        return ""
    tail = f" ± {fixed(100.0 * stderr, 0)}" if math.isfinite(stderr) and stderr > 0.0 else ""
    return f"explains {fixed(100.0 * explained, 0)}{tail} %"


def _fit(name: str, most: int = 72) -> str:
    return name if len(name) <= most else f"{name[: most - 1]}…"
