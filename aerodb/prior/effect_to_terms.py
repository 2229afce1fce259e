"""Effects to terms: cells that are not printed filled or cut away, standard errors and sources
given to every node.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np
import xarray as xr

from aerodb.prior.prior_errors import PriorErrors
from aerodb.prior.sources import warn_user
from aerodb.store.effects import Effect, join_sentences
from flightmech import terms as _terms
from flightmech.units import DEGREE

AXIS_ORDER = ("h", "h_agl", "delta_f", "mach", "alpha", "delta_e", "delta_a", "delta_s", "delta_d")
_NONE = np.array([])
# standard error of a node that is held or not the program's own, against the rule for printed ones
_HELD = 2.0


def terms_of_effect(
    effect: Effect, prior: PriorErrors, cover: Mapping[str, tuple[float, float]]
) -> dict[str, xr.Dataset]:
    """Return the terms of an effect by name.

    Parameters
    ----------
    effect : Effect
        Its tables may hold NaN where the listing prints no number.
    prior : PriorErrors
        Standard errors by term, class of method and regime.
    cover : mapping of str to (float, float)
        Range that an axis must cover, where a table has it: ``mach`` and ``alpha``.

    Notes
    -----
    A Mach number that prints less than half as many alphas as the best one is cut off (a transonic page prints one row), and so are
    alphas that no Mach number prints.  A cell that is then missing takes the value of the nearest printed alpha of its Mach number,
    interpolated between two; so do the ends of the range to cover.  This is what the simulation does beyond a table, but for each
    Mach number by itself, and it keeps a flight in the range of the basic tables inside all tables.  Such nodes are marked as
    judgement; those held in alpha, those held in Mach number into another speed regime (with a warning), and those that
    `Effect.judged` flags have twice the standard error.
    """
    found: dict[str, xr.Dataset] = {}
    carried: dict[tuple[float, float], list[str]] = {}
    for coefficient, table in effect.tables.items():
        whole, printed, notes = fill_unprinted_cells(
            table.transpose(*(axis for axis in AXIS_ORDER if axis in table.dims))
        )
        if not whole.size:
            continue
        name = f"{coefficient}/{effect.name}"
        if coefficient in effect.judged:
            printed = printed & ~effect.judged[coefficient].reindex_like(printed)
        value, ends = extend_to_ranges(whole, cover)
        far = _carried(whole, ends.get("mach", _NONE), prior)
        for end in far:
            carried.setdefault((float(whole["mach"].max()), float(end)), []).append(name)
        held = ~extend_to_ranges(printed, cover)[0]
        held = held | _among(value, "alpha", ends.get("alpha", _NONE)) | _among(value, "mach", far)
        judged = held | _among(value, "mach", ends.get("mach", _NONE))
        leaf = _terms.make_term(
            value.values,
            {str(axis): value[axis].values for axis in value.dims},
            effect.regressor.split(),
            stderr=_stderr(name, value, prior, effect.zeros)
            * np.where(held.transpose(*value.dims), _HELD, 1.0),
            source="datcom",
            references=effect.references,
            comment=join_sentences(
                effect.comment,
                *notes,
                *(_range_text(axis, points) for axis, points in ends.items()),
            ),
            history=f"from_datcom: {name}",
        )
        code = np.where(
            judged.transpose(*value.dims), _terms.SOURCES.index("judgement"), leaf["source"]
        ).astype(np.uint8)
        found[name] = leaf.assign(source=leaf["source"].copy(data=code))
    for (last, end), names in carried.items():
        warn_user(
            f"{' '.join(names)}: nothing is printed beyond Mach {last:g}; that value is held "
            f"to Mach {end:g}, another speed regime, "
            "with twice the standard error; delete or replace it if it matters there"
        )
    return found


def _among(table: xr.DataArray, axis: str, points: np.ndarray) -> xr.DataArray | bool:
    """Return a mask of the nodes that stand at some breakpoints of an axis."""
    return table[axis].isin(list(points)) if axis in table.dims else False


def fill_unprinted_cells(table: xr.DataArray) -> tuple[xr.DataArray, xr.DataArray, list[str]]:
    """Return a table without NaN, which of its cells are printed, and what was done; an empty one
    when nothing is printed.
    """
    good = table.notnull()
    if bool(good.all()):
        return table, good, []
    if not bool(good.any()):
        return table.isel({table.dims[0]: slice(0, 0)}), good, []
    notes = []
    if "mach" in table.dims:
        count = good.sum("alpha") if "alpha" in table.dims else good.astype(int)
        count = count.min([d for d in count.dims if d != "mach"])
        keep = count >= max(0.5 * float(count.max()), 1.0)
        notes += _dropped(keep, "mach")
        table, good = table.sel(mach=keep), good.sel(mach=keep)
    if "alpha" in table.dims:
        keep = good.any([d for d in good.dims if d != "alpha"])
        notes += _dropped(keep, "alpha")
        table, good = table.sel(alpha=keep), good.sel(alpha=keep)
        missing = int((~good).sum())
        if missing:
            notes.append(
                f"{missing} of {good.size} cells are not printed: value of the nearest "
                f"printed alpha held there"
            )
            table = xr.apply_ufunc(
                _nearest,
                table["alpha"],
                table,
                input_core_dims=[["alpha"], ["alpha"]],
                output_core_dims=[["alpha"]],
                vectorize=True,
            ).transpose(*table.dims)
    return table, good, notes


def _nearest(x: np.ndarray, y: np.ndarray) -> np.ndarray:
    good = np.isfinite(y)
    return np.interp(x, x[good], y[good]) if good.any() else y


def extend_to_ranges(
    table: xr.DataArray, cover: Mapping[str, tuple[float, float]]
) -> tuple[xr.DataArray, dict[str, np.ndarray]]:
    """Return a table whose axes cover ranges, the last values held, and the breakpoints that were
    put in.
    """
    ends = {}
    for axis, (low, high) in cover.items():
        if axis not in table.dims:
            continue
        points = table[axis].values
        ends[axis] = np.array([end for end in (low, high) if end < points[0] or end > points[-1]])
        table = table.reindex({axis: np.union1d(points, ends[axis])}, method="nearest")
    return table, ends


def _dropped(keep: xr.DataArray, axis: str) -> list[str]:
    gone = keep[axis].values[~keep.values]
    return [f"{axis} {_words(axis, gone)} not printed"] if gone.size else []


def _range_text(axis: str, points: np.ndarray) -> str:
    return f"{axis} {_words(axis, points)}: value of the nearest one held" if points.size else ""


def _words(axis: str, points: np.ndarray) -> str:
    scale, unit = (DEGREE, " deg") if axis == "alpha" else (1.0, "")
    return " ".join(f"{point / scale:.4g}" for point in points) + unit


def _stderr(
    name: str, table: xr.DataArray, prior: PriorErrors, zeros: Mapping[str, Sequence[float]]
) -> np.ndarray:
    stderr = prior.stderr(name, table)
    for axis, points in zeros.items():
        if axis in table.dims:
            stderr = stderr.where(~table[axis].isin(list(points)), 0.0)
    return stderr.transpose(*table.dims).values


def _carried(printed: xr.DataArray, ends: np.ndarray, prior: PriorErrors) -> np.ndarray:
    """Return the Mach numbers to which a value is carried from another speed regime."""
    if not ends.size:
        return ends
    last = float(printed["mach"].max())
    return np.array([end for end in ends if end > last and prior.regime(end) != prior.regime(last)])
