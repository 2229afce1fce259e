"""Description of the driving of a case: inputs of the models, loops and work of the math pilot."""

from __future__ import annotations

import math
from collections.abc import Iterable
from pathlib import Path
from typing import Any

import numpy as np

from pom.cases.case_inputs import PRIMARY
from pom.cases.pilot import PilotLoop
from pom.replaying.run_remarks import PILOT, pilot_activity
from pom.report.case.panels import split_inputs
from pom.report.presentation.quantities import (
    QuantityLabel,
    fixed_decimals,
    format_number,
    has_ends,
    measured_text,
    percent_text,
    plain_measured_text,
    quantity_label,
    short_number,
)
from pom.result import PomResult

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
    "torque": "the recorded torque drives the propeller",
    "rpm": "the recorded speed drives the propeller",
    "map": "the recorded manifold pressure drives the engine model",
    "none": "none: the aircraft has no engines",
}
_PROPELLER = {
    "lever": "a governor holds the speed of the propeller lever",
    "rpm": "a governor holds the recorded speed",
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
# An input that varies by less than this fraction of its mean is constant.
_CONSTANT = 1e-9


def describe_driving(result: PomResult) -> dict[str, Any]:
    """Return the driving of the models: in words, input by input, loop by loop."""
    drive = result.case.drive
    surfaces = _SURFACES.get(drive.surfaces, drive.surfaces)
    propeller = []
    if drive.engine in ("torque", "map"):
        propeller.append(("propeller", _PROPELLER.get(drive.propeller, drive.propeller)))
    how = [
        ("controls", _LAW if result.case.law else surfaces),
        ("engine", _ENGINE.get(drive.engine, drive.engine)),
        *propeller,
        ("start", _START.get(drive.trim, str(drive.trim))),
        ("wind", _WIND_INPUTS.get(result.case.wind, result.case.wind)),
        ("feedback", _feedback_words(result)),
        ("time shift", "none: flight and models share the clock of the record"),
    ]
    moving, steady = split_inputs(result)
    inputs = []
    for name in moving:
        inputs.append((quantity_label(name), _input_source(result, name), "moves, plotted"))
    for name in steady:
        value = _steady_text(result, name)
        inputs.append((quantity_label(name), _input_source(result, name), value))
    return {
        "how": how,
        "inputs": inputs,
        "loops": [_loop_row(loop) for loop in drive.pilot],
        "activity": _activity_rows(result),
    }


def _feedback_words(result: PomResult) -> str:
    """Return what corrects the models during the run."""
    case = result.case
    if case.law:
        moves = ", ".join(_control_words(case.law_moves))
        law = result.signals.attrs.get("control_law", Path(case.law).name)
        return (
            f"closed loop: the control law of the airplane ({law}) moves {moves}; it sees the "
            f"outputs of the model one sample late"
        )
    if not case.drive.pilot:
        return "none: open loop, nothing corrects the model during the run"
    # Several loops may move one control; a dictionary keeps the order and drops repetitions.
    controls = [loop.control for loop in case.drive.pilot]
    moves = ", ".join(dict.fromkeys(_control_words(controls)))
    return f"closed loop: the math pilot moves {moves}"


def _control_words(names: Iterable[str]) -> list[str]:
    return [quantity_label(name).words or name for name in names]


def _input_source(result: PomResult, name: str) -> str:
    """Return the source of an input, in words."""
    drive = result.case.drive
    if any(loop.control == name for loop in drive.pilot):
        return "recorded, plus math pilot"
    if name in result.case.law_moves:
        return "control law"
    if name in result.case.conditions:
        return "case file, held"
    if name in PRIMARY.get(drive.level, ()):
        return _SOURCES[drive.level]
    return "reconstructed" if name.startswith("wind_") else "recorded"


def _steady_text(result: PomResult, name: str) -> str:
    """Return the mean of an input that does not move, and its largest deviation."""
    values = result.inputs[name].values
    mean = float(values.mean())
    deviation = float(np.abs(values - values.mean()).max())
    if deviation < _CONSTANT * max(1.0, abs(mean)) or has_ends(name):
        return measured_text(mean, name)
    label = quantity_label(name)
    if label.unit:
        mean_text = plain_measured_text(float(label.shown(mean)), label.unit)
    else:
        # a share, such as that of a brake pedal: two digits of the deviation are enough
        mean_text = fixed_decimals(mean, max(0, 1 - math.floor(math.log10(deviation))))
    deviation_text = short_number(float(label.width(deviation)), 2)
    return f"{mean_text} ±\N{NO-BREAK SPACE}{deviation_text} {label.unit}".strip()


def _loop_row(loop: PilotLoop) -> dict[str, Any]:
    """Return one loop of the math pilot in display units."""
    control, channel = quantity_label(loop.control), quantity_label(loop.channel)
    integral = "none"
    if loop.integral:
        # The integral gain is per second of the accumulated difference.
        integral = f"{_gain_text(loop.integral, control, channel)} and s"
    limit = format_number(float(control.width(loop.limit)))
    return {
        "control": control,
        "channel": channel,
        "gain": _gain_text(loop.gain, control, channel),
        "integral": integral,
        "limit": f"± {limit} {control.unit}".strip(),
    }


def _gain_text(gain: float, control: QuantityLabel, channel: QuantityLabel) -> str:
    """Return a gain in display units of control and channel; ``gain`` is in SI."""
    number = format_number(gain * control.factor / channel.factor)
    return f"{number} {control.unit or '1'} per {channel.unit or '1'}"


def _activity_rows(result: PomResult) -> list[dict[str, Any]]:
    """Return the motion that the math pilot added to each control, model by model."""
    rows: list[dict[str, Any]] = []
    if PILOT not in result.signals.attrs:
        return rows
    for row in pilot_activity(result).to_dict("records"):
        control = quantity_label(row["control"])
        rms = format_number(float(control.width(row["rms"])), 2)
        largest = format_number(float(control.width(row["largest"])), 2)
        instant = fixed_decimals(row["at"], 1)
        rows.append(
            {
                "run": row["run"],
                "control": control,
                "rms": f"{rms} {control.unit}".strip(),
                "largest": f"{largest} {control.unit} at {instant} s",
                "at_limit": percent_text(row["at_limit"]),
                "held": row["held"],
            }
        )
    return rows
