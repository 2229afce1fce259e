"""Motion of a tree of bodies from camera markers, by one least squares over the record.

Position, quaternion and independent angles are splines of fifth degree with knots half a period of
the cut-off apart. Their coefficients minimise the squared distances of all visible markers.
Velocities and accelerations are derivatives of the splines. All standard errors follow from the
covariance of the coefficients. A crank at the dead centre of its rocker is not visible in that
frame; the spline connects the frames around it.

The first guess is frame by frame (`first_guess`). If the fit is away from the markers in a part of
the record, it is repeated from a path on which the crank may turn back there.

References
----------
.. [Grauer2010] Grauer, Ulrich, Hubbard, Pines, Humbert, System identification of an ornithopter
   aerodynamics model, AIAA 2010-7632, IV.C.
"""

from __future__ import annotations

import warnings
from collections.abc import Callable
from contextlib import suppress
from dataclasses import dataclass

import numpy as np
import xarray as xr

from flightmech.axes import matrix_from_quaternion
from flightmech.errors import AeromatchWarning, IdentificationError
from flightmech.quantities import time_text
from flightmech.short_text import ShortText
from flighttest.special_tests.marker_poses import cross_matrices
from flighttest.special_tests.multibody.first_guess import BodyMarker, guess_motion
from flighttest.special_tests.multibody.mechanics import tree_posture
from flighttest.special_tests.multibody.splines import RecordSplines
from flighttest.special_tests.multibody.vehicle import Vehicle

# Weight of the length of the quaternion, which the markers do not determine.
_UNIT = 1e-3
# Largest number of steps of the search.
_ROUNDS = 200
# Square of a step in units of its own standard errors at which the search ends.
_STILL = 1e-8
# Change of the motion at which the search ends [m, rad]. A crank at the end of a record, outside
# the part that is used, may still change.
_SMALL = 1e-8
# First damping of Marquardt, over the diagonal.
_DAMPING = 1e-4
# Periods of the cut-off that are omitted at each end.
_LEFT_OUT = 2.0
# Largest number of unknowns, because their covariance is dense.
_LARGEST = 4000
# Mean square of the residuals over a period of the cut-off, over the median of the record. It is
# 1.3 in sound flights.
_STRAY = 3.0
# Correlation of the residuals of two consecutive frames. It is -0.04 in sound flights, where the
# splines follow a part of the noise.
_ALIKE = 0.2
# Change of a state for a derivative, in its standard errors.
_DIFFERENCE = 0.1


@dataclass(frozen=True)
class TreeMotion(ShortText):
    """Motion of a tree.

    Attributes
    ----------
    vehicle : Vehicle
    time : array (time,)
        Without two periods of the cut-off at both ends. [s]
    y, y_dot, y_ddot : array (time, 7 + independent)
        North, east, down of the origin of the base [m], quaternion scalar first, not of unit
        length, independent angles [rad], and their derivatives.
    covariance : array (time, 3 (7 + independent), 3 (7 + independent))
        Of ``y, y_dot, y_ddot`` at one time.
    noise : float
        Standard deviation of a coordinate of a marker, from the residuals. [m]
    cutoff : float
        [Hz]
    """

    vehicle: Vehicle
    time: np.ndarray
    y: np.ndarray
    y_dot: np.ndarray
    y_ddot: np.ndarray
    covariance: np.ndarray
    noise: float
    cutoff: float

    @property
    def states(self) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Positions, velocities and their derivatives, as arguments of `inertial_loads`."""
        return tree_states(self.y, self.y_dot, self.y_ddot)

    def stderr(
        self, function: Callable[[np.ndarray, np.ndarray, np.ndarray], np.ndarray]
    ) -> np.ndarray:
        """Return standard errors (time, column) of a function of ``y, y_dot, y_ddot``.

        The function returns columns (time, column).
        """
        states = [self.y, self.y_dot, self.y_ddot]
        width = self.y.shape[1]
        size = np.sqrt(np.einsum("tii->ti", self.covariance)).mean(axis=0)
        # central differences with respect to the states in the order of the covariance
        slopes = []
        for k in range(3 * width):
            order, column = divmod(k, width)
            ends = []
            for sign in (1.0, -1.0):
                changed = [state.copy() for state in states]
                changed[order][:, column] += _DIFFERENCE * sign * size[k]
                ends.append(function(*changed))
            slopes.append((ends[0] - ends[1]) / (2.0 * _DIFFERENCE * size[k]))
        G = np.stack(slopes, axis=2)
        return np.sqrt(np.einsum("tci,tij,tcj->tc", G, self.covariance, G))


def tree_states(
    y: np.ndarray, y_dot: np.ndarray, y_ddot: np.ndarray
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Return positions, velocities along axes of the base, and their derivatives.

    The arguments are those of `TreeMotion`, the results those of `inertial_loads`.
    """
    # The quaternion has no unit length: rates of the unit quaternion q/|q| are
    # omega = 2 vec(conj(q) q') / |q|^2, and |q|^2 grows at the rate 2 q q'.
    q, dq, ddq = y[:, 3:7], y_dot[:, 3:7], y_ddot[:, 3:7]
    square = (q**2).sum(axis=1, keepdims=True)
    growth = 2.0 * (q * dq).sum(axis=1, keepdims=True) / square
    unit = q / np.sqrt(square)
    omega = 2.0 * _vector(q, dq) / square
    omega_dot = 2.0 * _vector(q, ddq) / square - growth * omega
    # velocity along axes of the base; its derivative has the part -omega x nu of turning axes
    R = matrix_from_quaternion(unit)
    nu = np.einsum("tij,tj->ti", R, y_dot[:, :3])
    nu_dot = np.einsum("tij,tj->ti", R, y_ddot[:, :3]) - np.cross(omega, nu)
    p = np.concatenate([y[:, :3], unit, y[:, 7:]], axis=1)
    return (
        p,
        np.concatenate([nu, omega, y_dot[:, 7:]], axis=1),
        np.concatenate([nu_dot, omega_dot, y_ddot[:, 7:]], axis=1),
    )


def fit_tree_motion(
    vehicle: Vehicle, positions: xr.DataArray, cutoff: float | None = None
) -> TreeMotion:
    """Return the motion of a vehicle from the positions of its markers.

    Parameters
    ----------
    vehicle : Vehicle
    positions : DataArray (time, marker, axis)
        North, east, down [m]; NaN if the cameras do not see a marker.
    cutoff : float, optional
        Highest frequency of the motion; by default that of the cameras of the vehicle. [Hz]

    Raises
    ------
    IdentificationError
        The markers do not determine the motion, the frames are too few or too many, the cut-off is
        above half the frame rate, or the search does not converge.

    Warns
    -----
    AeromatchWarning
        The motion is away from the markers in a part of the record, or its residuals are not
        independent noise.  The standard errors are then not valid.
    """
    if cutoff is None:
        cutoff = vehicle.markers.cutoff
    time = positions["time"].values.astype(float)
    rate = (len(time) - 1) / max(time[-1] - time[0], 1e-12)
    problem = _MarkerProblem(vehicle, positions, cutoff=cutoff, rate=rate)

    solution = problem.minimise(np.zeros(len(time), bool))
    size = max(3, int(np.ceil(rate / cutoff)))
    stray = _find_stray(solution.residuals, problem.seen, size)
    if vehicle.linkage and stray.any():
        # the crank may turn back near the frames that are away from their markers
        backward = np.convolve(stray, np.ones(2 * size + 1), "same") > 0.0
        # if the second search does not converge, the first solution stays
        with suppress(IdentificationError):
            second = problem.minimise(backward)
            if (second.residuals**2).sum() < (solution.residuals**2).sum():
                solution = second
    _warn_of_residuals(solution.residuals, problem.seen, size, time=time)
    return problem.motion_of(solution)


@dataclass(frozen=True)
class _Solution:
    """Coefficients at the least squares, residuals, and Cholesky factor of the normal matrix."""

    coefficients: np.ndarray
    residuals: np.ndarray
    root: np.ndarray


class _MarkerProblem:
    """Least squares of the markers of one record."""

    def __init__(self, vehicle: Vehicle, positions: xr.DataArray, *, cutoff: float, rate: float):
        time = positions["time"].values.astype(float)
        if not 0.0 < cutoff < 0.5 * rate:
            raise IdentificationError(
                f"cut-off {cutoff:g} Hz; it must lie between 0 and half the frame rate, "
                f"{0.5 * rate:g} Hz"
            )
        self.vehicle, self.positions, self.cutoff = vehicle, positions, cutoff
        self.splines = RecordSplines(time, cutoff)
        self.width = 7 + len(vehicle.independent)
        self._check_length(time, rate)
        ends = int(np.ceil(_LEFT_OUT / cutoff * rate))
        self.use = slice(ends, len(time) - ends)
        self.P = positions.transpose("time", "marker", "axis").values.astype(float)
        self.seen = np.isfinite(self.P).all(axis=2)
        self.markers: list[BodyMarker] = []
        bodies = {}
        for name, body in vehicle.body.items():
            for marker in body.markers:
                bodies[marker] = name
        for marker in map(str, positions["marker"].values):
            self.markers.append((bodies[marker], vehicle.body[bodies[marker]].markers[marker]))
        # the markers do not determine the length of the quaternion
        coordinates = 3 * int(self.seen.sum())
        self.freedom = coordinates - self.splines.count * (self.width - 1)
        if self.freedom <= 0:
            raise IdentificationError(
                f"{coordinates} coordinates for {self.splines.count * self.width} unknowns; lower "
                "the cut-off or add markers"
            )

    def _check_length(self, time: np.ndarray, rate: float) -> None:
        least = 2 * int(np.ceil(_LEFT_OUT / self.cutoff * rate)) + 16
        if len(time) < least:
            raise IdentificationError(
                f"{len(time)} frames; with a cut-off of {self.cutoff:g} Hz at least {least} are "
                "needed"
            )
        if self.splines.count * self.width > _LARGEST:
            longest = _LARGEST / self.width / (2.0 * self.cutoff)
            raise IdentificationError(
                f"a record of {time[-1] - time[0]:.3g} s; at a cut-off of {self.cutoff:g} Hz cut "
                f"it to {longest:.2g} s at most"
            )

    def minimise(self, backward: np.ndarray) -> _Solution:
        """Return the least squares nearest to a first guess.

        A crank may turn against its sense in the frames `backward` (time,).
        """
        guess = guess_motion(self.vehicle, self.positions, self.markers, backward=backward)
        splines = self.splines
        c = splines.through(guess)
        e, J = self.residuals(splines.value @ c)
        damping = 0.0
        for _ in range(_ROUNDS):
            N, b = splines.normal(J, e)
            try:
                root = np.linalg.cholesky(N)
            except np.linalg.LinAlgError:
                raise IdentificationError(self._describe_undetermined()) from None
            still = _STILL * float((e**2).sum()) / self.freedom
            step, e, J, damping = self._damped_step(c, e, N=N, b=b, damping=damping, still=still)
            change = step.reshape(c.shape)
            c = c + change
            if float(step @ N @ step) < still:
                return _Solution(c, e, root)
            if np.abs(splines.value[self.use] @ change).max() < _SMALL:
                return _Solution(c, e, root)
            if damping > _DAMPING:
                damping = 0.1 * damping
            else:
                damping = 0.0
        raise IdentificationError(
            f"the motion did not settle in {_ROUNDS} steps; check markers, joints and branch"
        )

    def _damped_step(
        self,
        c: np.ndarray,
        e: np.ndarray,
        *,
        N: np.ndarray,
        b: np.ndarray,
        damping: float,
        still: float,
    ) -> tuple[np.ndarray, np.ndarray, np.ndarray, float]:
        """Return a step that does not increase the sum of squares.

        A crank near its dead centre makes the problem nonlinear. Marquardt's damping grows until
        the sum of squares does not increase, or until the expected gain is negligible.

        Returns
        -------
        step, residuals, slopes, damping
        """
        cost = float((e**2).sum())
        while True:
            step = np.linalg.solve(N + damping * np.diag(np.diag(N)), b)
            trial = c + step.reshape(c.shape)
            e_new, J_new = self.residuals(self.splines.value @ trial)
            if float((e_new**2).sum()) <= cost or float(step @ b) < still:
                return step, e_new, J_new, damping
            damping = max(10.0 * damping, _DAMPING)

    def residuals(self, y: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Return distances of the markers (time, row) and their slopes (time, row, column).

        The last row is the length of the quaternion.
        """
        q = y[:, 3:7]
        square = (q**2).sum(axis=1)
        to_ned = np.swapaxes(matrix_from_quaternion(q / np.sqrt(square)[:, None]), 1, 2)
        tree = tree_posture(self.vehicle, y[:, 7:])
        # turn about body axes for a small change of the quaternion
        turn = 2.0 / square[:, None, None] * _vector_matrix(q)
        rows, slopes = [], []
        for j, (body, position) in enumerate(self.markers):
            m = tree.point(body, position)
            J = np.zeros((len(y), 3, y.shape[1]))
            J[:, :, :3] = np.eye(3)
            J[:, :, 3:7] = -to_ned @ cross_matrices(m) @ turn
            J[:, :, 7:] = to_ned @ tree.jacobian(body, m)
            e = self.P[:, j] - y[:, :3] - np.einsum("tij,tj->ti", to_ned, m)
            is_seen = self.seen[:, j, None]
            rows.append(np.where(is_seen, e, 0.0))
            slopes.append(np.where(is_seen[:, :, None], J, 0.0))
        length = np.zeros((len(y), 1, y.shape[1]))
        length[:, 0, 3:7] = _UNIT * q
        rows.append(_UNIT * 0.5 * (1.0 - square)[:, None])
        return np.concatenate(rows, axis=1), np.concatenate([*slopes, length], axis=1)

    def motion_of(self, solution: _Solution) -> TreeMotion:
        """Return motion and covariance of a solution, without the ends of the record."""
        splines, use = self.splines, self.use
        e = solution.residuals
        noise = float(np.sqrt((e[:, :-1] ** 2).sum() / self.freedom))
        inverse = np.linalg.inv(solution.root)
        covariance = splines.covariance(noise**2 * (inverse.T @ inverse), self.width, use)
        return TreeMotion(
            vehicle=self.vehicle,
            time=splines.time[use],
            y=splines.value[use] @ solution.coefficients,
            y_dot=splines.slope[use] @ solution.coefficients,
            y_ddot=splines.bend[use] @ solution.coefficients,
            covariance=covariance,
            noise=noise,
            cutoff=self.cutoff,
        )

    def _describe_undetermined(self) -> str:
        time = self.splines.time
        text = f"the markers do not determine the motion at a cut-off of {self.cutoff:g} Hz"
        hidden = np.flatnonzero(self.seen.sum(axis=1) < 3)
        if len(hidden):
            first, last = time[hidden[0]], time[hidden[-1]]
            text += (
                f"; fewer than three markers were seen from {time_text(first)} to "
                f"{time_text(last)} s"
            )
        return f"{text}; every independent joint needs markers that it moves"


def _find_stray(e: np.ndarray, seen: np.ndarray, size: int) -> np.ndarray:
    """Return the frames (time,) whose residuals, over `size` frames, are too large for noise."""
    window = np.ones(size)
    square = np.convolve((e[:, :-1] ** 2).sum(axis=1), window, "same")
    count = np.convolve(3.0 * seen.sum(axis=1), window, "same")
    mean = np.where(count > 0.0, square / np.maximum(count, 1.0), 0.0)
    return mean > _STRAY * np.median(mean[count > 0.0])


def _warn_of_residuals(e: np.ndarray, seen: np.ndarray, size: int, *, time: np.ndarray) -> None:
    """Warn if the residuals are not noise alone, so that the standard errors are not valid."""
    stray = np.flatnonzero(_find_stray(e, seen, size))
    if len(stray):
        is_stray = np.zeros(len(time), bool)
        is_stray[stray] = True
        far, near = _mean_distance(e, seen, is_stray), _mean_distance(e, seen, ~is_stray)
        text = (
            f"from {time_text(time[stray[0]], 3)} to {time_text(time[stray[-1]], 3)} s the motion "
            f"lies {far:.2g} mm from the markers, {near:.2g} mm elsewhere"
        )
        advice = "cut the record there, or check the markers and the sense of the crank"
    else:
        correlation = _correlate_frames(e, seen)
        if correlation <= _ALIKE:
            return
        text = (
            f"distances of the markers from the motion are alike from frame to frame "
            f"(correlation {correlation:.2f}), not noise"
        )
        advice = "raise the cut-off (multiples), or check places of markers and joints"
    warnings.warn(
        f"{text}; its standard errors do not hold: {advice}", AeromatchWarning, stacklevel=3
    )


def _mean_distance(e: np.ndarray, seen: np.ndarray, frames: np.ndarray) -> float:
    """Return the rms of a coordinate of the residuals in some frames. [mm]"""
    count = max(3 * int(seen[frames].sum()), 1)
    return 1e3 * np.sqrt((e[frames, :-1] ** 2).sum() / count)


def _correlate_frames(e: np.ndarray, seen: np.ndarray) -> float:
    """Return the correlation of the residuals of consecutive frames."""
    both_seen = np.repeat(seen[1:] & seen[:-1], 3, axis=1)
    following, preceding = e[1:, :-1], e[:-1, :-1]
    products = (following * preceding)[both_seen].sum()
    squares = (0.5 * (following**2 + preceding**2))[both_seen].sum()
    return float(products / max(squares, 1e-300))


def _vector(q: np.ndarray, rate: np.ndarray) -> np.ndarray:
    """Return the vector part of conj(q) rate."""
    return np.einsum("tij,tj->ti", _vector_matrix(q), rate)


def _vector_matrix(q: np.ndarray) -> np.ndarray:
    """Return the matrix (time, 3, 4) of the vector part of conj(q) times a quaternion."""
    s, u = q[:, 0], q[:, 1:]
    matrix = np.empty((len(q), 3, 4))
    matrix[:, :, 0] = -u
    matrix[:, :, 1:] = s[:, None, None] * np.eye(3) - cross_matrices(u)
    return matrix
