"""Samples of long parameter lists.

``./run test`` runs the first few cases of a list, ``.ci/run`` a sample that holds each pair of
properties, ``.ci/nightly`` all.
"""

from __future__ import annotations

from collections.abc import Callable, Hashable, Iterable, Mapping, Sequence
from itertools import combinations
from typing import Any

import pytest


def sampled(
    cases: Sequence[Any] | Mapping[str, Any],
    properties: Callable[[Any], Iterable[Hashable]],
    fast: int = 0,
    order: int = 2,
) -> list[Any]:
    """Return the cases as parameters of pytest, marked ``slow`` and ``nightly`` by the run that
    they are for.

    Parameters
    ----------
    cases : sequence or mapping
        Of a mapping its keys.
    properties : callable
        Case -> what it has in common with others, such as the sensor, the kind of fault or the file
        format.
    fast : int
        Number of cases without a mark, from the first.
    order : int
        2: the sample holds each pair of properties that some case has.  1: each property.
    """
    cases = list(cases)
    sample = _cover([_combinations(properties(case), order) for case in cases])
    marks: list[tuple[pytest.MarkDecorator, ...]] = []
    for k in range(len(cases)):
        if k < fast:
            marks.append(())
        elif k in sample:
            marks.append((pytest.mark.slow,))
        else:
            marks.append((pytest.mark.slow, pytest.mark.nightly))
    return [pytest.param(case, marks=mark) for case, mark in zip(cases, marks, strict=True)]


def _combinations(properties: Iterable[Hashable], order: int) -> set[frozenset[Hashable]]:
    """Return the sets of `order` properties of a case, or of all where it has fewer; a case without
    properties is not sampled.
    """
    unique = set(properties)
    if not unique:
        return set()
    return {frozenset(some) for some in combinations(unique, min(order, len(unique)))}


def _cover(held: Sequence[set[frozenset[Hashable]]]) -> set[int]:
    """Return places of cases that together hold all combinations: greedily, always the case that
    adds most, the first of several.
    """
    missing = set().union(*held)
    sample: set[int] = set()
    while missing:
        best = max(range(len(held)), key=lambda k: (len(held[k] & missing), -k))
        sample.add(best)
        missing -= held[best]
    return sample
