"""Errors of the states of a path, from the errors of the constants of the instruments."""

from __future__ import annotations

from typing import Any

import numpy as np
import xarray as xr

from flightmech.names import quantity_attributes
from flighttest.reconstruction.path_quantities import motion_quantities
from flighttest.reconstruction.problem.assembly import Setup
from flighttest.reconstruction.problem.problem import PER_RUN, body_rates, specific_force
from flighttest.reconstruction.problem.trajectory import Solution, linearise, step_trajectory
from flighttest.records.sensors.instruments import IMU

# States of coefficients and regressors.
_REGRESSION_STATES = (
    "V",
    "qbar",
    "mach",
    "alpha",
    "beta",
    "alpha_dot",
    "beta_dot",
    "p",
    "q",
    "r",
    "ax",
    "ay",
    "az",
    "phi",
    "h",
    "h_agl",
)
# Further states at the start or in the criteria of replays.
_REPLAY_STATES = ("theta", "psi", "gamma", "V_cas", "nz")
# Constants that change rates and forces.
_INERTIAL = {*(f"bias.{name}" for name in IMU), *(f"scale.{name}" for name in IMU)}
STATES = (*_REGRESSION_STATES, *_REPLAY_STATES)
# Addition to the diagonal of the correlation. Why: two constants may have almost the same effect.
_ROUNDING = 1e-12


def state_errors(
    record: xr.DataTree, aircraft: Any, setup: Setup, solution: Solution
) -> xr.Dataset:
    """Return the change of the states for one standard error of each independent error.

    The errors of the constants are correlated. Their Cholesky factor gives independent errors.

    Parameters
    ----------
    record : DataTree
    aircraft : Aircraft
    setup, solution
        Results of `solve_record`.

    Returns
    -------
    Dataset (error, time)
        `STATES`, in their units, single precision. Errors of the instruments have the name of their
        constant, errors of the run the name ``"<constant> of <title of the record>"``.
    """
    problem = setup.problem
    names = problem.constants.names
    # a stable sort: constants of the instruments first
    order = sorted(range(len(names)), key=lambda i: names[i] in PER_RUN)
    changes = _independent_errors(solution.covariance, order)
    errors = _change_states(record, aircraft, setup=setup, solution=solution, changes=changes)
    variables = {}
    for name, error in errors.items():
        variables[name] = (("error", "time"), error, quantity_attributes(name))
    labels = _label_errors([names[i] for i in order], str(record.attrs.get("title", "")))
    clock = ("time", problem.time, quantity_attributes("time"))
    return xr.Dataset(variables, coords={"error": labels, "time": clock})


def _change_states(
    record: xr.DataTree, aircraft: Any, setup: Setup, solution: Solution, changes: np.ndarray
) -> dict[str, np.ndarray]:
    """Return the changes of the states (errors, time) by changes of the constants (nc, errors)."""
    problem, c = setup.problem, solution.c
    # The loop reads single state variables, which are contiguous in this order.
    x = np.asfortranarray(solution.x)
    inertial = body_rates(problem, c), specific_force(problem, c)
    nominal = motion_quantities(record, aircraft, setup=setup, x=x, c=c, inertial=inertial)
    states = [name for name in STATES if name in nominal]
    errors = {name: np.empty((changes.shape[1], len(x)), np.float32) for name in states}
    difference = np.empty(len(x))
    is_inertial = np.array([name in _INERTIAL for name in problem.constants.names])
    equations = solution.equations or linearise(problem, solution.x, c)
    for k, (dc, dx) in enumerate(zip(changes.T, equations.following(changes), strict=True)):
        # Difference over a part of a large error. A constant that nothing determines has an error
        # without bound.
        part = 1.0 / max(1.0, np.abs(dc).max(), dx.max(), -dx.min())
        disturbed = motion_quantities(
            record,
            aircraft,
            setup=setup,
            x=step_trajectory(x, part * dx),
            c=c + part * dc,
            # rates and forces change with the constants of the inertial unit only
            inertial=None if dc[is_inertial].any() else inertial,
        )
        for name in states:
            np.subtract(disturbed[name], nominal[name], out=difference)
            if part != 1.0:
                errors[name][k] = difference / part
            else:
                errors[name][k] = difference
    return errors


def _independent_errors(covariance: np.ndarray, order: list[int]) -> np.ndarray:
    """Return the changes of all constants (nc, errors) by one standard error of each error.

    They are the Cholesky factor of the covariance for the constants in the given order.
    """
    stderr = np.sqrt(np.diag(covariance))[order]
    correlation = covariance[np.ix_(order, order)] / np.outer(stderr, stderr)
    root = np.linalg.cholesky(correlation + _ROUNDING * np.eye(len(stderr)))
    # rows in the original order of the constants, columns in the given order
    changes = np.zeros_like(root)
    changes[order] = stderr[:, None] * root
    return changes


def _label_errors(names: list[str], title: str) -> list[str]:
    """Return the names of the errors; errors of a run have its title."""
    labels = []
    for name in names:
        if name in PER_RUN:
            name = f"{name} of {title}"
        labels.append(name)
    return labels
