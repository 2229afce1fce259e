"""Estimation of the flight path as one least-squares problem.

The residuals are the kinematics between samples, the readings of the sensors, and the priors of the
constants. The state at each sample is attitude, ground velocity (north, east, down), height and the
lagged angles at the vanes. In turbulence three states follow: the gust velocity (north, east,
down), or the change that gusts make in the readings of the two vanes and the pitot.

The inertial unit drives the path, and its white noise is the process noise. The residual of a step
is the error of gyros and accelerometers, in the axes of the instruments, that explains the step::

    r_omega = W(mid) (angles_k+1 - angles_k)/dt - (omega_m - b_omega)
    r_a     = R'(mid) [(v_k+1 - v_k)/dt - g + (2 Omega + omega_level) x v] - (a_m - b_a)

Its weight is therefore the noise of the data sheet. Gauss-Newton on all residuals at once is the
iterated extended Kalman smoother.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from flightmech.errors import IdentificationError
from flighttest.reconstruction.problem.driving import driven_path, driving_constants, slow_steps
from flighttest.reconstruction.problem.normal_equations import NormalEquations
from flighttest.reconstruction.problem.problem import VELOCITY, PathProblem, invert_covariance
from flighttest.reconstruction.problem.readings import linearise_sensor, states_and_rates

# m/s: noise of the height equation, far below the noise of any height sensor
HEIGHT_NOISE = 0.005
# rad per step: noise of the lag equation in flight too slow for the vanes
LOOSE = 0.01
# Expected decrease of the cost at which the iteration stops. One standard error is a decrease of 1.
GAIN = 0.01
# Expected decrease below which the equations before a step also hold after it: a hundredth of a
# standard error.
NEAR = 1e-4
# Cost per sample above which the path is a first guess only.
FAR = 1000.0
ITERATIONS = 20
_LEAST_SHARE = 1e-3  # of a step, in the line search
_POOR_STEP = 0.25  # share of the promised decrease below which a step is halved
_LEAST_SPEED = 10.0  # m/s, for the correlation time of gusts

_MULTIPLIERS = ("factor.", "lag.", "delay.")


@dataclass(frozen=True)
class Solution:
    """Estimate of a trajectory and of the constants.

    Attributes
    ----------
    x : array (N, n)
        Trajectory.
    c : array (nc,)
        Constants.
    covariance : array (nc, nc)
        Covariance of the constants.
    cost : float
        Twice the negative log density, without its constant.
    iterations : int
    settled : bool
        Whether the iteration converged.
    equations : NormalEquations or None
        Normal equations at the estimate. They may be the equations before a last step shorter than
        a hundredth of a standard error. None after a longer last step.
    """

    x: np.ndarray
    c: np.ndarray
    covariance: np.ndarray
    cost: float
    iterations: int
    settled: bool
    equations: NormalEquations | None = None


def estimate_trajectory(
    problem: PathProblem,
    x: np.ndarray,
    c: np.ndarray,
    iterations: int = ITERATIONS,
    held: Sequence[str] = (),
    known: NormalEquations | None = None,
) -> Solution:
    """Minimise the joint negative log density by Gauss-Newton, halving steps that overshoot.

    Parameters
    ----------
    problem : PathProblem
    x, c : array (N, n), (nc,)
        Start.
    iterations : int
        Largest number of steps.
    held : sequence of str
        Constants that stay at their start value, because the data do not inform them. Their prior
        uncertainty goes into the covariance of the others (Schmidt's "consider" parameters).
    known : NormalEquations, optional
        Normal equations at the start.

    Returns
    -------
    Solution
        It has ``settled`` in two cases. Either the last step promised to lower the cost (twice the
        negative log density) by less than 0.01; this step is taken without evaluation. Or the last
        step promised less than one, a standard error, and brought less than 0.01. The second case
        is needed because the cost has a kink where a latency crosses a sample.

    Raises
    ------
    IdentificationError
        No fraction of a step lowers the cost.
    """
    free = np.array([name not in held for name in problem.constants.names])
    return _minimise_cost(problem, x, c, free=free, iterations=iterations, start=known)


def _minimise_cost(
    problem: PathProblem,
    x: np.ndarray,
    c: np.ndarray,
    free: np.ndarray,
    iterations: int,
    start: NormalEquations | None,
) -> Solution:
    """Return the estimate of the path and of the constants `free` (nc,)."""
    multiplies = np.array([name.startswith(_MULTIPLIERS) for name in problem.constants.names])
    equations = start or linearise(problem, x, c)
    spare: list[NormalEquations] = []
    # Whether `equations` hold at the last estimate.
    near = True
    converged = False
    step = 0
    while step < iterations and not converged:
        step += 1
        # Far from the minimum the readings serve to start the path. Constants that multiply the
        # path wait until it is near.
        far = equations.cost > FAR * len(x)
        movable = free
        if far:
            movable = free & ~multiplies
        dx, dc, information = equations.solve(movable)
        gain = -float(np.vdot(equations.gx, dx) + equations.gc @ dc)
        if not far and gain < GAIN:
            x = step_trajectory(x, dx)
            c = c + dc
            converged = True
            near = gain < NEAR
            break
        trial, share = _search_along_step(
            problem, x, c, dx=dx, dc=dc, cost=equations.cost, gain=gain, spare=spare
        )
        decrease = equations.cost - trial.cost
        if decrease < -GAIN and gain > 1.0:
            raise IdentificationError(
                "the reconstruction finds no better path from its start; check signs, units "
                "and positions of the sensors"
            )
        obsolete = trial
        if decrease > -GAIN:
            x = step_trajectory(x, share * dx)
            c = c + share * dc
            equations, obsolete = trial, equations
            equations.reuse_elimination(obsolete)
        # The caller may still use the equations that it passed.
        if obsolete is not start:
            spare.append(obsolete)
        converged = not far and gain < 1.0 and decrease < GAIN
    return Solution(
        x,
        c,
        _constants_covariance(information, free, problem.constants.covariance),
        cost=equations.cost,
        iterations=step,
        settled=converged,
        equations=equations if near else None,
    )


def step_trajectory(x: np.ndarray, dx: np.ndarray) -> np.ndarray:
    """Return the trajectory after a step: the horizontal velocity turns along with the heading.

    To first order the result is x + dx. Without a compass the heading is free, and a straight step
    in north and east would lengthen a velocity that only turns. The vertical velocity takes the
    straight step, and so does the height. The stiff equation between the two is linear and remains
    fulfilled.

    Parameters
    ----------
    x, dx : array (N, n)
        Trajectory and step.
    """
    after = x + dx
    vn, ve, turn = x[:, 3], x[:, 4], dx[:, 2]
    # the step without the part that follows from the change of heading
    north = vn + dx[:, 3] + ve * turn
    east = ve + dx[:, 4] - vn * turn
    after[:, 3] = north * np.cos(turn) - east * np.sin(turn)
    after[:, 4] = north * np.sin(turn) + east * np.cos(turn)
    return after


def _search_along_step(
    problem: PathProblem, x, c, dx, dc, cost: float, gain: float, spare: list[NormalEquations]
) -> tuple[NormalEquations, float]:
    """Return the equations after the best of the full step and its halves, and the share taken."""
    share = 1.0
    best = linearise(problem, step_trajectory(x, dx), c + dc, spare=spare)
    while gain > GAIN and cost - best.cost < _POOR_STEP * gain * share and share > _LEAST_SHARE:
        half = share / 2.0
        trial = linearise(problem, step_trajectory(x, half * dx), c + half * dc, spare=spare)
        if trial.cost >= best.cost:
            spare.append(trial)
            break
        spare.append(best)
        best, share = trial, half
    return best, share


def _constants_covariance(
    information: np.ndarray, free: np.ndarray, prior: np.ndarray
) -> np.ndarray:
    """Return the covariance of the constants. Fixed constants keep their prior covariance."""
    covariance = prior.copy()
    f, h = np.flatnonzero(free), np.flatnonzero(~free)
    if not len(f):
        return covariance
    # Schmidt: the estimates c_f follow the errors of the fixed constants c_h, dc_f = K dc_h with
    # K = -I_ff^-1 I_fh.
    posterior = invert_covariance(information[np.ix_(f, f)])
    follow = -posterior @ information[np.ix_(f, h)]
    covariance[np.ix_(f, f)] = posterior + follow @ prior[np.ix_(h, h)] @ follow.T
    covariance[np.ix_(f, h)] = follow @ prior[np.ix_(h, h)]
    covariance[np.ix_(h, f)] = covariance[np.ix_(f, h)].T
    return covariance


def linearise(
    problem: PathProblem, x: np.ndarray, c: np.ndarray, spare: list[NormalEquations] | None = None
) -> NormalEquations:
    """Return the normal equations of all residuals about a trajectory and constants.

    Parameters
    ----------
    problem : PathProblem
    x, c : array (N, n), (nc,)
    spare : list of NormalEquations, optional
        Equations of the same problem that are not needed any more. The last one is removed from
        the list and its memory is used again.
    """
    if spare:
        equations = spare.pop()
        equations.clear()
    else:
        equations = NormalEquations(len(x), problem.states, len(c), problem.constants.names)
    with equations.sums.collect_groups():
        _add_path_steps(problem, x, c, equations)
        _add_gust_steps(problem, x, equations)
        values = states_and_rates(problem, x, c)
        for sensor in problem.sensors:
            r, k, f, J, columns, Jc = linearise_sensor(problem, sensor, values, c)
            weight = 1.0 / sensor.sigma
            equations.add_samples(r, k, f=f, J=J, columns=columns, Jc=Jc, weight=weight)
    # The prior of a start is wide. It prevents drift only: its mean is the present start, except
    # for vane angles and gusts, which are near zero.
    is_rigid = np.arange(problem.states) < 7
    for k in problem.starts:
        weight = 1.0 / problem.start_sigma[: problem.states]
        mean = np.where(is_rigid, x[k], 0.0)
        equations.add_state(int(k), (x[k] - mean) * weight, weight)
    equations.add_prior(c - problem.constants.mean, problem.constants.precision())
    return equations


def _add_path_steps(
    problem: PathProblem, x: np.ndarray, c: np.ndarray, equations: NormalEquations
) -> None:
    """Add the residuals of the kinematics between the samples."""
    columns = driving_constants(problem)
    sigma = np.empty((len(x) - 1, 7 + len(problem.vanes)))
    sigma[:, :7] = np.append(problem.noise, HEIGHT_NOISE)
    sigma[:, 7:] = np.where(slow_steps(problem.airborne)[:, None], LOOSE, problem.vane_noise)
    path = driven_path(problem, x, c, columns)
    # No equation connects the last sample of a segment with the first of the next.
    equations.add_path_steps(path, problem.linked[:, None] / sigma, columns)


def _add_gust_steps(problem: PathProblem, x: np.ndarray, equations: NormalEquations) -> None:
    """Add the residuals of the gust model, a first-order Markov process."""
    if problem.gust is None:
        return
    # w_k+1 = a w_k + noise, a = exp(-dt/T); the noise keeps the variance of the gust constant.
    decay = np.exp(-problem.dt / problem.gust_time)
    weight = problem.linked[:, None] / (problem.gust * np.sqrt(1.0 - decay**2))
    gust = x[:, problem.gusts]
    indices = np.arange(problem.gusts.start, problem.gusts.stop)
    A = np.zeros((len(x) - 1, 3, problem.states))
    B = np.zeros((len(x) - 1, 3, problem.states))
    A[:, np.arange(3), indices] = -decay
    B[:, np.arange(3), indices] = 1.0
    equations.add_steps(
        gust[1:] - decay * gust[:-1],
        A,
        B=B,
        columns=np.zeros(0, int),
        Jc=np.zeros((len(x) - 1, 3, 0)),
        weight=weight,
    )


def with_gusts(
    problem: PathProblem, x: np.ndarray, sigma: np.ndarray, length: float, shown: bool
) -> tuple[PathProblem, np.ndarray]:
    """Return the problem with gust states, and the trajectory with zero gusts.

    Parameters
    ----------
    problem : PathProblem
    x : array (N, n)
        Trajectory.
    sigma : array (3,)
        Standard deviation of the gust states, see `PathProblem.gust`.
    length : float
        Scale length of the gusts. [m]
    shown : bool
        Whether the gust states are changes of readings, see `PathProblem`.
    """
    n = 7 + len(problem.vanes)
    speed = float(np.median(np.linalg.norm(x[:, VELOCITY], axis=1)))
    gusty = replace(
        problem,
        gust=sigma,
        gust_time=length / max(speed, _LEAST_SPEED),
        shown=shown,
        start_sigma=np.concatenate([problem.start_sigma[:n], sigma]),
    )
    return gusty, np.concatenate([x[:, :n], np.zeros((len(x), 3))], axis=1)
