"""Standards and editions of the tolerance table by parts of their names, and titles of tests."""

from __future__ import annotations

import re
from collections.abc import Iterator, Sequence

from flightmech.errors import UnknownName
from pom.tolerances import rows


def edition_of(standard: str | None = None, edition: str | None = None) -> tuple[str, str]:
    """Return the full names of a standard and an edition.

    Parameters
    ----------
    standard : str, optional
        Part of the name of one standard only, ``CCAR`` or ``B2A``.  Default: `rows.STANDARD`.
    edition : str, optional
        First digits of the edition, such as ``2016``.  Default: `rows.EDITION`, or the oldest
        edition of the standard.

    Raises
    ------
    UnknownName
        No name fits, or several names fit.
    """
    standards = {row["standard"] for row in rows.tolerance_rows()}
    full_standard = rows.STANDARD
    if standard is not None:
        fitting = {name for name in standards if standard.lower() in name.lower()}
        full_standard = _select_one(standard, fitting, standards, what="standard")
    editions = set()
    for row in rows.tolerance_rows():
        if row["standard"] == full_standard:
            editions.add(row["edition"])
    if edition is not None:
        fitting = {name for name in editions if name.startswith(edition)}
        what = f"edition of {full_standard!r}"
        return full_standard, _select_one(edition, fitting, editions, what=what)
    # The default edition belongs to one standard; dates sort as texts.
    if rows.EDITION in editions:
        return full_standard, rows.EDITION
    return full_standard, min(editions)


def test_order(test_id: str) -> tuple[tuple[int, str], ...]:
    """Return the key that sorts tests as the table prints them: 2.c.9 before 2.c.10.

    Examples
    --------
    >>> sorted(["2.c.10", "2.c(9)", "1.e.1", "2.a.1.b"], key=test_order)
    ['1.e.1', '2.a.1.b', '2.c(9)', '2.c.10']
    """
    parts = re.findall(r"\d+|[a-zA-Z]+", test_id)
    return tuple((int(part), "") if part.isdigit() else (0, part.lower()) for part in parts)


def titles_of_tests(standard: str, edition: str) -> dict[str, str]:
    """Return the titles of the tests of an edition, in the order of the table."""
    titles = {}
    for row in rows.tolerance_rows():
        if (row["standard"], row["edition"]) == (standard, edition):
            titles[row["test_id"]] = row["title"]
    return titles


def _select_one(name: str, fitting: set[str], allowed: set[str], *, what: str) -> str:
    """Return the only fitting name, or the name itself if it is complete."""
    # A complete name may be a part of another one.
    if name in fitting:
        return name
    if len(fitting) != 1:
        hint = "several have it in their name" if fitting else ""
        raise UnknownName(name, allowed, what=what, hint=hint)
    return fitting.pop()


RESTS_ON = (
    "group",
    "measure",
    "applies_from",
    "applies_to",
    "condition",
    "flight_condition",
)
"""Columns of a row, in addition to its band, that change a judgement."""


def different_rows(
    old: Sequence[rows.Row], new: Sequence[rows.Row]
) -> Iterator[tuple[str, tuple[str, str]]]:
    """Yield name, old and new text of every row of a test that differs between two tables.

    The text of a row that is missing is ``absent``.
    """
    by_name = [dict(zip(rows.names_of(list(table)), table, strict=True)) for table in (old, new)]
    for name in dict.fromkeys([*by_name[0], *by_name[1]]):
        before, after = by_name[0].get(name), by_name[1].get(name)
        if before is None or after is None:
            yield name, (_width_text(before), _width_text(after))
            continue
        bands = rows.band_of(before), rows.band_of(after)
        texts = [_width_text(before), _width_text(after)]
        # the rule and the base of a percentage are part of the band
        others = [column for column in RESTS_ON if before[column] != after[column]]
        if bands[0] == bands[1] and not others:
            continue
        for column in others:
            texts[0] += f", {column} {before[column] or 'empty'}"
            texts[1] += f", {column} {after[column] or 'empty'}"
        yield name, (texts[0], texts[1])


def _width_text(row: rows.Row | None) -> str:
    """Return the tolerance of a row as text; ``absent`` without a row."""
    if row is None:
        return "absent"
    return rows.band_of(row).text or "no number"
