"""Probability of a match: what the draws of the models show, as the page prints it."""

from __future__ import annotations

from typing import Any

from pom.result import PomResult
from pom.samples import Samples

from ..presentation.quantities import fixed
from ..presentation.verdict_text import words

SOURCES = 4
"""Printed of one criterion."""


def probability_table(result: PomResult) -> list[dict[str, Any]]:
    """Return one block per sampled model: its line, and one row per criterion that is judged."""
    return [_block(run, samples) for run, samples in result.samples.items()]


def _block(run: str, samples: Samples) -> dict[str, Any]:
    return {
        "run": run,
        "draws": samples.count,
        "seed": samples.seed,
        "database": samples.database,
        "probability": probability(samples),
        "ratio": spread(samples),
        "rows": [
            {
                "criterion": words(name),
                "probability": fixed(samples.passing(name), 3),
                "ratio": spread(samples, name),
                "sources": sources(samples, name),
            }
            for name in map(str, samples.ratio.columns)
        ],
    }


def probability(samples: Samples) -> str:
    """Return the probability of a pass with its standard error from the number of draws."""
    return f"{fixed(samples.probability, 3)} ± {fixed(samples.stderr, 3)}"


def spread(samples: Samples, criterion: str = "") -> str:
    """Return the median of the ratio and its quantiles 5 and 95 %."""
    low, middle, high = samples.spread(criterion)
    return f"{fixed(middle, 2)} ({fixed(low, 2)} … {fixed(high, 2)})"


def sources(samples: Samples, criterion: str, most: int = SOURCES) -> str:
    """Return the terms and instruments whose errors make most of the spread, with their shares."""
    return ", ".join(f"{source} {100.0 * share:.0f} %" for source, share in samples.dominant(criterion, most))
