"""The start of a case: configuration, atmosphere, the trimmed state, what the trim found and what it left."""

from __future__ import annotations

import math
from collections.abc import Callable, Collection, Mapping, Sequence
from typing import Any

import numpy as np

from pom.judging.watch import SLOWEST
from pom.replaying import offsets
from pom.replaying.tables_left import FLOW
from pom.replaying.trim_state import CONTROLS, limits_of
from pom.result import PomResult, records

from ..presentation.quantities import MINUS, MISSING, Label, fixed, label, measured, number, plainly, pretty_unit, short

_CONFIGURATION = ("mass", "x_cg", "x_cg_b", "y_cg_b", "z_cg_b", "Ixx", "Iyy", "Izz", "Ixy", "Ixz", "Iyz", "delta_f", "gear", "speedbrake")
_ATMOSPHERE = ("h", "h_agl", "h_baro", "p_static", "temperature", "rho", "delta_T", "qnh", "runway_elevation", "wind", "a_sound")
_LONG = 20.0  # [s] from which small errors of force add up
_CALM = 0.05  # [m/s] a vertical wind below this is not printed


def conditions(found: Mapping[str, float], printed: Collection[str]) -> list[tuple[str, list[tuple[Label, str]]]]:
    """Return the conditions by part of the table; the flight state stands in the table of the trim, which has `printed` it."""
    parts: dict[str, list[tuple[Label, str]]] = {"Configuration": [], "Atmosphere": [], "Flight": []}
    for name, value in found.items():
        stem = name.rpartition(".")[2]
        part = "Configuration" if stem in _CONFIGURATION else "Atmosphere" if stem in _ATMOSPHERE else "Flight"
        if not stem.startswith("wind_") and (part != "Flight" or stem not in printed):
            parts[part].append((label(name), measured(value, name)))
    if {"wind_n", "wind_e"} <= set(found):
        parts["Atmosphere"].append((_WIND, wind(found["wind_n"], found["wind_e"], found.get("wind_d", 0.0))))
    for part, names in (("Configuration", _CONFIGURATION), ("Atmosphere", _ATMOSPHERE)):
        parts[part] = sorted(parts[part], key=_place_among(names))
    return [(part, rows) for part, rows in parts.items() if rows]


def _place_among(names: Sequence[str]) -> Callable[[tuple[Label, str]], int]:
    return lambda row: names.index(row[0].name.rpartition(".")[2])


_WIND = Label("wind", "W", "", "wind", "", "", 1.0, 0.0)


def wind(north: float, east: float, down: float = 0.0) -> str:
    """Return a wind as pilots name it, from where it blows.

    Parameters
    ----------
    north, east, down : float
        Velocity of the air mass. [m/s]

    Examples
    --------
    >>> wind(-5.0, 0.0)
    'from 360° true at 9.7 kt'
    """
    knots = float(label("V").shown(math.hypot(north, east)))
    if knots < 0.05:
        return "calm"
    bearing = round(math.degrees(math.atan2(-east, -north))) % 360 or 360
    rising = f", {'down' if down > 0 else 'up'} {measured(abs(down), 'wind_d')}" if abs(down) >= _CALM else ""
    return f"from {bearing:03d}° true at {fixed(knots, 1)} kt{rising}"


def trim(result: PomResult) -> dict[str, Any]:
    """Return the table of the trim in its parts; a bias or an acceleration beyond its limit is marked."""
    parts: dict[str, list[Any]] = {"State": [], "Controls as applied": [], _FOUND: [], _LEFT: []}
    table = result.trim
    limits = limits_of(result)
    standing = "V" in table.index and float(table.iloc[:, 0]["V"]) < SLOWEST
    for name, held in zip(map(str, table.index), table.to_numpy(float), strict=True):
        shown, stem = label(name), name.rpartition(".")[2]
        found, left = name.startswith("trim.") and not name.endswith("_dot"), name.startswith("trim.") and name.endswith("_dot")
        if (found and not np.nan_to_num(held).any()) or (standing and name in FLOW):
            continue
        part = _FOUND if found else _LEFT if left or "." in name else "Controls as applied" if stem in CONTROLS else "State"
        limit = limits[stem].size if (found or left) and stem in limits else math.inf
        cells = [(_value(v, shown), abs(si) > limit) for v, si in zip(shown.shown(held), held, strict=True)]
        differences = [] if found or left else [_difference(v, shown) for v in shown.width(held[1:] - held[0])]
        shown_limit = f"± {short(float(shown.width(limit)), 3)}" if math.isfinite(limit) else ""
        parts[part].append(
            {"label": shown, "words": label(stem).words or stem, "cells": cells, "differences": differences, "limit": shown_limit}
        )
    return {"columns": list(map(str, table.columns)), "parts": [(title, rows) for title, rows in parts.items() if rows]}


_FOUND, _LEFT = "Biases found by the trim", "Accelerations left after the trim"


def _value(value: float, shown: Label) -> str:
    return MISSING if np.isnan(value) else plainly(float(value), shown.unit)


def _difference(value: float, shown: Label) -> str:
    text = _value(value, shown)
    return text if text == MISSING or text.startswith(MINUS) or not text.strip("0.") else f"+{text}"


def calibration(result: PomResult) -> list[tuple[str, str]]:
    """Return the constants of the instruments by which the flight data were corrected, with their standard errors."""
    rows: list[tuple[str, str]] = []
    if offsets.CALIBRATION not in result.signals.attrs:
        return rows
    for row in records(offsets.calibration(result)):
        given = str(row["unit"])
        unit = {"rad": "deg", "rad s-1": "deg/s"}.get(given, given)
        scale = math.degrees(1.0) if unit != given else 1.0
        estimate, stderr = scale * row["estimate"], scale * row["stderr"]
        decimals = max(0, 1 - math.floor(math.log10(stderr))) if stderr > 0.0 else 4
        value = f"{fixed(estimate, decimals)} ± {fixed(stderr, decimals)} {pretty_unit(unit)}"
        rows.append((_constant(str(row["parameter"])), value.strip()))
    return rows


_INSTRUMENTS = {
    **{f"a{axis}_imu": f"specific force {axis}" for axis in "xyz"},
    "alpha_vane": "α vane",
    "beta_vane": "β vane",
    "h_radio": "radio altitude",
    "gps": "GPS",
    "temperature": "temperature",
    "p_reference": "reference pressure",
    "static_error": "static error over q̄",
}


def _constant(parameter: str) -> str:
    """Return a constant of the instruments in words.

    Examples
    --------
    >>> [_constant(name) for name in ("bias.ax_imu", "delay.air_data", "p_reference")]
    ['bias of specific force x', 'delay of air data', 'reference pressure']
    """
    kind, _, name = parameter.rpartition(".")
    quantity = _INSTRUMENTS.get(name) or label(name).words or name.replace("_", " ")
    return f"{kind} of {quantity}" if kind else quantity


def drift(result: PomResult) -> list[tuple[Label, str, str, str]]:
    """Return how fast speed, height and heading of every model leave those of the flight in a long run: channel, run, rate, spread."""
    time = result.signals["time"].values
    if time[-1] - time[0] < _LONG:
        return []
    rows = []
    for row in records(offsets.drift(result)):
        shown = label(str(row["channel"]))
        unit = shown.unit
        rate, spread = (number(float(shown.width(row[key])), 2) for key in ("rate", "spread"))
        rows.append((shown, str(row["run"]), f"{rate} {unit}/s", f"{spread} {unit}"))
    return rows
