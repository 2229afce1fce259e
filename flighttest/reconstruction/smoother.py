"""State reconstruction by an iterated extended Kalman smoother ([LR743] 4.3).

Recordings with instrument errors become one consistent flight path. The smoother is Gauss-Newton on
the joint density of path and constants. It is the right estimator for ordinary gyros. A batch
output-error fit assumes a perfect inertial unit; its standard errors cover 30 % of the truth where
they promise 95 %.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from typing import TYPE_CHECKING, Any

import numpy as np
import pandas as pd
import xarray as xr

from flightmech.errors import IdentificationError
from flightmech.quantities import value_in_si
from flighttest.reconstruction.channel_signals import channel_signals
from flighttest.reconstruction.dynamics.loads import with_propeller_thrust_coefficient
from flighttest.reconstruction.flight_path import FlightPath, fit_row
from flighttest.reconstruction.path_quantities import solution_states
from flighttest.reconstruction.problem.assembly import Setup, assemble_problem
from flighttest.reconstruction.problem.problem import PathProblem
from flighttest.reconstruction.problem.readings import sensor_residuals
from flighttest.reconstruction.problem.trajectory import Solution, estimate_trajectory, with_gusts
from flighttest.reconstruction.state_errors import state_errors
from flighttest.reconstruction.turbulence import (
    GUST_LENGTH,
    gust_intensity,
    hidden_by_gusts,
    in_calm_air,
    measured_airspeed,
)
from flighttest.records.sensors.instruments import VANES

if TYPE_CHECKING:
    from flightmech.aircraft.aircraft import Aircraft

CALM_STEPS = 4  # iterations before the test for turbulence
STILL = 0.1  # standard errors: a constant with a smaller change has converged
# First standard deviation of the gust states over the noise of their sensors, and the smallest
# share of it that an estimate may have.
_FIRST_GUST = 5.0
_LEAST_GUST = 0.1
_DEFAULT_NOISE = 1e-3  # of a vane that the record does not have
_LISTED = 5  # constants in an error message


def reconstruct(
    record: xr.DataTree,
    aircraft: Aircraft,
    windows: Sequence[tuple[float | str, float | str]] | None = None,
    prior: xr.Dataset | None = None,
    rate: float | str = 50.0,
) -> FlightPath:
    """Reconstruct the flight path of a record.

    Parameters
    ----------
    record : DataTree
        Flight record. Required channels are the inertial unit (p q r ax_imu ay_imu az_imu), phi,
        theta; an airspeed (q_c, V, V_cas or mach); p_static, h_baro or h_gps; and temperature, as
        channel or root attribute. Optional channels are psi, vn ve vd h_gps, alpha_vane, beta_vane
        and h_radio. Root attributes: ``temperature`` [K], ``wind_down_sigma`` (standard error of
        the prior of the mean vertical wind, 0.2) [m s-1], ``latitude`` [rad], ``runway_elevation``
        (for h_radio) [m].
    aircraft : Aircraft
        For cbar, b, c.g. and the instruments (see `flighttest.records.sensors.parse_instruments`).
    windows : sequence of (start, stop), optional
        Parts to reconstruct, with common constants; the complete record by default. A text has its
        unit, as ``("90 s", "2.5 min")``; here and in `rate`. [s]
    prior : Dataset, optional
        `biases` of other runs (`combine_biases`): the prior of the constants of the instruments.
    rate : float
        Samples per second of the path. [Hz]

    Returns
    -------
    FlightPath

    Raises
    ------
    OutOfRange
        A window is not inside the record.
    SchemaError
        A required channel is missing or holds NaN, or the instrument specification is faulty.
    IdentificationError
        The iteration does not converge, or a constant has neither data nor a prior.

    References
    ----------
    .. [LR743] Report LR-743, 1993, section 4.3.
    .. [Mulder1999] Mulder et al., Prog. Aerosp. Sci. 35, 1999.
    .. [Bell1994] Bell, SIAM J. Optim. 4, 1994.
    """
    parts = None if windows is None else [_window_in_seconds(window) for window in windows]
    frequency: float = value_in_si(rate, "Hz", "rate")
    setup, solution = solve_record(record, aircraft, parts, prior, frequency)
    return path_of_solution(record, aircraft, setup, solution)


def _window_in_seconds(window: tuple[float | str, float | str]) -> tuple[float, float]:
    start, stop = window
    return value_in_si(start, "s", "start of a window"), value_in_si(stop, "s", "end of a window")


def solve_record(
    record: xr.DataTree, aircraft: Aircraft, windows=None, prior=None, rate: float = 50.0
) -> tuple[Setup, Solution]:
    """Return the problem of a record and its solution; arguments as in `reconstruct`."""
    setup = assemble_problem(record, aircraft, windows, prior=prior, rate=rate)
    try:
        solution = estimate_trajectory(setup.problem, setup.x, setup.c, CALM_STEPS)
        if in_calm_air(setup, solution):
            return setup, _iterate_until_settled(setup.problem, solution)
        return _solve_turbulence(setup)
    except IdentificationError as error:
        raise IdentificationError(f"{record.attrs.get('title', 'record')}: {error}") from error


def refine_path(
    record: xr.DataTree, aircraft: Aircraft, setup: Setup, solution: Solution, prior: xr.Dataset
) -> FlightPath:
    """Return the path of a solved record, with the constants of other runs as prior."""
    constants = setup.problem.constants.with_prior(prior)
    problem = replace(setup.problem, constants=constants)
    if problem.gust is None:
        first = estimate_trajectory(problem, solution.x, solution.c)
        setup = replace(setup, problem=problem)
        solution = _iterate_until_settled(problem, first)
        return path_of_solution(record, aircraft, setup=setup, solution=solution)
    # In turbulence start again from calm air. Fixed constants take the mean of the new prior.
    is_held = [name in setup.held for name in constants.names]
    calm = replace(
        setup,
        problem=replace(problem, gust=None),
        x=solution.x[:, : problem.gusts.start],
        c=np.where(is_held, constants.mean, solution.c),
    )
    setup, solution = _solve_turbulence(calm)
    return path_of_solution(record, aircraft, setup=setup, solution=solution)


def _solve_turbulence(setup: Setup) -> tuple[Setup, Solution]:
    """Return problem and solution with gusts: first the constants, then the gust velocities."""
    first_sigma = _first_gust_sigma(setup.problem)
    hidden = hidden_by_gusts(setup.problem)
    # 1. Gust states are changes of readings. Their intensity follows from a few iterations.
    problem, x = with_gusts(
        setup.problem, setup.x, sigma=first_sigma, length=GUST_LENGTH, shown=True
    )
    first = estimate_trajectory(problem, x, setup.c, CALM_STEPS, hidden)
    rms = np.sqrt(np.mean(first.x[:, problem.gusts] ** 2, axis=0))
    sigma = np.maximum(rms, _LEAST_GUST * first_sigma)
    problem = replace(problem, gust=sigma)
    # 2. Constants for this intensity. Cost and equations of the first iterations belong to another
    # problem.
    start = replace(first, settled=False, equations=None)
    # they also need much memory
    del first
    constants_fit = replace(_iterate_until_settled(problem, start, hidden), equations=None)
    # 3. Gust velocities for fixed constants.
    intensity = gust_intensity(setup, constants_fit, sigma)
    gusty, x = with_gusts(
        problem, constants_fit.x, sigma=intensity, length=GUST_LENGTH, shown=False
    )
    names = problem.constants.names
    path_fit = estimate_trajectory(gusty, x, constants_fit.c, CALM_STEPS, names)
    path_fit = _iterate_until_settled(gusty, path_fit, names)
    solution = replace(
        path_fit,
        covariance=constants_fit.covariance,
        iterations=constants_fit.iterations + path_fit.iterations,
    )
    return replace(setup, problem=gusty, held=hidden), solution


def _first_gust_sigma(problem: PathProblem) -> np.ndarray:
    """Return a first standard deviation of the changes of readings by gusts (3,)."""
    noise: dict[str, float] = {}
    for sensor in problem.sensors:
        noise.update(zip(sensor.names, sensor.sigma, strict=True))
    channels = (*VANES, measured_airspeed(problem))
    return _FIRST_GUST * np.array([noise.get(name, _DEFAULT_NOISE) for name in channels])


def _iterate_until_settled(
    problem: PathProblem, solution: Solution, held: Sequence[str] = ()
) -> Solution:
    """Return the converged solution.

    Raises
    ------
    IdentificationError
        The iteration does not converge. The message names the constants that still change.
    """
    if solution.settled:
        return solution
    continued = estimate_trajectory(
        problem, solution.x, solution.c, held=held, known=solution.equations
    )
    solution = replace(continued, iterations=solution.iterations + continued.iterations)
    if not solution.settled:
        raise IdentificationError(
            f"the reconstruction did not settle in {solution.iterations} iterations: "
            f"{_describe_changes(problem, solution, held)}"
        )
    return solution


def _describe_changes(problem: PathProblem, solution: Solution, held: Sequence[str]) -> str:
    """Return the constants that one more iteration changes, by how much, and what to do."""
    change = estimate_trajectory(problem, solution.x, solution.c, 1, held).c - solution.c
    errors = np.sqrt(np.diag(solution.covariance))
    # the largest change in standard errors first
    changing = []
    for k in np.argsort(-np.abs(change) / errors):
        if abs(change[k]) > STILL * errors[k]:
            changing.append(k)
    if not changing:
        return (
            "all constants stand still and only the path moves; look for readings that "
            "contradict each other (signs, units, clocks)"
        )
    names, units = problem.constants.names, problem.constants.units
    parts = []
    for k in changing[:_LISTED]:
        ratio = abs(change[k]) / errors[k]
        parts.append(f"{names[k]} by {change[k]:.2g} {units[k]} ({ratio:.2g} standard errors)")
    listed = ", ".join(parts)
    if len(changing) > _LISTED:
        listed += f" and {len(changing) - _LISTED} more"
    return (
        f"still moving are {listed}; give them a prior in the aircraft file, "
        f"or a window whose readings determine them"
    )


def path_of_solution(
    record: xr.DataTree, aircraft: Aircraft, setup: Setup, solution: Solution
) -> FlightPath:
    """Return the path of a solution."""
    states = solution_states(record, aircraft, setup=setup, solution=solution)
    states = with_propeller_thrust_coefficient(states, aircraft)
    columns: dict[str, Any] = {}
    rows = []
    for sensor in setup.problem.sensors:
        residuals, k = sensor_residuals(setup.problem, sensor, solution.x, solution.c)
        for i, name in enumerate(sensor.names):
            column = np.full(len(setup.problem.time), np.nan)
            column[k] = residuals[:, i]
            columns[name] = "time", column
            rows.append(fit_row(name, residuals[:, i], float(sensor.sigma[i])))
    return FlightPath(
        states,
        setup.biases(solution),
        residuals=xr.Dataset(columns, coords={"time": states["time"]}),
        fit=pd.DataFrame(rows).set_index("channel"),
        compatibility=channel_signals(setup, solution),
        errors=state_errors(record, aircraft, setup=setup, solution=solution),
    )
