"""Estimates of a coefficient during flight: one per second of data.

Every second the transforms of the samples so far give a complex least-squares problem
[Morelli1999]_. Its estimates and standard errors are those of `regress_frequency` on the same
samples: the standard errors follow the spectrum of the residual. A stretch longer than the period
of the grid of frequencies is divided at that period, so that no information between its lines is
lost. Stretches below one period of the lower edge of the band are not used. Of the others the
newest half hour is kept (`KeptWindows`).

Terms may be candidates. A candidate enters where the evidence for it is strong: the Bayesian
information criterion [Schwarz1978]_, with the coloured standard error, rises by `STRONG`. The
choice is made anew each second from the data alone.

References
----------
.. [Morelli1999] Morelli, Real-time parameter estimation in the frequency domain, AIAA 99-4043,
   1999; J. Guidance 23, 2000.
.. [Schwarz1978] Schwarz, Estimating the dimension of a model, Annals of Statistics 6, 1978.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from dataclasses import replace

import numpy as np

from flightmech.aircraft.aircraft import Aircraft
from flightmech.errors import IdentificationError, UnknownName
from flighttest.in_flight.clocked_stretches import ClockedSamples
from flighttest.in_flight.coefficient_samples import CoefficientSamples
from flighttest.in_flight.flight_estimate import (
    LASTING,
    RECENT,
    STEADY,
    AccuracyGoal,
    FlightEstimate,
)
from flighttest.in_flight.kept_windows import KeptWindows, place_windows
from flighttest.in_flight.running_transform import RunningTransform
from flighttest.in_flight.slope_solution import (
    SlopeSolution,
    StreamRows,
    most_explaining,
    rate_solution,
    solve_slopes,
)
from flighttest.parameter_constraints import (
    Constraint,
    choose_active,
    eliminate,
    parse_constraints,
)
from flighttest.records.signals.fourier import harmonics
from flighttest.regression.equation_error.frequency.transformed_stretches import TransformedStretch
from flighttest.regression.equation_error.model import RegressionModel
from flighttest.regression.equation_error.problem import spell_term

BAND = (0.1, 2.0)  # [Hz]
SPACING = 0.01  # of the grid of frequencies [Hz]
STRONG = 6.0  # rise of the criterion with which a candidate enters: odds of twenty to one
EVERY = 1.0  # data between two estimates [s]
_SHORTEST = 8  # samples of a window at which a stretch is divided, at least


class FlightFollower:
    """Running estimates of one model.

    Parameters
    ----------
    model : RegressionModel
        Its terms are always estimated.
    aircraft : Aircraft, optional
        For coefficients and reduced rates; without it the stream must give them.
    band : (low, high)
        [Hz]
    spacing : float
        Of the frequencies. [Hz]
    candidates : sequence of str
        Further terms, which enter by evidence.
    goals : sequence of AccuracyGoal
    rate : float, optional
        Sampling rate; by default it is taken from the first stamps. [Hz]
    constraints : sequence of str
        Linear constraints among the terms, as of `regress`. Candidates of an equality, or of a
        limit that zeros do not satisfy, are in the model from the start.

    Raises
    ------
    IdentificationError
        A band or a spacing that gives no frequencies, or a model without a slope.
    UnknownName
        A goal of a term that is not in the model.
    SchemaError
        Constraints that cannot be read, or that contradict each other.
    """

    def __init__(
        self,
        model: RegressionModel,
        aircraft: Aircraft | None = None,
        band: tuple[float, float] = BAND,
        spacing: float = SPACING,
        candidates: Sequence[str] = (),
        goals: Sequence[AccuracyGoal] = (),
        rate: float | None = None,
        constraints: Sequence[str] = (),
    ):
        if not spacing > 0.0:
            raise IdentificationError(f"spacing is {spacing:g} Hz; a positive one is needed")
        self.frequencies = harmonics(1.0 / spacing, *band)
        self.band, self.spacing = band, spacing
        # Mean and trend of a stretch are removed, so that the constant is not a term.
        self.always = [term for term in model.terms if term != "1"]
        self.terms = list(RegressionModel(model.coefficient, [*self.always, *candidates]).terms)
        self.constraints = self._parse_constraints(model, constraints)
        if not self.always:
            raise IdentificationError(f"{model} has no slope; give at least one term")
        for goal in goals:
            if goal.term not in self.terms:
                raise UnknownName(goal.term, self.terms, "term of a goal", "the model lacks it")
        self.model, self.goals = model, tuple(goals)
        full = RegressionModel(model.coefficient, self.terms, model.reference)
        self.source = CoefficientSamples(full, aircraft)
        self.clock = ClockedSamples(given=0.0 if rate is None else 1.0 / rate)
        # State of the stream: open stretch, waiting stretches, and time of the next estimate.
        self._kept = KeptWindows(band[0])
        self._without_coefficient = 0
        self._open: RunningTransform | None = None
        self._waiting: list[tuple[np.ndarray, np.ndarray]] = []
        self._next = math.nan
        self._met = 0
        self._recent: list[FlightEstimate] = []
        self._time = math.nan

    def _parse_constraints(self, model: RegressionModel, texts: Sequence[str]) -> list[Constraint]:
        """Return constraints among the terms, with the terms that they need in front."""

        def parse() -> list[Constraint]:
            return parse_constraints(
                texts, self.terms, lambda name: spell_term(name, model.coefficient)
            )

        needed: dict[str, None] = dict.fromkeys(self.always)
        for constraint in parse():
            if constraint.is_equality or constraint.value > 0.0:
                needed |= {self.terms[k]: None for k in np.flatnonzero(constraint.weights)}
        self.always = list(needed)
        self.terms = list(dict.fromkeys([*self.always, *self.terms]))
        found = parse()
        # Contradictions end the program before the stream begins.
        count = len(self.terms)
        held = eliminate([one for one in found if one.is_equality], count)
        free = len(held.free)
        limits = [one for one in found if not one.is_equality]
        choose_active(limits, held, phi=np.zeros(free), information=np.eye(free))
        return found

    def choose_channels(self, available: Sequence[str]) -> list[str]:
        """Return the channels that the model needs; raise UnknownName for a missing one."""
        return self.source.choose_channels(available)

    def add(
        self, time: np.ndarray, values: np.ndarray, left_out: int = 0, final: bool = False
    ) -> Iterator[FlightEstimate]:
        """Yield the estimates of all whole seconds up to the given samples.

        Parameters
        ----------
        time : array (samples,)
            [s]
        values : array (samples, channels)
            In the order of `choose_channels`. [SI]
        left_out : int
            Lines of the stream that were left out so far, for the counts.
        final : bool
            Whether the stream ends here; the last estimate is then at the last sample.
        """
        for is_new, times, rows in self.clock.divide(time, values, final):
            if is_new:
                yield from self._flush(left_out)
                self._close()
                self.source.begin()
                self._next = math.nan
            self._waiting.append((times, rows))
            if self._is_due(float(times[-1])):
                yield from self._flush(left_out)
        if final:
            yield from self._flush(left_out)
        if final and not math.isnan(self._time):
            yield self.estimate(left_out)

    def _is_due(self, time: float) -> bool:
        """Return whether the waiting samples complete a second, or begin a stretch.

        Samples wait for it because a conversion of many takes as long as that of one.
        """
        if math.isnan(self._next):
            count = sum(len(times) for times, _ in self._waiting)
            return count > self.source.delay
        return time >= self._next + (self.source.delay - 0.5) * self.clock.step

    def _flush(self, left_out: int) -> Iterator[FlightEstimate]:
        """Convert the waiting samples, and yield the estimates of all whole seconds."""
        if not self._waiting:
            return
        times = np.concatenate([part[0] for part in self._waiting])
        rows = np.concatenate([part[1] for part in self._waiting])
        self._waiting = []
        times, rows = self.source.convert(times, rows)
        # A coefficient of free flight needs all wheels in the air: a stretch ends on the ground.
        usable = np.isfinite(rows).all(axis=1)
        edges = np.flatnonzero(np.diff(usable)) + 1
        for part in np.split(np.arange(len(times)), edges):
            if len(part) and not usable[part[0]]:
                self._without_coefficient += len(part)
                self._close()
            elif len(part):
                yield from self._add_part(times[part], rows[part], left_out=left_out)

    def _add_part(
        self, times: np.ndarray, rows: np.ndarray, left_out: int
    ) -> Iterator[FlightEstimate]:
        """Add samples (samples, 1 + terms) of one stretch; yield at every second."""
        # A stretch has the length that resolves the spacing of the frequencies.
        longest = max(_SHORTEST, round(1.0 / (self.spacing * self.clock.step)))
        first = 0
        while first < len(times):
            if self._open is None:
                self._open = RunningTransform(
                    self.frequencies, self.clock.step, 1 + len(self.terms)
                )
                if self.frequencies[-1] > 0.5 / self.clock.step:
                    raise IdentificationError(
                        f"{self.frequencies[-1]:g} Hz is beyond half the sampling rate, "
                        f"{0.5 / self.clock.step:g} Hz; lower the band"
                    )
            if math.isnan(self._next):
                self._next = times[first] + EVERY
            # Samples up to the end of the stretch, or up to the next estimate.
            last = min(len(times), first + longest - self._open.samples)
            due = np.flatnonzero(times[first:last] >= self._next - 0.5 * self.clock.step)
            if len(due):
                last = first + int(due[0]) + 1
            self._open.add(rows[first:last])
            self._time = float(times[last - 1])
            if self._open.samples >= longest:
                self._close()
            if len(due):
                # After a jump of the time the missed seconds have no estimate of their own.
                behind = (self._time - self._next) / EVERY
                self._next += EVERY * max(1.0, math.floor(behind + 0.5) + 1.0)
                yield self.estimate(left_out)
            first = last

    def _close(self) -> None:
        """Close the open window."""
        if self._open is not None:
            self._kept.close(self._open)
        self._open = None

    def estimate(self, left_out: int = 0) -> FlightEstimate:
        """Return the estimates from the samples so far that are kept."""
        counts = {
            "left_out": left_out,
            "bridged": self.clock.bridged,
            "gaps": self.clock.gaps,
            "clock_jumps": self.clock.jumps,
            "repeated": self.clock.repeated,
            "without_coefficient": self._without_coefficient,
            "too_short": self._kept.too_short,
            "forgotten_windows": self._kept.forgotten,
        }
        windows = self._kept.with_open(self._open)
        if not windows:
            text = f"waiting for {1.0 / self.band[0]:.3g} s without a gap"
            return self._without_estimate(text, counts)
        stream = StreamRows(
            str(self.model.coefficient),
            self.terms,
            rows=np.concatenate([window.rows for window in windows]),
            parts=place_windows(windows, self.frequencies),
            largest=np.max([window.largest for window in windows], axis=0),
        )
        try:
            solved, refused = self._choose_terms(stream)
        except IdentificationError as error:
            return self._without_estimate(str(error), counts)
        stored = ""
        if self.constraints:
            stored = rate_solution(stream, solved, self.constraints, refused)
        found = FlightEstimate(
            self._time,
            sum(window.samples for window in windows),
            tuple(self.terms[k] for k in solved.used),
            solved.theta,
            np.sqrt(np.diag(solved.covariance)),
            R2=solved.R2,
            counts=counts,
            constraints=stored,
        )
        unsteady = self._find_unsteady(found)
        is_met = bool(self.goals)
        for goal in self.goals:
            is_met = is_met and goal.is_met(found) and goal.term not in unsteady
        self._met = self._met + 1 if is_met else 0
        self._recent = [*self._recent, found][-RECENT:]
        return replace(found, unsteady=unsteady, is_accurate=self._met >= LASTING)

    def _find_unsteady(self, found: FlightEstimate) -> tuple[str, ...]:
        """Return the terms that have left one of the recent estimates."""
        unsteady: dict[str, None] = {}
        for earlier in self._recent:
            # Another choice of terms changes the meaning of all of them.
            if earlier.terms == found.terms:
                moved = np.abs(found.values - earlier.values) > STEADY * earlier.stderr
                unsteady |= {found.terms[k]: None for k in np.flatnonzero(moved)}
        return tuple(unsteady)

    def _without_estimate(self, text: str, counts: dict[str, int]) -> FlightEstimate:
        self._met = 0
        return FlightEstimate(self._time, 0, waiting=text, counts=counts)

    def _choose_terms(self, stream: StreamRows) -> tuple[SlopeSolution, list[SlopeSolution]]:
        """Return the estimates of the terms of the model and of the candidates with evidence.

        The second result are the trials of the candidates that an active limit holds.
        """
        used = list(range(len(self.always)))
        solved = solve_slopes(stream, used, self.constraints)
        remaining = list(range(len(self.always), len(self.terms)))
        refused: list[SlopeSolution] = []
        while remaining:
            best = most_explaining(stream, remaining, solved)
            remaining.remove(best)
            try:
                tried = solve_slopes(stream, [*solved.used, best], self.constraints)
            except IdentificationError:
                continue
            if tried.factor[-1] == 0.0:
                # A candidate that a limit holds has no evidence of its own; the next one may.
                refused.append(tried)
                continue
            # Rise of the criterion by one term: t^2 - ln n, with the independent equations n.
            count = _independent_equations(stream.parts)
            if tried.t_of_last**2 - math.log(count) < STRONG:
                break
            # With another term in the model the limits may not hold the refused ones any more.
            remaining += [trial.used[-1] for trial in refused]
            solved, refused = tried, []
        return solved, refused


def _independent_equations(parts: Sequence[TransformedStretch]) -> float:
    """Return the number of independent real equations: two for each 1/T of the band."""
    total = 0.0
    for part in parts:
        width = float(part.frequencies[-1] - part.frequencies[0])
        total += 2.0 * min(len(part.frequencies), 1.0 + width * part.duration)
    return max(2.0, total)
