"""How well the terms of a stall describe records that they were not fitted to.

Each record is left out in turn. The linear terms come from the others, the shape of the separation
from all: it has at most a few parameters, and to search it again for each record takes too long.
"""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from flighttest.regression.separable.search import SeparableProblem

LEAST_SHARE = 0.8
"""R2 on records left out below which a coefficient is remarked; our number."""


def left_out_shares(problem: SeparableProblem, s: np.ndarray) -> dict[str, float]:
    """Return R2 of each coefficient on the records that are left out in turn.

    Parameters
    ----------
    problem : SeparableProblem
    s : array (parameters,)
        Shape parameters at the minimum.

    Returns
    -------
    dict of str to float
        Negative where a constant is better. nan where it cannot be had: one record, records that
        are left do not determine the terms, as with one record of a flap, or a coefficient that
        does not vary.
    """
    shares = {}
    for model, samples, z, design in zip(
        problem.models, problem.samples, problem.z, problem.designs(s), strict=True
    ):
        number = samples.data["manoeuvre"].values
        # columns of unit length, so that the rank does not depend on units
        A = design.A / np.maximum(np.linalg.norm(design.A, axis=0), np.finfo(float).tiny)
        misses = 0.0
        for own in np.unique(number):
            others = number != own
            theta, _, rank, _ = np.linalg.lstsq(A[others], z[others], rcond=1e-8)
            if rank < A.shape[1]:
                misses = np.nan
                break
            misses += float(np.sum((z[~others] - A[~others] @ theta) ** 2))
        # nan where nothing varies
        variation = float(np.sum((z - z.mean()) ** 2))
        shares[model.target] = 1.0 - misses / variation if variation > 0.0 else np.nan
    return shares


def remark_shares(shares: Mapping[str, float]) -> list[str]:
    """Return what a reader has to know of R2 on records left out, one text per coefficient."""
    remarks = []
    for coefficient, share in shares.items():
        if np.isnan(share):
            remarks.append(
                f"{coefficient}: not checked on records that its terms were not fitted to: the "
                "others do not determine them, or it does not vary; add stalls of each "
                "configuration"
            )
        elif share < LEAST_SHARE:
            remarks.append(
                f"{coefficient}: R2 {share:.2f} on records that its terms were not fitted to, "
                f"below {LEAST_SHARE:g}: noise, or a separation of another form, which standard "
                "errors do not contain; compare unseen stalls before use"
            )
    return remarks
