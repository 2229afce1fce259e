"""Runs of a manoeuvre at changed unknowns, and the slopes of its outputs."""

from __future__ import annotations

from collections.abc import Callable
from typing import NamedTuple

import numpy as np

Fly = Callable[[np.ndarray], tuple[np.ndarray, np.ndarray]]


class _Prefetched(NamedTuple):
    """Runs of slopes that were simulated together with a response."""

    steps: np.ndarray
    central: bool
    outputs: np.ndarray
    succeeded: np.ndarray


class Runs:
    """The runs of one manoeuvre that a search requires.

    The last response is stored, so that it is not simulated again for its slopes. Announced slopes
    are simulated in the batch of the response itself. The batch then fills the lanes of the
    processor, and no run is simulated alone.

    Parameters
    ----------
    fly : callable
        From unknowns (run, unknown) to outputs (run, time, output) and success (run,).
    """

    def __init__(self, fly: Fly):
        self.fly = fly
        self.values = np.empty(0)  # unknowns of the last response
        self.response = np.empty((0, 0))
        self.announced: tuple[np.ndarray, bool] | None = None  # steps of the next slopes
        self.prefetched: _Prefetched | None = None

    def expect(self, steps: np.ndarray, central: bool) -> None:
        """Simulate slopes together with the next response, unless that response is discarded."""
        self.announced = steps, central

    def outputs(self, values: np.ndarray) -> np.ndarray:
        """Return the outputs (time, output), NaN after the end of a failed run."""
        announced, self.announced = self.announced, None
        if np.array_equal(values, self.values):
            return self.response
        rows = values[None]
        if announced:
            rows = np.concatenate([rows, _shift_values(values, *announced)])
        y, succeeded = self.fly(rows)
        self.values, self.response = values.copy(), y[0].copy()
        self.prefetched = None
        if announced:
            self.prefetched = _Prefetched(*announced, outputs=y[1:], succeeded=succeeded[1:])
        return self.response

    def slopes(self, values: np.ndarray, steps: np.ndarray, central: bool) -> np.ndarray:
        """Return the slopes (unknown, time, output).

        The differences are central if requested, or if a one-sided run fails.
        """
        base = self.outputs(values)
        prefetched, self.prefetched = self.prefetched, None
        # Prefetched central differences serve for one-sided ones, but not the reverse.
        if prefetched and np.array_equal(prefetched.steps, steps) and prefetched.central >= central:
            _, central, y, succeeded = prefetched
        else:
            y, succeeded = self.fly(_shift_values(values, steps, central))
        if not central and not succeeded.all():
            return self.slopes(values, steps, central=True)
        # The runs up come before the runs down.
        down = None
        if central:
            down = y[len(steps) :]
        return output_slopes(base, y[: len(steps)], down=down, steps=steps, succeeded=succeeded)


def _shift_values(values: np.ndarray, steps: np.ndarray, central: bool) -> np.ndarray:
    """Return the unknowns after a step of each, up and, for central differences, down."""
    shifts = np.diag(steps)
    if central:
        shifts = np.concatenate([shifts, -shifts])
    return values + shifts


def output_slopes(
    base: np.ndarray,
    up: np.ndarray,
    down: np.ndarray | None,
    steps: np.ndarray,
    succeeded: np.ndarray,
) -> np.ndarray:
    """Return the slopes of outputs (unknown, time, output).

    They are one-sided if the run of one side failed, and zero if both failed.

    Parameters
    ----------
    base : array (time, output)
        Outputs without a step.
    up, down : array (unknown, time, output)
        Outputs after a step of each unknown up and down; `up` is overwritten. None for one-sided
        differences.
    steps : array (unknown,)
    succeeded : array of bool (unknown,) or (2 unknowns,)
        Whether the runs up, and then those down, succeeded.
    """
    if down is not None and succeeded.all():
        up -= down
        up /= 2.0 * steps[:, None, None]
        return up
    # A failed run is replaced by the base, and the width is that of the runs that succeeded.
    by_side = succeeded.reshape(-1, len(steps))
    up[~by_side[0]] = base
    if down is None:
        up -= base
    else:
        up -= np.where(by_side[1][:, None, None], down, base)
    width = steps * by_side.sum(axis=0)
    up /= np.where(width > 0.0, width, np.inf)[:, None, None]
    return up
