"""Responses and their differences, flown as batches of runs."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

Fly = Callable[[np.ndarray], tuple[np.ndarray, np.ndarray]]


class Runs:
    """The runs that a search requires of one manoeuvre.

    The last response is remembered, so that it is not flown again for its slopes.  Slopes that are expected are flown in the batch
    of the response itself: the lanes of the processor are then full, and no run flies alone.

    Parameters
    ----------
    fly : callable
        Takes unknowns (run, unknown), returns outputs (run, time, output) and which runs went through (run,).
    """

    def __init__(self, fly: Fly):
        self.fly = fly
        self.at = np.empty(0)  # unknowns of the last response
        self.response = np.empty((0, 0))
        self.ahead: tuple[np.ndarray, bool] | None = None  # steps of the slopes that are expected
        self.flown: tuple[np.ndarray, bool, np.ndarray, np.ndarray] | None = None  # steps, sides and runs that were flown with it

    def expect(self, steps: np.ndarray, central: bool) -> None:
        """Fly slopes together with the next response; they are required unless that response is discarded."""
        self.ahead = steps, central

    def outputs(self, values: np.ndarray) -> np.ndarray:
        """Return the outputs (time, output), NaN behind the end of a run that failed."""
        ahead, self.ahead = self.ahead, None
        if not np.array_equal(values, self.at):
            rows = np.concatenate([values[None], _moved(values, *ahead)]) if ahead else values[None]
            y, ok = self.fly(rows)
            self.at, self.response = values.copy(), y[0].copy()
            self.flown = (*ahead, y[1:], ok[1:]) if ahead else None
        return self.response

    def slopes(self, values: np.ndarray, steps: np.ndarray, central: bool) -> np.ndarray:
        """Return the slopes (unknown, time, output), of both sides when asked or where one side cannot be flown."""
        base = self.outputs(values)
        flown, self.flown = self.flown, None
        if flown and np.array_equal(flown[0], steps) and flown[1] >= central:
            _, central, y, ok = flown
        else:
            y, ok = self.fly(_moved(values, steps, central))
        if not central and not ok.all():
            return self.slopes(values, steps, central=True)
        return differences(base, y[: len(steps)], y[len(steps) :] if central else None, steps, ok)


def _moved(values: np.ndarray, steps: np.ndarray, central: bool) -> np.ndarray:
    moves = np.diag(steps)
    return values + (np.concatenate([moves, -moves]) if central else moves)


def differences(base: np.ndarray, up: np.ndarray, down: np.ndarray | None, steps: np.ndarray, flown: np.ndarray) -> np.ndarray:
    """Return the slopes of outputs (unknown, time, output); one-sided where one side could not be flown, zero where neither could.

    Parameters
    ----------
    base : array (time, output)
        Outputs without a step.
    up, down : array (unknown, time, output)
        Outputs after a step of each unknown up and down; `up` is overwritten.  None for one-sided differences.
    steps : array (unknown,)
    flown : array of bool (unknown,) or (2 unknowns,)
        Whether the runs up, then those down, went through.
    """
    if down is not None and flown.all():
        up -= down
        up /= 2.0 * steps[:, None, None]
        return up
    good = flown.reshape(-1, len(steps))
    up[~good[0]] = base
    up -= base if down is None else np.where(good[1][:, None, None], down, base)
    width = steps * good.sum(axis=0)
    up /= np.where(width > 0.0, width, np.inf)[:, None, None]
    return up
