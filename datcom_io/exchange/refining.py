"""Refinement of printed numbers by those of the plot file.

The print gives CD, CL, CN and CA three decimals, so at small angles of attack five per cent of CD
are lost.  The plot file has five significant digits.  A number of the plot file replaces the
printed one only where it rounds to it.
"""

from __future__ import annotations

from typing import Any

import numpy as np
import xarray as xr

from datcom_io.arrays.conditions import parse_configuration
from datcom_io.cells import FILLED, OVERFLOW, is_number_flag
from flightmech.errors import SchemaError
from flightmech.units import DEGREE

# Printed decimals of the columns that have a fixed number of them.
_DECIMALS = {
    "CD": 3,
    "CL": 3,
    "Cm": 4,
    "CN": 3,
    "CA": 3,
    "q_ratio": 3,
    "epsilon": 3,
    "epsilon_alpha": 3,
    "dCL": 3,
    "dCm": 4,
    "dCLmax": 3,
    "dCDmin": 5,
}
_DIGITS = {"dCDi": 3}  # significant ones; four in all other columns
_ROUNDING = 1e-9  # of the unit conversions, in half units
_SINGLE = 2.0**-23  # spacing of numbers of single precision, relative
# Half of the last digit of a Mach number and of an altitude [m] in the print.
_MACH, _HEIGHT = 5.1e-4, 0.31
_MOST_FAULTS = 5  # of a variable, in a message

Index = dict[Any, Any]
"""Index of a part of a leaf by dimension."""


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
        A new tree.  In ``static``, ``downwash`` and ``symflp`` the plot file replaces every number
        that it has of a page in free air, without power and deflection, unless power effects of
        the same case have left fewer digits in it than the print has.  Attribute ``refined`` of
        each variable states how many numbers come from which file.  Flags, missing numbers and all
        other numbers stay as printed.

    Raises
    ------
    SchemaError
        The trees are not of the same case, or a number does not round to the printed one.

    Examples
    --------
    >>> plot = datcom_io.exchange.read_plot("for013.dat")                     # doctest: +SKIP
    >>> tree = listing[0].to_datatree()                                       # doctest: +SKIP
    >>> fine = datcom_io.exchange.refine(tree, plot["case 1"])                # doctest: +SKIP
    """
    problems: list[str] = []
    leaves = {name: leaf.to_dataset(inherit=False) for name, leaf in tree.children.items()}
    for name in ("static", "downwash", "symflp"):
        if name not in leaves or name not in plot.children:
            continue
        # A deck without angles of attack prints rows of no angle, and its plot file has none.
        if plot.children[name].sizes.get("alpha") == 0:
            continue
        written = _drop_missing_angles(plot.children[name].to_dataset(inherit=False), leaves[name])
        written = _select_conditions(written, leaves[name])
        faults = _compare_axes(name, leaves[name], written)
        if not faults:
            # Slopes of control pages are printed per degree whatever card DERIV states.
            per_degree = name == "symflp" or tree.attrs.get("deriv") == "DEG"
            file = str(plot.attrs.get("file"))
            leaves[name], faults = _refine_leaf(leaves[name], written, file, per_degree)
        problems += faults
    if problems:
        raise SchemaError(
            f"{plot.attrs.get('file')} is not the plot file of {tree.attrs.get('file')}: "
            f"{tree.attrs.get('case')}",
            problems,
        )
    return xr.DataTree.from_dict({"/": tree.to_dataset(inherit=False), **leaves}, name=tree.name)


def _drop_missing_angles(written: xr.Dataset, printed: xr.Dataset) -> xr.Dataset:
    """Return a leaf of the plot file without angles for which the print has no row.

    NALPHA counts such angles, and the cards do not give them.
    """
    if written.sizes.get("alpha") == printed.sizes.get("alpha") or "alpha" not in written.dims:
        return written
    return written.isel(alpha=np.flatnonzero(np.isfinite(written["alpha"].values)))


def _select_conditions(written: xr.Dataset, printed: xr.Dataset) -> xr.Dataset:
    """Return a leaf of the plot file with the conditions of the print, in their order.

    The file has all conditions of the run, the print has no page of some.  The leaf is returned as
    it is when a printed condition is not among them.
    """
    if "mach" not in written.coords or "mach" not in printed.coords:
        return written
    machs, heights = np.atleast_1d(written["mach"].values), np.atleast_1d(written["h"].values)
    places: list[int] = []
    for mach, height in zip(np.atleast_1d(printed["mach"].values), _printed_heights(printed)):
        # A condition comes once more with the same numbers, so each stands behind the last one.
        later = np.arange(len(machs)) > (places[-1] if places else -1)
        is_same = _agrees(machs, mach, _MACH) & _agrees(heights, height, _HEIGHT)
        found = np.flatnonzero(later & is_same)
        if not len(found):
            return written
        places.append(int(found[0]))
    return written.isel(condition=places)


def _printed_heights(printed: xr.Dataset) -> np.ndarray:
    """Return the altitude of each printed condition, NaN where there is none. [m]"""
    if "h" in printed.coords:
        return np.atleast_1d(printed["h"].values)
    return np.full(np.atleast_1d(printed["mach"].values).shape, np.nan)


def _agrees(written: np.ndarray, printed: float, tolerance: float) -> np.ndarray:
    """Return where written numbers are the printed one, or one of both is missing."""
    is_close = np.abs(written - printed) <= tolerance + 1e-4 * abs(printed)
    return is_close | np.isnan(written) | np.isnan(printed)


def _compare_axes(name: str, printed: xr.Dataset, written: xr.Dataset) -> list[str]:
    """Return the axes of a leaf that differ between print and plot file."""
    differences = []
    for axis in ("mach", "alpha", "delta"):
        if axis not in printed.coords or axis not in written.coords:
            continue
        a, b = printed[axis].values, written[axis].values
        # Axes have five digits, but a deflection of zero is written as 0.01 deg.
        tolerance = 1e-4
        if axis == "mach":
            tolerance = _MACH
        if axis == "delta":
            tolerance = 0.011 * DEGREE
        if a.shape != b.shape or not np.allclose(a, b, rtol=1e-4, atol=tolerance, equal_nan=True):
            differences.append(
                f"{name}: {axis} is {_list_numbers(a)} in the print, {_list_numbers(b)} in the "
                f"plot file"
            )
    return differences


def _list_numbers(values: np.ndarray) -> str:
    return " ".join(f"{value:.5g}" for value in values.tolist())


def _refine_leaf(
    printed: xr.Dataset, written: xr.Dataset, file: str, per_degree: bool
) -> tuple[xr.Dataset, list[str]]:
    """Return a leaf with finer numbers, and the numbers that do not round to the printed ones."""
    finer, faults = printed.copy(deep=True), []
    pairs = _match_pages(printed, written)
    for name in map(str, written.data_vars):
        if name.endswith("_flag") or name not in printed:
            continue
        attrs = written[name].attrs
        scale = _print_factor(name, attrs, per_degree)
        file_scale = _file_factor(name, attrs)
        count = 0
        for target, source in pairs:
            dims = printed[name][target].dims
            old = printed[name][target].values
            old_flag = printed[f"{name}_flag"][target].values
            new = written[name].isel(source).transpose(*dims).values
            new_flag = written[f"{name}_flag"].isel(source).transpose(*dims).values
            both_numbers = is_number_flag(old_flag) & is_number_flag(new_flag)
            both_filled = (old_flag == FILLED) & (new_flag == FILLED)
            in_both = both_numbers | both_filled
            half_units = _half_units(name, old, new, to_print=scale, to_file=file_scale)
            rounding = scale * _rounding_of_power(printed, name, target)
            differing = in_both & ~(np.abs(old - new) * scale <= half_units + rounding)
            # A written number that power has rounded more than the print has fewer digits.
            in_both &= rounding <= half_units
            for index in map(tuple, np.argwhere(differing)[:_MOST_FAULTS]):
                where = "".join(f", {dim} {i}" for dim, i in zip(dims, index))
                faults.append(
                    f"{name} is {old[index] * scale:.6g} in the print, {new[index] * scale:.6g} "
                    f"in the plot file{where}"
                )
            finer[name][target] = np.where(in_both, new, old)
            count += int(in_both.sum())
        finer[name].attrs["refined"] = (
            f"{count} of {printed[name].size} numbers with five significant digits from "
            f"{file}, all others as printed"
        )
    return finer, faults


def _rounding_of_power(leaf: xr.Dataset, name: str, page: Index) -> np.ndarray:
    """Return by how much the written numbers of a clean page are rounded by power effects.

    The program adds power effects to its numbers of single precision, and subtracts them again
    before it writes the plot file.  It is infinite where the print of a sum overflows.
    """
    dims = leaf[name][page].dims
    if "power" not in page:
        return np.zeros([leaf.sizes[dim] for dim in dims])
    every_power = {axis: index for axis, index in page.items() if axis != "power"}
    sums, flags = leaf[name][every_power], leaf[f"{name}_flag"][every_power]
    largest = abs(sums).fillna(0.0).where(flags != OVERFLOW, np.inf).max("power")
    return _SINGLE * largest.transpose(*dims).values


# Values of a clean page along the axes of the print.
_CLEAN_PAGE = (("power", "off"), ("ground_height", np.inf), ("delta_e", 0.0), ("delta_f", 0.0))


def _match_pages(printed: xr.Dataset, written: xr.Dataset) -> list[tuple[Index, Index]]:
    """Return the index of the clean pages of each configuration, in the print and in the file."""
    clean: Index = {}
    for axis, value in _CLEAN_PAGE:
        if axis not in printed.coords:
            continue
        indices = np.flatnonzero(np.atleast_1d(printed[axis].values) == value)
        if not len(indices):
            return []
        if axis in printed.dims:
            clean[axis] = int(indices[0])
    names = [""]
    if "configuration" in printed.coords:
        names = [str(name) for name in np.atleast_1d(printed["configuration"].values)]
    pages: list[Index] = []
    for i in range(len(names)):
        page = dict(clean)
        if "configuration" in printed.dims:
            page["configuration"] = i
        pages.append(page)
    # The one downwash table belongs to every page that has one.
    if "configuration" not in written.dims:
        return [(page, {}) for page in pages]
    blocks = {}
    for i, name in enumerate(written["configuration"].values):
        blocks[parse_configuration(str(name))] = i
    pairs = []
    for page, name in zip(pages, names):
        parts = parse_configuration(name)
        if parts in blocks:
            pairs.append((page, {"configuration": blocks[parts]}))
    return pairs


def _print_factor(name: str, attrs: dict[str, Any], per_degree: bool) -> float:
    """Return the factor from the tree to the printed number."""
    if name == "epsilon":
        return 1.0 / DEGREE
    if attrs.get("per") == "radian" and per_degree:
        return DEGREE
    return 1.0


def _file_factor(name: str, attrs: dict[str, Any]) -> float:
    """Return the factor from the tree to the written number.

    Slopes are written per degree whatever card DERIV states.
    """
    return _print_factor(name, attrs, per_degree=True)


def _half_units(
    name: str, printed: np.ndarray, written: np.ndarray, *, to_print: float, to_file: float
) -> np.ndarray:
    """Return half of the last printed digit plus half of the last written one. [as printed]"""
    with np.errstate(divide="ignore", invalid="ignore"):
        printed_decade = _decade_of(printed * to_print)
        written_decade = _decade_of(written * to_file)
    if name in _DECIMALS:
        last_digit = np.full(printed.shape, -float(_DECIMALS[name]))
    else:
        last_digit = printed_decade - (_DIGITS.get(name, 4) - 1)
    # The plot file has five significant digits.
    last_written = 10.0 ** (written_decade - 4) * to_print / to_file
    return (1.0 + _ROUNDING) * 0.5 * (10.0**last_digit + last_written)


def _decade_of(values: np.ndarray) -> np.ndarray:
    """Return the power of ten of the first significant digit, -30 for zero."""
    return np.where(values == 0.0, -30.0, np.floor(np.log10(np.abs(values))))
