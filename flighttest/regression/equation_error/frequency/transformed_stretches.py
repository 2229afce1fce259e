"""Finite Fourier transforms of the stretches of a record, inside a frequency band."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from flightmech.errors import IdentificationError
from flighttest.records.signals.fourier import finite_fourier, harmonics, remove_straight_line
from flighttest.regression.equation_error.samples import RegressionSamples

_ROUNDING = 1e-9  # cycles of the lower band edge that a stretch may miss by rounding


@dataclass(frozen=True)
class TransformedStretch:
    """Position of one stretch without a gap in the samples and in the transformed rows.

    Attributes
    ----------
    samples : slice
        Samples of the stretch.
    step : float
        Sampling interval. [s]
    frequencies : array (frequencies,)
        Frequencies of the transform. [Hz]
    rows : slice
        Rows of the transform, one per frequency.
    """

    samples: slice
    step: float
    frequencies: np.ndarray
    rows: slice

    @property
    def duration(self) -> float:
        """Length of the record, one step per sample. [s]"""
        return (self.samples.stop - self.samples.start) * self.step


def select_stretches(
    samples: RegressionSamples, band: tuple[float, float], spacing: float | None = None
) -> list[TransformedStretch]:
    """Return the stretches that reach down to the band, with the frequencies of each.

    Parameters
    ----------
    samples : RegressionSamples
    band : (low, high)
        Edges of the band, both inside it; a stretch shorter than 1/low is left out. [Hz]
    spacing : float, optional
        Spacing of the frequencies; default one over the duration of each stretch. [Hz]

    Raises
    ------
    IdentificationError
        No stretch is long enough, or the band is not valid.
    """
    stretches: list[TransformedStretch] = []
    first_row, longest = 0, 0.0
    for piece, step in zip(*samples.pieces()):
        duration = (piece.stop - piece.start) * step
        longest = max(longest, duration)
        if duration * band[0] < 1.0 - _ROUNDING:
            continue
        # Multiples of one over the duration are independent values of the spectrum.
        period = duration
        if spacing is not None:
            period = 1.0 / spacing
        frequencies = harmonics(period, *band)
        rows = slice(first_row, first_row + len(frequencies))
        stretches.append(TransformedStretch(piece, step, frequencies, rows))
        first_row = rows.stop
    if not stretches:
        raise IdentificationError(
            f"no stretch is as long as 1/{band[0]:g} Hz, the longest is {longest:.3g} s; "
            f"raise the lower edge of the band"
        )
    return stretches


def transform_columns(columns: np.ndarray, parts: Sequence[TransformedStretch]) -> np.ndarray:
    """Return the scaled transforms of sampled columns, complex (rows, columns).

    Parameters
    ----------
    columns : array (samples, columns)
    parts : sequence of TransformedStretch
    """
    rows = []
    for part in parts:
        detrended = remove_straight_line(columns[part.samples])
        transform = finite_fourier(detrended, part.step, part.frequencies)
        # The root of the duration gives long and short stretches the weight of their information.
        rows.append(transform / np.sqrt(part.duration))
    return np.concatenate(rows)


def stack_complex(values: np.ndarray) -> np.ndarray:
    """Return complex rows as real rows: real parts above imaginary parts."""
    return np.concatenate([values.real, values.imag])


def fill_rows(parts: Sequence[TransformedStretch], values: Sequence[float]) -> np.ndarray:
    """Return one value per stretch, repeated for each of its frequencies, (rows,)."""
    columns = []
    for part, value in zip(parts, values):
        columns.append(np.full(len(part.frequencies), value))
    return np.concatenate(columns)
