"""Validity envelope of a database: its region tables, their joint look-up and their bytes.

The region of a state is the worst of all tables: those of the evidence (`evidence`) and those of
the terms of the six coefficients (`term_regions`).  Hinge moments are left out, since a model whose
surfaces are driven does not use them.
"""

from __future__ import annotations

import struct
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from itertools import chain
from typing import Any

import numpy as np
import xarray as xr

from flightmech import terms as _terms
from flightmech.aircraft.controls import ICE
from flightmech.build_up import COEFFICIENTS
from flightmech.envelope.evidence import evidence_tables
from flightmech.envelope.regions import (
    A_PRIORI,
    RegionTable,
    axis_name,
    join_tables,
    shrink_table,
)
from flightmech.envelope.term_regions import term_region_table
from flightmech.errors import UnknownName
from flightmech.flown_states import CONFIGURATION, FLOWN_STATES, FlownStates, unpack_states
from flightmech.names import ATTACHED_FLOW
from flightmech.short_text import ShortText

_MOST_GROWTH = 1.5  # of the cells of two tables by joining them
_REGION_BITS = 2  # of the byte of a cell; the code of the axis is above them


@dataclass(frozen=True)
class Envelope(ShortText):
    """Validity envelope of a model.

    Attributes
    ----------
    tables : tuple of RegionTable
        The region of a state is the worst of all of them.
    states : FlownStates or None
        The evidence; None for a database that does not keep it, and for an envelope of a model.
    everywhere : tuple of str
        Terms that are a-priori at every state, such as a constant of a handbook: with one of them
        no state is better.  Empty for an envelope of a model, which has no names of terms.
    """

    tables: tuple[RegionTable, ...]
    states: FlownStates | None = None
    everywhere: tuple[str, ...] = ()

    @property
    def axes(self) -> tuple[str, ...]:
        """Variables that the tables need."""
        return tuple(dict.fromkeys(chain.from_iterable(table.axes for table in self.tables)))

    def look_up(self, states: Mapping[str, Any]) -> tuple[np.ndarray, np.ndarray]:
        """Return the region and the code of the axis that leaves, at states.

        Parameters
        ----------
        states : mapping of str to array
            The variables of `axes`, broadcast against each other; a missing one of
            `flightmech.flown_states.CONFIGURATION` and the setting of the ice count as zero, one of
            the flow separation as attached flow. [SI]

        Returns
        -------
        regions, axes : array
            Codes of `flightmech.envelope.regions`: `REGIONS` and `axis_name`.

        Raises
        ------
        UnknownName
            Another variable is missing.
        """
        usual = {**dict.fromkeys((*CONFIGURATION, ICE), 0.0), **ATTACHED_FLOW}
        full: dict[str, Any] = {name: usual[name] for name in usual if name not in states}
        for name in self.axes:
            if name in states:
                full[name] = np.asarray(states[name], dtype=float)
            elif name not in full:
                raise UnknownName(name, map(str, states), "variable of the envelope")
        shape = np.broadcast_shapes(*(np.shape(item) for item in states.values()))
        regions, leaving = np.zeros(shape, np.uint8), np.zeros(shape, np.uint8)
        for table in self.tables:
            own, axis = table.look_up(full)
            # the first table with the worst region names the axis, if it knows one
            is_worse = (own > regions) | ((own == regions) & (own > 0) & (leaving == 0))
            leaving = np.where(is_worse, axis, leaving)
            regions = np.maximum(regions, own)
        return regions, leaving

    def leaving_names(self, codes: np.ndarray) -> list[str]:
        """Return the names of axis codes in their order, the most frequent first."""
        present, counts = np.unique(codes[codes > 0], return_counts=True)
        return [axis_name(int(present[k])) for k in np.argsort(-counts, kind="stable")]


def make_envelope(db: xr.DataTree) -> Envelope:
    """Return the validity envelope of a database.

    Parameters
    ----------
    db : DataTree
        With ``source`` and ``stderr`` of its nodes.  Without the root attribute `FLOWN_STATES` the
        regions rest on the nodes alone.
    """
    states = unpack_states(str(db.attrs.get(FLOWN_STATES, "")))
    tables: list[RegionTable] = []
    variables: set[str] = set()
    everywhere: list[str] = []
    for coefficient in COEFFICIENTS:
        if coefficient not in db.children:
            continue
        for contribution in sorted(db[coefficient].children):
            leaf = db[coefficient][contribution].to_dataset()
            variables |= _terms.list_model_variables(leaf)
            name = f"{coefficient}/{contribution}"
            table = term_region_table(name, leaf, states)
            if table is None:
                continue
            tables.append(table)
            if table.regions.min() >= A_PRIORI:
                everywhere.append(name)
    if states is not None:
        tables = [*evidence_tables(states, variables), *tables]
    return Envelope(tuple(_join_all(tables)), states, tuple(everywhere))


def _join_all(tables: Sequence[RegionTable]) -> list[RegionTable]:
    """Return fewer tables with the same look-up: a table joins one that has all its axes."""
    joined: list[RegionTable] = []
    for table in sorted(tables, key=lambda own: -len(own.axes)):
        for k, host in enumerate(joined):
            if not set(table.axes) <= set(host.axes):
                continue
            both = shrink_table(join_tables(host, table))
            if both.regions.size <= _MOST_GROWTH * (host.regions.size + table.regions.size):
                joined[k] = both
                break
        else:
            joined.append(table)
    return joined


def pack_envelope(envelope: Envelope, variables: Sequence[str]) -> bytes:
    """Return the tables as the section of a model block.

    Parameters
    ----------
    envelope : Envelope
    variables : sequence of str
        Variables of the model, which hold all axes.

    Notes
    -----
    The section has the number of tables, then each table: the number of axes, and for each axis its
    variable and its number of edges (all uint32); the edges (float64) from a multiple of 8 on; one
    byte for each cell, region + 4 x axis, last axis fastest, up to a multiple of 8.
    """
    data = struct.pack("<2I", len(envelope.tables), 0)
    for table in envelope.tables:
        head = struct.pack("<I", len(table.axes))
        for name, edges in zip(table.axes, table.edges, strict=True):
            head += struct.pack("<2I", variables.index(name), len(edges))
        data += head + bytes(-len(head) % 8)
        for edges in table.edges:
            data += np.asarray(edges, "<f8").tobytes()
        cells = (table.regions + (table.leaving << _REGION_BITS)).astype(np.uint8).tobytes()
        data += cells + bytes(-len(cells) % 8)
    return data


def unpack_envelope(data: bytes, variables: Sequence[str]) -> Envelope | None:
    """Return the envelope of `pack_envelope`; None for an empty section."""
    if not data:
        return None
    (count, _), place = struct.unpack_from("<2I", data), 8
    tables = []
    for _ in range(count):
        # Per table: rank, (variable, number of edges) per axis, edges, cells; each part fills 8
        # bytes.
        (rank,) = struct.unpack_from("<I", data, place)
        pairs = [struct.unpack_from("<2I", data, place + 4 + 8 * k) for k in range(rank)]
        place += -(-(4 + 8 * rank) // 8) * 8
        edges = []
        for _, size in pairs:
            edges.append(np.frombuffer(data, "<f8", size, place))
            place += 8 * size
        shape = tuple(size + 1 for _, size in pairs)
        cells = np.frombuffer(data, np.uint8, int(np.prod(shape)), place).reshape(shape)
        place += -(-cells.size // 8) * 8
        names = tuple(variables[variable] for variable, _ in pairs)
        # A cell has its region in the low bits, and the code of the axis above them.
        regions = cells & ((1 << _REGION_BITS) - 1)
        tables.append(RegionTable(names, tuple(edges), regions, cells >> _REGION_BITS))
    return Envelope(tuple(tables))
