"""Tables of the start of a case: conditions, trim, calibration of the instruments and drift."""

from __future__ import annotations

import math
from collections.abc import Collection, Mapping, Sequence
from typing import Any

import numpy as np

from pom.cases.job import STATED
from pom.cases.reference_states import CALIBRATION
from pom.judging.watched_channels import SLOWEST
from pom.replaying import run_remarks
from pom.replaying.trim import CONTROLS, result_trim_limits
from pom.report.case.panel_marks import FLOW_ANGLES
from pom.report.presentation.quantities import (
    MINUS,
    MISSING,
    QuantityLabel,
    fixed_decimals,
    format_number,
    measured_text,
    plain_measured_text,
    pretty_unit,
    quantity_label,
    short_number,
)
from pom.result import PomResult, to_records

# Quantities of the parts of the table of conditions, in the order of the rows.
_CONFIGURATION = (
    "mass",
    "x_cg",
    "x_cg_b",
    "y_cg_b",
    "z_cg_b",
    "Ixx",
    "Iyy",
    "Izz",
    "Ixy",
    "Ixz",
    "Iyz",
    "delta_f",
    "gear",
    "speedbrake",
)
_ATMOSPHERE = (
    "h",
    "h_agl",
    "h_baro",
    "p_static",
    "temperature",
    "rho",
    "delta_T",
    "qnh",
    "runway_elevation",
    "wind",
    "a_sound",
)
# Initial conditions in the line below the title of a case.
_GLANCE = (
    "mass",
    "x_cg",
    "x_cg_b",
    "delta_f",
    "gear",
    "speedbrake",
    "h",
    "h_agl",
    "delta_T",
    "wind",
)
_WIND = QuantityLabel("wind", "W", "", words="wind", unit="", sign="", factor=1.0, offset=0.0)
# A slower wind is calm, a slower vertical wind is not printed. [m/s]
_CALM = 0.05
# Small errors of force add up in a run of at least this length. [s]
_LONG = 20.0

_STATE, _CONTROLS = "State", "Controls as applied"
_BIASES, _RESIDUALS = "Biases found by the trim", "Accelerations left after the trim"

ConditionRow = tuple[QuantityLabel, str]


def condition_rows(
    conditions: Mapping[str, float], printed: Collection[str], stated: Collection[str] = ()
) -> list[tuple[str, list[ConditionRow]]]:
    """Return the conditions of a case by part of the table.

    Parameters
    ----------
    conditions : mapping of str to float
        Initial conditions and configuration. [SI]
    printed : collection of str
        Quantities of the flight state that the table of the trim has.  They are left out.
    stated : collection of str
        Quantities that the case states and its record does not have, which their rows say.

    Returns
    -------
    list of (str, list of (QuantityLabel, str))
        Title and rows of every part that has rows.
    """
    parts: dict[str, list[ConditionRow]] = {"Configuration": [], "Atmosphere": [], "Flight": []}
    for name, value in conditions.items():
        stem = _stem(name)
        part = _condition_part(stem)
        # The components of the wind have a common row.
        if stem.startswith("wind_") or (part == "Flight" and stem in printed):
            continue
        text = measured_text(value, name)
        if name in stated:
            text = f"{text} (stated, not recorded)"
        parts[part].append((quantity_label(name), text))
    if "wind_n" in conditions and "wind_e" in conditions:
        down = conditions.get("wind_d", 0.0)
        wind = wind_text(conditions["wind_n"], conditions["wind_e"], down)
        parts["Atmosphere"].append((_WIND, wind))
    _sort_rows(parts["Configuration"], _CONFIGURATION)
    _sort_rows(parts["Atmosphere"], _ATMOSPHERE)
    return [(part, rows) for part, rows in parts.items() if rows]


def stated_conditions(result: PomResult) -> list[str]:
    """Return the conditions of a result that its record does not show."""
    return str(result.signals.attrs.get(STATED, "")).split()


def glance_text(result: PomResult) -> str:
    """Return the main initial conditions of a case in one line."""
    texts: list[str] = []
    table = result.trim
    if "V_cas" in table.index:
        # the table of the trim has the flight first
        speed = float(table.iloc[:, 0]["V_cas"])
        if math.isfinite(speed):
            texts.append(f"{quantity_label('V_cas').words} {measured_text(speed, 'V_cas')}")
    for _, rows in condition_rows(result.conditions, table.index, stated_conditions(result)):
        for label, value in rows:
            if label.name in _GLANCE:
                texts.append(f"{label.words or label.name} {value}")
    if "h" in table.index and math.isfinite(float(table.iloc[:, 0]["h"])):
        height = measured_text(float(table.iloc[:, 0]["h"]), "h")
        texts.append(f"{quantity_label('h').words} {height}")
    # a height of record and state is printed once
    return ";  ".join(dict.fromkeys(texts))


def _stem(name: str) -> str:
    """Return the name of a quantity without its prefixes, such as ``engine1.``."""
    return name.rpartition(".")[2]


def _condition_part(stem: str) -> str:
    if stem in _CONFIGURATION:
        return "Configuration"
    if stem in _ATMOSPHERE:
        return "Atmosphere"
    return "Flight"


def _sort_rows(rows: list[ConditionRow], names: Sequence[str]) -> None:
    rows.sort(key=lambda row: names.index(_stem(row[0].name)))


def wind_text(north: float, east: float, down: float = 0.0) -> str:
    """Return a wind as pilots name it, by the bearing from which it blows.

    Parameters
    ----------
    north, east, down : float
        Velocity of the air mass. [m/s]

    Examples
    --------
    >>> wind_text(-5.0, 0.0)
    'from 360° true at 9.7 kt'
    """
    label, speed = quantity_label("V"), math.hypot(north, east)
    if speed < _CALM:
        return "calm"
    # The bearing is opposite to the velocity.  North is 360 degrees, not 0.
    bearing = round(math.degrees(math.atan2(-east, -north))) % 360 or 360
    text = (
        f"from {bearing:03d}° true at {fixed_decimals(float(label.shown(speed)), 1)} {label.unit}"
    )
    if abs(down) < _CALM:
        return text
    direction = "down" if down > 0 else "up"
    return f"{text}, {direction} {measured_text(abs(down), 'wind_d')}"


def trim_tables(result: PomResult) -> dict[str, Any]:
    """Return the table of the trim by part.

    A cell is marked if its bias or its acceleration is beyond the limit.
    """
    parts: dict[str, list[Any]] = {_STATE: [], _CONTROLS: [], _BIASES: [], _RESIDUALS: []}
    table = result.trim
    limits = result_trim_limits(result)
    is_standing = "V" in table.index and float(table.iloc[:, 0]["V"]) < SLOWEST
    for name, values in zip(map(str, table.index), table.to_numpy(float), strict=True):
        part = _trim_part(name)
        # A bias that no model has, and angles of flow at rest, carry no information.
        has_no_bias = part == _BIASES and not np.nan_to_num(values).any()
        if has_no_bias or (is_standing and name in FLOW_ANGLES):
            continue
        stem = _stem(name)
        limit = math.inf
        if name.startswith("trim.") and stem in limits:
            limit = limits[stem].size
        parts[part].append(_trim_row(name, values, limit))
    return {
        "columns": list(map(str, table.columns)),
        "parts": [(title, rows) for title, rows in parts.items() if rows],
    }


def _trim_part(name: str) -> str:
    """Return the part of the table of the trim that has the row of a quantity."""
    if name.startswith("trim."):
        return _RESIDUALS if name.endswith("_dot") else _BIASES
    if "." in name:
        return _RESIDUALS
    return _CONTROLS if name in CONTROLS else _STATE


def _trim_row(name: str, values: np.ndarray, limit: float) -> dict[str, Any]:
    """Return a row of the table of the trim.

    ``values`` has the flight first and then the models. [SI]
    """
    label, stem = quantity_label(name), _stem(name)
    cells = []
    for displayed, si in zip(label.shown(values), values, strict=True):
        cells.append((_value_text(displayed, label), abs(si) > limit))
    differences = []
    # The flight has no bias of the trim, so there is nothing to compare.
    if not name.startswith("trim."):
        for difference in label.width(values[1:] - values[0]):
            differences.append(_difference_text(difference, label))
    limit_text = ""
    if math.isfinite(limit):
        limit_text = f"± {short_number(float(label.width(limit)), 3)}"
    return {
        "label": label,
        "words": quantity_label(stem).words or stem,
        "cells": cells,
        "differences": differences,
        "limit": limit_text,
    }


def _value_text(value: float, label: QuantityLabel) -> str:
    return MISSING if np.isnan(value) else plain_measured_text(float(value), label.unit)


def _difference_text(value: float, label: QuantityLabel) -> str:
    """Return a difference with its sign; a rounded zero has none."""
    text = _value_text(value, label)
    is_zero = not text.strip("0.")
    if text == MISSING or text.startswith(MINUS) or is_zero:
        return text
    return f"+{text}"


def calibration_rows(result: PomResult) -> list[tuple[str, str]]:
    """Return the constants that corrected the instruments, with their standard errors."""
    rows: list[tuple[str, str]] = []
    if CALIBRATION not in result.signals.attrs:
        return rows
    for row in to_records(run_remarks.calibration(result)):
        si_unit = str(row["unit"])
        # Angles are printed in degrees, all else in SI.
        unit = {"rad": "deg", "rad s-1": "deg/s"}.get(si_unit, si_unit)
        scale = math.degrees(1.0) if unit != si_unit else 1.0
        estimate, stderr = scale * row["estimate"], scale * row["stderr"]
        # Two significant digits of the standard error.
        decimals = max(0, 1 - math.floor(math.log10(stderr))) if stderr > 0.0 else 4
        value = (
            f"{fixed_decimals(estimate, decimals)} ± {fixed_decimals(stderr, decimals)} "
            f"{pretty_unit(unit)}"
        )
        rows.append((_constant_words(str(row["parameter"])), value.strip()))
    return rows


_INSTRUMENTS = {
    "ax_imu": "specific force x",
    "ay_imu": "specific force y",
    "az_imu": "specific force z",
    "alpha_vane": "α vane",
    "beta_vane": "β vane",
    "h_radio": "radio altitude",
    "gps": "GPS",
    "temperature": "temperature",
    "p_reference": "reference pressure",
    "static_error": "static error over q̄",
}


def _constant_words(parameter: str) -> str:
    """Return a constant of the instruments in words.

    Examples
    --------
    >>> [_constant_words(name) for name in ("bias.ax_imu", "delay.air_data", "p_reference")]
    ['bias of specific force x', 'delay of air data', 'reference pressure']
    """
    kind, _, name = parameter.rpartition(".")
    quantity = _INSTRUMENTS.get(name) or quantity_label(name).words or name.replace("_", " ")
    return f"{kind} of {quantity}" if kind else quantity


def drift_rows(result: PomResult) -> list[tuple[QuantityLabel, str, str, str]]:
    """Return the drift of speed, height and heading of every model from the flight.

    Only long runs have rows.

    Returns
    -------
    list of (QuantityLabel, str, str, str)
        Channel, run, rate of the difference, and spread around its line.
    """
    time = result.signals["time"].values
    if time[-1] - time[0] < _LONG:
        return []
    rows = []
    for row in to_records(run_remarks.drift(result)):
        label = quantity_label(str(row["channel"]))
        rate = format_number(float(label.width(row["rate"])), 2)
        spread = format_number(float(label.width(row["spread"])), 2)
        rows.append((label, str(row["run"]), f"{rate} {label.unit}/s", f"{spread} {label.unit}"))
    return rows
