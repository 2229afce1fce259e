"""Motion of the whole tree from camera markers: one least squares of the record, with splines in
time for base and independent joints.

Position, quaternion and independent angles are splines of fifth degree whose knots stand half a
period of the cut-off apart; their coefficients minimise the squared distances of all markers that
the cameras saw.  Velocities and accelerations are derivatives of the splines; the errors of
everything follow from the one covariance of the coefficients.  A crank whose rocker reverses is not
visible in that frame: the spline carries it across.  The first guess is frame by frame: `poses` of
the base, then joint by joint the best of a grid of angles; for a crank the best path through the
grid at about the flapping frequency, in the sense that its linkage states.  Where the fit settles
away from the markers in a part of the record, it is repeated from a path on which the crank may
turn back there.

References
----------
.. [Grauer2010] Grauer, Ulrich, Hubbard, Pines, Humbert, System identification of an ornithopter aerodynamics model, AIAA 2010-7632, IV.C.
.. [Viterbi1967] Viterbi, Error bounds for convolutional codes and an asymptotically optimum decoding algorithm, IEEE Trans. IT-13, 1967.
"""

from __future__ import annotations

import warnings
from collections.abc import Callable
from contextlib import suppress
from dataclasses import dataclass

import numpy as np
import xarray as xr
from scipy.interpolate import BSpline

from flightmech.axes import matrix_from_quaternion
from flightmech.errors import AeromatchWarning, IdentificationError
from flighttest.special_tests.motion_capture import poses
from flighttest.special_tests.multibody.mechanics import Posture, tree_posture
from flighttest.special_tests.multibody.vehicle import Vehicle

_DEGREE = 5
_UNIT = 1e-3  # weight of the length of the quaternion, which no marker sees
_ROUNDS = 200
_STILL = 1e-8  # square of a step in its own standard errors
_SMALL = 1e-8  # step of what is kept; a crank at the end of a record may move on [m, rad]
_DAMPING = 1e-4  # first of Marquardt, over the diagonal
_LEFT_OUT = 2.0  # periods of the cut-off at each end
_LARGEST = 4000  # unknowns: their covariance is dense
_GRID, _REACH = 72, np.radians(80.0)  # angles of a crank, and how far another joint is looked for
_FASTEST = 2.0  # of a crank over its mean rate
# mean square of the residuals over a period of the cut-off, over the median of the record: 1.3 in
# sound flights
_STRAY = 3.0
# correlation of the residuals of two frames in turn: -0.04 in sound flights, where the splines take
# up a part
_ALIKE = 0.2


@dataclass(frozen=True)
class TreeMotion:
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
        Standard deviation of a coordinate of a marker that the residuals show. [m]
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
        """Positions, velocities and their derivatives as `inertial_loads` takes them."""
        return tree_states(self.y, self.y_dot, self.y_ddot)

    def stderr(
        self, function: Callable[[np.ndarray, np.ndarray, np.ndarray], np.ndarray]
    ) -> np.ndarray:
        """Return standard errors (time, column) of a function of ``y, y_dot, y_ddot`` with columns
        (time, column).
        """
        parts = [self.y, self.y_dot, self.y_ddot]
        size = np.sqrt(np.einsum("tii->ti", self.covariance)).mean(axis=0)
        changes = []
        for place in range(3 * self.y.shape[1]):
            which, column = divmod(place, self.y.shape[1])
            moved = []
            for sign in (1.0, -1.0):
                pushed = [part.copy() for part in parts]
                pushed[which][:, column] += 0.1 * sign * size[place]
                moved.append(function(*pushed))
            changes.append((moved[0] - moved[1]) / (0.2 * size[place]))
        G = np.stack(changes, axis=2)
        return np.sqrt(np.einsum("tci,tij,tcj->tc", G, self.covariance, G))


def tree_states(
    y: np.ndarray, y_dot: np.ndarray, y_ddot: np.ndarray
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Return positions, velocities along axes of the base, and their derivatives; see `TreeMotion`
    and `inertial_loads`.
    """
    q, dq, ddq = y[:, 3:7], y_dot[:, 3:7], y_ddot[:, 3:7]
    square = (q**2).sum(axis=1, keepdims=True)
    growth = 2.0 * (q * dq).sum(axis=1, keepdims=True) / square
    unit = q / np.sqrt(square)
    omega = 2.0 * _vector(q, dq) / square
    omega_dot = 2.0 * _vector(q, ddq) / square - growth * omega
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
        North, east, down [m]; NaN where the cameras did not see a marker.
    cutoff : float, optional
        Frequency up to which there is motion; default that of the cameras of the vehicle. [Hz]

    Raises
    ------
    IdentificationError
        Markers that do not determine the motion, too few or too many frames, a cut-off beyond half
        the frame rate, no convergence.

    Warns
    -----
    AeromatchWarning
        The motion lies away from the markers in a part of the record, or its residuals are not
        those of independent noise: the standard errors do not hold.
    """
    cutoff = vehicle.markers.cutoff if cutoff is None else cutoff
    time = positions["time"].values.astype(float)
    rate = (len(time) - 1) / max(time[-1] - time[0], 1e-12)
    if not 0.0 < cutoff < 0.5 * rate:
        raise IdentificationError(
            f"cut-off {cutoff:g} Hz; it must lie between 0 and half the frame rate, "
            f"{0.5 * rate:g} Hz"
        )
    splines = _Splines(time, cutoff)
    width = 7 + len(vehicle.independent)
    ends = int(np.ceil(_LEFT_OUT / cutoff * rate))
    if len(time) < 2 * ends + 16:
        raise IdentificationError(
            f"{len(time)} frames; with a cut-off of {cutoff:g} Hz at least {2 * ends + 16} "
            f"are needed"
        )
    if splines.count * width > _LARGEST:
        longest = _LARGEST / width / (2.0 * cutoff)
        raise IdentificationError(
            f"a record of {time[-1] - time[0]:.3g} s; at a cut-off of {cutoff:g} Hz cut it "
            f"to {longest:.2g} s at most"
        )
    names = [str(name) for name in positions["marker"].values]
    holder = {marker: name for name, body in vehicle.body.items() for marker in body.markers}
    P = positions.transpose("time", "marker", "axis").values.astype(float)
    markers = [(holder[name], vehicle.body[holder[name]].markers[name]) for name in names]
    seen = np.isfinite(P).all(axis=2)
    use = slice(ends, len(time) - ends)
    freedom = 3 * int(seen.sum()) - splines.count * (
        width - 1
    )  # no marker sees the length of the quaternion
    if freedom <= 0:
        raise IdentificationError(
            f"{3 * int(seen.sum())} coordinates for {splines.count * width} unknowns; lower "
            f"the cut-off or add markers"
        )

    def settled(back: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        guess = splines.through(_first_guess(vehicle, positions, P, markers, time, back))
        return _settled(vehicle, markers, splines, guess, P, seen, use, freedom, cutoff)

    c, e, root = settled(np.zeros(len(time), bool))
    size = max(3, int(np.ceil(rate / cutoff)))
    stray = _stray(e, seen, size)
    if vehicle.linkage and stray.any():
        with suppress(IdentificationError):  # the first one stays
            c_back, e_back, root_back = settled(
                np.convolve(stray, np.ones(2 * size + 1), "same") > 0.0
            )
            if (e_back**2).sum() < (e**2).sum():
                c, e, root = c_back, e_back, root_back
    _warn(e, seen, size, time)
    noise = float(np.sqrt((e[:, :-1] ** 2).sum() / freedom))
    inverse = np.linalg.inv(root)
    covariance = splines.covariance(noise**2 * (inverse.T @ inverse), width, use)
    y, y_dot, y_ddot = (B[use] @ c for B in (splines.value, splines.slope, splines.bend))
    return TreeMotion(vehicle, time[use], y, y_dot, y_ddot, covariance, noise, cutoff)


def _settled(
    vehicle: Vehicle,
    markers: list,
    splines: _Splines,
    c: np.ndarray,
    P: np.ndarray,
    seen: np.ndarray,
    use: slice,
    freedom: int,
    cutoff: float,
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Coefficients at the least squares next to a first guess, residuals there, and the Cholesky
    factor of the normal matrix.
    """
    e, J = _residuals(vehicle, markers, splines.value @ c, P, seen)
    damping = 0.0
    for _ in range(_ROUNDS):
        N, b = splines.normal(J, e)
        try:
            root = np.linalg.cholesky(N)
        except np.linalg.LinAlgError:
            raise IdentificationError(_undetermined(seen, splines.time, cutoff)) from None
        cost = float((e**2).sum())
        # a crank near its dead centre bends the problem: Marquardt's damping where the sum of
        # squares would rise
        while True:
            step = np.linalg.solve(N + damping * np.diag(np.diag(N)), b)
            trial = c + step.reshape(c.shape)
            e_new, J_new = _residuals(vehicle, markers, splines.value @ trial, P, seen)
            if float((e_new**2).sum()) <= cost or float(step @ b) < _STILL * cost / freedom:
                break
            damping = max(10.0 * damping, _DAMPING)
        c, e, J = trial, e_new, J_new
        if (
            float(step @ N @ step) < _STILL * cost / freedom
            or np.abs(splines.value[use] @ step.reshape(c.shape)).max() < _SMALL
        ):
            return c, e, root
        damping = 0.1 * damping if damping > _DAMPING else 0.0
    raise IdentificationError(
        f"the motion did not settle in {_ROUNDS} steps; check markers, joints and branch"
    )


def _stray(e: np.ndarray, seen: np.ndarray, size: int) -> np.ndarray:
    """Frames (time,) whose residuals, over `size` frames about them, are larger than those of the
    record by more than noise can be.
    """
    sums = np.stack([(e[:, :-1] ** 2).sum(axis=1), 3.0 * seen.sum(axis=1)])
    square, count = (np.convolve(row, np.ones(size), "same") for row in sums)
    mean = np.where(count > 0.0, square / np.maximum(count, 1.0), 0.0)
    return mean > _STRAY * np.median(mean[count > 0.0])


def _warn(e: np.ndarray, seen: np.ndarray, size: int, time: np.ndarray) -> None:
    """Warn where the residuals are not those of noise alone, so that the standard errors do not
    hold.
    """
    stray = np.flatnonzero(_stray(e, seen, size))
    if len(stray):
        apart = np.zeros(len(time), bool)
        apart[stray] = True
        far, near = (
            1e3 * np.sqrt((e[rows, :-1] ** 2).sum() / max(3 * int(seen[rows].sum()), 1))
            for rows in (apart, ~apart)
        )
        text = (
            f"from {time[stray[0]]:.3g} to {time[stray[-1]]:.3g} s the motion lies {far:.2g} "
            f"mm from the markers, {near:.2g} mm elsewhere"
        )
        advice = "cut the record there, or check the markers and the sense of the crank"
    else:
        pair = np.repeat(seen[1:] & seen[:-1], 3, axis=1)
        one, other = e[1:, :-1], e[:-1, :-1]
        alike = float(
            (one * other)[pair].sum() / max((0.5 * (one**2 + other**2))[pair].sum(), 1e-300)
        )
        if alike <= _ALIKE:
            return
        text = (
            f"distances of the markers from the motion are alike from frame to frame "
            f"(correlation {alike:.2f}), not noise"
        )
        advice = "raise the cut-off (multiples), or check places of markers and joints"
    warnings.warn(
        f"{text}; its standard errors do not hold: {advice}", AeromatchWarning, stacklevel=3
    )


class _Splines:
    """Splines of fifth degree over a record and their derivatives, as matrices (time, coefficient)."""

    def __init__(self, time: np.ndarray, cutoff: float):

        self.time = time
        pieces = max(1, int(np.ceil((time[-1] - time[0]) * 2.0 * cutoff)))
        inner = np.linspace(time[0], time[-1], pieces + 1)
        knots = np.concatenate([np.full(_DEGREE, time[0]), inner, np.full(_DEGREE, time[-1])])
        self.count = pieces + _DEGREE
        basis = BSpline(knots, np.eye(self.count), _DEGREE)
        self.value, self.slope, self.bend = (basis(time, nu=order) for order in range(3))
        self.start = np.clip(np.searchsorted(inner, time, side="right") - 1, 0, pieces - 1)

    def through(self, y: np.ndarray) -> np.ndarray:
        """Coefficients (coefficient, column) of the least squares through values (time, column)."""
        return np.linalg.lstsq(self.value, y, rcond=None)[0]

    def normal(self, J: np.ndarray, e: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Normal equations of residuals (time, row) with slopes (time, row, column)."""
        width, span = J.shape[2], _DEGREE + 1
        N, b = np.zeros((self.count * width,) * 2), np.zeros(self.count * width)
        products, pushes = np.swapaxes(J, 1, 2) @ J, np.einsum("trc,tr->tc", J, e)
        for t, first in enumerate(self.start):
            B = self.value[t, first : first + span]
            place = slice(first * width, (first + span) * width)
            N[place, place] += np.kron(np.outer(B, B), products[t])
            b[place] += np.kron(B, pushes[t])
        return N, b

    def covariance(self, C: np.ndarray, width: int, use: slice) -> np.ndarray:
        """Covariance (time, 3 width, 3 width) of values and derivatives at one time."""
        span, found = _DEGREE + 1, []
        for t in range(len(self.value))[use]:
            first = self.start[t]
            D = np.array([B[t, first : first + span] for B in (self.value, self.slope, self.bend)])
            block = C[
                first * width : (first + span) * width, first * width : (first + span) * width
            ].reshape(span, width, span, width)
            found.append(np.einsum("ka,aibj,lb->kilj", D, block, D).reshape(3 * width, 3 * width))
        return np.array(found)


def _residuals(
    vehicle: Vehicle, markers: list, y: np.ndarray, P: np.ndarray, seen: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    """Distances of the markers (time, row) and their slopes (time, row, column); the last row is
    the length of the quaternion.
    """
    q = y[:, 3:7]
    square = (q**2).sum(axis=1)
    to_ned = np.swapaxes(matrix_from_quaternion(q / np.sqrt(square)[:, None]), 1, 2)
    tree = tree_posture(vehicle, y[:, 7:])
    rows, slopes = [], []
    turn = (
        2.0 / square[:, None, None] * _vector_matrix(q)
    )  # of a small change of the quaternion, about body axes
    for j, (body, place) in enumerate(markers):
        m = tree.point(body, place)
        J = np.zeros((len(y), 3, y.shape[1]))
        J[:, :, :3] = np.eye(3)
        J[:, :, 3:7] = -to_ned @ _cross(m) @ turn
        J[:, :, 7:] = to_ned @ tree.jacobian(body, m)
        e = P[:, j] - y[:, :3] - np.einsum("tij,tj->ti", to_ned, m)
        rows.append(np.where(seen[:, j, None], e, 0.0))
        slopes.append(np.where(seen[:, j, None, None], J, 0.0))
    length = np.zeros((len(y), 1, y.shape[1]))
    length[:, 0, 3:7] = _UNIT * q
    rows.append(_UNIT * 0.5 * (1.0 - square)[:, None])
    return np.concatenate(rows, axis=1), np.concatenate([*slopes, length], axis=1)


def _first_guess(
    vehicle: Vehicle,
    positions: xr.DataArray,
    P: np.ndarray,
    markers: list,
    time: np.ndarray,
    back: np.ndarray,
) -> np.ndarray:
    """Values (time, column) of the unknowns frame by frame; a crank may turn against its sense in
    the frames `back` (time,).
    """
    base = poses(positions, vehicle.body[vehicle.base].markers)
    good = np.isfinite(base["r"].values).all(axis=1)
    rigid = np.concatenate([base["r"].values, base["q"].values], axis=1)
    rigid = np.stack([np.interp(time, time[good], column[good]) for column in rigid.T], axis=1)
    unit = rigid[:, 3:] / np.linalg.norm(rigid[:, 3:], axis=1, keepdims=True)
    inside = np.einsum(
        "tij,tmj->tmi", matrix_from_quaternion(unit), P - rigid[:, None, :3]
    )  # markers in axes of the base
    theta = np.zeros((len(time), len(vehicle.independent)))
    cranks = {linkage.crank: linkage.turns for linkage in vehicle.linkage.values()}
    for k, name in enumerate(vehicle.independent):
        grid = (
            np.linspace(0.0, 2.0 * np.pi, _GRID, endpoint=False)
            if name in cranks
            else np.linspace(-_REACH, _REACH, _GRID)
        )
        trial = np.broadcast_to(theta[:, None], (len(time), _GRID, theta.shape[1])).copy()
        trial[:, :, k] = grid
        tree = tree_posture(vehicle, trial)
        cost = np.zeros((len(time), _GRID))
        for j, (body, place) in enumerate(markers):
            if k in _sources(tree, body):
                cost += np.nan_to_num(
                    ((inside[:, None, j] - tree.point(body, place)) ** 2).sum(axis=2)
                )
        if name in cranks:
            rate = (
                2.0
                * np.pi
                * vehicle.cameras.flapping_frequency
                * (time[-1] - time[0])
                / (len(time) - 1)
            )
            turns = cranks[name]
            theta[:, k] = turns * _path(
                np.roll(cost[:, ::-1], 1, axis=1) if turns < 0 else cost, rate, back
            )  # angle k of the grid is minus angle -k
        else:
            theta[:, k] = grid[np.argmin(cost, axis=1)]
    return np.concatenate([rigid, theta], axis=1)


def _sources(tree: Posture, body: str) -> set[int]:
    """Independent joints that move a body."""
    found, name = set(), body
    while name != tree.vehicle.base:
        found.add(int(tree.joints.source[tree.vehicle.joints.index(name)]))
        parent = tree.vehicle.body[name].parent
        assert parent is not None  # of a joint
        name = parent
    return found


def _path(cost: np.ndarray, rate: float, back: np.ndarray) -> np.ndarray:
    """The angles of a crank that turns on, in frames `back` (time,) also back, by the cheapest path
    through the grid.

    `rate` is the mean turn of a frame. [rad]
    """
    step = 2.0 * np.pi / _GRID
    most = max(2, int(np.ceil(_FASTEST * rate / step)))
    scale = max(float(np.median(cost.min(axis=1))), 1e-12)
    moves = np.arange(-most, most + 1)
    price = 0.5 * (moves * step - rate) ** 2 / max(rate, step) ** 2
    total, taken = cost[0] / scale, []
    for now, either in zip(cost[1:], back[1:], strict=True):
        first = 0 if either else most
        options = np.stack(
            [np.roll(total, k) + own for k, own in zip(moves[first:], price[first:], strict=True)]
        )
        best = options.argmin(axis=0)
        taken.append(moves[first:][best])
        total = options[best, np.arange(_GRID)] + now / scale
    place, turns = int(total.argmin()), [0]
    for move in reversed(taken):
        turns.append(int(move[place]))
        place = (place - turns[-1]) % _GRID
    return step * (place + np.cumsum([0, *turns[:0:-1]]))


def _undetermined(seen: np.ndarray, time: np.ndarray, cutoff: float) -> str:
    hidden = np.flatnonzero(seen.sum(axis=1) < 3)
    where = (
        f"; fewer than three markers were seen from {time[hidden[0]]:g} to {time[hidden[-1]]:g} s"
        if len(hidden)
        else ""
    )
    return (
        f"the markers do not determine the motion at a cut-off of {cutoff:g} Hz{where}; every "
        f"independent joint needs markers that it moves"
    )


def _vector(q: np.ndarray, rate: np.ndarray) -> np.ndarray:
    """Vector part of conj(q) rate."""
    return np.einsum("tij,tj->ti", _vector_matrix(q), rate)


def _vector_matrix(q: np.ndarray) -> np.ndarray:
    """Matrix (time, 3, 4) of the vector part of conj(q) times a quaternion."""
    s, u = q[:, 0], q[:, 1:]
    found = np.empty((len(q), 3, 4))
    found[:, :, 0] = -u
    found[:, :, 1:] = s[:, None, None] * np.eye(3) - _cross(u)
    return found


def _cross(v: np.ndarray) -> np.ndarray:
    """Matrices (time, 3, 3) of the cross product."""
    out = np.zeros((len(v), 3, 3))
    out[:, 0, 1], out[:, 0, 2], out[:, 1, 2] = -v[:, 2], v[:, 1], -v[:, 0]
    return out - np.swapaxes(out, 1, 2)
