"""Cross plots: one quantity against another, for rows that compare curves (force against position, sweeps)."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from pom.judging.signals import Signals, signals_of, traces_of
from pom.result import PomResult
from pom.tolerances.bands import NotJudged, half_width, inside_window
from pom.tolerances.criteria import Criterion

from ..presentation.quantities import Label, label
from ..presentation.traces import STEPS_PER_HEIGHT, step_of


@dataclass(frozen=True)
class Cross:
    """One cross plot; `x`, `y` by run over the window of the criterion, `half` the half width at the flight samples. [display units]"""

    criteria: tuple[str, ...]
    abscissa: Label
    ordinate: Label
    x: dict[str, np.ndarray]
    y: dict[str, np.ndarray]
    half: np.ndarray

    @property
    def words(self) -> str:
        """Alternative text."""
        return f"{self.ordinate.words or self.ordinate.name} against {self.abscissa.words or self.abscissa.name}"

    @property
    def steps(self) -> tuple[float, float]:
        """Steps in which abscissa and ordinate are stored."""
        x = np.concatenate(list(self.x.values()))
        span = float(np.nanmax(x) - np.nanmin(x)) or 1.0
        y = np.concatenate(list(self.y.values()))
        return span / (2 * STEPS_PER_HEIGHT), step_of(self.half, (float(np.nanmin(y)), float(np.nanmax(y))))


def crosses(result: PomResult) -> list[Cross]:
    """Return the cross plots of the criteria that compare curves; several criteria on one pair of channels share a plot."""
    curves = [c for c in result.case.criteria if c.abscissa and c.channel and c.applies]
    if not curves:
        return []
    time = result.signals["time"].values
    held = {run: _signals(result, run, time) for run in ("flight", *result.runs)}
    found: dict[tuple[str, str], Cross] = {}
    for criterion in curves:
        pair = criterion.abscissa, criterion.channel
        runs = {run: signals for run, signals in held.items() if all(name in signals for name in pair)}
        if pair not in found and "flight" in runs:
            found[pair] = _cross(result, criterion, runs, inside_window(time, criterion.window))
    return list(found.values())


def _signals(result: PomResult, run: str, time: np.ndarray) -> Signals:
    """Return what a run holds of the channels of a result."""
    return signals_of(result.case, traces_of(result.signals, run), time)


def _cross(result: PomResult, criterion: Criterion, runs: Mapping[str, Signals], inside: np.ndarray) -> Cross:
    names = tuple(c.name for c in result.case.criteria if (c.abscissa, c.channel) == (criterion.abscissa, criterion.channel))
    x, y = label(criterion.abscissa), label(criterion.channel)
    flight = runs["flight"][criterion.channel][inside]
    try:
        half = y.width(np.broadcast_to(half_width(criterion, flight), flight.shape))
    except NotJudged:
        half = np.full(flight.shape, np.nan)
    xs, ys = ({run: shown.shown(signals[shown.name][inside]) for run, signals in runs.items()} for shown in (x, y))
    return Cross(names, x, y, xs, ys, half)
