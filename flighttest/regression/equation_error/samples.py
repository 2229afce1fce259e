"""Samples of several manoeuvres along one dimension, and their stretches without a gap."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from itertools import pairwise

import numpy as np
import xarray as xr

from flightmech.aircraft.controls import ICE
from flightmech.errors import IdentificationError, UnknownName
from flightmech.names import REDUCED_RATES
from flightmech.quantities import time_text
from flighttest.regression.equation_error.model import RegressionModel

# Variables that a table may depend on. They stay with the samples if all manoeuvres have them.
_AIR_DATA = ("alpha", "beta", "mach", "V", "qbar", "h", "h_agl")
_RATES = ("p", "q", "r", *REDUCED_RATES)
_LOADS = ("phi", "nz", "dnz", "CL", "CT")
_SURFACES = ("delta_e", "delta_a", "delta_r", "delta_f", "delta_t", "delta_ta", "delta_tr")
_TABLE_VARIABLES = (*_AIR_DATA, *_RATES, *_LOADS, *_SURFACES, "gear", "speedbrake", ICE)
_GAP = 1.5  # sampling intervals between two samples from which on there is a gap

Response = Callable[[Mapping[str, np.ndarray]], np.ndarray]


@dataclass(frozen=True)
class RegressionSamples:
    """Samples of manoeuvres, one after the other.

    Attributes
    ----------
    data : Dataset (sample,)
        Coefficient, variables, ``time`` and ``manoeuvre`` (from 0). If all manoeuvres have it,
        also ``<coefficient>_error`` (error, sample), and the same of the variables that any error
        source changes.
    steps : list of float
        Sampling interval of each manoeuvre. [s]
    """

    data: xr.Dataset
    steps: list[float]

    def pieces(self) -> tuple[list[slice], list[float]]:
        """Return the stretches without a gap, inside one manoeuvre, and their sampling intervals.

        Returns
        -------
        pieces : list of slice
        steps : list of float
            Sampling interval of each stretch. [s]

        Raises
        ------
        IdentificationError
            No sample.
        """
        if not self.data.sizes["sample"]:
            raise IdentificationError(
                "no sample holds numbers of the coefficient and all its variables; check the "
                "accelerations, dynamic pressure and angles of the records for gaps and zeros"
            )
        manoeuvre, time = self.data["manoeuvre"].values, self.data["time"].values
        # A stretch ends at a gap in time, and at the end of its manoeuvre.
        allowed = _GAP * np.asarray(self.steps)[manoeuvre[1:]]
        is_cut = (np.diff(manoeuvre) != 0) | (np.abs(np.diff(time)) > allowed)
        edges = [0, *(np.flatnonzero(is_cut) + 1).tolist(), len(time)]
        pieces = [slice(start, stop) for start, stop in pairwise(edges)]
        return pieces, [self.steps[manoeuvre[start]] for start in edges[:-1]]

    def errors(
        self,
        target: str,
        variables: Sequence[str] = (),
        fitted: Response | None = None,
    ) -> tuple[list[str], np.ndarray]:
        """Return the common errors of the measurement and their effect on the samples.

        Parameters
        ----------
        target : str
            The measured quantity.
        variables : sequence of str
            Variables of the model.
        fitted : callable, optional
            Response of the model without its constants to values (sample,) of the variables by
            name; see `slopes_of`. An error of a variable changes the response, and so the samples
            with the opposite sign.

        Returns
        -------
        sources : list of str
        change : array (error, sample)
            Change of the samples for one standard error of each source.
        """
        name = f"{target}_error"
        if name not in self.data:
            return [], np.zeros((0, self.data.sizes["sample"]))
        # Stored changes have single precision.
        change = self.data.variables[name].values.astype(float)
        errors_of: dict[str, np.ndarray] = {}
        for variable in variables:
            if f"{variable}_error" in self.data:
                errors_of[variable] = self.data.variables[f"{variable}_error"].values
        if fitted is not None and errors_of:
            values = {variable: self.data.variables[variable].values for variable in variables}
            _subtract_response(change, fitted, values=values, errors_of=errors_of)
        return [str(source) for source in self.data["error"].values], change

    def for_fit(self, coefficient: str, change: np.ndarray) -> xr.Dataset:
        """Return the samples for a Fit, with the change by all errors.

        Parameters
        ----------
        coefficient : str
        change : array (error, sample)
            Replaces the errors of the coefficient. The errors of the variables are removed.
        """
        name = f"{coefficient}_error"
        removed = []
        for variable, item in self.data.data_vars.items():
            if "error" in item.dims and variable != name:
                removed.append(variable)
        data = self.data.drop_vars(removed)
        if name not in data:
            return data
        return data.assign({name: (("error", "sample"), change.astype(np.float32))})


def _subtract_response(
    change: np.ndarray,
    fitted: Response,
    values: Mapping[str, np.ndarray],
    errors_of: Mapping[str, np.ndarray],
) -> None:
    """Subtract the model's response to the errors of its variables from `change`, in place."""
    reference = fitted(values)
    for k in range(len(change)):
        # Only the variables that this source changes.
        shifted = {}
        for variable, steps in errors_of.items():
            if steps[k].any():
                shifted[variable] = values[variable] + steps[k]
        if shifted:
            change[k] -= fitted({**values, **shifted}) - reference


def slopes_of(model: RegressionModel, theta: np.ndarray) -> Response:
    """Return the response of a model without its constant, for `RegressionSamples.errors`.

    Parameters
    ----------
    model : RegressionModel
    theta : array (terms,)
        Estimates. One constant per manoeuvre may replace the term ``1``.
    """
    if len(theta) != len(model.terms):
        # Several constants stand at the position of the term 1: they become one zero.
        position, extra = model.terms.index("1"), len(theta) - len(model.terms)
        theta = np.concatenate([theta[:position], [0.0], theta[position + extra + 1 :]])
    slopes = np.where([term == "1" for term in model.terms], 0.0, theta)
    return lambda values: model.design(values) @ slopes


def _demand_rising_time(time: np.ndarray, number: int) -> None:
    """Raise when time does not rise: rates, colour and gaps of such samples would be wrong."""
    falls = np.flatnonzero(~(np.diff(time) > 0.0))
    if not len(falls):
        return
    k = int(falls[0])
    where = (
        f"from {time_text(time[k])} to {time_text(time[k + 1])} s at sample {k + 1} and "
        f"{len(falls) - 1} more times"
    )
    if len(falls) == len(time) - 1:
        where = (
            f"at all of its {len(time)} samples, from {time_text(time[0])} to "
            f"{time_text(time[-1])} s"
        )
    raise IdentificationError(
        f"time of manoeuvre {number} does not rise: it steps back or stands {where}; a time "
        f"that rises is needed: sort the samples (data.sortby('time')) and drop what comes twice, "
        f"and check the rates if the record was played backwards"
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
        Manoeuvres. Other variables that tables may depend on are included.
    purpose : object
        User of the variables, for the error messages.

    Raises
    ------
    IdentificationError
        No manoeuvre, or a manoeuvre whose time does not rise.
    UnknownName
        A variable that a manoeuvre does not hold.
    """
    manoeuvres = list_manoeuvres(data)
    if not manoeuvres:
        raise IdentificationError(f"no manoeuvre for {purpose}; give at least one Dataset")
    needed = [coefficient, *variables]
    _demand_variables(manoeuvres, needed, purpose)
    # Table variables are optional: a variable that one manoeuvre lacks is not stacked.
    optional = [name for name in _TABLE_VARIABLES if _all_hold(manoeuvres, name)]
    names = list(dict.fromkeys([*needed, *optional]))
    usable = [_usable_samples(manoeuvre, needed) for manoeuvre in manoeuvres]

    samples = xr.Dataset(_stack_columns(manoeuvres, names, usable))
    # Errors count only if every manoeuvre has them; the sources may differ.
    if _all_hold(manoeuvres, f"{coefficient}_error"):
        sources = _error_sources(manoeuvres)
        changes = _stack_errors(manoeuvres, needed, sources=sources, usable=usable)
        samples = samples.assign_coords(error=sources).assign(changes)
    steps = [_sampling_interval(manoeuvre) for manoeuvre in manoeuvres]
    return RegressionSamples(samples, steps)


def list_manoeuvres(data: xr.Dataset | Sequence[xr.Dataset]) -> list[xr.Dataset]:
    """Return manoeuvres as a list, also a single one."""
    if isinstance(data, xr.Dataset):
        return [data]
    return list(data)


def _demand_variables(
    manoeuvres: Sequence[xr.Dataset], needed: Sequence[str], purpose: object
) -> None:
    """Raise when a manoeuvre does not hold a variable, or when its time does not rise."""
    for number, manoeuvre in enumerate(manoeuvres):
        for name in needed:
            if name not in manoeuvre:
                raise UnknownName(
                    name,
                    map(str, manoeuvre.data_vars),
                    "variable",
                    f"manoeuvre {number} does not hold it; {purpose} needs it",
                )
        _demand_rising_time(manoeuvre["time"].values, number)


def _all_hold(manoeuvres: Sequence[xr.Dataset], name: str) -> bool:
    return all(name in manoeuvre for manoeuvre in manoeuvres)


def _sampling_interval(manoeuvre: xr.Dataset) -> float:
    """Return the median sampling interval, 1 for a single sample. [s]"""
    if manoeuvre.sizes["time"] == 1:
        return 1.0
    return float(np.median(np.diff(manoeuvre["time"].values)))


def _read_column(manoeuvre: xr.Dataset, name: str) -> np.ndarray:
    """Return a variable, (time,); a scalar has the same value at all samples."""
    values = np.asarray(manoeuvre.variables[name].values, float)
    return np.broadcast_to(values, (manoeuvre.sizes["time"],))


def _usable_samples(manoeuvre: xr.Dataset, needed: Sequence[str]) -> np.ndarray:
    """Return the mask (time,) of the samples in which all needed variables are finite."""
    usable = np.ones(manoeuvre.sizes["time"], bool)
    for name in needed:
        usable &= np.isfinite(_read_column(manoeuvre, name))
    return usable


def _stack_columns(
    manoeuvres: Sequence[xr.Dataset], names: Sequence[str], usable: Sequence[np.ndarray]
) -> dict[str, tuple[str, np.ndarray]]:
    """Return the usable samples of all manoeuvres, with ``time`` and the manoeuvre number."""
    parts: dict[str, list[np.ndarray]] = {name: [] for name in (*names, "time", "manoeuvre")}
    for number, (manoeuvre, use) in enumerate(zip(manoeuvres, usable)):
        for name in names:
            parts[name].append(_read_column(manoeuvre, name)[use])
        parts["time"].append(manoeuvre["time"].values.astype(float)[use])
        parts["manoeuvre"].append(np.full(int(use.sum()), number))
    return {name: ("sample", np.concatenate(arrays)) for name, arrays in parts.items()}


def _error_sources(manoeuvres: Sequence[xr.Dataset]) -> list[str]:
    """Return the names of all error sources, each once, in order of appearance."""
    sources: dict[str, None] = {}
    for manoeuvre in manoeuvres:
        sources.update(dict.fromkeys(map(str, manoeuvre["error"].values)))
    return list(sources)


def _stack_errors(
    manoeuvres: Sequence[xr.Dataset],
    needed: Sequence[str],
    sources: list[str],
    usable: Sequence[np.ndarray],
) -> dict[str, tuple[tuple[str, str], np.ndarray]]:
    """Return the changes (error, sample) of the needed variables that any source changes."""
    changes = {}
    for name in needed:
        error_name = f"{name}_error"
        if not any(error_name in manoeuvre for manoeuvre in manoeuvres):
            continue
        parts = []
        for manoeuvre, use in zip(manoeuvres, usable):
            parts.append(_change_by_source(manoeuvre, error_name, sources=sources, use=use))
        changes[error_name] = (("error", "sample"), np.concatenate(parts, axis=1))
    return changes


def _change_by_source(
    manoeuvre: xr.Dataset, name: str, sources: list[str], use: np.ndarray
) -> np.ndarray:
    """Return the change (source, sample) by every source; zero where a source does not act."""
    if name not in manoeuvre:
        return np.zeros((len(sources), int(use.sum())))
    changes = manoeuvre.variables[name].values
    if not use.all():
        changes = changes[:, use]
    rows = [sources.index(str(source)) for source in manoeuvre["error"].values]
    # Usually all manoeuvres have the same sources, and no copy is needed.
    if rows == list(range(len(sources))):
        return changes
    change = np.zeros((len(sources), changes.shape[1]))
    change[rows] = changes
    return change
