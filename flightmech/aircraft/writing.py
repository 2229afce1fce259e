"""An aircraft to a TOML file that `read_aircraft` reads back the same; tables of engines and fuel
go to netCDF files next to it.
"""

from __future__ import annotations

import json
from collections.abc import Mapping
from dataclasses import fields
from pathlib import Path
from typing import Any

from flightmech.aircraft.aircraft import Aircraft
from flightmech.aircraft.engine import Engine
from flightmech.aircraft.engine_deck import CONSTANTS, EngineDeck, write_tables
from flightmech.aircraft.fuel import Fuel
from flightmech.aircraft.landing_gear import CONDITIONS, LandingGear
from flightmech.aircraft.landing_gear_file import ORDERS
from flightmech.support.atomic_write import write_text, written_atomically

_PLAIN = (
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
    """Write an aircraft file, SI.

    Parameters
    ----------
    aircraft : Aircraft
        The aircraft.
    path : str or path
        TOML file; tables are written next to it as ``<name>_engine1.nc`` and so on, those that
        engines share once, and ``<name>_fuel.nc``.

    Returns
    -------
    Path
        The TOML file.
    """
    path = Path(path)
    files = _engine_files(aircraft.engines, path)
    lines = [
        f"{name} = {_value(getattr(aircraft, name))}"
        for name in _PLAIN
        if getattr(aircraft, name) is not None
    ]
    if aircraft.history:
        lines.append(f"history = {_value(aircraft.history)}")
    lines += ["earth_outputs = true"] if aircraft.earth_outputs else []
    for engine, file in zip(aircraft.engines, files, strict=True):
        lines += [
            "",
            "[[engine]]",
            f"position = {_value(engine.position)}",
            f"direction = {_value(engine.direction)}",
        ]
        lines += [
            f"{name} = {_value(getattr(engine, name))}"
            for name in ("time_constant", "angular_momentum")
        ]
        lines += [f"thrust_file = {_value(file)}"] if engine.thrust is not None else []
        lines += _deck(engine.deck, file) if engine.deck is not None else []
    lines += _fuel(aircraft.fuel, path) if aircraft.fuel is not None else []
    lines += _gear(aircraft.gear) if aircraft.gear is not None else []
    if aircraft.limits:
        lines += [
            "",
            "[limits]",
            *(f"{_key(name)} = {_value(travel)}" for name, travel in aircraft.limits.items()),
        ]
    for name, control in aircraft.controls.items():
        lines += [
            "",
            f"[control.{name}]",
            f"S_hinge = {control.S_hinge!r}",
            f"c_hinge = {control.c_hinge!r}",
        ]
        lines += [f"gearing = {control.gearing!r}"] if control.gearing is not None else []
    for name, circuit in aircraft.circuits.items():
        changed = [f.name for f in fields(circuit) if getattr(circuit, f.name) != f.default]
        lines += [
            "",
            f"[circuit.{name}]",
            *(f"{key} = {_value(getattr(circuit, key))}" for key in changed),
        ]
    for name, table in aircraft.instruments.items():
        lines += [
            "",
            f"[instruments.{name}]",
            *(f"{_key(key)} = {_value(item)}" for key, item in table.items()),
        ]
    write_text(path, "\n".join(lines) + "\n")
    return path


def _engine_files(engines: tuple[Engine, ...], path: Path) -> list[str]:
    """Write the tables of the engines; engines with the same tables share a file, one without has
    the name "".
    """
    files: list[str] = []
    for number, engine in enumerate(engines, 1):
        same = next(
            (i for i, other in enumerate(engines[: number - 1]) if _same_tables(other, engine)), -1
        )
        if engine.thrust is None and engine.deck is None:
            files.append("")
        elif same >= 0:
            files.append(files[same])
        else:
            files.append(f"{path.stem}_engine{number}.nc")
            with written_atomically(path.with_name(files[-1])) as part:
                if engine.thrust is not None:
                    engine.thrust.to_netcdf(part, engine="h5netcdf")
                else:
                    write_tables(engine.deck.tables, part)  # type: ignore[union-attr]
    return files


def _same_tables(one: Engine, other: Engine) -> bool:
    if one.thrust is not None and other.thrust is not None:
        return bool(one.thrust.identical(other.thrust))
    if one.deck is None or other.deck is None or set(one.deck.tables) != set(other.deck.tables):
        return False
    return all(leaf.identical(other.deck.tables[name]) for name, leaf in one.deck.tables.items())


def _deck(deck: EngineDeck, file: str) -> list[str]:
    lines = [
        "",
        "[engine.deck]",
        f"file = {_value(file)}",
        *(f"{name} = {_value(getattr(deck, name))}" for name in CONSTANTS),
    ]
    return lines + ([f"inlet = {_value(deck.inlet)}"] if deck.inlet is not None else [])


def _gear(gear: LandingGear) -> list[str]:
    plain = ("mu_dry", "mu_icy", "mu_wet", "skid_ratio", "antiskid")
    lines = [
        "",
        "[gear]",
        f"condition = {_value(CONDITIONS[gear.condition])}",
        *(f"{name} = {_value(getattr(gear, name))}" for name in plain),
    ]
    order = next(word for word, number in ORDERS.items() if number == gear.steering.order)
    lines += ["", "[gear.steering]", f"order = {_value(order)}"]
    lines += [
        f"{f.name} = {_value(getattr(gear.steering, f.name))}"
        for f in fields(gear.steering)
        if f.name != "order"
    ]
    for contact in gear.contacts:
        given = [f.name for f in fields(contact) if f.name != "strut"]
        lines += [
            "",
            "[[gear.contact]]",
            *(f"{name} = {_value(getattr(contact, name))}" for name in given),
        ]
        if contact.strut is not None:
            leaf = contact.strut
            points, force = (tuple(leaf[name].values.tolist()) for name in ("compression", "value"))
            lines.append(f"strut = {{ compression = {_value(points)}, value = {_value(force)} }}")
    return lines


def _fuel(fuel: Fuel, path: Path) -> list[str]:
    lines = ["", "[fuel]", f"mass = {_value(fuel.mass)}", f"position = {_value(fuel.position)}"]
    if not fuel.tables:
        return lines
    file = f"{path.stem}_fuel.nc"
    with written_atomically(path.with_name(file)) as part:
        write_tables(fuel.tables, part)
    return [*lines, f"file = {_value(file)}"]


def _key(name: str) -> str:
    return name if name.replace("_", "").isalnum() and name.isascii() else json.dumps(name)


def _value(item: Any) -> str:
    if isinstance(item, Mapping):
        return (
            f"{{ {', '.join(f'{_key(str(key))} = {_value(value)}' for key, value in item.items())} "
            f"}}"
            if item
            else "{}"
        )
    if isinstance(item, list | tuple):
        return f"[{', '.join(map(_value, item))}]"
    if isinstance(item, str):
        return json.dumps(item, ensure_ascii=False).replace("\x7f", "\\u007f")
    if isinstance(item, bool):
        return "true" if item else "false"
    return repr(float(item)) if isinstance(item, float) else str(item)
