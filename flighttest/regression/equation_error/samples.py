"""The samples of several manoeuvres along one dimension, and where they are contiguous in time."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from itertools import pairwise

import numpy as np
import xarray as xr

from flightmech.errors import IdentificationError, UnknownName
from flighttest.regression.equation_error.model import RegressionModel

# what tables may depend on: kept with the samples
_KEPT = (
    *(
        "alpha",
        "beta",
        "mach",
        "V",
        "qbar",
        "h",
        "h_agl",
        "p",
        "q",
        "r",
        "phat",
        "qhat",
        "rhat",
        "alphadothat",
        "betadothat",
    ),
    *(
        "phi",
        "nz",
        "dnz",
        "CL",
        "CT",
        "delta_e",
        "delta_a",
        "delta_r",
        "delta_f",
        "delta_t",
        "delta_ta",
        "delta_tr",
        "gear",
        "speedbrake",
    ),
)


@dataclass(frozen=True)
class RegressionSamples:
    """Samples of manoeuvres, one after the other.

    Attributes
    ----------
    data : Dataset (sample,)
        Coefficient, variables, ``time``, ``manoeuvre`` (from 0); where all have it,
        ``<coefficient>_error`` (error, sample) and the same of the variables that any source moves.
    steps : list of float
        Sampling interval of each manoeuvre. [s]
    """

    data: xr.Dataset
    steps: list[float]

    def pieces(self) -> tuple[list[slice], list[float]]:
        """Return the stretches without a gap, inside one manoeuvre, and their sampling intervals."""
        manoeuvre, time = self.data["manoeuvre"].values, self.data["time"].values
        allowed = 1.5 * np.asarray(self.steps)[manoeuvre[1:]]
        cuts = np.flatnonzero((np.diff(manoeuvre) != 0) | (np.abs(np.diff(time)) > allowed)) + 1
        edges = [0, *cuts.tolist(), len(time)]
        return [slice(a, b) for a, b in pairwise(edges)], [
            self.steps[manoeuvre[a]] for a in edges[:-1]
        ]

    def errors(
        self,
        target: str,
        variables: Sequence[str] = (),
        fitted: Callable[[Mapping[str, np.ndarray]], np.ndarray] | None = None,
    ) -> tuple[list[str], np.ndarray]:
        """Return names of the common errors of the measurement and what they change, (error,
        sample).

        Parameters
        ----------
        target : str
            The measured quantity.
        variables : sequence of str
            Of the model.
        fitted : callable, optional
            What the model makes of values (sample,) of the variables by name, but for constants;
            see `slopes_of`.  An error of a variable changes that, and so the samples with the
            opposite sign.
        """
        name = f"{target}_error"
        if name not in self.data:
            return [], np.zeros((0, self.data.sizes["sample"]))
        change = self.data.variables[name].values.astype(float)
        moving = {
            variable: self.data.variables[f"{variable}_error"].values
            for variable in variables
            if f"{variable}_error" in self.data
        }
        if fitted is not None and moving:
            values = {variable: self.data.variables[variable].values for variable in variables}
            before = fitted(values)
            for k in range(len(change)):
                moved = {
                    variable: values[variable] + steps[k]
                    for variable, steps in moving.items()
                    if steps[k].any()
                }
                if moved:
                    change[k] -= fitted({**values, **moved}) - before
        return [str(source) for source in self.data["error"].values], change

    def kept(self, coefficient: str, change: np.ndarray) -> xr.Dataset:
        """Return the samples for a Fit: with the change by all errors, and without those of the
        variables.
        """
        wanted = f"{coefficient}_error"
        others = [
            name
            for name, item in self.data.data_vars.items()
            if "error" in item.dims and name != wanted
        ]
        data = self.data.drop_vars(others)
        return (
            data.assign({wanted: (("error", "sample"), change.astype(np.float32))})
            if wanted in data
            else data
        )


def slopes_of(
    model: RegressionModel, theta: np.ndarray
) -> Callable[[Mapping[str, np.ndarray]], np.ndarray]:
    """Return what a model makes of values of its variables without its constant, for
    `RegressionSamples.errors`.

    Parameters
    ----------
    model : Model
    theta : array (terms,)
        Estimates, perhaps with one constant per manoeuvre in place of the term ``1``.
    """
    if len(theta) != len(model.terms):
        at, extra = model.terms.index("1"), len(theta) - len(model.terms)
        theta = np.concatenate([theta[:at], [0.0], theta[at + extra + 1 :]])
    slopes = np.where([term == "1" for term in model.terms], 0.0, theta)
    return lambda values: model.design(values) @ slopes


def _demand_rising(time: np.ndarray, number: int) -> None:
    """Raise when time does not rise: reversed samples have reversed rates, and colour and gaps
    would be misread.

    Raises
    ------
    IdentificationError
        States where, and what to do.
    """
    back = np.flatnonzero(~(np.diff(time) > 0.0))
    if not len(back):
        return
    k = int(back[0])
    where = (
        f"from {time[k]:g} to {time[k + 1]:g} s at sample {k + 1} and {len(back) - 1} more times"
    )
    if len(back) == len(time) - 1:
        where = f"at all of its {len(time)} samples, from {time[0]:g} to {time[-1]:g} s"
    raise IdentificationError(
        f"time of manoeuvre {number} does not rise: it steps back or stands {where}; a time "
        f"that rises is needed: sort the samples "
        "(data.sortby('time')) and drop what comes twice, and check the rates if the record "
        "was played backwards"
    )


def stack_samples(
    coefficient: str,
    variables: Sequence[str],
    data: xr.Dataset | Sequence[xr.Dataset],
    purpose: object,
) -> RegressionSamples:
    """Return all samples in which the coefficient and the variables are finite.

    Parameters
    ----------
    coefficient : str
    variables : sequence of str
    data : Dataset (time,) or sequence of them
        Manoeuvres; other variables that tables may depend on are taken along.
    purpose : object
        What needs the variables; for the texts of errors.

    Raises
    ------
    IdentificationError
        No manoeuvre, or one whose time does not rise.
    UnknownName
        A variable that a manoeuvre does not hold.
    """
    manoeuvres = [data] if isinstance(data, xr.Dataset) else list(data)
    if not manoeuvres:
        raise IdentificationError(f"no manoeuvre for {purpose}; give at least one Dataset")
    needed = [coefficient, *variables]
    for number, one in enumerate(manoeuvres):
        for name in needed:
            if name not in one:
                raise UnknownName(
                    name,
                    map(str, one.data_vars),
                    "variable",
                    f"manoeuvre {number} does not hold it; {purpose} needs it",
                )
        _demand_rising(one["time"].values, number)
    kept = [name for name in _KEPT if all(name in one for one in manoeuvres)]
    names = list(dict.fromkeys([*needed, *kept]))
    with_errors = all(f"{coefficient}_error" in one for one in manoeuvres)
    sources = (
        list(dict.fromkeys(str(source) for one in manoeuvres for source in one["error"].values))
        if with_errors
        else []
    )
    moved = [
        f"{name}_error"
        for name in needed
        if with_errors and any(f"{name}_error" in one for one in manoeuvres)
    ]
    parts: dict[str, list[np.ndarray]] = {
        name: [] for name in (*names, "time", "manoeuvre", *moved)
    }
    for number, one in enumerate(manoeuvres):
        size = one.sizes["time"]
        columns = {
            name: np.broadcast_to(np.asarray(one.variables[name].values, float), (size,))
            for name in names
        }
        use = np.logical_and.reduce([np.isfinite(columns[name]) for name in needed])
        for name, column in columns.items():
            parts[name].append(column[use])
        parts["time"].append(one["time"].values.astype(float)[use])
        parts["manoeuvre"].append(np.full(int(use.sum()), number))
        rows = [sources.index(str(source)) for source in one["error"].values] if moved else []
        for name in moved:
            parts[name].append(_by_source(one, name, rows, len(sources), use))
    samples = xr.Dataset(
        {
            name: ("sample", np.concatenate(found))
            for name, found in parts.items()
            if name not in moved
        }
    )
    if with_errors:
        changes = {
            name: (("error", "sample"), np.concatenate(parts[name], axis=1)) for name in moved
        }
        samples = samples.assign_coords(error=sources).assign(changes)
    steps = [
        float(np.median(np.diff(one["time"].values))) if one.sizes["time"] > 1 else 1.0
        for one in manoeuvres
    ]
    return RegressionSamples(samples, steps)


def _by_source(
    one: xr.Dataset, name: str, rows: Sequence[int], count: int, use: np.ndarray
) -> np.ndarray:
    """The change of a variable by every source, (source, sample); nothing by those that this
    manoeuvre does not know.
    """
    if name not in one:
        return np.zeros((count, int(use.sum())))
    known = one.variables[name].values
    if not use.all():
        known = known[:, use]
    if rows == list(range(count)):
        return known
    found = np.zeros((count, known.shape[1]))
    found[rows] = known
    return found
