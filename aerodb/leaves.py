"""Effects to terms: cells that are not printed filled or cut away, standard errors and sources put beside every node."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np
import xarray as xr

from flightmech import terms as _terms
from flightmech.units import DEGREE

from .effects import Effect, joined

AXIS_ORDER = ("h", "h_agl", "delta_f", "mach", "alpha", "delta_e", "delta_a")
_HELD = 2.0  # standard error of a node held beyond the printed alphas, against the rule for printed ones


def leaves(effect: Effect, prior: Mapping[str, tuple[float, float]], machs: tuple[float, float]) -> dict[str, xr.Dataset]:
    """Return the terms of an effect by name.

    Parameters
    ----------
    effect : Effect
        Its tables may hold NaN where the listing prints no number.
    prior : mapping of str to (float, float)
        Relative and absolute standard error by term name.
    machs : (float, float)
        Range every Mach axis must cover.

    Notes
    -----
    A Mach number that prints less than half as many alphas as the best one is cut off (a transonic page prints one row), and so are
    alphas that no Mach number prints.  A cell that is then missing takes the value of the nearest printed alpha of its Mach number,
    interpolated between two, and a Mach number beyond the printed ones the value of the nearest: what the simulation does beyond a
    table, but here for one Mach number without loss to the others.  Such nodes are marked as judgement, those held in alpha with
    twice the standard error.
    """
    found = {}
    for coefficient, table in effect.tables.items():
        whole, printed, notes = completed(table.transpose(*(axis for axis in AXIS_ORDER if axis in table.dims)))
        if not whole.size:
            continue
        value, held = _covered(whole, machs), _covered(printed, machs)
        name = f"{coefficient}/{effect.name}"
        leaf = _terms.make(
            value.values,
            {str(axis): value[axis].values for axis in value.dims},
            effect.regressor.split(),
            stderr=_stderr(value, *prior[name], effect.zeros) * np.where(held, 1.0, _HELD),
            source="datcom",
            references=effect.references,
            comment=joined(effect.comment, *notes, _said_of_mach(value, whole)),
            history=f"from_datcom: {name}",
        )
        judged = ~held
        if "mach" in value.dims:
            judged = judged | ~value["mach"].isin(whole["mach"].values)
        leaf["source"] = leaf["source"].copy(
            data=np.where(judged.transpose(*value.dims), _terms.SOURCES.index("judgement"), leaf["source"]).astype(np.uint8)
        )
        found[name] = leaf
    return found


def completed(table: xr.DataArray) -> tuple[xr.DataArray, xr.DataArray, list[str]]:
    """Return a table without NaN, which of its cells are printed, and what was done; an empty one when nothing is printed."""
    good = np.isfinite(table)
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
            notes.append(f"{missing} of {good.size} cells are not printed: value of the nearest printed alpha held there")
            table = xr.apply_ufunc(
                _nearest, table["alpha"], table, input_core_dims=[["alpha"], ["alpha"]], output_core_dims=[["alpha"]], vectorize=True
            ).transpose(*table.dims)
    return table, good, notes


def _nearest(x: np.ndarray, y: np.ndarray) -> np.ndarray:
    good = np.isfinite(y)
    return np.interp(x, x[good], y[good]) if good.any() else y


def _dropped(keep: xr.DataArray, axis: str) -> list[str]:
    gone = keep[axis].values[~keep.values]
    scale, unit = (DEGREE, " deg") if axis == "alpha" else (1.0, "")
    return [f"{axis} {' '.join(f'{point / scale:.4g}' for point in gone)}{unit} cut off: not printed"] if gone.size else []


def _covered(table: xr.DataArray, machs: tuple[float, float]) -> xr.DataArray:
    """Return a table whose Mach axis covers a range, the last values held."""
    if "mach" not in table.dims:
        return table
    points = table["mach"].values
    wanted = [mach for mach in machs if mach < points[0] or mach > points[-1]]
    return table.reindex(mach=np.union1d(points, wanted), method="nearest") if wanted else table


def _said_of_mach(value: xr.DataArray, whole: xr.DataArray) -> str:
    new = np.setdiff1d(value["mach"].values, whole["mach"].values) if "mach" in value.dims else np.array([])
    return f"Mach {' and '.join(f'{mach:g}' for mach in new)}: value of the nearest computed Mach number held" if new.size else ""


def _stderr(table: xr.DataArray, relative: float, absolute: float, zeros: Mapping[str, Sequence[float]]) -> np.ndarray:
    stderr = np.hypot(relative * table, absolute)
    for axis, points in zeros.items():
        if axis in table.dims:
            stderr = stderr.where(~table[axis].isin(list(points)), 0.0)
    return stderr.transpose(*table.dims).values
