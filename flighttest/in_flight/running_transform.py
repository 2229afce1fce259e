"""Finite Fourier transforms that are updated with every sample, on a fixed grid of frequencies.

The recursive transform of [Morelli1999]_ adds x_i exp(-2 pi j f t_i) for each sample. Here the sums
also hold the straight line that the batch removes, and the first and last samples that its end
corrections need. At any time the result is thus that of `transform_columns` on all samples so far.

References
----------
.. [Morelli1999] Morelli, Real-time parameter estimation in the frequency domain, AIAA 99-4043,
   1999; J. Guidance 23, 2000.
"""

from __future__ import annotations

import numpy as np

from flighttest.records.signals.fourier import ENDS, end_corrections


class RunningTransform:
    """Transform of one stretch without a gap.

    Parameters
    ----------
    frequencies : array (frequency,)
        [Hz]
    step : float
        Sampling interval. [s]
    columns : int

    Attributes
    ----------
    samples : int
        Number of samples so far.
    largest : array (columns,)
        Largest absolute values so far.
    """

    def __init__(self, frequencies: np.ndarray, step: float, columns: int):
        self.frequencies, self.step = frequencies, step
        self.samples = 0
        self.largest = np.zeros(columns)
        self._angle = 2.0 * np.pi * frequencies * step
        self._weight, self._ends = end_corrections(self._angle)
        # Sums of the columns, of a one and of a ramp, at every frequency and at frequency zero.
        self._sums = np.zeros((len(frequencies), columns + 2), complex)
        self._line_sums = np.zeros((2, columns))
        self._origin = np.zeros(columns)
        self._first = np.zeros((0, columns))
        self._last = np.zeros((0, columns))

    @property
    def duration(self) -> float:
        """Length of the stretch, one step per sample. [s]"""
        return self.samples * self.step

    def add(self, rows: np.ndarray) -> None:
        """Add samples (samples, columns)."""
        if not len(rows):
            return
        self.largest = np.maximum(self.largest, np.abs(rows).max(axis=0))
        if not self.samples:
            # Departures from the first sample: a large mean would cost digits.
            self._origin = rows[0].copy()
        rows = rows - self._origin
        number = self.samples + np.arange(len(rows))
        phases = np.exp(-1j * np.outer(self._angle, number))
        ramp = number.astype(float)
        self._sums += phases @ np.column_stack([rows, np.ones(len(rows)), ramp])
        self._line_sums += np.vstack([np.ones(len(rows)), ramp]) @ rows
        if len(self._first) < ENDS:
            self._first = np.concatenate([self._first, rows])[:ENDS]
        self._last = np.concatenate([self._last, rows])[-ENDS:]
        self.samples += len(rows)

    def transform(self) -> np.ndarray:
        """Return the transforms without the straight line, over the root of the duration.

        Returns
        -------
        complex array (frequency, columns)
        """
        n, columns = self.samples, len(self._origin)
        # Straight line by least squares about the middle: mean and slope of every column.
        middle = 0.5 * (n - 1.0)
        spread = n * (n * n - 1.0) / 12.0
        mean = self._line_sums[0] / n
        slope = (self._line_sums[1] - middle * self._line_sums[0]) / spread
        start = mean - middle * slope
        ones, ramp = self._sums[:, columns, None], self._sums[:, columns + 1, None]
        total = self._weight[:, None] * (self._sums[:, :columns] - ones * start - ramp * slope)
        first, number = np.arange(ENDS)[:, None], n - ENDS + np.arange(ENDS)[:, None]
        head = self._first - start - first * slope
        tail = (self._last - start - number * slope)[::-1]
        end_phase = np.exp(-1j * self._angle * (n - 1))
        total = total + self._ends @ head + end_phase[:, None] * (self._ends.conj() @ tail)
        return self.step * total / np.sqrt(self.duration)
