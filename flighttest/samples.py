"""The samples of several manoeuvres along one dimension, and where they hang together in time."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import pairwise

import numpy as np
import xarray as xr

from flightmech.errors import IdentificationError, UnknownName

# what tables may depend on: kept with the samples
_KEPT = (
    *("alpha", "beta", "mach", "V", "qbar", "h", "h_agl", "p", "q", "r", "phat", "qhat", "rhat", "alphadothat", "betadothat"),
    *("phi", "nz", "dnz", "CL", "delta_e", "delta_a", "delta_r", "delta_f", "delta_t", "delta_ta", "delta_tr", "gear", "speedbrake"),
)


@dataclass(frozen=True)
class Samples:
    """Samples of manoeuvres, one after the other.

    Attributes
    ----------
    data : Dataset (sample,)
        Coefficient, variables, ``time``, ``manoeuvre`` (from 0); ``<coefficient>_error`` (error, sample) where all have it.
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
        return [slice(a, b) for a, b in pairwise(edges)], [self.steps[manoeuvre[a]] for a in edges[:-1]]

    def errors(self, coefficient: str) -> tuple[list[str], np.ndarray]:
        """Return names of the common errors of the measurement and what they change, (error, sample)."""
        name = f"{coefficient}_error"
        if name not in self.data:
            return [], np.zeros((0, self.data.sizes["sample"]))
        return [str(source) for source in self.data["error"].values], self.data[name].values


def _demand_rising(time: np.ndarray, number: int) -> None:
    """Raise when time does not rise: reversed samples have reversed rates, and colour and gaps would be misread.

    Raises
    ------
    IdentificationError
        Says where, and what to do.
    """
    back = np.flatnonzero(~(np.diff(time) > 0.0))
    if not len(back):
        return
    k = int(back[0])
    where = f"from {time[k]:g} to {time[k + 1]:g} s at sample {k + 1} and {len(back) - 1} more times"
    if len(back) == len(time) - 1:
        where = f"at all of its {len(time)} samples, from {time[0]:g} to {time[-1]:g} s"
    raise IdentificationError(
        f"time of manoeuvre {number} does not rise: it steps back or stands {where}; a time that rises is needed: sort the samples "
        "(data.sortby('time')) and drop what comes twice, and check the rates if the record was played backwards"
    )


def stack(coefficient: str, variables: Sequence[str], data: xr.Dataset | Sequence[xr.Dataset], purpose: object) -> Samples:
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
                raise UnknownName(name, map(str, one.data_vars), "variable", f"manoeuvre {number} does not hold it; {purpose} needs it")
        _demand_rising(one["time"].values, number)
    kept = [name for name in _KEPT if all(name in one for one in manoeuvres)]
    names = list(dict.fromkeys([*needed, *kept]))
    error = f"{coefficient}_error"
    with_errors = all(error in one and one["error"].equals(manoeuvres[0]["error"]) for one in manoeuvres)
    parts: dict[str, list[np.ndarray]] = {name: [] for name in (*names, "time", "manoeuvre", error)}
    for number, one in enumerate(manoeuvres):
        size = one.sizes["time"]
        columns = {name: np.broadcast_to(np.asarray(one[name].values, float), (size,)) for name in names}
        use = np.logical_and.reduce([np.isfinite(columns[name]) for name in needed])
        for name, column in columns.items():
            parts[name].append(column[use])
        parts["time"].append(one["time"].values.astype(float)[use])
        parts["manoeuvre"].append(np.full(int(use.sum()), number))
        if with_errors:
            parts[error].append(one[error].values[:, use])
    samples = xr.Dataset({name: ("sample", np.concatenate(found)) for name, found in parts.items() if name != error})
    if with_errors:
        samples = samples.assign_coords(error=manoeuvres[0]["error"].values)
        samples[error] = ("error", "sample"), np.concatenate(parts[error], axis=1)
    steps = [float(np.median(np.diff(one["time"].values))) if one.sizes["time"] > 1 else 1.0 for one in manoeuvres]
    return Samples(samples, steps)
