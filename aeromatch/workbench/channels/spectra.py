"""Power spectral densities of channels, averaged over the stretches without a gap."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
from scipy.signal import welch

# Relative difference below which two sampling intervals are equal.
_SAME_RATE = 1e-3


def average_densities(
    lines: Mapping[str, np.ndarray],
    stretches: Sequence[tuple[slice, float]],
    longest: int,
) -> dict[str, Any]:
    """Return one-sided power spectral densities by the method of Welch.

    The segments have a Hann window, overlap by half, and are as long as the lower median of the
    stretches, `longest` samples at most.  Each segment is taken about its mean.  Shorter
    stretches, and stretches with another sampling interval than the lower median, are left out.

    Parameters
    ----------
    lines : mapping of str to ndarray (samples,)
    stretches : sequence of (slice, float)
        Samples without a gap, and their sampling interval. [s]
    longest : int
        Samples of the longest segment.

    Returns
    -------
    dict
        ``frequency`` [Hz] without zero, ``densities`` by line [unit2/Hz], ``segments``,
        ``samples`` of a segment, ``step`` [s], ``used`` (stretches), ``left_out`` (their number).

    References
    ----------
    .. [Welch1967] Welch, The use of fast Fourier transform for the estimation of power spectra,
       IEEE Trans. Audio AU-15, 1967.
    """
    # The lower median: the mean of two rates is the rate of no stretch.
    intervals = sorted(interval for _, interval in stretches)
    step = intervals[(len(intervals) - 1) // 2]
    alike = [piece for piece, interval in stretches if abs(interval - step) < _SAME_RATE * step]
    lengths = sorted(piece.stop - piece.start for piece in alike)
    size = min(longest, lengths[(len(lengths) - 1) // 2])
    used = [piece for piece in alike if piece.stop - piece.start >= size]
    # Segments of each stretch: the first, and one for each further half segment.
    counts = [(piece.stop - piece.start - size) // (size - size // 2) + 1 for piece in used]
    densities: dict[str, np.ndarray] = {}
    frequency = np.zeros(0)
    for name, line in lines.items():
        powers = []
        for piece in used:
            frequency, power = welch(
                line[piece],
                fs=1.0 / step,
                window="hann",
                nperseg=size,
                noverlap=size // 2,
                detrend="constant",
            )
            powers.append(power)
        # The mean over all segments, so a stretch counts by its segments. The mean value of a
        # segment is removed, so the frequency 0 is left out.
        densities[name] = np.average(powers, axis=0, weights=counts)[1:]
    return {
        "frequency": frequency[1:],
        "densities": densities,
        "segments": int(np.sum(counts)),
        "samples": size,
        "step": step,
        "used": used,
        "left_out": len(stretches) - len(used),
    }
