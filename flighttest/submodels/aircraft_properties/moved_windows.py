"""Fits of an oscillation in shorter windows, which show whether it belongs to the motion.

A fit can explain 97 % of a window in which the motion is not alone: the end of an input, a second
mode, a turn that begins.  Such a fit changes with the window.  The fit is therefore repeated in
windows whose ends are moved inwards by a third and by two thirds of the period.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass

import numpy as np
import xarray as xr

from flightmech.errors import IdentificationError, SchemaError

Figures = Mapping[str, tuple[float, float, str]]
"""Value, standard error and unit by name, as `Eigenmotion.values`."""

# Parts of the period by which the ends move: 1 and 2 s for a Dutch roll.
TRIMS = (1.0 / 3.0, 2.0 / 3.0)
# Largest part of the window that is left out.
_MOST = 0.25
# Shares of start and end in the movement.
_SIDES = ((1.0, 0.0), (0.0, 1.0), (0.5, 0.5))
# Part of its range by which an input has moved when it begins.
_STARTS = 0.05
# Change of a figure that shows an effect of the window, in the smaller of both standard errors.
SHIFT = 3.0
# Smallest such change of the period [1] and of the damping ratio.
LEAST = {"period": 0.05, "damping_ratio": 0.04}


@dataclass(frozen=True)
class MovedWindow:
    """A fit in a shorter window.

    Attributes
    ----------
    start, stop : float
        Ends of the window. [s]
    period, damping_ratio : (float, float)
        Estimate and standard error. [s], [1]
    """

    start: float
    stop: float
    period: tuple[float, float]
    damping_ratio: tuple[float, float]

    def differs(self, values: Figures) -> str:
        """Return the name of a figure that the shorter window changes, or an empty text.

        Parameters
        ----------
        values : mapping of str to (value, standard error, unit)
            Figures of the whole window.
        """
        for name, least in LEAST.items():
            value, stderr, _ = values[name]
            estimate, own_stderr = getattr(self, name)
            # The limit of the period is relative, that of the damping ratio absolute.
            scale = value if name == "period" else 1.0
            limit = max(SHIFT * min(stderr, own_stderr), least * scale)
            if abs(estimate - value) > limit:
                return name
        return ""

    def shift(self, name: str, values: Figures) -> float:
        """Return the change of a figure in the smaller of both standard errors."""
        value, stderr, _ = values[name]
        estimate, own_stderr = getattr(self, name)
        return abs(estimate - value) / max(min(stderr, own_stderr), 1e-12)


def fits_in_moved_windows(
    data: xr.Dataset,
    period: float,
    inputs: Sequence[str],
    fit: Callable[[xr.Dataset], Figures | None],
) -> tuple[MovedWindow, ...]:
    """Return the same fit in shorter windows.

    Parameters
    ----------
    data : Dataset (time,)
        Data of the fit in the whole window.
    period : float
        Period of the oscillation. [s]
    inputs : sequence of str
        Controls that drive the oscillation. They must begin to move inside every window.
    fit : callable
        Function that returns the figures of a Dataset, as `Eigenmotion.values`; None if the fit did
        not converge, whose figures show nothing about the window.
    """
    windows = []
    for start, stop in _shorter_windows(data, period, inputs):
        part = data.sel(time=slice(start, stop))
        try:
            values = fit(part)
        except (IdentificationError, SchemaError):
            # The window is too short for a fit.
            continue
        if values is None:
            continue
        windows.append(
            MovedWindow(
                start, stop, values["period"][:2], damping_ratio=values["damping_ratio"][:2]
            )
        )
    return tuple(windows)


def _shorter_windows(
    data: xr.Dataset, period: float, inputs: Sequence[str]
) -> Iterator[tuple[float, float]]:
    """Yield start and stop of the shorter windows, half a sample outside their samples. [s]"""
    time = data["time"].values
    first, last = float(time[0]), float(time[-1])
    # Time at which the first input begins to move.
    begins = last
    for name in inputs:
        values = data[name].values
        has_moved = np.abs(values - values[0]) > _STARTS * np.ptp(values)
        begins = min(begins, float(time[np.argmax(has_moved)]))
    step = float(time[1] - time[0])
    for share in TRIMS:
        trim = min(share * period, _MOST * (last - first))
        for front, rear in _SIDES:
            if first + front * trim <= begins:
                yield first + front * trim - 0.5 * step, last - rear * trim + 0.5 * step
