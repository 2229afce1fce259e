"""The packed block: sections and records of format 2, little-endian.

A header (magic, format, byte-order word, size, CRC-32), a directory of sections, and the sections,
each at a multiple of 64 bytes.  ``kernel/src/access/block_reader.h`` holds the same records as C
structs.  Tables whose axes have identical breakpoints and order lie side by side (a bundle);
nothing is ever resampled.
"""

from __future__ import annotations

import struct
import zlib
from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import NamedTuple

import numpy as np
import xarray as xr

from flightmech.aircraft.aircraft import Aircraft
from flightmech.build_up import COEFFICIENTS
from flightmech.simulation import catalogue, submodels
from flightmech.simulation.kernel import CatalogueEntry, list_name_groups, load_kernel
from flightmech.terms import list_regressors, power_factor

FORCES = {
    "stability": ("CL", "CD", "CY"),
    "wind": ("CL", "CD", "CY"),
    "body": ("CX", "CZ", "CY"),
}  # in the order of the kernel
MOMENTS = ("Cl", "Cm", "Cn")
_TABLES = ("K1", "K2", "value")


class Term(NamedTuple):
    """A leaf on its way into the block: the stage of its target, the number of its target, its
    name, its level (`flightmech.build_up`).
    """

    stage: int
    target: int
    name: str
    leaf: xr.Dataset
    level: int = 0

    def stage_of(self, table: xr.Variable) -> int:
        """Return the stage that looks up a table: that of the term where coefficients are on its
        axes.
        """
        return self.stage + (self.level if set(table.dims) & set(COEFFICIENTS) else 0)


class _AxisKey(NamedTuple):
    """What makes two axes the same axis."""

    stage: int
    name: str
    linear: int
    points: tuple[float, ...]


def list_table_axes(leaf: xr.Dataset) -> list[str]:
    """Return the axis names of all tables of a leaf."""
    return [str(axis) for table in _TABLES if table in leaf for axis in leaf.variables[table].dims]


@dataclass
class Packer:
    """Collects the sections of a block."""

    aircraft: Aircraft
    terms: Sequence[Term]
    force_axes: str
    meta: str
    strings: dict[str, int] = field(default_factory=dict, init=False)
    text: bytearray = field(default_factory=bytearray, init=False)
    points: list[float] = field(default_factory=list, init=False)

    def __post_init__(self) -> None:
        self.variables = sorted(
            {
                v
                for t in self.terms
                for v in (*list_table_axes(t.leaf), *list_regressors(t.leaf), *_powered(t.leaf))
            }
        )
        found = dict.fromkeys(
            axis for t in self.terms for _, table in _tables(t.leaf) for axis in _axes_of(t, table)
        )
        self.axes = sorted(found, key=lambda axis: axis.stage)
        self.numbers = {axis: number for number, axis in enumerate(self.axes)}

    def pack(self) -> bytes:
        """Return the block."""
        bundles, nodes, slots = self._bundles()
        names = [t.name for t in self.terms]
        powers = {t.name: factor.exponent for t in self.terms if (factor := power_factor(t.leaf))}
        items = self._items()
        sections = [
            (1, self._geometry()),
            self._entries(catalogue.input_rows(self.aircraft)),
            self._entries(catalogue.output_rows(self.aircraft)),
            self._entries(catalogue.parameter_rows(self.aircraft, names, powers)),
            self._entries(catalogue.state_rows(self.aircraft)),
            self._entries(catalogue.variable_rows(self.variables, self.aircraft)),
            (len(self.axes), b"".join(self._axis(axis) for axis in self.axes)),
            (len(self.points), np.array(self.points, "<f8").tobytes()),
            (len(bundles), b"".join(bundles)),
            (len(nodes), np.array(nodes, "<f8").tobytes()),
            (len(self.terms), b"".join(self._term(t, slots) for t in self.terms)),
            (len(items), b"".join(items)),
        ]
        sections.append((len(self.text), bytes(self.text)))
        return _block(sections)

    def _items(self) -> list[bytes]:
        found = submodels.submodel_items(self.aircraft)
        return [
            struct.pack("<2I", number, self._string(item))
            for number, group in enumerate(list_name_groups())
            for item in found.get(group, ())
        ]

    def _string(self, text: str) -> int:
        if text not in self.strings:
            self.strings[text] = len(self.text)
            self.text += text.encode() + b"\0"
        return self.strings[text]

    def _geometry(self) -> bytes:
        a = self.aircraft
        axes = list(FORCES).index(self.force_axes)
        return struct.pack(
            "<4d4I",
            a.S,
            a.cbar,
            a.b,
            a.x_ref_mac,
            axes,
            self._string(a.name),
            self._string(self.meta),
            0,
        )

    def _entries(self, rows: list[CatalogueEntry]) -> tuple[int, bytes]:
        packed = [
            struct.pack(
                "<4I3d2I", *map(self._string, row[:4]), row.value, row.low, row.high, row.flags, 0
            )
            for row in rows
        ]
        return len(packed), b"".join(packed)

    def _axis(self, axis: _AxisKey) -> bytes:
        first = len(self.points)
        self.points += axis.points
        return struct.pack(
            "<6I",
            self.variables.index(axis.name),
            first,
            len(axis.points),
            axis.linear,
            axis.stage,
            0,
        )

    def _bundles(self) -> tuple[list[bytes], list[float], dict[tuple[str, str], int]]:
        """Return the records, the nodes and the slot of each table; slot 0 is the constant 1."""
        members: dict[tuple[int, tuple[int, ...]], list[tuple[str, str, np.ndarray]]] = {}
        for t in self.terms:
            for name, table in _tables(t.leaf):
                members.setdefault(
                    (t.stage_of(table), tuple(self.numbers[axis] for axis in _axes_of(t, table))),
                    [],
                ).append((t.name, name, table.values))
        records: list[bytes] = []
        nodes: list[float] = []
        slots: dict[tuple[str, str], int] = {}
        for (stage, numbers), tables in sorted(members.items(), key=lambda item: item[0][0]):
            records.append(
                struct.pack(
                    "<8IQ",
                    len(numbers),
                    *numbers,
                    *[0] * (4 - len(numbers)),
                    len(tables),
                    stage,
                    0,
                    len(nodes),
                )
            )
            nodes += (
                np.stack([values for *_, values in tables], axis=-1).astype(float).ravel().tolist()
            )
            for term, name, _ in tables:
                slots[term, name] = len(slots) + 1
        return records, nodes, slots

    def _term(self, t: Term, slots: dict[tuple[str, str], int]) -> bytes:
        factors = [self.variables.index(word) + 1 for word in list_regressors(t.leaf)]
        tables = [slots.get((t.name, name), 0) for name in _TABLES]
        text = str(t.leaf.attrs.get("comment", ""))
        factor = power_factor(t.leaf)
        place, floor = (
            (self.variables.index(factor.variable) + 1, factor.floor) if factor else (0, 0.0)
        )
        packed = (
            self._string(t.name),
            self._string(text),
            *tables,
            *factors,
            *[0] * (2 - len(factors)),
            t.target,
            place,
            0,
        )
        return struct.pack("<10Id", *packed, floor)


def _powered(leaf: xr.Dataset) -> list[str]:
    """Return the variable of the power factor, if there is one."""
    factor = power_factor(leaf)
    return [factor.variable] if factor else []


def _tables(leaf: xr.Dataset) -> list[tuple[str, xr.Variable]]:
    return [(name, leaf.variables[name]) for name in _TABLES if name in leaf]


def _axes_of(t: Term, table: xr.Variable) -> list[_AxisKey]:
    linear, points = int(t.leaf.attrs.get("outside", "hold") == "linear"), t.leaf.variables
    return [
        _AxisKey(
            t.stage_of(table), str(axis), linear, tuple(points[axis].values.astype(float).tolist())
        )
        for axis in table.dims
    ]


def _block(sections: list[tuple[int, bytes]]) -> bytes:
    directory, body = b"", b""
    start = 32 + 16 * len(sections)
    for count, data in sections:
        body += bytes(-(start + len(body)) % 64)
        directory += struct.pack("<2Q", start + len(body), count)
        body += data
    checked = struct.pack("<I", len(sections)) + directory + body
    head = struct.pack(
        "<8s2IQ", b"AMKERNEL", load_kernel().am_format(), 0x01020304, 28 + len(checked)
    )
    return head + struct.pack("<I", zlib.crc32(checked)) + checked
