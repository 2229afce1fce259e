"""What the kernel adds of the steps of a flight path, written out in NumPy with the kinematics of
the flight path.
"""

import numpy as np

from flightmech.simulation.driven_path import LAG, SCALE, WIND
from flighttest.reconstruction.dynamics.kinematics import (
    body_rates_from_angles,
    cross_product_matrix,
    ned_to_body,
    rate_matrix,
)


def over_steps(values, linked):
    """Return the mean over each step (N-1, m) of what is a cubic between the samples of a
    window.
    """
    second = np.zeros_like(values)
    inner = np.concatenate([[False], linked[1:] & linked[:-1], [False]])
    second[1:-1] = np.diff(values, 2, axis=0)
    second[~inner] = 0.0
    bend = (second[1:] + second[:-1]) / np.maximum(inner[1:].astype(int) + inner[:-1], 1)[:, None]
    return (values[1:] + values[:-1]) / 2.0 - bend / 12.0


def path_steps(path, linked):
    """Return residuals (N-1, rows) and their derivatives by the states before and after (N-1, rows,
    q) and by the inputs (N-1, rows, p).
    """
    rows = 7 + len(path.vanes.side)
    r = np.zeros((path.samples - 1, rows))
    A, B = (np.zeros((path.samples - 1, rows, rows + 3 * path.gusts)) for _ in range(2))
    J = np.zeros((path.samples - 1, rows, len(path.inputs)))
    r[:, :7], A[:, :7, :7], B[:, :7, :7] = inertial_steps(path, linked)
    by = by_inputs(path)
    J[:, :6] = -(by[1:] + by[:-1]) / 2.0
    if path.vanes.side:
        add_vanes(path, r, A, B, J)
    return r, A, B, J


def inertial_steps(path, linked):
    """Return residuals (N-1, 7) and their derivatives by the first seven states before and after
    (N-1, 7, 7).
    """
    x, dt, around = path.x, path.dt, path.around
    mean_rates, mean_force = (
        over_steps(path.inertial.rates, linked),
        over_steps(path.inertial.force, linked),
    )
    difference, middle = np.diff(x[:, :7], axis=0) / dt, (x[1:, :7] + x[:-1, :7]) / 2.0
    r = np.zeros((len(middle), 7))
    from_angles, change = body_rates_from_angles(middle[:, :3], difference[:, :3])
    v = middle[:, 3:6]
    carried = v @ around.transport.T
    needed = difference[:, 3:6] + np.cross(2.0 * around.spin + carried, v)
    needed[:, 2] -= around.gravity - around.fall * (middle[:, 6] - around.level)
    U, turn, Rt = ned_to_body(middle[:, :3], needed)
    r[:, :3] = from_angles + (Rt @ (carried + around.sensed)[..., None])[..., 0] - mean_rates
    r[:, 3:6] = U - mean_force
    r[:, 6] = difference[:, 6] + middle[:, 5]
    # half of the derivative with respect to the middle, and the one with respect to the difference
    half, slope = np.zeros((len(middle), 7, 7)), np.zeros((len(middle), 7, 7))
    half[:, :3, :3] = change / 2.0
    slope[:, :3, :3] = rate_matrix(middle[:, :3]) / dt
    half[:, 3:6, :3] = turn / 2.0
    slope[:, 3:6, 3:6] = Rt / dt
    half[:, 3:6, 6] = around.fall / 2.0 * Rt[:, :, 2]
    half[:, 6, 5] = 0.5
    slope[:, 6, 6] = 1.0 / dt
    return r, half - slope, half + slope


def by_inputs(path):
    """Return the derivatives of rates and specific force by the inputs (N, 6, p)."""
    unit, by = path.inertial, np.zeros((path.samples, 6, len(path.inputs)))
    lever = cross_product_matrix(np.cross(unit.rates, unit.arm)) + cross_product_matrix(
        unit.rates
    ) @ cross_product_matrix(unit.arm)
    read = np.concatenate([unit.rates, unit.sensed], axis=1)
    for j, item in enumerate(path.inputs):
        if item < WIND:
            i = item % SCALE
            by[:, i, j] = -unit.gain[i] * (read[:, i] if item >= SCALE else 1.0)
            if i < 3:
                by[:, 3:, j] = lever[:, :, i] * by[:, i, j, None]
    return by


def add_vanes(path, r, A, B, J):
    """Fill the rows of the vanes."""
    (E, c0, c1), slope, slow = path.vanes.lag, path.vanes.lag_slope, path.slow.astype(bool)
    for i in range(len(path.vanes.side)):
        own = 7 + i
        angle, by_state, by_input = sight(path, i)
        lagged = path.x[:, own]
        r[:, own] = lagged[1:] - E * lagged[:-1] - c0 * angle[:-1] - c1 * angle[1:]
        A[:, own], B[:, own] = -c0 * by_state[:-1], -c1 * by_state[1:]
        A[:, own, own], B[:, own, own] = -E, 1.0
        J[:, own] = -c0 * by_input[:-1] - c1 * by_input[1:]
        if LAG in path.inputs:
            J[:, own, path.inputs.index(LAG)] = (
                -slope[0] * lagged[:-1] - slope[1] * angle[:-1] - slope[2] * angle[1:]
            )
        r[slow, own], A[slow, own], B[slow, own], J[slow, own] = (
            np.diff(lagged)[slow],
            0.0,
            0.0,
            0.0,
        )
        A[slow, own, own], B[slow, own, own] = -1.0, 1.0


def sight(path, i):
    """Return the angle that a vane without lag would see (N,), and its derivatives by state (N, q)
    and inputs (N, p).
    """
    gusts = slice(7 + len(path.vanes.side), 10 + len(path.vanes.side))
    air = path.x[:, 3:6] - path.vanes.wind - (path.x[:, gusts] if path.gusts else 0.0)
    U, turn, Rt = ned_to_body(path.x[:, :3], air)
    arm, side = path.vanes.arms[i], path.vanes.side[i]
    local, row = U + np.cross(path.inertial.rates, arm), np.zeros_like(U)
    row[:, 0], row[:, side] = -local[:, side], local[:, 0]
    row /= np.maximum(local[:, 0] ** 2 + local[:, side] ** 2, 1.0)[:, None]
    by_state = np.zeros((len(U), 7 + len(path.vanes.side) + 3 * path.gusts))
    by_state[:, :3], by_state[:, 3:6] = (row[:, None] @ turn)[:, 0], (row[:, None] @ Rt)[:, 0]
    if path.gusts:
        by_state[:, gusts] = -by_state[:, 3:6]
    by_rates, by_input = -row @ cross_product_matrix(arm), np.zeros((len(U), len(path.inputs)))
    for j, item in enumerate(path.inputs):
        if WIND <= item < LAG:
            by_input[:, j] = -by_state[:, 3 + item - WIND]
        elif item < WIND and item % SCALE < 3:
            read = path.inertial.rates[:, item % SCALE] if item >= SCALE else 1.0
            by_input[:, j] = -by_rates[:, item % SCALE] * path.inertial.gain[item % SCALE] * read
    return np.arctan2(local[:, side], local[:, 0]), by_state, by_input
