"""The joint ranking of wrong terms in sentences."""

from __future__ import annotations

import math
from collections.abc import Hashable, Mapping
from types import MappingProxyType
from typing import Any

import pandas as pd

from pom.diagnosis.culprits.ranking import LEAST_WORSE
from pom.diagnosis.swap_judgement import LEAST_GAP
from pom.judging.beyond_the_bands import FAR

FIRST = 3  # terms that the sentence names


def describe_culprits(
    ranked: pd.DataFrame,
    corrections: pd.DataFrame,
    origins: Mapping[str, str] = MappingProxyType({}),
) -> list[str]:
    """Return what the joint ranking states about the a-priori model.

    Parameters
    ----------
    ranked : DataFrame
        Of `rank_culprits`.
    corrections : DataFrame
        Of `order_corrections`.
    origins : mapping of str to str
        A-priori sources by term.
    """
    rows = corrections.to_dict("records")
    if not rows or not rows[0]["cases"]:
        return ["No case carries a verdict, so no term is ranked."]
    start, *steps, end = rows
    if not steps:
        return [
            f"No term is named: no case is off by {LEAST_GAP:g} half widths more when one term of "
            f"the final model is put back as it was a priori."
        ]
    # Terms of the sequence that the evidence refutes come first, by name.
    named = [str(row["term"]) for row in steps]
    near = list(ranked.loc[ranked["term"].isin(named) & (ranked["distance"] < FAR), "term"])
    refuted = [name for name in named if name not in near][:FIRST]
    wrong = [_with_origin(name, origins) for name in refuted]
    first = f"Over all cases the a-priori model is most likely wrong in {', '.join(wrong)}."
    if not refuted:
        first = "Over all cases the evidence refutes none of the terms that the flights feel."
    sentences = [
        first,
        f"With the {len(steps)} terms of this ranking corrected, which the corrected model need "
        f"not have, {steps[-1]['matched']} of {end['cases']} cases are within "
        f"the tolerances that could be judged (a priori {start['matched']}, final model "
        f"{end['matched']}) and the mismatch over all cases is {steps[-1]['mismatch']:.2f} half "
        f"widths (a priori {start['mismatch']:.2f}, final model {end['mismatch']:.2f}).",
    ]
    if near:
        sentences.append(
            f"Within {FAR:g} standard errors of the evidence, so not refuted by it: "
            f"{', '.join(near)}."
        )
    unknown = ranked[ranked["term"].isin(named) & ranked["distance"].isna()]
    if len(unknown):
        sentences.append(f"Without evidence from flight: {', '.join(unknown['term'])}.")
    for before, row in zip(rows, steps, strict=False):
        if row["mismatch"] - before["mismatch"] > LEAST_WORSE:
            sentences.append(_describe_worse_step(before, row))
    if end["mismatch"] >= start["mismatch"]:
        sentences.append(
            "Over all cases the final model is no better than the a-priori model; the ranking "
            "takes it as right."
        )
    return sentences


def _with_origin(name: str, origins: Mapping[str, str]) -> str:
    """Return a term with its a-priori sources, if they are known."""
    if name not in origins:
        return name
    return f"{name} (a priori from {origins[name]})"


def _describe_worse_step(before: Mapping[Hashable, Any], row: Mapping[Hashable, Any]) -> str:
    """Return the sentence on a correction that makes the mismatch larger."""
    text = (
        f"The correction of {row['term']} makes the match worse on the way, from "
        f"{before['mismatch']:.2f} to {row['mismatch']:.2f} half widths"
    )
    if row["partner"] and math.isfinite(row["correlation"]):
        text += (
            f": its error and that of {row['partner']} compensate each other (correlation of "
            f"their effects on the judged outputs {row['correlation']:.2f})"
        )
    return f"{text}."
