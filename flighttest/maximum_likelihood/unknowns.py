"""Unknown parameters of a likelihood, and their vector over all manoeuvres."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from flightmech.errors import SchemaError


class Unknown(NamedTuple):
    """One parameter to estimate.

    Attributes
    ----------
    start : float or None
        Start value, and mean of the prior. None for a parameter that the record gives at its first
        sample, such as ``init.alpha``. [SI]
    sigma : float
        Standard error of the a-priori value; infinite without a-priori value. [SI]
    low, high : float
        Bounds. [SI]
    own : bool
        Whether every manoeuvre has a separate value.
    """

    start: float | None
    sigma: float = math.inf
    low: float = -math.inf
    high: float = math.inf
    own: bool = False


Wanted = Mapping[str, "Unknown | float | tuple"]


@dataclass(frozen=True)
class UnknownVector:
    """All unknowns as one vector.

    Attributes
    ----------
    names : tuple of str
        One per unknown. The name of an unknown of one manoeuvre ends in ``@1``, ``@2`` ...
    bases : tuple of tuple of str
        Per manoeuvre the names of its unknowns without this ending.
    columns : tuple of array of int
        Per manoeuvre the positions of its unknowns in the vector.
    start, sigma, low, high : array (unknown,)
        Fields of `Unknown`.
    """

    names: tuple[str, ...]
    bases: tuple[tuple[str, ...], ...]
    columns: tuple[np.ndarray, ...]
    start: np.ndarray
    sigma: np.ndarray
    low: np.ndarray
    high: np.ndarray


def lay_out(unknowns: Wanted, recorded: Sequence[Mapping[str, float]]) -> UnknownVector:
    """Return the vector of the unknowns.

    Parameters
    ----------
    unknowns : mapping of str to Unknown, tuple or float
        A tuple contains the first fields of `Unknown`; a number is the start value.
    recorded : sequence of mapping of str to float
        Per manoeuvre, the values that replace a start of None.

    Raises
    ------
    SchemaError
        Unknowns without a start, a start outside the bounds, or a prior standard error that is not
        positive. One error lists all of them.
    """
    problems: list[str] = []
    if not unknowns:
        problems.append("no unknown; name at least one parameter")
    names: list[str] = []
    starts: list[float] = []
    items: list[Unknown] = []
    positions: list[dict[str, int]] = [{} for _ in recorded]
    for name, item in unknowns.items():
        unknown = _as_unknown(item)
        # A common unknown is one element for all manoeuvres, a separate one has one for each.
        groups = [range(len(recorded))]
        if unknown.own:
            groups = [range(k, k + 1) for k in range(len(recorded))]
        for group in groups:
            label = name
            if unknown.own and len(recorded) > 1:
                label = f"{name}@{group[0] + 1}"
            start = unknown.start
            if start is None:
                start = recorded[group[0]].get(name)
            problems += _list_problems(label, start, unknown)
            for k in group:
                positions[k][name] = len(names)
            names.append(label)
            starts.append(math.nan if start is None else float(start))
            items.append(unknown)
    if problems:
        raise SchemaError("unknowns", problems)
    # columns of the fields start, sigma, low, high, own
    fields = np.array(items, dtype=float)
    return UnknownVector(
        names=tuple(names),
        bases=tuple(map(tuple, positions)),
        columns=tuple(np.array(list(position.values()), int) for position in positions),
        start=np.array(starts),
        sigma=fields[:, 1].copy(),
        low=fields[:, 2].copy(),
        high=fields[:, 3].copy(),
    )


def _as_unknown(item: Unknown | float | tuple) -> Unknown:
    if isinstance(item, tuple):
        return Unknown(*item)
    return Unknown(item)


def _list_problems(label: str, start: float | None, unknown: Unknown) -> list[str]:
    """Return the problems of one unknown."""
    low, high = unknown.low, unknown.high
    if start is None:
        return [f"{label} has no start, and neither model nor record gives it; give a start"]
    if not math.isfinite(start) or not low < high or not low <= start <= high:
        return [
            f"{label} starts at {start:g}, bounds {low:g} ... {high:g}; the start must be finite "
            f"and lie between them"
        ]
    if not unknown.sigma > 0.0:
        return [
            f"{label} has a prior standard error of {unknown.sigma:g}; give a positive one, "
            f"or hold the parameter at its value"
        ]
    return []
