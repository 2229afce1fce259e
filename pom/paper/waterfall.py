"""The cause of a miss as a waterfall: from the miss of the a-priori model, term by term, to what is left."""

from __future__ import annotations

import math

import pandas as pd

from pom.sections.figure import WIDTH, line, rect, text
from pom.sections.quantities import fixed
from pom.sections.term_words import term_words

from .figure import Drawing, svg

LEFT, RIGHT, ROW, HEAD = 350.0, 60.0, 16.0, 16.0
MOST = 12  # terms


def waterfall(table: pd.DataFrame) -> Drawing | None:
    """Draw the miss that is left, in percent of the gap between a-priori and final model, after each term of the sequence.

    Parameters
    ----------
    table : DataFrame
        From `pom.diagnose`; without a sequence the single terms are drawn, each from the a-priori model.

    Returns
    -------
    Drawing or None
        None when no term closes anything.
    """
    sequence = table[table["stage"] == "sequence"].to_dict("records")
    chained = bool(sequence)
    rows = sequence or table[(table["stage"] == "single") & (table["closes"].abs() >= 0.01)].to_dict("records")
    rows = [row for row in rows if math.isfinite(row["closes"])][:MOST]
    if not rows:
        return None
    bars = [("a-priori model", 0.0, 100.0, "total")]
    left = 100.0
    for row in rows:
        rest = 100.0 * (1.0 - row["closes"])
        said = term_words(row["term"])
        bars.append((f"{row['term']}{f'  ({said})' if said else ''}", left, rest, "bar" if rest <= left else "rise"))
        left = rest if chained else 100.0
    if chained:
        bars.append(("left: a-priori model with these terms", 0.0, left, "total"))
    low = min(0.0, *(min(a, b) for _, a, b, _ in bars)) - 5.0
    high = max(100.0, *(max(a, b) for _, a, b, _ in bars)) + 5.0
    wide = WIDTH - LEFT - RIGHT

    def at(share: float) -> float:
        return LEFT + (share - low) / (high - low) * wide

    bottom = HEAD + ROW * len(bars)
    parts = [line(at(x), HEAD - 3, at(x), bottom, "grid") for x in (0.0, 25.0, 50.0, 75.0, 100.0)]
    parts += [text(at(x), HEAD - 5, f"{x:.0f} %", "tick", "middle") for x in (0.0, 50.0, 100.0)]
    for i, (name, start, stop, css) in enumerate(bars):
        y = HEAD + ROW * i
        a, b = sorted((at(start), at(stop)))
        parts.append(text(LEFT - 8, y + 11.5, _fit(name), "", "end"))
        parts.append(rect(a, y + 2.5, max(b - a, 1.0), ROW - 5.0, css))
        shown = fixed(stop if css == "total" else stop - start, 0)
        parts.append(text(b + 5, y + 11.5, f"{shown} %" if css == "total" else f"{'+' if stop > start else ''}{shown} %", "tick"))
        if chained and i + 1 < len(bars):
            parts.append(line(at(stop), y + ROW - 2.5, at(stop), y + ROW + 2.5, "joint"))
    said = "; ".join(f"{name}: {fixed(stop, 0)} % left" for name, _, stop, _ in bars[1:])
    return Drawing(
        svg(bottom + 3.0, "".join(parts)), bottom + 3.0, f"Miss left, in percent of the gap between a-priori and final model. {said}."
    )


def _fit(name: str, most: int = 72) -> str:
    return name if len(name) <= most else f"{name[: most - 1]}…"
