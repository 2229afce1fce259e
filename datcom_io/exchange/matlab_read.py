"""The structure of MATLAB's ``datcomimport`` as a tree: SI, radians, canonical names, flags."""

from __future__ import annotations

import os
from collections.abc import Mapping
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
import xarray as xr

from datcom_io.arrays.conditions import LOW_ASPECT_RATIO, printed_name
from datcom_io.arrays.leaves import LeafBuilder
from datcom_io.cells import ABSENT, FILLED, NDM, OK
from datcom_io.decks.deck import DIMENSIONS
from datcom_io.exchange.matlab_fields import (
    BUILD,
    INDEX_DIMENSIONS,
    LABELS,
    MISSING,
    Field,
    Units,
    field_dimension,
    select_fields,
)
from datcom_io.printout.rows import PrintedColumn
from flightmech.errors import ParseError
from flightmech.support.input_files import read_bytes
from flightmech.support.mat_files import load_mat
from flightmech.units import DEGREE

_FLAGS_OF_CONFIG = {
    "body": "body",
    "wing": "wing",
    "htail": "horizontal",
    "vtail": "vertical",
    "vfin": "fin",
}
_NUMERIC = "fiub"
_LOCAL = ("hypersonic", "jet")  # leaves with conditions of their own


class _MatlabField(NamedTuple):
    """One field along the conditions of the case: dimensions after ``condition``, values in SI,
    flags.
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
    for number, structure in enumerate(_structures(file, content), 1):
        case = _Case(file, number, structure)
        leaves = case.leaves()
        if leaves:
            name = (case.text("case") or f"case {number}").replace("/", "|")
            unique = f"{name} ({number})" if name in root.children else name
            root[unique] = xr.DataTree.from_dict(
                {"/": xr.Dataset(attrs=case.attrs(name)), **leaves}, name=unique
            )
    return root


def _structures(file: str, content: Mapping[str, Any]) -> list[Mapping[str, np.ndarray]]:
    """Return the structures of the one variable that holds them."""
    found = {}
    for name, value in content.items():
        if not isinstance(value, np.ndarray):
            continue
        items = (
            [item for item in value.ravel() if isinstance(item, np.ndarray)]
            if value.dtype.hasobject and not value.dtype.names
            else [value]
        )
        records = [record for item in items if item.dtype.names for record in item.ravel()]
        structures: list[Mapping[str, np.ndarray]] = [
            {str(key): record[key] for key in record.dtype.names} for record in records
        ]
        if structures and all(
            {"mach", "alpha", "dim"} <= structure.keys() for structure in structures
        ):
            found[name] = structures
    if len(found) != 1:
        names = ", ".join(name for name in found or content if not name.startswith("__"))
        expected = (
            "one variable with structures that have the fields mach, alpha and dim, as "
            "datcomimport returns them"
        )
        raise ParseError(file, 0, f"{len(found)} of them among the variables {names}", expected)
    return next(iter(found.values()))


class _Case:
    """One structure with its breakpoints."""

    def __init__(self, file: str, number: int, structure: Mapping[str, np.ndarray]):
        self.file, self.number, self.structure = file, number, structure
        self.machs, self.alts, self.alphas = (
            self.numbers(name) for name in ("mach", "alt", "alpha")
        )
        self.deltas, self.heights = self.numbers("delta"), self.numbers("grndht")
        self.loop, self.style = (
            int(self.number_of(name, default)) for name, default in (("loop", 1), ("stype", 0))
        )
        dim, deriv = self.text("dim").upper(), self.text("deriv").upper()
        if dim not in DIMENSIONS or deriv not in ("DEG", "RAD"):
            raise self.fault(
                f"dim {dim!r} and deriv {deriv!r}",
                f"one of {' '.join(DIMENSIONS)}, and DEG or RAD, in any case",
            )
        self.units = Units(dim, deriv, "psf" if self.alts else "psi")
        self.parts = self._parts()
        self.device = "delta_e" if {"wing", "horizontal"} <= self.parts else "delta_f"
        self.places = self._places()

    def fault(self, found: str, expected: str) -> ParseError:
        """Return an error of this case."""
        return ParseError(self.file, 0, f"case {self.number}: {found}", expected)

    def numbers(self, name: str) -> list[float]:
        """Return a row vector; empty when it is not there."""
        value = self.structure.get(name, np.empty(0))
        return [float(x) for x in np.ravel(value)] if value.dtype.kind in _NUMERIC else []

    def number_of(self, name: str, default: float) -> float:
        """Return a scalar, the default when it is not there or no number."""
        return next((x for x in self.numbers(name)[:1] if np.isfinite(x)), default)

    def text(self, name: str) -> str:
        """Return a text, an empty one when it is not there."""
        value = np.ravel(self.structure.get(name, np.empty(0)))
        return str(value[0]).strip() if value.dtype.kind == "U" and value.size else ""

    def _parts(self) -> frozenset[str]:
        """Return what the aeroplane is made of, by ``config``."""
        config = self.structure.get("config")
        if config is None or not config.dtype.names or not config.size:
            return frozenset()
        names = [
            name
            for name in _FLAGS_OF_CONFIG
            if name in config.dtype.names and np.any(config.ravel()[0][name])
        ]
        return frozenset(_FLAGS_OF_CONFIG[name] for name in names)

    def _places(self) -> list[tuple[int, int]]:
        """Return the indices of Mach number and altitude of each flight condition, in the order of
        the run.
        """
        machs, alts = range(max(len(self.machs), 1)), range(max(len(self.alts), 1))
        if self.loop == 2:
            return [(i, j) for j in alts for i in machs]
        if self.loop == 3:
            return [(i, j) for i in machs for j in alts]
        return [(i, min(i, len(alts) - 1)) for i in machs]

    def attrs(self, name: str) -> dict[str, str | float]:
        """Return the attributes of the case's tree."""
        references = (("S", "sref", "area"), ("cbar", "cbar", "length"), ("b", "blref", "length"))
        found: dict[str, str | float] = {
            quantity: self.numbers(field)[0] * self.units.factor(units)
            for quantity, field, units in references
            if self.numbers(field)
        }
        return {
            **found,
            "dim": self.units.dim,
            "deriv": self.units.deriv,
            "title": self.text("case"),
            "case": name,
            "file": self.file,
        }

    def leaves(self) -> dict[str, xr.Dataset]:
        """Return the leaves of the case."""
        parts: dict[str, list[_MatlabField]] = {}
        for field in select_fields(self.style):
            if (
                field.name == "fc_con"
            ):  # a force in pounds or a coefficient, which the structure does not distinguish
                field = field._replace(quantity="fc_con", units="1")
            part = self._part(field)
            if part is not None:
                parts.setdefault(field.leaf, []).append(part)
        return {
            leaf: self._leaf(leaf, found)
            for leaf, found in parts.items()
            if any((part.flags != ABSENT).any() for part in found)
        }

    def _part(self, field: Field) -> _MatlabField | None:
        array = self.structure.get(field.name)
        if array is None or array.size == 0:
            return None
        others = [axis for axis in field.axes if axis not in ("mach", "alt")]
        if field.units != "text" and array.dtype.kind not in _NUMERIC:
            raise self.fault(f"{field.name} without numbers", "an array of numbers")
        raw = self._with_all_indices(field, array)
        if "alt" not in field.axes:
            raw = np.repeat(raw[..., np.newaxis], max(len(self.alts), 1), axis=-1)
        order = [*field.axes, *(() if "alt" in field.axes else ("alt",))]
        raw = raw.transpose([order.index(axis) for axis in ("mach", "alt", *others)])
        chosen = np.array([raw[place] for place in self.places])
        if field.units == "text":
            words = np.array(
                [str(np.ravel(item)[0]) if np.size(item) else "" for item in chosen.ravel()]
            ).reshape(chosen.shape)
            flags = np.where(words == "", ABSENT, OK).astype(np.uint8)
            return _MatlabField(
                field,
                tuple(field_dimension(field, axis, self.device) for axis in others),
                words,
                flags,
            )
        numbers = chosen.astype(float)
        flags = np.where(numbers == MISSING, ABSENT, np.where(np.isnan(numbers), NDM, OK)).astype(
            np.uint8
        )
        values = np.where(flags == OK, numbers * self.units.factor(field.units), np.nan)
        if field.constant:
            self._fill(values, flags)
        return _MatlabField(
            field,
            tuple(field_dimension(field, axis, self.device) for axis in others),
            values,
            flags,
        )

    def _with_all_indices(self, field: Field, array: np.ndarray) -> np.ndarray:
        """Return an array with the indices that MATLAB has dropped, after a look at its size."""
        lengths = {
            "alpha": len(self.alphas),
            "mach": len(self.machs),
            "alt": len(self.alts),
            "grndht": len(self.heights),
        }
        count = (
            len(self.deltas)
            if field.leaf not in ("asyflp", "spoiler")
            else int(self.number_of("ndelta", 0))
        )
        lengths |= {
            "delta": count,
            "build": len(BUILD) if self.number_of("build", 1) == len(BUILD) else 1,
        }
        shape = [*array.shape, *[1] * (len(field.axes) - array.ndim)]
        if array.ndim == 2 and len(field.axes) == 1 and shape[1] == 1:
            shape = shape[:1]
        for axis, size in zip(field.axes, shape):
            allowed = {max(lengths.get(axis, size), 1)} | (
                {1} if axis in ("grndht", "delta") else set()
            )
            if size not in allowed or len(shape) != len(field.axes):
                wanted = " x ".join(
                    f"{name} {lengths[name]}" if name in lengths else name for name in field.axes
                )
                hint = (
                    "; how the breakpoints of free air are stored is not known"
                    if axis == "grndht"
                    else ""
                )
                raise self.fault(
                    f"{field.name} of size {' x '.join(map(str, array.shape))}", f"{wanted}{hint}"
                )
        return array.reshape(shape, order="F")

    def _fill(self, values: np.ndarray, flags: np.ndarray) -> None:
        """Fill columns, the second index, that have a number in the first row only; none at
        transonic Mach numbers.
        """
        low, high = self.number_of("stmach", 0.6), self.number_of("tsmach", 1.4)
        for k, (i, _) in enumerate(self.places):
            if self.machs and low < self.machs[i] < high:
                continue
            first, below = flags[k, :1] == OK, (flags[k, 1:] == ABSENT).all(axis=0, keepdims=True)
            fill = np.broadcast_to(first & below, flags[k, 1:].shape)
            values[k, 1:] = np.where(fill, values[k, :1], values[k, 1:])
            flags[k, 1:] = np.where(fill, FILLED, flags[k, 1:])

    def _leaf(self, leaf: str, parts: list[_MatlabField]) -> xr.Dataset:
        """Return a leaf of its fields."""
        there = [
            k
            for k in range(len(self.places))
            if any((part.flags[k] != ABSENT).any() for part in parts)
        ]
        chosen = there if leaf in _LOCAL else list(range(len(self.places)))
        parts = [
            part._replace(values=part.values[chosen], flags=part.flags[chosen]) for part in parts
        ]
        made = LeafBuilder(self._conditions(chosen, leaf))
        for name in dict.fromkeys(part.field.quantity for part in parts):
            alike = [part for part in parts if part.field.quantity == name]
            if alike[0].field.coordinate:
                made.coords[name] = _coordinate(alike[0])
            else:
                _add_variable(made, alike, parts)
        found = made.to_dataset()
        axes = {
            axis: points
            for axis in found.dims
            for points in [self._points(str(axis), found.sizes[axis], leaf)]
            if points is not None
        }
        found = found.assign_coords(axes)
        return self._tidied(found, leaf)

    def _conditions(self, chosen: list[int], leaf: str) -> dict[str, xr.Variable]:
        places = [self.places[k] for k in chosen]
        known = self.alts and (leaf != "hypersonic" or len(self.alts) == 1)
        heights = [
            self.alts[j] * self.units.factor("length") if known else np.nan for _, j in places
        ]
        return {
            "condition": xr.Variable("condition", np.arange(len(chosen))),
            "mach": xr.Variable(
                "condition",
                [self.machs[i] if self.machs else np.nan for i, _ in places],
                {"units": "1"},
            ),
            "h": xr.Variable("condition", heights, {"units": "m"}),
        }

    def _points(self, axis: str, size: int, leaf: str) -> tuple | None:
        """Return a coordinate: dimension, values, attributes."""
        if axis == "alpha":
            return (
                axis,
                np.array(self.alphas) * DEGREE,
                {"units": "rad", "sign": "ANU", "long_name": "angle of attack"},
            )
        if axis == "ground_height":
            heights = np.array(self.heights or [np.inf]) * self.units.factor("length")
            return axis, heights if len(heights) == size else np.full(size, np.inf), {"units": "m"}
        if axis == "configuration" and leaf in ("static", "downwash", "dynamic"):
            upright = self.parts & {"vertical", "fin"}
            names = [
                printed_name(
                    made_of if len(made_of) == 1 or "vertical" not in made_of else made_of | upright
                )
                for made_of in BUILD
            ]
            return axis, names if size == len(BUILD) else [self._whole()]
        if axis in ("delta", "delta_e", "delta_f"):
            deltas = self.deltas if len(self.deltas) == size else [0.0] * size
            return axis, np.array(deltas) * DEGREE, {"units": "rad"}
        return (
            (axis, np.arange(size))
            if axis in ("delta_pair", "deflection", *INDEX_DIMENSIONS.values())
            else None
        )

    def _whole(self) -> str:
        """Return the name of the one configuration of a case without a build-up."""
        if self.number_of("lb", 0):
            return LOW_ASPECT_RATIO
        return printed_name(self.parts) if self.parts else "not stated"

    def _tidied(self, found: xr.Dataset, leaf: str) -> xr.Dataset:
        """Return a leaf without configurations that are not there, and without indices of length
        one but condition and alpha.
        """
        if leaf == "asyflp":
            for name, field in (("delta_left", "deltal"), ("delta_right", "deltar")):
                if len(self.numbers(field)) == found.sizes["delta_pair"]:
                    found[name] = (
                        "delta_pair",
                        np.array(self.numbers(field)) * DEGREE,
                        {"units": "rad", "sign": "TED"},
                    )
                    found = found.set_coords(name)
        if leaf in ("static", "downwash", "dynamic"):
            flags = [
                found[name] != ABSENT for name in found.data_vars if str(name).endswith("_flag")
            ]
            there = np.any(
                [
                    flag.any([dim for dim in flag.dims if dim != "configuration"]).values
                    for flag in flags
                ],
                axis=0,
            )
            found = found.isel(configuration=np.flatnonzero(there))
            short = [
                dim
                for dim in ("configuration", "ground_height", self.device)
                if found.sizes.get(dim) == 1
            ]
            found = found.squeeze(short)
            if not self.deltas:
                found = found.drop_vars(self.device, errors="ignore")
        return found


def _coordinate(part: _MatlabField) -> xr.Variable:
    """Return a coordinate that is the same for all conditions, or one over condition and time."""
    if part.field.units == "text":
        return xr.Variable(("condition", *part.dims), part.values)
    k = next(k for k in range(len(part.flags)) if (part.flags[k] != ABSENT).any())
    return xr.Variable(
        part.dims, part.values[k], {"units": "s" if part.field.quantity == "time" else "1"}
    )


def _add_variable(found: LeafBuilder, alike: list[_MatlabField], parts: list[_MatlabField]) -> None:
    """Add a variable: one field, or fields of several surfaces and panels put together."""
    field, dims = alike[0].field, alike[0].dims
    column = PrintedColumn(
        " ".join(part.field.name for part in alike[:2]), 0, 0, field.quantity, field.units
    )
    if not field.at:
        found.add(column, ("condition", *dims), alike[0].values, alike[0].flags)
        return
    axes = [axis for axis, _ in field.at]
    there = {pair for part in parts if (part.flags != ABSENT).any() for pair in part.field.at}
    labels = [[label for label in LABELS[axis] if (axis, label) in there] for axis in axes]
    shape = (len(alike[0].values), *(len(names) for names in labels), *alike[0].values.shape[1:])
    values, flags = np.full(shape, np.nan), np.full(shape, ABSENT, np.uint8)
    for part in alike:
        if all(label in names for (_, label), names in zip(part.field.at, labels)):
            where: tuple[Any, ...] = (
                slice(None),
                *(names.index(label) for (_, label), names in zip(part.field.at, labels)),
            )
            values[where], flags[where] = part.values, part.flags
    found.add(column, ("condition", *axes, *dims), values, flags)
    found.coords |= {axis: xr.Variable(axis, names) for axis, names in zip(axes, labels)}
