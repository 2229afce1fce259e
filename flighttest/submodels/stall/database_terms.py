"""Terms of an identified stall in a database, and the attached flow that they need."""

from __future__ import annotations

from collections.abc import Iterable

import numpy as np
import xarray as xr

from aerodb.edit.term_edits import delete_terms, replace_terms
from aerodb.store.identified_terms import stamp_identified
from aerodb.store.schema import terms
from aerodb.update.posterior import without_posterior
from aerodb.update.tabulation_report import pack_flown_samples
from flightmech.errors import SchemaError
from flightmech.flown_samples import FLOWN_SAMPLES, with_flown_samples
from flightmech.flown_states import FLOWN_STATES, gather_states, pack_states
from flightmech.names import SEPARATION, value_text
from flightmech.terms import SOURCES, list_model_variables
from flightmech.units import DEGREE
from flighttest.submodels.stall.result import StallIdentification

_NOTE = "stall identified from flight"
BEYOND = 10.0 * DEGREE
"""Range of the attached flow beyond the largest angle of attack of the stalls. [rad]"""


def add_stall(database: xr.DataTree, found: StallIdentification) -> xr.DataTree:
    """Return a database with the terms of an identified stall.

    Parameters
    ----------
    database : DataTree
        Attached flow, as it was given to `identify_stall`. Its terms over the separation are
        deleted.
    found : StallIdentification

    Returns
    -------
    DataTree
        It keeps the samples of the stalls and their states, as those of other fits.
    """
    new = {name: stamp_identified(leaf) for name, leaf in found.leaves().items()}
    old = []
    for name, leaf in terms(database).items():
        if list_model_variables(leaf) & set(SEPARATION) and name not in new:
            old.append(name)
    remainder = delete_terms(database, old, _NOTE) if old else database
    changed = replace_terms(remainder, new, _NOTE)
    # The samples show which flights cannot prove the model, the states where it is supported.
    samples = []
    for number, record in enumerate(found.records, 1):
        samples.append((str(record.attrs.get("record") or f"stall {number}"), record))
    flown = {
        FLOWN_SAMPLES: pack_flown_samples(samples),
        FLOWN_STATES: pack_states(gather_states(found.records)),
    }
    changed.attrs |= with_flown_samples(changed.attrs, flown)
    return changed


def reach_of(records: Iterable[xr.Dataset]) -> float:
    """Return the angle of attack that the attached flow has to reach for records of stalls. [rad]

    It is 10 deg beyond the largest one, as 14 CFR Part 60, Appendix A, Attachment 7 asks beyond the
    stall.
    """
    return max(float(np.nanmax(record["alpha"].values)) for record in records) + BEYOND


def continue_attached_flow(
    database: xr.DataTree, alpha: float, reach: float = -np.inf
) -> xr.DataTree:
    """Return a database whose tables over alpha go on linearly from an angle of attack on.

    Parameters
    ----------
    database : DataTree
        A database whose tables contain a stall.
    alpha : float
        Last angle of attack of attached flow. Breakpoints beyond it get the values of the line
        through the table at `alpha` with the slope of the cell below it; their source is a
        judgement. [rad]
    reach : float
        Angle of attack to which tables are continued that end before it (`reach_of`). [rad]

    Returns
    -------
    DataTree
        The terms of hinge moments, and terms without alpha as axis of ``value``, do not change.

    Raises
    ------
    SchemaError
        A table has fewer than two breakpoints up to `alpha`.
    """
    changed, problems = {}, []
    for name, leaf in terms(database).items():
        if name.startswith("Ch_") or "alpha" not in leaf["value"].dims:
            continue
        points = leaf["alpha"].values
        if points[-1] <= alpha and points[-1] >= reach:
            continue
        if points[-1] <= alpha:
            # the table ends in attached flow; one breakpoint states no dependence
            if len(points) == 1:
                continue
            changed[name] = _continue_table(leaf, float(points[-1]), reach)
            continue
        if points[0] >= alpha or (points < alpha).sum() < 2:
            problems.append(
                f"{name}: alpha starts at {value_text('alpha', points[0])}; two breakpoints below "
                f"{value_text('alpha', alpha)} are needed"
            )
            continue
        changed[name] = _continue_table(leaf, alpha, reach)
    if problems:
        raise SchemaError("attached flow", problems)
    note = f"tables continued linearly beyond {value_text('alpha', alpha)}"
    return replace_terms(database, changed, note) if changed else database


def _continue_table(leaf: xr.Dataset, alpha: float, reach: float) -> xr.Dataset:
    """Return a leaf with a straight line in place of its values beyond alpha, up to `reach`."""
    leaf = without_posterior(leaf).copy()
    if leaf["alpha"].values[-1] < reach:
        # one more breakpoint, with standard error and source of the last one
        leaf = leaf.reindex(alpha=np.append(leaf["alpha"].values, reach), method="ffill")
    axis = leaf["value"].dims.index("alpha")
    points = leaf["alpha"].values
    values = np.moveaxis(leaf["value"].values.astype(float), axis, 0)
    k = int(np.searchsorted(points, alpha, side="left")) - 1
    slope = (values[k + 1] - values[k]) / (points[k + 1] - points[k])
    if points[k + 1] > alpha:
        # the cell that contains alpha may hold the break: take the slope below it
        slope = (values[k] - values[k - 1]) / (points[k] - points[k - 1])
    at_alpha = values[k] + slope * (alpha - points[k])
    beyond = points > alpha
    line = at_alpha + slope * (points[beyond] - alpha)[(...,) + (None,) * (values.ndim - 1)]
    values[beyond] = line
    leaf["value"] = (leaf["value"].dims, np.moveaxis(values, 0, axis), leaf["value"].attrs)
    if "source" in leaf:
        source = np.moveaxis(leaf["source"].values.copy(), axis, 0)
        source[beyond] = SOURCES.index("judgement")
        leaf["source"] = (leaf["value"].dims, np.moveaxis(source, 0, axis), leaf["source"].attrs)
    return leaf
