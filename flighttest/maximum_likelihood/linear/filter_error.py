"""Filter error: maximum likelihood of linear models with process noise, such as turbulence.

After a gust, an open-loop simulation deviates from the measured path permanently. The filter
predicts one sample ahead from all previous samples. Its innovations are white if the model is
correct, and the likelihood is that of the innovations [Maine1981]_, [Jategaonkar]_:

    J = 1/2 sum_k e_k' S^-1 e_k + N/2 ln |S| + 1/2 (theta - theta_0)' P^-1 (theta - theta_0)

The intensities of the disturbance and the noise of the instruments are unknowns too. They are
estimated as variances. S and the gain follow from them. The search uses Fisher's scoring:
M_ij = sum e_i' S^-1 e_j + N/2 tr(S^-1 S_i S^-1 S_j), with e_i and S_i by central differences.

References
----------
.. [Maine1981] Maine, Iliff, Formulation and implementation of a practical algorithm for parameter
   estimation with process and measurement noise, SIAM J. Appl. Math. 41, 1981.
.. [Jategaonkar] Jategaonkar, Flight Vehicle System Identification, 2nd ed., AIAA 2015, ch. 5.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from typing import NamedTuple

import numpy as np
import xarray as xr

from flightmech.errors import IdentificationError, SchemaError
from flighttest.maximum_likelihood.constrained_unknowns import (
    ConstrainedPiece,
    constrain_unknowns,
)
from flighttest.maximum_likelihood.innovations import whiteness_variables
from flighttest.maximum_likelihood.linear.gust_states import DrydenGust, add_gusts, gust_starts
from flighttest.maximum_likelihood.linear.positive_unknowns import (
    DEVIATIONS,
    LENGTHS,
    transform_positive,
)
from flighttest.maximum_likelihood.linear.state_space import (
    LinearModel,
    Predictor,
    demand_known,
    filter_innovations,
    innovation_slopes,
    input_output_arrays,
    make_predictor,
    pick_values,
    steady_filter,
)
from flighttest.maximum_likelihood.residual_covariance import (
    coloured_likelihood_covariance,
    effect_on_motion,
    warn_of_turbulence,
)
from flighttest.maximum_likelihood.result import OutputError, estimates_dataset, noise_dataset
from flighttest.maximum_likelihood.search import LikelihoodMaximum, maximise_likelihood
from flighttest.maximum_likelihood.time_domain import uniform_step
from flighttest.maximum_likelihood.unknowns import Unknown, UnknownVector, Wanted, lay_out
from flighttest.parameter_constraints import parse_constraints
from flighttest.regression.equation_error.samples import list_manoeuvres

_INTENSITIES = ("process", "gust")
_LEAST = 1e-6  # smallest start of a noise, of the spread of the output
_LEAST_NOISE = 1e-12  # smallest start of a noise
_START_FACTORS = (1e-3, 1e3)  # of the variance of an intensity, for further starts of the search
_SAME_COST = 0.01  # ends of a search that differ by less are one maximum


def filter_error(
    model: LinearModel,
    manoeuvres: xr.Dataset | Sequence[xr.Dataset],
    parameters: Wanted,
    gusts: Sequence[DrydenGust] = (),
    iterations: int = 50,
    constraints: Sequence[str] = (),
) -> OutputError:
    """Estimate parameters of a linear model from records in turbulence.

    Parameters
    ----------
    model : LinearModel
        As from `linear_model`.
    manoeuvres : Dataset (time,) or sequence of Dataset
        Inputs and measured outputs of the model on a uniform ``time``. [SI]
    parameters : mapping of str to Unknown, tuple or float
        Parameters of the model; ``process.alpha``, intensity of the disturbance of a state [its
        unit per square root of second]; ``noise.alpha``, standard deviation of the noise of an
        output, with a start from the record by default; ``init.alpha``, a state at the first
        sample, default zero; ``drift.alpha``, a constant in its rate; ``sensor.alpha``, a constant
        added to an output; ``gust.w`` and ``scale.w``, intensity and scale of a gust, which are as
        given otherwise. [SI]
    gusts : sequence of DrydenGust
        Gusts that drive the model besides ``process.*``. The gust at the first sample of each
        manoeuvre, ``init.gust_w``, is an unknown. [SI]
    iterations : int
        Largest number of iterations.
    constraints : sequence of str
        Linear constraints among the parameters of the model, as of `linear_output_error`; not of
        noises, intensities and scales. [SI]

    Returns
    -------
    OutputError
        ``residuals`` are the innovations. Without ``process.*`` and gusts the result is that of
        `linear_output_error` with the noise among the unknowns.

    Warns
    -----
    AeromatchWarning
        There are neither ``process.*`` nor gusts, and the residuals are a disturbance of the motion.

    Raises
    ------
    UnknownName
        A parameter that the model does not have, or a signal that the record does not hold.
    SchemaError
        ``process.*``, ``noise.*``, ``gust.*`` or ``scale.*`` that does not start above zero, an
        output that may be air-relative or inertial, samples that are not finite, time that is not
        uniform.
    IdentificationError
        The start does not have a filter, or the records cannot determine the unknowns.
    """
    records = list_manoeuvres(manoeuvres)
    states, outputs = model.states, model.outputs
    extra = {"process": states, "init": states, "drift": states, "noise": outputs}
    names = tuple(gust.name for gust in gusts)
    extra |= {"gust": names, "scale": names}
    extra["init"] = (*states, *(f"gust_{gust.name}" for gust in gusts))
    demand_known(model, list(parameters), {**extra, "sensor": outputs})
    moved = add_gusts(model, gusts)
    starts = _noise_starts([input_output_arrays(model, record)[1] for record in records])
    unknowns: Wanted = {f"noise.{name}": Unknown(start) for name, start in zip(outputs, starts)}
    # Every output has a noise; given parameters replace the starts from the record.
    natural = lay_out({**unknowns, **gust_starts(gusts), **parameters}, [{} for _ in records])
    _demand_natural(natural, constraints)
    constrained = constrain_unknowns(natural, constraints)
    transformed = transform_positive(constrained.layout)
    layout = transformed.layout
    everything = replace(constrained, full=transform_positive(constrained.full).layout)
    pieces = []
    for record, names, columns in zip(records, natural.bases, natural.columns):
        starts = natural.start[columns]
        pieces.append(_FilteredRecord(moved, record, gusts=gusts, names=names, starts=starts))
    maximum, worse = _search_from_several_starts(
        _InnovationLikelihood(constrained.wrap(pieces, _ConstrainedFilter), layout),
        layout,
        iterations=iterations,
    )
    white = _whiten_innovations(maximum)
    covariance, colours = coloured_likelihood_covariance(
        white, layout.columns, [piece.step for piece in pieces]
    )

    theta, scale = transformed.back(maximum.theta)
    size = np.outer(scale, scale)
    # The steps that remain are those of the natural unknowns too.
    remaining = maximum.remaining * scale
    in_deviations = replace(
        white, theta=theta, information=maximum.information / size, remaining=remaining
    )
    estimates = estimates_dataset(
        in_deviations,
        constrained.layout,
        covariance=covariance * size,
        about={"method": "filter error", "worse_starts": worse},
    )
    estimates = everything.rate(
        constrained.expand(estimates),
        _InnovationLikelihood(pieces, everything.full),
        maximum.theta,
        lambda end, full: coloured_likelihood_covariance(
            _whiten_innovations(end), full.columns, [piece.step for piece in pieces]
        )[0],
    )

    # The noise is reported in the unit of the outputs, the effect in white units.
    innovations = maximum.residuals.parts
    scaled = [piece.z / np.sqrt(R) for piece, R in zip(pieces, maximum.noise)]
    scatter = noise_dataset(
        replace(white, residuals=innovations, noise=maximum.noise),
        list(outputs),
        colours=colours,
        measured=[piece.z for piece in pieces],
        effect=effect_on_motion(white, layout.columns, covariance=covariance, measured=scaled),
    )
    scatter = scatter.merge(whiteness_variables(innovations, [piece.step for piece in pieces]))
    warnings: tuple[str, ...] = ()
    if not gusts and not any(name.startswith("process.") for name in parameters):
        warnings = warn_of_turbulence(scatter)
    residuals = tuple(piece.residual(e) for piece, e in zip(pieces, innovations))
    return OutputError(estimates, residuals, noise=scatter, warnings=warnings)


def _demand_natural(natural: UnknownVector, constraints: Sequence[str]) -> None:
    """Raise for constraints of noises, intensities and scales, which are not searched as such."""
    problems = []
    for constraint in parse_constraints(constraints, natural.names):
        for k in np.flatnonzero(constraint.weights):
            if natural.names[k].split(".")[0] in (*DEVIATIONS, *LENGTHS):
                problems.append(
                    f"{constraint.text!r}: {natural.names[k]} is a noise or a scale; give it a "
                    f"start, or leave it out"
                )
    if problems:
        raise SchemaError("constraints", problems)


def _search_from_several_starts(
    likelihood: _InnovationLikelihood, layout: UnknownVector, iterations: int
) -> tuple[LikelihoodMaximum, int]:
    """Return the lowest cost of several starts, and the number of starts that ended above it.

    The cost of the intensities has several minima: motion can be explained by a disturbance of one
    state or of another, or by noise. Each intensity starts from its own value and from a large and
    a small one in turn.
    """
    starts = [layout.start]
    is_intensity = np.array([name.split(".")[0] in _INTENSITIES for name in layout.names])
    for k in np.flatnonzero(is_intensity):
        for factor in _START_FACTORS:
            start = layout.start.copy()
            start[k] = np.clip(factor * start[k], layout.low[k], layout.high[k])
            starts.append(start)
    ends = []
    for start in starts:
        # The error of the given start is raised; another start may have no filter.
        try:
            ends.append(maximise_likelihood(likelihood, iterations, start=start))
        except IdentificationError:
            if start is layout.start:
                raise
    best = min(ends, key=lambda end: end.cost)
    # Of equal ends a proven one is taken.
    for end in ends:
        if end.converged and end.cost < best.cost + _SAME_COST:
            best = end
            break
    return best, sum(end.cost > best.cost + _SAME_COST for end in ends)


def _noise_starts(measured: Sequence[np.ndarray]) -> np.ndarray:
    """Return the noise of each output from second differences, in which smooth motion is small."""
    bends = np.concatenate([np.diff(z, 2, axis=0) for z in measured])
    spread = np.concatenate([z - z.mean(axis=0) for z in measured]).std(axis=0)
    # The second difference of white noise has six times its variance: 1 + 4 + 1.
    noise = np.sqrt((bends**2).mean(axis=0) / 6.0)
    return np.maximum(noise, np.maximum(_LEAST * spread, _LEAST_NOISE))


class _Innovations(NamedTuple):
    """Innovations (time, output) and their variances (output, output), per record.

    They are the residuals of `maximise_likelihood`.
    """

    parts: list[np.ndarray]
    variances: list[np.ndarray]


class _InnovationSlopes(NamedTuple):
    """Slopes of innovations and of their variance.

    Attributes
    ----------
    e : array (time, output, unknown)
    S : array (unknown, output, output)
    """

    e: np.ndarray
    S: np.ndarray


class _InnovationLikelihood:
    """J of the innovations, the target of `maximise_likelihood`."""

    def __init__(self, pieces: Sequence[_FilteredRecord], layout: UnknownVector):
        self.pieces, self.layout = pieces, layout

    def residuals(self, theta: np.ndarray) -> _Innovations:
        """Return innovations and their variances."""
        innovations = _Innovations([], [])
        for piece, columns in zip(self.pieces, self.layout.columns):
            e, S = piece.predict(theta[columns])
            innovations.parts.append(e)
            innovations.variances.append(S)
        return innovations

    def scatter(self, innovations: _Innovations) -> np.ndarray:
        """Return the variances of the innovations (manoeuvre, output)."""
        return np.array([np.diag(S) for S in innovations.variances])

    def cost(self, theta: np.ndarray, innovations: _Innovations) -> float:
        """Return J; infinite without a filter."""
        total = 0.5 * float((((theta - self.layout.start) / self.layout.sigma) ** 2).sum())
        for e, S in zip(innovations.parts, innovations.variances):
            if not np.isfinite(S).all() or not np.isfinite(e).all():
                return np.inf
            # 1/2 e' S^-1 e + N/2 ln |S|; S must be positive definite.
            sign, size = np.linalg.slogdet(S)
            if sign <= 0.0:
                return np.inf
            total += 0.5 * float((e * np.linalg.solve(S, e.T).T).sum()) + 0.5 * len(e) * float(size)
        return total

    def expect(self, steps: np.ndarray, central: bool) -> None:
        """Do nothing: all runs of a record are fast."""

    def slopes(
        self, theta: np.ndarray, steps: np.ndarray, central: bool
    ) -> list[_InnovationSlopes]:
        """Return slopes by central differences of the filters, which are fast here."""
        slopes = []
        for piece, columns in zip(self.pieces, self.layout.columns):
            slopes.append(piece.slopes(theta[columns], steps[columns]))
        return slopes

    def normal(
        self, theta: np.ndarray, innovations: _Innovations, slopes: Sequence[_InnovationSlopes]
    ) -> tuple[np.ndarray, np.ndarray]:
        """Return Fisher's information and the downhill gradient."""
        M = np.diag(self.layout.sigma**-2.0)
        g = -(theta - self.layout.start) / self.layout.sigma**2
        for columns, e, S, slope in zip(
            self.layout.columns, innovations.parts, innovations.variances, slopes
        ):
            # With S = L L': X = L^-1 e_i, w = L^-1 e and T_i = L^-1 S_i L^-T, so that
            # M_ij = sum X_i' X_j + N/2 tr(T_i T_j).
            root = np.linalg.cholesky(S)
            X = np.linalg.solve(root, slope.e).reshape(-1, len(columns))
            w = np.linalg.solve(root, e.T).T
            T = np.linalg.solve(root, np.linalg.solve(root, slope.S).transpose(0, 2, 1))
            flat = T.reshape(len(columns), -1)
            excess = (len(e) * np.eye(len(S)) - w.T @ w).ravel()
            M[np.ix_(columns, columns)] += X.T @ X + 0.5 * len(e) * flat @ flat.T
            g[columns] -= X.T @ w.ravel() + 0.5 * flat @ excess
        return M, g


def _whiten_innovations(maximum: LikelihoodMaximum) -> LikelihoodMaximum:
    """Return innovations and slopes transformed to unit variance."""
    e, slopes = [], []
    for part, S, slope in zip(maximum.residuals.parts, maximum.residuals.variances, maximum.slopes):
        root = np.linalg.cholesky(S)
        e.append(np.linalg.solve(root, part.T).T)
        slopes.append(np.linalg.solve(root, slope.e))
    return replace(maximum, residuals=e, slopes=slopes, noise=np.ones_like(maximum.noise))


class _ConstrainedFilter(ConstrainedPiece):
    """A filtered record as a function of its free unknowns."""

    def slopes(self, values: np.ndarray, steps: np.ndarray, *central: bool) -> _InnovationSlopes:
        """Return slopes by the free unknowns."""
        slopes = self.piece.slopes(self.T @ values + self.t, self.all_steps(steps))
        return _InnovationSlopes(slopes.e @ self.T, np.tensordot(self.T.T, slopes.S, axes=1))


class _FilteredRecord:
    """One record and the filter of its readings."""

    def __init__(
        self,
        model: LinearModel,
        record: xr.Dataset,
        gusts: Sequence[DrydenGust],
        names: Sequence[str],
        starts: np.ndarray,
    ):
        self.model, self.names, self.starts = model, tuple(names), starts
        self.gusts = gusts
        self.time = record["time"].values.astype(float)
        self.step = uniform_step(self.time, "record")
        self.u, self.z = input_output_arrays(model, record)

    def _make_run(self, values: np.ndarray) -> tuple[Predictor, np.ndarray]:
        """Return the filter and the variance of its innovations.

        Raise LinAlgError or ValueError if there is no steady filter.
        """
        named, states, outputs = self._name_values(values), self.model.states, self.model.outputs
        # A trial far off overflows, and then has no filter.
        with np.errstate(all="ignore"):
            steady = steady_filter(
                self.model.at(named),
                drift=pick_values(named, "drift", states),
                intensity=pick_values(named, "process", states),
                noise=pick_values(named, "noise", outputs),
                step=self.step,
            )
        start = pick_values(named, "init", states)
        run = make_predictor(steady, start, offset=pick_values(named, "sensor", outputs))
        return run, steady.S

    def predict(self, values: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Return innovations (time, output) and their variance; NaN without a filter."""
        try:
            run, S = self._make_run(values)
        except (np.linalg.LinAlgError, ValueError):
            return np.full(self.z.shape, np.nan), np.full(2 * self.z.shape[1:], np.nan)
        with np.errstate(over="ignore", invalid="ignore"):
            return filter_innovations(run, self.u, self.z), S

    def slopes(self, values: np.ndarray, steps: np.ndarray) -> _InnovationSlopes:
        """Return their slopes; NaN if a step does not have a filter.

        A variance does not become negative: near zero, the differences are those about one step
        above it.
        """
        is_variance = np.array([name.split(".")[0] in DEVIATIONS for name in self.names])
        values = np.where(is_variance, np.maximum(values, steps), values)
        shifts = np.diag(steps)
        try:
            run, _ = self._make_run(values)
            up, S_up = zip(*[self._make_run(values + shift) for shift in shifts])
            down, S_down = zip(*[self._make_run(values - shift) for shift in shifts])
        except (np.linalg.LinAlgError, ValueError):
            return _InnovationSlopes(
                np.full((*self.z.shape, len(values)), np.nan),
                np.full((len(values), *2 * self.z.shape[1:]), np.nan),
            )
        dS = (np.stack(S_up) - np.stack(S_down)) / (2.0 * steps[:, None, None])
        with np.errstate(over="ignore", invalid="ignore"):
            e = innovation_slopes(run, up, down=down, width=2.0 * steps, u=self.u, z=self.z)
        return _InnovationSlopes(np.moveaxis(e, 0, 2), dS)

    def _name_values(self, values: np.ndarray) -> dict[str, float]:
        """Return the unknowns by name, in their natural form."""
        named = {}
        for name, value, start in zip(self.names, values, self.starts):
            named[name] = float(value)
            if name.split(".")[0] in DEVIATIONS:
                named[name] = start * np.sqrt(abs(float(value)))
            if name.split(".")[0] in LENGTHS:
                named[name] = start * np.exp(float(value))
        for gust in self.gusts:
            named |= gust.filter_values(named)
        return named

    def residual(self, e: np.ndarray) -> xr.Dataset:
        """Return innovations as a Dataset."""
        columns = {name: ("time", e[:, k]) for k, name in enumerate(self.model.outputs)}
        return xr.Dataset(columns, {"time": self.time})
