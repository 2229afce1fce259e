"""Tables and constants of the parts of an engine with a propeller, from the aircraft file.

A part is a dataclass with ``tables`` and constants. Its section of the aircraft file has the same
names.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import fields
from typing import TYPE_CHECKING, Any

from flightmech.aircraft.propulsion.engine_deck import DeckFiles, leaf_from_toml
from flightmech.errors import AeromatchError, SchemaError, UnknownName
from flightmech.terms import make_term

if TYPE_CHECKING:
    import xarray as xr

# Variables of one engine that its own tables may depend on, without its number.
SHAFT_VARIABLES = (
    "throttle",
    "J",
    "rpm",
    "engine_rpm",
    "blade_angle",
    "tip_mach",
    "prop_command",
    "V_eas",
    "manifold_pressure",
    "mixture",
    "fuel_air_ratio",
    "pressure_ratio",
    "density_ratio",
    "charge",
)


def list_constants(part: type) -> tuple[str, ...]:
    """Return the names of the constants of a part: its fields without ``tables``."""
    return tuple(item.name for item in fields(part) if item.name != "tables")


def unknown_tables(
    tables: Mapping[str, xr.Dataset], targets: Mapping[str, str], what: str
) -> Iterator[str]:
    """Yield the problem of every table that is not a target of the part."""
    for target in sorted(set(tables) - set(targets)):
        yield str(UnknownName(target, targets, what))


def read_part(
    item: Any, files: DeckFiles, *, part: type, targets: Mapping[str, str], what: str
) -> Any:
    """Return a part of an engine from its section of the aircraft file.

    Parameters
    ----------
    item : model of the section
        With ``file``, ``tables`` and the constants of the part; None is the default of the part.
    files : DeckFiles
        Files in the folder of the aircraft file.
    part : type
        The dataclass of the part.
    targets : mapping of str to str
        SI unit of each table.
    what : str
        Name of the part for the problems.

    Raises
    ------
    SchemaError
        With all problems of the tables, or those of the part.
    """
    tables: dict[str, xr.Dataset] = {}
    problems: list[str] = []
    if item.file is not None:
        tables |= files.of(item.file)
    for target, content in item.tables.items():
        if target not in targets:
            problems.append(str(UnknownName(target, targets, f"table of {what}")))
            continue
        try:
            tables[target] = leaf_from_toml(content, targets[target])
        except (AeromatchError, ValueError) as error:
            texts = getattr(error, "problems", [str(error)])
            problems += [f"{target}: {text}" for text in texts]
            tables[target] = make_term(1.0)
    if problems:
        raise SchemaError(what, problems)
    constants = {}
    for name in list_constants(part):
        value = getattr(item, name)
        if value is not None:
            constants[name] = value
    return part(tables=tables, **constants)
