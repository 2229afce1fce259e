"""Terms of effects: tables without missing cells, with standard errors and sources."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np
import xarray as xr

from aerodb.prior.prior_errors import CALIBRATED_MACH, PriorErrors
from aerodb.prior.sources import warn_user
from aerodb.store.effects import Effect, join_sentences
from flightmech import terms as _terms
from flightmech.units import DEGREE

AXIS_ORDER = (
    "h",
    "h_agl",
    "delta_f",
    "mach",
    "alpha",
    "delta_e",
    "delta_a",
    "delta_r",
    "delta_s",
    "delta_d",
)
_NO_POINTS = np.array([])
# Function that builds the database, by source of the nodes.
_VERBS = {"datcom": "from_datcom", "estimate": "from_estimate"}
# Factor on the standard error of nodes that are extended or do not come from the program.
_EXTENDED_ERROR = 2.0
_LEAST_ROWS = 0.5  # share of the alphas of the best Mach number that a Mach number needs


def terms_of_effect(
    effect: Effect,
    prior: PriorErrors,
    cover: Mapping[str, tuple[float, float]],
    source: str = "datcom",
) -> dict[str, xr.Dataset]:
    """Return the terms of an effect by name.

    Parameters
    ----------
    effect : Effect
        Its tables may contain NaN where the listing prints no number.
    prior : PriorErrors
        Standard errors by term, class of method and regime.
    cover : mapping of str to (float, float)
        Range that an axis must cover if a table has it: ``mach`` and ``alpha``.
    source : {"datcom", "estimate"}
        Source of the nodes.

    Notes
    -----
    A Mach number with less than half as many printed alphas as the best one is removed (a transonic
    page prints one row).  Alphas that no Mach number prints are removed as well.  A missing cell
    takes the value of the nearest printed alpha of its Mach number, interpolated between two.  The
    ends of the range to cover are filled in the same way.  The simulation does the same beyond a
    table, but here each Mach number is treated by itself, and a flight in the range of the basic
    tables stays inside all tables.  Such nodes are marked as judgement.  Twice the standard error
    have nodes extended in alpha, nodes extended in Mach number into another speed regime (with a
    warning), and nodes that `Effect.judged` marks.
    """
    leaves: dict[str, xr.Dataset] = {}
    # Names of the terms that are extended into another regime, by last Mach number and end.
    extended: dict[tuple[float, float], list[str]] = {}
    for coefficient, table in effect.tables.items():
        axes = [axis for axis in AXIS_ORDER if axis in table.dims]
        filled, printed, notes = fill_unprinted_cells(table.transpose(*axes))
        if not filled.size:
            continue
        name = f"{coefficient}/{effect.name}"
        if coefficient in effect.judged:
            printed = printed & ~effect.judged[coefficient].reindex_like(printed)
        value, ends = extend_to_ranges(filled, cover)
        machs, alphas = ends.get("mach", _NO_POINTS), ends.get("alpha", _NO_POINTS)
        far_machs = _machs_in_other_regime(filled, machs, prior)
        for end in far_machs:
            extended.setdefault((float(filled["mach"].max()), float(end)), []).append(name)
        # Uncertain nodes have a larger error.  Other extended nodes are judgement only.
        uncertain = ~extend_to_ranges(printed, cover)[0]
        uncertain = uncertain | _is_at(value, "alpha", alphas) | _is_at(value, "mach", far_machs)
        judged = uncertain | _is_at(value, "mach", machs)
        for axis, points in ends.items():
            notes += _describe_extension(axis, points)
        leaves[name] = _make_leaf(
            name,
            effect,
            value,
            uncertain=uncertain,
            judged=judged,
            prior=prior,
            notes=notes,
            source=source,
        )
    leaves = _without_bias(leaves, prior)
    for (last, end), names in extended.items():
        warn_user(
            f"{' '.join(names)}: nothing is printed beyond Mach {last:g}; that value is held "
            f"to Mach {end:g}, another speed regime, "
            "with twice the standard error; delete or replace it if it matters there"
        )
    return leaves


def _make_leaf(
    name: str,
    effect: Effect,
    value: xr.DataArray,
    *,
    uncertain: xr.DataArray,
    judged: xr.DataArray,
    prior: PriorErrors,
    notes: Sequence[str],
    source: str,
) -> xr.Dataset:
    """Return the leaf of one term with the standard error and the source of every node."""
    factor = np.where(uncertain.transpose(*value.dims), _EXTENDED_ERROR, 1.0)
    # All nodes are from the program first, then the judged ones are marked.
    leaf = _terms.make_term(
        value.values,
        {str(axis): value[axis].values for axis in value.dims},
        effect.regressor.split(),
        stderr=_node_stderr(name, value, prior, effect.zeros) * factor,
        source=source,
        references=effect.references,
        comment=join_sentences(effect.comment, *notes),
        history=f"{_VERBS[source]}: {name}",
    )
    judgement = _terms.SOURCES.index("judgement")
    code = np.where(judged.transpose(*value.dims), judgement, leaf["source"]).astype(np.uint8)
    return leaf.assign(source=leaf["source"].copy(data=code))


def _without_bias(leaves: Mapping[str, xr.Dataset], prior: PriorErrors) -> dict[str, xr.Dataset]:
    """Return terms multiplied by their ratios of true to estimated slopes.

    The pitching moment of the basic aeroplane keeps its value at zero lift: its slope has the
    ratio. The standard errors stay, because the calibration refers them to the estimates. Beyond
    `CALIBRATED_MACH` nothing shows the ratio: the value stays, and its standard error contains the
    bias that was seen below.
    """
    corrected = {}
    for name, leaf in leaves.items():
        ratio = prior.ratios.get(name)
        if ratio is None:
            corrected[name] = leaf
            continue
        value = leaf["value"]
        fixed = xr.zeros_like(value)
        note = f"multiplied by {ratio:g}"
        if name == "Cm/basic":
            fixed = _moment_at_zero_lift(leaves["CL/basic"]["value"], value)
            note = f"slope over the value at zero lift multiplied by {ratio:g}"
        note = f"{note}, the bias of the calibration"
        # Only the part above the fixed value has the ratio.
        bias = ((ratio - 1.0) * (value - fixed)).transpose(*value.dims)
        stderr = leaf["stderr"]
        if "mach" in value.dims and float(value["mach"].max()) > CALIBRATED_MACH:
            is_calibrated = value["mach"] <= CALIBRATED_MACH
            kept = xr.where(is_calibrated, 0.0, bias).transpose(*value.dims)
            bias = bias.where(is_calibrated, 0.0)
            stderr = stderr.copy(data=np.hypot(stderr.values, kept.values))
            note = f"{note}; not calibrated beyond Mach {CALIBRATED_MACH:g}"
        leaf = leaf.assign(value=value.copy(data=(value + bias).values), stderr=stderr)
        corrected[name] = leaf.assign_attrs(comment=join_sentences(leaf.attrs["comment"], note))
    return corrected


def _moment_at_zero_lift(lift: xr.DataArray, moment: xr.DataArray) -> xr.DataArray:
    """Return the pitching moment where the lift is zero, below the largest lift."""
    others = [axis for axis in moment.dims if axis != "alpha"]
    lift = lift.interp_like(moment["alpha"]) if "alpha" in lift.dims else lift

    def at_zero(lifts: np.ndarray, moments: np.ndarray) -> float:
        rising = slice(0, int(np.argmax(lifts)) + 1)
        return float(np.interp(0.0, lifts[rising], moments[rising]))

    found = xr.apply_ufunc(
        at_zero, lift, moment, input_core_dims=[["alpha"], ["alpha"]], vectorize=True
    )
    return found.broadcast_like(moment).transpose(*others, "alpha")


def _is_at(table: xr.DataArray, axis: str, points: np.ndarray) -> xr.DataArray | bool:
    """Return a mask of the nodes at some breakpoints of an axis, False without the axis."""
    if axis not in table.dims:
        return False
    return table[axis].isin(list(points))


def fill_unprinted_cells(table: xr.DataArray) -> tuple[xr.DataArray, xr.DataArray, list[str]]:
    """Return a table without NaN, a mask of its printed cells, and notes on the changes.

    The table is empty if nothing is printed.
    """
    printed = table.notnull()
    if bool(printed.all()):
        return table, printed, []
    if not bool(printed.any()):
        return table.isel({table.dims[0]: slice(0, 0)}), printed, []
    notes = []
    if "mach" in table.dims:
        # Least number of printed alphas over the other axes.
        count = printed.astype(int)
        if "alpha" in table.dims:
            count = printed.sum("alpha")
        count = count.min([axis for axis in count.dims if axis != "mach"])
        kept_machs = count >= max(_LEAST_ROWS * float(count.max()), 1.0)
        notes += _describe_removed(kept_machs, "mach")
        table, printed = table.sel(mach=kept_machs), printed.sel(mach=kept_machs)
    if "alpha" in table.dims:
        kept_alphas = printed.any([axis for axis in printed.dims if axis != "alpha"])
        notes += _describe_removed(kept_alphas, "alpha")
        table, printed = table.sel(alpha=kept_alphas), printed.sel(alpha=kept_alphas)
        missing = int((~printed).sum())
        if missing:
            notes.append(
                f"{missing} of {printed.size} cells are not printed: value of the nearest "
                f"printed alpha held there"
            )
            table = _interpolate_alpha(table)
    return table, printed, notes


def _interpolate_alpha(table: xr.DataArray) -> xr.DataArray:
    """Return a table whose missing cells are interpolated along alpha."""
    filled = xr.apply_ufunc(
        _fill_row,
        table["alpha"],
        table,
        input_core_dims=[["alpha"], ["alpha"]],
        output_core_dims=[["alpha"]],
        vectorize=True,
    )
    return filled.transpose(*table.dims)


def _fill_row(x: np.ndarray, y: np.ndarray) -> np.ndarray:
    """Return a row without NaN; beyond its numbers the nearest one holds."""
    printed = np.isfinite(y)
    if not printed.any():
        return y
    return np.interp(x, x[printed], y[printed])


def extend_to_ranges(
    table: xr.DataArray, cover: Mapping[str, tuple[float, float]]
) -> tuple[xr.DataArray, dict[str, np.ndarray]]:
    """Return a table whose axes cover ranges, and the added breakpoints by axis.

    The value at an added breakpoint is that of the nearest one.
    """
    ends = {}
    for axis, (low, high) in cover.items():
        if axis not in table.dims:
            continue
        # Ends inside the table are not added.
        points = table[axis].values
        ends[axis] = np.array([end for end in (low, high) if end < points[0] or end > points[-1]])
        table = table.reindex({axis: np.union1d(points, ends[axis])}, method="nearest")
    return table, ends


def _describe_removed(is_kept: xr.DataArray, axis: str) -> list[str]:
    """Return a note on the breakpoints that are removed, none without any."""
    removed = is_kept[axis].values[~is_kept.values]
    if not removed.size:
        return []
    return [f"{axis} {_format_points(axis, removed)} not printed"]


def _describe_extension(axis: str, points: np.ndarray) -> list[str]:
    """Return a note on the breakpoints that are added, none without any."""
    if not points.size:
        return []
    return [f"{axis} {_format_points(axis, points)}: value of the nearest one held"]


def _format_points(axis: str, points: np.ndarray) -> str:
    """Return breakpoints as text; alpha in degrees."""
    scale, unit = 1.0, ""
    if axis == "alpha":
        scale, unit = DEGREE, " deg"
    return " ".join(f"{point / scale:.4g}" for point in points) + unit


def _node_stderr(
    name: str, table: xr.DataArray, prior: PriorErrors, zeros: Mapping[str, Sequence[float]]
) -> np.ndarray:
    """Return the standard error of every node; 0 where the effect is zero by definition."""
    stderr = prior.stderr(name, table)
    for axis, points in zeros.items():
        if axis in table.dims:
            stderr = stderr.where(~table[axis].isin(list(points)), 0.0)
    return stderr.transpose(*table.dims).values


def _machs_in_other_regime(
    printed: xr.DataArray, ends: np.ndarray, prior: PriorErrors
) -> np.ndarray:
    """Return the added Mach numbers that lie in another speed regime than the last printed one."""
    if not ends.size:
        return ends
    last = float(printed["mach"].max())
    regime = prior.regime(last)
    return np.array([end for end in ends if end > last and prior.regime(end) != regime])
