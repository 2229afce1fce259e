"""Standards and editions of the tolerance table by parts of their names, and titles of tests."""

from __future__ import annotations

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
