"""What a measure looks at: flight and one model over the samples of a case."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field, replace
from typing import TYPE_CHECKING, Any

import numpy as np

from ..tolerances.bands import NotJudged, demand_finite, inside_window
from ..tolerances.criteria import Criterion
from ..tolerances.row_conditions import sample_mask
from .signals import Raw, Signals, signals_of

if TYPE_CHECKING:
    from ..cases.case import PomCase

WHO = ("flight", "the model")


@dataclass(frozen=True)
class Match:
    """Flight and one model on the clock of the record.

    Attributes
    ----------
    case : PomCase
        Gives events, features and certified values.
    time : array (time,)
        [s]
    flight, model : Signals
        [SI]
    """

    case: PomCase
    time: np.ndarray
    flight: Signals
    model: Signals
    _of_flight: dict[Any, Any] = field(default_factory=dict, repr=False, compare=False)

    @classmethod
    def of(cls, case: PomCase, time: np.ndarray, flight: Raw, model: Raw) -> Match:
        """Return the match of two runs by canonical name."""
        return cls(case, time, signals_of(case, flight, time), signals_of(case, model, time))

    def against(self, model: Raw) -> Match:
        """Return the match of the same flight and another model; what depends on the flight alone is not computed again."""
        return replace(self, model=signals_of(self.case, model, self.time))

    def once(self, key: Any, of_flight: Callable[[], Any]) -> Any:
        """Return what depends on case and flight alone, computed for the first of the models only."""
        if key not in self._of_flight:
            self._of_flight[key] = of_flight()
        return self._of_flight[key]

    def both(self, criterion: Criterion, channel: str = "") -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Return time, flight and model over the samples that a criterion counts; those of the flight are not to be changed.

        Raises
        ------
        Invalid
            The record is short, time does not rise, or a value is missing.
        """
        place, channel = (criterion.window, criterion.condition), channel or criterion.channel
        mask = self.once(place, lambda: inside_window(self.time, criterion.window) & self.counted(criterion))
        time, flight = self.once((place, channel), lambda: self._checked(mask, channel))
        model = self.model[channel][mask]
        demand_finite(WHO[1], time, model)
        return time, flight, model

    def _checked(self, mask: np.ndarray, channel: str) -> tuple[np.ndarray, np.ndarray]:
        time, flight = self.time[mask], self.flight[channel][mask]
        demand_finite(WHO[0], time, flight)
        time.flags.writeable = flight.flags.writeable = False
        return time, flight

    def over(self, mask: np.ndarray, channel: str) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Return time, flight and model over the samples of a mask."""
        time, flight, model = self.time[mask], self.flight[channel][mask], self.model[channel][mask]
        for who, values in zip(WHO, (flight, model), strict=True):
            demand_finite(who, time, values)
        return time, flight, model

    def counted(self, criterion: Criterion) -> np.ndarray:
        """Return the samples at which the condition of the row holds in flight; all when it has none on samples."""
        if not criterion.condition:
            return np.ones(self.time.size, bool)
        mask = sample_mask(criterion.condition, self.case.events, self.time, self.flight)
        if not mask[inside_window(self.time, criterion.window)].any():
            raise NotJudged(f"no sample of the window has {criterion.condition}")
        return mask
