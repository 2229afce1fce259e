"""Linear models with named parameters: elements of the matrices, or whatever a function makes
matrices from.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from typing import NamedTuple

import numpy as np
import scipy
import xarray as xr

from flightmech.errors import SchemaError, UnknownName

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
        Takes a mapping of parameter to value and returns A, B, C, D; parameters that it does not
        find keep a value of its own.
    parameters : tuple of str
        What may be estimated.
    reference : mapping of str to float
        Inputs and outputs about which the model is linear; 0 where none is named.  [SI]
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
        found = Matrices(*(np.asarray(item, float) for item in self.matrices(values)))
        n, m, p = len(self.states), len(self.inputs), len(self.outputs)
        wanted = {"A": (n, n), "B": (n, m), "C": (p, n), "D": (p, m)}
        wrong = [
            f"{name} is {x.shape}; the names require {wanted[name]}"
            for name, x in found._asdict().items()
            if x.shape != wanted[name]
        ]
        if wrong:
            raise SchemaError("linear model", wrong)
        return found


def linear_model(
    linear: xr.Dataset, ties: Mapping[str, Mapping[str, float]] | None = None
) -> LinearModel:
    """Return the model whose parameters are the elements of given matrices, ``A[alpha,q]``,
    ``B[q,delta_e]``, ``C[nz,alpha]`` ...

    Parameters
    ----------
    linear : Dataset
        As from `flightmech.linearize`: ``A (state, state_)``, ``B (state, input)``, ``C (output,
        state_)``, ``D (output, input)``, with ``u`` and ``y`` for the point.  [SI]
    ties : mapping of str to mapping of str to float, optional
        Elements that move with another one: ``{"A[alpha,alpha]": {"C[nz,alpha]": -V / g}}`` adds
        -V/g times the change of the first to the second.

    Raises
    ------
    UnknownName
        A tie that names no element.
    """
    names = {
        key: [str(x) for x in linear[key].values] for key in ("state", "state_", "input", "output")
    }
    places = {
        f"{matrix}[{row},{column}]": (matrix, i, j)
        for matrix, (down, across) in _DIMS.items()
        for i, row in enumerate(names[down])
        for j, column in enumerate(names[across])
    }
    base = {
        matrix: linear[matrix].transpose(*dims).values.astype(float)
        for matrix, dims in _DIMS.items()
    }
    linked = {name: dict(others) for name, others in (ties or {}).items()}
    for name in [*linked, *(other for others in linked.values() for other in others)]:
        if name not in places:
            raise UnknownName(name, places, "element")

    def matrices(values: Mapping[str, float]) -> list[np.ndarray]:
        made = {matrix: x.copy() for matrix, x in base.items()}
        for name in places.keys() & values.keys():
            matrix, i, j = places[name]
            change = values[name] - base[matrix][i, j]
            for other, slope in {name: 1.0, **linked.get(name, {})}.items():
                where, k, l = places[other]
                made[where][k, l] += slope * change
        return [made[matrix] for matrix in _DIMS]

    reference = {
        name: float(x)
        for at, key in (("u", "input"), ("y", "output"))
        if at in linear
        for name, x in zip(names[key], linear[at].values)
    }
    return LinearModel(
        tuple(names["state"]),
        tuple(names["input"]),
        tuple(names["output"]),
        matrices,
        tuple(places),
        reference,
    )


def demand_known(model: LinearModel, wanted: Sequence[str], extra: Sequence[str]) -> None:
    """Refuse unknowns that are neither parameters of the model nor among `extra`."""
    allowed = [*model.parameters, *extra]
    for name in wanted:
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
        x = np.broadcast_to(
            record[name].values.astype(float), (record.sizes["time"],)
        ) - model.reference.get(name, 0.0)
        if not (gaps and name in model.outputs) and not np.isfinite(x).all():
            problems.append(
                f"{name} is not finite in {int((~np.isfinite(x)).sum())} samples; fill short "
                f"gaps or cut the record there"
            )
        columns.append(x)
    if problems:
        raise SchemaError("record", problems)
    together = np.column_stack(columns)
    return together[:, : len(model.inputs)], together[:, len(model.inputs) :]


def pick_values(values: Mapping[str, float], kind: str, names: Sequence[str]) -> np.ndarray:
    """Return the values called `kind`.name, zero where there is none."""
    return np.array([values.get(f"{kind}.{name}", 0.0) for name in names])


class Filter(NamedTuple):
    """A predictor: x_(k+1) = F (x_k + K e_k) + G0 u_k + G1 u_(k+1) + g, e_k = z_k - C x_k - D u_k,
    cov(e) = S.
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
    """Return the steady-state Kalman filter.

    Parameters
    ----------
    model : Matrices
    drift : array (state,)
        Constant part b of the rates.
    intensity : array (state,)
        Square root of the intensity of w. [unit of the state per square root of second]
    noise : array (output,)
        Standard deviation of v.
    step : float
        Sampling interval. [s]

    Raises
    ------
    LinAlgError
        No filter settles: what grows is not seen in the outputs.

    References
    ----------
    .. [VanLoan1978] Van Loan, Computing integrals involving the matrix exponential, IEEE Trans. Automatic Control 23, 1978.
    """
    A, B, C, D = model
    n, m = B.shape
    # constant and ramp of [u; 1] as further states: the transition over one step holds the
    # integrals
    whole = np.zeros((n + 2 * (m + 1), n + 2 * (m + 1)))
    whole[:n, :n], whole[:n, n : n + m], whole[:n, n + m] = A, B, drift
    whole[n : n + m + 1, n + m + 1 :] = np.eye(m + 1) / step
    made = scipy.linalg.expm(whole * step)
    F, level, ramp = made[:n, :n], made[:n, n : n + m + 1], made[:n, n + m + 1 :]
    R = np.diag(noise**2)
    if not intensity.any():
        return Filter(
            F, level[:, :m] - ramp[:, :m], ramp[:, :m], level[:, m], C, D, np.zeros((n, len(C))), R
        )
    paired = np.zeros((2 * n, 2 * n))
    paired[:n, :n], paired[:n, n:], paired[n:, n:] = -A, np.diag(intensity**2), A.T
    spread = scipy.linalg.expm(paired * step)
    Q = F @ spread[:n, n:]
    P = scipy.linalg.solve_discrete_are(F.T, C.T, 0.5 * (Q + Q.T), R)
    S = C @ P @ C.T + R
    K = np.linalg.solve(S, C @ P).T
    return Filter(F, level[:, :m] - ramp[:, :m], ramp[:, :m], level[:, m], C, D, K, 0.5 * (S + S.T))


class Predictor(NamedTuple):
    """One run of a filter: x_(k+1) = M x_k + W [u_k, u_(k+1), 1, z_k], e_k = z_k - N [x_k, u_k, 1];
    or the rates of one.

    ``start`` is x_0.
    """

    M: np.ndarray
    W: np.ndarray
    N: np.ndarray
    start: np.ndarray


def make_predictor(made: Filter, start: np.ndarray, offset: np.ndarray) -> Predictor:
    """Return a filter with its first state (state,) and the errors of the instruments (output,),
    which are added to y.
    """
    F, G0, G1, g, C, D, K, _ = made
    gain = F @ K
    return Predictor(
        F - gain @ C,
        np.column_stack([G0 - gain @ D, G1, g - gain @ offset, gain]),
        np.column_stack([C, D, offset]),
        start,
    )


def filter_innovations(run: Predictor, u: np.ndarray, z: np.ndarray) -> np.ndarray:
    """Return the innovations (time, output) under inputs u (time, input) and readings z (time,
    output).
    """
    return z - np.column_stack([_states(run, u, z), u, np.ones(len(u))]) @ run.N.T


def innovation_slopes(
    run: Predictor,
    up: list[Predictor],
    down: list[Predictor],
    width: np.ndarray,
    u: np.ndarray,
    z: np.ndarray,
):
    """Return the slopes of the innovations (unknown, time, output).

    The matrices by differences; of what they make of the record the exact derivative, so that all
    unknowns share one recursion: s_(k+1) = M s_k + M' x_k + W' [u_k, u_(k+1), 1, z_k].

    Parameters
    ----------
    run : Predictor
    up, down : list of Predictor
        After a step of each unknown.
    width : array (unknown,)
        Distance between the two.
    u, z : array (time, input), (time, output)
    """
    M, W, N, start = (np.stack(a) - np.stack(b) for a, b in zip(zip(*up), zip(*down)))
    x = _states(run, u, z)
    drive = np.column_stack([x[:-1], _driving(u, z)]) @ np.concatenate([M, W], axis=2).transpose(
        0, 2, 1
    )
    s = solve_recursion(run.M, drive, start)
    seen = np.column_stack([x, u, np.ones(len(u))]) @ N.transpose(0, 2, 1)
    return -(seen + s @ run.N[:, : len(run.M)].T) / width[:, None, None]


def _driving(u: np.ndarray, z: np.ndarray) -> np.ndarray:
    return np.column_stack([u[:-1], u[1:], np.ones(len(u) - 1), z[:-1]])


def _states(run: Predictor, u: np.ndarray, z: np.ndarray) -> np.ndarray:
    return solve_recursion(run.M, (_driving(u, z) @ run.W.T)[None], run.start[None])[0]


def solve_recursion(M: np.ndarray, drive: np.ndarray, start: np.ndarray) -> np.ndarray:
    """Return x_(k+1) = M x_k + drive_k, x_0 = start, (run, time, state): one triangular banded
    system for all runs.

    Parameters
    ----------
    M : array (state, state)
    drive : array (run, time - 1, state)
    start : array (run, state)
    """
    runs, steps, n = drive.shape
    band = np.zeros(
        (2 * n, (steps + 1) * n)
    )  # row i - j of the diagonals below the main one, which is of ones
    for i, j in np.ndindex(n, n):
        band[n + i - j, j : steps * n : n] = -M[i, j]
    x = np.concatenate([start[:, None], drive], axis=1).reshape(runs, -1)
    x, _ = scipy.linalg.lapack.dtbtrs(band, x.T, uplo="L", diag="U", overwrite_b=1)
    return x.T.reshape(runs, steps + 1, n)
