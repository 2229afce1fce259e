"""What the kernel adds of the steps of a flight path, written out in NumPy with the kinematics of the flight path."""

import numpy as np

from flighttest.dynamics.kinematics import rate_matrix, rates, to_body


def path_steps(x, mean_rates, mean_force, dt, around):
    """Return residuals (N-1, 7) and their derivatives by the first seven states before and after (N-1, 7, 7)."""
    difference, middle = np.diff(x[:, :7], axis=0) / dt, (x[1:, :7] + x[:-1, :7]) / 2.0
    r = np.zeros((len(middle), 7))
    from_angles, change = rates(middle[:, :3], difference[:, :3])
    v = middle[:, 3:6]
    carried = v @ around.transport.T
    needed = difference[:, 3:6] + np.cross(2.0 * around.spin + carried, v)
    needed[:, 2] -= around.gravity - around.fall * (middle[:, 6] - around.level)
    U, turn, Rt = to_body(middle[:, :3], needed)
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
