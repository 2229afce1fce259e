"""One manoeuvre, its simulation and the filter of its readings."""

from __future__ import annotations

from collections.abc import Sequence
from itertools import chain

import numpy as np

from flighttest.maximum_likelihood.flown_runs import output_slopes
from flighttest.maximum_likelihood.linear.gust_states import DrydenGust
from flighttest.maximum_likelihood.linear.innovation_likelihood import InnovationSlopes
from flighttest.maximum_likelihood.linear.positive_unknowns import DEVIATIONS, LENGTHS
from flighttest.maximum_likelihood.nonlinear.extended_filter import FilterSettings, filter_flights
from flighttest.maximum_likelihood.nonlinear.kernel_flights import KernelFlights
from flighttest.maximum_likelihood.time_domain import SimulatedRecord

FILTER_KINDS = ("process", "noise", "gust", "scale")  # unknowns that the simulation does not have
_AXES = {"beta": 1, "alpha": 2}  # body axis of the gusts of an angle


class FilteredFlight:
    """A manoeuvre as a piece of an `InnovationLikelihood`.

    Parameters
    ----------
    record : SimulatedRecord
    names : sequence of str
        Unknowns of this manoeuvre.
    starts : array (unknown,)
        Their start values: the search has deviations and lengths over their start.
    coordinates : sequence of str
        That the filter corrects.
    gusts : sequence of DrydenGust
    """

    def __init__(
        self,
        record: SimulatedRecord,
        names: Sequence[str],
        starts: np.ndarray,
        coordinates: Sequence[str],
        gusts: Sequence[DrydenGust],
    ):
        self.record, self.names, self.starts = record, list(names), starts
        self.coordinates, self.gusts = list(coordinates), list(gusts)
        self.z, self.step = record.measured, record.interval
        kinds = [name.split(".")[0] for name in names]
        self.is_deviation = np.array([kind in DEVIATIONS for kind in kinds])
        self.is_length = np.array([kind in LENGTHS for kind in kinds])
        # positions of the unknowns of the simulation and of the instruments
        self.simulated = [k for k, name in enumerate(names) if not is_of_filter(name)]
        record.set_unknowns([names[k] for k in self.simulated])
        self.flights = KernelFlights(
            record.sim,
            record.time,
            record.u,
            record.output_names,
            inertial=list(chain.from_iterable(gust.inertial for gust in gusts)),
            coordinates=coordinates,
            axes=[_AXES[gust.state] for gust in gusts],
        )
        self.last = (np.empty(0), np.empty(0), np.empty(0))  # values, innovations, variances

    def predict(self, values: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Return innovations (time, output) and variances (time, output, output); NaN without."""
        if not np.array_equal(values, self.last[0]):
            e, S = self._filter(values[None])
            self.last = values.copy(), e[0], S[0]
        return self.last[1], self.last[2]

    def slopes(self, values: np.ndarray, steps: np.ndarray) -> InnovationSlopes:
        """Return slopes by central differences; one-sided ones where a run fails."""
        values, shifts = self.above_zero(values, steps), np.diag(steps)
        e, S = self._filter(values + np.concatenate([shifts, -shifts]))
        succeeded = np.isfinite(e).all(axis=(1, 2))
        count = len(steps)
        base = [np.zeros(self.z.shape), np.zeros(S.shape[1:])]
        if not succeeded.all():
            base = list(self.predict(values))
        flat = S.reshape(len(S), S.shape[1], -1)
        de = output_slopes(base[0], e[:count], down=e[count:], steps=steps, succeeded=succeeded)
        dS = output_slopes(
            base[1].reshape(flat.shape[1:]),
            flat[:count],
            down=flat[count:],
            steps=steps,
            succeeded=succeeded,
        )
        return InnovationSlopes(np.moveaxis(de, 0, 2), dS.reshape(count, *S.shape[1:]))

    def _filter(self, rows: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Return innovations and variances for rows of unknowns of the search."""
        record, of_simulation = self.record, self.natural(rows)[:, self.simulated]
        self.flights.start(record.varied, of_simulation[:, record.simulated], record.fixed)
        return filter_flights(self.flights, self.z, self.settings(rows), self.step)

    def natural(self, rows: np.ndarray) -> np.ndarray:
        """Return rows of unknowns of the search in their natural form."""
        deviation = self.starts * np.sqrt(np.abs(rows))
        length = self.starts * np.exp(self.is_length * rows)
        return np.select([self.is_deviation, self.is_length], [deviation, length], rows)

    def above_zero(self, values: np.ndarray, steps: np.ndarray) -> np.ndarray:
        """Return values about which differences are taken.

        A variance stays above zero: near it, the differences are those about two steps above.
        """
        return np.where(self.is_deviation, np.maximum(values, 2.0 * steps), values)

    def settings(self, rows: np.ndarray) -> FilterSettings:
        """Return the settings of the filters of rows of unknowns of the search."""
        natural, outputs = self.natural(rows), self.record.output_names
        runs, of_simulation = len(natural), natural[:, self.simulated]
        named = [dict(zip(self.names, row)) for row in natural]
        intensity = np.zeros((runs, len(self.coordinates) + 2 * len(self.gusts)))
        lags, time = np.zeros((runs, len(self.gusts), 2)), np.ones((runs, len(self.gusts)))
        for number, values in enumerate(named):
            for k, name in enumerate(self.coordinates):
                intensity[number, k] = values.get(f"process.{name}", 0.0)
            for k, gust in enumerate(self.gusts):
                found, (lead, lag) = gust.filter_values(values), gust.states
                place = len(self.coordinates) + 2 * k
                intensity[number, place] = found[f"process.{lead}"]
                lags[number, k] = found[f"init.{lead}"], found[f"init.{lag}"]
                time[number, k] = gust.time(values)
        factor, offset = np.ones((runs, len(outputs))), np.zeros((runs, len(outputs)))
        for k, (kind, output) in self.record.instruments.items():
            column = outputs.index(output)
            if kind == "factor":
                factor[:, column] *= of_simulation[:, k]
            else:
                offset[:, column] += of_simulation[:, k]
        return FilterSettings(
            intensity=intensity,
            noise=natural[:, [self.names.index(f"noise.{name}") for name in outputs]],
            factor=factor,
            offset=offset,
            lags=lags,
            time=time,
            speed=np.array([gust.speed for gust in self.gusts]),
        )


def is_of_filter(name: str) -> bool:
    """Return whether an unknown belongs to the filter, not to the simulation."""
    return name.split(".")[0] in FILTER_KINDS or name.startswith("init.gust_")
