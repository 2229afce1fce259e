"""Linear models with named parameters: elements of the matrices, or whatever a function makes matrices from."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from typing import NamedTuple

import numpy as np
import xarray as xr

from flightmech.errors import SchemaError, UnknownName

_DIMS = {"A": ("state", "state_"), "B": ("state", "input"), "C": ("output", "state_"), "D": ("output", "input")}


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
        Takes a mapping of parameter to value and returns A, B, C, D; parameters that it does not find keep a value of its own.
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
        wrong = [f"{name} is {x.shape}; the names require {wanted[name]}" for name, x in found._asdict().items() if x.shape != wanted[name]]
        if wrong:
            raise SchemaError("linear model", wrong)
        return found


def linear_model(linear: xr.Dataset, ties: Mapping[str, Mapping[str, float]] | None = None) -> LinearModel:
    """Return the model whose parameters are the elements of given matrices, ``A[alpha,q]``, ``B[q,delta_e]``, ``C[nz,alpha]`` ...

    Parameters
    ----------
    linear : Dataset
        As from `flightmech.linearize`: ``A (state, state_)``, ``B (state, input)``, ``C (output, state_)``, ``D (output, input)``, with
        ``u`` and ``y`` for the point.  [SI]
    ties : mapping of str to mapping of str to float, optional
        Elements that move with another one: ``{"A[alpha,alpha]": {"C[nz,alpha]": -V / g}}`` adds -V/g times the change of the first to
        the second.

    Raises
    ------
    UnknownName
        A tie that names no element.
    """
    names = {key: [str(x) for x in linear[key].values] for key in ("state", "state_", "input", "output")}
    places = {
        f"{matrix}[{row},{column}]": (matrix, i, j)
        for matrix, (down, across) in _DIMS.items()
        for i, row in enumerate(names[down])
        for j, column in enumerate(names[across])
    }
    base = {matrix: linear[matrix].transpose(*dims).values.astype(float) for matrix, dims in _DIMS.items()}
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
        name: float(x) for at, key in (("u", "input"), ("y", "output")) if at in linear for name, x in zip(names[key], linear[at].values)
    }
    return LinearModel(tuple(names["state"]), tuple(names["input"]), tuple(names["output"]), matrices, tuple(places), reference)


def demand_known(model: LinearModel, wanted: Sequence[str], extra: Sequence[str]) -> None:
    """Refuse unknowns that are neither parameters of the model nor among `extra`."""
    allowed = [*model.parameters, *extra]
    for name in wanted:
        if name not in allowed:
            raise UnknownName(name, allowed, "parameter")


def signals(model: LinearModel, record: xr.Dataset, gaps: bool = False) -> tuple[np.ndarray, np.ndarray]:
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
            raise UnknownName(name, map(str, record.data_vars), "signal", "the record does not hold it")
        x = np.broadcast_to(record[name].values.astype(float), (record.sizes["time"],)) - model.reference.get(name, 0.0)
        if not (gaps and name in model.outputs) and not np.isfinite(x).all():
            problems.append(f"{name} is not finite in {int((~np.isfinite(x)).sum())} samples; fill short gaps or cut the record there")
        columns.append(x)
    if problems:
        raise SchemaError("record", problems)
    together = np.column_stack(columns)
    return together[:, : len(model.inputs)], together[:, len(model.inputs) :]


def picked(values: Mapping[str, float], kind: str, names: Sequence[str]) -> np.ndarray:
    """Return the values called `kind`.name, zero where there is none."""
    return np.array([values.get(f"{kind}.{name}", 0.0) for name in names])
