"""The page of a case as the report holds it: packed for the script, in brief for readers without one."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import pandas as pd

from pom.result import PomResult

from ..page_templates import page_templates
from ..presentation.traces import parcel
from . import case

# figures for readers without a script take 10 kB a case: only a report that is short enough to be read that way has them
MOST_WITH_FIGURES = 30


@dataclass(frozen=True)
class Heading:
    """What the pages of all cases share.

    Attributes
    ----------
    title, revision : str
        Of the report.
    count : int
        Of the cases.
    provenance : mapping
        As `pom.write_report` takes it.
    with_databases : bool
        The report compares databases: terms lead to their tables.
    """

    title: str
    revision: str
    count: int
    provenance: Mapping[str, Any]
    with_databases: bool


@dataclass(frozen=True)
class PackedPage:
    """The page of one case, and what the overview shows of it.

    Attributes
    ----------
    key : str
        Its name in addresses and files.
    outcome : list of dict
        Of `case.outcomes`.
    brief : str
        HTML for readers without a script.
    parcel : str
        Page and traces, of `presentation.traces.parcel`.
    """

    key: str
    outcome: list[dict[str, Any]]
    brief: str
    parcel: str

    @property
    def fail(self) -> bool:
        """Whether a model failed, or passed with limits exceeded."""
        return any(cell["status"] in ("fail", "limits_exceeded", "record_error") for cell in self.outcome)


def packed_page(
    position: int, key: str, result: PomResult, heading: Heading, diagnosis: pd.DataFrame | None, modes: pd.DataFrame
) -> PackedPage:
    """Return the page of the case at `position`, counted from one; `modes` is its table of modes."""
    made_from = heading.provenance
    outcome = case.outcomes(result, case.line_styles(result.runs))
    page = case.case_page(key, result, outcome, made_from, diagnosis, modes, with_figures=heading.count <= MOST_WITH_FIGURES)
    context = {
        "title": heading.title,
        "revision": heading.revision,
        "count": heading.count,
        "origin": {"date": made_from.get("date", ""), "versions": sorted(made_from.get("versions", {}).items())},
        "models": heading.with_databases,
        "page": {**page, "position": position},
    }
    whole, brief = (page_templates().get_template(name).render(context) for name in ("case.html", "brief.html"))
    return PackedPage(key, outcome, brief, parcel({**page["head"], "page": whole}, page["body"]))
