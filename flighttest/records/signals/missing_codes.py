"""Numbers that recorders write for a missing value, such as -999 and 9999.

A code is not near the readings: the channel jumps to it and back, and never passes beyond it.
"""

from __future__ import annotations

import numpy as np

# Sizes that recorders and spreadsheets write, with either sign.
_NINES = (999.0, 9999.0, 99999.0, 999999.0, 9999999.0)
_TENTHS = (999.9, 9999.9, 99999.9)
_HUNDREDTHS = (999.99, 9999.99, 99999.99)
_SIZES = (*_NINES, *_TENTHS, *_HUNDREDTHS)
# Relative difference of equal numbers, for those of single precision.
_EQUAL = 1e-6
# Smallest step to a code and from it, in typical steps of the readings.
_JUMP = 50.0
# Smallest distance of a code from the readings, over their range.
_AWAY = 0.05
# Largest share of samples with a code. A channel with more of them shows nothing.
_MOST = 0.9
# A channel may have one code for each end of its range.
_CODES = 2


def find_missing_codes(raw: np.ndarray) -> list[tuple[float, np.ndarray]]:
    """Return the codes of missing values in a column, each with its samples.

    Parameters
    ----------
    raw : array (time,)
        Values as recorded, in the unit of the column; NaN is a blank cell.

    Returns
    -------
    list of (code, is_code)
        The number as recorded, and the samples that have it (time,).  Empty for nearly all columns.

    Notes
    -----
    A code is 999, 9999, ... 9999999, also with one or two decimals of nine, with either sign.  It
    is the largest or smallest value of the column, at least a twentieth of the range of all other
    values away from them.  Every step to it and from it is at least 50 times the median size of all
    other steps that are not zero.
    """
    codes: list[tuple[float, np.ndarray]] = []
    if not raw.size:
        return codes
    rest = raw
    for _ in range(_CODES):
        for value in (np.fmin.reduce(rest), np.fmax.reduce(rest)):
            if not _is_nines(float(value)):
                continue
            is_code = rest == value
            if _stands_apart(rest, is_code):
                codes.append((float(value), is_code))
                rest = np.where(is_code, np.nan, rest)
                break
        else:
            break
    return codes


def _is_nines(value: float) -> bool:
    """Return whether a number has the size of a code."""
    if not abs(value) > 0.99 * _NINES[0]:
        return False
    return any(abs(abs(value) - size) <= _EQUAL * size for size in _SIZES)


def _stands_apart(x: np.ndarray, is_code: np.ndarray) -> bool:
    """Return whether some samples are far from all others, and are reached by jumps alone."""
    others = x[~is_code & ~np.isnan(x)]
    if len(others) < 2 or is_code.sum() > _MOST * (len(others) + is_code.sum()):
        return False
    low, high = float(others.min()), float(others.max())
    value = float(x[is_code][0])
    distance = max(low - value, value - high)
    if not distance > _AWAY * (high - low):
        return False
    size = np.abs(np.diff(others))
    moving = size[size > 0.0]
    if not len(moving):
        return True
    # the sample before and the one after each run of the code
    filled = np.flatnonzero(~np.isnan(x))
    code, values = is_code[filled], x[filled]
    edges = np.flatnonzero(code[1:] != code[:-1])
    jumps = np.abs(values[edges + 1] - values[edges])
    return bool(jumps.min(initial=np.inf) > _JUMP * float(np.median(moving)))
