"""Times of day in one number, such as 102233.05 for 10:22:33.05.

Satellite receivers write such numbers.  Read as seconds, such a clock jumps by 40 s at every
minute.
"""

from __future__ import annotations

import numpy as np

_SPARSE = 100  # step of the stamps that are looked at first
_USUAL = 5.0  # median steps that may lie between two samples about a new minute


def seconds_of_digits(stamps: np.ndarray) -> np.ndarray | None:
    """Return seconds of the day if the digits of stamps are hours, minutes and seconds.

    The result is None if the stamps are seconds.  It is also None if no minute ends between them,
    so that both readings are the same clock.

    Parameters
    ----------
    stamps : array (time,)
        Recorded stamps; NaN remains NaN.

    Examples
    --------
    >>> seconds_of_digits(np.array([102258.0, 102259.0, 102300.0])).tolist()
    [37378.0, 37379.0, 37380.0]
    >>> seconds_of_digits(np.array([58.0, 59.0, 60.0])) is None
    True
    """
    is_finite = np.isfinite(stamps)
    numbers = stamps[is_finite]
    if len(numbers) < 3 or numbers.min() < 0.0 or numbers.max() >= 240000.0:
        return None
    # Most clocks count seconds. A few of their stamps show it before all digits are separated.
    if (np.floor(numbers[::_SPARSE]) % 100.0).max() >= 60.0:
        return None
    whole_numbers = np.floor(numbers)
    hours = whole_numbers // 10000.0
    minutes = whole_numbers // 100.0 % 100.0
    seconds = whole_numbers % 100.0
    if max(minutes.max(), seconds.max()) >= 60.0:
        return None
    of_day = hours * 3600.0 + minutes * 60.0 + seconds + (numbers - whole_numbers)

    # Both readings step back at midnight, when the next day begins at 0 again.
    is_midnight = (numbers[:-1] >= 235900.0) & (numbers[1:] < 100.0)
    step = np.diff(of_day) + 86400.0 * is_midnight
    number_step = np.diff(numbers) + 240000.0 * is_midnight
    # At the end of a minute the digits jump by 40 more than the seconds do.
    is_minute_end = (number_step - step >= 40.0) & (step > 0.0)
    if not is_minute_end.any():
        return None
    is_usual = step[is_minute_end] <= _USUAL * np.median(step[step > 0.0])
    if np.mean(is_usual) < 0.5:
        return None
    all_seconds = np.full(len(stamps), np.nan)
    all_seconds[is_finite] = of_day
    return all_seconds
