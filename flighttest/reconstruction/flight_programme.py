"""A whole flight-test programme: instrument constants are shared by all runs, wind and pressure are
per run.
"""

from __future__ import annotations

import os
import pathlib
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from functools import partial
from typing import Any

import h5py
import numpy as np
import xarray as xr

from flightmech.aircraft.aircraft import Aircraft
from flightmech.errors import IdentificationError, ParseError, SchemaError
from flightmech.support.hdf5_seal import demand_self_contained
from flightmech.support.kept_stages.stages import Kept, Stages
from flighttest.reconstruction.flight_path import FlightPath
from flighttest.reconstruction.problem.assembly import Setup
from flighttest.reconstruction.problem.problem import PER_RUN, invert_covariance
from flighttest.reconstruction.problem.trajectory import Solution
from flighttest.reconstruction.smoother import path_of_solution, refine_path, solve_record
from flighttest.records.files import write_groups
from flighttest.records.stored_groups import plain_group


def combine_biases(paths: Sequence[Any]) -> xr.Dataset:
    """Return the constants of the instruments as all runs together determine them.

    Parameters
    ----------
    paths : sequence of Path, or of their ``biases``
        Reconstructions that started from the same prior, which is counted once.

    Returns
    -------
    Dataset (parameter,)
        Like ``Path.biases``, without the constants of a single run (wind, reference pressure), and
        with ``spread``: the rms over the runs of (run - combined)/(standard error of the
        difference), about 1 when the runs agree.

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
    return _combined([_evidence(getattr(path, "biases", path)) for path in paths])


@dataclass(frozen=True)
class _Evidence:
    """What one run states about the instruments, as plain arrays.

    Attributes
    ----------
    names, units : list of str (n,)
        Constants without those of the single run.
    estimate, stderr, prior, prior_stderr : array (n,)
    held : array of bool (n,)
    covariance : array (n, n)
        Of the prior.
    free : array of int (m,)
        Places of the constants that were not held.
    information, vector : array (m, m), (m,)
        What the run adds to the information on them, and that times their values.
    """

    names: list[str]
    units: list[str]
    estimate: np.ndarray
    stderr: np.ndarray
    prior: np.ndarray
    prior_stderr: np.ndarray
    held: np.ndarray
    covariance: np.ndarray
    free: np.ndarray
    information: np.ndarray
    vector: np.ndarray


def _evidence(found: xr.Dataset) -> _Evidence:
    """Return what the ``biases`` of a run state about the instruments."""
    shared = instrument_constants(found)
    estimate, stderr, prior, prior_stderr, held = (
        shared[k].values for k in ("estimate", "stderr", "prior", "prior_stderr", "held")
    )
    free = np.flatnonzero(~held)
    at = np.ix_(free, free)
    of_prior = _covariance(prior_stderr, shared["prior_correlation"].values)
    own, before = (
        invert_covariance(_covariance(stderr, shared["correlation"].values)[at]),
        invert_covariance(of_prior[at]),
    )
    return _Evidence(
        names=[str(name) for name in shared["parameter"].values],
        units=[str(unit) for unit in shared["unit"].values],
        estimate=estimate,
        stderr=stderr,
        prior=prior,
        prior_stderr=prior_stderr,
        held=held,
        covariance=of_prior,
        free=free,
        information=own - before,
        vector=own @ estimate[free] - before @ prior[free],
    )


def _combined(runs: Sequence[_Evidence]) -> xr.Dataset:
    """Return the constants as these runs together determine them, see `combine_biases`."""
    if not runs:
        raise SchemaError("combination of biases", ["no reconstruction given; give one at least"])
    names = list(dict.fromkeys(name for run in runs for name in run.names))
    place = {name: i for i, name in enumerate(names)}
    places = [np.array([place[name] for name in run.names]) for run in runs]
    prior_mean, prior, units = _common_prior(runs, places, names)
    base = invert_covariance(prior)
    information, vector = base.copy(), base @ prior_mean
    for run, at in zip(runs, places, strict=True):
        free = at[run.free]
        information[np.ix_(free, free)] += run.information
        vector[free] += run.vector
    covariance = invert_covariance(information)
    if not (np.diag(covariance) > 0.0).all():
        raise IdentificationError(
            "the runs contradict each other and their prior; look at the spread of single "
            "constants before you combine them"
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
            "spread": ("parameter", _spread(runs, places, mean, se)),
            "correlation": (square, covariance / np.outer(se, se)),
            "prior_correlation": (square, prior / np.outer(prior_se, prior_se)),
        },
        coords={"parameter": names, "parameter_": names},
        attrs={"runs": len(runs)},
    )


def reconstruct_programme(
    records: Sequence[xr.DataTree],
    aircraft: Aircraft,
    rate: float = 50.0,
    jobs: int = 1,
    validation: Sequence[xr.DataTree] = (),
) -> list[FlightPath]:
    """Reconstruct all runs of a programme, each with what the other runs indicate about the
    instruments.

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
        Runs of the same instruments that prove the model.  Each takes what `records` indicate about
        the instruments as its prior and gives nothing to any other run.

    Returns
    -------
    list of Path
        In the order of the records, then of the validation runs.  Every run is solved alone first;
        then again with the combination of all *other* `records` as its prior, so that no reading
        counts twice.  The paths of `records` are the same to the last bit with and without
        validation runs.

    Raises
    ------
    As `reconstruct`.
    """
    named = {f"{i}": Stages().given(record) for i, record in enumerate(records)}
    proving = {f"{len(named) + i}": Stages().given(record) for i, record in enumerate(validation)}
    return [
        path.value
        for path in reconstructed_paths(
            named, Stages().given(aircraft), rate, jobs, proving
        ).values()
    ]


def reconstructed_paths(
    records: Mapping[str, Kept[xr.DataTree]],
    aircraft: Kept[Aircraft],
    rate: float = 50.0,
    jobs: int = 1,
    validation: Mapping[str, Kept[xr.DataTree]] | None = None,
    stages: Stages | None = None,
) -> dict[str, Kept[FlightPath]]:
    """Return the paths of `reconstruct_programme` by name, each computed or kept by stages; records
    by name, others as there.

    What one run alone states of the instruments is kept with its solution, so that a change of one
    record leaves the first pass over the others; their second pass takes what it states.
    """
    stages, every = stages or Stages(), {**records, **(validation or {})}
    of_all = {"aircraft": aircraft, "rate": rate}

    def first(name: str) -> tuple[Any, ...]:
        return every[name].value, aircraft.value, rate

    solved = stages.each(
        "solution",
        {name: {"record": record, **of_all} for name, record in every.items()},
        _alone,
        first,
        jobs,
    )
    stated = {
        name: stages.one(
            "instruments", {"solution": solved[name]}, partial(_stated_by, solved[name]), name
        )
        for name in records
    }
    others = {name: [one for other, one in stated.items() if other != name] for name in every}
    priors: dict[tuple[str, ...], xr.Dataset] = {}

    def second(name: str) -> tuple[Any, ...]:
        own = tuple(other for other in stated if other != name)
        if own and own not in priors:  # runs that prove the model share theirs
            priors[own] = _combined([stated[other].value for other in own])
        return every[name].value, aircraft.value, *solved[name].value, priors.get(own)

    inputs = {
        name: {"record": record, "solution": solved[name], "instruments": others[name], **of_all}
        for name, record in every.items()
    }
    return stages.each("path", inputs, _refined, second, jobs)


def _alone(record: xr.DataTree, aircraft: Aircraft, rate: float) -> tuple[Setup, Solution]:
    """Return what `solve` finds, without the equations: they are many times as large and stay in
    their process.
    """

    setup, solution = solve_record(record, aircraft, None, None, rate)
    return setup, replace(solution, equations=None)


def _stated(setup: Setup, solution: Solution) -> _Evidence:
    """Return what a run that was solved alone states about the instruments."""
    return _evidence(setup.biases(solution))


def _stated_by(solved: Kept[tuple[Setup, Solution]]) -> _Evidence:
    return _stated(*solved.value)


def _refined(
    record: xr.DataTree,
    aircraft: Aircraft,
    setup: Setup,
    solution: Solution,
    prior: xr.Dataset | None,
) -> FlightPath:
    """Return the path of a run with what the others state about the instruments; of the only run as
    it was solved alone.
    """

    return (
        path_of_solution(record, aircraft, setup, solution)
        if prior is None
        else refine_path(record, aircraft, setup, solution, prior)
    )


def instrument_constants(found: xr.Dataset) -> xr.Dataset:
    """Return constants without those of a single run (wind, reference pressure)."""
    keep = [name not in PER_RUN for name in map(str, found["parameter"].values)]
    return found.isel(parameter=keep, parameter_=keep)


def _covariance(stderr: np.ndarray, correlation: np.ndarray) -> np.ndarray:
    return correlation * np.outer(stderr, stderr)


def _common_prior(
    runs: Sequence[_Evidence], places: Sequence[np.ndarray], names: list[str]
) -> tuple[np.ndarray, np.ndarray, list[str]]:
    mean, covariance, units = (
        np.full(len(names), np.nan),
        np.zeros((len(names), len(names))),
        [""] * len(names),
    )
    problems = []
    for run, at in zip(runs, places, strict=True):
        known, before, own = np.isfinite(mean[at]), np.diag(covariance)[at], np.diag(run.covariance)
        same = (np.abs(mean[at] - run.prior) <= 1e-9 * np.abs(run.prior)) & (
            np.abs(before - own) <= 1e-6 * np.abs(own) + 1e-8
        )
        problems += [
            f"{names[i]}: two runs started from different priors; reconstruct them with the "
            f"same one"
            for i in at[known & ~same]
        ]
        mean[at], covariance[np.ix_(at, at)] = run.prior, run.covariance
        for i, unit in zip(at, run.units, strict=True):
            units[i] = unit
    if problems:
        raise SchemaError("combination of biases", sorted(set(problems)))
    return mean, covariance, units


def _spread(
    runs: Sequence[_Evidence], places: Sequence[np.ndarray], mean: np.ndarray, se: np.ndarray
) -> np.ndarray:
    """Return the rms normalised deviation of the runs from their combination; NaN where only one
    run determines it.
    """
    ratios: list[list[float]] = [[] for _ in mean]
    for run, at in zip(runs, places, strict=True):
        variance = (
            run.stderr**2 - se[at] ** 2
        )  # of the difference: the run is part of the combination
        for j in np.flatnonzero(
            ~run.held & (run.stderr < 0.5 * run.prior_stderr) & (variance > 0.0)
        ).tolist():
            ratios[at[j]].append(float(run.estimate[j] - mean[at[j]]) / np.sqrt(variance[j]))
    return np.array([np.sqrt(np.mean(np.square(r))) if len(r) > 1 else np.nan for r in ratios])


def save_path(path: FlightPath, target: str | os.PathLike[str]) -> None:
    """Write a reconstruction: groups ``states`` (with the report as attribute), ``biases``,
    ``residuals``, ``errors``.
    """
    states = path.states.assign_attrs(report=path.report())
    biases = path.biases.assign(held=path.biases["held"].astype("int8"))
    groups = {"/states": states, "/residuals": path.residuals, "/biases": biases}
    write_groups(
        groups if path.errors is None else {**groups, "/errors": path.errors}, pathlib.Path(target)
    )


def open_biases(path: str | os.PathLike[str]) -> xr.Dataset:
    """Return the constants of a reconstruction written by `save_path`, as a prior or for
    `combine_biases`.

    Raises
    ------
    ParseError
        Not such a file.
    """

    demand_self_contained(path)
    try:
        with h5py.File(path, "r") as file:
            found = plain_group(file["biases"])
        if found is None:
            with xr.open_dataset(path, group="biases", engine="h5netcdf") as data:
                found = data.load()
    except (OSError, ValueError, KeyError) as error:
        if not os.path.exists(path):
            raise
        wanted = "a path as `aeromatch flight reconstruct -o` writes it"
        raise ParseError(
            str(path), 0, f"no constants of a reconstruction ({error})", wanted
        ) from error
    return found.assign(held=found["held"].astype(bool))
