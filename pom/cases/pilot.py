"""The math pilot: loops that move controls so that the model follows recorded channels.

The child process of an FMU runs it, so it imports nothing but NumPy.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

_TURNING = ("phi", "psi", "lon")


def is_wrapped_angle(channel: str) -> bool:
    """Return whether a channel is an angle that jumps by a full turn."""
    return channel in _TURNING


def shortest_error(channel: str, error: float) -> float:
    """Return an error; of an angle that jumps by a full turn the one below half a turn."""
    return (
        math.remainder(error, 2.0 * math.pi)
        if is_wrapped_angle(channel) and math.isfinite(error)
        else error
    )


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
        Largest correction; while it is reached the integral stands still. [SI of the control]
    """

    control: str
    channel: str
    gain: float
    limit: float
    integral: float = 0.0


class Pilot:
    """The loops in flight: one call per communication point, in order.

    Parameters
    ----------
    loops : sequence of Loop, or of mappings with its fields (what crosses to a child process)
    time : array (time,)
        Communication points. [s]
    targets : mapping of str to array (time,)
        The recorded channel of every loop. [SI]

    Attributes
    ----------
    moved : dict of str to array (time,)
        Correction of every control, in force from its sample to the next; NaN where the run did not
        come. [SI]
    cut : dict of str to array (time,)
        Whether a loop of the control was at its limit.
    """

    def __init__(
        self,
        loops: Sequence[PilotLoop | Mapping],
        time: np.ndarray,
        targets: Mapping[str, np.ndarray],
    ):
        self.loops = tuple(
            loop if isinstance(loop, PilotLoop) else PilotLoop(**loop) for loop in loops
        )
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
            total[loop.control] += self._correction(
                i, shortest_error(loop.channel, self.targets[i][k] - outputs[loop.channel]), k
            )
        for name, value in total.items():
            self.moved[name][k] = value
        return total

    def _correction(self, i: int, error: float, k: int) -> float:
        loop = self.loops[i]
        wanted = loop.gain * error + self.integrals[i]
        found = min(max(wanted, -loop.limit), loop.limit)
        if found != wanted:
            self.cut[loop.control][k] = True
        push = loop.integral * error
        if k < len(self.steps) and (found == wanted or push * wanted < 0.0):
            self.integrals[i] += push * self.steps[k]
        return found
