"""Transforms of the closed windows of a stream, kept for a time, so that the work stays bounded."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field

import numpy as np

from flighttest.in_flight.running_transform import RunningTransform
from flighttest.regression.equation_error.frequency.transformed_stretches import TransformedStretch

KEPT = 1800.0  # total length of the windows that are kept [s]
_SHORTEST = 8  # samples of a transform
_ROUNDING = 1e-9  # share of a length that rounding of the sampling interval changes


@dataclass(frozen=True)
class SpectralWindow:
    """Transforms (frequency, 1 + terms) of one window."""

    rows: np.ndarray
    samples: int
    step: float
    largest: np.ndarray


@dataclass
class KeptWindows:
    """Newest windows of a stream.

    Attributes
    ----------
    lowest : float
        Lower edge of the band, of which a window holds at least one period. [Hz]
    closed : list of SpectralWindow
        Newest last.
    forgotten, too_short : int
        Windows that were forgotten, and samples of windows without one period.
    """

    lowest: float
    closed: list[SpectralWindow] = field(default_factory=list)
    forgotten: int = 0
    too_short: int = 0

    def close(self, window: RunningTransform) -> None:
        """Keep a window that is long enough, and forget the oldest beyond `KEPT` seconds."""
        if not self._is_long(window):
            self.too_short += window.samples
            return
        self.closed.append(_window_of(window))
        lengths = [kept.samples * kept.step for kept in self.closed]
        # Windows are counted by their length: gaps make many short ones.
        while len(lengths) > 1 and sum(lengths) > KEPT * (1.0 + _ROUNDING):
            del lengths[0], self.closed[0]
            self.forgotten += 1

    def with_open(self, window: RunningTransform | None) -> list[SpectralWindow]:
        """Return all windows, and the open one if it is long enough."""
        if window is None or not self._is_long(window):
            return list(self.closed)
        return [*self.closed, _window_of(window)]

    def _is_long(self, window: RunningTransform) -> bool:
        is_whole = window.duration * self.lowest >= 1.0 - _ROUNDING
        return is_whole and window.samples >= _SHORTEST


def _window_of(running: RunningTransform) -> SpectralWindow:
    return SpectralWindow(running.transform(), running.samples, running.step, running.largest)


def place_windows(
    windows: Sequence[SpectralWindow], frequencies: np.ndarray
) -> list[TransformedStretch]:
    """Return the positions of the windows in samples and rows."""
    parts, sample, row = [], 0, 0
    for window in windows:
        parts.append(
            TransformedStretch(
                slice(sample, sample + window.samples),
                window.step,
                frequencies,
                slice(row, row + len(frequencies)),
            )
        )
        sample, row = sample + window.samples, row + len(frequencies)
    return parts
