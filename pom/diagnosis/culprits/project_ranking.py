"""The joint ranking of wrong terms over all cases of a project, as a table and in sentences."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, field

import pandas as pd
import xarray as xr

from aerodb.store.overview import list_origins
from pom.diagnosis.culprits.ranking import order_corrections, rank_culprits
from pom.diagnosis.culprits.sentences import describe_culprits
from pom.diagnosis.kept_diagnosis import LateBench
from pom.diagnosis.swap_runs import SwapBench

COLUMNS = ("term", "effect", "largest in", "cases", "from evidence", "mismatch", "matched")
"""Heads of the columns of `ProjectRanking.rows`."""

CAPTION = (
    "all cases together: terms wrong in the a-priori model, corrected one after the other "
    "(half widths, standard errors)"
)


@dataclass(frozen=True)
class ProjectRanking:
    """Ranking of the terms of the a-priori model over all cases.

    Attributes
    ----------
    culprits : DataFrame
        Of `rank_culprits`.
    corrections : DataFrame
        Of `order_corrections`.
    origins : mapping of str to str
        A-priori sources of the terms, for a database of several sources.
    """

    culprits: pd.DataFrame
    corrections: pd.DataFrame
    origins: Mapping[str, str] = field(default_factory=dict)

    @property
    def sentences(self) -> list[str]:
        """What the ranking states about the a-priori model."""
        return describe_culprits(self.culprits, self.corrections, self.origins)

    def rows(self) -> list[tuple[str, ...]]:
        """Return the a-priori model, the corrected terms and the final model, as `COLUMNS`."""
        numbers = self.culprits.set_index("term")
        rows: list[tuple[str, ...]] = []
        for step in self.corrections.to_dict("records"):
            # The first state has no term, the last one is the final model.
            cells = ("a priori", "", "", "", "")
            if step["term"] in numbers.index:
                row = numbers.loc[step["term"]]
                distance = ""
                if not math.isnan(row["distance"]):
                    distance = f"{row['distance']:.1f}"
                effect = f"{row['effect']:.2f}"
                cells = (step["term"], effect, row["case"], str(row["felt"]), distance)
            elif step["term"]:
                cells = ("final model", "", "", "", "")
            state = (f"{step['mismatch']:.2f}", f"{step['matched']} of {step['cases']}")
            rows.append((*cells, *state))
        return rows


def rank_project(
    benches: Mapping[str, SwapBench | LateBench],
    evidence: xr.DataTree | None = None,
    jobs: int = 1,
) -> ProjectRanking:
    """Rank the terms over all cases and correct them one after the other.

    Parameters
    ----------
    benches, evidence, jobs
        As in `rank_culprits`.
    """
    culprits = rank_culprits(benches, evidence, jobs)
    origins = list_origins(evidence) if evidence is not None else {}
    return ProjectRanking(culprits, order_corrections(benches, culprits), origins)
