"""What the flights decide about each term: replace, correct, keep or delete it, with the reason in
numbers ([LR743] 4.5).
"""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np
import pandas as pd
import xarray as xr

from aerodb.store.schema import terms
from aerodb.update.posterior import factor_of
from flightmech import terms as _terms
from flightmech.support.netcdf_trees import StoredGroup

REPLACED, CORRECTED = (
    0.5,
    0.9,
)  # posterior over prior standard error of a node: below the first identified, below the second corrected
DECISIONS = ("replace", "correct", "keep", "delete")
# correlation from which two terms are determined by the flights together rather than one by one
_JOINT = 0.9


def add_decisions(
    before: Mapping[str, xr.Dataset],
    after: Mapping[str, xr.Dataset],
    flown: Mapping[str, np.ndarray],
) -> dict[str, xr.Dataset]:
    """Return identified terms with the attributes ``decision`` and ``reason``.

    ``replace``: at half or more of the flown nodes the standard error fell below 0.5 of the
    a-priori one.  ``correct``: below 0.9 at some flown node.  ``keep``: at none, the a-priori
    values stand.  ``delete``: at none, and there is no a-priori value either (all nodes were zero,
    none from DATCOM): the term cannot be identified from these flights.

    Parameters
    ----------
    before, after : mapping of str to Dataset
        The terms of one coefficient a priori and with their posterior.
    flown : mapping of str to array of bool
        The nodes in the flown region, in the shape of the table.
    """
    return {
        name: leaf.assign_attrs(zip(("decision", "reason"), _decision(name, before, after, flown)))
        for name, leaf in after.items()
    }


def decisions(db: xr.DataTree) -> pd.DataFrame:
    """Return what the flights decided about each term of a database, index term, columns ``decision
    reason``.

    Terms that no fit informs have no decision of their own: the a-priori ones are kept, empty ones
    deleted.  `aerodb.delete_terms` deletes.
    """

    return pd.DataFrame.from_dict(
        decision_rows(terms(db)), orient="index", columns=["decision", "reason"]
    ).rename_axis("term")


def decision_rows(leaves: Mapping[str, xr.Dataset | StoredGroup]) -> dict[str, tuple[str, str]]:
    """Return the rows of `decisions` by term, of terms by name, also as they stand in a file."""
    rows = {}
    for name, leaf in leaves.items():
        unknown = ("delete" if _opened(leaf) else "keep", "no fit informs it")
        decision, reason = (
            str(leaf.attrs.get(key, word))
            for key, word in zip(("decision", "reason"), unknown, strict=True)
        )
        rows[name] = decision, reason
    return rows


def _decision(name: str, before, after, flown) -> tuple[str, str]:
    at, old, new = flown[name], before[name], after[name]
    known = at & (old["stderr"].values > 0)
    if not known.any():
        return ("delete" if _opened(old) else "keep"), "no node in the flown region"
    ratio = new["stderr"].values[known] / old["stderr"].values[known]
    identified, corrected = int((ratio < REPLACED).sum()), int((ratio < CORRECTED).sum())
    numbers = (
        f"{identified} of {len(ratio)} flown nodes with less than {REPLACED:g} of the "
        f"a-priori standard error"
    )
    if 2 * identified >= len(ratio):
        decision = "replace"
    elif corrected:
        decision, numbers = "correct", f"{numbers}, {corrected} with less than {CORRECTED:g}"
    else:
        decision = "delete" if _opened(old) else "keep"
        numbers = (
            f"none of {len(ratio)} flown nodes with less than {CORRECTED:g} of the "
            f"a-priori standard error, at least {ratio.min():.2f}"
        )
    return decision, "; ".join(
        [numbers, *_significance(old, new, known), *_partner(name, after, flown)]
    )


def _opened(leaf: xr.Dataset | StoredGroup) -> bool:
    """Whether a term is an empty one that was opened for the flights."""
    handbook = "source" in leaf and (leaf["source"].values == _terms.SOURCES.index("datcom")).any()
    return not handbook and not leaf["value"].values.any()


def _significance(old: xr.Dataset, new: xr.Dataset, known: np.ndarray) -> list[str]:
    if not _opened(old):
        return []
    t = np.abs(new["value"].values[known]) / new["stderr"].values[known]
    return (
        [f"zero within {t.max():.1f} standard errors: it may be left out"]
        if t.max() < 2.0
        else [f"up to {t.max():.3g} standard errors from zero"]
    )


def _partner(
    name: str, after: Mapping[str, xr.Dataset], flown: Mapping[str, np.ndarray]
) -> list[str]:
    """Return the term that a term is most correlated with at its flown nodes, when it is from
    `_JOINT`; none without a joint covariance.
    """
    if "posterior_factor" not in after[name]:
        return []

    rows = {}
    for term, leaf in after.items():
        at = flown[term].ravel()
        F, sign = factor_of(leaf)
        rows[term] = (
            F[at] / np.maximum(leaf["stderr"].values.ravel()[at], np.finfo(float).tiny)[:, None]
        )
    own = rows.pop(name) * sign
    largest = {
        term: R.flat[np.abs(R).argmax()]
        for term, other in rows.items()
        if (R := own @ other.T).size
    }
    partner = max(largest, key=lambda term: abs(largest[term]), default="")
    if not partner or abs(largest[partner]) < _JOINT:
        return []
    return [
        f"correlation {largest[partner]:.2f} with {partner}: the flights determine them together"
    ]
