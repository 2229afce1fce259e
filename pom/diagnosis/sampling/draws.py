"""Draws of models and of instrument errors: differences between an aeroplane and its record.

The constants of a reconstruction leave common errors in its states
(`flighttest.reconstruction.state_errors`). Pick-ups of controls have a bias and a scale; mass,
inertia and thrust have a relative error, as `flighttest.coefficients` takes them.  All are linear,
so that a draw of a flight is one with a sum of shifts.  An error of one name is one error in all
records of a programme, and in the tables that were identified from them (`aerodb.update.draw`).
Channels that are not smoothed have noise, which is that of the record.
"""

from __future__ import annotations

import re
import zlib
from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property
from pathlib import Path

import numpy as np
import xarray as xr

import aerodb
from flightmech.aircraft.aircraft import Aircraft
from flightmech.errors import SchemaError
from flightmech.short_text import ShortText
from flightmech.simulation.compiler import SimModel
from flightmech.simulation.node_values import table_values, with_table_values
from flighttest.reconstruction.dynamics.coefficient_errors import ERRORS
from flighttest.reconstruction.dynamics.error_sizes import complete_errors
from flighttest.reconstruction.dynamics.kinematics import body_to_ned_rotation
from flighttest.records.sensors.instruments import pick_up_errors
from pom.archive.origins import file_sha256
from pom.cases.case_file import WIND
from pom.cases.job import TRIM_GROUND, ReplayJob
from pom.cases.reference_states import ERROR
from pom.judging.beyond_the_bands import flown_model

MEDIAN = 1.4826  # standard deviation over median of the absolute value of a normal distribution
_THRUST = re.compile(r"^engine(\d+)\.thrust_drive$")
INERTIA = ("mass.Ixx", "mass.Iyy", "mass.Izz", "mass.Ixy", "mass.Ixz", "mass.Iyz")
# Parameters with a relative error, by name of the error.
_RELATIVE = {"mass": ("mass.mass",), "inertia": INERTIA}
_AIR = ("V", "alpha", "beta", "phi", "theta", "psi")
# States that a start on the wheels computes. The errors do not change them there: the speed is that
# over the ground.
_FOUND_ON_GROUND = ("V", "alpha", "beta", "gamma", "phi", "theta", "p", "q", "r", "h")
_PART = 1e-3  # step of a difference, in standard errors


def standard_normal(error: str, count: int, seed: int) -> np.ndarray:
    """Return the draws (count,) of an error. They depend on its name, not on the case."""
    return np.random.default_rng([seed, zlib.crc32(error.encode())]).standard_normal(count)


def white_noise_sigma(y: np.ndarray) -> float:
    """Return the standard deviation of the white noise of a channel (time,).

    It is estimated from the third differences, by the median of their size. A motion at 1 Hz with
    50 samples per second has third differences of 0.2 % of its amplitude. White noise has third
    differences of 4.5 of its standard deviations.
    """
    steps = np.diff(y, 3)
    if not np.isfinite(steps).all() or not steps.size:
        return 0.0
    # The third difference of white noise has 1 + 9 + 9 + 1 times its variance.
    return float(np.median(np.abs(steps)) * MEDIAN / np.sqrt(20.0))


@dataclass(frozen=True)
class InstrumentErrors(ShortText):
    """Changes by one standard error of each independent error: truth minus record.

    Attributes
    ----------
    constants : list of str
        The errors that the reconstruction leaves.
    flight : dict of str to array (constant, time)
        By channel: change of the reconstructed flight. [SI]
    inputs : dict of str to dict of str to array (time,)
        By error, by input. [SI]
    parameters : dict of str to dict of str to float
        By error, by parameter. [SI]
    noise : dict of str to float
        Standard deviation of the white noise of the channels of the flight that have any. [SI]
    """

    constants: Sequence[str]
    flight: Mapping[str, np.ndarray]
    inputs: Mapping[str, Mapping[str, np.ndarray]]
    parameters: Mapping[str, Mapping[str, float]]
    noise: Mapping[str, float] = field(default_factory=dict)

    @classmethod
    def of(
        cls,
        job: ReplayJob,
        states: xr.Dataset,
        aircraft: Aircraft | None,
        errors: Mapping[str, float] | None = None,
        compared: Collection[str] | None = None,
    ) -> InstrumentErrors:
        """Return the errors of a case.

        Parameters
        ----------
        job : Job
        states : Dataset (time,)
            Of the flight over the window. The states of a reconstruction contain the errors of its
            constants.
        aircraft : Aircraft or None
            Its instruments have the errors of the pick-ups. Without it the pick-ups are exact.
        errors : mapping, optional
            Relative standard errors of ``mass``, ``inertia`` and ``thrust`` other than the defaults
            of `flighttest.coefficients`.
        compared : collection of str, optional
            Channels with noise. Default: all.
        """
        constants: list[str] = []
        if "error" in states.coords:
            constants = [str(name) for name in states["error"].values]
        flight = {}
        for variable in map(str, states.data_vars):
            name = variable.removeprefix(ERROR)
            if variable.startswith(ERROR) and name in states:
                flight[name] = states[variable].values.astype(float)
        # Standard errors of the sources that no channel shows.
        sizes = complete_errors(ERRORS, errors)
        inputs: dict[str, dict[str, np.ndarray]] = {}
        if WIND[0] in job.inputs:
            inputs |= _wind_changes(constants, flight, states)
        if aircraft is not None:
            inputs |= _pick_up_changes(job, aircraft)
        inputs |= _thrust_changes(job, sizes["thrust"])
        parameters = {**_start_changes(job, constants, flight), **_relative_changes(job, sizes)}
        return cls(constants, flight, inputs, parameters, noise=_channel_noise(states, compared))

    @cached_property
    def names(self) -> list[str]:
        """Names of the errors."""
        return sorted({*self.constants, *self.inputs, *self.parameters})

    def draws(self, count: int, seed: int) -> np.ndarray:
        """Return standard normal numbers (count, error).

        An error of one name has the same numbers in every case.
        """
        columns = [standard_normal(name, count, seed) for name in self.names]
        if not columns:
            return np.zeros((count, 0))
        return np.stack(columns, axis=1)

    @cached_property
    def _shifts(self) -> dict[str, tuple[list[int], np.ndarray]]:
        """By input: numbers of its errors, and changes by one standard error (error, time). [SI]"""
        changes: dict[str, dict[int, np.ndarray]] = {}
        for k, error in enumerate(self.names):
            for name, change in self.inputs.get(error, {}).items():
                changes.setdefault(name, {})[k] = change
        shifts = {}
        for name, by_error in changes.items():
            shifts[name] = (list(by_error), np.stack(list(by_error.values())))
        return shifts

    def job(self, job: ReplayJob, draw: np.ndarray) -> ReplayJob:
        """Return the drive of an aeroplane from its record `job` and one draw (error,)."""
        inputs = dict(job.inputs)
        for name, (errors, shifts) in self._shifts.items():
            if name in job.inputs:
                inputs[name] = job.inputs[name] + draw[errors] @ shifts
        # A parameter can have several errors, for example a start by all constants.
        parameters = dict(job.parameters)
        for name, size in zip(self.names, draw, strict=True):
            for key, step in self.parameters.get(name, {}).items():
                parameters[key] += size * step
        return replace(job, inputs=inputs, parameters=parameters)

    def recorded(
        self, motion: Mapping[str, np.ndarray], draw: np.ndarray, random: np.random.Generator
    ) -> dict[str, np.ndarray]:
        """Return the record of a motion (time,) with one draw (error,) of the errors, and noise.

        A draw of an error is truth minus reading, so it is subtracted from the motion.
        """
        # Errors of the reconstruction, then of the pick-ups and of the thrust, then noise.
        record = dict(motion)
        constants = draw[[self.names.index(name) for name in self.constants]]
        for name, change in self.flight.items():
            if name in record:
                record[name] = record[name] - constants @ change
        for name, (errors, shifts) in self._shifts.items():
            # The input that drives an engine has another name than its channel.
            channel = name.removesuffix("_drive")
            if channel in record:
                record[channel] = record[channel] - draw[errors] @ shifts
        for name, sigma in self.noise.items():
            if name in motion:
                noise = sigma * random.standard_normal(motion[name].size)
                record[name] = record[name] + noise
        return record


def _start_changes(
    job: ReplayJob, constants: Sequence[str], flight: Mapping[str, np.ndarray]
) -> dict[str, dict[str, float]]:
    """Return the changes of the initial state by the constants. [SI]"""
    starts = [name for name in flight if f"init.{name}" in job.parameters]
    if job.parameters.get("mode.trim") == TRIM_GROUND:
        starts = [name for name in starts if name not in _FOUND_ON_GROUND]
    changes = {}
    for k, error in enumerate(constants):
        changes[error] = {f"init.{name}": float(flight[name][k, 0]) for name in starts}
    return changes


def _relative_changes(job: ReplayJob, sizes: Mapping[str, float]) -> dict[str, dict[str, float]]:
    """Return the changes of mass and inertia by their relative errors. [SI]"""
    changes: dict[str, dict[str, float]] = {}
    for error, names in _RELATIVE.items():
        for name in names:
            if name in job.parameters:
                changes.setdefault(error, {})[name] = sizes[error] * job.parameters[name]
    return changes


def _pick_up_changes(job: ReplayJob, aircraft: Aircraft) -> dict[str, dict[str, np.ndarray]]:
    """Return the changes of the controls by bias and scale error of their pick-ups. [SI]"""
    changes = {}
    for name, (bias, scale) in pick_up_errors(aircraft.instruments).items():
        if name in job.inputs:
            changes[f"bias.{name}"] = {name: np.full(job.time.size, bias)}
            changes[f"scale.{name}"] = {name: scale * job.inputs[name]}
    return changes


def _thrust_changes(job: ReplayJob, size: float) -> dict[str, dict[str, np.ndarray]]:
    """Return the changes of the thrusts by their relative errors `size`, one per engine. [N]"""
    changes = {}
    for name, values in job.inputs.items():
        match = _THRUST.match(name)
        if match:
            changes[f"thrust{match.group(1)}"] = {name: size * values}
    return changes


def _channel_noise(states: xr.Dataset, compared: Collection[str] | None) -> dict[str, float]:
    """Return the standard deviations of the noise of the compared channels, if not zero. [SI]"""
    noise = {}
    for name in map(str, states.data_vars):
        if states[name].dims != ("time",) or (compared and name not in compared):
            continue
        sigma = white_noise_sigma(states[name].values)
        if sigma:
            noise[name] = sigma
    return noise


def _wind_changes(
    constants: Sequence[str], flight: Mapping[str, np.ndarray], states: xr.Dataset
) -> dict[str, dict[str, np.ndarray]]:
    """Return the changes of the wind (time,) by the constants. [m s-1]

    The velocity over the ground is measured independently, and the constants hardly change it.
    Their change of the velocity through the air is therefore a change of the wind.
    """
    if not set(_AIR) <= set(flight):
        return {}
    nominal = _air_velocity(*(states[name].values for name in _AIR))
    changes = {}
    for k, error in enumerate(constants):
        shifted = [states[name].values + _PART * flight[name][k] for name in _AIR]
        # Wind = velocity over the ground - velocity through the air.
        difference = (nominal - _air_velocity(*shifted)).T / _PART
        changes[error] = dict(zip(WIND, difference, strict=True))
    return changes


def _air_velocity(
    V: np.ndarray,
    alpha: np.ndarray,
    beta: np.ndarray,
    phi: np.ndarray,
    theta: np.ndarray,
    psi: np.ndarray,
) -> np.ndarray:
    """Return the velocity through the air in north-east-down axes, (time, 3). [m s-1]"""
    direction = np.stack(
        [np.cos(alpha) * np.cos(beta), np.sin(beta), np.sin(alpha) * np.cos(beta)], axis=1
    )
    U = V[:, None] * direction
    rotation = body_to_ned_rotation(np.stack([phi, theta, psi], axis=1))
    return (rotation @ U[:, :, None])[:, :, 0]


@dataclass(frozen=True)
class DrawnModels(ShortText):
    """Models whose tables are drawn from the posterior of a database.

    Attributes
    ----------
    model : SimModel
        The model inside the FMU.
    database : DataTree
        Terms with standard errors.
    nodes : dict of str to array (draw, *axes)
        Drawn values by term.
    seed : int
    source : str
        Name of the database in the results.
    """

    model: SimModel
    database: xr.DataTree
    nodes: dict[str, np.ndarray]
    seed: int
    source: str

    @classmethod
    def of(
        cls, fmu: str | Path, database: str | Path | xr.DataTree, count: int, seed: int = 0
    ) -> DrawnModels:
        """Return draws for a model.

        Parameters
        ----------
        fmu : path
            Of this program; its tables are replaced by drawn ones.
        database : path or DataTree
            The database from which the FMU was made, with standard errors.
        count : int
            Number of draws.
        seed : int

        Raises
        ------
        SchemaError
            An FMU of another program, a database without standard errors, or a database with other
            values than those of the FMU.
        """
        model = flown_model(fmu)
        if model is None:
            text = "the FMU holds no tables of this program; samples need a model of `aeromatch`"
            raise SchemaError(str(fmu), [text])
        if isinstance(database, xr.DataTree):
            db = database
            source = str(db.attrs.get("title", ""))
        else:
            db = aerodb.open(database)
            source = f"{Path(database).name}, sha256 {file_sha256(Path(database))}"
        # An error that several terms share has one draw for all of them.
        common = {}
        for name in aerodb.update.common_errors(db):
            common[name] = standard_normal(name, count, seed)
        nodes = aerodb.update.draw(db, count, seed, common=common)
        if not nodes:
            text = (
                "no term has standard errors, there is nothing to draw; give the "
                "identified database"
            )
            raise SchemaError(source, [text])
        _demand_equal_values(model, db, nodes, source=source, fmu=fmu)
        return cls(model, db, nodes, seed, source)

    @property
    def count(self) -> int:
        """Number of draws."""
        return len(next(iter(self.nodes.values())))

    @cached_property
    def models(self) -> list[SimModel]:
        """One model per draw."""
        models = []
        for k in range(self.count):
            tables = {name: values[k] for name, values in self.nodes.items()}
            models.append(with_table_values(self.model, tables))
        return models


def _demand_equal_values(
    model: SimModel,
    db: xr.DataTree,
    names: Collection[str],
    *,
    source: str,
    fmu: str | Path,
) -> None:
    """Raise if terms of a database have other values than the tables of the model in an FMU."""
    leaves = aerodb.terms(db)
    tables = table_values(model, {name: leaves[name]["value"].shape for name in names})
    different = []
    for name in names:
        if not np.array_equal(tables[name], leaves[name]["value"].values):
            different.append(name)
    if different:
        text = (
            f"{source}: {len(different)} terms have other values than in {fmu} "
            f"({', '.join(different[:3])}); give the database of this FMU"
        )
        raise SchemaError("database of a model", [text])
