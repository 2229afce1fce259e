"""Whether a model passes only with the variation of the recorded wind.

The wind of a record is often computed from its own motion, so it can take up what a model misses.
The model flies once more in the mean of the wind; if a row then fails, the pass rests on the wind.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace

import numpy as np

from flightmech.names import value_text
from flightmech.units import KNOT
from pom.cases.case_file import WIND
from pom.cases.job import ReplayJob
from pom.judging.signals import traces_of
from pom.judging.verdict import judge_criterion
from pom.result import PomResult
from pom.status import unprobed_remark
from pom.tolerances.bands import RowRemark
from pom.tolerances.channels import plain_words

LEAST_VARIATION = 1.0 * KNOT
"""Range of a component of the wind below which its effect is not weighed; our number. [m s-1]"""
QUANTITY = "wind"  # of the remark


def weigh_wind(
    result: PomResult,
    run: str,
    job: ReplayJob,
    outputs: Mapping[str, np.ndarray],
    fly: Callable[[ReplayJob, Sequence[str]], tuple[Mapping[str, np.ndarray], str]],
) -> tuple[RowRemark, ...]:
    """Return the remark on the variation of the wind; empty for a steady wind.

    Parameters
    ----------
    result : PomResult
    run : str
        A model that passes.
    job, outputs
        Its job, and its outputs (time,) by name.
    fly : callable
        Flight of a job by the model: outputs (time,) by name, and why it failed.

    Returns
    -------
    tuple of RowRemark
        Of kind ``departure`` if a row fails in the mean wind, else ``probe``.
    """
    ranges = {name: float(np.ptp(job.inputs[name])) for name in WIND if name in job.inputs}
    varying = {name: size for name, size in ranges.items() if size > LEAST_VARIATION}
    if not varying:
        return ()
    # The same flight in the mean wind.
    steady = {name: np.full_like(job.inputs[name], job.inputs[name].mean()) for name in varying}
    changed = replace(job, inputs={**job.inputs, **steady})
    after, failure = fly(changed, [*outputs])
    name = max(varying, key=varying.__getitem__)
    wind = f"the wind of the record varies by {value_text(name, varying[name], '.2g')} ({name})"
    if failure:
        text = f"departure: {wind}, and the flight in its mean failed: {failure}"
        return (RowRemark("departure", text, QUANTITY),)
    flight = traces_of(result.signals, "flight")
    passed = {
        row["criterion"] for row in result.rows if row["run"] == run and row["verdict"] == "pass"
    }
    # Only rows that pass in the recorded wind are judged again.
    ratios: dict[str, float] = {}
    lost: list[str] = []  # rows that pass in the recorded wind alone
    for criterion in result.case.criteria:
        if criterion.name in passed:
            outcome = judge_criterion(result.case, criterion, job.time, flight, after)
            if math.isfinite(outcome.worst_ratio):
                ratios[criterion.name] = float(outcome.worst_ratio)
            if outcome.verdict in ("fail", "invalid"):
                lost.append(criterion.name)
    if lost:
        listed = ", ".join(f"{plain_words(name)} {_ratio_text(ratios, name)}" for name in lost)
        text = (
            f"departure: {wind}; in its mean these rows do not pass: {listed}, so the pass rests "
        )
        text += "on the wind: state how it was measured"
        return (RowRemark("departure", text, QUANTITY, values=ratios, unit="1"),)
    if not ratios:
        reason = f"no row has a number; {wind}"
        return (unprobed_remark("the effect of the wind", reason, QUANTITY),)
    worst = max(ratios, key=ratios.__getitem__)
    text = f"{wind}; in its mean {plain_words(worst)} is at {ratios[worst]:.2f} of its tolerance"
    return (RowRemark("probe", text, QUANTITY, values=ratios, unit="1"),)


def _ratio_text(ratios: Mapping[str, float], name: str) -> str:
    """Return a ratio to the tolerance as text, for a row without a number that it has none."""
    return f"{ratios[name]:.2f} of its tolerance" if name in ratios else "(no number)"
