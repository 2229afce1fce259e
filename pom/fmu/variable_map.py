"""Table of names: canonical names of an FMU's variables, with factors, signs and offsets."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Annotated, Any, Literal

from pydantic import BeforeValidator, Field

from flightmech.errors import SchemaError, UnitError, UnknownName
from flightmech.names import lookup
from flightmech.quantities import parse_quantity
from flightmech.support.input_files import file_sha256
from flightmech.support.toml_files import read_toml
from flightmech.support.toml_models import Strict, validate_content
from flightmech.units import parse_unit
from pom.fmu.run_cache import FileState


@dataclass(frozen=True)
class Fmu:
    """Interface of an FMU: names and declared units of its scalar numbers.

    A unit is empty if the FMU declares none.

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
        Whether it has model exchange and no co-simulation.
    even : bool
        Whether it takes steps of one length only.
    step : float
        Length of its steps; 0: any. [s]
    once : bool
        Whether a process can instantiate it only once.
    state : FileState, optional
        State of the file when it was read.
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
# Units of names without a row in the vocabulary, by name or group.
_OTHER_UNITS = {"env.qnh": "Pa", "mode": "1"}


class _LinkTable(Strict):
    variable: str
    unit: str = ""
    scale: float | str | None = None
    sign: Literal[1, -1] = 1


def _as_link_table(item: Any) -> Any:
    """Return an entry as a table; a text is the name of the variable."""
    return {"variable": item} if isinstance(item, str) else item


_Entries = dict[str, Annotated[_LinkTable, BeforeValidator(_as_link_table)]]


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
    """Variables of an FMU by canonical name.

    Attributes
    ----------
    inputs, outputs, parameters : mapping of str to Link
        By canonical name.
    fixed : mapping of str to float
        Variables of the FMU with a constant value, in the unit of the FMU.
    table : str
        Name and SHA-256 of the table of names; empty without one.
    waived : tuple of str
        Canonical names of inputs and parameters that a case needs and this FMU may lack.
    """

    inputs: Mapping[str, Link]
    outputs: Mapping[str, Link]
    parameters: Mapping[str, Link]
    fixed: Mapping[str, float] = field(default_factory=dict)
    table: str = ""
    waived: tuple[str, ...] = ()


def links_of(fmu: Fmu, table: str | Path | None = None) -> Links:
    """Return the variables of an FMU by canonical name.

    Parameters
    ----------
    fmu : Fmu
    table : path, optional
        Table of names, TOML: sections ``inputs``, ``outputs``, ``parameters`` with ``canonical_name
        = "variable"`` or ``canonical_name = { variable = "...", unit = "deg", sign = -1 }`` or ``{
        variable = "...", scale = "40 deg" }`` (the value of 1), and ``fixed`` with ``variable =
        value``. A list ``waived`` before the sections names inputs and parameters that the FMU may
        lack, such as ``["mode.engine", "mode.trim"]``. A variable with a canonical name needs no
        entry.

    Raises
    ------
    ParseError
        The table is not TOML.
    SchemaError
        With every entry that names a variable which the FMU does not have in this section or which
        another entry has, an unknown canonical name, or a unit of another quantity; every input of
        the FMU without an entry; and every waived name that the FMU has.
    """
    canonical = {
        "input": _links_by_own_name(fmu.inputs),
        "output": _links_by_own_name(fmu.outputs),
        "parameter": _links_by_own_name(fmu.parameters),
    }
    if table is None:
        return Links(canonical["input"], canonical["output"], canonical["parameter"])
    file = validate_content(_VariableMapFile, read_toml(table), f"names {table}")
    problems: list[str] = []
    links: dict[str, dict[str, Link]] = {}
    # All sections are read before an error is raised, so that it has all problems.
    for kind, entries, offered in (
        ("input", file.inputs, fmu.inputs),
        ("output", file.outputs, fmu.outputs),
        ("parameter", file.parameters, {**fmu.parameters, **fmu.settable}),
    ):
        links[kind] = _join_entries(
            kind, entries, offered=offered, canonical=canonical[kind], problems=problems
        )
    _check_fixed(file, fmu, problems)
    _check_waived(file.waived, {**links["input"], **links["parameter"]}, problems)
    _check_driven(file, fmu, inputs=links["input"], problems=problems)
    if problems:
        raise SchemaError(f"names {table} for FMU {fmu.path}", problems)
    digest = file_sha256(table)
    return Links(
        inputs=links["input"],
        outputs=links["output"],
        parameters=links["parameter"],
        fixed={name: float(value) for name, value in file.fixed.items()},
        table=f"{Path(table).name}, sha256 {digest}",
        waived=tuple(file.waived),
    )


def _links_by_own_name(offered: Mapping[str, str]) -> dict[str, Link]:
    return {name: Link(name) for name in offered}


def _join_entries(
    kind: str,
    entries: Mapping[str, _LinkTable],
    *,
    offered: Mapping[str, str],
    canonical: Mapping[str, Link],
    problems: list[str],
) -> dict[str, Link]:
    """Return the links of one section, and of the variables that have no entry.

    `offered` has the units of the variables, `canonical` the links of variables by their own name.
    """
    by_entry: dict[str, Link] = {}
    for name, entry in entries.items():
        by_entry[name] = _link_of_entry(kind, name, entry, offered=offered, problems=problems)
    variables = _check_unique(kind, entries, problems)
    # An entry replaces the link of the variable that has its name, and of the variable it names.
    links = {name: link for name, link in canonical.items() if name not in variables}
    return {**links, **by_entry}


def _check_unique(kind: str, entries: Mapping[str, _LinkTable], problems: list[str]) -> set[str]:
    """Return the variables of all entries, and add a problem for a variable with two entries."""
    # Name of the entry by variable.
    names: dict[str, str] = {}
    for name, entry in entries.items():
        if entry.variable in names:
            problems.append(
                f"{kind}s.{name}: {entry.variable!r} is {names[entry.variable]} already; a "
                f"variable has one canonical name"
            )
        names[entry.variable] = name
    return set(names)


def _link_of_entry(
    kind: str,
    name: str,
    entry: _LinkTable,
    *,
    offered: Mapping[str, str],
    problems: list[str],
) -> Link:
    """Return the link of an entry; with a problem, a link without conversion."""
    key = f"{kind}s.{name}"
    if entry.variable not in offered:
        problems.append(f"{key}: {UnknownName(entry.variable, offered, f'{kind} of the FMU')}")
        return Link(entry.variable)
    try:
        factor, offset = _conversion_to_si(entry, offered[entry.variable], canonical_unit(name))
    except (UnknownName, UnitError) as error:
        problems.append(f"{key}: {error}")
        return Link(entry.variable)
    if not factor:
        problems.append(f"{key}: scale 0; give what 1 stands for")
    # canonical = sign (factor number + offset)
    return Link(entry.variable, entry.sign * factor, entry.sign * offset)


def _conversion_to_si(entry: _LinkTable, declared: str, expected: str) -> tuple[float, float]:
    """Return factor and offset to SI from the entry and the declared unit, which may be empty."""
    # A scale is the value of 1, for a variable without a unit, such as a normalised deflection.
    if entry.scale is not None:
        if entry.unit or declared not in ("", "1", "-", "%"):
            raise UnitError(
                f"a scale is for a variable without a unit; this one is in "
                f"{entry.unit or declared!r}, leave the scale out"
            )
        return parse_quantity(entry.scale, expected), 0.0
    unit = entry.unit or declared
    conversion = parse_unit(unit or expected)
    dimension, factor, offset = conversion
    if dimension != parse_unit(expected)[0]:
        raise UnitError(
            f"unit {unit!r} cannot be converted to {expected!r}; give a unit of the same quantity"
        )
    # A declared unit that cannot be parsed is no contradiction.
    if entry.unit and declared and _parse_if_valid(declared) not in (None, conversion):
        raise UnitError(
            f"the table gives {entry.unit!r} and the FMU declares {declared!r}; correct the table"
        )
    return factor, offset


def _parse_if_valid(unit: str) -> Any:
    try:
        return parse_unit(unit)
    except UnitError:
        return None


def _check_fixed(file: _VariableMapFile, fmu: Fmu, problems: list[str]) -> None:
    """Add a problem for a fixed variable that the FMU lacks, or that has a canonical name too."""
    offered = {**fmu.inputs, **fmu.parameters, **fmu.settable}
    entries = [*file.inputs.values(), *file.parameters.values()]
    mapped = {entry.variable for entry in entries}
    # A variable with two values would have that of the table or that of the case.
    for name in file.fixed:
        if name not in offered:
            problems.append(f"fixed: {UnknownName(name, offered, 'input or parameter of the FMU')}")
        elif name in mapped:
            problems.append(f"fixed.{name}: it has a canonical name too; choose one of the two")


def _check_waived(waived: list[str], linked: Mapping[str, Link], problems: list[str]) -> None:
    """Add a problem for a waived name that the FMU has, or that is not a canonical name."""
    for name in waived:
        if name in linked:
            problems.append(
                f"waived: the FMU has {name!r} as {linked[name].variable!r}; delete it from "
                f"the list"
            )
        elif not _is_canonical(name):
            problems.append(f"waived: {name!r} is not a canonical name of an input or parameter")


def _check_driven(
    file: _VariableMapFile, fmu: Fmu, *, inputs: Mapping[str, Link], problems: list[str]
) -> None:
    """Add a problem for every input of the FMU without a canonical name and without a value."""
    driven: set[str] = set()
    for name, link in inputs.items():
        if name in file.inputs or _is_canonical(name):
            driven.add(link.variable)
    for name in fmu.inputs:
        if name not in driven and name not in file.fixed:
            problems.append(
                f"inputs: nothing drives the input {name!r} of the FMU; give it a canonical "
                f"name, or a value in [fixed]"
            )


def canonical_unit(name: str) -> str:
    """Return the SI unit of an input, output or parameter by its canonical name.

    Raises
    ------
    UnknownName
        The name does not exist.
    """
    unit = _OTHER_UNITS.get(name) or _OTHER_UNITS.get(name.partition(".")[0])
    return unit or lookup(_quantity_of(name)).units


def _is_canonical(name: str) -> bool:
    try:
        return bool(canonical_unit(name))
    except UnknownName:
        return False


def _quantity_of(name: str) -> str:
    """Return the quantity of a grouped name.

    It is ``theta`` for ``init.theta``, and ``thrust`` for ``engine1.thrust_drive``.
    """
    # An input that drives a quantity has the name of the quantity.
    if name.endswith("_drive"):
        return name.rpartition(".")[2].removesuffix("_drive")
    group, _, quantity = name.partition(".")
    return quantity if group in _GROUPS else name
