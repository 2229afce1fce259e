"""The math pilot: loops that move controls so that the model follows recorded channels.

The child process of an FMU runs it, so it imports nothing but NumPy.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

_WRAPPED_ANGLES = ("phi", "psi", "lon")


def is_wrapped_angle(channel: str) -> bool:
    """Return whether a channel is an angle that jumps by a full turn."""
    return channel in _WRAPPED_ANGLES


def shortest_error(channel: str, error: float) -> float:
    """Return an error; for an angle that jumps by a full turn the smallest equivalent error."""
    # math.remainder raises on an infinite error
    if is_wrapped_angle(channel) and math.isfinite(error):
        return math.remainder(error, 2.0 * math.pi)
    return error


@dataclass(frozen=True)
class PilotLoop:
    """One loop of the math pilot.

    The correction c is added to the recorded control (zero where the record has none)::

        e = target - output          target: the recorded channel
        c = gain e + integral * Int e dt,     |c| <= limit

    Loops on the same control add up: attitude and rate are two loops.

    Attributes
    ----------
    control : str
        Input of the model that the loop moves: ``delta_a``, ``wheel``, ``engine1.throttle``.
    channel : str
        Output of the model that is held to the recorded channel.
    gain : float
        [SI of the control / SI of the channel]
    integral : float
        [SI of the control / SI of the channel / s]
    limit : float
        Largest correction; the integral is frozen at the limit. [SI of the control]
    """

    control: str
    channel: str
    gain: float
    limit: float
    integral: float = 0.0


def _as_loop(loop: PilotLoop | Mapping) -> PilotLoop:
    if isinstance(loop, PilotLoop):
        return loop
    return PilotLoop(**loop)


class Pilot:
    """The loops of a run: one call per communication point, in order.

    Parameters
    ----------
    loops : sequence of PilotLoop or mapping
        A mapping has the fields of `PilotLoop`; a child process gets mappings.
    time : array (time,)
        Communication points. [s]
    targets : mapping of str to array (time,)
        The recorded channel of every loop. [SI]

    Attributes
    ----------
    moved : dict of str to array (time,)
        Correction of every control, in force from its sample to the next; NaN after the end of the
        run. [SI]
    cut : dict of str to array (time,)
        True where a loop of the control was at its limit.
    """

    def __init__(
        self,
        loops: Sequence[PilotLoop | Mapping],
        time: np.ndarray,
        targets: Mapping[str, np.ndarray],
    ):
        self.loops = tuple(map(_as_loop, loops))
        # lists: arithmetic on single elements of arrays takes several times as long
        self.steps = np.diff(np.asarray(time, float)).tolist()
        self.targets = [np.asarray(targets[loop.channel], float).tolist() for loop in self.loops]
        self.integrals = [0.0] * len(self.loops)
        self.moved = {loop.control: np.full(len(time), np.nan) for loop in self.loops}
        self.cut = {name: np.zeros(len(time), bool) for name in self.moved}

    @property
    def channels(self) -> list[str]:
        """Outputs of the model that `controls` requires."""
        return list(dict.fromkeys(loop.channel for loop in self.loops))

    def controls(self, k: int, outputs: Mapping[str, float]) -> dict[str, float]:
        """Return the correction of every control over the step from sample `k` to the next.

        Parameters
        ----------
        k : int
            Sample, counted up by one from call to call.
        outputs : mapping of str to float
            Outputs of the model at sample `k`, at least `channels`. [SI]

        Returns
        -------
        dict of str to float
            To be added to the recorded control at both ends of the step. [SI]
        """
        total = dict.fromkeys(self.moved, 0.0)
        for i, loop in enumerate(self.loops):
            error = shortest_error(loop.channel, self.targets[i][k] - outputs[loop.channel])
            total[loop.control] += self._loop_correction(i, error, k)
        for name, value in total.items():
            self.moved[name][k] = value
        return total

    def _loop_correction(self, i: int, error: float, k: int) -> float:
        """Return the correction of loop `i` at sample `k`, and step its integral."""
        loop = self.loops[i]
        # c = gain e + integral * Int e dt, |c| <= limit
        unlimited = loop.gain * error + self.integrals[i]
        correction = min(max(unlimited, -loop.limit), loop.limit)
        is_limited = correction != unlimited
        if is_limited:
            self.cut[loop.control][k] = True
        rate = loop.integral * error
        # Anti-windup: at the limit the integral only moves away from the limit.
        if k < len(self.steps) and (not is_limited or rate * unlimited < 0.0):
            self.integrals[i] += rate * self.steps[k]
        return correction
