"""Whether an oscillation fitted to a window is that of the motion or that of the window.

A fit can explain 97 % of a window in which the motion is not alone: the end of an input, a second
mode, a turn that begins.  Such a fit changes when the window does.  So it is repeated in windows
whose ends are moved inwards by a third and by two thirds of the period.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass

import numpy as np
import xarray as xr

from flightmech.errors import IdentificationError, SchemaError

Figures = Mapping[
    str, tuple[float, float, str]
]  # value, standard error and unit by name, as `Motion.values`

TRIMS = (1.0 / 3.0, 2.0 / 3.0)  # of the fitted period: 1 and 2 s for a Dutch roll
_MOST = 0.25  # of the window that is left out at most
_SIDES = ((1.0, 0.0), (0.0, 1.0), (0.5, 0.5))  # start, end, and both by half
_STARTS = 0.05  # of its range: an input that has moved so far has begun
# standard errors, the smaller of the two, by which a figure must move to be one of the window,
SHIFT = 3.0
LEAST = {
    "period": 0.05,
    "damping_ratio": 0.04,
}  # and of the period [1], and of the damping ratio: less is not a fault of the window


@dataclass(frozen=True)
class MovedWindow:
    """A fit in a shorter window: ``start stop`` [s], and period [s] and damping ratio with their
    standard errors.
    """

    start: float
    stop: float
    period: tuple[float, float]
    damping_ratio: tuple[float, float]

    def differs(self, values: Figures) -> str:
        """Return the name of the figure that the shorter window moves, or nothing."""
        for name, least in LEAST.items():
            value, stderr, _ = values[name]
            moved, own = getattr(self, name)
            limit = max(SHIFT * min(stderr, own), least * (value if name == "period" else 1.0))
            if abs(moved - value) > limit:
                return name
        return ""


def fits_in_moved_windows(
    data: xr.Dataset, period: float, inputs: Sequence[str], fit: Callable[[xr.Dataset], Figures]
) -> tuple[MovedWindow, ...]:
    """Return the same fit in shorter windows.

    Parameters
    ----------
    data : Dataset (time,)
        What was fitted.
    period : float
        Of the oscillation found in it. [s]
    inputs : sequence of str
        Controls that drive it: they must begin to move inside every window.
    fit : callable
        Dataset -> figures of the same fit, as `Motion.values`.
    """
    found = []
    for start, stop in _windows(data, period, inputs):
        part = data.sel(time=slice(start, stop))
        try:
            values = fit(part)
        except (IdentificationError, SchemaError):  # too little of it is left there
            continue
        found.append(MovedWindow(start, stop, values["period"][:2], values["damping_ratio"][:2]))
    return tuple(found)


def _windows(
    data: xr.Dataset, period: float, inputs: Sequence[str]
) -> Iterator[tuple[float, float]]:
    time = data["time"].values
    first, last = float(time[0]), float(time[-1])
    begins = last
    for name in inputs:
        away = np.abs(data[name].values - data[name].values[0])
        begins = min(begins, float(time[np.argmax(away > _STARTS * np.ptp(data[name].values))]))
    step = float(time[1] - time[0])
    for share in TRIMS:
        off = min(share * period, _MOST * (last - first))
        for front, back in _SIDES:
            if first + front * off <= begins:
                yield first + front * off - 0.5 * step, last - back * off + 0.5 * step
