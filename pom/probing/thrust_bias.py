"""Bias of the trim on thrust or lever, and the thrust of the model against the recorded one.

The trim balances a wrong drag by a bias on thrust or lever, which then hides it.  Table A2A limits
the bias on a recorded thrust.  Where a propeller, a pressure or a lever drives the model, its own
thrust takes the place of a recorded one, or is compared with it: a wrong engine and a wrong drag
that cancel each other need no bias, and a lever has a large effect within its limit.
"""

from __future__ import annotations

import re
from collections.abc import Iterable, Mapping

import numpy as np

from flightmech.names import value_text
from pom.cases.job import TRIM_THROTTLE, TRIM_THRUST, ReplayJob
from pom.status import unprobed_remark
from pom.tolerances.bands import RowRemark

MOST = 0.05
"""Share of the model's largest thrust in the window; that of 2.c.5 of Table A2A."""
LEAST_ACCELERATION = 0.05
"""Acceleration by the added thrust below which it is not a departure, as a trim may leave it.
[m/s2]

Near idle the model has hardly any thrust, and a share of it no meaning.
"""
THRUST = re.compile(r"^engine\d+\.thrust$")
_LEVER = "engine1.throttle"
_LEAST_RANGE = 0.1  # movement of a lever that shows its effect on the thrust
QUANTITY = "trim.thrust"
STEADY = 1.0
"""Time from the start over which thrusts are compared, in the balance that the trim found. [s]"""
CANCELLING = (
    "not visible: an error of the recorded thrust, which drives the model, and one of the drag "
    "that cancel each other"
)
"""What no steady flight shows if thrust and drag come from the same record."""


def thrust_bias_remarks(
    job: ReplayJob, outputs: Mapping[str, np.ndarray], recorded: Iterable[str]
) -> tuple[RowRemark, ...]:
    """Return the remark on the thrust that the trim adds to a model; empty without a bias.

    Parameters
    ----------
    job : ReplayJob
    outputs : mapping of str to array (time,)
        Of the model: thrust of its engines, ``trim.thrust``, ``trim.throttle``. [SI]
    recorded : iterable of str
        Channels of the flight.  With a thrust among them the limits of the trim apply.

    Returns
    -------
    tuple of RowRemark
        Of kind ``departure`` beyond `MOST` and `LEAST_ACCELERATION`, else ``probe``, or
        ``not_probed`` for a model that does not report its thrust.
    """
    if any(THRUST.match(name) for name in recorded):
        return ()
    thrust_bias, lever_bias = (_first(outputs, f"trim.{name}") for name in ("thrust", "throttle"))
    if not thrust_bias and not lever_bias:
        return ()
    # the outputs hold the bias, which is added to each engine
    thrusts = [values - thrust_bias for name, values in outputs.items() if THRUST.match(name)]
    largest = max((float(np.nanmax(np.abs(values))) for values in thrusts), default=0.0)
    if not largest > 0.0:
        reason = "neither the record nor the model has a thrust"
        return (unprobed_remark("the bias of the trim on the thrust", reason, QUANTITY),)
    added, source = thrust_bias, ""
    if lever_bias:
        added += lever_bias * _lever_effect(job, outputs, lever_bias)
        source = f", from {100.0 * lever_bias:+.2g} % of the lever"
    share = abs(added) / largest
    text = (
        f"the trim adds {value_text('engine1.thrust', added, '+.3g')} to the thrust{source}: "
        f"{100.0 * share:.2g} % of the model's largest in the window (limit {100.0 * MOST:g} %; "
        f"the record has no thrust)"
    )
    mass = job.parameters.get("mass.mass", np.nan)
    acceleration = len(thrusts) * abs(added) / mass
    if share > MOST and acceleration <= LEAST_ACCELERATION:
        text += (
            f"; it accelerates the aeroplane by {acceleration:.2g} m/s2, within the "
            f"{LEAST_ACCELERATION:g} m/s2 that a trim may leave"
        )
    elif share > MOST:
        reason = f"departure: {text}. The drag or the thrust of the model is wrong by as much"
        return (RowRemark("departure", reason, QUANTITY, values={"share": share}, unit="1"),)
    return (RowRemark("probe", text, QUANTITY, values={"share": share}, unit="1"),)


def recorded_thrust_remarks(
    job: ReplayJob, outputs: Mapping[str, np.ndarray], recorded: Mapping[str, np.ndarray]
) -> tuple[RowRemark, ...]:
    """Return the remarks on the thrust of a model that is trimmed in flight, where it is recorded.

    Parameters
    ----------
    job : ReplayJob
    outputs : mapping of str to array (time,)
        Of the model. [SI]
    recorded : mapping of str to array (time,)
        Channels of the flight at the instants of the job. [SI]

    Returns
    -------
    tuple of RowRemark
        Of kind ``departure`` if thrusts at the start differ by more than `MOST` of the largest
        recorded one, or if the bias of the lever is worth as much, and by `LEAST_ACCELERATION`.
        Else ``probe``.  Empty without a recorded thrust.
    """
    names = [name for name in outputs if THRUST.match(name) and name in recorded]
    if not names or job.parameters.get("mode.trim") not in (TRIM_THRUST, TRIM_THROTTLE):
        return ()
    if any(name.endswith(".thrust_drive") for name in job.inputs):
        return (RowRemark("probe", CANCELLING, QUANTITY),)
    flight = np.sum([recorded[name] for name in names], axis=0)
    largest = float(np.nanmax(np.abs(flight), initial=0.0))
    is_start = job.time <= job.time[0] + STEADY
    model = np.sum([outputs[name] for name in names], axis=0)
    difference = float(np.mean((model - flight)[is_start]))
    if not largest > 0.0 or not np.isfinite(difference):
        return (unprobed_remark("the thrust of the model", "a sample is missing", QUANTITY),)
    mass = job.parameters.get("mass.mass", np.nan)
    thrust_text = (
        f"the thrust of the model at the start differs from the recorded one by "
        f"{value_text('engine1.thrust', difference, '+.3g')}"
    )
    remarks = [
        _judge_thrust(
            thrust_text, difference, largest, mass, "Engine and drag of the model are wrong alike"
        )
    ]
    lever_bias = _first(outputs, "trim.throttle")
    if lever_bias and _LEVER not in job.inputs:
        remarks.append(unprobed_remark("the bias of the lever", f"no input {_LEVER}", QUANTITY))
    elif lever_bias:
        added = len(names) * lever_bias * _lever_effect(job, outputs, lever_bias)
        lever_text = (
            f"the trim moves the lever by {100.0 * lever_bias:+.2g} % of its travel, which adds "
            f"{value_text('engine1.thrust', added, '+.3g')}"
        )
        reason = "The recorded lever, or the engine of the model over its lever, is wrong"
        remarks.append(_judge_thrust(lever_text, added, largest, mass, reason))
    return tuple(remarks)


def _judge_thrust(text: str, added: float, largest: float, mass: float, reason: str) -> RowRemark:
    """Return the remark on a thrust [N] that is a share of the largest recorded one."""
    share = abs(added) / largest
    text += (
        f": {100.0 * share:.2g} % of the largest recorded in the window (limit {100.0 * MOST:g} %)"
    )
    values = {"share": share}
    if share <= MOST or abs(added) / mass <= LEAST_ACCELERATION:
        return RowRemark("probe", text, QUANTITY, values=values, unit="1")
    text = f"departure: {text}. {reason}"
    return RowRemark("departure", text, QUANTITY, values=values, unit="1")


def _first(outputs: Mapping[str, np.ndarray], name: str) -> float:
    """Return the constant value of a bias; zero without it or without a number."""
    value = float(outputs[name][0]) if name in outputs else 0.0
    return value if np.isfinite(value) else 0.0


def _lever_effect(job: ReplayJob, outputs: Mapping[str, np.ndarray], lever_bias: float) -> float:
    """Return the thrust per travel of the lever. [N]

    It is the slope over the window if the lever moves there, else thrust over position, which an
    engine exceeds above its idle.
    """
    if _LEVER not in job.inputs or "engine1.thrust" not in outputs:
        return 0.0
    lever, thrust = job.inputs[_LEVER] + lever_bias, outputs["engine1.thrust"]
    is_known = np.isfinite(lever) & np.isfinite(thrust)
    lever, thrust = lever[is_known], thrust[is_known]
    if not lever.size:
        return 0.0
    if np.ptp(lever) >= _LEAST_RANGE:
        return float(np.polyfit(lever, thrust, 1)[0])
    return float(thrust[0] / max(lever[0], _LEAST_RANGE))
