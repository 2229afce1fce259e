"""Bias of the trim on a thrust that nobody recorded, against the thrust of the model.

The trim balances a wrong drag by a bias on thrust or lever, which then hides it.  Table A2A limits
the bias by the recorded thrust.  Where a propeller, a pressure or a lever drives the model, its own
thrust takes the place of the recorded one.
"""

from __future__ import annotations

import re
from collections.abc import Iterable, Mapping

import numpy as np

from flightmech.names import value_text
from pom.cases.job import ReplayJob
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
