"""Errors of the instruments that a replay inherits: where it starts, what drives it, and what it is compared with.

The constants of a reconstruction leave common errors in its states (`flighttest.reconstruction.state_errors`); pick-ups of controls have a
bias and a scale, mass and thrust a relative error, as `flighttest.coefficients` takes them.  All are linear, so that a draw of a replay is
the replay with a sum of shifts.  Constants of one name are one error in all records of a programme.
"""

from __future__ import annotations

import re
import zlib
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np
import xarray as xr

from flightmech import Aircraft
from flighttest.dynamics.force_coefficients import ERRORS
from flighttest.sensors.instruments import pick_up_errors

from ..cases.job import Job
from ..replaying.reference_states import ERROR

_THRUST = re.compile(r"^engine(\d+)\.thrust_drive$")


@dataclass(frozen=True)
class Instruments:
    """What one standard error of each independent error changes in a replay.

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
    """

    constants: Sequence[str]
    flight: Mapping[str, np.ndarray]
    inputs: Mapping[str, Mapping[str, np.ndarray]]
    parameters: Mapping[str, Mapping[str, float]]

    @classmethod
    def of(cls, job: Job, states: xr.Dataset, aircraft: Aircraft | None, errors: Mapping[str, float] | None = None) -> Instruments:
        """Return the errors of a case.

        Parameters
        ----------
        job : Job
        states : Dataset (time,)
            Of the flight over the window; the errors of its constants are among them where the record was reconstructed.
        aircraft : Aircraft or None
            Its instruments have the errors of the pick-ups; without it these are taken as exact.
        errors : mapping, optional
            Relative standard errors of ``mass`` and ``thrust`` other than the defaults of `flighttest.coefficients`.
        """
        constants = [str(name) for name in states["error"].values] if "error" in states.coords else []
        moved = [str(name).removeprefix(ERROR) for name in states.data_vars if str(name).startswith(ERROR)]
        flight = {name: states[ERROR + name].values.astype(float) for name in moved if name in states}
        starts = [name for name in flight if f"init.{name}" in job.parameters]
        parameters = {error: {f"init.{name}": float(flight[name][k, 0]) for name in starts} for k, error in enumerate(constants)}
        sizes = {**ERRORS, **(errors or {})}
        inputs = {}
        for name, (bias, scale) in pick_up_errors(aircraft.instruments).items() if aircraft else ():
            if name in job.inputs:
                inputs[f"bias.{name}"] = {name: np.full(job.time.size, bias)}
                inputs[f"scale.{name}"] = {name: scale * job.inputs[name]}
        for name, values in job.inputs.items():
            if match := _THRUST.match(name):
                inputs[f"thrust{match.group(1)}"] = {name: sizes["thrust"] * values}
        if "mass.mass" in job.parameters:
            parameters["mass"] = {"mass.mass": sizes["mass"] * job.parameters["mass.mass"]}
        return cls(constants, flight, inputs, parameters)

    @property
    def names(self) -> list[str]:
        """Names of the errors."""
        return sorted({*self.constants, *self.inputs, *self.parameters})

    def draws(self, count: int, seed: int) -> np.ndarray:
        """Return standard normal numbers (count, error); an error of one name has the same ones in every case."""
        columns = [np.random.default_rng([seed, zlib.crc32(name.encode())]).standard_normal(count) for name in self.names]
        return np.stack(columns, axis=1) if columns else np.zeros((count, 0))

    def job(self, job: Job, draw: np.ndarray) -> Job:
        """Return a job as one draw (error,) of the errors gives it."""
        inputs, parameters = dict(job.inputs), dict(job.parameters)
        for name, size in zip(self.names, draw, strict=True):
            for key, shift in self.inputs.get(name, {}).items():
                inputs[key] = inputs[key] + size * shift
            for key, step in self.parameters.get(name, {}).items():
                parameters[key] += size * step
        return replace(job, inputs=inputs, parameters=parameters)

    def recorded(self, flight: Mapping[str, np.ndarray], draw: np.ndarray) -> dict[str, np.ndarray]:
        """Return the channels of the flight (time,) as one draw (error,) of the errors gives them."""
        sizes = draw[[self.names.index(name) for name in self.constants]]
        return {**flight, **{name: flight[name] + sizes @ change for name, change in self.flight.items() if name in flight}}
