"""Data partitioned into bins over conditions, a local model in each.

Samples of large manoeuvres, over which no simple model holds, are sorted by angle of attack or Mach
number, and a simple model is fitted to each bin: derivatives as functions of the condition, before
a structure for the whole range is known.

References
----------
.. [Klein2006] Klein, Morelli, Aircraft System Identification, AIAA 2006, chapter 5 (data partitioning).
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from itertools import pairwise, product

import numpy as np
import xarray as xr

from flightmech.errors import IdentificationError, UnknownName
from flighttest.regression.equation_error.fit import Fit
from flighttest.regression.equation_error.model import RegressionModel
from flighttest.regression.equation_error.time_domain import regress

LEAST_STRETCH = 0.5  # stretches inside a bin that are shorter are left out [s]


@dataclass(frozen=True)
class Partition:
    """One model fitted bin by bin.

    Attributes
    ----------
    model : Model
    estimates : Dataset (bin, term, term_)
        ``estimate``, ``stderr``, ``stderr_white``, ``correlation`` (NaN where a bin gave no fit),
        ``samples`` (bin); of every condition ``<name>_low``, ``<name>_high`` and the
        ``<name>_mean`` of the samples.
    fits : tuple of Fit
        Of the bins that gave one; `aerodb.tabulate` takes them.
    refused : dict of int to str
        Bins without a fit, and why.
    """

    model: RegressionModel
    estimates: xr.Dataset
    fits: tuple[Fit, ...]
    refused: Mapping[int, str]

    def report(self) -> str:
        """Return the estimates of all bins as a text table."""
        e = self.estimates
        names = e.attrs["conditions"].split()
        terms = [str(term) for term in e["term"].values]
        heads = "".join(f"{name:>22}" for name in names)
        lines = [
            f"{self.model} in {e.sizes['bin']} bins",
            f"{heads}{'samples':>9}" + "".join(f"{term:>24}" for term in terms),
        ]
        for k in range(e.sizes["bin"]):
            row = e.isel(bin=k)
            edges = "".join(
                f"{float(row[name + '_low']):>10.4g} ...{float(row[name + '_high']):>8.4g}"
                for name in names
            )
            if k in self.refused:
                lines.append(f"{edges}{int(row['samples']):>9}  no fit: {self.refused[k]}")
                continue
            cells = "".join(
                f"{float(row['estimate'][j]):>13.4g} ({float(row['stderr'][j]):>8.2g})"
                for j in range(len(terms))
            )
            lines.append(f"{edges}{int(row['samples']):>9}{cells}")
        return "\n".join(lines)


def bins(
    data: xr.Dataset | Sequence[xr.Dataset], edges: Mapping[str, Sequence[float]]
) -> list[tuple[dict, list[xr.Dataset]]]:
    """Sort the samples of manoeuvres into bins.

    Parameters
    ----------
    data : Dataset (time,) or list of them
    edges : mapping of str to sequence of float
        Rising edges of the bins of each condition: n edges make n - 1 bins. [SI]

    Returns
    -------
    list of (conditions, manoeuvres)
        Name -> (low, high), and the stretches of each manoeuvre that lie inside for half a second
        at least, with gaps in time where the condition was elsewhere.  All combinations, the last
        condition fastest.

    Raises
    ------
    IdentificationError
        Edges that do not rise.
    UnknownName
        A condition that a manoeuvre does not hold.
    """
    manoeuvres = [data] if isinstance(data, xr.Dataset) else list(data)
    for name, values in edges.items():
        if len(values) < 2 or not (np.diff(values) > 0).all():
            raise IdentificationError(
                f"edges of {name} are {list(values)}; expected two or more numbers that rise"
            )
        for one in manoeuvres:
            if name not in one:
                raise UnknownName(
                    name, map(str, one.data_vars), "condition", "the data do not hold it"
                )
    found = []
    for pick in product(*(list(pairwise(values)) for values in edges.values())):
        limits = dict(zip(edges, pick))
        found.append(
            (limits, [part for one in manoeuvres if (part := _inside(one, limits)).sizes["time"]])
        )
    return found


def fit_bins(
    model: RegressionModel,
    data: xr.Dataset | Sequence[xr.Dataset],
    edges: Mapping[str, Sequence[float]],
    name: str = "",
) -> Partition:
    """Fit a model to the samples of each bin.

    Parameters
    ----------
    model : Model
        Simple enough for one bin; take its `reference` near the middle of the range, or leave out
        what hardly moves there.
    data, edges
        As in `bins`.
    name : str
        For reports and provenance.

    Returns
    -------
    Partition

    Raises
    ------
    IdentificationError
        No bin gave a fit; the message states why for each.
    UnknownName
        A variable of the model that the data do not hold.
    """
    sorted_bins = bins(data, edges)
    fits: dict[int, Fit] = {}
    refused = {}
    for k, (limits, parts) in enumerate(sorted_bins):
        label = ", ".join(f"{key} {low:g} ... {high:g}" for key, (low, high) in limits.items())
        if not parts:
            refused[k] = f"no stretch of {LEAST_STRETCH:g} s"
            continue
        try:
            fits[k] = regress(model, parts, f"{name}: {label}" if name else label)
        except IdentificationError as error:
            refused[k] = str(error).split(": ", 1)[-1]
    if not fits:
        raise IdentificationError(
            f"{model}: no bin gave a fit\n"
            + "\n".join(f"  - bin {k}: {why}" for k, why in refused.items())
        )
    return Partition(model, _table(model, sorted_bins, fits), tuple(fits.values()), refused)


def _inside(one: xr.Dataset, limits: Mapping[str, tuple[float, float]]) -> xr.Dataset:
    """The samples inside all limits, in stretches long enough."""
    size = one.sizes["time"]
    inside = np.ones(size, bool)
    for name, (low, high) in limits.items():
        x = np.broadcast_to(np.asarray(one[name].values, float), (size,))
        inside &= (x >= low) & (x < high)
    step = float(np.median(np.diff(one["time"].values))) if size > 1 else 1.0
    shortest = max(1, round(LEAST_STRETCH / step))
    edges = np.flatnonzero(np.diff(np.concatenate([[0], inside.astype(int), [0]])))
    for start, stop in zip(edges[::2], edges[1::2]):
        if stop - start < shortest:
            inside[start:stop] = False
    return one.isel(time=inside)


def _table(model: RegressionModel, sorted_bins, fits: Mapping[int, Fit]) -> xr.Dataset:
    terms, count = list(model.terms), len(sorted_bins)
    shapes = {
        "estimate": (count, len(terms)),
        "stderr": (count, len(terms)),
        "stderr_white": (count, len(terms)),
    }
    tables = {key: np.full(shape, np.nan) for key, shape in shapes.items()}
    correlation = np.full((count, len(terms), len(terms)), np.nan)
    for k, fit in fits.items():
        for key, values in tables.items():
            values[k] = fit.estimates[key].values
        correlation[k] = fit.estimates["correlation"].values
    found = xr.Dataset(
        {key: (("bin", "term"), values) for key, values in tables.items()},
        coords={"term": terms, "term_": terms},
    )
    found["correlation"] = ("bin", "term", "term_"), correlation
    found["samples"] = (
        "bin",
        np.array([sum(part.sizes["time"] for part in parts) for _, parts in sorted_bins]),
    )
    for name in sorted_bins[0][0]:
        found[f"{name}_low"] = "bin", np.array([limits[name][0] for limits, _ in sorted_bins])
        found[f"{name}_high"] = "bin", np.array([limits[name][1] for limits, _ in sorted_bins])
        found[f"{name}_mean"] = "bin", np.array([_mean(parts, name) for _, parts in sorted_bins])
    found.attrs = {"coefficient": model.coefficient, "conditions": " ".join(sorted_bins[0][0])}
    return found


def _mean(parts: Sequence[xr.Dataset], name: str) -> float:
    values = [
        np.broadcast_to(np.asarray(part[name].values, float), (part.sizes["time"],))
        for part in parts
    ]
    return float(np.concatenate(values).mean()) if values else float("nan")
