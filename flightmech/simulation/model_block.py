"""The packed block: sections and records of format 2, little-endian.

A header (magic, format, byte-order word, size, CRC-32), a directory of sections, and the sections,
each at a multiple of 64 bytes.  ``kernel/src/access/block_reader.h`` holds the same records as C
structs.  Tables with identical breakpoints and axis order form a bundle.  Their values at a node
are adjacent.  Tables are never resampled.
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
from flightmech.envelope.envelope import Envelope, pack_envelope
from flightmech.simulation import catalogue, submodels
from flightmech.simulation.kernel import (
    CatalogueEntry,
    list_name_groups,
)
from flightmech.simulation.kernel_library import load_kernel
from flightmech.terms import list_regressors, power_factor

# Force coefficients by axes, in the order of the kernel.
FORCES = {
    "stability": ("CL", "CD", "CY"),
    "wind": ("CL", "CD", "CY"),
    "body": ("CX", "CZ", "CY"),
}
MOMENTS = ("Cl", "Cm", "Cn")
_TABLES = ("K1", "K2", "value")
_MOST_AXES, _MOST_REGRESSORS = 4, 2  # of a table, of a term
_ALIGNMENT = 64  # of the sections [bytes]
_HEADER_SIZE = 32  # magic, format, byte order, size, checksum, number of sections [bytes]
_DIRECTORY_ENTRY_SIZE = 16  # offset and count of a section [bytes]
_CHECKSUM_END = 28  # the checksum covers all bytes from here
_BYTE_ORDER = 0x01020304
_SECTIONS_PLACE = 28  # of the number of sections [bytes]
_ENVELOPE_SECTION = 13  # the last one, which only models with a validity envelope have


class Term(NamedTuple):
    """A term for the block.

    `stage` and `target` are the stage and the number of its target, `level` its level among the
    coefficients (`flightmech.build_up`).
    """

    stage: int
    target: int
    name: str
    leaf: xr.Dataset
    level: int = 0

    def stage_of(self, table: xr.Variable) -> int:
        """Return the stage that evaluates a table.

        If coefficients are axes of the table, that is the stage of the term and its level.
        """
        if set(table.dims) & set(COEFFICIENTS):
            return self.stage + self.level
        return self.stage


class _AxisKey(NamedTuple):
    """Properties of an axis. Axes with equal properties are one axis in the block."""

    stage: int
    name: str
    linear: int
    points: tuple[float, ...]


class _TableNode(NamedTuple):
    """A table of a term, and the term."""

    term: str
    name: str
    values: np.ndarray


def list_table_axes(leaf: xr.Dataset) -> list[str]:
    """Return the axis names of all tables of a leaf."""
    names = []
    for table in _TABLES:
        if table in leaf:
            names += [str(axis) for axis in leaf.variables[table].dims]
    return names


@dataclass
class Packer:
    """Collects the sections of a block."""

    aircraft: Aircraft
    terms: Sequence[Term]
    force_axes: str
    meta: str
    envelope: Envelope | None = None
    strings: dict[str, int] = field(default_factory=dict, init=False)
    text: bytearray = field(default_factory=bytearray, init=False)
    points: list[float] = field(default_factory=list, init=False)

    def __post_init__(self) -> None:
        variables: set[str] = set()
        axes: dict[_AxisKey, None] = {}  # a dict keeps the order and drops duplicates
        for term in self.terms:
            variables |= set(list_table_axes(term.leaf)) | set(list_regressors(term.leaf))
            factor = power_factor(term.leaf)
            if factor:
                variables.add(factor.variable)
            for table in _list_tables(term.leaf).values():
                axes |= dict.fromkeys(_list_axis_keys(term, table))
        if self.envelope is not None:
            variables |= set(self.envelope.axes)
        self.variables = sorted(variables)
        self.axes = sorted(axes, key=lambda axis: axis.stage)
        self.numbers = {axis: number for number, axis in enumerate(self.axes)}

    def pack(self) -> bytes:
        """Return the block."""
        bundles, nodes, slots = self._pack_bundles()
        names = [term.name for term in self.terms]
        powers = {}
        for term in self.terms:
            factor = power_factor(term.leaf)
            if factor:
                powers[term.name] = factor.exponent
        items = self._pack_items()
        # The order of the calls is the order of the texts in the last section.
        sections = [
            (1, self._pack_geometry()),
            self._pack_entries(catalogue.input_rows(self.aircraft)),
            self._pack_entries(catalogue.output_rows(self.aircraft, self._list_items())),
            self._pack_entries(catalogue.parameter_rows(self.aircraft, names, powers)),
            self._pack_entries(catalogue.state_rows(self.aircraft)),
            self._pack_entries(catalogue.variable_rows(self.variables, self.aircraft)),
            (len(self.axes), b"".join([self._pack_axis(axis) for axis in self.axes])),
            (len(self.points), np.array(self.points, "<f8").tobytes()),
            (len(bundles), b"".join(bundles)),
            (len(nodes), np.array(nodes, "<f8").tobytes()),
            (len(self.terms), b"".join([self._pack_term(term, slots) for term in self.terms])),
            (len(items), b"".join(items)),
        ]
        sections.append((len(self.text), bytes(self.text)))
        if self.envelope is not None:
            # a model without an envelope has no such section, and the bytes that it always had
            tables = pack_envelope(self.envelope, self.variables)
            sections.append((len(tables), tables))
        return _join_sections(sections)

    def _list_items(self) -> dict[str, tuple[str, ...]]:
        """Return the items of every group, with the envelope if there is one."""
        items = submodels.submodel_items(self.aircraft)
        if self.envelope is not None:
            items[submodels.envelope.GROUP] = ("",)
        return items

    def _pack_items(self) -> list[bytes]:
        """Return number of the group and name of each item of a submodel."""
        items = self._list_items()
        records = []
        for number, group in enumerate(list_name_groups()):
            for item in items.get(group, ()):
                records.append(struct.pack("<2I", number, self._add_text(item)))
        return records

    def _add_text(self, text: str) -> int:
        """Return the offset of a text, which is stored once and ends with a zero."""
        if text not in self.strings:
            self.strings[text] = len(self.text)
            self.text += text.encode() + b"\0"
        return self.strings[text]

    def _pack_geometry(self) -> bytes:
        craft = self.aircraft
        numbers = (craft.S, craft.cbar, craft.b, craft.x_ref_mac)
        # number of the force axes in the kernel
        axes = list(FORCES).index(self.force_axes)
        offsets = (self._add_text(craft.name), self._add_text(self.meta))
        return struct.pack("<4d4I", *numbers, axes, *offsets, 0)

    def _pack_entries(self, rows: list[CatalogueEntry]) -> tuple[int, bytes]:
        """Return count and records of rows of the catalogue."""
        records = []
        for row in rows:
            offsets = map(self._add_text, row[:4])
            numbers = (row.value, row.low, row.high)
            records.append(struct.pack("<4I3d2I", *offsets, *numbers, row.flags, 0))
        return len(records), b"".join(records)

    def _pack_axis(self, axis: _AxisKey) -> bytes:
        # breakpoints of all axes are in one section
        first = len(self.points)
        self.points += axis.points
        record = (self.variables.index(axis.name), first, len(axis.points), axis.linear, axis.stage)
        return struct.pack("<6I", *record, 0)

    def _pack_bundles(self) -> tuple[list[bytes], list[float], dict[tuple[str, str], int]]:
        """Return the records, the nodes and the slot of each table; slot 0 is the constant 1."""
        # tables by stage and numbers of their axes
        bundles: dict[tuple[int, tuple[int, ...]], list[_TableNode]] = {}
        for term in self.terms:
            for name, table in _list_tables(term.leaf).items():
                numbers = tuple(self.numbers[axis] for axis in _list_axis_keys(term, table))
                key = term.stage_of(table), numbers
                bundles.setdefault(key, []).append(_TableNode(term.name, name, table.values))
        records: list[bytes] = []
        nodes: list[float] = []
        slots: dict[tuple[str, str], int] = {}
        for (stage, numbers), tables in sorted(bundles.items(), key=lambda item: item[0][0]):
            # unused axes are zero
            axes = [*numbers, *[0] * (_MOST_AXES - len(numbers))]
            record = (len(numbers), *axes, len(tables), stage, 0)
            records.append(struct.pack("<8IQ", *record, len(nodes)))
            # nodes (axes..., table): values of all tables at one node are adjacent
            values = np.stack([member.values for member in tables], axis=-1)
            # nodes of the bundle follow those of the bundles before it
            nodes += values.astype(float).ravel().tolist()
            for member in tables:
                slots[member.term, member.name] = len(slots) + 1
        return records, nodes, slots

    def _pack_term(self, term: Term, slots: dict[tuple[str, str], int]) -> bytes:
        """Return the record of a term; variables count from 1, and 0 means none."""
        factors = [self.variables.index(name) + 1 for name in list_regressors(term.leaf)]
        factors += [0] * (_MOST_REGRESSORS - len(factors))
        tables = [slots.get((term.name, name), 0) for name in _TABLES]
        # texts are added in the order of the record
        offsets = (
            self._add_text(term.name),
            self._add_text(str(term.leaf.attrs.get("comment", ""))),
        )
        power, floor = 0, 0.0
        factor = power_factor(term.leaf)
        if factor:
            power, floor = self.variables.index(factor.variable) + 1, factor.floor
        record = (*offsets, *tables, *factors, term.target, power, 0)
        return struct.pack("<10Id", *record, floor)


def _list_tables(leaf: xr.Dataset) -> dict[str, xr.Variable]:
    return {name: leaf.variables[name] for name in _TABLES if name in leaf}


def _list_axis_keys(term: Term, table: xr.Variable) -> list[_AxisKey]:
    """Return the axes of a table of a term."""
    # 1: linear extrapolation beyond the ends, 0: constant
    linear = int(term.leaf.attrs.get("outside", "hold") == "linear")
    stage = term.stage_of(table)
    keys = []
    for axis in table.dims:
        points = tuple(term.leaf.variables[axis].values.astype(float).tolist())
        keys.append(_AxisKey(stage, str(axis), linear, points))
    return keys


def _join_sections(sections: list[tuple[int, bytes]]) -> bytes:
    """Return the block of sections (count of records, bytes)."""
    directory, body = b"", b""
    start = _HEADER_SIZE + _DIRECTORY_ENTRY_SIZE * len(sections)
    for count, data in sections:
        # zeros up to the next multiple of the alignment
        body += bytes(-(start + len(body)) % _ALIGNMENT)
        directory += struct.pack("<2Q", start + len(body), count)
        body += data
    checked = struct.pack("<I", len(sections)) + directory + body
    size = _CHECKSUM_END + len(checked)
    header = struct.pack("<8s2IQ", b"AMKERNEL", load_kernel().am_format(), _BYTE_ORDER, size)
    return header + struct.pack("<I", zlib.crc32(checked)) + checked


def envelope_section(block: bytes) -> bytes:
    """Return the section of the validity envelope of a block; empty without one."""
    (sections,) = struct.unpack_from("<I", block, _SECTIONS_PLACE)
    if sections <= _ENVELOPE_SECTION:
        return b""
    place = _HEADER_SIZE + _DIRECTORY_ENTRY_SIZE * _ENVELOPE_SECTION
    start, count = struct.unpack_from("<2Q", block, place)
    return block[start : start + count]
