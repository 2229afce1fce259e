"""Aircraft and tree of terms to one immutable block that the kernel flies.

Format 1 of the block, little-endian: a header (magic, format, endian mark, size, CRC-32), a directory of sections, and the
sections, each at a multiple of 64 bytes.  ``kernel/src/pack.c`` holds the same records as C structs.  Tables whose axes
have identical breakpoints and order lie side by side (a bundle); nothing is ever resampled.  The same aircraft and
tree give the same bytes.
"""

from __future__ import annotations

import json
import struct
import zlib
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field
from functools import cached_property
from typing import Any, NamedTuple

import numpy as np
import xarray as xr

from . import catalogue
from .aircraft import Aircraft
from .errors import SchemaError, UnknownName
from .library import AXIS, INPUT, OUTPUT, PARAMETER, TERM, VARIABLE, Entry, Model, library
from .terms import check, regressors

FORCES = {"stability": ("CL", "CD", "CY"), "wind": ("CL", "CD", "CY"), "body": ("CX", "CZ", "CY")}
MOMENTS = ("Cl", "Cm", "Cn")
IMPLICIT = ("alphadothat", "betadothat", "dnz")
_ENGINE_GROUP, _AERO_GROUP = 0, 1
_ENGINE_BASE = 6
_REFERENCE = {"S": "S", "cbar": "cbar", "b": "b"}
_AGREE = 1e-6  # relative: what a unit conversion and a netCDF round trip may change
_NO_COEFFICIENT = ("checks",)  # groups of a database that hold no terms


@dataclass(frozen=True)
class SimModel:
    """A compiled simulation model.

    Parameters
    ----------
    block : bytes
        What the kernel loads; ``resources/model.bin`` of an FMU.
    """

    block: bytes = field(repr=False)

    @cached_property
    def model(self) -> Model:
        """The block loaded into the kernel."""
        return Model(self.block)

    def entries(self, kind: int) -> tuple[Entry, ...]:
        """Return names, units, descriptions, start values and ranges of one kind (`flightmech.library`: INPUT ... AXIS)."""
        return self.model.entries(kind)

    @cached_property
    def inputs(self) -> tuple[str, ...]:
        """Names of the inputs, in the order of the kernel."""
        return _names(self.entries(INPUT))

    @cached_property
    def outputs(self) -> tuple[str, ...]:
        """Names of the outputs."""
        return _names(self.entries(OUTPUT))

    @cached_property
    def parameters(self) -> tuple[str, ...]:
        """Names of the parameters."""
        return _names(self.entries(PARAMETER))

    @cached_property
    def terms(self) -> tuple[str, ...]:
        """Names of the terms, ``CL/basic`` and so on; engine terms first."""
        return _names(self.entries(TERM))

    @cached_property
    def variables(self) -> tuple[str, ...]:
        """Names of the model variables that the tables and terms use."""
        return _names(self.entries(VARIABLE))

    @cached_property
    def axes(self) -> tuple[str, ...]:
        """Names of the table axes; a name appears once per set of breakpoints."""
        return _names(self.entries(AXIS))

    @property
    def title(self) -> str:
        """Name of the aircraft."""
        return self.model.title

    @property
    def meta(self) -> dict[str, Any]:
        """Provenance: force axes, attributes of the database, source of each term."""
        return json.loads(self.model.meta)

    def __getstate__(self) -> dict[str, bytes]:
        return {"block": self.block}

    def __setstate__(self, state: dict[str, bytes]) -> None:
        object.__setattr__(self, "block", state["block"])


def compile(aircraft: Aircraft, db: xr.DataTree) -> SimModel:
    """Compile an aircraft and its database to a simulation model.

    Parameters
    ----------
    aircraft : Aircraft
        Geometry, mass, engines, limits.
    db : DataTree
        Terms at ``/<coefficient>/<contribution>``, as in `flightmech.terms`; root attribute ``force_axes``.

    Raises
    ------
    SchemaError
        With all problems: faults of a term, an axis or regressor that the simulation does not know, a geometry that
        differs from the aircraft's.
    """
    found = list(_collect(aircraft, db))
    problems = _root_problems(aircraft, db)
    problems += [text for _, _, name, leaf in found for text in _leaf_problems(name, leaf, aircraft)]
    if problems:
        raise SchemaError(f"model of {aircraft.name}", problems)
    sim = SimModel(_Packer(aircraft, found, _force_axes(db), _meta(db, found)).pack())
    assert sim.model.count(INPUT) > 0  # the kernel has accepted the block
    return sim


class _Term(NamedTuple):
    group: int
    coefficient: int
    name: str
    leaf: xr.Dataset


def _names(entries: tuple[Entry, ...]) -> tuple[str, ...]:
    return tuple(entry.name for entry in entries)


def _force_axes(db: xr.DataTree) -> str:
    return str(db.attrs.get("force_axes", "stability"))


def _collect(aircraft: Aircraft, db: xr.DataTree) -> Iterator[_Term]:
    for number, engine in enumerate(aircraft.engines):
        if engine.thrust is not None:
            own = {name: f"engine{number + 1}.{name}" for name in ("throttle",)}
            yield _Term(_ENGINE_GROUP, _ENGINE_BASE + number, f"engine{number + 1}/thrust", _renamed(engine.thrust, own))
    for index, coefficient in enumerate((*FORCES.get(_force_axes(db), FORCES["stability"]), *MOMENTS)):
        if coefficient in db.children:
            for contribution in sorted(db[coefficient].children):
                leaf = db[coefficient][contribution].to_dataset()
                yield _Term(_AERO_GROUP, index, f"{coefficient}/{contribution}", leaf)


def _renamed(leaf: xr.Dataset, own: Mapping[str, str]) -> xr.Dataset:
    renamed = leaf.rename({name: new for name, new in own.items() if name in leaf.dims})
    return renamed.assign_attrs(regressors=" ".join(own.get(word, word) for word in regressors(leaf)))


def _root_problems(aircraft: Aircraft, db: xr.DataTree) -> list[str]:
    problems = []
    axes = _force_axes(db)
    if axes not in FORCES:
        problems.append(f"attribute force_axes is {axes!r}; allowed: {', '.join(FORCES)}")
        axes = "stability"
    for name in map(str, db.children):
        if name not in (*FORCES[axes], *MOMENTS, *_NO_COEFFICIENT):
            allowed = ", ".join((*FORCES[axes], *MOMENTS))
            problems.append(f"/{name} is no coefficient; with force_axes {axes} there are {allowed}")
    for name in ("S", "cbar", "b"):
        if name in db.attrs and not np.isclose(float(db.attrs[name]), getattr(aircraft, name), rtol=_AGREE, atol=0.0):
            problems.append(
                f"{name} is {float(db.attrs[name]):.8g} in the database and {getattr(aircraft, name):.8g} in the aircraft; they must agree"
            )
    for name, own in zip(("x_ref", "y_ref", "z_ref"), aircraft.reference, strict=True):
        if name in db.attrs and not np.isclose(float(db.attrs[name]), own, rtol=_AGREE, atol=1e-4 * aircraft.cbar):
            problems.append(
                f"{name} is {float(db.attrs[name]):.6g} m in the database and {own:.6g} m in the aircraft; move the moment reference"
            )
    return problems


def _leaf_problems(name: str, leaf: xr.Dataset, aircraft: Aircraft) -> list[str]:
    problems = check(leaf)
    if problems:
        return [f"{name}: {text}" for text in problems]
    allowed = catalogue.variables(len(aircraft.engines))
    for axis in _axes(leaf):
        if axis in IMPLICIT:
            problems.append(f"{name}: {axis} cannot be an axis, the simulation solves for it; make it a regressor")
        elif axis not in allowed:
            problems.append(f"{name}: axis: {_unknown(axis, allowed)}")
    words = regressors(leaf)
    problems += [f"{name}: regressor: {_unknown(word, allowed)}" for word in words if word not in allowed]
    if sum(word in IMPLICIT for word in words) > 1:
        problems.append(f"{name}: regressors {' '.join(words)}: only one of {', '.join(IMPLICIT)} can be solved for in a term")
    if name.startswith("engine") and {*_axes(leaf), *words} & {*IMPLICIT, *(v for v in allowed if v.endswith(".thrust"))}:
        problems.append(f"{name}: a thrust table cannot depend on a thrust or on {', '.join(IMPLICIT)}")
    return problems


def _axes(leaf: xr.Dataset) -> list[str]:
    return [str(axis) for table in ("K1", "K2", "value") if table in leaf for axis in leaf[table].dims]


def _unknown(name: str, allowed: list[str]) -> str:
    hint = "write engine1.throttle or engine1.thrust for one engine" if name in ("throttle", "thrust") else ""
    return str(UnknownName(name, allowed, "model variable of the simulation", hint))


def _meta(db: xr.DataTree, terms: list[_Term]) -> str:
    plain = {key: item for key, item in db.attrs.items() if isinstance(item, str | int | float)}
    texts = {
        t.name: {key: str(t.leaf.attrs[key]) for key in ("regressors", "references", "comment") if t.leaf.attrs.get(key)} for t in terms
    }
    return json.dumps({"database": plain, "force_axes": _force_axes(db), "terms": texts}, sort_keys=True, ensure_ascii=False)


@dataclass
class _Packer:
    """Collects the sections of a block."""

    aircraft: Aircraft
    terms: list[_Term]
    force_axes: str
    meta: str
    strings: dict[str, int] = field(default_factory=dict)
    text: bytearray = field(default_factory=bytearray)
    points: list[float] = field(default_factory=list)
    variables: list[str] = field(default_factory=list)
    axes: list[tuple] = field(default_factory=list)

    def pack(self) -> bytes:
        self.variables = sorted({v for t in self.terms for v in (*_axes(t.leaf), *regressors(t.leaf))})
        self._set_axes()
        bundles, nodes, slots = self._bundles()
        names = [t.name for t in self.terms]
        sections = [
            (1, self._geometry()),
            self._entries(catalogue.inputs(self.aircraft)),
            self._entries(catalogue.outputs(self.aircraft)),
            self._entries(catalogue.parameters(self.aircraft, names)),
            self._entries([catalogue.variable(name) for name in self.variables]),
            (len(self.axes), b"".join(self._axis(axis) for axis in self.axes)),
            (len(self.points), np.array(self.points, "<f8").tobytes()),
            (len(bundles), b"".join(bundles)),
            (len(nodes), np.array(nodes, "<f8").tobytes()),
            (len(self.terms), b"".join(self._term(t, slots) for t in self.terms)),
            (len(self.aircraft.engines), b"".join(struct.pack("<6d", *e.position, *e.direction) for e in self.aircraft.engines)),
        ]
        sections.append((len(self.text), bytes(self.text)))
        return _block(sections)

    def _string(self, text: str) -> int:
        if text not in self.strings:
            self.strings[text] = len(self.text)
            self.text += text.encode() + b"\0"
        return self.strings[text]

    def _geometry(self) -> bytes:
        a = self.aircraft
        axes = list(FORCES).index(self.force_axes)
        return struct.pack("<4d4I", a.S, a.cbar, a.b, a.x_ref_mac, axes, self._string(a.name), self._string(self.meta), 0)

    def _entries(self, rows: list[Entry]) -> tuple[int, bytes]:
        packed = [struct.pack("<4I3d2I", *map(self._string, row[:4]), row.value, row.low, row.high, row.flags, 0) for row in rows]
        return len(packed), b"".join(packed)

    def _set_axes(self) -> None:
        keys = {key: None for t in self.terms for _, table in _tables(t.leaf) for key in _keys(t, table)}
        self.axes = sorted(keys, key=lambda key: key[0])
        self.numbers = {key: number for number, key in enumerate(self.axes)}

    def _axis(self, key: tuple) -> bytes:
        group, name, linear, points = key
        first = len(self.points)
        self.points += points
        return struct.pack("<6I", self.variables.index(name), first, len(points), linear, group, 0)

    def _bundles(self) -> tuple[list[bytes], list[float], dict[tuple[str, str], int]]:
        members: dict[tuple, list[tuple[str, str, np.ndarray]]] = {}
        for t in self.terms:
            for name, table in _tables(t.leaf):
                members.setdefault((t.group, tuple(self.numbers[key] for key in _keys(t, table))), []).append((t.name, name, table.values))
        records, nodes, slots, slot = [], [], {}, 1
        for (group, axes), tables in sorted(members.items(), key=lambda item: item[0][0]):
            records.append(struct.pack("<8IQ", len(axes), *axes, *[0] * (4 - len(axes)), len(tables), group, 0, len(nodes)))
            nodes += np.stack([values for *_, values in tables], axis=-1).astype(float).ravel().tolist()
            for term, table, _ in tables:
                slots[term, table] = slot
                slot += 1
        return records, nodes, slots

    def _term(self, t: _Term, slots: dict[tuple[str, str], int]) -> bytes:
        factors = [self.variables.index(word) + 1 for word in regressors(t.leaf)]
        tables = [slots.get((t.name, name), 0) for name in ("K1", "K2", "value")]
        text = str(t.leaf.attrs.get("comment", ""))
        return struct.pack("<8I", self._string(t.name), self._string(text), *tables, *factors, *[0] * (2 - len(factors)), t.coefficient)


def _tables(leaf: xr.Dataset) -> list[tuple[str, xr.DataArray]]:
    return [(name, leaf[name]) for name in ("K1", "K2", "value") if name in leaf]


def _keys(t: _Term, table: xr.DataArray) -> list[tuple]:
    """Return what makes an axis the same axis: group, variable, rule beyond the ends, breakpoints."""
    linear = int(t.leaf.attrs.get("outside", "hold") == "linear")
    return [(t.group, str(axis), linear, tuple(table[axis].values.astype(float).tolist())) for axis in table.dims]


def _block(sections: list[tuple[int, bytes]]) -> bytes:
    directory, body = b"", b""
    start = 32 + 16 * len(sections)
    for count, data in sections:
        body += bytes(-(start + len(body)) % 64)
        directory += struct.pack("<2Q", start + len(body), count)
        body += data
    checked = struct.pack("<I", len(sections)) + directory + body
    head = struct.pack("<8s2IQ", b"AMKERNEL", library().am_format(), 0x01020304, 28 + len(checked))
    return head + struct.pack("<I", zlib.crc32(checked)) + checked
