"""What a table of `pom.diagnose` holds: the terms in order per criterion, and the steps of a waterfall."""

from __future__ import annotations

import numpy as np
import pandas as pd

CEILING = 10.0  # [half widths] of a criterion that fails without a number, such as a mode that is not there; no mismatch counts more
MATCHED = ("pass", "limits_exceeded")  # verdicts of a model within tolerance; of the second the trim is beyond its usual limits
OTHERS = "others"  # in the shares: all terms without a share of their own


def criteria_of(table: pd.DataFrame) -> list[str]:
    """Return the names of the judged criteria of a diagnosis."""
    return [str(column).removesuffix(" ratio") for column in table.columns if str(column).endswith(" ratio")]


def waterfall(table: pd.DataFrame, criterion: str = "") -> pd.DataFrame:
    """Return the way from the mismatch of the a-priori model to that of the final one, share by share.

    Parameters
    ----------
    table : DataFrame
        From `diagnose`.
    criterion : str, optional
        A judged criterion; the total mismatch without it.

    Returns
    -------
    DataFrame
        One row per share, in the order of the table: ``term``, ``start`` and ``stop`` (mismatch before and after it, in half widths),
        ``explained`` and ``stderr`` (share of the gap and its standard error).  Empty when the diagnosis has no shares.
    """
    prefix = f"{criterion} " if criterion else ""
    rows = table[table["stage"] == "share"]
    first = table.loc[table["stage"] == "prior", f"{prefix}mismatch"].to_numpy(float)
    stop = rows[f"{prefix}mismatch"].to_numpy(float)
    start = np.append(np.fmin(first, CEILING), stop)[: len(stop)]
    found = {"term": rows["term"].to_list(), "start": start, "stop": stop}
    return pd.DataFrame(found | {name: rows[f"{prefix}{name}"].to_numpy(float) for name in ("explained", "stderr")})


def ranking(table: pd.DataFrame) -> pd.DataFrame:
    """Return the terms of every criterion, those first that explain most of its mismatch.

    Parameters
    ----------
    table : DataFrame
        From `diagnose`.

    Returns
    -------
    DataFrame
        ``criterion`` (empty: the total mismatch), ``rank`` from 1, ``term``, ``explained`` and ``stderr`` (Shapley share of the gap and its
        standard error; NaN where the criterion has no gap), ``change`` (of the mismatch, in half widths; negative: towards the flight).
    """
    found = []
    for criterion in ("", *criteria_of(table)):
        steps = waterfall(table, criterion)
        steps = steps.assign(criterion=criterion, change=steps["stop"] - steps["start"]).sort_values("change", kind="stable")
        found.append(steps.assign(rank=np.arange(1, len(steps) + 1)))
    return pd.concat(found, ignore_index=True)[["criterion", "rank", "term", "explained", "stderr", "change"]]
