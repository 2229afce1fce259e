"""A whole flight-test programme: instrument constants are shared by all runs, wind and pressure are per run."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING, Any

import numpy as np
import xarray as xr

from flightmech.errors import IdentificationError, SchemaError

from .problem.constants import PER_RUN, inverse

if TYPE_CHECKING:
    from flightmech import Aircraft

    from .smoother import Path


def combine_biases(paths: Sequence[Any]) -> xr.Dataset:
    """Return the constants of the instruments as all runs together determine them.

    Parameters
    ----------
    paths : sequence of Path, or of their ``biases``
        Reconstructions that started from the same prior, which is counted once.

    Returns
    -------
    Dataset (parameter,)
        Like ``Path.biases``, without the constants of a single run (wind, reference pressure), and with ``spread``: the
        rms over the runs of (run - combined)/(standard error of the difference), about 1 when the runs agree.

    Raises
    ------
    SchemaError
        No path, or paths with different priors.
    IdentificationError
        The runs contradict their prior so much that no combination exists.

    Notes
    -----
    Run i adds the information P_i^-1 - P_0^-1 of its marginal posterior.  Constants that a run in turbulence held are
    not counted for that run.
    """
    sets = [getattr(path, "biases", path) for path in paths]
    if not sets:
        raise SchemaError("combination of biases", ["no reconstruction given; give one at least"])
    shared = [instrument_constants(found) for found in sets]
    names = list(dict.fromkeys(str(n) for found in shared for n in found["parameter"].values))
    prior_mean, prior, units = _common_prior(shared, names)
    base = inverse(prior)
    information, vector = base.copy(), base @ prior_mean
    for found in shared:
        free = found.isel(parameter=~found["held"].values, parameter_=~found["held"].values)
        at = np.array([names.index(str(n)) for n in free["parameter"].values])
        own, before = (inverse(_covariance(free, s, r)) for s, r in (("stderr", "correlation"), ("prior_stderr", "prior_correlation")))
        information[np.ix_(at, at)] += own - before
        vector[at] += own @ free["estimate"].values - before @ free["prior"].values
    covariance = inverse(information)
    if not (np.diag(covariance) > 0.0).all():
        raise IdentificationError(
            "the runs contradict each other and their prior; look at the spread of single constants before you combine them"
        )
    mean = covariance @ vector
    se, prior_se = np.sqrt(np.diag(covariance)), np.sqrt(np.diag(prior))
    square = ("parameter", "parameter_")
    return xr.Dataset(
        {
            "estimate": ("parameter", mean),
            "stderr": ("parameter", se),
            "prior": ("parameter", prior_mean),
            "prior_stderr": ("parameter", prior_se),
            "unit": ("parameter", units),
            "held": ("parameter", np.zeros(len(names), bool)),
            "spread": ("parameter", _spread(shared, names, mean, se)),
            "correlation": (square, covariance / np.outer(se, se)),
            "prior_correlation": (square, prior / np.outer(prior_se, prior_se)),
        },
        coords={"parameter": names, "parameter_": names},
        attrs={"runs": len(sets)},
    )


def reconstruct_programme(
    records: Sequence[xr.DataTree],
    aircraft: Aircraft,
    rate: float = 50.0,
    jobs: int = 1,
    validation: Sequence[xr.DataTree] = (),
) -> list[Path]:
    """Reconstruct all runs of a programme, each with what the other runs indicate about the instruments.

    Parameters
    ----------
    records : sequence of DataTree
        Runs with the same instruments.
    aircraft : Aircraft
    rate : float
        Samples per second of the paths. [Hz]
    jobs : int
        Processes to use.
    validation : sequence of DataTree
        Runs of the same instruments that prove the model.  Each takes what `records` indicate about the instruments as its prior and
        gives nothing to any other run.

    Returns
    -------
    list of Path
        In the order of the records, then of the validation runs.  Every run is solved alone first; then again with the combination
        of all *other* `records` as its prior, so that no reading counts twice.  The paths of `records` are the same to the last bit
        with and without validation runs.

    Raises
    ------
    As `reconstruct`.
    """
    from joblib import Parallel, delayed

    from .smoother import finish, refine, solve

    every = [*records, *validation]
    with Parallel(n_jobs=jobs) as pool:
        alone = list(pool(delayed(solve)(record, aircraft, None, None, rate) for record in every))
        sets = [setup.biases(solution) for setup, solution in alone[: len(records)]]
        others = [sets[:i] + sets[i + 1 :] for i in range(len(sets))] + [sets] * len(validation)
        found = [combine_biases(group) if group else None for group in others]
        refined = iter(
            pool(
                delayed(refine)(record, aircraft, *item, prior)
                for record, item, prior in zip(every, alone, found, strict=True)
                if prior is not None
            )
        )
        return [
            finish(record, aircraft, *item) if prior is None else next(refined)
            for record, item, prior in zip(every, alone, found, strict=True)
        ]


def instrument_constants(found: xr.Dataset) -> xr.Dataset:
    """Return constants without those of a single run (wind, reference pressure)."""
    keep = [name not in PER_RUN for name in map(str, found["parameter"].values)]
    return found.isel(parameter=keep, parameter_=keep)


def _covariance(found: xr.Dataset, stderr: str, correlation: str) -> np.ndarray:
    se = found[stderr].values
    return found[correlation].values * np.outer(se, se)


def _common_prior(shared: Sequence[xr.Dataset], names: list[str]) -> tuple[np.ndarray, np.ndarray, list[str]]:
    mean, covariance, units = np.full(len(names), np.nan), np.zeros((len(names), len(names))), [""] * len(names)
    problems = []
    for found in shared:
        at = np.array([names.index(str(n)) for n in found["parameter"].values])
        own_mean, own = found["prior"].values, _covariance(found, "prior_stderr", "prior_correlation")
        known = np.isfinite(mean[at])
        same = np.isclose(mean[at], own_mean, rtol=1e-9, atol=0.0) & np.isclose(np.diag(covariance)[at], np.diag(own), rtol=1e-6)
        problems += [f"{names[i]}: two runs started from different priors; reconstruct them with the same one" for i in at[known & ~same]]
        mean[at], covariance[np.ix_(at, at)] = own_mean, own
        for i, unit in zip(at, found["unit"].values, strict=True):
            units[i] = str(unit)
    if problems:
        raise SchemaError("combination of biases", sorted(set(problems)))
    return mean, covariance, units


def _spread(shared: Sequence[xr.Dataset], names: list[str], mean: np.ndarray, se: np.ndarray) -> np.ndarray:
    """Return the rms normalised deviation of the runs from their combination; NaN where only one run determines it."""
    ratios: list[list[float]] = [[] for _ in names]
    for found in shared:
        for name, x, s, prior_s, held in zip(
            *(found[k].values for k in ("parameter", "estimate", "stderr", "prior_stderr", "held")), strict=True
        ):
            i = names.index(str(name))
            variance = float(s) ** 2 - se[i] ** 2  # of the difference: the run is part of the combination
            if not held and s < 0.5 * prior_s and variance > 0.0:
                ratios[i].append(float(x - mean[i]) / np.sqrt(variance))
    return np.array([np.sqrt(np.mean(np.square(r))) if len(r) > 1 else np.nan for r in ratios])
