"""Headings of a CSV file that share a name or have none.

Two columns under one heading are a column written twice, or two quantities.  The first is read
once.  Of the second kind none may be taken for the other: each gets its number behind its name,
``Alt.1`` and ``Alt.2``, so that a name map has to state which one it means.
"""

from __future__ import annotations

import re
from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
import numpy.typing as npt

from flighttest.records.readers.recording import LeftOut


def own_names(heads: Sequence[str]) -> tuple[list[str], dict[str, list[str]]]:
    """Return a name of its own for each column, and the names that those of one heading got.

    Parameters
    ----------
    heads : sequence of str
        Headings from left to right, without their units.

    Returns
    -------
    names : list of str
        A heading that others share has a number behind it, a blank one is ``column 3``.
    shared : dict of str to list of str
        Heading -> its names.

    Examples
    --------
    >>> own_names(["time", "Alt", "", "Alt"])
    (['time', 'Alt.1', 'column 3', 'Alt.2'], {'Alt': ['Alt.1', 'Alt.2']})
    """
    names: list[str] = []
    shared: dict[str, list[str]] = {}
    for at, head in enumerate(heads):
        name = head or f"column {at + 1}"
        if head and heads.count(head) > 1:
            number = len(shared.setdefault(head, [])) + 1
            while (name := f"{head}.{number}") in (*heads, *names):
                number += 1
            shared[head].append(name)
        names.append(name)
    return names, shared


def without_copies(
    columns: Mapping[str, Any],
    units: dict[str, str],
    shared: Mapping[str, Sequence[str]],
    table: str,
) -> tuple[dict[str, Any], tuple[str, ...], list[LeftOut]]:
    """Return the columns with those of one heading and one content joined under that heading, notes
    on them, and the headings that are no column because their contents differ.

    Parameters
    ----------
    columns : mapping of str to array (time,)
        By the names of `own_names`; columns that are left out are missing.
    units : dict of str to str
        By the same names; those of joined columns are added.
    shared : mapping of str to sequence of str
        Of `own_names`.
    table : str
        Name of the table, for the list of headings that are left out.
    """
    found = {name: values for name, values in columns.items() if not _is_empty(name, values)}
    notes: list[str] = []
    left_out: list[LeftOut] = []
    for head, names in shared.items():
        first, *others = names
        if all(name in found for name in names) and all(
            _same(found[first], found[name]) and units.get(first) == units.get(name)
            for name in others
        ):
            found = {
                head if name == first else name: values
                for name, values in found.items()
                if name not in others
            }
            if first in units:
                units[head] = units[first]
            notes.append(f"{len(names)} columns {head!r} hold the same; the first one is read")
            continue
        if not any(name in found for name in names):  # each is named as left out already
            continue
        reason = (
            f"{len(names)} columns {head!r} of different content, called {', '.join(names)} "
            f"from left to right"
        )
        left_out.append(LeftOut(f"{table}/{head}", reason, f"one of {', '.join(names)}", head))
    return found, tuple(notes), left_out


def _same(one: npt.ArrayLike, other: npt.ArrayLike) -> bool:
    first, second = np.asarray(one), np.asarray(other)
    numbers = first.dtype.kind == second.dtype.kind == "f"
    return bool(np.array_equal(first, second, equal_nan=numbers))


def _is_empty(name: str, values: npt.ArrayLike) -> bool:
    """Whether a column has neither heading nor content, as behind a last separator."""
    cells = np.asarray(values)
    return (
        re.fullmatch(r"column \d+", name) is not None
        and cells.dtype.kind == "f"
        and bool(np.isnan(cells).all())
    )
