"""The flight path as one least-squares problem: kinematics between samples, sensors at samples,
priors on constants.

State at each sample: attitude, ground velocity (north, east, down), height, the lagged angles behind the vanes, and in
turbulence three more: the gust (north, east, down), or what the gusts add to the readings of the two vanes and the pitot.
The inertial unit drives it; its white noise is the process noise.  Written in the axes of the instruments, the residual
of a step is what the gyros and accelerometers would have to be wrong by::

    r_omega = W(mid) (angles_k+1 - angles_k)/dt - (omega_m - b_omega)
    r_a     = R'(mid) [(v_k+1 - v_k)/dt - g + (2 Omega + omega_level) x v] - (a_m - b_a)

so its weight is the data-sheet noise, and no process noise has to be tuned.  Minimising all
residuals at once by Gauss-Newton is the iterated extended Kalman smoother.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace

import numpy as np

from flightmech.errors import IdentificationError
from flightmech.simulation.driven_path import (
    BIAS,
    LAG,
    SCALE,
    WIND,
    DrivenPath,
    Inertial,
    Surroundings,
    Vanes,
)
from flighttest.reconstruction.problem.normal_equations import NormalEquations
from flighttest.reconstruction.problem.problem import (
    VELOCITY,
    PathProblem,
    Sensor,
    body_rates,
    inertial_gains,
    invert_covariance,
    sensed_force,
    specific_force,
)
from flighttest.records.sensors.instruments import IMU
from flighttest.records.signals.delays import lag_weights

HEIGHT_NOISE = 0.005  # m/s: noise of the height equation; far below any height sensor
LOOSE = 0.01  # rad per step: vanes too slow to show anything
GAIN = 0.01  # expected change of the cost at which the iteration has settled
# expected change below which the equations before a step hold behind it too: a hundredth of a
# standard error
NEAR = 1e-4
FAR = 1000.0  # cost per sample above which the path is no more than a first guess
SCALES = tuple(f"scale.{name}" for name in IMU)
WINDS = ("wind_n", "wind_e", "wind_d")
_DRIVING = {f"bias.{name}": BIAS + i for i, name in enumerate(IMU)} | {
    name: SCALE + i for i, name in enumerate(SCALES)
}
_DRIVING |= {name: WIND + i for i, name in enumerate(WINDS)} | {
    "lag.vanes": LAG
}  # constants that act between the samples
_SIDE = {"beta_vane": 1, "alpha_vane": 2}
_MULTIPLY = ("factor.", "lag.", "delay.")
ITERATIONS = 20


@dataclass(frozen=True)
class Solution:
    """Estimate of the trajectory x (N, n) and the constants c (nc,), with the covariance of c.

    With the equations about it, or those of a last step shorter than a hundredth of a standard
    error; without any behind a longer one.
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
    problem : Problem
    x, c : array (N, n), (nc,)
        Start.
    iterations : int
        Largest number of steps.
    held : sequence of str
        Constants that stay at their start value: the data do not inform them, and their prior
        uncertainty is passed on to the others (Schmidt's "consider" parameters).
    known : NormalEquations, optional
        Those about the start.

    Returns
    -------
    Solution
        ``settled`` when the last step promised to lower the cost (twice the negative log density)
        by less than 0.01, and is taken unseen, or promised less than one, a standard error, and
        brought less than 0.01: a latency that crosses a sample is a kink.

    Raises
    ------
    IdentificationError
        No fraction of a step lowers the cost.
    """
    free = np.array([name not in held for name in problem.constants.names])
    equations, step, settled, near = known or linearise(problem, x, c), 0, False, True
    spare: list[NormalEquations] = []
    while step < iterations and not settled:
        step += 1
        far = equations.cost > FAR * len(
            x
        )  # the readings only start the path: constants that multiply it wait
        moving = (
            free & ~np.array([name.startswith(_MULTIPLY) for name in problem.constants.names])
            if far
            else free
        )
        dx, dc, information = equations.solve(moving)
        gain = -float(np.vdot(equations.gx, dx) + equations.gc @ dc)
        if not far and gain < GAIN:
            x, c, settled, near = step_trajectory(x, dx), c + dc, True, gain < NEAR
            break
        trial, share = _line_search(problem, x, c, dx, dc, equations.cost, gain, spare)
        gained = equations.cost - trial.cost
        if gained < -GAIN and gain > 1.0:
            raise IdentificationError(
                "the reconstruction finds no better path from its start; check signs, units "
                "and positions of the sensors"
            )
        left = trial
        if gained > -GAIN:
            x, c, equations, left = step_trajectory(x, share * dx), c + share * dc, trial, equations
            equations.reuse_elimination(left)
        if left is not known:  # that belongs to the caller
            spare.append(left)
        settled = not far and gain < 1.0 and gained < GAIN
    covariance = _covariance(information, free, problem.constants.covariance)
    return Solution(x, c, covariance, equations.cost, step, settled, equations if near else None)


def step_trajectory(x: np.ndarray, dx: np.ndarray) -> np.ndarray:
    """Return the trajectory after a step: the horizontal velocity turns along with the heading.

    To first order this is x + dx.  Without a compass the heading is free, and a straight step in
    north and east would lengthen the velocity that it only wants to turn.  The vertical velocity
    takes the straight step, as the height does: the stiff equation between the two is linear and
    stays fulfilled.
    """
    after = x + dx
    vn, ve, turn = x[:, 3], x[:, 4], dx[:, 2]
    n, e = (
        vn + dx[:, 3] + ve * turn,
        ve + dx[:, 4] - vn * turn,
    )  # the step less the heading's share of it
    after[:, 3] = n * np.cos(turn) - e * np.sin(turn)
    after[:, 4] = n * np.sin(turn) + e * np.cos(turn)
    return after


def _line_search(
    problem: PathProblem, x, c, dx, dc, cost: float, gain: float, spare: list[NormalEquations]
) -> tuple[NormalEquations, float]:
    """Return the equations at the best of the step's halves, while halving pays; the full step when
    it keeps its promise.
    """
    share, best = 1.0, linearise(problem, step_trajectory(x, dx), c + dc, spare)
    while gain > GAIN and cost - best.cost < 0.25 * gain * share and share > 1e-3:
        trial = linearise(
            problem, step_trajectory(x, share / 2.0 * dx), c + share / 2.0 * dc, spare
        )
        if trial.cost >= best.cost:
            spare.append(trial)
            break
        spare.append(best)
        best, share = trial, share / 2.0
    return best, share


def _covariance(information: np.ndarray, free: np.ndarray, prior: np.ndarray) -> np.ndarray:
    """Return the covariance of the constants; those not free keep their prior one and hand it on."""
    covariance = prior.copy()
    f, h = np.flatnonzero(free), np.flatnonzero(~free)
    if len(f):
        own = invert_covariance(information[np.ix_(f, f)])
        follow = -own @ information[np.ix_(f, h)]
        covariance[np.ix_(f, f)] = own + follow @ prior[np.ix_(h, h)] @ follow.T
        covariance[np.ix_(f, h)] = follow @ prior[np.ix_(h, h)]
        covariance[np.ix_(h, f)] = covariance[np.ix_(f, h)].T
    return covariance


def linearise(
    problem: PathProblem, x: np.ndarray, c: np.ndarray, spare: list[NormalEquations] | None = None
) -> NormalEquations:
    """Return the normal equations of all residuals about a trajectory and constants.

    Parameters
    ----------
    problem : Problem
    x, c : array (N, n), (nc,)
    spare : list of NormalEquations, optional
        Equations of the same problem that nobody needs any more; the last one is taken out and
        written over.
    """
    if spare:
        equations = spare.pop()
        equations.clear()
    else:
        equations = NormalEquations(len(x), problem.states, len(c))
    with equations.sums.collect_groups():
        _path_steps(problem, x, c, equations)
        _gust_steps(problem, x, equations)
        values = states_and_rates(problem, x, c)
        for sensor in problem.sensors:
            r, k, f, J, places, Jc = linearise_sensor(problem, sensor, values, c)
            equations.add_samples(r, k, f, J, places, Jc, 1.0 / sensor.sigma)
    for k in problem.starts:
        weight = 1.0 / problem.start_sigma[: problem.states]
        mean = np.where(
            np.arange(problem.states) < 7, x[k], 0.0
        )  # wide and only against drift: the start itself is free
        equations.add_state(int(k), (x[k] - mean) * weight, weight)
    equations.add_prior(c - problem.constants.mean, problem.constants.precision())
    return equations


def path_surroundings(problem: PathProblem) -> Surroundings:
    """Return gravity and the rate of the Earth along a path."""
    return Surroundings(
        problem.g, problem.g_fall, problem.g_height, *problem.earth, problem.gyro_spin
    )


def driven_path(
    problem: PathProblem,
    x: np.ndarray,
    c: np.ndarray,
    columns: np.ndarray,
    part: slice = slice(None),
) -> DrivenPath:
    """Return a path (N, n) between the instruments, or a part of it, with derivatives by the
    constants at the places `columns`.
    """
    constants = problem.constants
    rates, force, sensed = (
        item(problem, c)[part] for item in (body_rates, specific_force, sensed_force)
    )
    wind = np.array([constants.get(c, name) for name in WINDS])
    weights = (
        lag_weights(constants.get(c, "lag.vanes"), problem.dt)
        if problem.vanes
        else (np.zeros(3), np.zeros(3))
    )
    vanes = Vanes([_SIDE[name] for name in problem.vanes], problem.vane_arms, wind, *weights)
    inputs = [_DRIVING[constants.names[i]] for i in columns]
    blowing = problem.gust is not None and not problem.shown
    unit = Inertial(rates, force, sensed, inertial_gains(problem, c), problem.arm)
    return DrivenPath(
        unit,
        x[part],
        problem.dt,
        path_surroundings(problem),
        inputs,
        vanes,
        blowing,
        _slow(problem.airborne[part]),
    )


def driving_constants(problem: PathProblem, free: np.ndarray | None = None) -> np.ndarray:
    """Return the places of the constants that act between the samples of a path, of those in the
    mask `free` (nc,) if given.
    """
    names = problem.constants.names
    return np.array(
        [i for i, name in enumerate(names) if name in _DRIVING and (free is None or free[i])], int
    )


def _path_steps(
    problem: PathProblem, x: np.ndarray, c: np.ndarray, equations: NormalEquations
) -> None:
    columns = driving_constants(problem)
    sigma = np.empty((len(x) - 1, 7 + len(problem.vanes)))
    sigma[:, :7] = np.append(problem.noise, HEIGHT_NOISE)
    sigma[:, 7:] = np.where(_slow(problem.airborne)[:, None], LOOSE, problem.vane_noise)
    equations.add_path_steps(
        driven_path(problem, x, c, columns), problem.linked[:, None] / sigma, columns
    )


def _slow(airborne: np.ndarray) -> np.ndarray:
    """Return the steps over which vanes hang freely."""
    return ~(airborne[1:] & airborne[:-1])


def _gust_steps(problem: PathProblem, x: np.ndarray, equations: NormalEquations) -> None:
    if problem.gust is None:
        return
    keep = np.exp(-problem.dt / problem.gust_time)
    weight = problem.linked[:, None] / (problem.gust * np.sqrt(1.0 - keep**2))
    gust = x[:, problem.gusts]
    A, B = np.zeros((len(x) - 1, 3, problem.states)), np.zeros((len(x) - 1, 3, problem.states))
    places = np.arange(problem.gusts.start, problem.gusts.stop)
    A[:, np.arange(3), places], B[:, np.arange(3), places] = -keep, 1.0
    equations.add_steps(
        gust[1:] - keep * gust[:-1], A, B, np.zeros(0, int), np.zeros((len(x) - 1, 3, 0)), weight
    )


def reading_positions(
    problem: PathProblem, sensor: Sensor, c: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    """Return for each reading of a sensor the sample before it, k, and the fraction f of the step,
    its delay removed.
    """
    seen = sensor.time - (problem.constants.get(c, sensor.delay) if sensor.delay else 0.0)
    k = np.clip(
        np.searchsorted(problem.time, seen + 1e-9, side="right") - 1, 0, len(problem.time) - 1
    )
    f = (seen - problem.time[k]) / problem.dt
    last = ~np.append(problem.linked, False)  # of its segment: there is no step to go into
    return k, np.where((np.abs(f) < 1e-6) | last[k], 0.0, f)


def states_and_rates(problem: PathProblem, x: np.ndarray, c: np.ndarray) -> np.ndarray:
    """Return states and body rates (N, n + 3)."""
    return np.concatenate([x, body_rates(problem, c)], axis=1)


def _at(k: np.ndarray, values: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Return values (N, n) at k (M, n) and k + 1; of readings as regular as the path without a
    copy.
    """
    last = len(values) - 1
    if len(k) and k[-1] - k[0] == len(k) - 1 and (np.diff(k) == 1).all():
        before = values[k[0] : k[-1] + 1]
        return before, values[k[0] + 1 : k[-1] + 2] if k[-1] < last else np.concatenate(
            [before[1:], values[-1:]]
        )
    return values[k], values[np.minimum(k + 1, last)]


def _between(k: np.ndarray, f: np.ndarray, values: np.ndarray) -> np.ndarray:
    """Return values (N, n) at k + f (M, n)."""
    before, after = _at(k, values)
    return (1.0 - f)[:, None] * before + f[:, None] * after if f.any() else before


def _gyro_errors(
    problem: PathProblem, c: np.ndarray, omega: np.ndarray
) -> Iterator[tuple[str, int, np.ndarray | float]]:
    """Yield the constants behind the body rates, the axis they act on, and the derivative of its
    rate by them.
    """
    gain = inertial_gains(problem, c)
    for kind in ("bias", "scale"):
        for i, axis in enumerate(IMU[:3]):
            if f"{kind}.{axis}" in problem.constants:
                yield (
                    f"{kind}.{axis}",
                    i,
                    -gain[i] * (omega[:, i, None] if kind == "scale" else 1.0),
                )


def linearise_sensor(problem: PathProblem, sensor: Sensor, values: np.ndarray, c: np.ndarray):
    """Return what a sensor shows, linearised at its readings.

    Parameters
    ----------
    problem : Problem
    sensor : Sensor
    values : array (N, n + 3)
        The path, see `moving`.
    c : array (nc,)
        Constants.

    Returns
    -------
    r : array (M, m)
        Model minus reading.
    k, f : array (M,)
        Places of the readings, see `reading_positions`.
    J : array (M, m, n) or (1, m, n)
        Derivative by the state at k + f, of each reading or of all.
    columns : array of int
        The constants involved.
    Jc : array (M, m, columns)
        Derivative by them.
    """
    n = problem.states
    k, f = reading_positions(problem, sensor, c)
    at = _between(k, f, values)
    y, J, names, Jc = sensor.model(sensor, problem, at, c)
    more: list[np.ndarray] = []
    if sensor.delay:
        before, after = _at(k, values)
        step = (after - before)[:, : J.shape[-1]]
        if problem.shown:
            step[:, problem.gusts] = 0.0
        slope = step @ J[0].T if len(J) == 1 else np.einsum("kij,kj->ki", J, step)
        names, more = (*names, sensor.delay), [slope / -problem.dt]
    if (
        J.shape[-1] > n
    ):  # the sensor sees the body rates too, which are known but for the errors of the gyros
        for name, i, slope in _gyro_errors(problem, c, at[:, n:]):
            names = (*names, name)
            more.append(J[..., n + i] * slope)
    if more:
        Jc = np.concatenate([Jc, np.stack(more, axis=-1)], axis=-1)
    return y - sensor.z, k, f, J[..., :n], problem.constants.index(*names), Jc


def sensor_residuals(
    problem: PathProblem, sensor: Sensor, x: np.ndarray, c: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    """Return readings minus model (M, m) of a sensor and the sample each belongs to."""
    k, f = reading_positions(problem, sensor, c)
    at = _between(k, f, states_and_rates(problem, x, c))
    return sensor.z - sensor.model(sensor, problem, at, c)[0], k + (f > 0.5)


def with_gusts(
    problem: PathProblem, x: np.ndarray, sigma: np.ndarray, length: float, shown: bool
) -> tuple[PathProblem, np.ndarray]:
    """Return the problem with gust states of given intensity and scale length, and the trajectory
    with zero gusts.
    """
    n = 7 + len(problem.vanes)
    speed = float(np.median(np.linalg.norm(x[:, VELOCITY], axis=1)))
    sigma_0 = np.concatenate([problem.start_sigma[:n], sigma])
    changed = replace(
        problem, gust=sigma, gust_time=length / max(speed, 10.0), shown=shown, start_sigma=sigma_0
    )
    return changed, np.concatenate([x[:, :n], np.zeros((len(x), 3))], axis=1)
