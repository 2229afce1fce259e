"""Explicit identification of a landing gear from reconstructed wheel loads (type 2 of LR-743,
Table 1).

The constants are those of struts, tyres, brakes and rolling friction:

    N  = K s + K2 s^2 + c s' + o s' |s'|                        c by the direction of s'
    Fx = - (rolling N + (brake + brake_friction N) pedal)       in the axes of the wheel
    Fy = - mu N (1 - (1 - t)^3) sgn(slip),   t = C |tan slip| / (3 mu N)
    C  = g N / (1 + b (N / 10 kN)^2)

Fy is the brush model of the kernel.  The aircraft file has C_max = g N_max / 2 at
N_max = 10 kN / sqrt(b).

The side force is weighted by the speed, because the error of the lateral velocity limits it,
C dv / V.  One fit contains the balances of all runs: loads, force along and across, yawing moment.
The inputs may have errors: aerodynamics near the ground, thrust, and the wind of every run.  The
fit estimates these errors with a-priori standard errors.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from typing import NamedTuple

import numpy as np
import xarray as xr

from flightmech.aircraft.aircraft import Aircraft
from flighttest.maximum_likelihood.likelihood import Likelihood
from flighttest.maximum_likelihood.residual_covariance import coloured_likelihood_covariance
from flighttest.maximum_likelihood.result import OutputError, estimates_dataset, noise_dataset
from flighttest.maximum_likelihood.search import maximise_likelihood
from flighttest.maximum_likelihood.unknowns import Unknown, lay_out
from flighttest.remarks import Convergence, warn_forbidden
from flighttest.submodels.landing_gear.wheel_positions import WheelGroup, wheel_groups, wheels_of

# Speed above which the equations of a rolling tyre are valid. [m s-1]
MOVING = 1.5
# Constants of a leg. damping_outwards is damping_ext less damping.
LEG = ("stiffness", "stiffness_square", "damping", "orifice", "damping_outwards")
TYRE = ("brake", "brake_friction", "cornering", "bend")
# Constants of all wheels together.
ROLLING, FRICTION = "rolling", "runway.mu_dry"
# Unit of the load in the cornering stiffness. [N]
LOAD = 1e4
# Speed at which the side force has the weight 1. [m s-1]
FAST = 10.0
# Samples that are used per period of the low-pass filter.
_SAMPLES = 3.0
_ITERATIONS = 40
# Least and largest number of rounds of the shares of brake and side force in the friction.
_ROUNDS, _MOST_ROUNDS = 6, 5000
# Change of the sliding part at which the shares have converged. [1]
_SAME_SHARE = 1e-6


def brush_side_force(load, tangent, C, mu, brake) -> np.ndarray:
    """Return the side force of a rolling tyre to the left, for a wheel that moves to its right.

    Parameters
    ----------
    load, tangent, C, mu, brake : array
        Load [N], tangent of the slip angle, cornering stiffness [N rad-1], friction, braking force
        at the ground [N].

    Warns
    -----
    AeromatchWarning
        The shares of brake and side force do not converge.

    Notes
    -----
    Brush of parabolic pressure, [Pacejka] sec. 3.2. The friction is shared as in
    ``kernel/src/gear/tyre.c``.  The sliding part follows by fixed-point iteration, which is slow
    where brake and side force together just reach the friction.

    References
    ----------
    .. [Pacejka] Pacejka, Tyre and Vehicle Dynamics, 3rd ed., 2012.
    """
    most = np.maximum(mu * load, 1e-9)
    side = np.minimum(C * np.abs(tangent) / (3.0 * most), 1e6)
    part = _sliding_part(most, brake, side)
    return most * _chord(part) * side * np.sign(tangent)


def _sliding_part(most: np.ndarray, brake: np.ndarray, side: np.ndarray) -> np.ndarray:
    """Return the sliding part of the patch from friction, braking force and its part by slip."""

    def shared(part, most, brake, side):
        along = np.minimum(brake / (most * _chord(part)), 1.0)
        return np.hypot(along, side)

    # Brake and side force share the friction: fixed-point iteration of the sliding part.
    part = last = side
    for _ in range(_ROUNDS):
        part, last = shared(part, most, brake, side), part
    # Samples that have converged keep their value; the others iterate on.
    shape = np.shape(part)
    part, last, most, brake, side = map(
        np.ravel, np.broadcast_arrays(part, last, most, brake, side)
    )
    part, change = part.copy(), np.abs(part - last)
    moving = np.flatnonzero(change > _SAME_SHARE)
    for _ in range(_ROUNDS, _MOST_ROUNDS):
        if not len(moving):
            return part.reshape(shape)
        following = shared(part[moving], most[moving], brake[moving], side[moving])
        change = np.abs(following - part[moving])
        part[moving] = following
        moving = moving[change > _SAME_SHARE]
    convergence = Convergence(
        not len(moving), _MOST_ROUNDS, float(np.max(change, initial=0.0)) / _SAME_SHARE
    )
    advice = "the side force of braked wheels is not exact; leave such braking out"
    warn_forbidden(convergence.remarks("shares of the friction", advice), "tyre")
    return part.reshape(shape)


def _chord(part):
    """Force over mu Fz and over the part of the patch that slides."""
    return np.where(part < 1.0, 3.0 - part * (3.0 - part), 1.0 / np.maximum(part, 1.0))


class GroundRun:
    """One record as the equations of the gear predict it.

    Parameters
    ----------
    loads : Dataset
        Of `wheel_loads`.
    aircraft : Aircraft
    cutoff : float
        Low-pass of the loads. [Hz]

    Attributes
    ----------
    fixed : dict of str to float
        Values of the constants that are not estimated.
    """

    def __init__(self, loads: xr.Dataset, aircraft: Aircraft, cutoff: float):
        step = float(loads.attrs["step"])
        stride = max(1, math.floor(1.0 / (_SAMPLES * cutoff * step)))
        self.data = loads.isel(time=slice(None, None, stride))
        self.interval = stride * step
        self.wheels = names = [wheel.name for wheel in wheels_of(aircraft)]
        self.fixed: dict[str, float] = {}
        self.names: tuple[str, ...] = ()
        self.time = self.data["time"].values
        self.fields = {str(name): self.data[name].values for name in self.data.data_vars}
        self.sources = [str(name) for name in self.data["source"].values]
        rolls = (
            (self.fields["speed"] > MOVING)
            & np.isfinite(self.fields["force"]).all(axis=1)
            & (self.fields["along"] > 0.0).all(axis=1)
        )
        self.measured = self.fields["force"].copy()
        self.measured[~rolls, len(names) :] = np.nan
        # Near the ends the low-pass filter has no samples to one side.
        edge = max(1, round(0.5 / self.interval))
        self.measured[:edge] = self.measured[-edge:] = np.nan
        self.weight = np.ones(self.measured.shape)
        self.weight[:, len(names) + 1] = self.fields["speed"] / FAST
        self.measured *= self.weight
        self.parts = self._wheel_parts(aircraft)

    def _wheel_parts(self, aircraft: Aircraft) -> list[_Wheels]:
        """Return the channels of the wheels, group by group."""
        channels = {name: self.fields[name] for name in ("compression", "rate", "pedal", "x", "y")}
        angle = self.fields["angle"]
        along = np.maximum(np.abs(self.fields["along"]), MOVING)
        channels["tangent"] = self.fields["across"] / along
        channels |= {"cos": np.cos(angle), "sin": np.sin(angle)}
        parts = []
        for group in wheel_groups(aircraft):
            members = [self.wheels.index(name) for name in group.names]
            columns = {key: values[:, members] for key, values in channels.items()}
            parts.append(_Wheels(group, members, **columns))
        return parts

    def set_unknowns(self, names: Sequence[str], number: int) -> None:
        """Set the names of the unknowns; ``wind_n@2`` is the wind of the second run."""
        self.names = tuple(name.removesuffix(f"@{number}") for name in names)

    def predict(self, values: np.ndarray) -> np.ndarray:
        """Return loads, forces in the plane of the runway and yawing moment (time, output)."""
        constants = self.fixed | dict(zip(self.names, values))
        sizes = np.array([constants.get(name, 0.0) for name in self.sources])
        # Effect of the errors of the inputs on the outputs (time, output).
        errors = self.fields["change"] @ sizes
        return self.weight * (sum(self._of_group(constants, part) for part in self.parts) - errors)

    def _of_group(self, at: Mapping[str, float], part: _Wheels) -> np.ndarray:
        """Return the contribution of the wheels of one group to the outputs (time, output)."""
        outputs = np.zeros(self.measured.shape)
        N = part.load(at)
        Fx, Fy = tyre_forces(at, part.group, N=N, tangent=part.tangent, pedal=part.pedal)
        # From the axes of the wheel to those of the aircraft in the plane of the runway.
        ahead, aside = Fx * part.cos - Fy * part.sin, Fx * part.sin + Fy * part.cos
        moment = part.x * aside - part.y * ahead
        outputs[:, part.members] = N
        for column, force in enumerate((ahead, aside, moment), len(self.wheels)):
            outputs[:, column] = force.sum(axis=1)
        return outputs

    def used_friction(self, at: Mapping[str, float]) -> float:
        """Return the largest force along the runway over the load, with the constants `at`."""
        most, values = 0.0, self.fixed | dict(at)
        for part in self.parts:
            N = np.maximum(leg_load(values, part.group, part.compression, part.rate), 0.0)
            forces = tyre_forces(values, part.group, N=N, tangent=part.tangent, pedal=part.pedal)
            rolls = np.isfinite(self.measured[:, -1]) & (N > 0.0).all(axis=1)
            most = max(most, float((np.hypot(*forces)[rolls] / N[rolls]).max(initial=0.0)))
        return most

    def slopes(self, values: np.ndarray, steps: np.ndarray, central: bool) -> np.ndarray:
        """Return the slopes (time, output, unknown).

        Slopes to errors of the inputs are exact.  Slopes to a constant are central differences of
        the wheels on which it acts.
        """
        constants = self.fixed | dict(zip(self.names, values))
        S = np.zeros((*self.measured.shape, len(self.names)))
        for k, (name, step) in enumerate(zip(self.names, steps)):
            if name in self.sources:
                S[:, :, k] = -self.weight * self.fields["change"][:, :, self.sources.index(name)]
            for part in self.parts:
                if name in part.constants:
                    up = self._of_group({**constants, name: constants[name] + step}, part)
                    down = self._of_group({**constants, name: constants[name] - step}, part)
                    S[:, :, k] += self.weight * (up - down) / (2.0 * step)
        return S


class _Wheels(NamedTuple):
    """Channels of the wheels of one group; arrays (time, wheel)."""

    group: WheelGroup
    members: list[int]
    compression: np.ndarray
    rate: np.ndarray
    pedal: np.ndarray
    x: np.ndarray
    y: np.ndarray
    tangent: np.ndarray  # of the slip angle
    cos: np.ndarray  # of the angle of the wheel
    sin: np.ndarray

    @property
    def constants(self) -> set[str]:
        """Names of the constants that act on the wheels."""
        return {FRICTION, ROLLING, *(self.group.parameter(name) for name in (*LEG, *TYRE))}

    def load(self, at: Mapping[str, float]) -> np.ndarray:
        """Return the loads of the legs. [N]"""
        return np.where(
            self.compression > 0.0,
            np.maximum(leg_load(at, self.group, self.compression, self.rate), 0.0),
            0.0,
        )


def leg_load(
    at: Mapping[str, float], group: WheelGroup, s: np.ndarray, rate: np.ndarray
) -> np.ndarray:
    """Return the load of a leg from its compression and the rate of compression. [N]"""
    stiffness, square, damping, orifice, out = (at.get(group.parameter(name), 0.0) for name in LEG)
    return (stiffness + square * s) * s + (
        damping + orifice * np.abs(rate) + np.where(rate < 0.0, out, 0.0)
    ) * rate


def tyre_forces(
    at: Mapping[str, float], group: WheelGroup, N, tangent, pedal
) -> tuple[np.ndarray, np.ndarray]:
    """Return the force of the ground forward and to the right, in the axes of the wheel. [N]"""
    brake, share, cornering, bend = (at.get(group.parameter(name), 0.0) for name in TYRE)
    braking = at[ROLLING] * N + pedal * (brake + share * N)
    return -braking, -brush_side_force(
        N, tangent, cornering * N / (1.0 + bend * (N / LOAD) ** 2), at[FRICTION], braking
    )


def explicit_fit(runs: Sequence[GroundRun], unknowns: Mapping[str, Unknown]) -> OutputError:
    """Return the constants of a gear by least squares on the balances of all runs together.

    The balances are those of force and moment.

    Parameters
    ----------
    runs : sequence of GroundRun
        Records with their wheel loads.
    unknowns : mapping of str to Unknown
        Constants and errors of the inputs, with first value and a-priori standard error.

    Returns
    -------
    OutputError
        Estimates with the standard errors of coloured residuals.
    """
    layout = lay_out(unknowns, [{} for _ in runs])
    for k, run in enumerate(runs):
        run.set_unknowns(layout.names, k + 1)
    maximum = maximise_likelihood(Likelihood(runs, layout, np.arange(len(runs))), _ITERATIONS)
    covariance, colours = coloured_likelihood_covariance(
        maximum, layout.columns, [run.interval for run in runs]
    )
    outputs = [str(name) for name in runs[0].data["output"].values]
    estimates = estimates_dataset(
        maximum, layout, covariance, {"method": "reconstructed wheel loads"}
    )
    residuals = []
    for run, v in zip(runs, maximum.residuals):
        columns = {name: ("time", v[:, k]) for k, name in enumerate(outputs)}
        residuals.append(xr.Dataset(columns, {"time": run.time}, dict(run.data.attrs)))
    noise = noise_dataset(maximum, outputs, colours, [run.measured for run in runs])
    return OutputError(estimates, tuple(residuals), noise)
