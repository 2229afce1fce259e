"""Times of day in one number, 102233.05 for 10:22:33.05, as satellite receivers write them.

Taken as seconds such a clock seems to jump by 40 s with every minute.
"""

from __future__ import annotations

import numpy as np

_USUAL = 5.0  # median steps that may lie between two samples about a new minute


def seconds_of_digits(stamps: np.ndarray) -> np.ndarray | None:
    """Return seconds of the day of stamps whose digits are hours, minutes and seconds; None where
    they are seconds, or where no minute ends between them, so that both are the same clock.

    Parameters
    ----------
    stamps : array (time,)
        As recorded; NaN stays NaN.

    Examples
    --------
    >>> seconds_of_digits(np.array([102258.0, 102259.0, 102300.0])).tolist()
    [37378.0, 37379.0, 37380.0]
    >>> seconds_of_digits(np.array([58.0, 59.0, 60.0])) is None
    True
    """
    finite = np.isfinite(stamps)
    found = stamps[finite]
    if len(found) < 3 or found.min() < 0.0 or found.max() >= 240000.0:
        return None
    whole = np.floor(found)
    hours, minutes, seconds = whole // 10000.0, whole // 100.0 % 100.0, whole % 100.0
    if max(minutes.max(), seconds.max()) >= 60.0:
        return None
    of_day = hours * 3600.0 + minutes * 60.0 + seconds + (found - whole)
    step, plain = np.diff(of_day), np.diff(found)
    midnight = (found[:-1] >= 235900.0) & (found[1:] < 100.0)  # the next day begins at 0 again
    step, plain = step + 86400.0 * midnight, plain + 240000.0 * midnight
    onward = step[step > 0.0]
    ends = (plain - step >= 40.0) & (step > 0.0)
    if not ends.any() or np.mean(step[ends] <= _USUAL * np.median(onward)) < 0.5:
        return None
    spread = np.full(len(stamps), np.nan)
    spread[finite] = of_day
    return spread
