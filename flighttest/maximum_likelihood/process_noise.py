"""Filter error: maximum likelihood of linear models whose motion is disturbed, by turbulence or by
what the model lacks.

An open-loop simulation leaves the measured path for good after a gust.  The filter predicts one
sample ahead from all samples before, so that its innovations are white when the model is right, and
the likelihood is that of the innovations:

    J = 1/2 sum_k e_k' S^-1 e_k + N/2 ln |S| + 1/2 (theta - theta_0)' P^-1 (theta - theta_0)

The intensities of the disturbance and the noise of the instruments are unknowns too, estimated as
variances; S and the gain follow from them.  Fisher's scoring: M_ij = sum e_i' S^-1 e_j + N/2
tr(S^-1 S_i S^-1 S_j), with e_i and S_i by central differences.

References
----------
.. [Maine1981] Maine, Iliff, Formulation and implementation of a practical algorithm for parameter estimation with process and
   measurement noise, SIAM J. Appl. Math. 41, 1981.
.. [Jategaonkar] Jategaonkar, Flight Vehicle System Identification, 2nd ed., AIAA 2015, ch. 5.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from typing import NamedTuple

import numpy as np
import xarray as xr

from flightmech.errors import SchemaError
from flighttest.maximum_likelihood.residual_covariance import (
    coloured_likelihood_covariance,
    effect_on_motion,
    warn_of_turbulence,
)
from flighttest.maximum_likelihood.result import OutputError, estimates_dataset, noise_dataset
from flighttest.maximum_likelihood.search import LikelihoodMaximum, maximise_likelihood
from flighttest.maximum_likelihood.state_space import (
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
from flighttest.maximum_likelihood.time_domain import uniform_step
from flighttest.maximum_likelihood.unknowns import Unknown, UnknownVector, Wanted, lay_out

_POSITIVE = ("process", "noise")
_LEAST = 1e-6  # smallest start of a noise, of the spread of the output
_CALM = 1e-4  # bound of intensities and noises, of their start: below it there is none


def filter_error(
    model: LinearModel,
    manoeuvres: xr.Dataset | Sequence[xr.Dataset],
    parameters: Wanted,
    iterations: int = 50,
) -> OutputError:
    """Estimate parameters of a linear model from records in turbulence.

    Parameters
    ----------
    model : LinearModel
        As from `linear_model`.
    manoeuvres : Dataset (time,) or sequence of Dataset
        Inputs and measured outputs of the model on a uniform ``time``. [SI]
    parameters : mapping of str to Unknown, tuple or float
        Parameters of the model; ``process.alpha``, what disturbs a state [its unit per square root
        of second]; ``noise.alpha``, standard deviation of an output, estimated from a start of its
        own unless given; ``init.alpha``, a state at the first sample, zero unless given;
        ``drift.alpha``, a constant in its rate; ``sensor.alpha``, a constant added to an output.
        [SI]
    iterations : int
        At most so many.

    Returns
    -------
    OutputError
        ``residuals`` are the innovations.  Without any ``process.*`` this is `linear_output_error`
        with the noise among the unknowns.

    Warns
    -----
    AeromatchWarning
        No ``process.*`` is among the parameters and the residuals are a disturbance of the motion.

    Raises
    ------
    UnknownName
        A parameter the model does not have, a signal the record does not hold.
    SchemaError
        ``process.*`` or ``noise.*`` that does not start above zero, samples that are not finite,
        time that is not uniform.
    IdentificationError
        The start leads to no filter, or unknowns that the records cannot determine.
    """
    records = [manoeuvres] if isinstance(manoeuvres, xr.Dataset) else list(manoeuvres)
    extra = {
        "process": model.states,
        "init": model.states,
        "drift": model.states,
        "noise": model.outputs,
        "sensor": model.outputs,
    }
    demand_known(
        model,
        list(parameters),
        [f"{kind}.{name}" for kind, names in extra.items() for name in names],
    )
    starts = _noise_starts([input_output_arrays(model, record)[1] for record in records])
    wanted = {f"noise.{name}": Unknown(start) for name, start in zip(model.outputs, starts)} | dict(
        parameters
    )
    plain = lay_out(wanted, [{} for _ in records])
    layout, squares = _squared(plain)
    pieces = [
        _Predicted(model, record, names, plain.start[place])
        for record, names, place in zip(records, layout.bases, layout.columns)
    ]
    found = maximise_likelihood(_Innovated(pieces, layout), iterations)
    white = _whitened(found)
    covariance, colours = coloured_likelihood_covariance(
        white, layout.columns, [piece.step for piece in pieces]
    )
    theta = np.where(squares, plain.start * np.sqrt(np.abs(found.theta)), found.theta)
    scale = np.where(squares, plain.start**2 / (2.0 * theta), 1.0)
    size = np.outer(scale, scale)
    plainly = replace(white, theta=theta, information=found.information / size)
    estimates = estimates_dataset(plainly, plain, covariance * size, {"method": "filter error"})
    inside = replace(white, residuals=found.residuals.parts, noise=found.noise)
    rest = tuple(piece.residual(e) for piece, e in zip(pieces, found.residuals.parts))
    scaled = [piece.z / np.sqrt(R) for piece, R in zip(pieces, found.noise)]
    effect = effect_on_motion(white, layout.columns, covariance, scaled)
    scatter = noise_dataset(
        inside, list(model.outputs), colours, [piece.z for piece in pieces], effect
    )
    warnings = (
        ()
        if any(name.startswith("process.") for name in parameters)
        else warn_of_turbulence(scatter)
    )
    return OutputError(estimates, rest, scatter, warnings)


def _noise_starts(measured: Sequence[np.ndarray]) -> np.ndarray:
    """Return the noise of each output as second differences show it, which smooth motion does not
    reach.
    """
    bends = np.concatenate([np.diff(z, 2, axis=0) for z in measured])
    spread = np.concatenate([z - z.mean(axis=0) for z in measured]).std(axis=0)
    return np.maximum(np.sqrt((bends**2).mean(axis=0) / 6.0), np.maximum(_LEAST * spread, 1e-12))


def _squared(plain: UnknownVector) -> tuple[UnknownVector, np.ndarray]:
    """Return the layout with deviations as squares over that of their start, and which they are.

    In the variance of a noise alone one step of scoring reaches the maximum.
    """
    squares = np.array([name.split(".")[0] in _POSITIVE for name in plain.names])
    low = [
        name
        for name, squared, start in zip(plain.names, squares, plain.start)
        if squared and not start > 0.0
    ]
    if low:
        raise SchemaError(
            "unknowns",
            [
                f"{name} starts at zero or below; give a positive start, or leave it out"
                for name in low
            ],
        )
    unit = np.where(squares, plain.start, 1.0)
    return (
        replace(
            plain,
            start=np.where(squares, 1.0, plain.start),
            sigma=np.where(squares, 2.0 * plain.sigma / unit, plain.sigma),
            low=np.where(squares, np.maximum(plain.low / unit, _CALM) ** 2, plain.low),
            high=np.where(squares, (plain.high / unit) ** 2, plain.high),
        ),
        squares,
    )


class _Step(NamedTuple):
    """Innovations and their variances, per record; `maximise_likelihood` carries them as its residuals."""

    parts: list[np.ndarray]
    variances: list[np.ndarray]


class _Slope(NamedTuple):
    """Slopes of innovations (time, output, unknown) and of their variance (unknown, output,
    output).
    """

    e: np.ndarray
    S: np.ndarray


class _Innovated:
    """J of the innovations, as `maximise_likelihood` requires it."""

    def __init__(self, pieces: Sequence[_Predicted], layout: UnknownVector):
        self.pieces, self.layout = pieces, layout

    def residuals(self, theta: np.ndarray) -> _Step:
        """Return innovations and their variances."""
        made = [
            piece.predict(theta[columns])
            for piece, columns in zip(self.pieces, self.layout.columns)
        ]
        return _Step([e for e, _ in made], [S for _, S in made])

    def scatter(self, step: _Step) -> np.ndarray:
        """Return the variances of the innovations (manoeuvre, output)."""
        return np.array([np.diag(S) for S in step.variances])

    def cost(self, theta: np.ndarray, step: _Step) -> float:
        """Return J; infinite where there is no filter."""
        total = 0.5 * float((((theta - self.layout.start) / self.layout.sigma) ** 2).sum())
        for e, S in zip(step.parts, step.variances):
            sign, size = np.linalg.slogdet(S) if np.isfinite(S).all() else (-1.0, 0.0)
            if sign <= 0.0 or not np.isfinite(e).all():
                return np.inf
            total += 0.5 * float((e * np.linalg.solve(S, e.T).T).sum()) + 0.5 * len(e) * float(size)
        return total

    def expect(self, steps: np.ndarray, central: bool) -> None:
        """Nothing is prepared: all runs of a record cost little."""

    def slopes(self, theta: np.ndarray, steps: np.ndarray, central: bool) -> list[_Slope]:
        """Return slopes by central differences of the filters, which cost little here."""
        return [
            piece.slopes(theta[columns], steps[columns])
            for piece, columns in zip(self.pieces, self.layout.columns)
        ]

    def normal(
        self, theta: np.ndarray, step: _Step, slopes: Sequence[_Slope]
    ) -> tuple[np.ndarray, np.ndarray]:
        """Return Fisher's information and the downhill gradient."""
        M = np.diag(self.layout.sigma**-2.0)
        g = -(theta - self.layout.start) / self.layout.sigma**2
        for place, e, S, slope in zip(self.layout.columns, step.parts, step.variances, slopes):
            root = np.linalg.cholesky(S)
            X = np.linalg.solve(root, slope.e).reshape(-1, len(place))
            w = np.linalg.solve(root, e.T).T
            turned = np.linalg.solve(
                root, np.linalg.solve(root, slope.S).transpose(0, 2, 1)
            )  # L^-1 dS L^-T
            flat = turned.reshape(len(place), -1)
            M[np.ix_(place, place)] += X.T @ X + 0.5 * len(e) * flat @ flat.T
            g[place] -= X.T @ w.ravel() + 0.5 * flat @ (len(e) * np.eye(len(S)) - w.T @ w).ravel()
        return M, g


def _whitened(found: LikelihoodMaximum) -> LikelihoodMaximum:
    """Return innovations and slopes turned so that their variance is one."""
    roots = [np.linalg.cholesky(S) for S in found.residuals.variances]
    e = [np.linalg.solve(root, part.T).T for root, part in zip(roots, found.residuals.parts)]
    slopes = [np.linalg.solve(root, slope.e) for root, slope in zip(roots, found.slopes)]
    return replace(found, residuals=e, slopes=slopes, noise=np.ones_like(found.noise))


class _Predicted:
    """One record."""

    def __init__(
        self, model: LinearModel, record: xr.Dataset, names: Sequence[str], starts: np.ndarray
    ):
        self.model, self.names, self.starts = model, tuple(names), starts
        self.time = record["time"].values.astype(float)
        self.step = uniform_step(self.time, "record")
        self.u, self.z = input_output_arrays(model, record)

    def _run(self, values: np.ndarray) -> tuple[Predictor, np.ndarray]:
        """Return the filter and the variance of its innovations; LinAlgError or ValueError without
        one.
        """
        at, states, outputs = self._natural(values), self.model.states, self.model.outputs
        stirred, noise = pick_values(at, "process", states), pick_values(at, "noise", outputs)
        made = steady_filter(
            self.model.at(at), pick_values(at, "drift", states), stirred, noise, self.step
        )
        return make_predictor(
            made, pick_values(at, "init", states), pick_values(at, "sensor", outputs)
        ), made.S

    def predict(self, values: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Return innovations (time, output) and their variance (output, output); NaN without a
        filter.
        """
        try:
            run, S = self._run(values)
        except (np.linalg.LinAlgError, ValueError):
            return np.full(self.z.shape, np.nan), np.full(2 * self.z.shape[1:], np.nan)
        with np.errstate(over="ignore", invalid="ignore"):
            return filter_innovations(run, self.u, self.z), S

    def slopes(self, values: np.ndarray, steps: np.ndarray) -> _Slope:
        """Return their slopes; NaN where a step leads to no filter."""
        moves = np.diag(steps)
        try:
            run, _ = self._run(values)
            up, down = (
                list(zip(*(self._run(values + side * move) for move in moves)))
                for side in (1.0, -1.0)
            )
        except (np.linalg.LinAlgError, ValueError):
            return _Slope(
                np.full((*self.z.shape, len(values)), np.nan),
                np.full((len(values), *2 * self.z.shape[1:]), np.nan),
            )
        dS = (np.stack(up[1]) - np.stack(down[1])) / (2.0 * steps[:, None, None])
        with np.errstate(over="ignore", invalid="ignore"):
            e = innovation_slopes(run, up[0], down[0], 2.0 * steps, self.u, self.z)
        return _Slope(np.moveaxis(e, 0, 2), dS)

    def _natural(self, row: np.ndarray) -> dict[str, float]:
        whole = {name: float(x) for name, x in zip(self.names, row)}
        deviations = {
            name: start * np.sqrt(abs(whole[name]))
            for name, start in zip(self.names, self.starts)
            if name.split(".")[0] in _POSITIVE
        }
        return whole | deviations

    def residual(self, e: np.ndarray) -> xr.Dataset:
        """Return innovations as a Dataset."""
        return xr.Dataset(
            {name: ("time", e[:, k]) for k, name in enumerate(self.model.outputs)},
            {"time": self.time},
        )
