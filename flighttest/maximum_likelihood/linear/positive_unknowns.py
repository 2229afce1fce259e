"""Unknowns that cannot be negative: noises, intensities and lengths of filter error."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from typing import NamedTuple

import numpy as np

from flightmech.errors import SchemaError
from flighttest.maximum_likelihood.unknowns import UnknownVector
from flighttest.parameter_constraints import parse_constraints

# kinds of unknowns that are standard deviations, and those that are lengths
DEVIATIONS, LENGTHS = ("process", "noise", "gust"), ("scale",)
_WIDEST = 30.0  # bounds of the scale of a gust, as a factor of its start
_CALM = 1e-4  # lower bound of intensities and noises, of their start: below, they count as zero


class PositiveTransform(NamedTuple):
    """Unknowns of the search: deviations as squares, lengths as logarithms, over their start.

    For the variance of a noise alone, one step of scoring reaches the maximum. A length cannot
    reach zero by a step of its logarithm.
    """

    natural: UnknownVector
    layout: UnknownVector
    is_squared: np.ndarray
    is_logarithm: np.ndarray

    def back(self, theta: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Return the natural unknowns, and their derivatives by those of the search."""
        # sigma = start sqrt(s), d sigma/d s = start^2 / (2 sigma); L = start e^l, d L/d l = L
        start = self.natural.start
        deviation = start * np.sqrt(np.abs(theta))
        length = start * np.exp(np.where(self.is_logarithm, theta, 0.0))
        values = np.where(self.is_squared, deviation, np.where(self.is_logarithm, length, theta))
        slopes = np.where(self.is_logarithm, length, 1.0)
        np.divide(start**2, 2.0 * values, out=slopes, where=self.is_squared)
        return values, slopes


def transform_positive(natural: UnknownVector) -> PositiveTransform:
    """Return the unknowns of the search."""
    kinds = [name.split(".")[0] for name in natural.names]
    is_squared = np.array([kind in DEVIATIONS for kind in kinds])
    is_logarithm = np.array([kind in LENGTHS for kind in kinds])
    is_positive = is_squared | is_logarithm
    problems = []
    for name, start, positive in zip(natural.names, natural.start, is_positive):
        if positive and not start > 0.0:
            problems.append(
                f"{name} starts at zero or below; give a positive start, or leave it out"
            )
    if problems:
        raise SchemaError("unknowns", problems)
    # s = (sigma / start)^2: at the start its standard error is 2 / start times that of sigma.
    unit = np.where(is_positive, natural.start, 1.0)
    low = np.maximum(natural.low / unit, _CALM) ** 2
    shortest = np.log(np.maximum(natural.low / unit, 1.0 / _WIDEST))
    longest = np.log(np.clip(natural.high / unit, 1.0, _WIDEST))
    by_kind = [is_squared, is_logarithm]
    layout = replace(
        natural,
        start=np.select(by_kind, [1.0, 0.0], natural.start),
        sigma=natural.sigma * np.select(by_kind, [2.0, 1.0], 1.0) / unit,
        low=np.select(by_kind, [low, shortest], natural.low),
        high=np.select(by_kind, [(natural.high / unit) ** 2, longest], natural.high),
    )
    return PositiveTransform(natural, layout, is_squared, is_logarithm)


def refuse_positive_constraints(names: Sequence[str], constraints: Sequence[str]) -> None:
    """Raise SchemaError for constraints of unknowns that are not searched as such.

    They are noises, intensities and scales, and first gusts, which are over their intensity.
    """
    problems = []
    for constraint in parse_constraints(constraints, names):
        for k in np.flatnonzero(constraint.weights):
            name = names[int(k)]
            if name.split(".")[0] in (*DEVIATIONS, *LENGTHS) or name.startswith("init.gust_"):
                problems.append(
                    f"{constraint.text!r}: {name} is a noise or a scale, or a gust over one; "
                    f"give it a start, or leave it out"
                )
    if problems:
        raise SchemaError("constraints", problems)
