"""Canonical names and the variables of a foreign FMU: the table of names that joins them, with
factors, signs and offsets.
"""

from __future__ import annotations

import hashlib
from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Annotated, Any, Literal

from pydantic import BeforeValidator, Field

from flightmech.errors import SchemaError, UnitError, UnknownName
from flightmech.names import lookup
from flightmech.support.input_files import read_toml
from flightmech.support.toml_models import Strict, validate_content
from flightmech.units import parse_quantity, parse_unit
from pom.fmu.run_cache import FileState


@dataclass(frozen=True)
class Fmu:
    """Interface of an FMU: names and units (empty: not declared) of scalar numbers.

    Attributes
    ----------
    path : Path
    version : str
        FMI version.
    sha256 : str
        Of the file.
    inputs, outputs, parameters : dict of str to str
        Name to unit.
    settable : dict of str to str
        Variables that are not parameters but take a start value.
    exchange : bool
        Model exchange, for want of co-simulation.
    even : bool
        It takes steps of one length only.
    step : float
        That length; 0: any. [s]
    once : bool
        It can be instantiated only once in a process.
    state : FileState, optional
        Of the file when it was read.
    """

    path: Path
    version: str
    sha256: str
    inputs: Mapping[str, str]
    outputs: Mapping[str, str]
    parameters: Mapping[str, str]
    settable: Mapping[str, str] = field(default_factory=dict)
    exchange: bool = False
    even: bool = False
    step: float = 0.0
    once: bool = False
    state: FileState | None = None


_GROUPS = ("init", "mass", "env", "trim", "applied")
_LOOSE = {"env.qnh": "Pa", "mode": "1"}  # what has no row in the vocabulary, by name or group


class _LinkTable(Strict):
    variable: str
    unit: str = ""
    scale: float | str | None = None
    sign: Literal[1, -1] = 1


def _entry(item: Any) -> Any:
    return {"variable": item} if isinstance(item, str) else item


_Entries = dict[str, Annotated[_LinkTable, BeforeValidator(_entry)]]


class _VariableMapFile(Strict):
    inputs: _Entries = Field(default_factory=dict)
    outputs: _Entries = Field(default_factory=dict)
    parameters: _Entries = Field(default_factory=dict)
    fixed: dict[str, float | bool] = Field(default_factory=dict)
    waived: list[str] = Field(default_factory=list)


@dataclass(frozen=True)
class Link:
    """A variable of an FMU; the canonical number is ``factor`` times its number plus ``offset``."""

    variable: str
    factor: float = 1.0
    offset: float = 0.0

    def to_fmu(self, value: Any) -> Any:
        """Return a value, or an array, in the unit and sign of the FMU."""
        return (value - self.offset) / self.factor

    def to_canonical(self, value: Any) -> Any:
        """Return a value, or an array, in SI and the canonical sign."""
        return value * self.factor + self.offset


@dataclass(frozen=True)
class Links:
    """How canonical names and the variables of an FMU correspond.

    Attributes
    ----------
    inputs, outputs, parameters : mapping of str to Link
        By canonical name.
    fixed : mapping of str to float
        Variables of the FMU that keep a value, in its own unit.
    table : str
        Name and SHA-256 of the table of names; empty without one.
    waived : tuple of str
        Inputs and parameters that a case needs and this FMU may lack, by their canonical names.
    """

    inputs: Mapping[str, Link]
    outputs: Mapping[str, Link]
    parameters: Mapping[str, Link]
    fixed: Mapping[str, float] = field(default_factory=dict)
    table: str = ""
    waived: tuple[str, ...] = ()


def links_of(fmu: Fmu, table: str | Path | None = None) -> Links:
    """Join an FMU to the canonical names.

    Parameters
    ----------
    fmu : Fmu
    table : path, optional
        Table of names, TOML: sections ``inputs``, ``outputs``, ``parameters`` with ``canonical_name
        = "variable"`` or ``canonical_name = { variable = "...", unit = "deg", sign = -1 }`` or ``{
        variable = "...", scale = "40 deg" }`` (what 1 stands for), and ``fixed`` with ``variable =
        value``; a list ``waived`` before them names what the FMU does without, such as
        ``["mode.engine", "mode.trim"]``.  A variable with a canonical name needs no entry.

    Raises
    ------
    ParseError
        The table is not TOML.
    SchemaError
        With every entry that names no such variable, another kind of variable, one that another
        entry has, an unknown canonical name, or a unit that cannot be; every input of the FMU that
        nothing drives; and what is waived and there.
    """
    own = Links(_alike(fmu.inputs), _alike(fmu.outputs), _alike(fmu.parameters))
    if table is None:
        return own
    file = validate_content(_VariableMapFile, read_toml(table), f"names {table}")
    problems: list[str] = []
    found = {}
    for what, entries, offered, names in (
        ("input", file.inputs, fmu.inputs, own.inputs),
        ("output", file.outputs, fmu.outputs, own.outputs),
        ("parameter", file.parameters, {**fmu.parameters, **fmu.settable}, own.parameters),
    ):
        links = {
            name: _link(what, name, entry, offered, problems) for name, entry in entries.items()
        }
        taken = _taken_once(what, entries, problems)
        found[what] = {**{name: link for name, link in names.items() if name not in taken}, **links}
    _check_fixed(file, fmu, problems)
    _check_waived(file.waived, {**found["input"], **found["parameter"]}, problems)
    driven = {
        link.variable
        for name, link in found["input"].items()
        if name in file.inputs or _known(name)
    }
    for name in fmu.inputs:
        if name not in driven and name not in file.fixed:
            problems.append(
                f"inputs: nothing drives the input {name!r} of the FMU; give it a canonical "
                f"name, or a value in [fixed]"
            )
    if problems:
        raise SchemaError(f"names {table} for FMU {fmu.path}", problems)
    digest = hashlib.sha256(Path(table).read_bytes()).hexdigest()
    return Links(
        found["input"],
        found["output"],
        found["parameter"],
        {name: float(value) for name, value in file.fixed.items()},
        table=f"{Path(table).name}, sha256 {digest}",
        waived=tuple(file.waived),
    )


def _alike(offered: Mapping[str, str]) -> dict[str, Link]:
    return {name: Link(name) for name in offered}


def _taken_once(what: str, entries: Mapping[str, _LinkTable], problems: list[str]) -> set[str]:
    taken: dict[str, str] = {}
    for name, entry in entries.items():
        if entry.variable in taken:
            problems.append(
                f"{what}s.{name}: {entry.variable!r} is {taken[entry.variable]} already; a "
                f"variable has one canonical name"
            )
        taken[entry.variable] = name
    return set(taken)


def _link(
    what: str, name: str, entry: _LinkTable, offered: Mapping[str, str], problems: list[str]
) -> Link:
    place = f"{what}s.{name}"
    if entry.variable not in offered:
        problems.append(f"{place}: {UnknownName(entry.variable, offered, f'{what} of the FMU')}")
        return Link(entry.variable)
    try:
        expected = canonical_unit(name)
        factor, offset = _turned(entry, offered[entry.variable], expected)
    except (UnknownName, UnitError) as error:
        problems.append(f"{place}: {error}")
        return Link(entry.variable)
    if not factor:
        problems.append(f"{place}: scale 0; give what 1 stands for")
    return Link(entry.variable, entry.sign * factor, entry.sign * offset)


def _turned(entry: _LinkTable, declared: str, expected: str) -> tuple[float, float]:
    """Return factor and offset to SI by the entry and the unit that the FMU declares, empty when it
    declares none.
    """
    if entry.scale is not None:
        if entry.unit or declared not in ("", "1", "-", "%"):
            raise UnitError(
                f"a scale is for a variable without a unit; this one is in "
                f"{entry.unit or declared!r}, leave the scale out"
            )
        return parse_quantity(entry.scale, expected), 0.0
    dimension, factor, offset = parse_unit(entry.unit or declared or expected)
    if dimension != parse_unit(expected)[0]:
        raise UnitError(
            f"unit {entry.unit or declared!r} cannot be converted to {expected!r}; give a "
            f"unit of the same quantity"
        )
    if entry.unit and declared and _parsed(declared) not in (None, (dimension, factor, offset)):
        raise UnitError(
            f"the table gives {entry.unit!r} and the FMU declares {declared!r}; correct the table"
        )
    return factor, offset


def _parsed(unit: str) -> Any:
    try:
        return parse_unit(unit)
    except UnitError:
        return None


def _check_fixed(file: _VariableMapFile, fmu: Fmu, problems: list[str]) -> None:
    offered = {**fmu.inputs, **fmu.parameters, **fmu.settable}
    mapped = {
        entry.variable for entries in (file.inputs, file.parameters) for entry in entries.values()
    }
    for name in file.fixed:
        if name not in offered:
            problems.append(f"fixed: {UnknownName(name, offered, 'input or parameter of the FMU')}")
        elif name in mapped:
            problems.append(f"fixed.{name}: it has a canonical name too; choose one of the two")


def _check_waived(waived: list[str], linked: Mapping[str, Link], problems: list[str]) -> None:
    for name in waived:
        if name in linked:
            problems.append(
                f"waived: the FMU has {name!r} as {linked[name].variable!r}; delete it from "
                f"the list"
            )
        elif not _known(name):
            problems.append(f"waived: {name!r} is not a canonical name of an input or parameter")


def canonical_unit(name: str) -> str:
    """Return the SI unit of an input, output or parameter by its canonical name.

    Raises
    ------
    UnknownName
        There is no such name.
    """
    loose = _LOOSE.get(name) or _LOOSE.get(name.partition(".")[0])
    return loose or lookup(_bare(name)).units


def _known(name: str) -> bool:
    try:
        return bool(canonical_unit(name))
    except UnknownName:
        return False


def _bare(name: str) -> str:
    """Return the quantity of a grouped name: ``init.theta`` is theta, ``engine1.thrust_drive`` a
    thrust.
    """
    if name.endswith("_drive"):
        return name.rpartition(".")[2].removesuffix("_drive")
    head, _, tail = name.partition(".")
    return tail if head in _GROUPS else name
