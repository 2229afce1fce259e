"""Movement of the variables of a model inside the manoeuvres that identify it.

A surface that rests gives no derivative: the fit then explains noise, and the level of its trim
from one manoeuvre to the next.  The standard error of such an estimate is finite, and can even be
small.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping

import numpy as np
import scipy

from flightmech.names import REDUCED_RATES
from flightmech.units import DEGREE

MOVED_LEAST = 0.6 * DEGREE
"""Range of an angle, or of a rate in a second, inside a manoeuvre that counts as a movement.

At rest, the variables of calm flights of a jet, a light aircraft and a commuter have ranges of 0.03
to 0.5 deg and 0.03 to 0.5 deg/s; moved ones have 1 deg and more. [rad], [rad s-1]
"""
JUDGED = ("delta_e", "delta_a", "delta_r", "alpha", "beta", "p", "q", "r")
"""Variables that have this limit."""
_SMOOTH = 0.3  # [s] mean over which the noise of a pick-up is not a movement
_RATES = {reduced: rate for reduced, (rate, _) in REDUCED_RATES.items()}


def judged_variable(name: str) -> str:
    """Return the recorded variable that a regressor needs moved; empty for one without a limit."""
    recorded = _RATES.get(name, name)
    return recorded if recorded in JUDGED else ""


def ranges_in_spans(
    time: np.ndarray,
    columns: Mapping[str, np.ndarray],
    spans: Iterable[tuple[float, float]],
) -> list[dict[str, float]]:
    """Return the range of each variable in each span, of the mean over 0.3 s.

    Parameters
    ----------
    time : array (time,)
        [s]
    columns : mapping of str to array (time,)
        [rad], [rad s-1]
    spans : iterable of (float, float)
        [s]

    Returns
    -------
    list of dict of str to float
        For each span; zero with fewer than two samples in it. [rad], [rad s-1]
    """
    step = float(np.median(np.diff(time))) if len(time) > 1 else 1.0
    width = max(1, round(_SMOOTH / step)) if step > 0.0 else 1
    smooth = {}
    for name, values in columns.items():
        filled = np.nan_to_num(np.asarray(values, float))
        smooth[name] = scipy.ndimage.uniform_filter1d(filled, width, mode="nearest")
    ranges = []
    for start, end in spans:
        inside = (time >= start) & (time <= end)
        is_empty = np.count_nonzero(inside) < 2
        ranges.append(
            {
                name: 0.0 if is_empty else float(np.ptp(values[inside]))
                for name, values in smooth.items()
            }
        )
    return ranges
