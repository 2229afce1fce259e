"""Assembly of the least-squares problem of the flight path from a record and its instruments."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
import xarray as xr

from flightmech.errors import SchemaError
from flighttest.reconstruction.dynamics.kinematics import earth_rotation, gravity
from flighttest.reconstruction.problem.initial_constants import initial_constants
from flighttest.reconstruction.problem.problem import (
    PER_RUN,
    Constants,
    PathProblem,
    Sensor,
    bias_estimates,
)
from flighttest.reconstruction.problem.record_inputs import TRACK, RecordInputs, first_path
from flighttest.reconstruction.problem.sensor_groups import group_sensors
from flighttest.reconstruction.problem.trajectory import Solution
from flighttest.records.sensors.instruments import IMU, SPEEDS, instruments_of
from flighttest.records.sensors.measurements import MEASURED, order_windows
from flighttest.records.signals.differentiation import derivative

# Standard deviations of the state at the start of a window: angles [rad], velocity [m/s], height
# [m], vane angles [rad]. They prevent drift of a start that no reading determines. Without a
# compass the heading counts from the start.
_START = {
    "phi": 0.2,
    "theta": 0.2,
    "psi": 3.0,
    "no psi": 1e-3,
    "track": 0.5,
    "v": 50.0,
    "h": 500.0,
    "vane": 0.3,
}
# Standard deviation of the lag equation over the noise of the vane. It adds (factor * deviation)^2
# to the variance of a reading. A mode of the joint density takes this as a reason to enlarge the
# factor: by N share^2 s^2 of a factor with standard error s from N readings.
VANE_SHARE = 0.01
# A step longer than this many sampling intervals separates two windows.
_GAP = 1.5


@dataclass(frozen=True)
class Setup:
    """A problem with its start values.

    Attributes
    ----------
    problem : PathProblem
    x : array (N, n)
        First trajectory.
    c : array (nc,)
        First values of the constants.
    temperature : array (N,)
        Air temperature as measured. [K]
    reference : (float, float)
        Reference height and the measured temperature there. [m], [K]
    cg : array (3,)
        Mean centre of gravity. [m]
    unused : tuple of str
        Recorded channels without a sensor.
    held : tuple of str
        Constants that stay at their prior.
    spikes : tuple of str
        Sentences about removed spikes.
    """

    problem: PathProblem
    x: np.ndarray
    c: np.ndarray
    temperature: np.ndarray
    reference: tuple[float, float]
    cg: np.ndarray
    unused: tuple[str, ...]
    held: tuple[str, ...] = ()
    spikes: tuple[str, ...] = ()

    def biases(self, solution: Solution) -> xr.Dataset:
        """Return the constants of a solution, see `bias_estimates`."""
        return bias_estimates(
            self.problem.constants, solution.c, covariance=solution.covariance, held=self.held
        )


def assemble_problem(
    record: xr.DataTree,
    aircraft: Any,
    windows: Sequence[tuple[float, float]] | None = None,
    prior: xr.Dataset | None = None,
    rate: float = 50.0,
) -> Setup:
    """Return the problem of a record with its start values; arguments as in `reconstruct`."""
    inputs = RecordInputs(
        record,
        aircraft,
        instruments_of(aircraft, record.attrs),
        windows=order_windows(record, windows),
        rate=rate,
    )
    x = first_path(inputs)
    mean_height = float(x[:, 6].mean())
    reference = (mean_height, float(inputs.air.temperature_at(inputs.time).mean()))
    g = gravity(inputs.latitude, mean_height)
    constants, c = initial_constants(inputs, x, g=g, reference=reference)
    if prior is not None:
        constants = constants.with_prior(prior)
        is_shared = []
        for name in constants.names:
            is_shared.append(name in prior["parameter"] and name not in PER_RUN)
        c = np.where(is_shared, constants.mean, c)
    sensors = group_sensors(inputs, reference)
    problem = _make_problem(inputs, sensors, constants=constants, g=g, height=mean_height)
    return Setup(
        problem,
        x,
        c,
        temperature=inputs.air.temperature_at(inputs.time),
        reference=reference,
        cg=inputs.cg,
        unused=_unused_channels(inputs, sensors),
        spikes=tuple(inputs.channels.spikes_in_words()),
    )


def _make_problem(
    inputs: RecordInputs, sensors: list[Sensor], constants: Constants, g: float, height: float
) -> PathProblem:
    """Return the problem; g is gravity at `height`."""
    specification, vanes = inputs.specification, inputs.vanes
    omega = np.stack([inputs.resample(name) for name in "pqr"], axis=1)
    force = np.stack([inputs.resample(name) for name in ("ax_imu", "ay_imu", "az_imu")], axis=1)
    slowest = 0.0
    if vanes:
        slowest = specification.of(vanes[0]).minimum_speed
    vane_noise = np.array([specification.noise(name) for name in vanes])
    return PathProblem(
        time=inputs.time,
        linked=np.diff(inputs.time) < _GAP / inputs.rate,
        omega=omega,
        omega_dot=_angular_acceleration(inputs, omega),
        force=force,
        noise=np.array([_sample_noise(inputs, name) for name in IMU]),
        arm=inputs.arm("ax_imu"),
        vane_arms=np.array([inputs.arm(name) for name in vanes]).reshape(-1, 3),
        g=g,
        g_height=height,
        earth=earth_rotation(inputs.latitude),
        airborne=inputs.air.speed_at(inputs.time) > slowest,
        vanes=vanes,
        vane_noise=VANE_SHARE * vane_noise,
        sensors=sensors,
        constants=constants,
        start_sigma=_start_sigma(inputs),
        gyro_spin=_gyro_spin(inputs),
    )


def _angular_acceleration(inputs: RecordInputs, omega: np.ndarray) -> np.ndarray:
    """Return the derivatives of the gyro signals (N, 3), window by window. [rad s-2]"""
    windows = []
    for piece in inputs.split_windows(omega):
        slopes = [derivative(signal, 1.0 / inputs.rate) for signal in piece.T]
        windows.append(np.stack(slopes, axis=1))
    return np.concatenate(windows)


def _sample_noise(inputs: RecordInputs, name: str) -> float:
    """Return the standard deviation of an inertial channel per sample of the path."""
    # The mean over a step of the path has less noise than one reading of a faster recorder.
    reduction = np.sqrt(min(inputs.rate / inputs.channels.rate(name), 1.0))
    return inputs.specification.noise(name) * reduction


def _start_sigma(inputs: RecordInputs) -> np.ndarray:
    """Return the standard deviations of the state at the start of a window (7 + vanes,)."""
    # Without heading and track the heading counts from the start.
    heading = "no psi"
    if inputs.can_use("psi"):
        heading = "psi"
    elif inputs.can_use(*TRACK):
        heading = "track"
    names = ["phi", "theta", heading, "v", "v", "v", "h"]
    names += ["vane"] * len(inputs.vanes)
    return np.array([_START[name] for name in names])


def _gyro_spin(inputs: RecordInputs) -> np.ndarray:
    """Return the rate of the Earth in the gyro signals, north-east-down (3,). [rad s-1]"""
    if not inputs.specification.of("p").earth_rate:
        return np.zeros(3)
    if inputs.latitude is None:
        raise SchemaError(
            "flight record",
            [
                "no latitude, but the gyros show the rate of the Earth (earth_rate); "
                'give [record] latitude = "45 deg" in the name map'
            ],
        )
    rate, _ = earth_rotation(inputs.latitude)
    return rate


def _unused_channels(inputs: RecordInputs, sensors: list[Sensor]) -> tuple[str, ...]:
    """Return the recorded channels that no sensor uses."""
    used = {"temperature"}
    for sensor in sensors:
        used.update(sensor.names)
    usable = set(MEASURED)
    if inputs.air.channel in used:
        # all airspeeds measure the same
        usable -= {*SPEEDS}
    return tuple(sorted((usable & inputs.channels.recorded) - used))
