"""What each instrument showed and what it should have shown, over time."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np
import xarray as xr

from flightmech.names import attrs

from .problem.assembly import Setup
from .problem.output_equations import no_sideslip
from .problem.problem import Problem, Sensor
from .problem.trajectory import Solution, residuals

VERSIONS = ("raw", "corrected", "reconstructed")


def channel_signals(setup: Setup, solution: Solution) -> xr.Dataset:
    """Return raw, corrected and reconstructed signal of every channel that was measured.

    Returns
    -------
    Dataset (time, version)
        On the clock of the path: ``raw`` at the sample next to its time stamp, ``corrected`` next to the instant that it shows;
        NaN where the channel has no reading.  Attributes ``rms_raw`` and ``rms_corrected``: rms of each against the reconstructed one.
    """
    problem = setup.problem
    found: dict[str, Any] = {}
    for sensor in problem.sensors:
        if sensor.model is no_sideslip:  # no instrument
            continue
        rest, k = residuals(problem, sensor, solution.x, solution.c)
        bare = _without_errors(problem, sensor, solution.c)
        late, k_late = residuals(problem, sensor, solution.x, bare)
        latency = problem.constants.get(solution.c, sensor.delay) if sensor.delay else 0.0
        shifted = replace(sensor, time=sensor.time - latency)
        true = sensor.z - residuals(problem, shifted, solution.x, bare)[0]
        for j, name in enumerate(sensor.names):
            columns = np.full((len(problem.time), len(VERSIONS)), np.nan)
            columns[k_late, 0], columns[k_late, 2] = sensor.z[:, j], sensor.z[:, j] - late[:, j]
            columns[k, 1], columns[k, 2] = true[:, j] + rest[:, j] / problem.constants.get(solution.c, f"factor.{name}", 1.0), true[:, j]
            rms = {"rms_raw": float(np.sqrt(np.mean(late[:, j] ** 2))), "rms_corrected": float(np.sqrt(np.mean(rest[:, j] ** 2)))}
            found[name] = (("time", "version"), columns, {**attrs(name), **rms})
    return xr.Dataset(found, coords={"time": ("time", problem.time, attrs("time")), "version": list(VERSIONS)})


def _without_errors(problem: Problem, sensor: Sensor, c: np.ndarray) -> np.ndarray:
    """Return the constants with the errors of one sensor taken off."""
    ideal = {"static_error": 0.0, sensor.delay: 0.0}
    for name in sensor.names:
        ideal |= {f"bias.{name}": 0.0, f"factor.{name}": 1.0}
    return np.array([ideal.get(name, value) for name, value in zip(problem.constants.names, c, strict=True)])
