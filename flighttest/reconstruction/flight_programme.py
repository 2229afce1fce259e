"""Reconstruction of a flight-test programme with common constants of the instruments.

All runs share the constants of the instruments. Wind and reference pressure belong to one run.
"""

from __future__ import annotations

import os
import pathlib
from collections.abc import Mapping, Sequence
from dataclasses import replace
from functools import partial
from typing import Any

import h5py
import numpy as np
import xarray as xr

from flightmech.aircraft.aircraft import Aircraft
from flightmech.errors import ParseError
from flightmech.support.hdf5_seal import decoding_errors, demand_self_contained
from flightmech.support.kept_stages.stages import Kept, Stages
from flighttest.reconstruction.combined_biases import (
    RunInformation,
    combine_runs,
    run_information,
)
from flighttest.reconstruction.flight_path import FlightPath
from flighttest.reconstruction.problem.assembly import Setup
from flighttest.reconstruction.problem.trajectory import Solution
from flighttest.reconstruction.smoother import path_of_solution, refine_path, solve_record
from flighttest.records.files import write_groups
from flighttest.records.stored_groups import plain_group

_Solved = tuple[Setup, Solution]


def reconstruct_programme(
    records: Sequence[xr.DataTree],
    aircraft: Aircraft,
    rate: float = 50.0,
    jobs: int = 1,
    validation: Sequence[xr.DataTree] = (),
) -> list[FlightPath]:
    """Reconstruct all runs of a programme, each with the constants of the other runs as prior.

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
        Runs of the same instruments for the validation of the model. The constants from `records`
        are their prior. They have no effect on other runs.

    Returns
    -------
    list of FlightPath
        In the order of the records, then of the validation runs. Every run is solved alone first.
        Then it is solved again with the combination of all *other* `records` as its prior, so that
        no reading counts twice. The paths of `records` are the same to the last bit with and
        without validation runs.

    Raises
    ------
    OutOfRange, SchemaError, IdentificationError
        As `reconstruct`.
    """
    stages = Stages()
    named = {str(i): stages.given(record) for i, record in enumerate(records)}
    proving = {str(len(named) + i): stages.given(record) for i, record in enumerate(validation)}
    paths = reconstructed_paths(
        named, stages.given(aircraft), rate=rate, jobs=jobs, validation=proving
    )
    return [path.value for path in paths.values()]


def reconstructed_paths(
    records: Mapping[str, Kept[xr.DataTree]],
    aircraft: Kept[Aircraft],
    rate: float = 50.0,
    jobs: int = 1,
    validation: Mapping[str, Kept[xr.DataTree]] | None = None,
    stages: Stages | None = None,
) -> dict[str, Kept[FlightPath]]:
    """Return the paths of `reconstruct_programme` by name, each computed or read from the stages.

    The information of each run on the instruments is a stage of its own. After a change of one
    record, the first solutions of the other records are still valid. Their second solutions use the
    new information.

    Parameters
    ----------
    records, validation : mapping of str to Kept
        Records by name.
    stages : Stages, optional
        Stages with a store; without it nothing is stored.
    """
    stages = stages or Stages()
    all_records = {**records, **(validation or {})}
    common = {"aircraft": aircraft, "rate": rate}

    # first pass: every run alone
    def first_arguments(name: str) -> tuple[Any, ...]:
        return all_records[name].value, aircraft.value, rate

    first_inputs = {name: {"record": record, **common} for name, record in all_records.items()}
    solved = stages.each(
        "solution", first_inputs, function=_solve_alone, arguments=first_arguments, jobs=jobs
    )
    information: dict[str, Kept[RunInformation]] = {}
    for name in records:
        work = partial(_solved_information, solved[name])
        information[name] = stages.one("instruments", {"solution": solved[name]}, work, name)

    # second pass: every run with the information of all other records
    priors: dict[tuple[str, ...], xr.Dataset] = {}

    def second_arguments(name: str) -> tuple[Any, ...]:
        others = tuple(record for record in information if record != name)
        # All validation runs have the same prior.
        if others and others not in priors:
            priors[others] = combine_runs([information[record].value for record in others])
        return all_records[name].value, aircraft.value, *solved[name].value, priors.get(others)

    second_inputs = {}
    for name, record in all_records.items():
        others = [item for record_name, item in information.items() if record_name != name]
        second_inputs[name] = {
            "record": record,
            "solution": solved[name],
            "instruments": others,
            **common,
        }
    return stages.each(
        "path", second_inputs, function=_refine_solution, arguments=second_arguments, jobs=jobs
    )


def _solve_alone(record: xr.DataTree, aircraft: Aircraft, rate: float) -> _Solved:
    """Return the solution of one run without its equations.

    The equations are many times as large as the solution, and stay in their process.
    """
    setup, solution = solve_record(record, aircraft, windows=None, prior=None, rate=rate)
    return setup, replace(solution, equations=None)


def _solved_information(solved: Kept[_Solved]) -> RunInformation:
    """Return the information of a run that was solved alone."""
    setup, solution = solved.value
    return run_information(setup.biases(solution))


def _refine_solution(
    record: xr.DataTree,
    aircraft: Aircraft,
    setup: Setup,
    solution: Solution,
    prior: xr.Dataset | None,
) -> FlightPath:
    """Return the path of a run with the constants of the other runs as prior."""
    if prior is None:
        return path_of_solution(record, aircraft, setup=setup, solution=solution)
    return refine_path(record, aircraft, setup=setup, solution=solution, prior=prior)


def save_path(path: FlightPath, target: str | os.PathLike[str]) -> None:
    """Write a reconstruction to a netCDF file.

    The groups are ``states`` (with the report as attribute), ``biases``, ``residuals`` and
    ``errors``.

    Parameters
    ----------
    path : FlightPath
    target : path
    """
    groups = {
        "/states": path.states.assign_attrs(report=path.report()),
        "/residuals": path.residuals,
        # netCDF has no bool
        "/biases": path.biases.assign(held=path.biases["held"].astype("int8")),
    }
    if path.errors is not None:
        groups["/errors"] = path.errors
    write_groups(groups, pathlib.Path(target))


def open_biases(path: str | os.PathLike[str]) -> xr.Dataset:
    """Return the constants in a file of `save_path`, as a prior or for `combine_biases`.

    Parameters
    ----------
    path : path

    Raises
    ------
    ParseError
        The file is not a reconstruction, or its constants lack what an estimate needs.
    """
    demand_self_contained(path)
    expected = "constants of a path, as `aeromatch flight reconstruct -o` writes it"
    with decoding_errors(path, expected):
        with h5py.File(path, "r") as file:
            if "biases" not in file:
                raise ParseError(str(path), 0, "no constants of a reconstruction", expected)
            biases = plain_group(file["biases"])
        # The general reader reads a group with more than plain numbers.
        if biases is None:
            with xr.open_dataset(
                path, group="biases", engine="h5netcdf", phony_dims="access"
            ) as data:
                biases = data.load()
    if fault := _find_fault(biases):
        raise ParseError(str(path), 0, fault, expected)
    return biases.assign(held=biases["held"].astype(bool))


_OF_EACH = ("estimate", "stderr", "prior", "prior_stderr", "held")
_OF_PAIRS = ("correlation", "prior_correlation")
_OF_SQUARE = ("parameter", "parameter_")
_CORRELATED = 1e-6  # rounding of a correlation; an inverse of the constants has 1e-13


def _find_fault(biases: xr.Dataset) -> str:
    """Return what makes constants useless as a prior, an empty text for nothing."""
    shapes: dict[str, tuple[str, ...]] = dict.fromkeys((*_OF_EACH, "unit"), ("parameter",))
    shapes |= dict.fromkeys(_OF_PAIRS, _OF_SQUARE)
    for name, dims in shapes.items():
        if name not in biases or biases[name].dims != dims:
            return f"constants without {name} ({', '.join(dims)})"
    if any(dimension not in biases.indexes for dimension in _OF_SQUARE):
        return "constants without names"
    names = biases.indexes["parameter"]
    if not names.is_unique or not names.equals(biases.indexes["parameter_"]):
        return "constants whose names are not the same in both directions, each once"
    for name in (*_OF_EACH, *_OF_PAIRS):
        values = biases[name].values
        if values.dtype.kind not in "biuf" or not np.all(np.isfinite(values)):
            return f"{name} of constants that is not a number"
    for name in ("stderr", "prior_stderr"):
        if not np.all(biases[name].values > 0.0):
            return f"{name} of constants that is not positive"
    for name in _OF_PAIRS:
        matrix = biases[name].values
        # A correlation is symmetric, has ones on its diagonal, and nothing beyond one.
        off = max(np.ptp([matrix, matrix.T], axis=0).max(), np.abs(np.diag(matrix) - 1.0).max())
        if off > _CORRELATED or np.abs(matrix).max() > 1.0 + _CORRELATED:
            return f"{name} of constants that is not a correlation"
    return ""
