"""One Gauss-Newton step of the reconstruction is the extended Kalman smoother linearised about the
same path ([Bell1994]).

The steps, readings and priors that `linearise` adds to the normal equations are taken down here and
solved a second time by the recursions: Kalman filter with the constants as states that do not
change, then Rauch-Tung-Striebel backwards.
"""

import copy

import numpy as np
import pytest
from path_steps import path_steps

from flighttest.reconstruction.problem import trajectory
from flighttest.reconstruction.problem.assembly import assemble_problem
from flighttest.reconstruction.problem.normal_equations import NormalEquations


class TakenDown(NormalEquations):
    """Normal equations that remember what was added."""

    def __init__(self, *sizes):
        super().__init__(*sizes)
        self.steps, self.samples, self.start, self.prior = [], [], [], []

    def add_path_steps(self, path, weight, columns):
        super().add_path_steps(path, weight, columns)
        r, A, B, J = path_steps(path, weight[:, 0] != 0.0)
        self.take_down(r, A, B, columns, J, weight)

    def add_steps(self, r, A, B, columns, Jc, weight):
        super().add_steps(r, A, B, columns, Jc, weight)
        self.take_down(r, A, B, columns, Jc, weight)

    def take_down(self, r, A, B, columns, Jc, weight):
        w = np.broadcast_to(weight, r.shape)[..., None]
        unused = np.zeros((*r.shape, self.D.shape[1] - A.shape[-1]))
        A, B = (np.concatenate([item * w, unused], axis=-1) for item in (A, B))
        self.steps.append((r * w[..., 0], A, B, columns, Jc * w))

    def add_samples(self, r, k, f, J, columns, Jc, weight):
        super().add_samples(r, k, f, J, columns, Jc, weight)
        J = np.broadcast_to(J, (len(r), *J.shape[1:]))
        self.samples.append((r * weight, k, f, J * weight[:, None], columns, Jc * weight[:, None]))

    def add_state(self, *state):
        super().add_state(*state)
        self.start.append(state)

    def add_prior(self, *prior):
        super().add_prior(*prior)
        self.prior.append(prior)


@pytest.fixture
def linearised(flown, aircraft, monkeypatch):
    craft = copy.deepcopy(
        aircraft
    )  # without latencies, so that every reading belongs to one sample
    for table in ("air_data", "gps"):
        del craft.instruments[table]["delay"]
    record = flown(0, duration=4.0)[0]
    setup = assemble_problem(record, craft, [(0.0, 4.0)])
    monkeypatch.setattr(trajectory, "NormalEquations", TakenDown)
    return trajectory.linearise(setup.problem, setup.x, setup.c)


def update(mean, P, H, r):
    """Take in readings H y + r = noise of unit variance."""
    S = H @ P @ H.T + np.eye(len(H))
    K = np.linalg.solve(S, H @ P).T
    left = np.eye(len(P)) - K @ H
    return mean - K @ (H @ mean + r), left @ P @ left.T + K @ K.T


def smoother(equations):
    """Return the smoothed changes of states and constants, and the covariance of the constants, by
    filter and backward pass.
    """
    samples, n, nc = equations.G.shape
    (deviation, precision), ((_, start, weight),) = equations.prior[0], equations.start
    mean, P = np.zeros(n + nc), np.zeros((n + nc, n + nc))
    P[:n, :n] = np.diag(1.0 / weight**2)
    P[n:, n:] = np.linalg.inv(precision)
    mean[:n], mean[n:] = -start / weight, -deviation
    kept = []
    for k in range(samples):
        if k:
            r, A, B, C = _step(equations, k - 1, n, nc)
            F, shift, spread = (
                -np.linalg.solve(B, np.hstack([A, C])),
                -np.linalg.solve(B, r),
                np.linalg.inv(B),
            )
            forward = np.eye(n + nc)
            forward[:n] = F
            ahead, P_ahead = forward @ mean, forward @ P @ forward.T
            ahead[:n] += shift
            P_ahead[:n, :n] += spread @ spread.T
            kept.append((mean, P, forward, ahead, P_ahead))
            mean, P = ahead, P_ahead
        for r, at, f, J, columns, Jc in equations.samples:
            assert not f.any()
            for i in np.flatnonzero(at == k):
                H = np.zeros((r.shape[1], n + nc))
                H[:, :n] = J[i]
                H[:, n + columns] += Jc[i]
                mean, P = update(mean, P, H, r[i])
    constants = P[n:, n:]
    states = [mean]
    for before, P, forward, ahead, P_ahead in reversed(kept):
        gain = np.linalg.solve(P_ahead, forward @ P).T
        states.append(before + gain @ (states[-1] - ahead))
    path = np.array(states[::-1])
    return path[:, :n], path[-1, n:], constants


def _step(equations, k, n, nc):
    r = np.concatenate([step[0][k] for step in equations.steps])
    A, B = (np.concatenate([step[i][k] for step in equations.steps]) for i in (1, 2))
    C = np.zeros((len(r), nc))
    row = 0
    for step in equations.steps:
        C[row : row + step[0].shape[1], step[3]] = step[4][k]
        row += step[0].shape[1]
    return r, A, B, C


def test_one_step_is_the_extended_kalman_smoother(linearised):
    dx, dc, information = linearised.solve()
    path, constants, covariance = smoother(linearised)
    sigma = np.sqrt(np.diag(np.linalg.inv(information)))
    # in standard errors: the covariance recursion loses digits where start (500 m) and noise (1e-4
    # rad) lie far apart
    np.testing.assert_allclose(constants / sigma, dc / sigma, atol=1e-3)
    np.testing.assert_allclose(np.sqrt(np.diag(covariance)), sigma, rtol=1e-3)
    scale = np.abs(dx).max(axis=0)
    np.testing.assert_allclose(path / scale, dx / scale, atol=1e-4)
