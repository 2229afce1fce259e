"""Signatures of a report or a case: who signs, and the rows of the signature block."""

from __future__ import annotations

import datetime
from collections.abc import Mapping
from typing import Any, Literal, get_args

from pydantic import Field, field_validator

from flightmech.support.toml_models import Strict

Role = Literal["prepared", "checked", "approved", "authority"]
ROLES: tuple[Role, ...] = get_args(Role)
"""Roles in the order of the rows of the signature block."""


class Signature(Strict):
    """One person who signs; the signature itself is made by hand or by the tool of the office."""

    name: str = Field(min_length=1, max_length=100, examples=["A. Engineer"], description="Name.")
    date: str = Field(examples=["2026-11-21"], description="Day of the signature, YYYY-MM-DD.")
    organisation: str = Field(
        default="",
        max_length=100,
        examples=["flight test"],
        description="Organisation or function.",
    )
    results: str = Field(
        default="",
        pattern=r"^([0-9a-f]{8,64})?$",
        examples=["3f9a12c4d0be"],
        description="The results that were signed, as the report names them; the signature is "
        "marked where a report has others.",
    )

    @field_validator("date")
    @classmethod
    def _check_day(cls, date: str) -> str:
        try:
            day = datetime.date.fromisoformat(date)
        except ValueError:
            raise ValueError(f"{date!r} is not a day; write YYYY-MM-DD") from None
        return day.isoformat()


class Signatures(Strict):
    """The block of signatures of a report or a case."""

    signatures: dict[Role, Signature] = Field(default={}, description="Who signs, by role.")


def plain_signatures(signatures: Mapping[Role, Signature]) -> dict[str, dict[str, str]]:
    """Return signatures as plain data, by role in the order of the block.

    ``results`` is present only if the signature names results.
    """
    plain: dict[str, dict[str, str]] = {}
    for role in ROLES:
        if role in signatures:
            entry = signatures[role].model_dump()
            plain[role] = {key: text for key, text in entry.items() if text or key != "results"}
    return plain


def signature_rows(
    signatures: Mapping[str, Mapping[str, Any]], date: str, results: str = ""
) -> list[dict[str, str]]:
    """Return the rows of the signature block, one for each role.

    Parameters
    ----------
    signatures : mapping
        Of `plain_signatures`.  A role without an entry has an empty row, for a signature by hand.
    date : str
        Date of the results, or empty.  A signature of an earlier day gets a remark.
    results : str
        Name of the results (`pom.result.results_name`), or empty.  A signature for other results
        gets a remark.

    Returns
    -------
    list of dict
        ``role``, ``name`` (with the organisation), ``date``, ``remark``.
    """
    rows = []
    for role in ROLES:
        entry = signatures.get(role, {})
        signed, remark = entry.get("results", ""), ""
        # Both names are digits of one hash; the shorter one is compared.
        if signed and results and signed[: len(results)] != results[: len(signed)]:
            remark = f"for other results, {signed[: len(results)]}"
        elif entry and date and entry["date"] < date[:10]:
            remark = f"before these results of {date}"
        name = ", ".join(filter(None, (entry.get("name", ""), entry.get("organisation", ""))))
        rows.append({"role": role, "name": name, "date": entry.get("date", ""), "remark": remark})
    return rows
