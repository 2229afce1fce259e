"""A listing as the structure of MATLAB's ``datcomimport``, in a MAT file of version 5."""

from __future__ import annotations

import io
import os
from collections import Counter
from typing import Any, NamedTuple

import numpy as np
import xarray as xr
from scipy.io import savemat

from datcom_io.arrays.conditions import control_surface, parse_configuration
from datcom_io.cells import ABSENT, BLANK, FILLED, FLAGS, OK, SUSPECT
from datcom_io.exchange.matlab_fields import (
    BUILD,
    MISSING,
    Field,
    Units,
    field_dimension,
    select_fields,
)
from datcom_io.exchange.matlab_scalars import MachAltitudeGrid, case_scalars, symmetric_deflections
from datcom_io.listing import Case, Listing
from flightmech.support.atomic_write import written_atomically

_HEADER = b"MATLAB 5.0 MAT-file, written by aeromatch"
_HEADER_SIZE = 116  # bytes of the text in the header
_UPRIGHT = frozenset(("fin", "panels"))
_NUMBER = (OK, FILLED, SUSPECT)
_NOT_PRINTED = (ABSENT, BLANK)
_NO_FIELD = (
    "velocity, pressure, temperature and Reynolds number of the flight conditions, the "
    "moment centre, notes, messages, "
    "line numbers and airfoil pages have no field"
)


def write_matlab(
    listing: Listing, path: str | os.PathLike[str], *, usenan: bool = True
) -> list[str]:
    """Write a listing as the structure that MATLAB's ``datcomimport`` returns.

    Parameters
    ----------
    listing : Listing
    path : path
        MAT file (version 5) to write atomically: variable ``aero``, a cell array with one structure
        per case, and ``history``, a text that states what was done and what was left out.
    usenan : bool
        NaN, otherwise 0, where the program prints NDM, NA or no number.  A place without a page
        holds 99999.

    Returns
    -------
    list of str
        Everything that the structure has no room for; nothing is left out silently.

    Notes
    -----
    Numbers are as printed: units of card DIM, slopes per degree or radian by card DERIV.  Columns
    that the program prints in the first row only, because they are constant in alpha, hold their
    value in every row.  ``grndht`` holds the heights in the unit of card DIM and Inf for free air,
    last.
    """
    # MATLAB reads an array of objects as a cell array.
    structures = np.empty((1, len(listing)), object)
    left_out = [_NO_FIELD]
    for k, case in enumerate(listing):
        structures[0, k], omissions = make_case_structure(case, usenan=usenan)
        left_out += [f"{case.name}: {text}" for text in omissions]
    if listing.unparsed:
        left_out.append(f"{len(listing.unparsed)} pages that are located only")
    title = (
        f"written from {listing.file} by aeromatch; constant columns stand in every row; left out:"
    )
    history = "\n".join([title, *left_out])
    # SciPy hides the error of a file that cannot be opened
    content = io.BytesIO()
    savemat(
        content,
        {"aero": structures, "history": history},
        appendmat=False,
        format="5",
        long_field_names=True,
        oned_as="row",
    )
    # SciPy's text holds the time, so that equal listings would give unequal files
    data = _HEADER.ljust(_HEADER_SIZE) + content.getvalue()[_HEADER_SIZE:]
    with written_atomically(path) as part:
        part.write_bytes(data)
    return left_out


def make_case_structure(case: Case, *, usenan: bool = True) -> tuple[dict[str, Any], list[str]]:
    """Return the structure of one case as a dict, and a list of what it has no room for."""
    tree = case.to_datatree()
    deck = case.deck
    jet_pressure = "psf"
    if deck.values("FLTCON", "PINF"):
        jet_pressure = "psi"
    units = Units(deck.dim, deck.deriv, jet_pressure)
    # Mach number and altitude are separate indices of the arrays.
    grid = _make_grid(case, tree, units)
    build = 1
    if deck.has("BUILD") or _has_configurations(tree):
        build = len(BUILD)
    structure = case_scalars(case, tree, grid, build=build, units=units)
    omissions = _Omissions(tree, grid)
    device = "delta_f"
    if control_surface(deck) == "tail":
        device = "delta_e"
    arrays = _FieldArrays(
        grid=grid,
        build=build,
        device=device,
        deltas=symmetric_deflections(deck),
        units=units,
        usenan=usenan,
        omissions=omissions,
    )
    for field in select_fields(int(deck.value("ASYFLP", "STYPE") or 0)):
        leaf = tree.children.get(field.leaf)
        if leaf is None:
            continue
        # The program prints the stick force or its coefficient, both of which become fc_con.
        if field.name == "fc_con" and "CF_stick" in leaf:
            field = field._replace(quantity="CF_stick", units="1")
        if field.quantity not in leaf.variables:
            continue
        array = arrays.make(field, leaf.to_dataset(inherit=False))
        if array is not None:
            structure[field.name] = _drop_trailing_axes(array)
    return structure, omissions.list_texts()


def _has_configurations(tree: xr.DataTree) -> bool:
    """Return whether static or dynamic pages are those of several configurations."""
    leaves = [tree.children[name] for name in ("static", "dynamic") if name in tree.children]
    return any("configuration" in leaf.dims for leaf in leaves)


def _make_grid(case: Case, tree: xr.DataTree, units: Units) -> MachAltitudeGrid:
    """Return Mach numbers and altitudes of a case, and the indices of each flight condition.

    They are those of the cards, or pairs where the cards do not state the printed conditions.
    """
    deck = case.deck
    schedule = deck.conditions()
    count = len(schedule)
    machs = deck.schedule("FLTCON", "MACH", "NMACH")
    alts = deck.schedule("FLTCON", "ALT", "NALT")
    conditions = _first_conditions(tree)
    if conditions is not None:
        count = conditions.sizes["condition"]
        if len(schedule) != count:
            machs = conditions["mach"].values.tolist()
            heights = np.round(conditions["h"].values / units.factor("length"), 6)
            alts = []
            if not np.isnan(heights).all():
                alts = heights.tolist()
            return MachAltitudeGrid(machs, alts, 1, _paired_indices(count, alts))
    # LOOP=1 steps both together, 2 has altitude outside, 3 has Mach number outside.
    if deck.loop == 1:
        return MachAltitudeGrid(machs[:count], alts[:count], 1, _paired_indices(count, alts))
    if deck.loop == 2:
        indices = [(k % len(machs), k // len(machs)) for k in range(count)]
        return MachAltitudeGrid(machs, alts, 2, indices)
    per_mach = max(len(alts), 1)
    return MachAltitudeGrid(machs, alts, 3, [(k // per_mach, k % per_mach) for k in range(count)])


def _first_conditions(tree: xr.DataTree) -> xr.Dataset | None:
    """Return the first leaf over flight conditions, None without any."""
    for leaf in tree.children.values():
        if "condition" in leaf.dims:
            return leaf.to_dataset(inherit=False)
    return None


def _paired_indices(count: int, alts: list[float]) -> list[tuple[int, int]]:
    """Return the indices of conditions whose Mach number and altitude step together."""
    if alts:
        return [(k, k) for k in range(count)]
    return [(k, 0) for k in range(count)]


class _FieldArrays(NamedTuple):
    """Makes the arrays of a case; `omissions` collects what they have no room for."""

    grid: MachAltitudeGrid
    build: int
    device: str
    deltas: list[float]
    units: Units
    usenan: bool
    omissions: _Omissions

    def make(self, field: Field, leaf: xr.Dataset) -> np.ndarray | None:
        """Return one field with its indices in order, None where nothing of it is printed."""
        selected = _select_labels(leaf, field)
        if selected is None:
            return None
        leaf = self._select_deflections(selected, field.leaf)
        value = leaf[field.quantity]
        flag = xr.zeros_like(value, dtype=np.uint8)
        if f"{field.quantity}_flag" in leaf:
            flag = leaf[f"{field.quantity}_flag"]
        if "power" in value.dims:
            # The structure has one power setting: power off, or the first one.
            settings = leaf["power"].values.tolist()
            index = settings.index("off") if "off" in settings else 0
            self.omissions.add_power(field.leaf, settings, index)
            value, flag = value.isel(power=index), flag.isel(power=index)
        inner_axes = [axis for axis in field.axes if axis not in ("mach", "alt")]
        dims = ["condition", *(field_dimension(field, axis, self.device) for axis in inner_axes)]
        count = leaf.sizes["condition"]
        numbers, flags = _order_dims(value, dims, count), _order_dims(flag, dims, count)
        self.omissions.count_flags(field, flags)
        if (flags == ABSENT).all():
            return None
        if field.units != "text":
            numbers = self._as_printed(field, numbers, flags)
        if "build" in inner_axes:
            numbers = self._over_build(numbers, inner_axes.index("build") + 1, leaf, field.leaf)
        array = self._over_grid(numbers, leaf, field)
        order = ["mach", "alt", *inner_axes]
        if "alt" not in field.axes:
            array = self._select_altitude(array, field.leaf)
            order.remove("alt")
        return array.transpose([order.index(axis) for axis in field.axes])

    def _select_deflections(self, leaf: xr.Dataset, name: str) -> xr.Dataset:
        """Return a leaf with the deflections of the cards.

        The structure has no room for the clean page of a run in ground effect.
        """
        if self.device not in leaf.dims or leaf.sizes[self.device] <= max(len(self.deltas), 1):
            return leaf
        # Rounded, because angles come back from radians.
        printed = np.round(np.rad2deg(leaf[self.device].values), 6)
        on_cards = np.isin(printed, np.round(self.deltas, 6))
        for angle in printed[~on_cards]:
            self.omissions.add(f"{self.device} {angle:g} deg of leaf {name}")
        return leaf.isel({self.device: on_cards})

    def _select_altitude(self, array: np.ndarray, leaf: str) -> np.ndarray:
        """Return the numbers of the first altitude that has some, for a field without altitude."""
        printed = [j for j in range(array.shape[1]) if (array[:, j] != MISSING).any()]
        for j in printed[1:]:
            self.omissions.add(f"leaf {leaf} at altitude {self.grid.alts[j]:g}")
        if not printed:
            return array[:, 0]
        return array[:, printed[0]]

    def _as_printed(self, field: Field, numbers: np.ndarray, flags: np.ndarray) -> np.ndarray:
        """Return the numbers in the unit of the print, and the codes of missing numbers."""
        no_number = 0.0
        if self.usenan:
            no_number = np.nan
        missing = np.where(np.isin(flags, _NOT_PRINTED), MISSING, no_number)
        factor = self.units.factor(field.units)
        return np.where(np.isin(flags, _NUMBER), numbers / factor, missing)

    def _over_build(
        self, numbers: np.ndarray, axis: int, leaf: xr.Dataset, name: str
    ) -> np.ndarray:
        """Return the numbers along the index ``build``."""
        names = np.atleast_1d(leaf["configuration"].values).tolist()
        for configuration in names:
            if "panels" in parse_configuration(configuration):
                self.omissions.add(
                    f"the words TWIN VERTICAL PANEL in configuration {configuration}"
                )
        if self.build != len(BUILD):
            return numbers
        # The index has ten places, whatever configurations are printed.
        shape = list(numbers.shape)
        shape[axis] = len(BUILD)
        array = np.moveaxis(np.full(shape, MISSING), axis, 0)
        filled = set()
        for i, configuration in enumerate(names):
            index = configuration_index(configuration)
            if index is None or index in filled:
                self.omissions.add_configuration(configuration, name)
                continue
            filled.add(index)
            array[index] = np.moveaxis(numbers, axis, 0)[i]
        return np.moveaxis(array, 0, axis)

    def _over_grid(self, numbers: np.ndarray, leaf: xr.Dataset, field: Field) -> np.ndarray:
        """Return an array (mach, alt, ...) of numbers along flight conditions."""
        shape = (len(self.grid.machs), max(len(self.grid.alts), 1), *numbers.shape[1:])
        if field.units == "text":
            array = np.full(shape, "", object)
        else:
            array = np.full(shape, MISSING)
        for k, index in enumerate(self._grid_indices(leaf)):
            if index is None:
                self.omissions.add(
                    f"condition {k} of leaf {field.leaf}: its Mach number and altitude are "
                    f"not those of the cards"
                )
            else:
                array[index] = numbers[k]
        return array

    def _grid_indices(self, leaf: xr.Dataset) -> list[tuple[int, int] | None]:
        """Return the indices of each condition of a leaf, None for one that is not on the cards.

        All leaves have the conditions of the case, except those of special pages.
        """
        if leaf.sizes["condition"] == len(self.grid.indices):
            return list(self.grid.indices)
        heights = np.round(leaf["h"].values / self.units.factor("length"), 6).tolist()
        # Special pages have conditions of their own, found by their values.
        index_of: dict[tuple[float, float | None], tuple[int, int]] = {}
        for i, j in self.grid.indices:
            alt = None
            if self.grid.alts:
                alt = round(self.grid.alts[j], 6)
            index_of[self.grid.machs[i], alt] = (i, j)
        indices = []
        for mach, height in zip(leaf["mach"].values.tolist(), heights):
            alt = height if self.grid.alts else None
            indices.append(index_of.get((mach, alt)))
        return indices


def _select_labels(leaf: xr.Dataset, field: Field) -> xr.Dataset | None:
    """Return the part of a leaf that a field has in its name, None where it is not printed."""
    for axis, label in field.labels:
        if axis not in leaf.dims:
            # One label alone is a scalar coordinate.
            if str(leaf[axis].values) != label:
                return None
        elif label in leaf[axis].values:
            leaf = leaf.sel({axis: label})
        else:
            return None
    return leaf


def _order_dims(item: xr.DataArray, dims: list[str], count: int) -> np.ndarray:
    """Return an array with its dimensions in order; missing ones get the length one.

    Numbers that hold for all conditions are repeated `count` times.
    """
    missing = [dim for dim in dims if dim not in item.dims]
    array = item.expand_dims(missing).transpose(*dims).values
    if "condition" in item.dims:
        return array
    return np.repeat(array, count, axis=0)


def configuration_index(configuration: str) -> int | None:
    """Return the index of a configuration along ``build``, None where it has none."""
    made_of = parse_configuration(configuration)
    # Fins and panels with other parts count as a vertical tail.
    if made_of & _UPRIGHT and made_of - _UPRIGHT:
        made_of = (made_of - _UPRIGHT) | {"vertical"}
    if made_of not in BUILD:
        return None
    return BUILD.index(made_of)


def _drop_trailing_axes(array: np.ndarray) -> np.ndarray:
    """Return an array without trailing indices of length one, which MATLAB does not keep."""
    while array.ndim > 2 and array.shape[-1] == 1:
        array = array[..., 0]
    if array.ndim == 1:
        return array.reshape(-1, 1)
    return array


class _Omissions:
    """Collects what the structure has no room for."""

    def __init__(self, tree: xr.DataTree, grid: MachAltitudeGrid):
        self.tree = tree
        self.grid = grid
        self.written: set[tuple[str, str]] = set()
        self.flag_counts: Counter[str] = Counter()
        self.configurations: dict[str, set[str]] = {}
        self.texts: set[str] = set()

    def add(self, text: str) -> None:
        """Add one thing that is left out."""
        self.texts.add(text)

    def add_power(self, leaf: str, settings: list[str], index: int) -> None:
        """Add the pages with another power setting than the written one."""
        for i, name in enumerate(settings):
            if i != index:
                self.add(f"{leaf} pages with power {name}")

    def add_configuration(self, configuration: str, leaf: str) -> None:
        """Add a configuration of a leaf that has no index along ``build``."""
        self.configurations.setdefault(configuration, set()).add(leaf)

    def count_flags(self, field: Field, flags: np.ndarray) -> None:
        """Count the flags of a field that is written; ordinary numbers are not counted."""
        self.written.add((field.leaf, field.quantity))
        # Ordinary and absent numbers need no remark.
        counts = np.bincount(flags.ravel(), minlength=len(FLAGS))
        for code, count in enumerate(counts):
            if count and code not in (OK, ABSENT):
                self.flag_counts[FLAGS[code]] += int(count)

    def list_texts(self) -> list[str]:
        """Return one line for each thing left out."""
        texts = []
        for name, leaf in self.tree.children.items():
            texts += self._unwritten_variables(name, leaf)
        for name, leaves in self.configurations.items():
            texts.append(f"configuration {name} of {' and '.join(sorted(leaves))}")
        texts += sorted(self.texts)
        for leaf_name, name in self.written:
            if leaf_name == "tabs" and name in ("F_stick", "CF_stick"):
                texts.append(f"leaf tabs: whether fc_con is {name}")
        if self.flag_counts:
            counts = [f"{count} {name}" for name, count in sorted(self.flag_counts.items())]
            texts.append(f"which cells are what: {', '.join(counts)}")
        if "jet" in self.tree.children and "alpha" in self.tree["jet"].coords:
            texts.append("leaf jet: the angle of attack at each time")
        for name, values in (("mach", self.grid.machs), ("alt", self.grid.alts)):
            if not (np.diff(values) > 0).all():
                texts.append(
                    f"(nothing lost) {name} does not rise, as Simulink's block wants it to"
                )
        return texts

    def _unwritten_variables(self, name: str, leaf: xr.DataTree) -> list[str]:
        """Return a text with the variables of a leaf that no field holds."""
        # A leaf that no field holds is listed as one.
        variables = [str(key) for key in leaf.data_vars if not str(key).endswith("_flag")]
        unwritten = [key for key in variables if (name, key) not in self.written]
        if not unwritten:
            return []
        if len(unwritten) == len(variables):
            return [f"leaf {name}"]
        return [f"leaf {name}: {' '.join(unwritten)}"]
