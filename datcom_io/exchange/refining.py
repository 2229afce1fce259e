"""Printed numbers made finer by those of the plot file, each checked against the print first.

The print gives CD, CL, CN and CA three decimals, so at small angles of attack five per cent of CD
are lost; the plot file has five significant digits.  A number is taken only where it rounds to the
printed one.
"""

from __future__ import annotations

from typing import Any

import numpy as np
import xarray as xr

from datcom_io.arrays.conditions import parse_configuration
from datcom_io.cells import FILLED, is_number_flag
from flightmech.errors import SchemaError
from flightmech.units import DEGREE

_DECIMALS = {
    "CD": 3,
    "CL": 3,
    "Cm": 4,
    "CN": 3,
    "CA": 3,
    "q_ratio": 3,
    "epsilon": 3,
    "epsilon_alpha": 3,
}
_DECIMALS |= {"dCL": 3, "dCm": 4, "dCLmax": 3, "dCDmin": 5}
_DIGITS = {"dCDi": 3}  # significant ones; four in all other columns
_ROUNDING = 1e-9  # of the unit conversions, in half units
_SHOWN = 5


def refine(tree: xr.DataTree, plot: xr.DataTree) -> xr.DataTree:
    """Return the tree of a case with the digits of its plot file.

    Parameters
    ----------
    tree : DataTree
        As `Case.to_datatree` returns it.
    plot : DataTree
        The same case in the plot file: a child of what `read_plot` returns.

    Returns
    -------
    DataTree
        A new tree.  In ``static``, ``downwash`` and ``symflp`` every number of a page in free air,
        without power and deflection, that the plot file has too is the finer one; attribute
        ``refined`` of each variable states how many and from where.  Flags, missing numbers and all
        else stay as printed.

    Raises
    ------
    SchemaError
        The two are not of the same case, or a number does not round to the printed one.

    Examples
    --------
    >>> plot = datcom_io.exchange.read_plot("for013.dat")                     # doctest: +SKIP
    >>> fine = datcom_io.exchange.refine(listing[0].to_datatree(), plot["case 1"])    # doctest: +SKIP
    """
    problems: list[str] = []
    leaves = {name: leaf.to_dataset(inherit=False) for name, leaf in tree.children.items()}
    for name in ("static", "downwash", "symflp"):
        if name in leaves and name in plot.children:
            written = _with_angles(plot.children[name].to_dataset(inherit=False), leaves[name])
            faults = _axes(name, leaves[name], written)
            if not faults:
                per_degree = name == "symflp" or tree.attrs.get("deriv") == "DEG"
                leaves[name], faults = _refined(
                    leaves[name], written, str(plot.attrs.get("file")), per_degree
                )
            problems += faults
    if problems:
        raise SchemaError(
            f"{plot.attrs.get('file')} is not the plot file of {tree.attrs.get('file')}: "
            f"{tree.attrs.get('case')}",
            problems,
        )
    return xr.DataTree.from_dict({"/": tree.to_dataset(inherit=False), **leaves}, name=tree.name)


def _with_angles(written: xr.Dataset, printed: xr.Dataset) -> xr.Dataset:
    """Return a leaf of the plot file without angles that NALPHA counts and the cards do not give,
    where the print has no row for them.
    """
    if written.sizes.get("alpha") == printed.sizes.get("alpha") or "alpha" not in written.dims:
        return written
    return written.isel(alpha=np.flatnonzero(np.isfinite(written["alpha"].values)))


def _axes(name: str, printed: xr.Dataset, written: xr.Dataset) -> list[str]:
    found = []
    for axis in ("mach", "alpha", "delta"):
        if axis not in printed.coords or axis not in written.coords:
            continue
        a, b = printed[axis].values, written[axis].values
        if axis == "mach" and a.shape == b.shape and np.isnan(b).all():
            continue  # speeds given by VINF: the file has no Mach number
        tolerance = (
            0.011 * DEGREE if axis == "delta" else 1e-4
        )  # zero is written as 0.01 deg; five digits else
        if a.shape != b.shape or not np.allclose(a, b, rtol=1e-4, atol=tolerance, equal_nan=True):
            found.append(f"{name}: {axis} is {_list(a)} in the print, {_list(b)} in the plot file")
    return found


def _list(values: np.ndarray) -> str:
    return " ".join(f"{value:.5g}" for value in values.tolist())


def _refined(
    printed: xr.Dataset, written: xr.Dataset, file: str, per_degree: bool
) -> tuple[xr.Dataset, list[str]]:
    """Return a leaf with finer numbers, and the faults found."""
    finer, faults = printed.copy(deep=True), []
    for name in (
        str(name)
        for name in written.data_vars
        if not str(name).endswith("_flag") and name in printed
    ):
        taken = 0
        for place, source in _places(printed, written):
            dims = printed[name][place].dims
            old, old_flag = (printed[key][place].values for key in (name, f"{name}_flag"))
            new, new_flag = (
                written[key].isel(source).transpose(*dims).values for key in (name, f"{name}_flag")
            )
            same = (is_number_flag(old_flag) & is_number_flag(new_flag)) | (
                (old_flag == FILLED) & (new_flag == FILLED)
            )
            scale = _to_print(name, written[name].attrs, per_degree)
            differing = same & ~(
                np.abs(old - new) * scale
                <= _half_units(name, old, new, scale, _to_file(name, written[name].attrs))
            )
            faults += [
                f"{name} is {old[at] * scale:.6g} in the print, {new[at] * scale:.6g} in the "
                f"plot file" + "".join(f", {dim} {i}" for dim, i in zip(dims, at))
                for at in map(tuple, np.argwhere(differing)[:_SHOWN])
            ]
            finer[name][place] = np.where(same, new, old)
            taken += int(same.sum())
        text = (
            f"{taken} of {printed[name].size} numbers with five significant digits from "
            f"{file}, all others as printed"
        )
        finer[name].attrs["refined"] = text
    return finer, faults


def _places(
    printed: xr.Dataset, written: xr.Dataset
) -> list[tuple[dict[Any, Any], dict[Any, Any]]]:
    """Return where the clean pages of each configuration stand in the printed leaf, and where in
    the plot file.
    """
    clean: dict[str, Any] = {}
    for axis, value in (
        ("power", "off"),
        ("ground_height", np.inf),
        ("delta_e", 0.0),
        ("delta_f", 0.0),
    ):
        if axis not in printed.coords:
            continue
        at = np.flatnonzero(np.atleast_1d(printed[axis].values) == value)
        if not len(at):
            return []
        if axis in printed.dims:
            clean[axis] = int(at[0])
    if (
        "configuration" not in written.dims
    ):  # the one downwash table belongs to every page that has one
        count = printed.sizes.get("configuration", 1)
        return [
            ({**clean, "configuration": i} if "configuration" in printed.dims else clean, {})
            for i in range(count)
        ]
    blocks = {
        parse_configuration(str(name)): i for i, name in enumerate(written["configuration"].values)
    }
    found = []
    for i, name in enumerate(np.atleast_1d(printed["configuration"].values)):
        if parse_configuration(str(name)) in blocks:
            place = {**clean, "configuration": i} if "configuration" in printed.dims else clean
            found.append((place, {"configuration": blocks[parse_configuration(str(name))]}))
    return found


def _to_print(name: str, attrs: dict[str, Any], per_degree: bool) -> float:
    """Return the factor from the tree to the printed number."""
    if name == "epsilon":
        return 1.0 / DEGREE
    return DEGREE if attrs.get("per") == "radian" and per_degree else 1.0


def _to_file(name: str, attrs: dict[str, Any]) -> float:
    """Return the factor from the tree to the written number; slopes are written per degree whatever
    card DERIV states.
    """
    return 1.0 / DEGREE if name == "epsilon" else DEGREE if attrs.get("per") == "radian" else 1.0


def _half_units(
    name: str, printed: np.ndarray, written: np.ndarray, to_print: float, to_file: float
) -> np.ndarray:
    """Return the half unit of the last printed digit plus that of the last written one. [as
    printed]
    """
    with np.errstate(divide="ignore", invalid="ignore"):
        numbers = (printed * to_print, written * to_file)
        decades = [
            np.where(values == 0.0, -30.0, np.floor(np.log10(np.abs(values)))) for values in numbers
        ]
    last = (
        np.full(printed.shape, -float(_DECIMALS[name]))
        if name in _DECIMALS
        else decades[0] - (_DIGITS.get(name, 4) - 1)
    )
    return (1.0 + _ROUNDING) * 0.5 * (10.0**last + 10.0 ** (decades[1] - 4) * to_print / to_file)
