"""The start of a case: configuration, atmosphere, the trimmed state, what the trim found and what
it left.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Collection, Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from pom.cases.case import PRIMARY
from pom.cases.pilot import PilotLoop
from pom.cases.reference_states import CALIBRATION
from pom.judging.beyond_the_bands import SLOWEST
from pom.replaying import run_remarks
from pom.replaying.run_remarks import FLOW, PILOT, pilot_activity
from pom.replaying.trim import CONTROLS, result_trim_limits
from pom.report.case.panels import split_inputs
from pom.report.presentation.quantities import (
    MINUS,
    MISSING,
    QuantityLabel,
    fixed_decimals,
    format_number,
    has_ends,
    measured_text,
    percent_text,
    plain_measured_text,
    pretty_unit,
    quantity_label,
    short_number,
)
from pom.result import PomResult, to_records

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
_LONG = 20.0  # [s] from which small errors of force add up
_CALM = 0.05  # [m/s] a vertical wind below this is not printed


def condition_rows(
    found: Mapping[str, float], printed: Collection[str]
) -> list[tuple[str, list[tuple[QuantityLabel, str]]]]:
    """Return the conditions by part of the table; the flight state stands in the table of the trim,
    which has `printed` it.
    """
    parts: dict[str, list[tuple[QuantityLabel, str]]] = {
        "Configuration": [],
        "Atmosphere": [],
        "Flight": [],
    }
    for name, value in found.items():
        stem = name.rpartition(".")[2]
        part = (
            "Configuration"
            if stem in _CONFIGURATION
            else "Atmosphere"
            if stem in _ATMOSPHERE
            else "Flight"
        )
        if not stem.startswith("wind_") and (part != "Flight" or stem not in printed):
            parts[part].append((quantity_label(name), measured_text(value, name)))
    if {"wind_n", "wind_e"} <= set(found):
        parts["Atmosphere"].append(
            (_WIND, wind_text(found["wind_n"], found["wind_e"], found.get("wind_d", 0.0)))
        )
    for part, names in (("Configuration", _CONFIGURATION), ("Atmosphere", _ATMOSPHERE)):
        parts[part] = sorted(parts[part], key=_place_among(names))
    return [(part, rows) for part, rows in parts.items() if rows]


def _place_among(names: Sequence[str]) -> Callable[[tuple[QuantityLabel, str]], int]:
    return lambda row: names.index(row[0].name.rpartition(".")[2])


_WIND = QuantityLabel("wind", "W", "", "wind", "", "", 1.0, 0.0)


def wind_text(north: float, east: float, down: float = 0.0) -> str:
    """Return a wind as pilots name it, from where it blows.

    Parameters
    ----------
    north, east, down : float
        Velocity of the air mass. [m/s]

    Examples
    --------
    >>> wind_text(-5.0, 0.0)
    'from 360° true at 9.7 kt'
    """
    knots = float(quantity_label("V").shown(math.hypot(north, east)))
    if knots < 0.05:
        return "calm"
    bearing = round(math.degrees(math.atan2(-east, -north))) % 360 or 360
    rising = (
        f", {'down' if down > 0 else 'up'} {measured_text(abs(down), 'wind_d')}"
        if abs(down) >= _CALM
        else ""
    )
    return f"from {bearing:03d}° true at {fixed_decimals(knots, 1)} kt{rising}"


def trim_tables(result: PomResult) -> dict[str, Any]:
    """Return the table of the trim in its parts; a bias or an acceleration beyond its limit is
    marked.
    """
    parts: dict[str, list[Any]] = {"State": [], "Controls as applied": [], _FOUND: [], _LEFT: []}
    table = result.trim
    limits = result_trim_limits(result)
    standing = "V" in table.index and float(table.iloc[:, 0]["V"]) < SLOWEST
    for name, held in zip(map(str, table.index), table.to_numpy(float), strict=True):
        shown, stem = quantity_label(name), name.rpartition(".")[2]
        found, left = (
            name.startswith("trim.") and not name.endswith("_dot"),
            name.startswith("trim.") and name.endswith("_dot"),
        )
        if (found and not np.nan_to_num(held).any()) or (standing and name in FLOW):
            continue
        part = (
            _FOUND
            if found
            else _LEFT
            if left or "." in name
            else "Controls as applied"
            if stem in CONTROLS
            else "State"
        )
        limit = limits[stem].size if (found or left) and stem in limits else math.inf
        cells = [
            (_value(v, shown), abs(si) > limit)
            for v, si in zip(shown.shown(held), held, strict=True)
        ]
        differences = (
            []
            if found or left
            else [_difference(v, shown) for v in shown.width(held[1:] - held[0])]
        )
        shown_limit = (
            f"± {short_number(float(shown.width(limit)), 3)}" if math.isfinite(limit) else ""
        )
        parts[part].append(
            {
                "label": shown,
                "words": quantity_label(stem).words or stem,
                "cells": cells,
                "differences": differences,
                "limit": shown_limit,
            }
        )
    return {
        "columns": list(map(str, table.columns)),
        "parts": [(title, rows) for title, rows in parts.items() if rows],
    }


_FOUND, _LEFT = "Biases found by the trim", "Accelerations left after the trim"


def _value(value: float, shown: QuantityLabel) -> str:
    return MISSING if np.isnan(value) else plain_measured_text(float(value), shown.unit)


def _difference(value: float, shown: QuantityLabel) -> str:
    text = _value(value, shown)
    return text if text == MISSING or text.startswith(MINUS) or not text.strip("0.") else f"+{text}"


def calibration_rows(result: PomResult) -> list[tuple[str, str]]:
    """Return the constants of the instruments by which the flight data were corrected, with their
    standard errors.
    """
    rows: list[tuple[str, str]] = []
    if CALIBRATION not in result.signals.attrs:
        return rows
    for row in to_records(run_remarks.calibration(result)):
        given = str(row["unit"])
        unit = {"rad": "deg", "rad s-1": "deg/s"}.get(given, given)
        scale = math.degrees(1.0) if unit != given else 1.0
        estimate, stderr = scale * row["estimate"], scale * row["stderr"]
        decimals = max(0, 1 - math.floor(math.log10(stderr))) if stderr > 0.0 else 4
        value = (
            f"{fixed_decimals(estimate, decimals)} ± {fixed_decimals(stderr, decimals)} "
            f"{pretty_unit(unit)}"
        )
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
    quantity = _INSTRUMENTS.get(name) or quantity_label(name).words or name.replace("_", " ")
    return f"{kind} of {quantity}" if kind else quantity


def drift_rows(result: PomResult) -> list[tuple[QuantityLabel, str, str, str]]:
    """Return how fast speed, height and heading of every model leave those of the flight in a long
    run: channel, run, rate, spread.
    """
    time = result.signals["time"].values
    if time[-1] - time[0] < _LONG:
        return []
    rows = []
    for row in to_records(run_remarks.drift(result)):
        shown = quantity_label(str(row["channel"]))
        unit = shown.unit
        rate, spread = (
            format_number(float(shown.width(row[key])), 2) for key in ("rate", "spread")
        )
        rows.append((shown, str(row["run"]), f"{rate} {unit}/s", f"{spread} {unit}"))
    return rows


_SURFACES = {
    "recorded": "recorded surface positions drive the model; augmentation of the airplane, if "
    "any, is in the record",
    "cockpit": "recorded travel of column, wheel and pedals drives the control system of the model",
    "force": "recorded pilot forces drive the control system of the model",
    "pilot": "the recorded controls drive the model, a math pilot adds to them",
}
_LAW = "the control law moves what it is named for, recorded surface positions drive the rest"
_ENGINE = {
    "thrust": "recorded thrust drives the model",
    "n1": "the recorded fan speed drives the engine model",
    "throttle": "the recorded lever drives the engine model",
}
_START = {
    True: "trimmed to the flight state; the residual stands below",
    False: "flight state, not trimmed",
    "ground": "on its wheels at the recorded speed; height and attitude from the landing gear",
}
_WIND_INPUTS = {
    "record": "as reconstructed from the record, an input of the model",
    "measured": "as measured in the record, an input of the model",
    "none": "calm air",
}
_SOURCES = {
    "recorded": "recorded surface",
    "cockpit": "recorded position",
    "force": "recorded force",
}


def describe_driving(result: PomResult) -> dict[str, Any]:
    """Return how the models were driven: in words, input by input, loop by loop."""
    drive = result.case.drive
    how = [
        ("controls", _LAW if result.case.law else _SURFACES.get(drive.surfaces, drive.surfaces)),
        ("engine", _ENGINE.get(drive.engine, drive.engine)),
        ("start", _START.get(drive.trim, str(drive.trim))),
        ("wind", _WIND_INPUTS.get(result.case.wind, result.case.wind)),
        ("feedback", _feedback(result)),
        ("time shift", "none: flight and models share the clock of the record"),
    ]
    moving, still = split_inputs(result)
    inputs = [(quantity_label(name), _source(result, name), "moves, plotted") for name in moving]
    inputs += [
        (quantity_label(name), _source(result, name), _steady(result, name)) for name in still
    ]
    return {
        "how": how,
        "inputs": inputs,
        "loops": [_loop(loop) for loop in drive.pilot],
        "activity": _activity(result),
    }


def _feedback(result: PomResult) -> str:
    if result.case.law:
        moved = ", ".join(quantity_label(name).words or name for name in result.case.law_moves)
        law = result.signals.attrs.get("control_law", Path(result.case.law).name)
        return (
            f"closed loop: the control law of the airplane ({law}) moves {moved}; it sees the "
            f"outputs of the model one sample late"
        )
    if not result.case.drive.pilot:
        return "none: open loop, nothing corrects the model during the run"
    moved = ", ".join(
        dict.fromkeys(
            quantity_label(loop.control).words or loop.control for loop in result.case.drive.pilot
        )
    )
    return f"closed loop: the math pilot moves {moved}"


def _source(result: PomResult, name: str) -> str:
    """Return where an input comes from."""
    drive = result.case.drive
    if name in {loop.control for loop in drive.pilot}:
        return "recorded, plus math pilot"
    if name in result.case.law_moves:
        return "control law"
    if name in result.case.conditions:
        return "case file, held"
    if name in PRIMARY.get(drive.level, ()):
        return _SOURCES[drive.level]
    return "reconstructed" if name.startswith("wind_") else "recorded"


def _steady(result: PomResult, name: str) -> str:
    """Return an input that does not move: its mean, and how far the record strays from it."""
    values = result.inputs[name].values
    mean, stray = float(values.mean()), float(np.abs(values - values.mean()).max())
    shown = quantity_label(name)
    if stray < 1e-9 * max(1.0, abs(mean)) or has_ends(name):
        return measured_text(mean, name)
    value = (
        f"{plain_measured_text(float(shown.shown(mean)), shown.unit)} "
        f"±\N{NO-BREAK SPACE}{short_number(float(shown.width(stray)), 2)}"
    )
    return f"{value} {shown.unit}".strip()


def _loop(loop: PilotLoop) -> dict[str, Any]:
    """Return one loop of the math pilot."""
    control, channel = quantity_label(loop.control), quantity_label(loop.channel)
    return {
        "control": control,
        "channel": channel,
        "gain": _gain(loop.gain, control, channel, ""),
        "integral": _gain(loop.integral, control, channel, " and s") if loop.integral else "none",
        "limit": f"± {format_number(float(control.width(loop.limit)))} {control.unit}".strip(),
    }


def _gain(value: float, control: QuantityLabel, channel: QuantityLabel, per: str) -> str:
    """Return a gain in display units of control and channel."""
    return (
        f"{format_number(value * control.factor / channel.factor)} {control.unit or '1'} per "
        f"{channel.unit or '1'}{per}"
    )


def _activity(result: PomResult) -> list[dict[str, Any]]:
    """Return what the math pilot added to each control, model by model."""
    rows: list[dict[str, Any]] = []
    if PILOT not in result.signals.attrs:
        return rows
    for row in pilot_activity(result).to_dict("records"):
        control = quantity_label(row["control"])
        rms, largest = (
            format_number(float(control.width(row[key])), 2) for key in ("rms", "largest")
        )
        rows.append(
            {
                "run": row["run"],
                "control": control,
                "rms": f"{rms} {control.unit}".strip(),
                "largest": f"{largest} {control.unit} at {fixed_decimals(row['at'], 1)} s",
                "at_limit": percent_text(row["at_limit"]),
                "held": row["held"],
            }
        )
    return rows
