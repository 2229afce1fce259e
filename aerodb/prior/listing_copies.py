"""Listings that were copied over another one: a case of other conditions is then missing."""

from __future__ import annotations

import re

import numpy as np

from aerodb.prior.clean_cases import case_label
from aerodb.prior.sources import warn_user
from datcom_io.listing import Case


def warn_of_copy(case: Case, used: Case, role: str) -> None:
    """Warn of a case that is left out of a role because another one has all of its numbers.

    Parameters
    ----------
    case, used : Case
        The case that is left out, and the one with its conditions.
    role : str
        Role in `from_datcom`.

    Warns
    -----
    AeromatchWarning
        The names of the listings state other numbers, such as m0.1 and m0.2, and their pages print
        the same ones.
    """
    if _has_other_numbers(case, used) and _is_copy(case, used):
        warn_user(
            f"{case_label(case)} is left out as {role}: it prints the same numbers as "
            f"{case_label(used)}; if it is a case of other conditions, its listing was copied "
            f"over: give the listing that DATCOM wrote for it, else delete the copy"
        )


def _has_other_numbers(one: Case, other: Case) -> bool:
    """Return whether the names of two listings state other numbers, such as m0.1 and m0.2.

    The print of another program may have the same numbers on its pages and in its name.
    """
    first, second = (re.findall(r"\d+(?:\.\d+)?", case.file) for case in (one, other))
    return first != second


def _is_copy(one: Case, other: Case) -> bool:
    """Return whether two cases print the same numbers on all pages."""
    tables = []
    for case in (one, other):
        tables.append([table.values for page in case.pages for table in page.tables])
    pairs = zip(*tables, strict=False)
    return len(tables[0]) == len(tables[1]) and all(
        np.array_equal(first, second, equal_nan=True) for first, second in pairs
    )
