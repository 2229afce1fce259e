"""A flight linearised along its open-loop simulation.

Innovations of a linear system are the filter's answer to the residuals of output error. Outputs,
their slopes by the parameters and the linear model along the flight therefore suffice for a search
without further simulation. Its end is the start of the search with the simulation itself.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from flighttest.maximum_likelihood.linear.innovation_likelihood import InnovationSlopes
from flighttest.maximum_likelihood.nonlinear.extended_filter import (
    count_between,
    filter_flights,
)
from flighttest.maximum_likelihood.nonlinear.filtered_flight import FilteredFlight
from flighttest.maximum_likelihood.nonlinear.kernel_flights import StepSlopes


class LinearisedFlights:
    """Deviations from one open-loop simulation, in place of `KernelFlights`.

    Parameters
    ----------
    models : sequence of StepSlopes
        Of one run, at every linearisation.
    every : int
        Samples between two of them.
    y : array (run, time, output)
        Open-loop outputs.
    """

    def __init__(self, models: Sequence[StepSlopes], every: int, y: np.ndarray):
        self.models, self.every, self.y = models, every, y
        self.failed = ~np.isfinite(y).all(axis=(1, 2))
        self.deviation = np.zeros((len(y), models[0].F.shape[2]))

    def _model(self, sample: int) -> StepSlopes:
        return self.models[min(sample // self.every, len(self.models) - 1)]

    def look(self, sample: int, gusts: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Return deviations and outputs (run, output)."""
        model = self._model(sample)
        moved = self.deviation @ model.H[0].T + gusts @ model.H_gust[0].T
        return self.deviation, self.y[:, sample] + moved

    def correct(self, changes: np.ndarray, coordinates: np.ndarray) -> np.ndarray:
        """Correct the deviations, and return them."""
        self.deviation = coordinates + changes
        return self.deviation

    def advance(
        self, sample: int, first: np.ndarray, last: np.ndarray, coordinates: np.ndarray
    ) -> None:
        """Advance to the next sample with gusts linear between two values."""
        model = self._model(sample)
        self.deviation = (
            coordinates @ model.F[0].T
            + first @ model.F_gust[0].T
            + (last - first) @ model.F_rise[0].T
        )

    def linearise(self, sample: int, gusts: np.ndarray, coordinates: np.ndarray) -> StepSlopes:
        """Return the linear model over the next step, the same for all runs."""
        model = self._model(sample)
        return StepSlopes(*(np.repeat(part, len(self.y), axis=0) for part in model))


class LinearisedPiece:
    """A manoeuvre as a piece of an `InnovationLikelihood`, linearised about given parameters.

    Parameters
    ----------
    piece : FilteredFlight
    values : array (unknown,)
        Unknowns of the search at the point of linearisation.
    steps : array (unknown,)
        Steps of the differences there.
    """

    def __init__(self, piece: FilteredFlight, values: np.ndarray, steps: np.ndarray):
        self.piece, self.centre = piece, values.copy()
        self.z, self.step = piece.z, piece.step
        self.every = count_between(piece.step)
        record, chosen = piece.record, piece.simulated
        natural = piece.natural(values[None])[0]
        self.y = record.predict(natural[chosen])
        self.slope = record.slopes(natural[chosen], steps[chosen], central=True)
        self.models = self._linearise_along(natural)

    def _linearise_along(self, natural: np.ndarray) -> list[StepSlopes]:
        """Return the linear models along the open-loop simulation."""
        record, flights = self.piece.record, self.piece.flights
        varied = natural[self.piece.simulated][record.simulated]
        flights.start(record.varied, varied[None], record.fixed)
        calm, models = np.zeros((1, len(flights.axes))), []
        for sample in range(len(self.z) - 1):
            coordinates, _ = flights.look(sample, calm)
            if sample % self.every == 0:
                models.append(flights.linearise(sample, calm, coordinates))
            flights.advance(sample, calm, calm, coordinates)
        return models

    def _filter(self, rows: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        chosen = self.piece.simulated
        y = self.y + np.moveaxis(self.slope @ (rows - self.centre)[:, chosen].T, 2, 0)
        settings = self.piece.settings(rows)
        # The instruments are in the outputs already.
        neutral = settings._replace(
            factor=np.ones_like(settings.factor), offset=np.zeros_like(settings.offset)
        )
        flights = LinearisedFlights(self.models, self.every, y)
        return filter_flights(flights, self.z, neutral, self.step)

    def predict(self, values: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Return innovations (time, output) and variances (time, output, output)."""
        e, S = self._filter(values[None])
        return e[0], S[0]

    def slopes(self, values: np.ndarray, steps: np.ndarray) -> InnovationSlopes:
        """Return slopes by central differences."""
        values = self.piece.above_zero(values, steps)
        shifts = np.diag(steps)
        e, S = self._filter(values + np.concatenate([shifts, -shifts]))
        count, width = len(steps), 2.0 * steps
        de = (e[:count] - e[count:]) / width[:, None, None]
        dS = (S[:count] - S[count:]) / width[:, None, None, None]
        return InnovationSlopes(np.moveaxis(de, 0, 2), dS)
