"""Small functions of arrays that all packages need."""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike


def rms(x: ArrayLike) -> float:
    """Return the root of the mean square, in the unit of `x`; NaN where there are no samples or one is NaN.

    Examples
    --------
    >>> rms([3.0, -3.0])
    3.0
    """
    return float(np.sqrt(np.mean(np.square(x))))
