"""Explicit identification: struts, tyres, brakes and rolling friction from reconstructed wheel
loads (type 2 of LR-743, Table 1).

    N  = K s + K2 s^2 + c s' + o s' |s'|                                                 c by the direction of s'
    Fx = - (rolling N + (brake + brake_friction N) pedal)                                in the axes of the wheel
    Fy = - mu N (1 - (1 - t)^3) sgn(slip),   t = C |tan slip| / (3 mu N)                 the kernel's brush model
    C  = g N / (1 + b (N / 10 kN)^2)                      C_max = g N_max / 2 at N_max = 10 kN / sqrt(b) of the aircraft file

The side force is weighed by the speed: what limits it is the error of the lateral velocity, C dv /
V.  The balances of all runs are one fit: loads, force along and across, yawing moment.  What the
inputs may be wrong by, aerodynamics near the ground, thrust, and the wind of every run, is
estimated along with a standard error of its own before the flights.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from typing import NamedTuple

import numpy as np
import xarray as xr

from flightmech.aircraft.aircraft import Aircraft
from flighttest.maximum_likelihood.residual_covariance import coloured_likelihood_covariance
from flighttest.maximum_likelihood.result import OutputError, estimates_dataset, noise_dataset
from flighttest.maximum_likelihood.search import Likelihood, maximise_likelihood
from flighttest.maximum_likelihood.unknowns import Unknown, lay_out
from flighttest.submodels.landing_gear.reconstructed_loads import (
    WheelGroup,
    wheel_groups,
    wheels_of,
)

MOVING = 1.5  # speed above which tyres roll in the sense of the equations [m s-1]
LEG = (
    "stiffness",
    "stiffness_square",
    "damping",
    "orifice",
    "damping_outwards",
)  # the last: damping_ext less damping
TYRE = ("brake", "brake_friction", "cornering", "bend")
ROLLING, FRICTION = "rolling", "runway.mu_dry"  # of all wheels
LOAD = 1e4  # unit of the load in the cornering stiffness [N]
FAST = 10.0  # speed at which the side force has weight 1 [m s-1]
_SAMPLES = 3.0  # samples per period of the low-pass that are used
_ITERATIONS = 40
_ROUNDS = 6  # of the share of brake and side force in the friction


def brush_side_force(load, tangent, C, mu, brake) -> np.ndarray:
    """Return the side force of a rolling tyre to the left, for a wheel that moves to its right.

    Parameters
    ----------
    load, tangent, C, mu, brake : array
        Load [N], tangent of the slip angle, cornering stiffness [N rad-1], friction, braking force
        at the ground [N].

    Notes
    -----
    Brush of parabolic pressure, [Pacejka] sec. 3.2, with the friction shared as in ``kernel/src/gear/tyre.c``.

    References
    ----------
    .. [Pacejka] Pacejka, Tyre and Vehicle Dynamics, 3rd ed., 2012.
    """
    most = np.maximum(mu * load, 1e-9)
    side = np.minimum(C * np.abs(tangent) / (3.0 * most), 1e6)
    part = side
    for _ in range(_ROUNDS):
        along = np.minimum(brake / (most * _chord(part)), 1.0)
        part = np.hypot(along, side)
    return most * _chord(part) * side * np.sign(tangent)


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
    known : dict of str to float
        Values of the constants that are not estimated.
    """

    def __init__(self, loads: xr.Dataset, aircraft: Aircraft, cutoff: float):
        step = float(loads.attrs["step"])
        stride = max(1, math.floor(1.0 / (_SAMPLES * cutoff * step)))
        self.data = loads.isel(time=slice(None, None, stride))
        self.interval = stride * step
        self.wheels = names = [wheel.name for wheel in wheels_of(aircraft)]
        self.known: dict[str, float] = {}
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
        edge = max(1, round(0.5 / self.interval))  # where the low-pass has no samples to one side
        self.measured[:edge] = self.measured[-edge:] = np.nan
        self.weight = np.ones(self.measured.shape)
        self.weight[:, len(names) + 1] = self.fields["speed"] / FAST
        self.measured *= self.weight
        tangent = self.fields["across"] / np.maximum(np.abs(self.fields["along"]), MOVING)
        angle, own = (
            self.fields["angle"],
            {name: self.fields[name] for name in ("compression", "rate", "pedal", "x", "y")},
        )
        own |= {"tangent": tangent, "cos": np.cos(angle), "sin": np.sin(angle)}
        self.parts = []
        for group in wheel_groups(aircraft):
            members = [names.index(name) for name in group.names]
            self.parts.append(
                _Wheels(group, members, **{key: values[:, members] for key, values in own.items()})
            )

    def take(self, names: Sequence[str], number: int) -> None:
        """Learn what is estimated; ``wind_n@2`` is the wind of the second run."""
        self.names = tuple(name.removesuffix(f"@{number}") for name in names)

    def predict(self, values: np.ndarray) -> np.ndarray:
        """Return loads, forces in the plane of the runway and yawing moment (time, output)."""
        at = self.known | dict(zip(self.names, values))
        errors = self.fields["change"] @ np.array([at.get(name, 0.0) for name in self.sources])
        return self.weight * (sum(self._of_group(at, part) for part in self.parts) - errors)

    def _of_group(self, at: Mapping[str, float], part: _Wheels) -> np.ndarray:
        """Return what the wheels of one group give to the outputs (time, output)."""
        found = np.zeros(self.measured.shape)
        N = part.load(at)
        Fx, Fy = tyre_forces(at, part.group, N, part.tangent, part.pedal)
        ahead, aside = Fx * part.cos - Fy * part.sin, Fx * part.sin + Fy * part.cos
        found[:, part.members] = N
        for column, force in enumerate(
            (ahead, aside, part.x * aside - part.y * ahead), len(self.wheels)
        ):
            found[:, column] = force.sum(axis=1)
        return found

    def used_friction(self, at: Mapping[str, float]) -> float:
        """Return the largest force along the runway over the load that carried it, with the
        constants `at`.
        """
        most, values = 0.0, self.known | dict(at)
        for part in self.parts:
            N = np.maximum(leg_load(values, part.group, part.compression, part.rate), 0.0)
            forces = tyre_forces(values, part.group, N, part.tangent, part.pedal)
            rolls = np.isfinite(self.measured[:, -1]) & (N > 0.0).all(axis=1)
            most = max(most, float((np.hypot(*forces)[rolls] / N[rolls]).max(initial=0.0)))
        return most

    def slopes(self, values: np.ndarray, steps: np.ndarray, central: bool) -> np.ndarray:
        """Return the slopes (time, output, unknown).

        Those of the inputs' errors are exact, the others central differences of the wheels on which
        a constant acts.
        """
        at = self.known | dict(zip(self.names, values))
        S = np.zeros((*self.measured.shape, len(self.names)))
        for k, (name, step) in enumerate(zip(self.names, steps)):
            if name in self.sources:
                S[:, :, k] = -self.weight * self.fields["change"][:, :, self.sources.index(name)]
            for part in self.parts:
                if name in part.constants:
                    up, down = (
                        self._of_group({**at, name: at[name] + side * step}, part)
                        for side in (1.0, -1.0)
                    )
                    S[:, :, k] += self.weight * (up - down) / (2.0 * step)
        return S


class _Wheels(NamedTuple):
    """Wheels of one group as a record shows them; arrays (time, wheel)."""

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
    """Return the load of a leg from its compression and the rate of it. [N]"""
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
    """Return the constants of a gear by least squares on its balances of force and moment, all runs
    together.

    Parameters
    ----------
    runs : sequence of GroundRun
    unknowns : mapping of str to Unknown

    Returns
    -------
    OutputError
        Its standard errors are those of coloured residuals.
    """
    layout = lay_out(unknowns, [{} for _ in runs])
    for k, run in enumerate(runs):
        run.take(layout.names, k + 1)
    found = maximise_likelihood(Likelihood(runs, layout, np.arange(len(runs))), _ITERATIONS)
    covariance, colours = coloured_likelihood_covariance(
        found, layout.columns, [run.interval for run in runs]
    )
    outputs = [str(name) for name in runs[0].data["output"].values]
    estimates = estimates_dataset(
        found, layout, covariance, {"method": "reconstructed wheel loads"}
    )
    rest = tuple(
        xr.Dataset(
            {name: ("time", v[:, k]) for k, name in enumerate(outputs)},
            {"time": run.time},
            dict(run.data.attrs),
        )
        for run, v in zip(runs, found.residuals)
    )
    return OutputError(
        estimates, rest, noise_dataset(found, outputs, colours, [run.measured for run in runs])
    )
