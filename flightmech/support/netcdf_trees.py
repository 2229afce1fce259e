"""The layout of a database file: a tree as netCDF-4, written and read through HDF5 itself.

Groups are the nodes of the tree, dimension scales its breakpoints, attributes text and numbers.
The file is laid out in memory, in the HDF5 1.8 format that netCDF and MATLAB read.
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
from flightmech.support.hdf5_seal import MOST_GROUPS

if TYPE_CHECKING:
    import xarray as xr

CHECKS = "checks"  # group of check cases that travel with a file
# group of what edits replaced: /previous/e001/CL/gear is the term as it was before edit 1
PREVIOUS = "previous"
GROUPS = (
    CHECKS,
    PREVIOUS,
)  # groups that are no coefficients; what stands there is no term of the model
_DEPTH = 20  # groups inside each other
LARGEST = (
    2**27
)  # bytes of one table, far above any aero table; a damaged or hostile size is refused before memory is allocated
NUMBERS = "iuf"
_FORMAT = ("v108", "v108")
_DIMENSION = "_Netcdf4Dimid"
# of a group: variables that are coordinates without being a dimension, as xarray writes them
_COORDINATES = "coordinates"
_HDF5 = ("CLASS", "NAME", "DIMENSION_LIST", "REFERENCE_LIST", "DIMENSION_LABELS")
LAYOUT = frozenset((*_HDF5, _DIMENSION, "_Netcdf4Coordinates", "_NCProperties", "_FillValue"))
PACKED = ("scale_factor", "add_offset", "missing_value")


def find_unstorable(db: xr.DataTree) -> list[str]:
    """Return what of a tree no file can hold; an empty list means that writing and reading give the
    same tree.
    """
    return [
        f"{node.path.strip('/') or 'root'}: {text}"
        for node in db.subtree
        for text in _node_faults(node)
    ]


def _node_faults(node: xr.DataTree) -> Iterator[str]:
    leaf = node.to_dataset(inherit=False)
    for name, variable in leaf.variables.items():
        if variable.dtype.kind not in NUMBERS:
            yield f"{name} holds {variable.dtype}; a file holds numbers"
        for axis in variable.dims:
            if axis not in node.coords:
                yield f"{name} has the dimension {axis} without a coordinate; give it one"
    owners: dict[str, Mapping] = {
        "": leaf.attrs,
        **{f" of {name}": variable.attrs for name, variable in leaf.variables.items()},
    }
    for owner, attributes in owners.items():
        for key, item in attributes.items():
            if isinstance(item, bool) or not isinstance(
                item, str | int | float | np.integer | np.floating
            ):
                yield f"attribute {key}{owner} is a {type(item).__name__}; only text and numbers survive in a file"
            elif isinstance(item, str) and not _writable(item):
                yield f"attribute {key}{owner} holds a character that no file can carry (zero byte or half a surrogate pair)"
            elif (
                not isinstance(key, str)
                or not key
                or not _writable(key)
                or key in LAYOUT
                or key == _COORDINATES
            ):
                yield f"attribute {key!r}{owner} has a name that the file format keeps for itself; rename it"


def _writable(text: str) -> bool:
    try:
        text.encode()
    except UnicodeEncodeError:
        return False
    return "\0" not in text


def encode_tree(db: xr.DataTree) -> bytes:
    """Return the content of the file of a tree without `find_unstorable`; the same tree gives the same bytes
    with one version of HDF5.
    """
    content = io.BytesIO()
    with h5py.File(content, "w", libver=_FORMAT, track_order=True) as file:
        _write(db, file, {}, itertools.count())
    return content.getvalue()


def _write(
    node: xr.DataTree, group: h5py.Group, scales: dict[str, h5py.Dataset], numbers: Iterator[int]
) -> None:
    leaf = node.to_dataset(inherit=False)
    for key, item in leaf.attrs.items():
        group.attrs[key] = item
    further = [str(name) for name in leaf.coords if name not in leaf.dims]
    if further:
        group.attrs[_COORDINATES] = " ".join(further)
    scales = dict(scales)
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
            for place, axis in zip(dataset.dims, variable.dims):
                place.attach_scale(scales[str(axis)])
    for name, child in node.children.items():
        _write(child, group.create_group(str(name), track_order=True), scales, numbers)


@dataclass(frozen=True)
class StoredVariable:
    """A variable as it stands in a file: names of its dimensions, numbers, attributes."""

    dims: tuple[str, ...]
    values: np.ndarray
    attrs: dict[str, str | int | float]


class StoredGroup(dict[str, StoredVariable]):
    """A group as it stands in a file: its variables by name and its attributes; what reads a
    Dataset this way, can read a leaf too.
    """

    def __init__(
        self, variables: Mapping[str, StoredVariable], attrs: dict[str, str | int | float]
    ) -> None:
        super().__init__(variables)
        self.attrs = attrs


def read_netcdf_tree(path: Path) -> tuple[xr.DataTree, list[str]]:
    """Return the tree of a file, and what of the file is no part of a database.

    Raises
    ------
    SchemaError
        More groups, or more of them inside each other, than any database has.
    Exception
        Of any kind that HDF5 finds for a damaged file.
    """
    import xarray as xr

    reader = _TreeReader()
    with h5py.File(path, "r") as file:
        reader.group(file, "/", {})
    nodes = {}
    for place, leaf in reader.leaves.items():
        further = str(leaf.attrs.pop(_COORDINATES, "")).split()
        nodes[place] = xr.Dataset()
        try:
            nodes[place] = _dataset(leaf).set_coords([name for name in further if name in leaf])
        except ValueError as error:  # lengths along one dimension differ
            reader.problems.append(f"{_place(place)}: {error}")
    return xr.DataTree.from_dict(nodes), reader.problems


def _dataset(leaf: StoredGroup) -> xr.Dataset:
    """Return a group as a Dataset; without `fastpath` xarray imports dask, where that is installed,
    to look for its arrays.
    """
    import pandas as pd
    import xarray as xr

    axes = {
        name: pd.Index(item.values)
        for name, item in leaf.items()
        if item.dims == (name,) and item.values.dtype != np.float16
    }
    indexes = {name: xr.indexes.PandasIndex(axis, name) for name, axis in axes.items()}
    points = {
        name: xr.IndexVariable(name, axis, leaf[name].attrs, fastpath=True)
        for name, axis in axes.items()
    }
    tables = {
        name: xr.Variable(item.dims, item.values, item.attrs, fastpath=True)
        for name, item in leaf.items()
        if name not in axes
    }
    return xr.Dataset(tables, xr.Coordinates(points, indexes), leaf.attrs)


class _TreeReader:
    """Walks through a file; whatever is no part of a tree of tables becomes a problem with its
    place.
    """

    def __init__(self) -> None:
        self.leaves: dict[str, StoredGroup] = {}
        self.problems: list[str] = []
        self._seen: set[int] = set()

    def group(self, group: h5py.Group, path: str, axes: Mapping[int, str]) -> None:
        """Read one group and those in it; `axes` names dimension scales by their address in the
        file.
        """
        if path.count("/") > _DEPTH:
            raise SchemaError(
                "database",
                [
                    f"groups inside each other more than {_DEPTH} deep, {path[:40]!r} ...; a "
                    f"term stands two levels down"
                ],
            )
        self._seen.add(_address(group))
        tables, below = {}, []
        for name in _names(group):
            if not isinstance(group.get(name, getlink=True), h5py.HardLink):
                self.problems.append(
                    f"{_place(path, name)} is a link to another place; a database holds its "
                    f"tables itself"
                )
                continue
            item = group[name]
            if isinstance(item, h5py.Group):
                if len(self._seen) > MOST_GROUPS:
                    raise SchemaError(
                        "database", [f"more than {MOST_GROUPS} groups; a database has some hundred"]
                    )
                if _address(item) in self._seen:
                    self.problems.append(
                        f"{_place(path, name)}: linked to more than once; a database holds "
                        f"each group once"
                    )
                    continue
                self._seen.add(_address(item))
                below.append((name, item))
            elif isinstance(item, h5py.Dataset):
                tables[name] = item
            else:
                self.problems.append(
                    f"{_place(path, name)} is a named type of HDF5; a database holds tables"
                )
        axes = {**axes, **{_address(item): name for name, item in tables.items() if item.is_scale}}
        tables = {
            name: item for name, item in tables.items() if not (item.is_scale and _is_bare(item))
        }
        read = {
            name: self._variable(item, name, _place(path, name), axes)
            for name, item in tables.items()
        }
        found = {name: variable for name, variable in read.items() if variable is not None}
        self.leaves[path] = StoredGroup(found, self._attributes(group, _place(path)))
        for name, item in below:
            self.group(item, f"{path.rstrip('/')}/{name}", axes)

    def _variable(
        self, item: h5py.Dataset, name: str, place: str, axes: Mapping[int, str]
    ) -> StoredVariable | None:
        before = len(self.problems)
        if item.dtype.kind not in NUMBERS:
            self.problems.append(
                f"{place} holds "
                f"{'objects or texts' if item.dtype.kind == 'O' else item.dtype}; tables "
                f"hold numbers"
            )
        elif item.size is None or item.nbytes > LARGEST:
            self.problems.append(
                f"{place} has the shape {item.shape}; a table has at most {LARGEST // 2**20} MiB"
            )
        if item.is_virtual or item.external:
            self.problems.append(
                f"{place} keeps its numbers in another file; a database holds its tables itself"
            )
        dims: list[str] = [name] if item.is_scale and item.ndim == 1 else []
        for number, dimension in enumerate(item.dims if not dims else (), 1):
            axis = axes.get(_address(dimension[0])) if len(dimension) else None
            if axis is None:
                self.problems.append(
                    f"{place}: dimension {number} has no name; attach the dimension scale of "
                    f"its axis"
                )
            else:
                dims.append(axis)
        attributes = self._attributes(item, place)
        for key in PACKED:
            if key in attributes:
                self.problems.append(
                    f"{place} is packed (attribute {key}); unpack the numbers before you write them"
                )
        if len(self.problems) > before:
            return None
        numbers = item[()]
        return StoredVariable(
            tuple(dims), np.asarray(numbers, numbers.dtype.newbyteorder("=")), attributes
        )

    def _attributes(
        self, owner: h5py.Group | h5py.Dataset, place: str
    ) -> dict[str, str | int | float]:
        found = {}
        for key in owner.attrs:
            if key in LAYOUT:
                continue
            plain = _plain(owner.attrs[key])
            if plain is None:
                self.problems.append(f"{place}: attribute {key} is neither a text nor a number")
            else:
                found[key] = plain
        return found


def _is_bare(scale: h5py.Dataset) -> bool:
    """Whether a dimension scale is a dimension without coordinates, which netCDF writes as a
    variable of this name.
    """
    return bytes(h5py.h5ds.get_scale_name(scale.id)).startswith(
        b"This is a netCDF dimension but not a netCDF variable"
    )


def _names(group: h5py.Group) -> list[str]:
    """Return what is in a group, in the order in which it was written if the file records it; older
    h5py has another order at the root.
    """
    names: list[bytes] = []
    try:
        group.id.links.iterate(names.append, idx_type=h5py.h5.INDEX_CRT_ORDER)
    except RuntimeError:  # the program that wrote the file did not keep the order
        return list(group)
    return [name.decode() for name in names]


def _plain(item: Any) -> str | int | float | None:
    """Return an attribute as text or number, None when it is neither; netCDF writes single numbers
    as arrays of one.
    """
    if isinstance(item, np.ndarray) and item.size == 1:
        item = item.reshape(())[()]
    if isinstance(item, bytes):
        with suppress(UnicodeDecodeError):
            return item.decode()
        return None
    if isinstance(item, str):
        return str(item) if _writable(item) else None
    return item.item() if isinstance(item, np.integer | np.floating) else None


def _place(path: str, name: str = "") -> str:
    return "/".join(part for part in (path.strip("/"), name) if part) or "root"


def _address(item: h5py.Dataset | h5py.Group) -> int:
    """Return where an object stands in the file; asking HDF5 for its name takes a search through
    all groups.
    """
    return h5py.h5o.get_info(item.id).addr
