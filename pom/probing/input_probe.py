"""One more flight with changed inputs: an answer that does not follow is not driven by them.

An FMU that reads the flight from a file, holds it as a table, or follows it by a controller can be
within every tolerance.  Its answer to other inputs shows it.  All deviations of the inputs from
their first values are multiplied by `SCALE`.  For small changes an aeroplane is linear, so its
answer changes by the share 1 - `SCALE` of its response, with or without dampers.  A table does not
change, and a controller removes most of the change.
"""

from __future__ import annotations

import math
from collections.abc import Collection, Mapping
from dataclasses import dataclass, replace

import numpy as np

from flightmech.names import lookup
from flightmech.support.arrays import rms
from flightmech.units import DEGREE
from pom.cases.case_file import LEVERS, WIND
from pom.cases.job import ReplayJob
from pom.status import unprobed_remark
from pom.tolerances.bands import RowRemark
from pom.tolerances.channels import quantity_words

SCALE = 0.9
"""Factor on the deviations of the inputs; smaller deviations stay inside the tables."""
SIZES = {
    **dict.fromkeys(("p", "q", "r"), 1.0 * DEGREE),
    **dict.fromkeys(("phi", "theta", "psi"), 1.0 * DEGREE),
    **dict.fromkeys(("alpha", "beta"), 0.5 * DEGREE),
    "V": 0.5,
    "h": 3.0,
    "nz": 0.03,
}
"""Channels of the probe, and the rms of a response that is judged. [SI]  Our numbers."""
NEAR = 0.999
"""The same for a flight whose inputs are nearly those of the record."""
SHARE_PROBE = "the answer to scaled inputs"
JUMP_PROBE = f"the answer to inputs scaled by {NEAR:g}"
"""Names of the probes in the remarks that they were not made."""
JUMP = 0.3
"""Share of the change with `SCALE` that is a jump with `NEAR`: a smooth answer changes by 0.01."""
_LEAST_JUMP = 0.1  # in `SIZES`: a trim that is found to a tolerance changes by less
LEAST_CHANGE = 1e-4
"""Change below which an answer counts as unchanged, in units of `SIZES`.

Of the 24 cases of the T-37 and the C182 the least driven channel changes by 1.2e-2.
"""
LEAST_LATE_SHARE = 0.1
"""The same outside the linear range of the aeroplane: nine tenths of the answer are stored."""
LEAST_SHARE = 0.5
"""Least share of the expected change: the middle one of the judged channels, of two the larger.

Honest models of the T-37 and the C182 have 0.73 (turn of the nose wheel on the ground) to 5.0, most
of them 0.8 to 1.1.  A controller that holds the short period of the T-37 with time constants of
0.2 s and 0.05 s has 0.19 and 0.06.
"""
LEAST_LEFT = 0.05
"""Least part of a displacement after a pulse that remains at the end, of the best channel."""
# Deviation of a control that counts as moved; recorded ones at rest have half of it. [SI]
_MOVED = {"rad": 0.6 * DEGREE, "N": 10.0, "N m": 2.0, "m": 0.005}
_MOVED_SHARE = 0.05  # of the largest value, for levers, thrust and devices
_SMOOTHED = 0.3  # [s] mean over it, so that noise of a pick-up is not a movement
# Pulse on a control if none is moved; small against travel and force. [SI]
_PULSES = {
    **dict.fromkeys(("delta_e", "delta_a", "delta_r"), 0.5 * DEGREE),
    **dict.fromkeys(("F_column", "F_pedal"), 10.0),
    "F_wheel": 2.0,
    **dict.fromkeys(("column", "pedal"), 0.003),
    "wheel": 2.0 * DEGREE,
}
_PULSE = (0.1, 1.0)  # start [share of the window] and length [s]
_BLOCK = 1.0  # [s] parts of the window whose change is judged alone
_SETTLED = 1.0  # [s] after the first movement of a control
_LEVERS = (".throttle", *(f".{name}" for name in LEVERS))
_LAST = 0.2  # share of the window in which the remaining displacement is measured
_INTEGRALS = ("phi", "theta", "psi", "V", "h")  # displaced for good by a pulse

Traces = Mapping[str, np.ndarray]


@dataclass(frozen=True)
class ChangedJob:
    """Job of the probe.

    Attributes
    ----------
    job : ReplayJob
        Without math pilot and control law: the controls that they moved are inputs.
    moved_at : float
        Instant at which the first control moves.  If none does, it is infinite, and the primary
        controls have a pulse. [s]
    only_levers : bool
        Whether the controls that move are levers of engines.
    """

    job: ReplayJob
    moved_at: float
    only_levers: bool = False

    @property
    def moved(self) -> bool:
        """Whether a control moves."""
        return math.isfinite(self.moved_at)


def changed_job(job: ReplayJob, outputs: Traces, scale: float = SCALE) -> ChangedJob:
    """Return the job of a probe.

    Parameters
    ----------
    job : ReplayJob
    outputs : mapping of str to array (time,)
        Of the flight of the model.  Controls that math pilot or control law moved are among them.
    scale : float
        Factor on the deviations of the inputs.
    """
    # Controls that a pilot or a control law moves get their applied position as an input.
    followed = {loop.control for loop in job.pilot}
    if job.law is not None:
        followed.update(job.law.moves)
    inputs: dict[str, np.ndarray] = {}
    moved_at: dict[str, float] = {}
    for name, recorded in job.inputs.items():
        values = outputs.get(name, recorded) if name in followed else recorded
        if name in WIND or not np.isfinite(values).all():
            inputs[name] = recorded
            continue
        # Scaled about the first sample: the start of the flight is the same.
        deviation = values - values[0]
        at = _first_movement(name, job.time, values)
        if math.isfinite(at):
            moved_at[name] = at
        inputs[name] = values[0] + scale * deviation
    # Without a movement of a control a pulse drives the model.
    if not moved_at:
        pulse = _pulse_shape(job.time)
        for name, size in _PULSES.items():
            if name in inputs:
                inputs[name] = inputs[name] + size * pulse
    changed = replace(job, inputs=inputs, pilot=(), targets={}, law=None)
    levers = [name for name in moved_at if name.startswith("engine") and name.endswith(_LEVERS)]
    return ChangedJob(
        changed,
        min(moved_at.values(), default=math.inf),
        only_levers=bool(moved_at) and len(levers) == len(moved_at),
    )


def _first_movement(name: str, time: np.ndarray, values: np.ndarray) -> float:
    """Return when a control leaves its first position by more than its noise, or infinity. [s]"""
    quantity = name.removesuffix("_drive")
    least = _MOVED.get(lookup(quantity).units, 0.0)
    if quantity.startswith("engine") or not least:
        least = _MOVED_SHARE * max(1.0, float(np.max(np.abs(values))))
    step = float(np.median(np.diff(time)))
    count = max(1, min(values.size, round(_SMOOTHED / step)))
    smooth = np.convolve(values, np.ones(count) / count, mode="valid")
    is_moved = np.abs(smooth - values[0]) > least
    if not is_moved.any():
        return math.inf
    # a mean belongs to the last of its samples
    return float(time[np.argmax(is_moved) + count - 1])


def _pulse_shape(time: np.ndarray) -> np.ndarray:
    """Return a half sine of unit size near the start of the window (time,)."""
    start = time[0] + _PULSE[0] * (time[-1] - time[0])
    phase = (time - start) / _PULSE[1]
    return np.where((phase > 0.0) & (phase < 1.0), np.sin(np.pi * phase), 0.0)


def judge_input_change(
    time: np.ndarray,
    before: Traces,
    after: Traces,
    judged: Collection[str],
    *,
    moved_at: float,
    on_wheels: bool = False,
    linear_end: float = math.inf,
    uncompared: str = "",
) -> tuple[RowRemark, ...]:
    """Return the remarks on a probe: the change, and ``not_driven`` if the inputs do not drive it.

    Parameters
    ----------
    time : array (time,)
        [s]
    before, after : mapping of str to array (time,)
        Outputs of the flight as recorded, and of the probe. [SI]
    judged : collection of str
        Channels with a judged time history.
    moved_at : float
        As in `ChangedJob`. [s]
    on_wheels : bool
        Whether the aeroplane stands or rolls in a part of the window.  Wheels and brakes stop it
        whatever the inputs are: only an answer that does not change at all is judged.
    linear_end : float
        Instant from which on the aeroplane is not linear in the inputs, such as the warning of a
        stall.  The shares of the expected change are those before it; after it only shares below
        `LEAST_LATE_SHARE` are named. [s]
    uncompared : str
        Why the change is not compared with the expected one.  An answer that does not change is
        named all the same.
    """
    is_linear = time <= linear_end
    is_moved = math.isfinite(moved_at)
    responding: dict[str, tuple[np.ndarray, np.ndarray]] = {}  # response and change, in `SIZES`
    changes: dict[str, float] = {}  # rms of the change, in units of `SIZES`
    shares: dict[str, float] = {}  # of the expected change, before `linear_end`
    late: dict[str, float] = {}  # the same after it
    for name, size in SIZES.items():
        if name not in before or name not in after:
            continue
        response, change = before[name] - before[name][0], after[name] - before[name]
        is_finite = np.isfinite(response) & np.isfinite(change)
        if is_finite.sum() < 2:
            continue
        changes[name] = rms(change[is_finite]) / size
        if rms(response[is_finite]) > size:
            responding[name] = response / size, change / size
        for found, is_part in ((shares, is_linear), (late, ~is_linear)):
            is_counted = is_finite & is_part
            if is_counted.sum() >= 2 and rms(response[is_counted]) > size:
                expected = (1.0 - SCALE) * rms(response[is_counted])
                found[name] = rms(change[is_counted]) / expected
    if not changes:
        return (unprobed_remark(SHARE_PROBE, "no motion among the outputs of the model"),)
    still = [name for name, change in changes.items() if change < LEAST_CHANGE]
    is_still = len(still) == len(changes)
    # a channel that responds but does not change is given, whatever the others do
    given = [name for name in still if name in responding]
    if is_moved and (given or is_still):
        return (_unchanged_remark(given or still, f"inputs scaled by {SCALE:g}", changes),)
    if not is_moved:
        if is_still:
            return (_unchanged_remark(still, "a pulse on the controls", changes),)
        return _judge_pulse(time, before, after)
    if on_wheels:
        reason = "on its wheels the aeroplane is not linear in the inputs"
        return (unprobed_remark(SHARE_PROBE, reason),)
    stored = _stored_part(time, responding, moved_at)
    if stored is not None:
        text = (
            f"not driven by the inputs: from {stored[0]:.1f} to {stored[1]:.1f} s the answer does "
            f"not change with inputs scaled by {SCALE:g}; this part is stored in the model or read "
            f"by it"
        )
        return (RowRemark("not_driven", text),)
    if uncompared:
        return (unprobed_remark(SHARE_PROBE, uncompared),)
    if _middle_share(late, judged) < LEAST_LATE_SHARE:
        return _judge_shares(late, judged, LEAST_LATE_SHARE)
    return _judge_shares(shares, judged, LEAST_SHARE)


def _stored_part(
    time: np.ndarray, responding: Mapping[str, tuple[np.ndarray, np.ndarray]], moved_at: float
) -> tuple[float, float] | None:
    """Return the first block of time in which channels respond and none changes; None without one.

    Displacements of attitude, speed and height stay after a change of the inputs, so an answer that
    the inputs drive does not return to the first one.
    """
    # The answer needs some time after the first movement.
    bounds = np.arange(moved_at + _SETTLED, time[-1] - _BLOCK + 1e-9, _BLOCK)
    for start in bounds:
        inside = (time >= start) & (time <= start + _BLOCK)
        sizes = []
        for response, change in responding.values():
            if np.isfinite(change[inside]).all() and rms(response[inside]) > 1.0:
                sizes.append(rms(change[inside]))
        if sizes and max(sizes) < LEAST_CHANGE:
            return float(start), float(start + _BLOCK)
    return None


def _considered_shares(shares: Mapping[str, float], judged: Collection[str]) -> Mapping[str, float]:
    return {name: share for name, share in shares.items() if name in judged} or shares


def _middle_share(shares: Mapping[str, float], judged: Collection[str]) -> float:
    """Return the middle one of the shares, infinity without one."""
    considered = _considered_shares(shares, judged)
    return sorted(considered.values())[len(considered) // 2] if considered else math.inf


def _judge_shares(
    shares: Mapping[str, float], judged: Collection[str], least: float
) -> tuple[RowRemark, ...]:
    """Return the remarks on the shares of the expected change, of channels that respond."""
    considered = _considered_shares(shares, judged)
    if not considered:
        return (unprobed_remark(SHARE_PROBE, "no channel responds enough to be judged"),)
    listed = ", ".join(f"{quantity_words(name)} {share:.2f}" for name, share in considered.items())
    text = (
        f"with inputs scaled by {SCALE:g} the answer changes by this share of what the inputs "
        f"explain: {listed} (1 for an aeroplane that is linear)"
    )
    if _middle_share(shares, judged) >= least:
        return (_probe_remark(text, considered),)
    reason = (
        f"not driven by the inputs: {text}; the middle one is below {least:g}. The "
        f"model follows the record by other means, such as a controller"
    )
    return (RowRemark("not_driven", reason, values=dict(considered), unit="1"),)


def judge_jump(before: Traces, near: Traces, after: Traces) -> tuple[RowRemark, ...]:
    """Return the remark on a model that answers otherwise to the inputs of the record alone.

    Parameters
    ----------
    before, near, after : mapping of str to array (time,)
        Outputs of the flight as recorded, and with inputs scaled by `NEAR` and `SCALE`. [SI]

    Returns
    -------
    tuple of RowRemark
        Of kind ``not_driven``, or ``probe`` for a smooth answer.
    """
    jumps: dict[str, float] = {}
    shares: dict[str, float] = {}
    for name, size in SIZES.items():
        if name not in before or name not in near or name not in after:
            continue
        step, whole = (other[name] - before[name] for other in (near, after))
        if not (np.isfinite(step).all() and np.isfinite(whole).all()):
            continue
        if rms(whole) > _LEAST_JUMP * size:
            shares[name] = rms(step) / rms(whole)
        if rms(step) > max(_LEAST_JUMP * size, JUMP * rms(whole)):
            jumps[name] = rms(step) / rms(whole) if rms(whole) else math.inf
    if not jumps and not shares:
        return (unprobed_remark(JUMP_PROBE, "no channel changes enough to be judged"),)
    if not jumps:
        worst = max(shares, key=lambda name: shares[name])
        text = (
            f"with inputs scaled by {NEAR:g} the answer changes by up to {shares[worst]:.2g} of "
            f"its change with {SCALE:g} ({quantity_words(worst)}; limit {JUMP:g}, for changes "
            f"beyond {_LEAST_JUMP:g} of the sizes of the probe)"
        )
        return (_probe_remark(text, {}),)
    listed = ", ".join(f"{quantity_words(name)} {share:.2f}" for name, share in jumps.items())
    text = (
        f"not driven by the inputs: with inputs scaled by {NEAR:g} the answer changes by these "
        f"shares of its change with {SCALE:g}: {listed} (0.01 for a smooth answer); the model "
        f"answers otherwise to the inputs of the record alone"
    )
    return (RowRemark("not_driven", text, values=jumps, unit="1"),)


def _judge_pulse(time: np.ndarray, before: Traces, after: Traces) -> tuple[RowRemark, ...]:
    """Return the remarks on the displacement that a pulse leaves."""
    is_last = time > time[-1] - _LAST * (time[-1] - time[0])
    left: dict[str, float] = {}
    for name in _INTEGRALS:
        if name not in before or name not in after:
            continue
        # Share of the largest displacement that remains at the end of the flight.
        change = np.nan_to_num(np.abs(after[name] - before[name]))
        if change.max() > LEAST_CHANGE * SIZES[name]:
            left[name] = float(rms(change[is_last]) / change.max())
    listed = ", ".join(f"{quantity_words(name)} {share:.2f}" for name, share in left.items())
    text = f"no control moves; after a pulse on the controls this part remains: {listed}"
    if not left or max(left.values()) >= LEAST_LEFT:
        return (_probe_remark(text, left),)
    reason = f"not driven by the inputs: {text}; the model returns to the record by other means"
    return (RowRemark("not_driven", reason, values=left, unit="1"),)


def _unchanged_remark(
    names: Collection[str], means: str, changes: Mapping[str, float]
) -> RowRemark:
    text = (
        f"not driven by the inputs: {', '.join(map(quantity_words, names))} do not change with "
        f"{means}; the answer is stored in the model or read by it"
    )
    values = {name: changes[name] for name in names}
    return RowRemark("not_driven", text, values=values, unit="1")


def _probe_remark(text: str, values: Mapping[str, float]) -> RowRemark:
    return RowRemark("probe", text, values=dict(values), unit="1" if values else "")
