"""Waterfall and ranking of the Shapley shares in the table of a diagnosis."""

from __future__ import annotations

import numpy as np
import pandas as pd

from pom.diagnosis.swap_judgement import CEILING

OTHERS = "others"  # row of the shares: all terms without a share of their own
_RANKING_COLUMNS = ["criterion", "rank", "term", "explained", "stderr", "change"]


def criteria_of(table: pd.DataFrame) -> list[str]:
    """Return the names of the judged criteria of a diagnosis."""
    columns = map(str, table.columns)
    return [name.removesuffix(" ratio") for name in columns if name.endswith(" ratio")]


def waterfall(table: pd.DataFrame, criterion: str = "") -> pd.DataFrame:
    """Return the steps from the mismatch of the a-priori model to that of the final model.

    Parameters
    ----------
    table : DataFrame
        From `diagnose`.
    criterion : str, optional
        A judged criterion; the total mismatch without it.

    Returns
    -------
    DataFrame
        One row per share, in the order of the table: ``term``, ``start`` and ``stop`` (mismatch
        before and after it, in half widths), ``explained`` and ``stderr`` (share of the gap and its
        standard error).  Empty when the diagnosis has no shares.
    """
    prefix = ""
    if criterion:
        prefix = f"{criterion} "
    shares = table[table["stage"] == "share"]
    prior = table.loc[table["stage"] == "prior", f"{prefix}mismatch"].to_numpy(float)
    stop = shares[f"{prefix}mismatch"].to_numpy(float)
    # Each step starts where the step before it stops; the first starts at the a-priori model.
    start = np.append(np.fmin(prior, CEILING), stop)[: len(stop)]
    columns = {
        "term": shares["term"].to_list(),
        "start": start,
        "stop": stop,
        "explained": shares[f"{prefix}explained"].to_numpy(float),
        "stderr": shares[f"{prefix}stderr"].to_numpy(float),
    }
    return pd.DataFrame(columns)


def ranking(table: pd.DataFrame) -> pd.DataFrame:
    """Return the terms of every criterion; terms that explain most of its mismatch come first.

    Parameters
    ----------
    table : DataFrame
        From `diagnose`.

    Returns
    -------
    DataFrame
        ``criterion`` (empty: the total mismatch), ``rank`` from 1, ``term``, ``explained`` and
        ``stderr`` (Shapley share of the gap and its standard error; NaN where the criterion has no
        gap), ``change`` (of the mismatch, in half widths; negative: towards the flight).
    """
    rankings = []
    for criterion in ("", *criteria_of(table)):
        steps = waterfall(table, criterion)
        change = steps["stop"] - steps["start"]
        steps = steps.assign(criterion=criterion, change=change)
        steps = steps.sort_values("change", kind="stable")
        rankings.append(steps.assign(rank=np.arange(1, len(steps) + 1)))
    return pd.concat(rankings, ignore_index=True)[_RANKING_COLUMNS]
