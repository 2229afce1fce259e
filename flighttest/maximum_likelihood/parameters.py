"""The unknowns of a likelihood: where they start, what is known of them, which manoeuvres share them."""

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
        First value, and mean of the prior.  None for what a record gives at its first sample, such as ``init.alpha``. [SI]
    sigma : float
        Standard error of the a-priori value; infinite when nothing is known. [SI]
    low, high : float
        Bounds. [SI]
    own : bool
        Whether every manoeuvre has a value of its own.
    """

    start: float | None
    sigma: float = math.inf
    low: float = -math.inf
    high: float = math.inf
    own: bool = False


Wanted = Mapping[str, "Unknown | float | tuple"]


@dataclass(frozen=True)
class Layout:
    """All unknowns as one vector.

    Attributes
    ----------
    names : tuple of str
        One per unknown; that of a manoeuvre alone ends in ``@1``, ``@2`` ...
    bases : tuple of tuple of str
        Per manoeuvre the plain names of its unknowns.
    columns : tuple of array of int
        Per manoeuvre their places in the vector.
    start, sigma, low, high : array (unknown,)
    """

    names: tuple[str, ...]
    bases: tuple[tuple[str, ...], ...]
    columns: tuple[np.ndarray, ...]
    start: np.ndarray
    sigma: np.ndarray
    low: np.ndarray
    high: np.ndarray


def lay_out(wanted: Wanted, recorded: Sequence[Mapping[str, float]]) -> Layout:
    """Return the vector of the unknowns.

    Parameters
    ----------
    wanted : mapping of str to Unknown, tuple or float
        A tuple holds the first fields of `Unknown`, a number is the start alone.
    recorded : sequence of mapping of str to float
        Per manoeuvre, what stands for a start of None.

    Raises
    ------
    SchemaError
        Unknowns without a start, outside their bounds, with a prior that is not positive; all at once.
    """
    unknowns = {name: _unknown(item) for name, item in wanted.items()}
    problems = [] if unknowns else ["no unknown; name at least one parameter"]
    rows: list[tuple[str, float, Unknown]] = []
    places: list[dict[str, int]] = [{} for _ in recorded]
    for name, unknown in unknowns.items():
        groups = [[k] for k in range(len(recorded))] if unknown.own else [list(range(len(recorded)))]
        for group in groups:
            label = f"{name}@{group[0] + 1}" if unknown.own and len(recorded) > 1 else name
            start = recorded[group[0]].get(name) if unknown.start is None else float(unknown.start)
            problems += _problems(label, start, unknown)
            for k in group:
                places[k][name] = len(rows)
            rows.append((label, math.nan if start is None else start, unknown))
    if problems:
        raise SchemaError("unknowns", problems)
    return Layout(
        tuple(label for label, _, _ in rows),
        tuple(tuple(place) for place in places),
        tuple(np.array(list(place.values()), int) for place in places),
        np.array([start for _, start, _ in rows]),
        *(np.array([getattr(unknown, field) for _, _, unknown in rows], float) for field in ("sigma", "low", "high")),
    )


def _unknown(item: Unknown | float | tuple) -> Unknown:
    return Unknown(*item) if isinstance(item, tuple) else Unknown(item)


def _problems(label: str, start: float | None, unknown: Unknown) -> list[str]:
    if start is None:
        return [f"{label} has no start, and neither model nor record gives it; give a start"]
    if not math.isfinite(start) or not unknown.low < unknown.high or not unknown.low <= start <= unknown.high:
        return [f"{label} starts at {start:g}, bounds {unknown.low:g} ... {unknown.high:g}; the start must be finite and lie between them"]
    if not unknown.sigma > 0.0:
        return [f"{label} has a prior standard error of {unknown.sigma:g}; give a positive one, or hold the parameter at its value"]
    return []
