"""Cross plots: one quantity against another, for rows that compare curves (force against position, sweeps)."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from pom.criteria import Criterion
from pom.result import PomResult
from pom.tolerance import NotJudged, half_width

from .quantities import Label, label
from .traces import STEPS_PER_HEIGHT, step_of


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
    found: dict[tuple[str, str], Cross] = {}
    for criterion in result.case.criteria:
        pair = getattr(criterion, "abscissa", ""), criterion.channel
        if not all(pair) or pair in found or not criterion.applies or not {*pair} <= set(result.signals):
            continue
        cross = _cross(result, criterion)
        if cross is not None:
            found[pair] = cross
    return list(found.values())


def _cross(result: PomResult, criterion: Criterion) -> Cross | None:
    time = result.signals["time"].values
    inside = (time >= criterion.window[0] - 1e-9) & (time <= criterion.window[1] + 1e-9)
    names = tuple(c.name for c in result.case.criteria if c.channel == criterion.channel and c.measure == criterion.measure)
    x, y = label(criterion.abscissa), label(criterion.channel)
    runs = [run for run in ("flight", *result.runs) if np.isfinite(result.signals[criterion.channel].sel(run=run).values[inside]).any()]
    if "flight" not in runs:
        return None
    flight = result.signals[criterion.channel].sel(run="flight").values[inside]
    try:
        half = y.width(np.broadcast_to(half_width(criterion, flight), flight.shape))
    except (NotJudged, ValueError):
        half = np.full(flight.shape, np.nan)

    def cut(name: str, shown: Label) -> dict[str, np.ndarray]:
        return {run: shown.shown(result.signals[name].sel(run=run).values[inside]) for run in runs}

    return Cross(names, x, y, cut(criterion.abscissa, x), cut(criterion.channel, y), half)
