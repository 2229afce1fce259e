"""Values with standard errors of an actuator, and their average."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass

from flighttest.regression.combining.pooling import Pooled, pool


@dataclass(frozen=True)
class LogEstimates:
    """Estimates of the output error on one log alone, with the end of its search."""

    record: str
    values: Mapping[str, float]
    stderr: Mapping[str, float]
    converged: bool = True
    iterations: int = 0


@dataclass(frozen=True)
class ValueWithError:
    """A number with its standard error."""

    value: float
    stderr: float

    def __str__(self) -> str:
        return f"{self.value:.5g} +- {self.stderr:.2g}"


def average_estimates(values: Sequence[float], stderr: Sequence[float]) -> Pooled | None:
    """Return the average of the estimates with a standard error; None if there are none."""
    estimates, errors = [], []
    for value, error in zip(values, stderr):
        if math.isfinite(value) and math.isfinite(error) and error > 0.0:
            estimates.append(value)
            errors.append(error)
    return pool(estimates, errors, "inverse_sigma") if estimates else None
