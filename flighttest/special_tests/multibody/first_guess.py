"""First guess of the motion of a tree, frame by frame.

The base follows from its own markers. Each independent joint follows from the best of a grid of
angles, in the order of the tree. A crank follows the best path through its grid at about the
flapping frequency, in the sense of rotation of its linkage.

References
----------
.. [Viterbi1967] Viterbi, Error bounds for convolutional codes and an asymptotically optimum
   decoding algorithm, IEEE Trans. IT-13, 1967.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
import xarray as xr

from flightmech.axes import matrix_from_quaternion
from flighttest.special_tests.marker_poses import poses
from flighttest.special_tests.multibody.joints import Position
from flighttest.special_tests.multibody.mechanics import Posture, tree_posture
from flighttest.special_tests.multibody.vehicle import Vehicle

# Number of angles of a grid, and largest angle of a joint that is not a crank [rad].
_GRID, _REACH = 72, np.radians(80.0)
# Largest rate of a crank over its mean rate.
_FASTEST = 2.0

BodyMarker = tuple[str, Position]
"""Body of a marker, and the position of the marker in axes of the body [m]."""


def guess_motion(
    vehicle: Vehicle,
    positions: xr.DataArray,
    markers: Sequence[BodyMarker],
    *,
    backward: np.ndarray,
) -> np.ndarray:
    """Return the unknowns frame by frame (time, column).

    Parameters
    ----------
    vehicle : Vehicle
    positions : DataArray (time, marker, axis)
        North, east, down [m].
    markers : sequence of (str, position)
        Body and position of each marker of `positions`.
    backward : array of bool (time,)
        Frames in which a crank may turn against its sense.

    Returns
    -------
    array (time, 7 + independent)
        Position [m] and quaternion of the base, angles of the independent joints [rad].
    """
    P = positions.transpose("time", "marker", "axis").values.astype(float)
    time = positions["time"].values.astype(float)
    rigid = _interpolate_base(vehicle, positions, time)
    # markers in axes of the base
    unit = rigid[:, 3:] / np.linalg.norm(rigid[:, 3:], axis=1, keepdims=True)
    to_base = matrix_from_quaternion(unit)
    inside = np.einsum("tij,tmj->tmi", to_base, P - rigid[:, None, :3])
    # mean turn of a crank from frame to frame [rad]
    frames = (time[-1] - time[0]) / (len(time) - 1)
    rate = 2.0 * np.pi * vehicle.cameras.flapping_frequency * frames
    theta = np.zeros((len(time), len(vehicle.independent)))
    senses = {linkage.crank: linkage.turns for linkage in vehicle.linkage.values()}
    for k, name in enumerate(vehicle.independent):
        if name not in senses:
            grid = np.linspace(-_REACH, _REACH, _GRID)
            cost = _grid_cost(vehicle, markers, inside, theta=theta, k=k, grid=grid)
            theta[:, k] = grid[np.argmin(cost, axis=1)]
            continue
        grid = np.linspace(0.0, 2.0 * np.pi, _GRID, endpoint=False)
        cost = _grid_cost(vehicle, markers, inside, theta=theta, k=k, grid=grid)
        if senses[name] < 0:
            # angle k of the grid is minus angle -k: the reversed grid turns forward
            cost = np.roll(cost[:, ::-1], 1, axis=1)
        theta[:, k] = senses[name] * _cheapest_path(cost, rate, backward)
    return np.concatenate([rigid, theta], axis=1)


def _interpolate_base(vehicle: Vehicle, positions: xr.DataArray, time: np.ndarray) -> np.ndarray:
    """Return position and quaternion of the base (time, 7), interpolated where it is not seen."""
    base = poses(positions, vehicle.body[vehicle.base].markers)
    is_seen = np.isfinite(base["r"].values).all(axis=1)
    rigid = np.concatenate([base["r"].values, base["q"].values], axis=1)
    columns = [np.interp(time, time[is_seen], column[is_seen]) for column in rigid.T]
    return np.stack(columns, axis=1)


def _grid_cost(
    vehicle: Vehicle,
    markers: Sequence[BodyMarker],
    inside: np.ndarray,
    *,
    theta: np.ndarray,
    k: int,
    grid: np.ndarray,
) -> np.ndarray:
    """Return squared distances of the markers that joint `k` moves, (time, angle of the grid)."""
    frames = len(theta)
    trial = np.broadcast_to(theta[:, None], (frames, len(grid), theta.shape[1])).copy()
    trial[:, :, k] = grid
    tree = tree_posture(vehicle, trial)
    cost = np.zeros((frames, len(grid)))
    for j, (body, position) in enumerate(markers):
        if k in _moving_joints(tree, body):
            distance = inside[:, None, j] - tree.point(body, position)
            # a marker that is not seen has no cost
            cost += np.nan_to_num((distance**2).sum(axis=2))
    return cost


def _moving_joints(tree: Posture, body: str) -> set[int]:
    """Return the independent joints that move a body."""
    joints, name = set(), body
    while name != tree.vehicle.base:
        joints.add(int(tree.joints.source[tree.vehicle.joints.index(name)]))
        parent = tree.vehicle.body[name].parent
        # every body except the base has a parent
        assert parent is not None
        name = parent
    return joints


def _cheapest_path(cost: np.ndarray, rate: float, backward: np.ndarray) -> np.ndarray:
    """Return the angles of a crank (time,) by the cheapest path through the grid [Viterbi1967].

    The crank turns forward, and in the frames `backward` also backward. `rate` is the mean turn
    from frame to frame. [rad]
    """
    step = 2.0 * np.pi / _GRID
    most = max(2, int(np.ceil(_FASTEST * rate / step)))
    scale = max(float(np.median(cost.min(axis=1))), 1e-12)
    # possible moves from frame to frame in steps of the grid, and their prices by deviation from
    # the mean rate
    moves = np.arange(-most, most + 1)
    prices = 0.5 * (moves * step - rate) ** 2 / max(rate, step) ** 2
    total, best_moves = cost[0] / scale, []
    for frame_cost, may_reverse in zip(cost[1:], backward[1:], strict=True):
        first = 0 if may_reverse else most
        # cheapest path to each angle of the grid, by its last move
        options = np.stack(
            [
                np.roll(total, move) + price
                for move, price in zip(moves[first:], prices[first:], strict=True)
            ]
        )
        best = options.argmin(axis=0)
        best_moves.append(moves[first:][best])
        total = options[best, np.arange(_GRID)] + frame_cost / scale
    # trace the cheapest path back from its last angle
    node, turns = int(total.argmin()), [0]
    for move in reversed(best_moves):
        turns.append(int(move[node]))
        node = (node - turns[-1]) % _GRID
    return step * (node + np.cumsum([0, *turns[:0:-1]]))
