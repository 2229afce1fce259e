"""One more flight with late inputs: an answer that is not late by as much depends on time.

A model can answer by its inputs and add a correction that is stored over time, or formed from the
record.  Scaled inputs hardly change such a correction.  Late inputs do: the answer of an aeroplane
that starts in a steady state is late with them, and the correction stays where it was.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace

import numpy as np

from flightmech.names import value_text
from flightmech.support.arrays import rms
from pom.cases.job import ReplayJob
from pom.cases.pilot import is_wrapped_angle
from pom.probing.input_probe import SIZES
from pom.status import unprobed_remark
from pom.tolerances.bands import RowRemark
from pom.tolerances.channels import quantity_words

LATE = 2.0
"""Delay of the inputs. [s]"""
PROBE = f"the answer to inputs {LATE:g} s late"
"""Name of the probe in the remark that it was not made."""
STEADY = 0.5
"""Movement before the late inputs, in `SIZES`, above which the answer is not compared."""
MOST = 0.5
"""Difference of an answer to late inputs from the answer as late, in `SIZES`.  Our number.

Honest models have 0.21 at most in 15 cases of the T-37 and the C182 that start steadily.  In these
the smoothed difference of a wrong model from the record has up to 5.2.
"""
QUANTITY = "late inputs"  # of the remark
_REST = 0.6  # [s] at rest that shows whether the start is steady
_FOUND_LATE = 0.3  # [s] after its start a movement of a control is found, at most
_GO_ON = ("h", "psi")  # in a steady climb or turn

Traces = Mapping[str, np.ndarray]


def late_job(job: ReplayJob) -> ReplayJob:
    """Return a job whose inputs keep their first values for `LATE`, then are those of the record.

    The job has neither math pilot nor control law.
    """
    inputs = {}
    for name, values in job.inputs.items():
        inputs[name] = np.interp(job.time - LATE, job.time, values)
    return replace(job, inputs=inputs)


def judge_late(
    time: np.ndarray, before: Traces, late: Traces, moved_at: float
) -> tuple[RowRemark, ...]:
    """Return the remark on the answer of a model to late inputs.

    Parameters
    ----------
    time : array (time,)
        [s]
    before, late : mapping of str to array (time,)
        Outputs of the flight as recorded, and of `late_job`. [SI]
    moved_at : float
        Instant at which the first control moves in the flight as recorded. [s]

    Returns
    -------
    tuple of RowRemark
        Of kind ``departure``, ``probe`` for an answer that is late, or ``not_probed`` with the
        reason, such as an unsteady start.
    """
    pairs = _pairs(before, late)
    # one sample alone is where every difference is zero
    is_compared = time + LATE < time[-1]
    reason = ""
    if not is_compared.any():
        reason = f"the window is not longer than {LATE:g} s"
    elif not pairs:
        reason = "no motion without gaps among the outputs of the model"
    else:
        reason = _unsteady_text(time, pairs, moved_at)
    if reason:
        return (unprobed_remark(PROBE, reason),)
    sizes: dict[str, float] = {}  # rms of the difference [SI]
    for name, (first, second) in pairs.items():
        # late(t + LATE) = before(t), each from its start
        shifted = np.interp(time + LATE, time, second)
        difference = (shifted - shifted[0]) - (first - first[0])
        sizes[name] = rms(difference[is_compared])
    found = {name: value for name, value in sizes.items() if value > MOST * SIZES[name]}
    if not found:
        worst = max(sizes, key=lambda name: sizes[name] / SIZES[name])
        size = value_text(worst, sizes[worst], ".2g")
        text = (
            f"with inputs {LATE:g} s late the answer is the same {LATE:g} s later (rms of the "
            f"difference {size}, {quantity_words(worst)}; limit "
            f"{value_text(worst, MOST * SIZES[worst], '.2g')})"
        )
        return (RowRemark("probe", text, QUANTITY),)
    listed = ", ".join(
        f"{quantity_words(name)} {value_text(name, value, '.2g')}" for name, value in found.items()
    )
    text = (
        f"departure: with inputs {LATE:g} s late, the answer is not the same {LATE:g} s later (rms "
        f"of the difference: {listed}). A part of the answer depends on time, not on the inputs. "
        f"Check whether the model holds a correction by the record"
    )
    return (RowRemark("departure", text, QUANTITY),)


def _pairs(before: Traces, late: Traces) -> dict[str, tuple[np.ndarray, np.ndarray]]:
    """Return the channels that both flights have, angles without jumps."""
    pairs = {}
    for name in SIZES:
        if name not in before or name not in late:
            continue
        first, second = before[name], late[name]
        if np.isfinite(first).all() and np.isfinite(second).all():
            if is_wrapped_angle(name):
                first, second = np.unwrap(first), np.unwrap(second)
            pairs[name] = first, second
    return pairs


def _unsteady_text(
    time: np.ndarray, pairs: Mapping[str, tuple[np.ndarray, np.ndarray]], moved_at: float
) -> str:
    """Return how the aeroplane moves by more than `STEADY` while no control moves; else empty.

    A correction that depends on time moves the late flight as well, so the flight as recorded is
    looked at where it is long enough.
    """
    rest = min(moved_at - _FOUND_LATE - time[0], LATE)
    looks_at_late = rest < _REST
    is_waiting = time <= time[0] + (LATE if looks_at_late else rest)
    times = 1.0 if looks_at_late else LATE / rest
    moves: dict[str, float] = {}  # largest movement in `LATE` [SI]
    for name, pair in pairs.items():
        values = pair[1] if looks_at_late else pair[0]
        if name not in _GO_ON:
            moves[name] = times * float(np.abs(values - values[0])[is_waiting].max())
    worst = max(moves, key=lambda name: moves[name] / SIZES[name], default="")
    if not worst or moves[worst] <= STEADY * SIZES[worst]:
        return ""
    return (
        f"its start is not steady: {quantity_words(worst)} changes by "
        f"{value_text(worst, moves[worst], '.2g')} in {LATE:g} s before the inputs move, limit "
        f"{value_text(worst, STEADY * SIZES[worst], '.2g')}"
    )
