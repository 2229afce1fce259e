"""Windows of a record that select the same samples twice."""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from itertools import pairwise

from flightmech.quantities import time_text

_SHARE = 0.5  # of the shorter window; ends that overlap less are those of neighbours


def repeated_windows(windows: Sequence[tuple[float, float]]) -> Iterator[str]:
    """Yield a line for windows of which more than half is in another window.

    Samples that count twice give standard errors that are too small.

    Parameters
    ----------
    windows : sequence of (float, float)
        Start and end; ``(-inf, inf)`` is the whole record. [s]
    """
    # If any two windows overlap by more than the share, so do two neighbours in order of start.
    for (first, last), (start, stop) in pairwise(sorted(windows)):
        end = min(last, stop)
        if math.isinf(end - start):
            yield "the whole record is taken twice; take it once"
        elif end - start > _SHARE * min(last - first, stop - start):
            yield f"{time_text(start)} ... {time_text(end)} s is taken twice; take it once"
