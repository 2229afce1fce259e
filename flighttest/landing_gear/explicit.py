"""Explicit identification: struts, tyres, brakes and rolling friction from reconstructed wheel loads (type 2 of LR-743, Table 1).

    N  = K s + K2 s^2 + c s' + o s' |s'|                                                 c by the direction of s'
    Fx = - (rolling N + (brake + brake_friction N) pedal)                                in the axes of the wheel
    Fy = - mu N (1 - (1 - t)^3) sgn(slip),   t = C |tan slip| / (3 mu N)                 the kernel's brush, docs/landing-gear.md
    C  = g N / (1 + b (N / 10 kN)^2)                      C_max = g N_max / 2 at N_max = 10 kN / sqrt(b) of the aircraft file

The side force is weighed by the speed: what limits it is the error of the lateral velocity, C dv / V.  The balances of all runs are
one fit: loads, force along and across, yawing moment.  What the inputs may be wrong by, aerodynamics near the ground, thrust, and
the wind of every run, is estimated along with a standard error of its own before the flights.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence

import numpy as np
import xarray as xr

from flightmech import Aircraft

from ..maximum_likelihood.likelihood_search import Likelihood, search
from ..maximum_likelihood.parameters import Unknown, lay_out
from ..maximum_likelihood.residual_covariance import coloured_covariance
from ..maximum_likelihood.result import OutputError, noise_of, tabulated
from .wheels import WheelGroup, wheel_groups, wheels_of

MOVING = 1.5  # speed above which tyres roll in the sense of the equations [m s-1]
LEG = ("stiffness", "stiffness_square", "damping", "orifice", "damping_outwards")  # the last: damping_ext less damping
TYRE = ("brake", "brake_friction", "cornering", "bend")
ROLLING, FRICTION = "rolling", "runway.mu_dry"  # of all wheels
LOAD = 1e4  # unit of the load in the cornering stiffness [N]
FAST = 10.0  # speed at which the side force has weight 1 [m s-1]
_SAMPLES = 3.0  # samples per period of the low-pass that are used
_ITERATIONS = 40
_ROUNDS = 6  # of the share of brake and side force in the friction


def brush(load, tangent, C, mu, brake) -> np.ndarray:
    """Return the side force of a rolling tyre to the left, for a wheel that moves to its right.

    Parameters
    ----------
    load, tangent, C, mu, brake : array
        Load [N], tangent of the slip angle, cornering stiffness [N rad-1], friction, braking force at the ground [N].

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
        self.groups = wheel_groups(aircraft)
        self.wheels = names = [wheel.name for wheel in wheels_of(aircraft)]
        self.members = [[names.index(name) for name in group.names] for group in self.groups]
        self.known: dict[str, float] = {}
        self.names: tuple[str, ...] = ()
        self.time = self.data["time"].values
        self.fields = {str(name): self.data[name].values for name in self.data.data_vars}
        self.sources = [str(name) for name in self.data["source"].values]
        rolls = (self.fields["speed"] > MOVING) & np.isfinite(self.fields["force"]).all(axis=1) & (self.fields["along"] > 0.0).all(axis=1)
        self.measured = self.fields["force"].copy()
        self.measured[~rolls, len(names) :] = np.nan
        edge = max(1, round(0.5 / self.interval))  # where the low-pass has no samples to one side
        self.measured[:edge] = self.measured[-edge:] = np.nan
        self.weight = np.ones(self.measured.shape)
        self.weight[:, len(names) + 1] = self.fields["speed"] / FAST
        self.measured *= self.weight
        self.tangent = self.fields["across"] / np.maximum(np.abs(self.fields["along"]), MOVING)

    def take(self, names: Sequence[str], number: int) -> None:
        """Learn what is estimated; ``wind_n@2`` is the wind of the second run."""
        self.names = tuple(name.removesuffix(f"@{number}") for name in names)

    def predict(self, values: np.ndarray) -> np.ndarray:
        """Return loads, forces in the plane of the runway and yawing moment (time, output)."""
        at = self.known | dict(zip(self.names, values))
        load = np.empty_like(self.fields["compression"])
        Fx, Fy = np.empty_like(load), np.empty_like(load)
        for group, members in zip(self.groups, self.members):
            s, rate = (self.fields[name][:, members] for name in ("compression", "rate"))
            load[:, members] = N = np.where(s > 0.0, np.maximum(leg_load(at, group, s, rate), 0.0), 0.0)
            Fx[:, members], Fy[:, members] = tyre_forces(at, group, N, self.tangent[:, members], self.fields["pedal"][:, members])
        angle = self.fields["angle"]
        ahead, aside = Fx * np.cos(angle) - Fy * np.sin(angle), Fx * np.sin(angle) + Fy * np.cos(angle)
        yaw = self.fields["x"] * aside - self.fields["y"] * ahead
        found = np.column_stack([load, ahead.sum(axis=1), aside.sum(axis=1), yaw.sum(axis=1)])
        return self.weight * (found - self.fields["change"] @ np.array([at.get(name, 0.0) for name in self.sources]))

    def used_friction(self, at: Mapping[str, float]) -> float:
        """Return the largest force along the runway over the load that carried it, with the constants `at`."""
        most = 0.0
        for group, members in zip(self.groups, self.members):
            s, rate = (self.fields[name][:, members] for name in ("compression", "rate"))
            N = np.maximum(leg_load(self.known | dict(at), group, s, rate), 0.0)
            forces = tyre_forces(self.known | dict(at), group, N, self.tangent[:, members], self.fields["pedal"][:, members])
            rolls = np.isfinite(self.measured[:, -1]) & (N > 0.0).all(axis=1)
            most = max(most, float((np.hypot(*forces)[rolls] / N[rolls]).max(initial=0.0)))
        return most

    def slopes(self, values: np.ndarray, steps: np.ndarray, central: bool) -> np.ndarray:
        """Return central differences (time, output, unknown)."""
        moves = np.diag(steps)
        return np.stack([(self.predict(values + d) - self.predict(values - d)) / (2.0 * step) for d, step in zip(moves, steps)], axis=2)


def leg_load(at: Mapping[str, float], group: WheelGroup, s: np.ndarray, rate: np.ndarray) -> np.ndarray:
    """Return the load of a leg from its compression and the rate of it. [N]"""
    stiffness, square, damping, orifice, out = (at.get(group.parameter(name), 0.0) for name in LEG)
    return (stiffness + square * s) * s + (damping + orifice * np.abs(rate) + np.where(rate < 0.0, out, 0.0)) * rate


def tyre_forces(at: Mapping[str, float], group: WheelGroup, N, tangent, pedal) -> tuple[np.ndarray, np.ndarray]:
    """Return the force of the ground forward and to the right, in the axes of the wheel. [N]"""
    brake, share, cornering, bend = (at.get(group.parameter(name), 0.0) for name in TYRE)
    braking = at[ROLLING] * N + pedal * (brake + share * N)
    return -braking, -brush(N, tangent, cornering * N / (1.0 + bend * (N / LOAD) ** 2), at[FRICTION], braking)


def explicit_fit(runs: Sequence[GroundRun], unknowns: Mapping[str, Unknown]) -> OutputError:
    """Return the constants of a gear by least squares on its balances of force and moment, all runs together.

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
    found = search(Likelihood(runs, layout, np.arange(len(runs))), _ITERATIONS)
    covariance, colours = coloured_covariance(found, layout.columns, [run.interval for run in runs])
    outputs = [str(name) for name in runs[0].data["output"].values]
    estimates = tabulated(found, layout, covariance, {"method": "reconstructed wheel loads"})
    rest = tuple(
        xr.Dataset({name: ("time", v[:, k]) for k, name in enumerate(outputs)}, {"time": run.time}, dict(run.data.attrs))
        for run, v in zip(runs, found.residuals)
    )
    return OutputError(estimates, rest, noise_of(found, outputs, colours, [run.measured for run in runs]))
