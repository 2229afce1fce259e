"""Who signs a case or a report: the block of signatures, by role."""

from __future__ import annotations

import datetime
from collections.abc import Mapping
from typing import Any, Literal, get_args

from pydantic import Field, field_validator

from flightmech.support.configuration import Strict

Role = Literal["prepared", "checked", "approved", "authority"]
ROLES: tuple[Role, ...] = get_args(Role)
"""Rows of the block, in its order."""


class Signature(Strict):
    """One person who signs; the signature itself is made by hand or by the tool of the office."""

    name: str = Field(min_length=1, max_length=100, examples=["A. Engineer"], description="Name.")
    date: str = Field(examples=["2026-11-21"], description="Day of the signature, YYYY-MM-DD.")
    organisation: str = Field(default="", max_length=100, examples=["flight test"], description="Organisation or function.")
    results: str = Field(
        default="",
        pattern=r"^([0-9a-f]{8,64})?$",
        examples=["3f9a12c4d0be"],
        description="The results that were signed, as the report names them; the signature is marked where a report has others.",
    )

    @field_validator("date")
    @classmethod
    def _a_day(cls, date: str) -> str:
        try:
            day = datetime.date.fromisoformat(date)
        except ValueError:
            raise ValueError(f"{date!r} is no day; write YYYY-MM-DD") from None
        return day.isoformat()


class Signatures(Strict):
    """The block of signatures of a report or a case."""

    signatures: dict[Role, Signature] = Field(default={}, description="Who signs, by role.")


def plain_signatures(given: Mapping[Role, Signature]) -> dict[str, dict[str, str]]:
    """Return signatures as plain data, by role in the order of the block; ``results`` where they are named."""
    dumped = {role: given[role].model_dump() for role in ROLES if role in given}
    return {role: {key: text for key, text in one.items() if text or key != "results"} for role, one in dumped.items()}


def signature_rows(given: Mapping[str, Mapping[str, Any]], date: str, results: str = "") -> list[dict[str, str]]:
    """Return the rows of the block of signatures, one for each role.

    Parameters
    ----------
    given : mapping
        Of `plain_signatures`; roles without an entry stay empty, for a signature by hand.
    date : str
        Of the results, empty where none is given: who signed on an earlier day has not seen these results.
    results : str
        Their name (`pom.result.results_name`), empty where there are none yet: who signed others has not seen them either.

    Returns
    -------
    list of dict
        ``role``, ``name`` (with the organisation), ``date``, ``remark``.
    """
    rows = []
    for role in ROLES:
        one = given.get(role, {})
        signed, remark = one.get("results", ""), ""
        if signed and results and signed[: len(results)] != results[: len(signed)]:
            remark = f"for other results, {signed[: len(results)]}"
        elif one and date and one["date"] < date[:10]:
            remark = f"before these results of {date}"
        name = ", ".join(filter(None, (one.get("name", ""), one.get("organisation", ""))))
        rows.append({"role": role, "name": name, "date": one.get("date", ""), "remark": remark})
    return rows
