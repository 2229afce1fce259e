"""Writer of aircraft files. `read_aircraft` reads the same aircraft from the file.

The tables of engines, fuel and stall are written to netCDF files next to the TOML file.
"""

from __future__ import annotations

import json
from collections.abc import Iterable, Mapping
from contextlib import ExitStack
from dataclasses import asdict, fields
from pathlib import Path
from typing import Any

from flightmech.aircraft.aircraft import Aircraft
from flightmech.aircraft.controls import ControlGeometry
from flightmech.aircraft.engine import Engine
from flightmech.aircraft.fuel import Fuel
from flightmech.aircraft.landing_gear import CONDITIONS, LandingGear
from flightmech.aircraft.landing_gear_file import ORDERS
from flightmech.aircraft.propulsion.engine_deck import CONSTANTS, EngineDeck, write_tables
from flightmech.aircraft.separation import FlowSeparation
from flightmech.support.array_files.netcdf_writing import write_netcdf
from flightmech.support.atomic_write import written_atomically

# keys before the first section of the file
_MAIN_KEYS = (
    "name",
    "S",
    "cbar",
    "b",
    "reference",
    "x_ref_mac",
    "mass",
    "Ixx",
    "Iyy",
    "Izz",
    "Ixy",
    "Ixz",
    "Iyz",
    "cg",
)


def write_aircraft(aircraft: Aircraft, path: str | Path) -> Path:
    """Write an aircraft file in SI units.

    Parameters
    ----------
    aircraft : Aircraft
    path : str or path
        TOML file. Tables are written next to it as ``<name>_engine1.nc`` and so on,
        ``<name>_fuel.nc`` and ``<name>_stall.nc``. Engines with the same tables share a file.

    Returns
    -------
    Path
        The TOML file.
    """
    path = Path(path)
    # All files are complete under temporary names before the first one is renamed: otherwise an
    # older TOML file would stay with new tables after a failed write.
    with ExitStack() as parts:
        lines = _write_all_tables(aircraft, path, parts)
        part = parts.enter_context(written_atomically(path))
        part.write_text("\n".join(lines) + "\n", encoding="utf-8", newline="")
    return path


def _write_all_tables(aircraft: Aircraft, path: Path, parts: ExitStack) -> list[str]:
    """Write the tables to temporary files, and return the lines of the TOML file.

    The files get their names at the end of `parts`.
    """
    files = _write_engine_tables(aircraft.engines, path, parts)
    lines = _main_lines(aircraft)
    for number, (engine, file) in enumerate(zip(aircraft.engines, files, strict=True), 1):
        lines += _engine_lines(engine, file)
        lines += _write_shaft_tables(engine, number, path, parts)
    if aircraft.fuel is not None:
        lines += _write_fuel(aircraft.fuel, path, parts)
    if aircraft.stall is not None:
        lines += _write_separation(aircraft.stall, path, parts)
    if aircraft.gear is not None:
        lines += _gear_lines(aircraft.gear)
    facts = aircraft.facts.known()
    if facts:
        lines += ["", "[facts]", *_key_lines(facts)]
    if aircraft.acknowledged:
        lines += ["", "[acknowledged]", *_key_lines(aircraft.acknowledged)]
    if aircraft.limits:
        lines += ["", "[limits]", *_key_lines(aircraft.limits)]
    for name, control in aircraft.controls.items():
        lines += _control_lines(name, control)
    for name, circuit in aircraft.circuits.items():
        # constants with their defaults are omitted
        changed = [f.name for f in fields(circuit) if getattr(circuit, f.name) != f.default]
        lines += ["", f"[circuit.{name}]", *_field_lines(circuit, changed)]
    for name, table in aircraft.instruments.items():
        lines += ["", f"[instruments.{name}]", *_key_lines(table)]
    return lines


def _main_lines(aircraft: Aircraft) -> list[str]:
    keys = [key for key in _MAIN_KEYS if getattr(aircraft, key) is not None]
    lines = _field_lines(aircraft, keys)
    if aircraft.history:
        lines.append(f"history = {_to_toml(aircraft.history)}")
    if aircraft.earth_outputs:
        lines.append("earth_outputs = true")
    return lines


def _write_engine_tables(engines: tuple[Engine, ...], path: Path, parts: ExitStack) -> list[str]:
    """Write the tables of the engines, and return the name of the file of each engine.

    Engines with the same tables share a file. The name of an engine without tables is empty.
    """
    files: list[str] = []
    for i, engine in enumerate(engines):
        if engine.thrust is None and engine.deck is None:
            files.append("")
            continue
        # files of the engines before this one
        shared = [file for before, file in zip(engines, files) if _has_same_tables(before, engine)]
        if shared:
            files.append(shared[0])
            continue
        files.append(f"{path.stem}_engine{i + 1}.nc")
        part = parts.enter_context(written_atomically(path.with_name(files[-1])))
        if engine.thrust is not None:
            write_netcdf(engine.thrust, part)
        elif engine.deck is not None:
            write_tables(engine.deck.tables, part)
    return files


# Sections of an engine in addition to the deck.
_SHAFT_SECTIONS = ("propeller", "piston", "motor")


def _write_shaft_tables(engine: Engine, number: int, path: Path, parts: ExitStack) -> list[str]:
    """Write the tables of propeller, piston engine and motor; return the lines of the sections."""
    lines: list[str] = []
    for name in _SHAFT_SECTIONS:
        section = getattr(engine, name)
        if section is None:
            continue
        file = f"{path.stem}_engine{number}_{name}.nc"
        write_tables(section.tables, parts.enter_context(written_atomically(path.with_name(file))))
        lines += ["", f"[engine.{name}]", f"file = {_to_toml(file)}"]
        constants = [item for item in fields(section) if item.name != "tables"]
        # constants with their defaults are omitted
        changed = [f.name for f in constants if getattr(section, f.name) != f.default]
        lines += _field_lines(section, changed)
    return lines


def _has_same_tables(a: Engine, b: Engine) -> bool:
    if a.thrust is not None and b.thrust is not None:
        return bool(a.thrust.identical(b.thrust))
    if a.deck is None or b.deck is None or set(a.deck.tables) != set(b.deck.tables):
        return False
    # identical() also compares names and attributes
    return all(leaf.identical(b.deck.tables[name]) for name, leaf in a.deck.tables.items())


def _engine_lines(engine: Engine, file: str) -> list[str]:
    lines = ["", "[[engine]]"]
    lines += _field_lines(engine, ("position", "direction", "time_constant", "angular_momentum"))
    lines += _field_lines(engine, [key for key in ("feed", "crossfeed") if getattr(engine, key)])
    if engine.thrust is not None:
        lines.append(f"thrust_file = {_to_toml(file)}")
    if engine.deck is not None:
        lines += _deck_lines(engine.deck, file)
    return lines


def _deck_lines(deck: EngineDeck, file: str) -> list[str]:
    constants = [name for name in CONSTANTS if name != "coupled" or deck.coupled]
    lines = ["", "[engine.deck]", f"file = {_to_toml(file)}", *_field_lines(deck, constants)]
    if deck.inlet is not None:
        lines.append(f"inlet = {_to_toml(deck.inlet)}")
    return lines


def _control_lines(name: str, control: ControlGeometry) -> list[str]:
    lines = ["", f"[control.{name}]"]
    lines += [f"S_hinge = {control.S_hinge!r}", f"c_hinge = {control.c_hinge!r}"]
    if control.gearing is not None:
        lines.append(f"gearing = {control.gearing!r}")
    return lines


def _gear_lines(gear: LandingGear) -> list[str]:
    lines = ["", "[gear]", f"condition = {_to_toml(CONDITIONS[gear.condition])}"]
    lines += _field_lines(gear, ("mu_dry", "mu_icy", "mu_wet", "skid_ratio", "antiskid"))
    names = {number: name for name, number in ORDERS.items()}
    lines += ["", "[gear.steering]", f"order = {_to_toml(names[gear.steering.order])}"]
    lines += _field_lines(
        gear.steering, [f.name for f in fields(gear.steering) if f.name != "order"]
    )
    for contact in gear.contacts:
        keys = [f.name for f in fields(contact) if f.name != "strut"]
        lines += ["", "[[gear.contact]]", *_field_lines(contact, keys)]
        if contact.strut is not None:
            compression = _to_toml(contact.strut["compression"].values.tolist())
            force = _to_toml(contact.strut["value"].values.tolist())
            lines.append(f"strut = {{ compression = {compression}, value = {force} }}")
    return lines


def _write_fuel(fuel: Fuel, path: Path, parts: ExitStack) -> list[str]:
    """Write the tables of the fuel, and return the lines of its section."""
    if fuel.tanks:
        tanks = [f"    {_to_toml(asdict(tank))}," for tank in fuel.tanks]
        lines = ["", "[fuel]", *_field_lines(fuel, ("mass",)), "tank = [", *tanks, "]"]
        if fuel.transfers:
            pumps = [f"    {_to_toml(asdict(pump))}," for pump in fuel.transfers]
            lines += ["transfer = [", *pumps, "]"]
        return lines
    lines = ["", "[fuel]", *_field_lines(fuel, ("mass", "position"))]
    if not fuel.tables:
        return lines
    file = f"{path.stem}_fuel.nc"
    write_tables(fuel.tables, parts.enter_context(written_atomically(path.with_name(file))))
    return [*lines, f"file = {_to_toml(file)}"]


def _write_separation(stall: FlowSeparation, path: Path, parts: ExitStack) -> list[str]:
    """Write the tables of the separation, and return the lines of its section."""
    file = f"{path.stem}_stall.nc"
    write_tables(stall.tables, parts.enter_context(written_atomically(path.with_name(file))))
    return ["", "[stall]", *_field_lines(stall, ("station",)), f"file = {_to_toml(file)}"]


def _field_lines(item: Any, names: Iterable[str]) -> list[str]:
    """Return one line for each of these attributes of an object."""
    return [f"{name} = {_to_toml(getattr(item, name))}" for name in names]


def _key_lines(table: Mapping[str, Any]) -> list[str]:
    return [f"{_to_key(key)} = {_to_toml(item)}" for key, item in table.items()]


def _to_key(name: str) -> str:
    """Return a key of TOML, in quotes if it has characters that a bare key must not have."""
    if name.isascii() and name.replace("_", "").isalnum():
        return name
    return json.dumps(name)


def _to_toml(item: Any) -> str:
    """Return a value as TOML. A float is written with all its digits."""
    if isinstance(item, Mapping):
        return _to_inline_table(item)
    if isinstance(item, list | tuple):
        return f"[{', '.join(map(_to_toml, item))}]"
    if isinstance(item, str):
        # JSON leaves the control character DEL as it is, TOML requires an escape
        return json.dumps(item, ensure_ascii=False).replace("\x7f", "\\u007f")
    if isinstance(item, bool):
        return "true" if item else "false"
    # float() because the repr of a NumPy float has its type
    return repr(float(item)) if isinstance(item, float) else str(item)


def _to_inline_table(table: Mapping[str, Any]) -> str:
    if not table:
        return "{}"
    entries = [f"{_to_key(str(key))} = {_to_toml(item)}" for key, item in table.items()]
    return f"{{ {', '.join(entries)} }}"
