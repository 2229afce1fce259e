"""Decisions on each term after flight: replace, correct, keep or delete it, with a reason.

The classes are those of LR-743, section 4.5.
"""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np
import pandas as pd
import xarray as xr

from aerodb.store.overview import ORIGIN
from aerodb.store.schema import terms
from aerodb.update.posterior import factor_of
from flightmech import terms as _terms

# Posterior over prior standard error of a node: identified below the first, corrected below the
# second.
REPLACED, CORRECTED = 0.5, 0.9
DECISIONS = ("replace", "correct", "keep", "delete")
_FLIGHT = _terms.SOURCES.index("flight")
_ESTIMATED = [_terms.SOURCES.index(name) for name in ("datcom", "estimate")]
# Correlation from which on the flights determine two terms together and not one by one.
_JOINT = 0.9
_NOT_SIGNIFICANT = 2.0  # standard errors from zero below which an opened term may be left out


def add_decisions(
    before: Mapping[str, xr.Dataset],
    after: Mapping[str, xr.Dataset],
    flown: Mapping[str, np.ndarray],
) -> dict[str, xr.Dataset]:
    """Return identified terms with the attributes ``decision`` and ``reason``.

    ``replace``: at half or more of the flown nodes the standard error fell below 0.5 of the
    a-priori one.  ``correct``: below 0.9 at some flown node.  ``keep``: below 0.9 at no flown node;
    the a-priori values stay.  ``delete``: the same, and the a-priori values are empty (all nodes
    are zero, none from DATCOM).  The term cannot be identified from these flights.

    Parameters
    ----------
    before, after : mapping of str to Dataset
        The terms of one coefficient a priori and with their posterior.
    flown : mapping of str to array of bool
        The nodes in the flown region, in the shape of the table.
    """
    decided = {}
    for name, leaf in after.items():
        decision, reason = _decide(name, before[name], after, flown)
        decided[name] = leaf.assign_attrs(decision=decision, reason=reason)
    return decided


def decisions(db: xr.DataTree) -> pd.DataFrame:
    """Return the decision on each term of a database: index term, columns ``decision reason``.

    Terms that no fit informs do not have a stored decision: the a-priori ones are kept, empty ones
    deleted.  `aerodb.delete_terms` deletes.
    """
    rows = decision_rows(db)
    table = pd.DataFrame.from_dict(rows, orient="index", columns=["decision", "reason"])
    return table.rename_axis("term")


def decision_rows(db: xr.DataTree) -> dict[str, tuple[str, str]]:
    """Return the rows of `decisions` by term."""
    rows = {}
    for name, leaf in terms(db).items():
        if "decision" in leaf.attrs:
            rows[name] = str(leaf.attrs["decision"]), str(leaf.attrs.get("reason", ""))
        elif _has_flight_nodes(leaf):
            rows[name] = "replace", _describe_entry(leaf)
        else:
            rows[name] = _decide_uninformed(leaf), _describe_uninformed(leaf)
    return rows


def _describe_uninformed(leaf: xr.Dataset) -> str:
    """Return why a term without information from flight is as it is, with its a-priori sources."""
    origin = str(leaf.attrs.get(ORIGIN, ""))
    if not origin:
        return "no fit informs it"
    return f"no fit informs it; a priori from {origin}"


def _has_flight_nodes(leaf: xr.Dataset) -> bool:
    """Return whether a node of a term comes from flight: a submodel or an engineer entered it."""
    return "source" in leaf and bool((np.asarray(leaf["source"].values) == _FLIGHT).any())


def _describe_entry(leaf: xr.Dataset) -> str:
    """Return how numbers from flight entered a term that no tabulation decided on."""
    history = str(leaf.attrs.get("history", "")).splitlines()
    if not history:
        return "from flight; its history does not state how it was entered"
    return f"from flight, entered outside the fits of the tables: {history[-1]}"


def _decide_uninformed(leaf: xr.Dataset) -> str:
    """Return the decision on a term without information from flight."""
    if _is_opened(leaf):
        return "delete"
    return "keep"


def _decide(
    name: str,
    old: xr.Dataset,
    after: Mapping[str, xr.Dataset],
    flown: Mapping[str, np.ndarray],
) -> tuple[str, str]:
    """Return the decision on a term and its reason."""
    new = after[name]
    uncertain = flown[name] & (old["stderr"].values > 0)
    if not uncertain.any():
        return _decide_uninformed(old), "no node in the flown region"
    ratio = new["stderr"].values[uncertain] / old["stderr"].values[uncertain]
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
        decision = _decide_uninformed(old)
        numbers = (
            f"none of {len(ratio)} flown nodes with less than {CORRECTED:g} of the "
            f"a-priori standard error, at least {ratio.min():.2f}"
        )
    reasons = [numbers, *_describe_significance(old, new, uncertain)]
    return decision, "; ".join([*reasons, *_describe_partner(name, after, flown)])


def _is_opened(leaf: xr.Dataset) -> bool:
    """Return whether a term is an empty one that was opened for the flights."""
    if leaf["value"].values.any():
        return False
    return "source" not in leaf or not np.isin(leaf["source"].values, _ESTIMATED).any()


def _describe_significance(old: xr.Dataset, new: xr.Dataset, uncertain: np.ndarray) -> list[str]:
    """Return the distance of an opened term from zero, in standard errors; none for others."""
    if not _is_opened(old):
        return []
    t = np.abs(new["value"].values[uncertain]) / new["stderr"].values[uncertain]
    if t.max() < _NOT_SIGNIFICANT:
        return [f"zero within {t.max():.1f} standard errors: it may be left out"]
    return [f"up to {t.max():.3g} standard errors from zero"]


def _describe_partner(
    name: str, after: Mapping[str, xr.Dataset], flown: Mapping[str, np.ndarray]
) -> list[str]:
    """Return the term with the largest correlation at the flown nodes, if that reaches `_JOINT`."""
    if "posterior_factor" not in after[name]:
        return []
    # Rows of the joint factor over the standard errors: their products are correlations.
    rows, sign = {}, None
    for term, leaf in after.items():
        nodes = flown[term].ravel()
        F, sign = factor_of(leaf)
        stderr = np.maximum(leaf["stderr"].values.ravel()[nodes], np.finfo(float).tiny)
        rows[term] = F[nodes] / stderr[:, None]
    weighted = rows.pop(name) * sign
    partner, largest = "", 0.0
    for term, others in rows.items():
        correlations = weighted @ others.T
        if correlations.size:
            extreme = correlations.flat[np.abs(correlations).argmax()]
            if not partner or abs(extreme) > abs(largest):
                partner, largest = term, extreme
    if not partner or abs(largest) < _JOINT:
        return []
    return [f"correlation {largest:.2f} with {partner}: the flights determine them together"]
