"""Errors of the instruments: between what a record states of start, drive and motion and what an
aeroplane did.

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
from flightmech.simulation.compiler import SimModel
from flightmech.simulation.node_values import table_values, with_table_values
from flighttest.reconstruction.dynamics.coefficient_errors import ERRORS
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
_AIR = ("V", "alpha", "beta", "phi", "theta", "psi")
_FOUND_ON_GROUND = ("V", "alpha", "beta", "gamma", "phi", "theta", "p", "q", "r", "h")
"""What a start on the wheels does not take from the states that the constants move: the speed is that over the ground."""
_PART = 1e-3  # of an error, over which a difference is taken


def standard_normal(error: str, count: int, seed: int) -> np.ndarray:
    """Return the draws (count,) of an error: the same for its name wherever it acts."""
    return np.random.default_rng([seed, zlib.crc32(error.encode())]).standard_normal(count)


def white_noise_sigma(y: np.ndarray) -> float:
    """Return the standard deviation of the white noise of a channel (time,): of its third
    differences, by their median.

    A motion at 1 Hz in 50 samples per second has third differences of 0.2 % of its amplitude, noise
    of 4.5 of its standard deviations.
    """
    steps = np.diff(y, 3)
    return (
        float(np.median(np.abs(steps)) * MEDIAN / np.sqrt(20.0))
        if np.isfinite(steps).all() and steps.size
        else 0.0
    )


@dataclass(frozen=True)
class InstrumentErrors:
    """What one standard error of each independent error changes: truth less record.

    Attributes
    ----------
    constants : list of str
        The errors that the reconstruction leaves.
    flight : dict of str to array (constant, time)
        By channel: what they change in the reconstructed flight. [SI]
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
            Of the flight over the window; the errors of its constants are among them where the
            record was reconstructed.
        aircraft : Aircraft or None
            Its instruments have the errors of the pick-ups; without it these are taken as exact.
        errors : mapping, optional
            Relative standard errors of ``mass``, ``inertia`` and ``thrust`` other than the defaults
            of `flighttest.coefficients`.
        compared : collection of str, optional
            Channels whose noise counts; all without it.
        """
        constants = (
            [str(name) for name in states["error"].values] if "error" in states.coords else []
        )
        moved = [
            str(name).removeprefix(ERROR)
            for name in states.data_vars
            if str(name).startswith(ERROR)
        ]
        flight = {
            name: states[ERROR + name].values.astype(float) for name in moved if name in states
        }
        starts = [name for name in flight if f"init.{name}" in job.parameters]
        if job.parameters.get("mode.trim") == TRIM_GROUND:
            starts = [name for name in starts if name not in _FOUND_ON_GROUND]
        parameters = {
            error: {f"init.{name}": float(flight[name][k, 0]) for name in starts}
            for k, error in enumerate(constants)
        }
        sizes = {**ERRORS, **(errors or {})}
        inputs = _wind(constants, flight, states) if WIND[0] in job.inputs else {}
        for name, (bias, scale) in pick_up_errors(aircraft.instruments).items() if aircraft else ():
            if name in job.inputs:
                inputs[f"bias.{name}"] = {name: np.full(job.time.size, bias)}
                inputs[f"scale.{name}"] = {name: scale * job.inputs[name]}
        for name, values in job.inputs.items():
            if match := _THRUST.match(name):
                inputs[f"thrust{match.group(1)}"] = {name: sizes["thrust"] * values}
        for error, names in {"mass": ("mass.mass",), "inertia": INERTIA}.items():
            if found := {
                name: sizes[error] * job.parameters[name]
                for name in names
                if name in job.parameters
            }:
                parameters[error] = found
        channels = [
            str(name)
            for name, item in states.data_vars.items()
            if item.dims == ("time",) and (not compared or name in compared)
        ]
        noise = {
            name: size for name in channels if (size := white_noise_sigma(states[name].values))
        }
        return cls(constants, flight, inputs, parameters, noise)

    @cached_property
    def names(self) -> list[str]:
        """Names of the errors."""
        return sorted({*self.constants, *self.inputs, *self.parameters})

    def draws(self, count: int, seed: int) -> np.ndarray:
        """Return standard normal numbers (count, error); an error of one name has the same ones in
        every case.
        """
        columns = [standard_normal(name, count, seed) for name in self.names]
        return np.stack(columns, axis=1) if columns else np.zeros((count, 0))

    @cached_property
    def _shifts(self) -> dict[str, tuple[list[int], np.ndarray]]:
        """By input: the errors that move it, and what one standard error of each changes (error,
        time). [SI]
        """
        moved: dict[str, dict[int, np.ndarray]] = {}
        for k, error in enumerate(self.names):
            for name, shift in self.inputs.get(error, {}).items():
                moved.setdefault(name, {})[k] = shift
        return {
            name: (list(shifts), np.stack(list(shifts.values()))) for name, shifts in moved.items()
        }

    def job(self, job: ReplayJob, draw: np.ndarray) -> ReplayJob:
        """Return the drive of an aeroplane whose record is `job`, with one draw (error,) of the
        errors.
        """
        shifted = {
            name: job.inputs[name] + draw[errors] @ shifts
            for name, (errors, shifts) in self._shifts.items()
            if name in job.inputs
        }
        parameters = dict(job.parameters)
        for name, size in zip(self.names, draw, strict=True):
            for key, step in self.parameters.get(name, {}).items():
                parameters[key] += size * step
        return replace(job, inputs={**job.inputs, **shifted}, parameters=parameters)

    def recorded(
        self, motion: Mapping[str, np.ndarray], draw: np.ndarray, random: np.random.Generator
    ) -> dict[str, np.ndarray]:
        """Return a motion (time,) as the instruments with one draw (error,) of their errors, and
        with noise, record it.

        A draw of an error is what the truth has beyond the reading, so that the reading has its
        negative beyond the truth.
        """
        found = dict(motion)
        constants = draw[[self.names.index(name) for name in self.constants]]
        for name, change in self.flight.items():
            if name in found:
                found[name] = found[name] - constants @ change
        for name, (errors, shifts) in self._shifts.items():
            channel = name.replace("thrust_drive", "thrust")
            if channel in found:
                found[channel] = found[channel] - draw[errors] @ shifts
        noise = {
            name: size * random.standard_normal(motion[name].size)
            for name, size in self.noise.items()
            if name in motion
        }
        return {**found, **{name: found[name] + values for name, values in noise.items()}}


def _wind(
    constants: Sequence[str], flight: Mapping[str, np.ndarray], states: xr.Dataset
) -> dict[str, dict[str, np.ndarray]]:
    """Return what the error of each constant changes in the wind (time,). [m s-1]

    The velocity over the ground is measured by itself and the error of a constant hardly moves it:
    what it moves in the velocity through the air is wind.
    """
    if not set(_AIR) <= set(flight):
        return {}
    still = _air_velocity(*(states[name].values for name in _AIR))
    found = {}
    for k, error in enumerate(constants):
        moved = _air_velocity(*(states[name].values + _PART * flight[name][k] for name in _AIR))
        found[error] = dict(zip(WIND, (still - moved).T / _PART, strict=True))
    return found


def _air_velocity(
    V: np.ndarray,
    alpha: np.ndarray,
    beta: np.ndarray,
    phi: np.ndarray,
    theta: np.ndarray,
    psi: np.ndarray,
) -> np.ndarray:
    """Return the velocity through the air in north-east-down axes, (time, 3). [m s-1]"""
    U = V[:, None] * np.stack(
        [np.cos(alpha) * np.cos(beta), np.sin(beta), np.sin(alpha) * np.cos(beta)], axis=1
    )
    return (body_to_ned_rotation(np.stack([phi, theta, psi], axis=1)) @ U[:, :, None])[:, :, 0]


@dataclass(frozen=True)
class DrawnModels:
    """Models whose tables are drawn from the posterior of a database.

    Attributes
    ----------
    model : SimModel
        The model itself, as the FMU holds it.
    database : DataTree
        Terms with standard errors.
    nodes : dict of str to array (draw, *axes)
        Drawn values by term.
    seed : int
    source : str
        What the database is called in the results.
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
            Of this program; its tables are exchanged.
        database : path or DataTree
            The database from which the FMU was made, with standard errors.
        count : int
            Number of draws.
        seed : int

        Raises
        ------
        SchemaError
            An FMU of another program, a database without standard errors, or one whose values the
            FMU does not hold.
        """
        model = flown_model(fmu)
        if model is None:
            raise SchemaError(
                str(fmu),
                ["the FMU holds no tables of this program; samples need a model of `aeromatch`"],
            )
        db = database if isinstance(database, xr.DataTree) else aerodb.open(database)
        called = (
            str(db.attrs.get("title", ""))
            if isinstance(database, xr.DataTree)
            else _called(Path(database))
        )
        common = {
            name: standard_normal(name, count, seed) for name in aerodb.update.common_errors(db)
        }
        nodes = aerodb.update.draw(db, count, seed, common=common)
        if not nodes:
            raise SchemaError(
                called,
                [
                    "no term has standard errors, there is nothing to draw; give the "
                    "identified database"
                ],
            )
        leaves = aerodb.terms(db)
        held = table_values(model, {name: leaves[name]["value"].shape for name in nodes})
        other = [
            name for name in nodes if not np.array_equal(held[name], leaves[name]["value"].values)
        ]
        if other:
            text = (
                f"{called}: {len(other)} terms have other values than in {fmu} "
                f"({', '.join(other[:3])}); give the database of this FMU"
            )
            raise SchemaError("database of a model", [text])
        return cls(model, db, nodes, seed, called)

    @property
    def count(self) -> int:
        """Number of draws."""
        return len(next(iter(self.nodes.values())))

    @cached_property
    def models(self) -> list[SimModel]:
        """One model per draw."""
        return [
            with_table_values(self.model, {name: values[k] for name, values in self.nodes.items()})
            for k in range(self.count)
        ]


def _called(file: Path) -> str:
    return f"{file.name}, sha256 {file_sha256(file)}"
