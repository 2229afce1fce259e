"""Files of trees: the layout of a database file as netCDF-4, written and read with h5py.

Groups are the nodes of the tree, dimension scales are the breakpoints, and attributes are texts and
numbers. The content of a file is formed in memory, in the HDF5 1.8 format that netCDF and MATLAB
read.
"""

from __future__ import annotations

import io
import itertools
from collections.abc import Iterator, Mapping
from contextlib import suppress
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

import h5py
import numpy as np

from flightmech.errors import SchemaError
from flightmech.support.array_files.labelled_arrays import make_dataset, make_variable
from flightmech.support.hdf5_seal import MOST_GROUPS, find_false_scale

if TYPE_CHECKING:
    import xarray as xr

# group of the check cases of a file
CHECKS = "checks"
# group of terms before an edit: /previous/e001/CL/gear is the term before edit 1
PREVIOUS = "previous"
# groups that are not coefficients, whose leaves are not terms of the model
GROUPS = (CHECKS, PREVIOUS)
# greatest depth of nested groups
_DEPTH = 20
# Greatest size of one table [byte], far above any aero table. A damaged or malicious size is an
# error before memory is allocated.
LARGEST = 2**27
# Greatest size of all tables together [byte]. A small file can state many tables of zeros.
LARGEST_TOTAL = 4 * LARGEST
# kinds of NumPy types: signed and unsigned integers, floating-point numbers
NUMBERS = "iuf"
_FORMAT = ("v108", "v108")
# attribute of netCDF with the number of a dimension
_DIMENSION = "_Netcdf4Dimid"
# attribute of xarray with the coordinates of a group that are not dimensions
_COORDINATES = "coordinates"
# attributes of HDF5 and netCDF that describe the layout
_HDF5 = ("CLASS", "NAME", "DIMENSION_LIST", "REFERENCE_LIST", "DIMENSION_LABELS")
LAYOUT = frozenset((*_HDF5, _DIMENSION, "_Netcdf4Coordinates", "_NCProperties", "_FillValue"))
PACKED = ("scale_factor", "add_offset", "missing_value")


def find_unstorable(db: xr.DataTree) -> list[str]:
    """Return the parts of a tree that a file cannot store, as texts.

    If the list is empty, writing and reading give the same tree.
    """
    problems = []
    for node in db.subtree:
        path = node.path.strip("/") or "root"
        problems += [f"{path}: {text}" for text in _check_node(node)]
    return problems


def _check_node(node: xr.DataTree) -> Iterator[str]:
    leaf = node.to_dataset(inherit=False)
    for name, variable in leaf.variables.items():
        if variable.dtype.kind not in NUMBERS:
            yield f"{name} holds {variable.dtype}; a file holds numbers"
        for axis in variable.dims:
            if axis not in node.coords:
                yield f"{name} has the dimension {axis} without a coordinate; give it one"
    yield from _check_attributes(leaf.attrs, "")
    for name, variable in leaf.variables.items():
        yield from _check_attributes(variable.attrs, f" of {name}")


def _check_attributes(attributes: Mapping[str, Any], owner: str) -> Iterator[str]:
    for key, item in attributes.items():
        is_number = isinstance(item, int | float | np.integer | np.floating)
        # bool is a subclass of int, but netCDF has no attribute of this type
        if isinstance(item, bool) or not (isinstance(item, str) or is_number):
            yield (
                f"attribute {key}{owner} is a {type(item).__name__}; only text and numbers survive "
                f"in a file"
            )
        elif isinstance(item, str) and not _is_storable(item):
            yield (
                f"attribute {key}{owner} holds a character that no file can carry (zero byte or "
                f"half a surrogate pair)"
            )
        elif not _is_free_name(key):
            yield (
                f"attribute {key!r}{owner} has a name that the file format keeps for itself; "
                f"rename it"
            )


def _is_free_name(key: Any) -> bool:
    """Return whether an attribute can have this name."""
    if not isinstance(key, str) or not key or not _is_storable(key):
        return False
    return key not in LAYOUT and key != _COORDINATES


def _is_storable(text: str) -> bool:
    """Return whether HDF5 can store a text: no zero byte, no half of a surrogate pair."""
    try:
        text.encode()
    except UnicodeEncodeError:
        return False
    return "\0" not in text


def encode_tree(db: xr.DataTree) -> bytes:
    """Return the content of the file of a tree, without the check of `find_unstorable`.

    The same tree gives the same bytes with the same version of HDF5.
    """
    content = io.BytesIO()
    with h5py.File(content, "w", libver=_FORMAT, track_order=True) as file:
        _write_node(db, file, {}, itertools.count())
    return content.getvalue()


def _write_node(
    node: xr.DataTree, group: h5py.Group, scales: dict[str, h5py.Dataset], numbers: Iterator[int]
) -> None:
    """Write a node and its children. `scales` has the dimension scales of the parents."""
    leaf = node.to_dataset(inherit=False)
    for key, item in leaf.attrs.items():
        group.attrs[key] = item
    further = [str(name) for name in leaf.coords if name not in leaf.dims]
    if further:
        group.attrs[_COORDINATES] = " ".join(further)
    scales = dict(scales)
    # dimension scales first, so that the variables can refer to them
    for name in sorted(map(str, leaf.variables), key=lambda name: name not in leaf.dims):
        variable = leaf.variables[name]
        dataset = group.create_dataset(name, data=variable.values, track_order=True)
        for key, item in variable.attrs.items():
            dataset.attrs[key] = item
        if name in leaf.dims:
            dataset.make_scale(name)
            dataset.attrs.create(_DIMENSION, next(numbers), dtype="i4")
            scales[name] = dataset
        else:
            for dimension, axis in zip(dataset.dims, variable.dims):
                dimension.attach_scale(scales[str(axis)])
    for name, child in node.children.items():
        _write_node(child, group.create_group(str(name), track_order=True), scales, numbers)


@dataclass(frozen=True)
class StoredVariable:
    """A variable of a file: names of its dimensions, numbers and attributes."""

    dims: tuple[str, ...]
    values: np.ndarray
    attrs: dict[str, str | int | float]


class StoredGroup(dict[str, StoredVariable]):
    """A group of a file: its variables by name, and its attributes."""

    def __init__(
        self, variables: Mapping[str, StoredVariable], attrs: dict[str, str | int | float]
    ) -> None:
        super().__init__(variables)
        self.attrs = attrs


def read_netcdf_tree(path: Path, only: str = "") -> tuple[xr.DataTree, list[str]]:
    """Return the tree of a file, and the parts of the file that do not belong into a database.

    Parameters
    ----------
    path : Path
    only : str
        Path of a group, such as ``"CL/basic"``: other groups are not read, except those that
        contain it.

    Returns
    -------
    tree : DataTree
    problems : list of str
        One text for each part that is left out.

    Raises
    ------
    SchemaError
        More groups, or more nested groups, than a database has.
    Exception
        Any type, which HDF5 raises for a damaged file.
    """
    import xarray as xr

    reader = _TreeReader(only)
    with h5py.File(path, "r") as file:
        reader.read_group(file, "/", {})
    nodes = {}
    for group_path, leaf in reader.leaves.items():
        coordinates = str(leaf.attrs.pop(_COORDINATES, "")).split()
        nodes[group_path] = xr.Dataset()
        try:
            present = [name for name in coordinates if name in leaf]
            nodes[group_path] = _to_dataset(leaf).set_coords(present)
        except ValueError as error:
            # lengths along one dimension differ
            reader.problems.append(f"{_join_path(group_path)}: {error}")
    return xr.DataTree.from_dict(nodes), reader.problems


def _to_dataset(leaf: StoredGroup) -> xr.Dataset:
    """Return a group as a Dataset."""
    axes, tables = {}, {}
    for name, item in leaf.items():
        variable = make_variable(item.dims, item.values, item.attrs)
        # pandas has no index of half-precision numbers
        if item.dims == (name,) and item.values.dtype != np.float16:
            axes[name] = variable
        else:
            tables[name] = variable
    return make_dataset(tables, axes, leaf.attrs)


class _TreeReader:
    """Reader of the groups of a file. Parts that are not tables of a tree become problems.

    `only` is as in `read_netcdf_tree`.
    """

    def __init__(self, only: str) -> None:
        self._only = f"/{only}/" if only else "/"
        self.leaves: dict[str, StoredGroup] = {}
        self.problems: list[str] = []
        # addresses of the groups
        self._addresses: set[int] = set()
        # of the tables that were read [byte]
        self._size = 0

    def read_group(self, group: h5py.Group, path: str, axes: Mapping[int, str]) -> None:
        """Read a group and the groups inside.

        `axes` has the names of the dimension scales of the parents, by their address in the file.
        """
        if path.count("/") > _DEPTH:
            raise SchemaError(
                "database",
                [
                    f"groups inside each other more than {_DEPTH} deep, {path[:40]!r} ...; a "
                    f"term stands two levels down"
                ],
            )
        self._addresses.add(_address(group))
        tables, groups = self._list_items(group, path)
        axes = dict(axes)
        for name, item in tables.items():
            if item.is_scale:
                axes[_address(item)] = name
        variables = {}
        for name, item in tables.items():
            if item.is_scale and _is_bare(item):
                continue
            variable = self._read_variable(item, name, _join_path(path, name), axes)
            if variable is not None:
                variables[name] = variable
        attributes = self._read_attributes(group, _join_path(path))
        self.leaves[path] = StoredGroup(variables, attributes)
        for name, item in groups.items():
            group_path = f"{path.rstrip('/')}/{name}"
            if self._is_requested(f"{group_path}/"):
                self.read_group(item, group_path, axes)

    def _is_requested(self, path: str) -> bool:
        """Return whether a group contains the requested one, or lies inside it."""
        return self._only.startswith(path) or path.startswith(self._only)

    def _list_items(
        self, group: h5py.Group, path: str
    ) -> tuple[dict[str, h5py.Dataset], dict[str, h5py.Group]]:
        """Return the datasets and the groups inside a group, by name."""
        tables, groups = {}, {}
        for name in _item_names(group):
            item_path = _join_path(path, name)
            if not isinstance(group.get(name, getlink=True), h5py.HardLink):
                self.problems.append(
                    f"{item_path} is a link to another place; a database holds its tables itself"
                )
                continue
            item = group[name]
            if isinstance(item, h5py.Group):
                if len(self._addresses) > MOST_GROUPS:
                    text = f"more than {MOST_GROUPS} groups; a database has some hundred"
                    raise SchemaError("database", [text])
                if _address(item) in self._addresses:
                    self.problems.append(
                        f"{item_path}: linked to more than once; a database holds each group once"
                    )
                    continue
                self._addresses.add(_address(item))
                groups[name] = item
            elif isinstance(item, h5py.Dataset):
                if fault := find_false_scale(item.id):
                    self.problems.append(f"{item_path} has {fault}")
                    continue
                tables[name] = item
            else:
                self.problems.append(
                    f"{item_path} is a named type of HDF5; a database holds tables"
                )
        return tables, groups

    def _read_variable(
        self, item: h5py.Dataset, name: str, path: str, axes: Mapping[int, str]
    ) -> StoredVariable | None:
        """Return a variable, None if it has problems."""
        count = len(self.problems)
        self._check_storage(item, path)
        dims = self._read_dimensions(item, name, path, axes)
        attributes = self._read_attributes(item, path)
        for key in PACKED:
            if key in attributes:
                self.problems.append(
                    f"{path} is packed (attribute {key}); unpack the numbers before you write them"
                )
        # only now the numbers are read, which a damaged size would make impossible
        if len(self.problems) > count:
            return None
        self._size += item.nbytes
        if self._size > LARGEST_TOTAL:
            text = f"more than {LARGEST_TOTAL // 2**20} MiB of tables; a database has a few"
            raise SchemaError("database", [text])
        numbers = item[()]
        values = np.asarray(numbers, numbers.dtype.newbyteorder("="))
        return StoredVariable(tuple(dims), values, attributes)

    def _check_storage(self, item: h5py.Dataset, path: str) -> None:
        if item.dtype.kind not in NUMBERS:
            kind = "objects or texts" if item.dtype.kind == "O" else item.dtype
            self.problems.append(f"{path} holds {kind}; tables hold numbers")
        elif item.size is None or item.nbytes > LARGEST:
            self.problems.append(
                f"{path} has the shape {item.shape}; a table has at most {LARGEST // 2**20} MiB"
            )
        if item.is_virtual or item.external:
            self.problems.append(
                f"{path} keeps its numbers in another file; a database holds its tables itself"
            )

    def _read_dimensions(
        self, item: h5py.Dataset, name: str, path: str, axes: Mapping[int, str]
    ) -> list[str]:
        # a dimension scale is its own axis
        if item.is_scale and item.ndim == 1:
            return [name]
        dims = []
        for number, dimension in enumerate(item.dims, 1):
            axis = axes.get(_address(dimension[0])) if len(dimension) else None
            if axis is None:
                self.problems.append(
                    f"{path}: dimension {number} has no name; attach the dimension scale of "
                    f"its axis"
                )
            else:
                dims.append(axis)
        return dims

    def _read_attributes(
        self, owner: h5py.Group | h5py.Dataset, path: str
    ) -> dict[str, str | int | float]:
        attributes = {}
        for key in owner.attrs:
            if key in LAYOUT:
                continue
            item = _to_attribute(owner.attrs[key])
            if item is None:
                self.problems.append(f"{path}: attribute {key} is neither a text nor a number")
            else:
                attributes[key] = item
        return attributes


def _is_bare(scale: h5py.Dataset) -> bool:
    """Return whether a dimension scale is a dimension without coordinates.

    netCDF writes it as a variable with this name.
    """
    name = bytes(h5py.h5ds.get_scale_name(scale.id))
    return name.startswith(b"This is a netCDF dimension but not a netCDF variable")


def _item_names(group: h5py.Group) -> list[str]:
    """Return the names of the items of a group, in the order of writing if the file has it.

    The order of h5py at the root depends on its version.
    """
    names: list[bytes] = []
    try:
        group.id.links.iterate(names.append, idx_type=h5py.h5.INDEX_CRT_ORDER)
    except RuntimeError:
        # the file was written without the order
        return list(group)
    return [name.decode() for name in names]


def _to_attribute(item: Any) -> str | int | float | None:
    """Return an attribute as text or number, None if it is neither."""
    # netCDF writes a number as an array of one
    if isinstance(item, np.ndarray) and item.size == 1:
        item = item.reshape(())[()]
    if isinstance(item, bytes):
        with suppress(UnicodeDecodeError):
            return item.decode()
        return None
    if isinstance(item, str):
        return str(item) if _is_storable(item) else None
    if isinstance(item, np.integer | np.floating):
        return item.item()
    return None


def _join_path(path: str, name: str = "") -> str:
    return "/".join(filter(None, (path.strip("/"), name))) or "root"


def _address(item: h5py.Dataset | h5py.Group) -> int:
    """Return the address of an object in the file.

    The address is used in place of the name, because HDF5 searches all groups for a name.
    """
    return h5py.h5o.get_info(item.id).addr
