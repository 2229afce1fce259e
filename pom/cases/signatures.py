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
    """Return signatures as plain data, by role in the order of the block."""
    return {role: given[role].model_dump() for role in ROLES if role in given}


def signature_rows(given: Mapping[str, Mapping[str, Any]], date: str) -> list[dict[str, str]]:
    """Return the rows of the block of signatures, one for each role.

    Parameters
    ----------
    given : mapping
        Of `plain_signatures`; roles without an entry stay empty, for a signature by hand.
    date : str
        Of the results, empty where none is given: who signed on an earlier day has not seen these results.

    Returns
    -------
    list of dict
        ``role``, ``name`` (with the organisation), ``date``, ``remark``.
    """
    rows = []
    for role in ROLES:
        one = given.get(role, {})
        early = bool(one) and bool(date) and one["date"] < date[:10]
        name = ", ".join(filter(None, (one.get("name", ""), one.get("organisation", ""))))
        rows.append({"role": role, "name": name, "date": one.get("date", ""), "remark": f"before these results of {date}" if early else ""})
    return rows
