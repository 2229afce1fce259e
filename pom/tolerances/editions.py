"""Standards and editions of the tolerance table by parts of their names, and the titles of their
tests.
"""

from __future__ import annotations

from flightmech.errors import UnknownName
from pom.tolerances import rows


def edition_of(standard: str | None = None, edition: str | None = None) -> tuple[str, str]:
    """Return standard and edition in full.

    Parameters
    ----------
    standard : str, optional
        Any part of its name that no other has, ``CCAR`` or ``B2A``; the default one without it.
    edition : str, optional
        Its first digits, such as ``2016``; without it the default one, or the oldest of the
        standard.

    Raises
    ------
    UnknownName
        None fits, or several do.
    """
    standards = {row["standard"] for row in rows.tolerance_rows()}
    chosen = (
        rows.STANDARD
        if standard is None
        else _only(
            standard, [s for s in standards if standard.lower() in s.lower()], standards, "standard"
        )
    )
    editions = {row["edition"] for row in rows.tolerance_rows() if row["standard"] == chosen}
    if edition is None:
        return chosen, rows.EDITION if rows.EDITION in editions else min(editions)
    return chosen, _only(
        edition, [e for e in editions if e.startswith(edition)], editions, f"edition of {chosen!r}"
    )


def titles_of_tests(standard: str, edition: str) -> dict[str, str]:
    """Return the tests of an edition with their titles, in the order of the table."""
    return {
        row["test_id"]: row["title"]
        for row in rows.tolerance_rows()
        if (row["standard"], row["edition"]) == (standard, edition)
    }


def _only(name: str, fitting: list[str], allowed: set[str], what: str) -> str:
    if name in fitting:
        return name
    if len(fitting) != 1:
        raise UnknownName(name, allowed, what, "several have it in their name" if fitting else "")
    return fitting[0]
