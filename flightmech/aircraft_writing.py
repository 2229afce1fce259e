"""An aircraft to a TOML file that `read_aircraft` reads back the same; thrust tables go to netCDF files beside it."""

from __future__ import annotations

import json
from collections.abc import Mapping
from pathlib import Path
from typing import Any

from .aircraft import Aircraft, Engine
from .whole import written_whole

_PLAIN = ("name", "S", "cbar", "b", "reference", "x_ref_mac", "mass", "Ixx", "Iyy", "Izz", "Ixy", "Ixz", "Iyz", "cg")


def write_aircraft(aircraft: Aircraft, path: str | Path) -> Path:
    """Write an aircraft file, SI.

    Parameters
    ----------
    aircraft : Aircraft
        The aircraft.
    path : str or path
        TOML file; thrust tables are written beside it as ``<name>_engine1.nc`` and so on, each table once.

    Returns
    -------
    Path
        The TOML file.
    """
    path = Path(path)
    files = _thrust_files(aircraft.engines, path)
    lines = [f"{name} = {_value(getattr(aircraft, name))}" for name in _PLAIN]
    if aircraft.history:
        lines.append(f"history = {_value(aircraft.history)}")
    for engine, file in zip(aircraft.engines, files, strict=True):
        lines += ["", "[[engine]]", f"position = {_value(engine.position)}", f"direction = {_value(engine.direction)}"]
        lines += [f"{name} = {_value(getattr(engine, name))}" for name in ("time_constant", "angular_momentum")]
        lines += [f"thrust_file = {_value(file)}"] if file else []
    if aircraft.limits:
        lines += ["", "[limits]", *(f"{name} = {_value(travel)}" for name, travel in aircraft.limits.items())]
    for name, control in aircraft.controls.items():
        lines += ["", f"[control.{name}]", f"S_hinge = {control.S_hinge!r}", f"c_hinge = {control.c_hinge!r}"]
        lines += [f"gearing = {control.gearing!r}"] if control.gearing is not None else []
    for name, table in aircraft.instruments.items():
        lines += ["", f"[instruments.{name}]", *(f"{_key(key)} = {_value(item)}" for key, item in table.items())]
    with written_whole(path) as part:
        part.write_text("\n".join(lines) + "\n", encoding="utf-8")
    return path


def _thrust_files(engines: tuple[Engine, ...], path: Path) -> list[str]:
    """Write the thrust tables; engines with the same table share a file."""
    files: list[str] = []
    for number, engine in enumerate(engines, 1):
        if engine.thrust is None:
            files.append("")
            continue
        twin = next(
            (i for i, other in enumerate(engines[: number - 1]) if other.thrust is not None and other.thrust.identical(engine.thrust)), -1
        )
        if twin >= 0:
            files.append(files[twin])
            continue
        files.append(f"{path.stem}_engine{number}.nc")
        with written_whole(path.with_name(files[-1])) as part:
            engine.thrust.to_netcdf(part, engine="h5netcdf")
    return files


def _key(name: str) -> str:
    return name if name.replace("_", "").isalnum() and name.isascii() else json.dumps(name)


def _value(item: Any) -> str:
    if isinstance(item, Mapping):
        return f"{{ {', '.join(f'{_key(str(key))} = {_value(value)}' for key, value in item.items())} }}" if item else "{}"
    if isinstance(item, list | tuple):
        return f"[{', '.join(map(_value, item))}]"
    if isinstance(item, str):
        return json.dumps(item, ensure_ascii=False).replace("\x7f", "\\u007f")
    if isinstance(item, bool):
        return "true" if item else "false"
    return repr(float(item)) if isinstance(item, float) else str(item)
