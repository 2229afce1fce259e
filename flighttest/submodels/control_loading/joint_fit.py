"""Least squares over samples and windows together, with noise in the regressors.

The samples are those of driven manoeuvres, the windows those of free motion.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np

from flightmech.errors import IdentificationError
from flightmech.support.arrays import true_runs
from flighttest.regression.equation_error import least_squares
from flighttest.regression.uncertainty import collinearity
from flighttest.regression.uncertainty.coloured_residuals import coloured_covariance_of
from flighttest.remarks import Convergence, Remark

# Passes over the weights.
_PASSES = 5
# Smallest part of the mean square of the residuals that the noise of the regressors cannot explain.
_LEAST = 0.1
# Largest share of noise that is subtracted before the weights are final.
_SAFE = 0.5
# Last change of an estimate at which an iteration has converged, and above which its result must
# not be used. Each pass moves the estimates much less than the pass before. [standard errors]
_SAME, _WRONG = 0.5, 1.0
# Smallest tolerance over the estimate: without noise, the standard errors are those of rounding.
_RELATIVE = 1e-9
# Largest share of noise in the part of a regressor that is independent of the others.
_NOISY = 0.9


@dataclass(frozen=True)
class RecordEquations:
    """Equations of one record.

    Attributes
    ----------
    X : array (rows, terms)
        Regressors.
    z : array (rows,)
        Response.
    noise : array (rows, terms)
        Variance of the noise in every regressor.
    lengths : tuple of int
        Rows of every stretch without a gap.
    step : float
        Sampling interval. [s]
    """

    X: np.ndarray
    z: np.ndarray
    noise: np.ndarray
    lengths: tuple[int, ...]
    step: float


@dataclass(frozen=True)
class PriorConstraint:
    """A-priori value of a combination of the estimates: ``row @ theta``, with standard error."""

    row: np.ndarray
    value: float
    stderr: float


@dataclass(frozen=True)
class JointFit:
    """Joint estimates from samples and windows.

    Attributes
    ----------
    theta : array (terms,)
        Estimates.
    X : array (rows, terms)
        Weighted regressors.
    estimator : array (terms, rows)
        Change of theta by a change of the response. Samples come before windows, and windows before
        prior constraints.
    residual : array (rows,)
        Residuals of the unweighted equations.
    samples, windows : int
        Numbers of rows of samples and of windows.
    variances : array (rows,)
        Variances of the residuals.
    lengths : tuple of int
        Samples of every stretch without a gap.
    steps : tuple of float
        Sampling interval of each stretch. [s]
    last_change : array (terms,)
        Change of theta in the last pass over the weights.
    """

    theta: np.ndarray
    X: np.ndarray
    estimator: np.ndarray
    residual: np.ndarray
    samples: int
    windows: int
    variances: np.ndarray
    lengths: tuple[int, ...]
    steps: tuple[float, ...]
    last_change: np.ndarray

    @property
    def convergence(self) -> Convergence:
        """End of the passes over the weights."""
        stderr = np.sqrt(np.diag(self.covariance))
        return estimates_convergence(
            self.last_change, self.theta, stderr=stderr, iterations=_PASSES
        )

    @cached_property
    def covariance(self) -> np.ndarray:
        """Covariance of theta, (terms, terms).

        Residuals of the samples are coloured, and those of the windows are independent.
        """
        ends = np.cumsum(self.lengths)
        pieces = [slice(int(b) - a, int(b)) for a, b in zip(self.lengths, ends)]
        of_samples = self.estimator[:, : self.samples]
        of_windows = self.estimator[:, self.samples :]
        coloured = coloured_covariance_of(
            least_squares.equivalent_regressors(of_samples),
            self.residual[: self.samples],
            pieces,
            self.steps,
        ).covariance
        return coloured + of_windows * self.variances[self.samples :] @ of_windows.T


def estimates_convergence(
    change: np.ndarray, estimate: np.ndarray, stderr: np.ndarray, iterations: int
) -> Convergence:
    """Return the end of an iteration over estimates.

    Parameters
    ----------
    change, estimate, stderr : array (terms,)
        Last change of the estimates, the estimates, and their standard errors.
    iterations : int
        Number of iterations.
    """
    # An estimate that does not change has converged, also without a standard error.
    moves = np.abs(change) > 0.0
    tolerance = np.maximum(_SAME * stderr, _RELATIVE * np.abs(estimate))
    ratio = float(np.max(np.abs(change[moves]) / tolerance[moves], initial=0.0))
    return Convergence(ratio <= 1.0, iterations, ratio)


def convergence_remarks(iterations: Mapping[str, Convergence]) -> list[Remark]:
    """Return a remark on every iteration that did not converge, by the name of the iteration.

    It is an error if an estimate changes by more than its standard error.
    """
    advice = (
        f"an estimate still changes by more than {_SAME:g} of its standard error; give records "
        f"with more motion, or fewer terms"
    )
    remarks = []
    for name, convergence in iterations.items():
        severity = "error" if not _SAME * convergence.change <= _WRONG else "warning"
        remarks += convergence.remarks(name, advice, severity=severity)
    return remarks


def stretch_lengths(use: np.ndarray) -> tuple[int, ...]:
    """Return the number of samples of every stretch without a gap."""
    return tuple(stop - start for start, stop in true_runs(use))


def joint_fit(
    samples: Sequence[RecordEquations],
    windows: Sequence[RecordEquations],
    names: Sequence[str],
    cutoff: float,
    constraints: Sequence[PriorConstraint] = (),
) -> JointFit:
    """Fit samples and windows by weighted least squares, corrected for noise in the regressors.

    Parameters
    ----------
    samples, windows : sequence of Rows
        Equations of driven manoeuvres after a low-pass, and of free motion.
    names : sequence of str
        Names of the terms.
    cutoff : float
        Cut-off frequency of the low-pass. It gives the number of independent samples. [Hz]
    constraints : sequence of PriorConstraint, optional
        Each is one further equation.

    Raises
    ------
    IdentificationError
        A regressor consists mostly of noise.

    Notes
    -----
    X'X exceeds that of the true regressors by the noise.  The size of the noise is known from the
    pick-ups, and X'X is reduced by it [Fuller1987].  The weights are the inverse variances of the
    residuals.

    References
    ----------
    .. [Fuller1987] Fuller, Measurement Error Models, 1987, section 2.2.
    """
    X, z, noise = _stack_equations([*samples, *windows], constraints, len(names))
    fixed = np.array([constraint.stderr**2 for constraint in constraints])
    # Source of every row: 0 samples, 1 windows, 2 constraints.
    counts = [_count_rows(samples), _count_rows(windows), len(constraints)]
    source = np.repeat([0, 1, 2], counts)
    # A low-pass leaves two independent samples per period of its cut-off.
    step = float(np.median([record.step for record in samples]))
    worth = np.array([min(1.0, 2.0 * cutoff * step), 1.0, 1.0])[source]
    weight = worth.copy()
    weight[source == 2] /= fixed
    theta = np.zeros(len(names))
    for number in range(_PASSES):
        root, before = np.sqrt(weight), theta
        theta, equivalent = _solve_without_noise(
            root[:, None] * X,
            root * z,
            noise=weight @ noise,
            names=names,
            final=number + 1 == _PASSES,
        )
        v = z - X @ theta
        variances = _variances(v, noise @ theta**2, source=source, fixed=fixed)
        weight = worth / variances
    lengths, steps = _stretches(samples)
    return JointFit(
        theta,
        X=root[:, None] * X,
        estimator=least_squares.estimator_matrix(equivalent) * root,
        residual=v,
        samples=counts[0],
        windows=counts[1],
        variances=variances,
        lengths=lengths,
        steps=steps,
        last_change=theta - before,
    )


def _count_rows(records: Sequence[RecordEquations]) -> int:
    return sum(len(record.z) for record in records)


def _stretches(
    records: Sequence[RecordEquations],
) -> tuple[tuple[int, ...], tuple[float, ...]]:
    """Return number of samples and sampling step [s] of all stretches without a gap."""
    lengths: list[int] = []
    steps: list[float] = []
    for record in records:
        lengths += record.lengths
        steps += [record.step] * len(record.lengths)
    return tuple(lengths), tuple(steps)


def _stack_equations(
    records: Sequence[RecordEquations], constraints: Sequence[PriorConstraint], terms: int
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Return regressors, response and noise of the records, then of the constraints."""
    rows = np.array([constraint.row for constraint in constraints]).reshape(-1, terms)
    X = [*(record.X for record in records), rows]
    values = np.array([constraint.value for constraint in constraints])
    z = [*(record.z for record in records), values]
    # A constraint has no noise in its row.
    noise = [*(record.noise for record in records), np.zeros(rows.shape)]
    return np.concatenate(X), np.concatenate(z), np.concatenate(noise)


def _variances(
    v: np.ndarray, by_noise: np.ndarray, source: np.ndarray, fixed: np.ndarray
) -> np.ndarray:
    """Return the variance of every residual.

    It is the variance that the noise of the regressors explains, plus one value per source.
    """
    variances = by_noise.copy()
    variances[source == 2] = fixed
    for k in np.unique(source[source < 2]):
        rows = source == k
        total = float(np.mean(v[rows] ** 2))
        variances[rows] += max(total - float(np.mean(by_noise[rows])), _LEAST * total)
    return variances


def _solve_without_noise(
    X: np.ndarray, z: np.ndarray, noise: np.ndarray, names: Sequence[str], final: bool
) -> tuple[np.ndarray, np.ndarray]:
    """Return estimates corrected for noise, and regressors whose ordinary estimates they are.

    Before the weights are final, the noise may exceed the regressor.  Then only a safe part of it
    is subtracted.
    """
    collinearity.demand_rank(X, names)
    R = np.linalg.qr(X, mode="r")
    # Variance of each regressor that the others do not explain, compared with its noise.
    share = noise * np.sum(np.linalg.inv(R) ** 2, axis=1)
    worst = float(share.max())
    if final and worst > _NOISY:
        text = (
            f"{worst:.0%} of what distinguishes it from the other terms is noise; give faster "
            f"motion or leave it out"
        )
        raise IdentificationError(f"{names[int(np.argmax(share))]}: {text}")
    part = 1.0
    if not final and worst > 0.0:
        part = min(1.0, _SAFE / worst)
    return least_squares.solve_least_squares(X, z, -noise * part)
