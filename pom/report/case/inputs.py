"""How the models of a case were driven: what drives them, every input with its source, the loops of the math pilot."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np

from pom.cases.case import PRIMARY
from pom.cases.pilot import Loop
from pom.replaying.piloting import PILOT, pilot_activity
from pom.result import PomResult

from ..presentation.quantities import Label, fixed, has_ends, label, measured, number, percent, plainly, short
from .panels import split_inputs

_SURFACES = {
    "recorded": "recorded surface positions drive the model; augmentation of the airplane, if any, is in the record",
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
_SOURCES = {"recorded": "recorded surface", "cockpit": "recorded position", "force": "recorded force"}


def driving(result: PomResult) -> dict[str, Any]:
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
    inputs = [(label(name), _source(result, name), "moves, plotted") for name in moving]
    inputs += [(label(name), _source(result, name), _steady(result, name)) for name in still]
    return {"how": how, "inputs": inputs, "loops": [_loop(loop) for loop in drive.pilot], "activity": _activity(result)}


def _feedback(result: PomResult) -> str:
    if result.case.law:
        moved = ", ".join(label(name).words or name for name in result.case.law_moves)
        law = result.signals.attrs.get("control_law", Path(result.case.law).name)
        return f"closed loop: the control law of the airplane ({law}) moves {moved}; it sees the outputs of the model one sample late"
    if not result.case.drive.pilot:
        return "none: open loop, nothing corrects the model during the run"
    moved = ", ".join(dict.fromkeys(label(loop.control).words or loop.control for loop in result.case.drive.pilot))
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
    shown = label(name)
    if stray < 1e-9 * max(1.0, abs(mean)) or has_ends(name):
        return measured(mean, name)
    value = f"{plainly(float(shown.shown(mean)), shown.unit)} ±\N{NO-BREAK SPACE}{short(float(shown.width(stray)), 2)}"
    return f"{value} {shown.unit}".strip()


def _loop(loop: Loop) -> dict[str, Any]:
    """Return one loop of the math pilot."""
    control, channel = label(loop.control), label(loop.channel)
    return {
        "control": control,
        "channel": channel,
        "gain": _gain(loop.gain, control, channel, ""),
        "integral": _gain(loop.integral, control, channel, " and s") if loop.integral else "none",
        "limit": f"± {number(float(control.width(loop.limit)))} {control.unit}".strip(),
    }


def _gain(value: float, control: Label, channel: Label, per: str) -> str:
    """Return a gain in display units of control and channel."""
    return f"{number(value * control.factor / channel.factor)} {control.unit or '1'} per {channel.unit or '1'}{per}"


def _activity(result: PomResult) -> list[dict[str, Any]]:
    """Return what the math pilot added to each control, model by model."""
    rows: list[dict[str, Any]] = []
    if PILOT not in result.signals.attrs:
        return rows
    for row in pilot_activity(result).to_dict("records"):
        control = label(row["control"])
        rms, largest = (number(float(control.width(row[key])), 2) for key in ("rms", "largest"))
        rows.append(
            {
                "run": row["run"],
                "control": control,
                "rms": f"{rms} {control.unit}".strip(),
                "largest": f"{largest} {control.unit} at {fixed(row['at'], 1)} s",
                "at_limit": percent(row["at_limit"]),
                "held": row["held"],
            }
        )
    return rows
