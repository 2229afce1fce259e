"""What the math pilot did: how far he moved each control, how often at his limit, and how well he held his channels."""

from __future__ import annotations

import json
from collections.abc import Mapping, Sequence

import numpy as np
import pandas as pd

from flightmech.names import lookup
from flightmech.support.arrays import rms
from flightmech.units import from_si, parse

from ..cases.pilot import Loop, Pilot, shortest
from ..result import PomResult

PILOT = "pilot"  # attribute of the signals of a result: JSON
_PILOT_COLUMNS = ("run", "control", "gains", "mean", "rms", "largest", "at", "at_limit", "held")


def activity(
    run: str,
    loops: Sequence[Loop],
    time: np.ndarray,
    moved: Mapping[str, np.ndarray],
    targets: Mapping[str, np.ndarray],
    outputs: Mapping[str, np.ndarray],
) -> list[dict]:
    """Return one row per control that the math pilot moved in a run.

    Parameters
    ----------
    run : str
        The model.
    moved : mapping of str to array (time,)
        His corrections, as `pom.cases.pilot.Pilot.moved`. [SI of the control]
    targets, outputs : mapping of str to array (time,)
        The channels he held, recorded and of the model. [SI]

    Returns
    -------
    list of dict
        ``control``; ``gains``, his loops in words; ``mean``, ``rms`` and ``largest`` correction (signed) and its time ``at`` [s];
        ``at_limit``, the share of samples at which one of his loops was at its limit; ``held``, the rms by which each channel
        departed from its record, in words. [SI]
    """
    rows, cut = [], _cut(loops, time, targets, outputs)
    for control, correction in moved.items():
        mine = [loop for loop in loops if loop.control == control]
        known = np.isfinite(correction)
        if not known.any():
            continue
        used, when = correction[known], time[known]
        largest = int(np.argmax(np.abs(used)))
        rows.append(
            {
                "run": run,
                "control": control,
                "gains": "; ".join(_gains(loop) for loop in mine),
                "mean": float(used.mean()),
                "rms": rms(used),
                "largest": float(used[largest]),
                "at": float(when[largest]),
                "at_limit": float(np.mean(cut[control][known])),
                "held": ", ".join(_held(loop.channel, targets, outputs) for loop in mine),
            }
        )
    return rows


def pilot_activity(result: PomResult) -> pd.DataFrame:
    """Return the rows of `activity` of all models of a result; empty when no math pilot flew."""
    return pd.DataFrame(json.loads(result.signals.attrs.get(PILOT, "[]")), columns=list(_PILOT_COLUMNS))


def _cut(
    loops: Sequence[Loop], time: np.ndarray, targets: Mapping[str, np.ndarray], outputs: Mapping[str, np.ndarray]
) -> dict[str, np.ndarray]:
    """Return for every control whether a loop was at its limit: the loops once more, on what the model did."""
    pilot = Pilot(loops, time, targets)
    for k in range(time.size):
        pilot.controls(k, {name: float(outputs[name][k]) for name in pilot.channels})
    return pilot.cut


def _gains(loop: Loop) -> str:
    moved, held = (lookup(name).display_units for name in (loop.control, loop.channel))
    size = parse(held)[1] / parse(moved)[1]
    over = f"{moved}/{held}" if "/" not in held else f"{moved}/({held})"
    integral = f" {loop.integral * size:+.4g} {over} /s" if loop.integral else ""
    return f"{loop.gain * size:.4g} {over}{integral} x {loop.channel}, at most {from_si(loop.limit, moved):.3g} {moved}"


def _held(name: str, targets: Mapping[str, np.ndarray], outputs: Mapping[str, np.ndarray]) -> str:
    error_of = np.array([shortest(name, error) for error in targets[name] - outputs[name]])
    unit = lookup(name).display_units
    return f"{name} {np.sqrt(np.nanmean(error_of**2)) / parse(unit)[1]:.3g} {unit} rms"
