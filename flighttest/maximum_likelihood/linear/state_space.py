"""Linear models with named parameters, and their steady-state Kalman filter.

The parameters are elements of the matrices, or arguments of a function that returns the matrices.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from typing import NamedTuple

import numpy as np
import scipy
import xarray as xr

from flightmech.errors import SchemaError, UnknownName
from flighttest.maximum_likelihood.linear.riccati import steady_covariance

_DIMS = {
    "A": ("state", "state_"),
    "B": ("state", "input"),
    "C": ("output", "state_"),
    "D": ("output", "input"),
}


class Matrices(NamedTuple):
    """x' = A x + B u, y = C x + D u."""

    A: np.ndarray
    B: np.ndarray
    C: np.ndarray
    D: np.ndarray


@dataclass(frozen=True)
class LinearModel:
    """A linear model whose matrices depend on named parameters.

    Attributes
    ----------
    states, inputs, outputs : tuple of str
    matrices : callable
        Mapping of parameter to value -> A, B, C, D. A parameter that is not in the mapping keeps
        its default.
    parameters : tuple of str
        Parameters that may be estimated.
    reference : mapping of str to float
        Inputs and outputs of the point of linearisation; default 0. [SI]
    """

    states: tuple[str, ...]
    inputs: tuple[str, ...]
    outputs: tuple[str, ...]
    matrices: Callable[[Mapping[str, float]], Sequence[np.ndarray]]
    parameters: tuple[str, ...]
    reference: Mapping[str, float] = field(default_factory=dict)

    def at(self, values: Mapping[str, float]) -> Matrices:
        """Return the matrices for parameter values.

        Raises
        ------
        SchemaError
            The function returned matrices of other shapes than the names imply.
        """
        matrices = Matrices(*[np.asarray(item, float) for item in self.matrices(values)])
        n, m, p = len(self.states), len(self.inputs), len(self.outputs)
        required = {"A": (n, n), "B": (n, m), "C": (p, n), "D": (p, m)}
        problems = []
        for name, x in matrices._asdict().items():
            if x.shape != required[name]:
                problems.append(f"{name} is {x.shape}; the names require {required[name]}")
        if problems:
            raise SchemaError("linear model", problems)
        return matrices


def linear_model(
    linear: xr.Dataset, ties: Mapping[str, Mapping[str, float]] | None = None
) -> LinearModel:
    """Return the model whose parameters are the elements of given matrices.

    The elements are named ``A[alpha,q]``, ``B[q,delta_e]``, ``C[nz,alpha]`` ...

    Parameters
    ----------
    linear : Dataset
        As from `flightmech.linearize`: ``A (state, state_)``, ``B (state, input)``,
        ``C (output, state_)``, ``D (output, input)``, with ``u`` and ``y`` of the point. [SI]
    ties : mapping of str to mapping of str to float, optional
        Elements that change with another one: ``{"A[alpha,alpha]": {"C[nz,alpha]": -V / g}}`` adds
        -V/g times the change of the first element to the second.

    Raises
    ------
    UnknownName
        A tie of a name that is not an element.
    """
    elements = _list_elements(linear)
    base = {}
    for matrix, dims in _DIMS.items():
        base[matrix] = linear[matrix].transpose(*dims).values.astype(float)
    tied = {name: dict(slopes) for name, slopes in (ties or {}).items()}
    for name, slopes in tied.items():
        for element in (name, *slopes):
            if element not in elements:
                raise UnknownName(element, elements, "element")

    def matrices(values: Mapping[str, float]) -> list[np.ndarray]:
        changed = {matrix: x.copy() for matrix, x in base.items()}
        # A tied element changes by its slope times the change of the element.
        for name in elements.keys() & values.keys():
            matrix, i, j = elements[name]
            change = values[name] - base[matrix][i, j]
            for element, slope in {name: 1.0, **tied.get(name, {})}.items():
                element_matrix, k, l = elements[element]
                changed[element_matrix][k, l] += slope * change
        return [changed[matrix] for matrix in _DIMS]

    reference = {}
    for point, dim in (("u", "input"), ("y", "output")):
        if point in linear:
            for name, x in zip(linear[dim].values, linear[point].values):
                reference[str(name)] = float(x)
    return LinearModel(
        states=tuple(str(name) for name in linear["state"].values),
        inputs=tuple(str(name) for name in linear["input"].values),
        outputs=tuple(str(name) for name in linear["output"].values),
        matrices=matrices,
        parameters=tuple(elements),
        reference=reference,
    )


def _list_elements(linear: xr.Dataset) -> dict[str, tuple[str, int, int]]:
    """Return matrix, row and column of every element by its name."""
    elements = {}
    for matrix, (row_dim, column_dim) in _DIMS.items():
        for i, row in enumerate(linear[row_dim].values):
            for j, column in enumerate(linear[column_dim].values):
                elements[f"{matrix}[{row},{column}]"] = matrix, i, j
    return elements


def demand_known(
    model: LinearModel, names: Sequence[str], extra: Mapping[str, Sequence[str]]
) -> None:
    """Raise for unknowns that are neither parameters of the model nor ``kind.name`` of `extra`.

    Parameters
    ----------
    model : LinearModel
    names : sequence of str
    extra : mapping of str to sequence of str
        Names by kind, such as ``{"init": model.states}``.
    """
    allowed = list(model.parameters)
    for kind, kind_names in extra.items():
        allowed += [f"{kind}.{name}" for name in kind_names]
    for name in names:
        if name not in allowed:
            raise UnknownName(name, allowed, "parameter")


def input_output_arrays(
    model: LinearModel, record: xr.Dataset, gaps: bool = False
) -> tuple[np.ndarray, np.ndarray]:
    """Return inputs (time, input) and measured outputs (time, output) less their reference.

    Parameters
    ----------
    model : LinearModel
    record : Dataset (time,)
    gaps : bool
        Whether outputs may have readings that are NaN.

    Raises
    ------
    UnknownName
        A signal that the record does not hold.
    SchemaError
        Samples that are not finite.
    """
    columns, problems = [], []
    for name in (*model.inputs, *model.outputs):
        if name not in record:
            raise UnknownName(
                name, map(str, record.data_vars), "signal", "the record does not hold it"
            )
        values = record[name].values.astype(float)
        x = np.broadcast_to(values, (record.sizes["time"],)) - model.reference.get(name, 0.0)
        may_have_gaps = gaps and name in model.outputs
        if not may_have_gaps and not np.isfinite(x).all():
            problems.append(
                f"{name} is not finite in {int((~np.isfinite(x)).sum())} samples; fill short "
                f"gaps or cut the record there"
            )
        columns.append(x)
    if problems:
        raise SchemaError("record", problems)
    signals = np.column_stack(columns)
    return signals[:, : len(model.inputs)], signals[:, len(model.inputs) :]


def pick_values(values: Mapping[str, float], kind: str, names: Sequence[str]) -> np.ndarray:
    """Return the values named ``kind.name``, (names,); zero for a name without value."""
    return np.array([values.get(f"{kind}.{name}", 0.0) for name in names])


def pick_rows(rows: Sequence[Mapping[str, float]], kind: str, names: Sequence[str]) -> np.ndarray:
    """Return the values named ``kind.name`` of every row, (row, names)."""
    return np.array([pick_values(values, kind, names) for values in rows])


def stack_models(model: LinearModel, rows: Sequence[Mapping[str, float]]) -> Matrices:
    """Return the matrices for rows of parameter values, with the rows as first dimension."""
    matrices = [model.at(values) for values in rows]
    return Matrices(*(np.stack(part) for part in zip(*matrices)))


class Filter(NamedTuple):
    """A steady-state predictor, or several with the filters as the first dimension.

    x_(k+1) = F (x_k + K e_k) + G0 u_k + G1 u_(k+1) + g, e_k = z_k - C x_k - D u_k, cov(e) = S.
    """

    F: np.ndarray
    G0: np.ndarray
    G1: np.ndarray
    g: np.ndarray
    C: np.ndarray
    D: np.ndarray
    K: np.ndarray
    S: np.ndarray


def steady_filter(
    model: Matrices, drift: np.ndarray, intensity: np.ndarray, noise: np.ndarray, step: float
) -> Filter:
    """Return the steady-state Kalman filter, as `steady_filters`."""
    found = steady_filters(
        Matrices(*(part[None] for part in model)), drift[None], intensity[None], noise[None], step
    )
    return Filter(*(part[0] for part in found))


def steady_filters(
    models: Matrices, drift: np.ndarray, intensity: np.ndarray, noise: np.ndarray, step: float
) -> Filter:
    """Return the steady-state Kalman filters of several models.

    Parameters
    ----------
    models : Matrices
        Each with the models as its first dimension.
    drift : array (model, state)
        Constant part b of the rates.
    intensity : array (model, state)
        Square root of the intensity of w. [unit of the state per square root of second]
    noise : array (model, output)
        Standard deviation of v.
    step : float
        Sampling interval. [s]

    Raises
    ------
    LinAlgError
        No steady filter exists: the outputs do not show a growing motion.

    References
    ----------
    .. [VanLoan1978] Van Loan, Computing integrals involving the matrix exponential, IEEE Trans.
       Automatic Control 23, 1978.
    """
    A, B, C, D = models
    count, n, m = B.shape
    # [VanLoan1978]: with the level and the ramp of [u; 1] as further states, the transition matrix
    # over one step contains the integrals of the input.
    augmented = np.zeros((count, n + 2 * (m + 1), n + 2 * (m + 1)))
    augmented[:, :n, :n], augmented[:, :n, n : n + m], augmented[:, :n, n + m] = A, B, drift
    augmented[:, n : n + m + 1, n + m + 1 :] = np.eye(m + 1) / step
    transition = scipy.linalg.expm(augmented * step)
    F = transition[:, :n, :n]
    level, ramp = transition[:, :n, n : n + m + 1], transition[:, :n, n + m + 1 :]
    # Inputs are linear between samples: u_k has the level less the ramp, u_(k+1) the ramp.
    G0, G1, g = level[:, :, :m] - ramp[:, :, :m], ramp[:, :, :m], level[:, :, m]
    R = noise[:, :, None] ** 2 * np.eye(C.shape[1])
    if not intensity.any():
        return Filter(F, G0, G1=G1, g=g, C=C, D=D, K=np.zeros((count, n, C.shape[1])), S=R)
    # [VanLoan1978]: covariance Q of the process noise over one step
    paired = np.zeros((count, 2 * n, 2 * n))
    paired[:, :n, :n], paired[:, n:, n:] = -A, A.swapaxes(1, 2)
    paired[:, :n, n:] = intensity[:, :, None] ** 2 * np.eye(n)
    Q = F @ scipy.linalg.expm(paired * step)[:, :n, n:]
    P = steady_covariance(F, C, 0.5 * (Q + Q.swapaxes(1, 2)), noise**2)
    # P is the covariance of the predicted state: S = C P C' + R, K = P C' S^-1.
    S = C @ P @ C.swapaxes(1, 2) + R
    K = np.linalg.solve(S, C @ P).swapaxes(1, 2)
    return Filter(F, G0, G1=G1, g=g, C=C, D=D, K=K, S=0.5 * (S + S.swapaxes(1, 2)))


class Predictor(NamedTuple):
    """One run of a filter, or several with the runs as the first dimension.

    x_(k+1) = M x_k + W [u_k, u_(k+1), 1, z_k], e_k = z_k - N [x_k, u_k, 1], x_0 = ``start``.
    """

    M: np.ndarray
    W: np.ndarray
    N: np.ndarray
    start: np.ndarray


def make_predictor(steady: Filter, start: np.ndarray, offset: np.ndarray) -> Predictor:
    """Return a filter with its first state and the offsets of the instruments.

    Parameters
    ----------
    steady : Filter
    start : array (state,) or (filter, state)
    offset : array (output,) or (filter, output)
        Added to y.
    """
    F, G0, G1, g, C, D, K, _ = steady
    gain, offset = F @ K, offset[..., None]
    return Predictor(
        M=F - gain @ C,
        W=np.concatenate([G0 - gain @ D, G1, g[..., None] - gain @ offset, gain], axis=-1),
        N=np.concatenate([C, D, offset], axis=-1),
        start=start,
    )


def filter_innovations(run: Predictor, u: np.ndarray, z: np.ndarray) -> np.ndarray:
    """Return the innovations (time, output) of a filter.

    Parameters
    ----------
    run : Predictor
    u : array (time, input)
        Inputs.
    z : array (time, output)
        Readings.
    """
    return z - np.column_stack([_filter_states(run, u, z), u, np.ones(len(u))]) @ run.N.T


def innovation_slopes(
    run: Predictor,
    up: Predictor,
    down: Predictor,
    width: np.ndarray,
    u: np.ndarray,
    z: np.ndarray,
) -> np.ndarray:
    """Return the slopes of the innovations (unknown, time, output).

    The derivatives M', W', N' of the matrices are differences. The derivative of the states is
    exact, so that all unknowns have one recursion:
    s_(k+1) = M s_k + M' x_k + W' [u_k, u_(k+1), 1, z_k].

    Parameters
    ----------
    run : Predictor
    up, down : Predictor
        After a step of each unknown, which is the first dimension.
    width : array (unknown,)
        Distance between the two.
    u : array (time, input)
    z : array (time, output)
    """
    # Differences of the matrices, (unknown, row, column); they are divided by the width at the end.
    M, W, N, start = [a - b for a, b in zip(up, down)]
    x = _filter_states(run, u, z)
    # M' x_k + W' [u_k, u_(k+1), 1, z_k] of all unknowns at once, (unknown, time, state).
    matrices = np.concatenate([M, W], axis=2).transpose(0, 2, 1)
    drive = np.column_stack([x[:-1], _filter_inputs(u, z)]) @ matrices
    s = solve_recursion(run.M, drive, start)
    # e' = -(N' [x, u, 1] + C s)
    direct = np.column_stack([x, u, np.ones(len(u))]) @ N.transpose(0, 2, 1)
    return -(direct + s @ run.N[:, : len(run.M)].T) / width[:, None, None]


def _filter_inputs(u: np.ndarray, z: np.ndarray) -> np.ndarray:
    """Return [u_k, u_(k+1), 1, z_k] of all steps."""
    return np.column_stack([u[:-1], u[1:], np.ones(len(u) - 1), z[:-1]])


def _filter_states(run: Predictor, u: np.ndarray, z: np.ndarray) -> np.ndarray:
    """Return the states of a filter, (time, state)."""
    return solve_recursion(run.M, (_filter_inputs(u, z) @ run.W.T)[None], run.start[None])[0]


def solve_recursion(M: np.ndarray, drive: np.ndarray, start: np.ndarray) -> np.ndarray:
    """Return x_(k+1) = M x_k + drive_k with x_0 = start, (run, time, state).

    Parameters
    ----------
    M : array (state, state)
    drive : array (run, time - 1, state)
    start : array (run, state)
    """
    # One triangular banded system for all runs: the main diagonal has ones, and row n + i - j of
    # `band` is the diagonal at this distance below it, with the elements -M[i, j].
    runs, steps, n = drive.shape
    band = np.zeros((2 * n, (steps + 1) * n))
    for i, j in np.ndindex(n, n):
        band[n + i - j, j : steps * n : n] = -M[i, j]
    x = np.concatenate([start[:, None], drive], axis=1).reshape(runs, -1)
    x, _ = scipy.linalg.lapack.dtbtrs(band, x.T, uplo="L", diag="U", overwrite_b=1)
    return x.T.reshape(runs, steps + 1, n)
