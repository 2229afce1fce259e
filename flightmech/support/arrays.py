"""Small functions of arrays that all packages need."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, Any

import numpy as np

if TYPE_CHECKING:
    from collections.abc import Mapping

    from numpy.typing import ArrayLike


def rms(x: ArrayLike) -> float:
    """Return the root of the mean square, in the unit of `x`; NaN where there are no samples or one is NaN.

    Examples
    --------
    >>> rms([3.0, -3.0])
    3.0
    """
    squares = np.square(x)
    # the sum of `numpy.mean`, without what it asks first: that takes longer than the work where there are a thousand numbers
    return float(np.sqrt(np.add.reduce(squares, axis=None) / squares.size)) if squares.size else math.nan


def median(x: np.ndarray) -> float:
    """Return the median of one number or more (n,), none of them NaN, in their unit, as `numpy.median` does.

    That one imports `numpy.ma`, which takes a tenth of the time of a command that only shows a recording.

    Examples
    --------
    >>> median(np.array([3.0, 1.0, 2.0, 10.0]))
    2.5
    """
    low, high = (len(x) - 1) // 2, len(x) // 2
    parted = np.partition(x, (low, high))
    return float((parted[low] + parted[high]) / 2.0)


def columns_of(data: Any) -> tuple[Mapping[Any, Any], int]:
    """Return columns by name, and the number of samples, of a Dataset, without forming a DataArray of each, or of a mapping of arrays."""
    if hasattr(data, "variables"):
        samples = (size for name, size in data.sizes.items() if name != "error")  # a few samples may have more common errors
        return data.variables, max(samples, default=1)
    return data, max(map(np.size, data.values()), default=1)
