"""Unique names for the columns of a CSV file whose headings are blank or shared.

Two columns under one heading are either two copies or two quantities.  Copies are read once.  Two
quantities have numbered names, ``Alt.1`` and ``Alt.2``, so that a name map must state which one it
means.
"""

from __future__ import annotations

import re
from collections import Counter
from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
import numpy.typing as npt

from flighttest.records.readers.recording import LeftOut


def own_names(heads: Sequence[str]) -> tuple[list[str], dict[str, list[str]]]:
    """Return a unique name for each column, and the names under each shared heading.

    Parameters
    ----------
    heads : sequence of str
        Headings from left to right, without their units.

    Returns
    -------
    names : list of str
        A shared heading has a number behind it, a blank heading is ``column 3``.
    shared : dict of str to list of str
        Heading -> its names.

    Examples
    --------
    >>> own_names(["time", "Alt", "", "Alt"])
    (['time', 'Alt.1', 'column 3', 'Alt.2'], {'Alt': ['Alt.1', 'Alt.2']})
    """
    names: list[str] = []
    shared: dict[str, list[str]] = {}
    # An untrusted file may have 20 000 headings: sets and counters keep the search linear.
    counts = Counter(heads)
    taken = set(heads)
    last: dict[str, int] = {}
    for i, head in enumerate(heads):
        name = head or f"column {i + 1}"
        if head and counts[head] > 1:
            number = last.get(head, 0) + 1
            # A heading of the file may already look like a numbered name.
            while (name := f"{head}.{number}") in taken:
                number += 1
            last[head] = number
            shared.setdefault(head, []).append(name)
        taken.add(name)
        names.append(name)
    return names, shared


def without_copies(
    columns: Mapping[str, Any],
    units: dict[str, str],
    shared: Mapping[str, Sequence[str]],
    table: str,
) -> tuple[dict[str, Any], tuple[str, ...], list[LeftOut]]:
    """Return the columns with copies joined under their heading.

    Parameters
    ----------
    columns : mapping of str to array (time,)
        By the names of `own_names`, without the omitted columns.
    units : dict of str to str
        By the same names.  The units of joined columns are added.
    shared : mapping of str to sequence of str
        Result of `own_names`.
    table : str
        Name of the table, for the list of omitted headings.

    Returns
    -------
    columns : dict of str to array (time,)
        Without columns that have neither heading nor content.
    notes : tuple of str
        One note for each joined heading.
    left_out : list of LeftOut
        Headings of columns with different contents.
    """
    remaining = {}
    for name, values in columns.items():
        if not _is_empty(name, values):
            remaining[name] = values
    notes: list[str] = []
    left_out: list[LeftOut] = []
    for head, names in shared.items():
        # Columns of one heading with the same content are one; otherwise all of them are left out.
        present = [name for name in names if name in remaining]
        if len(present) == len(names) and _are_copies(names, remaining, units):
            remaining = _join_copies(remaining, names, head)
            if names[0] in units:
                units[head] = units[names[0]]
            notes.append(f"{len(names)} columns {head!r} hold the same; the first one is read")
        elif present:  # otherwise each column is in the list of omitted columns already
            called = ", ".join(names)
            reason = (
                f"{len(names)} columns {head!r} of different content, called {called} "
                f"from left to right"
            )
            left_out.append(
                LeftOut(f"{table}/{head}", reason, remedy=f"one of {called}", fault=head)
            )
    return remaining, tuple(notes), left_out


def _are_copies(names: Sequence[str], columns: Mapping[str, Any], units: Mapping[str, str]) -> bool:
    """Return whether columns have the same content and unit."""
    first = names[0]
    for name in names[1:]:
        if not _have_same_values(columns[first], columns[name]):
            return False
        if units.get(first) != units.get(name):
            return False
    return True


def _join_copies(columns: Mapping[str, Any], names: Sequence[str], head: str) -> dict[str, Any]:
    """Return the columns with the first copy under the heading and without the other copies."""
    joined = {}
    for name, values in columns.items():
        if name == names[0]:
            joined[head] = values
        elif name not in names:
            joined[name] = values
    return joined


def _have_same_values(first: npt.ArrayLike, second: npt.ArrayLike) -> bool:
    """Return whether two columns are equal; NaN equals NaN."""
    a, b = np.asarray(first), np.asarray(second)
    are_numbers = a.dtype.kind == b.dtype.kind == "f"
    return bool(np.array_equal(a, b, equal_nan=are_numbers))


def _is_empty(name: str, values: npt.ArrayLike) -> bool:
    """Return whether a column has neither heading nor content, as behind a last separator."""
    if re.fullmatch(r"column \d+", name) is None:
        return False
    cells = np.asarray(values)
    return cells.dtype.kind == "f" and bool(np.isnan(cells).all())
