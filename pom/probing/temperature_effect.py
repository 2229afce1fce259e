"""What a doubtful temperature of the air does to the judged quantities of a model.

The air decides density and true airspeed, and no row judges them.  A hot day is honest, a wrong
probe is not, and a record of level flight shows both alike.  The model flies once more in the air
that the doubt supposes; rows judge that flight against the first one, as they judge a model against
a flight.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import replace

import numpy as np

from flightmech.air import P_SEA, atmosphere
from pom.cases.job import ReplayJob
from pom.fmu.models import FmuModel
from pom.fmu.run_cache import KeptFlights
from pom.fmu.simulate import fly_job
from pom.judging.air_checks import AIR, SPEED
from pom.judging.verdict import judge_criterion
from pom.result import PomResult
from pom.status import unprobed_remark
from pom.tolerances.bands import RowRemark
from pom.tolerances.channels import plain_words

_PROBE = "the effect of the temperature"
MATTERS = 0.25
"""Share of a tolerance that a doubtful temperature moves, from which on it is a departure.

Our number: four doubts of this size together are a tolerance.
"""


def temperature_doubt(result: PomResult, run: str) -> RowRemark | None:
    """Return the remark with the largest doubt about the temperature; None without a doubt."""
    remarks = {}
    for row in result.rows:
        if row["run"] == run:
            for remark in row["remarks"]:
                if remark.quantity in (AIR, SPEED) and "error" in remark.values:
                    remarks[remark.text] = remark
    if not remarks:
        return None
    # a contradiction of two channels is stronger than unusual weather
    return max(
        remarks.values(), key=lambda item: (item.quantity == SPEED, abs(item.values["error"]))
    )


def supposed_air(job: ReplayJob, doubt: RowRemark) -> ReplayJob | None:
    """Return the job in the air without the doubted error; None if the job has no such air."""
    given = job.parameters
    if not {"env.delta_T", "env.qnh", "init.V", "init.h"} <= set(given):
        return None
    h, delta_T = given["init.h"], given["env.delta_T"]
    less = delta_T - doubt.values["error"]
    before, after = atmosphere(h, delta_T), atmosphere(h, less)
    # the static pressure was measured: it stays
    p = given["env.qnh"] * float(before.p_static) / P_SEA
    changed = {"env.delta_T": less, "env.qnh": P_SEA * p / float(after.p_static)}
    if doubt.quantity == AIR:
        # the true airspeed was computed with the doubted temperature: V ~ sqrt(T) at equal
        # calibrated airspeed and pressure
        share = float(np.sqrt(after.temperature / before.temperature))
        changed["init.V"] = given["init.V"] * share
    return replace(job, parameters={**given, **changed})


def weigh_temperature(
    result: PomResult,
    run: str,
    model: FmuModel,
    job: ReplayJob,
    outputs: Mapping[str, np.ndarray],
    timeout: float,
    store: KeptFlights | None = None,
) -> tuple[RowRemark, ...]:
    """Return the remark on the effect of a doubtful temperature; empty without a doubt.

    Parameters
    ----------
    result : PomResult
    run : str
        A model that passes.
    model, job, outputs
        The model, its job, and its outputs (time,) by name.
    timeout, store
        As `pom.fmu.simulate.fly_job`.

    Returns
    -------
    tuple of RowRemark
        Of kind ``departure`` from `MATTERS` on, else ``probe``.
    """
    doubt = temperature_doubt(result, run)
    if doubt is None:
        return ()
    if doubt.quantity == AIR and "delta_T" in result.case.conditions:
        text = "the temperature is confirmed by 'delta_T' of the case; its effect is not weighed"
        return (RowRemark("probe", text, AIR),)
    changed = supposed_air(job, doubt)
    if changed is None:
        return (unprobed_remark(_PROBE, "the record sets no air of the model", AIR),)
    names = [name for name in outputs if name in model.links.outputs]
    after, failure = fly_job(model, changed, names, timeout=timeout, store=store)
    error = doubt.values["error"]
    if failure:
        text = f"departure: the flight in air {-error:+.0f} K off the record failed: {failure}"
        return (RowRemark("departure", text, AIR),)
    effects: dict[str, float] = {}
    unlike = []
    for criterion in result.case.criteria:
        if not criterion.applies:
            continue
        outcome = judge_criterion(result.case, criterion, job.time, outputs, after)
        # A mode that the other air takes away has no ratio, and is more than any ratio.
        if outcome.fails_without_ratio:
            unlike.append(criterion.name)
        elif math.isfinite(outcome.worst_ratio):
            effects[criterion.name] = outcome.worst_ratio
    air = f"air {-error:+.0f} K off the record"
    confirm = "confirm the temperature by a second source, and give it as 'delta_T' in [conditions]"
    if unlike:
        text = (
            f"departure: {air} makes rows fail that have no ratio: {', '.join(unlike)}; {confirm}"
        )
        return (RowRemark("departure", text, AIR, values=effects, unit="1"),)
    if not effects:
        return (unprobed_remark(_PROBE, "no row has a number", AIR),)
    worst = max(effects, key=lambda name: effects[name])
    text = (
        f"{air} moves the answer by {effects[worst]:.2f} tolerances "
        f"({plain_words(worst)}; limit {MATTERS:g})"
    )
    if effects[worst] < MATTERS:
        return (RowRemark("probe", text, AIR, values=effects, unit="1"),)
    text = f"departure: {text}; {confirm}"
    return (RowRemark("departure", text, AIR, values=effects, unit="1"),)
