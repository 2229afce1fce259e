"""Standard errors of estimates from correlated samples, by leaving blocks of time out."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
from numpy.typing import ArrayLike


def block_jackknife(
    estimate: Callable[[np.ndarray], ArrayLike], samples: int, blocks: int
) -> np.ndarray:
    """Return the standard errors of estimates by leaving out one block after the other.

    Parameters
    ----------
    estimate : callable
        Returns the estimates, a number or an array, from the positions of the kept samples.
    samples : int
        Samples in their order of time.
    blocks : int
        Blocks of about equal size, each longer than the correlation of the residuals.

    Returns
    -------
    array (estimates,)
        sqrt((n - 1) var) of the n estimates; shape () for a number.

    References
    ----------
    .. [Kuensch1989] Kuensch, The jackknife and the bootstrap for general stationary observations,
       Annals of Statistics 17, 1989.

    Examples
    --------
    Of the mean of independent samples it is the standard deviation over the root of their number:

    >>> x = np.array([1.0, 2.0, 3.0, 4.0])
    >>> error = block_jackknife(lambda kept: x[kept].mean(), len(x), 4)
    >>> round(float(error), 6), round(float(x.std(ddof=1) / 2.0), 6)
    (0.645497, 0.645497)
    """
    positions = np.arange(samples)
    left_out = []
    for block in np.array_split(positions, blocks):
        left_out.append(estimate(np.delete(positions, block)))
    return np.sqrt((blocks - 1) * np.var(np.array(left_out), axis=0))
