"""Estimates of a coefficient at a time of flight, and the accuracy at which a stream may end."""

from __future__ import annotations

import json
import math
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from flightmech.short_text import ShortText
from flighttest.parameter_constraints import CONTRADICTED

STEADY, RECENT = 2.5, 5  # standard errors of a move, and updates over which it is looked for
LASTING = 3  # updates in a row in which a goal must be met


@dataclass(frozen=True)
class AccuracyGoal:
    """Accuracy of a term at which the stream may end.

    Attributes
    ----------
    term : str
    limit : float
        Standard error; [unit of the term], or a share of the estimate.
    is_share : bool
    """

    term: str
    limit: float
    is_share: bool

    def is_met(self, estimate: FlightEstimate) -> bool:
        """Return whether an estimate is as accurate."""
        if self.term not in estimate.terms:
            return False
        k = estimate.terms.index(self.term)
        limit = self.limit * (abs(estimate.values[k]) if self.is_share else 1.0)
        return bool(estimate.stderr[k] <= limit)


@dataclass(frozen=True)
class FlightEstimate(ShortText):
    """Estimates from the samples up to a time.

    Attributes
    ----------
    time : float
        Of the last sample. [s]
    samples : int
        Samples that the estimates use: those of the stretches that are long enough and not
        forgotten; zero without an estimate.
    terms : tuple of str
        Without the constant, which has no frequency.
    values, stderr : array (terms,)
        Standard errors are those for the spectrum of the residual, with Student's factor.
    R2 : float
        Inside the band.
    waiting : str
        Reason why the estimate is missing; empty with an estimate.
    counts : dict of str to int
        Samples that were left out or filled in, and breaks of the stream, so far. ``too_short``
        are samples of stretches below one period of the lower edge of the band,
        ``without_coefficient`` those with a wheel on the ground.
    unsteady : tuple of str
        Terms that have left an estimate of the last `RECENT` updates by more than `STEADY` of its
        standard errors. The disturbance or the model is then not what the standard errors assume.
    constraints : str
        As from `rate_constraints`; empty without constraints.
    is_accurate : bool
        Whether all goals have been met by steady terms in `LASTING` updates in a row.
    """

    time: float
    samples: int
    terms: tuple[str, ...] = ()
    values: np.ndarray = field(default_factory=lambda: np.zeros(0))
    stderr: np.ndarray = field(default_factory=lambda: np.zeros(0))
    R2: float = math.nan
    waiting: str = ""
    counts: dict[str, int] = field(default_factory=dict)
    unsteady: tuple[str, ...] = ()
    constraints: str = ""
    is_accurate: bool = False

    def as_dict(self) -> dict[str, Any]:
        """Return the estimate as JSON types."""
        terms = {}
        for name, value, stderr in zip(self.terms, self.values, self.stderr):
            terms[name] = {"estimate": float(value), "stderr": float(stderr)}
        return {
            "time": self.time,
            "samples": self.samples,
            "terms": terms,
            "R2": None if math.isnan(self.R2) else self.R2,
            "waiting": self.waiting,
            "unsteady": list(self.unsteady),
            "accurate": self.is_accurate,
            "constraints": json.loads(self.constraints or "[]"),
            **self.counts,
        }

    def line(self) -> str:
        """Return the estimate as one line."""
        parts = [f"{self.time:9.2f} s"]
        if self.waiting:
            parts.append(self.waiting)
        for name, value, stderr in zip(self.terms, self.values, self.stderr):
            parts.append(f"{name} {value:.4g} ({stderr:.2g})")
        if not math.isnan(self.R2):
            parts.append(f"R2 {self.R2:.3f}")
        parts += [
            f"{name.replace('_', ' ')} {count}" for name, count in self.counts.items() if count
        ]
        if self.unsteady:
            parts.append(f"unsteady {', '.join(self.unsteady)}")
        for row in json.loads(self.constraints or "[]"):
            if row["t"] is not None and abs(row["t"]) > CONTRADICTED:
                parts.append(f"contradicts {row['text']} by {abs(row['t']):.1f} standard errors")
        if self.is_accurate:
            parts.append("accurate")
        return "  ".join(parts)
