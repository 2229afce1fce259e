"""Data partitioned into bins over conditions, with a local model in each bin.

Large manoeuvres cover a range in which no simple model holds. Their samples are sorted by angle of
attack or Mach number, and a simple model is fitted to each bin. The result is derivatives as
functions of the condition, before a model structure for the full range is available.

References
----------
.. [Klein2006] Klein, Morelli, Aircraft System Identification, AIAA 2006, chapter 5 (data
   partitioning).
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from itertools import pairwise, product

import numpy as np
import xarray as xr

from flightmech.errors import IdentificationError, UnknownName
from flightmech.short_text import ShortText
from flightmech.support.arrays import true_runs
from flighttest.regression.equation_error.fit import Fit
from flighttest.regression.equation_error.model import RegressionModel
from flighttest.regression.equation_error.samples import list_manoeuvres
from flighttest.regression.equation_error.time_domain import regress

LEAST_STRETCH = 0.5  # shorter stretches inside a bin are ignored [s]

Limits = dict[str, tuple[float, float]]
Bin = tuple[Limits, list[xr.Dataset]]


@dataclass(frozen=True)
class Partition(ShortText):
    """One model fitted bin by bin.

    Attributes
    ----------
    model : RegressionModel
    estimates : Dataset (bin, term, term_)
        ``estimate``, ``stderr``, ``stderr_white``, ``correlation`` (NaN for a bin without fit),
        ``samples`` (bin); of every condition ``<name>_low``, ``<name>_high`` and the
        ``<name>_mean`` of the samples.
    fits : tuple of Fit
        Fits of the bins, for `aerodb.tabulate`.
    refused : dict of int to str
        Bins without a fit, and the reason.
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
        conditions = "".join(f"{name:>22}" for name in names)
        lines = [
            f"{self.model} in {e.sizes['bin']} bins",
            f"{conditions}{'samples':>9}" + "".join(f"{term:>24}" for term in terms),
        ]
        for k in range(e.sizes["bin"]):
            row = e.isel(bin=k)
            line = ""
            for name in names:
                line += f"{float(row[f'{name}_low']):>10.4g} ...{float(row[f'{name}_high']):>8.4g}"
            line += f"{int(row['samples']):>9}"
            if k in self.refused:
                lines.append(f"{line}  no fit: {self.refused[k]}")
                continue
            for estimate, stderr in zip(row["estimate"].values, row["stderr"].values):
                line += f"{float(estimate):>13.4g} ({float(stderr):>8.2g})"
            lines.append(line)
        return "\n".join(lines)


def bins(
    data: xr.Dataset | Sequence[xr.Dataset], edges: Mapping[str, Sequence[float]]
) -> list[Bin]:
    """Sort the samples of manoeuvres into bins.

    Parameters
    ----------
    data : Dataset (time,) or list of them
    edges : mapping of str to sequence of float
        Rising edges of the bins of each condition: n edges make n - 1 bins. [SI]

    Returns
    -------
    list of (conditions, manoeuvres)
        Limits (low, high) by name, and the stretches of each manoeuvre that are inside for at least
        half a second. They have gaps in time where the condition was outside. All combinations are
        returned, with the last condition the fastest.

    Raises
    ------
    IdentificationError
        Edges that do not rise.
    UnknownName
        A condition that a manoeuvre does not hold.
    """
    manoeuvres = list_manoeuvres(data)
    for name, values in edges.items():
        if len(values) < 2 or not (np.diff(values) > 0).all():
            raise IdentificationError(
                f"edges of {name} are {list(values)}; expected two or more numbers that rise"
            )
        for manoeuvre in manoeuvres:
            if name not in manoeuvre:
                raise UnknownName(
                    name, map(str, manoeuvre.data_vars), "condition", "the data do not hold it"
                )
    sorted_bins = []
    # All combinations of one range per condition, the last condition fastest.
    for ranges in product(*map(pairwise, edges.values())):
        limits = dict(zip(edges, ranges))
        parts = []
        for manoeuvre in manoeuvres:
            part = _select_inside(manoeuvre, limits)
            if part.sizes["time"]:
                parts.append(part)
        sorted_bins.append((limits, parts))
    return sorted_bins


def fit_bins(
    model: RegressionModel,
    data: xr.Dataset | Sequence[xr.Dataset],
    edges: Mapping[str, Sequence[float]],
    name: str = "",
) -> Partition:
    """Fit a model to the samples of each bin.

    Parameters
    ----------
    model : RegressionModel
        A model that is simple enough for one bin. Its `reference` is near the middle of the range,
        and it has no variable that hardly moves in a bin.
    data, edges
        As in `bins`.
    name : str
        Name in reports and in the provenance.

    Returns
    -------
    Partition

    Raises
    ------
    IdentificationError
        No bin gave a fit. The message states the reason of each bin.
    UnknownName
        A variable of the model that the data do not hold.
    """
    sorted_bins = bins(data, edges)
    fits: dict[int, Fit] = {}
    refused = {}
    for k, (limits, parts) in enumerate(sorted_bins):
        if not parts:
            refused[k] = f"no stretch of {LEAST_STRETCH:g} s"
            continue
        label = ", ".join(f"{key} {low:g} ... {high:g}" for key, (low, high) in limits.items())
        if name:
            label = f"{name}: {label}"
        try:
            fits[k] = regress(model, parts, label)
        except IdentificationError as error:
            # without the label, which the report prints in columns
            refused[k] = str(error).split(": ", 1)[-1]
    if not fits:
        reasons = "\n".join(f"  - bin {k}: {reason}" for k, reason in refused.items())
        raise IdentificationError(f"{model}: no bin gave a fit\n{reasons}")
    estimates = _tabulate_bins(model, sorted_bins, fits)
    return Partition(model, estimates, fits=tuple(fits.values()), refused=refused)


def _select_inside(manoeuvre: xr.Dataset, limits: Limits) -> xr.Dataset:
    """Return the samples inside all limits, in stretches of sufficient length."""
    size = manoeuvre.sizes["time"]
    is_inside = np.ones(size, bool)
    for name, (low, high) in limits.items():
        x = _read_column(manoeuvre, name)
        is_inside &= (x >= low) & (x < high)
    step = 1.0
    if size > 1:
        step = float(np.median(np.diff(manoeuvre["time"].values)))
    shortest = max(1, round(LEAST_STRETCH / step))
    for start, stop in true_runs(is_inside):
        if stop - start < shortest:
            is_inside[start:stop] = False
    return manoeuvre.isel(time=is_inside)


def _read_column(manoeuvre: xr.Dataset, name: str) -> np.ndarray:
    """Return a variable, (time,); a scalar has the same value at all samples."""
    values = np.asarray(manoeuvre[name].values, float)
    return np.broadcast_to(values, (manoeuvre.sizes["time"],))


def _tabulate_bins(
    model: RegressionModel, sorted_bins: Sequence[Bin], fits: Mapping[int, Fit]
) -> xr.Dataset:
    """Return the estimates of all bins; NaN for a bin without fit."""
    terms, count = list(model.terms), len(sorted_bins)
    # Arrays have one row per bin; a bin without fit keeps NaN.
    table = xr.Dataset(coords={"term": terms, "term_": terms})
    for key in ("estimate", "stderr", "stderr_white"):
        values = np.full((count, len(terms)), np.nan)
        for k, fit in fits.items():
            values[k] = fit.estimates[key].values
        table[key] = ("bin", "term"), values
    correlation = np.full((count, len(terms), len(terms)), np.nan)
    for k, fit in fits.items():
        correlation[k] = fit.estimates["correlation"].values
    table["correlation"] = ("bin", "term", "term_"), correlation
    samples = []
    for _, parts in sorted_bins:
        samples.append(sum(part.sizes["time"] for part in parts))
    table["samples"] = "bin", np.array(samples)
    names = list(sorted_bins[0][0])
    for name in names:
        table[f"{name}_low"] = "bin", np.array([limits[name][0] for limits, _ in sorted_bins])
        table[f"{name}_high"] = "bin", np.array([limits[name][1] for limits, _ in sorted_bins])
        table[f"{name}_mean"] = "bin", np.array([_mean(parts, name) for _, parts in sorted_bins])
    table.attrs = {"coefficient": model.coefficient, "conditions": " ".join(names)}
    return table


def _mean(parts: Sequence[xr.Dataset], name: str) -> float:
    """Return the mean of a condition over all samples of a bin; NaN without samples."""
    if not parts:
        return float("nan")
    return float(np.concatenate([_read_column(part, name) for part in parts]).mean())
