"""The start of a case: configuration, atmosphere, the trimmed state, what the trim found and what it left."""

from __future__ import annotations

import math
from collections.abc import Callable, Collection, Mapping, Sequence
from typing import Any

import numpy as np
import pandas as pd

from pom.replaying import LARGEST_BIAS, SURFACES

from .quantities import MISSING, Label, fixed, label, measured, plainly, short

_CONFIGURATION = ("mass", "x_cg", "x_cg_b", "y_cg_b", "z_cg_b", "Ixx", "Iyy", "Izz", "Ixy", "Ixz", "Iyz", "delta_f", "gear", "speedbrake")
_ATMOSPHERE = ("h", "h_agl", "h_baro", "p_static", "temperature", "rho", "delta_T", "qnh", "runway_elevation", "wind", "a_sound")
_CALM = 0.05  # [m/s] a vertical wind below this is not told


def conditions(found: Mapping[str, float], told: Collection[str]) -> list[tuple[str, list[tuple[Label, str]]]]:
    """Return the conditions by part of the table; the flight state stands in the table of the trim, which has `told` it."""
    parts: dict[str, list[tuple[Label, str]]] = {"Configuration": [], "Atmosphere": [], "Flight": []}
    for name, value in found.items():
        stem = name.rpartition(".")[2]
        part = "Configuration" if stem in _CONFIGURATION else "Atmosphere" if stem in _ATMOSPHERE else "Flight"
        if not stem.startswith("wind_") and (part != "Flight" or stem not in told):
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


def trim(table: pd.DataFrame) -> dict[str, Any]:
    """Return the table of the trim in its parts; a surface bias beyond its limit is marked."""
    parts: dict[str, list[Any]] = {
        "State": [],
        "Controls as applied": [],
        "Biases found by the trim": [],
        "Accelerations left after the trim": [],
    }
    for quantity, values in table.iterrows():
        name = str(quantity)
        shown, stem = label(name), name.rpartition(".")[2]
        held = values.to_numpy(float)
        if name.startswith("trim.") and not name.endswith("_dot"):
            if not np.nan_to_num(held).any():
                continue
            part = "Biases found by the trim"
        else:
            part = "Accelerations left after the trim" if "." in name else "Controls as applied" if stem.startswith("delta_") else "State"
        beyond = [name in SURFACES and abs(value) > LARGEST_BIAS for value in held]
        cells = [(MISSING if np.isnan(v) else plainly(float(v), shown.unit), out) for v, out in zip(shown.shown(held), beyond, strict=True)]
        parts[part].append((shown, label(stem).words or stem, cells))
    limit = f"surfaces at most ± {short(math.degrees(LARGEST_BIAS))} deg; beyond it marked ▲"
    return {
        "columns": list(map(str, table.columns)),
        "parts": [(title, limit if title.startswith("Biases") else "", rows) for title, rows in parts.items() if rows],
    }
