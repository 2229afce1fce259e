"""White noise of a sampled signal."""

from __future__ import annotations

import numpy as np


def estimate_white_noise(x: np.ndarray) -> float:
    """Return the standard deviation of white noise on a slow signal, from fourth differences.

    Parameters
    ----------
    x : array (time,)
        At least five samples on one step, without NaN.

    Returns
    -------
    float
        In the unit of the signal.
    """
    # 0.6745 is the median of |x| of a normal distribution, and 70 is 1 + 16 + 36 + 16 + 1.
    return float(np.median(np.abs(np.diff(x, 4))) / 0.6745 / np.sqrt(70.0))
