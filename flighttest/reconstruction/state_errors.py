"""What the instruments' constants leave open in a reconstructed path: common errors of its states.

The constants of a reconstruction (biases, factors, latencies, wind) are known with a covariance, and the whole path follows them,
dx/dc = -T^-1 G of the normal equations.  With the Cholesky factor L of the covariance, L L' = cov(c), column k of L is one
standard error of an independent error, and what it changes in the states is a function of time.  Constants of the instruments
come first in the factor, those of the single run (wind, reference pressure) after them: the first are errors that all runs
of a programme share, when all were reconstructed together; the others belong to the run alone and carry its title.
"""

from __future__ import annotations

from typing import Any

import numpy as np
import xarray as xr

from flightmech.names import attrs

from ..sensors.instruments import IMU
from .path_quantities import motion
from .problem.assembly import Setup
from .problem.constants import PER_RUN
from .problem.problem import body_rates, specific_force
from .problem.trajectory import Solution, linearise, moved

STATES = (
    # that coefficients and regressors are made of
    *("V", "qbar", "mach", "alpha", "beta", "alpha_dot", "beta_dot", "p", "q", "r", "ax", "ay", "az", "phi", "h", "h_agl"),
    # that replays start from or are judged on
    *("theta", "psi", "gamma", "V_cas", "nz"),
)


def state_errors(record: xr.DataTree, aircraft: Any, setup: Setup, solution: Solution) -> xr.Dataset:
    """Return the change of the states for one standard error of each independent error of the constants.

    Parameters
    ----------
    record : DataTree
    aircraft : Aircraft
    setup, solution
        Of `reconstruction.solve`.

    Returns
    -------
    Dataset (error, time)
        `STATES`, in their units, single precision.  Errors of the instruments carry the name of their constant, those of the
        run ``"<constant> of <title of the record>"``.
    """
    problem, x, c = setup.problem, solution.x, solution.c
    names = problem.constants.names
    order = sorted(range(len(names)), key=lambda i: names[i] in PER_RUN)  # stable: the instruments first
    scale = np.sqrt(np.diag(solution.covariance))[order]
    correlation = solution.covariance[np.ix_(order, order)] / np.outer(scale, scale)
    L = scale[:, None] * np.linalg.cholesky(correlation + 1e-12 * np.eye(len(scale)))  # two constants may do all but the same
    full = np.zeros_like(L)
    full[order] = L  # of all constants, in their own order, by the errors
    x = np.asfortranarray(x)  # from here on single states are read
    inertial = body_rates(problem, c), specific_force(problem, c)
    nominal = motion(record, aircraft, setup, x, c, inertial)
    known = [name for name in STATES if name in nominal]
    found = {name: np.empty((len(order), len(x)), np.float32) for name in known}
    change = np.empty(len(x))
    drive = np.isin(names, [f"{kind}.{channel}" for kind in ("bias", "scale") for channel in IMU])
    equations = solution.equations or linearise(problem, solution.x, c)
    for k, (dc, dx) in enumerate(zip(full.T, equations.following(full), strict=True)):
        # a difference over a part of the error where it is large: a constant that nothing determines has no bound
        part = 1.0 / max(1.0, np.abs(dc).max(), dx.max(), -dx.min())
        same = None if dc[drive].any() else inertial
        changed = motion(record, aircraft, setup, moved(x, part * dx), c + part * dc, same)
        for name in known:
            np.subtract(changed[name], nominal[name], out=change)
            found[name][k] = change if part == 1.0 else change / part
    title = str(record.attrs.get("title", ""))
    labels = [f"{names[i]} of {title}" if names[i] in PER_RUN else names[i] for i in order]
    return xr.Dataset(
        {name: (("error", "time"), change, attrs(name)) for name, change in found.items()},
        coords={"error": labels, "time": ("time", problem.time, attrs("time"))},
    )
