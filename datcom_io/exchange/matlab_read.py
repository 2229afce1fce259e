"""The structure of MATLAB's ``datcomimport`` as a tree: SI, radians, canonical names, flags."""

from __future__ import annotations

import os
from collections.abc import Sequence
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
import xarray as xr

from datcom_io.arrays.conditions import LOW_ASPECT_RATIO, printed_name
from datcom_io.arrays.leaves import LeafBuilder, empty_cells
from datcom_io.cells import ABSENT, FILLED, NDM, OK
from datcom_io.exchange.matlab_fields import (
    BUILD,
    INDEX_DIMENSIONS,
    LABELS,
    MISSING,
    Field,
    field_dimension,
    select_fields,
)
from datcom_io.exchange.matlab_structure import NUMERIC, CaseStructure, find_structures
from datcom_io.printout.rows import PrintedColumn
from flightmech.errors import ParseError
from flightmech.support.array_files.mat_files import load_mat
from flightmech.support.input_files import read_bytes
from flightmech.units import DEGREE

# Leaves with conditions of their own, and leaves over configurations.
_OWN_CONDITIONS = ("hypersonic", "jet")
_BY_CONFIGURATION = ("static", "downwash", "dynamic")


class _MatlabField(NamedTuple):
    """One field along the conditions of the case.

    ``dims`` are the dimensions after ``condition``; ``values`` are in SI.
    """

    field: Field
    dims: tuple[str, ...]
    values: np.ndarray
    flags: np.ndarray


def read_matlab(path: str | os.PathLike[str]) -> xr.DataTree:
    """Read the structure that MATLAB's ``datcomimport`` returns, saved in a MAT file, as a tree.

    Parameters
    ----------
    path : path
        MAT file of version 4 to 7 with a cell array of structures, or a structure, of Digital
        DATCOM (1976).

    Returns
    -------
    DataTree
        As `Listing.to_datatree`: one child per case with tables.  NaN is flagged NDM, though it may
        have been any other code; 99999 is flagged absent.  A column that is constant in alpha and
        stands in the first row only is filled where `Case.to_datatree` does.  The stick force, or
        its coefficient, is ``fc_con``, as printed.

    Raises
    ------
    ParseError
        No such structure in the file, a field whose size is not that of its breakpoints, or a
        version of the file that HDF5 tools read.
    """
    file = Path(path).name
    expected = "a MAT file with the result of datcomimport"
    try:
        content = load_mat(read_bytes(path, expected), file, expected, struct_as_record=True)
    except NotImplementedError as error:
        raise ParseError(
            file, 0, "a MAT file of version 7.3", "version 7 or older; save it with the option -v7"
        ) from error
    root = xr.DataTree(xr.Dataset(attrs={"file": file}))
    for number, structure in enumerate(find_structures(file, content), 1):
        case = CaseStructure(file, number, structure)
        leaves = _read_leaves(case)
        if not leaves:
            continue
        name = (case.text("case") or f"case {number}").replace("/", "|")
        unique = name
        if name in root.children:
            unique = f"{name} ({number})"
        attrs = xr.Dataset(attrs=case.attrs(name))
        root[unique] = xr.DataTree.from_dict({"/": attrs, **leaves}, name=unique)
    return root


def _read_leaves(case: CaseStructure) -> dict[str, xr.Dataset]:
    """Return the leaves of a case."""
    fields_of_leaf: dict[str, list[_MatlabField]] = {}
    for field in select_fields(case.style):
        # The structure does not distinguish a stick force in pounds from its coefficient.
        if field.name == "fc_con":
            field = field._replace(quantity="fc_con", units="1")
        part = _read_field(case, field)
        if part is not None:
            fields_of_leaf.setdefault(field.leaf, []).append(part)
    leaves = {}
    for name, parts in fields_of_leaf.items():
        if any((part.flags != ABSENT).any() for part in parts):
            leaves[name] = _make_leaf(case, name, parts)
    return leaves


# Arrays of single fields.


def _read_field(case: CaseStructure, field: Field) -> _MatlabField | None:
    """Return a field along flight conditions, None when the structure does not have it."""
    array = case.structure.get(field.name)
    if array is None or array.size == 0:
        return None
    if field.units != "text" and array.dtype.kind not in NUMERIC:
        raise case.error(f"{field.name} without numbers", "an array of numbers")
    inner_axes = [axis for axis in field.axes if axis not in ("mach", "alt")]
    dims = tuple(field_dimension(field, axis, case.device) for axis in inner_axes)
    indexed = _restore_indices(case, field, array)
    order = list(field.axes)
    # A field without altitude holds for all altitudes.
    if "alt" not in field.axes:
        indexed = np.repeat(indexed[..., np.newaxis], max(len(case.alts), 1), axis=-1)
        order.append("alt")
    indexed = indexed.transpose([order.index(axis) for axis in ("mach", "alt", *inner_axes)])
    by_condition = np.array([indexed[index] for index in case.grid_indices])
    if field.units == "text":
        texts = _texts_of(by_condition)
        flags = np.where(texts == "", ABSENT, OK).astype(np.uint8)
        return _MatlabField(field, dims, texts, flags)
    numbers = by_condition.astype(float)
    codes = np.where(np.isnan(numbers), NDM, OK)
    flags = np.where(numbers == MISSING, ABSENT, codes).astype(np.uint8)
    values = np.where(flags == OK, numbers * case.units.factor(field.units), np.nan)
    if field.constant:
        _fill_constant(case, values, flags)
    return _MatlabField(field, dims, values, flags)


def _texts_of(cells: np.ndarray) -> np.ndarray:
    """Return the texts of a cell array, empty where a cell is empty."""
    texts = []
    for item in cells.ravel():
        texts.append(str(np.ravel(item)[0]) if np.size(item) else "")
    return np.array(texts).reshape(cells.shape)


def _restore_indices(case: CaseStructure, field: Field, array: np.ndarray) -> np.ndarray:
    """Return an array with the trailing indices that MATLAB has dropped, after a check of its size.

    Raises
    ------
    ParseError
        The size is not that of the breakpoints.
    """
    lengths = _index_lengths(case, field)
    shape = [*array.shape, *[1] * (len(field.axes) - array.ndim)]
    # A vector has two indices in MATLAB.
    if array.ndim == 2 and len(field.axes) == 1 and shape[1] == 1:
        shape = shape[:1]
    for axis, size in zip(field.axes, shape):
        allowed = {max(lengths.get(axis, size), 1)}
        if axis in ("grndht", "delta"):
            allowed.add(1)
        if size not in allowed or len(shape) != len(field.axes):
            expected = " x ".join(_axis_text(name, lengths) for name in field.axes)
            if axis == "grndht":
                expected += "; how the breakpoints of free air are stored is not known"
            problem = f"{field.name} of size {' x '.join(map(str, array.shape))}"
            raise case.error(problem, expected)
    return array.reshape(shape, order="F")


def _index_lengths(case: CaseStructure, field: Field) -> dict[str, int]:
    """Return the expected length of each index of a field, as far as the breakpoints give it."""
    deltas = len(case.deltas)
    if field.leaf in ("asyflp", "spoiler"):
        deltas = int(case.number_of("ndelta", 0))
    build = 1
    if case.number_of("build", 1) == len(BUILD):
        build = len(BUILD)
    return {
        "alpha": len(case.alphas),
        "mach": len(case.machs),
        "alt": len(case.alts),
        "grndht": len(case.heights),
        "delta": deltas,
        "build": build,
    }


def _axis_text(name: str, lengths: dict[str, int]) -> str:
    if name in lengths:
        return f"{name} {lengths[name]}"
    return name


def _fill_constant(case: CaseStructure, values: np.ndarray, flags: np.ndarray) -> None:
    """Fill columns, the second index, that have a number in the first row only.

    At transonic Mach numbers the first row is the value at zero lift and is not filled down.
    """
    low, high = case.number_of("stmach", 0.6), case.number_of("tsmach", 1.4)
    for k, (i, _) in enumerate(case.grid_indices):
        if case.machs and low < case.machs[i] < high:
            continue
        first = flags[k, :1] == OK
        below = (flags[k, 1:] == ABSENT).all(axis=0, keepdims=True)
        fill = np.broadcast_to(first & below, flags[k, 1:].shape)
        values[k, 1:] = np.where(fill, values[k, :1], values[k, 1:])
        flags[k, 1:] = np.where(fill, FILLED, flags[k, 1:])


# Leaves of many fields.


def _make_leaf(case: CaseStructure, leaf: str, parts: list[_MatlabField]) -> xr.Dataset:
    """Return a leaf of its fields."""
    conditions = list(range(len(case.grid_indices)))
    if leaf in _OWN_CONDITIONS:
        conditions = _printed_conditions(conditions, parts)
    selected = []
    for part in parts:
        values, flags = part.values[conditions], part.flags[conditions]
        selected.append(part._replace(values=values, flags=flags))
    builder = LeafBuilder(_condition_coords(case, conditions, leaf))
    for name in dict.fromkeys(part.field.quantity for part in selected):
        alike = [part for part in selected if part.field.quantity == name]
        if alike[0].field.coordinate:
            builder.coords[name] = _make_coordinate(alike[0])
        else:
            _add_variable(builder, alike, selected)
    dataset = builder.to_dataset()
    axes = {}
    for axis, size in dataset.sizes.items():
        points = _axis_points(case, str(axis), size, leaf=leaf)
        if points is not None:
            axes[axis] = points
    return _tidy_leaf(case, dataset.assign_coords(axes), leaf)


def _printed_conditions(conditions: list[int], parts: list[_MatlabField]) -> list[int]:
    """Return the conditions that have a number in some field."""
    printed = []
    for k in conditions:
        if any((part.flags[k] != ABSENT).any() for part in parts):
            printed.append(k)
    return printed


def _condition_coords(
    case: CaseStructure, conditions: list[int], leaf: str
) -> dict[str, xr.Variable]:
    """Return Mach number and altitude of some conditions."""
    indices = [case.grid_indices[k] for k in conditions]
    machs, heights = [np.nan] * len(indices), [np.nan] * len(indices)
    if case.machs:
        machs = [case.machs[i] for i, _ in indices]
    # The fields of a hypersonic flap have no index of altitude.
    if case.alts and (leaf != "hypersonic" or len(case.alts) == 1):
        unit = case.units.factor("length")
        heights = [case.alts[j] * unit for _, j in indices]
    return {
        "condition": xr.Variable("condition", np.arange(len(conditions))),
        "mach": xr.Variable("condition", machs, {"units": "1"}),
        "h": xr.Variable("condition", heights, {"units": "m"}),
    }


def _axis_points(case: CaseStructure, axis: str, size: int, *, leaf: str) -> tuple[Any, ...] | None:
    """Return a coordinate as dimension, values, attributes; None for an axis without one."""
    if axis == "alpha":
        attrs = {"units": "rad", "sign": "ANU", "long_name": "angle of attack"}
        return axis, np.array(case.alphas) * DEGREE, attrs
    if axis == "ground_height":
        heights = np.array(case.heights or [np.inf]) * case.units.factor("length")
        if len(heights) != size:
            heights = np.full(size, np.inf)
        return axis, heights, {"units": "m"}
    if axis == "configuration" and leaf in _BY_CONFIGURATION:
        return axis, _configuration_names(case, size)
    if axis in ("delta", "delta_e", "delta_f"):
        deltas = [0.0] * size
        if len(case.deltas) == size:
            deltas = case.deltas
        return axis, np.array(deltas) * DEGREE, {"units": "rad"}
    if axis in ("delta_pair", "deflection", *INDEX_DIMENSIONS.values()):
        return axis, np.arange(size)
    return None


def _configuration_names(case: CaseStructure, size: int) -> list[str]:
    """Return the printed names along ``build``, or that of the whole aeroplane."""
    if size != len(BUILD):
        return [_whole_aeroplane(case)]
    upright = case.parts & {"vertical", "fin"}
    names = []
    for made_of in BUILD:
        # A vertical tail with other parts is printed with the ventral fin.
        if len(made_of) > 1 and "vertical" in made_of:
            made_of = made_of | upright
        names.append(printed_name(made_of))
    return names


def _whole_aeroplane(case: CaseStructure) -> str:
    """Return the name of the one configuration of a case without a build-up."""
    if case.number_of("lb", 0):
        return LOW_ASPECT_RATIO
    if not case.parts:
        return "not stated"
    return printed_name(case.parts)


def _tidy_leaf(case: CaseStructure, dataset: xr.Dataset, leaf: str) -> xr.Dataset:
    """Return a leaf without absent configurations and without indices of length one.

    The dimensions ``condition`` and ``alpha`` always stay.
    """
    if leaf == "asyflp":
        for name, field in (("delta_left", "deltal"), ("delta_right", "deltar")):
            deltas = case.numbers(field)
            if len(deltas) == dataset.sizes["delta_pair"]:
                attrs = {"units": "rad", "sign": "TED"}
                dataset[name] = ("delta_pair", np.array(deltas) * DEGREE, attrs)
                dataset = dataset.set_coords(name)
    if leaf not in _BY_CONFIGURATION:
        return dataset
    present = np.zeros(dataset.sizes["configuration"], bool)
    for key in dataset.data_vars:
        if str(key).endswith("_flag"):
            flag = dataset[key] != ABSENT
            inner_dims = [dim for dim in flag.dims if dim != "configuration"]
            present |= flag.any(inner_dims).values
    dataset = dataset.isel(configuration=np.flatnonzero(present))
    single = []
    for dim in ("configuration", "ground_height", case.device):
        if dataset.sizes.get(dim) == 1:
            single.append(dim)
    dataset = dataset.squeeze(single)
    if not case.deltas:
        dataset = dataset.drop_vars(case.device, errors="ignore")
    return dataset


def _make_coordinate(part: _MatlabField) -> xr.Variable:
    """Return a coordinate that is the same for all conditions, or one over condition and time."""
    if part.field.units == "text":
        return xr.Variable(("condition", *part.dims), part.values)
    # The first condition that has the field gives the values.
    has_number = [bool((flags != ABSENT).any()) for flags in part.flags]
    units = "1"
    if part.field.quantity == "time":
        units = "s"
    return xr.Variable(part.dims, part.values[has_number.index(True)], {"units": units})


def _add_variable(
    builder: LeafBuilder, alike: Sequence[_MatlabField], parts: Sequence[_MatlabField]
) -> None:
    """Add a variable: one field, or the fields of several surfaces and panels put together.

    `alike` are the fields of the variable, `parts` all fields of the leaf.
    """
    field, dims = alike[0].field, alike[0].dims
    names = " ".join(part.field.name for part in alike[:2])
    column = PrintedColumn(names, 0, 0, field.quantity, field.units)
    if not field.labels:
        builder.add(column, ("condition", *dims), alike[0].values, alike[0].flags)
        return
    # Labels along each axis: those that some field of the leaf has.
    present = set()
    for part in parts:
        if (part.flags != ABSENT).any():
            present |= set(part.field.labels)
    labels = {}
    for axis, _ in field.labels:
        labels[axis] = [label for label in LABELS[axis] if (axis, label) in present]
    sizes = [len(names_of_axis) for names_of_axis in labels.values()]
    first = alike[0].values
    values, flags = empty_cells((len(first), *sizes, *first.shape[1:]))
    for part in alike:
        if not present.issuperset(part.field.labels):
            continue
        index: list[Any] = [labels[axis].index(label) for axis, label in part.field.labels]
        values[(slice(None), *index)] = part.values
        flags[(slice(None), *index)] = part.flags
    builder.add(column, ("condition", *labels, *dims), values, flags)
    for axis, names_of_axis in labels.items():
        builder.coords[axis] = xr.Variable(axis, names_of_axis)
