"""The bordered band solver against a dense one, and the derivatives of every residual against
differences.
"""

import numpy as np
import pytest
from path_steps import path_steps

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
from flightmech.simulation.normal_sums import NormalSums
from flighttest.reconstruction.dynamics.kinematics import earth_rotation
from flighttest.reconstruction.problem.assembly import assemble_problem
from flighttest.reconstruction.problem.normal_equations import NormalEquations
from flighttest.reconstruction.problem.trajectory import estimate_trajectory, linearise, with_gusts


def test_solution_of_a_small_system():
    rng = np.random.default_rng(0)
    N, n, nc = 6, 3, 2
    equations = NormalEquations(N, n, nc)
    rows, right = [], []

    def dense(k, blocks, Jc, r):
        for i in range(len(r)):
            row = np.zeros(N * n + nc)
            for at, J in zip(k, blocks, strict=True):
                row[at * n : at * n + n] += J[i]
            row[N * n :] = Jc[i]
            rows.append(row)
            right.append(r[i])

    r, A, B, Jc = (
        rng.normal(size=s) for s in ((N - 1, 3), (N - 1, 3, n), (N - 1, 3, n), (N - 1, 3, nc))
    )
    equations.add_steps(r, A, B, np.arange(nc), Jc, np.ones_like(r))
    for k in range(N - 1):
        dense((k, k + 1), (A[k], B[k]), Jc[k], r[k])
    k, f = (
        np.array([0, 2, 2, 4, 5]),
        np.array([0.0, 0.25, 0.75, 0.5, 0.0]),
    )  # two readings in one step, one on the last sample
    r, J, Jc = rng.normal(size=(5, 2)), rng.normal(size=(5, 2, n)), rng.normal(size=(5, 2, 1))
    equations.add_samples(r, k, f, J, np.array([1]), Jc, np.ones(2))
    for i in range(5):
        blocks = ((1 - f[i]) * J[i], f[i] * J[i])
        dense((k[i], min(k[i] + 1, N - 1)), blocks, np.column_stack([np.zeros(2), Jc[i]]), r[i])
    equations.add_prior(np.array([0.5, -0.5]), np.eye(nc))
    dense((0,), (np.zeros((2, n)),), np.eye(2), np.array([0.5, -0.5]))
    X, y = np.array(rows), np.array(right)
    expected = -np.linalg.lstsq(X, y, rcond=None)[0]
    dx, dc, information = equations.solve()
    np.testing.assert_allclose(np.append(dx.ravel(), dc), expected, rtol=1e-9, atol=1e-9)
    np.testing.assert_allclose(
        np.linalg.inv(information), np.linalg.inv(X.T @ X)[N * n :, N * n :], rtol=1e-9
    )
    assert equations.cost == pytest.approx(y @ y)


def test_undetermined_state_is_an_error():
    with pytest.raises(IdentificationError, match="not determined at sample 0, state 0"):
        NormalEquations(4, 2, 1).solve()


def with_constants(derivatives, names):
    """Equations of a path that is known, and of constants with one reading each of four."""
    equations = NormalEquations(4, 2, len(names), names)
    equations.D[:] = np.eye(2)
    J = np.array(derivatives, float)
    equations.C += J.T @ J
    return equations


def test_constants_that_do_the_same_are_named():
    """Two columns that agree within rounding; a third that is far from both."""
    rng = np.random.default_rng(1)
    a, b = rng.standard_normal((2, 4))
    equations = with_constants(np.column_stack([a, b, 2.0 * a * (1.0 + 1e-16)]), ["x", "y", "z"])
    with pytest.raises(IdentificationError, match="constants x, z are not determined"):
        equations.solve()
    # a difference of 1e-5 leaves a part of 1e-10 of the information
    apart = 2.0 * a + 1e-5 * rng.standard_normal(4)
    equations = with_constants(np.column_stack([a, b, apart]), ["x", "y", "z"])
    equations.gc[:] = equations.C @ [1.0, 2.0, 3.0]
    np.testing.assert_allclose(equations.solve()[1], [-1.0, -2.0, -3.0], rtol=3e-3)


def test_a_constant_without_reading_and_prior_is_named():
    equations = with_constants(np.column_stack([np.ones(4), np.zeros(4)]), ["used", "spare"])
    with pytest.raises(IdentificationError, match="constant spare is not determined"):
        equations.solve()


@pytest.fixture(scope="module")
def setup(flown, aircraft):
    record, _, _ = flown(0, duration=3.0)
    return assemble_problem(record, aircraft, [(0.0, 3.0)])


@pytest.mark.nightly
@pytest.mark.parametrize("air", ["calm", "gusts", "shown"])
def test_gradient_of_the_whole_cost(setup, air):
    """The gradient holds the derivative of every residual by every unknown."""
    problem, x = setup.problem, setup.x
    if air != "calm":
        problem, x = with_gusts(problem, x, np.array([0.3, 0.4, 0.5]), 100.0, shown=air == "shown")
    solution = estimate_trajectory(
        problem,
        x,
        setup.c,
        3,
        [n for n in problem.constants.names if n.startswith(("factor", "lag", "delay"))],
    )
    rng = np.random.default_rng(2)
    x = solution.x + rng.normal(0, 1e-3, solution.x.shape)
    c = solution.c + rng.normal(0, 0.3, len(solution.c)) * np.sqrt(
        np.diag(problem.constants.covariance)
    )
    # off the kinks where a latency meets a sample
    c[problem.constants.index("delay.air_data", "delay.gps")] = 0.1234, 0.1571
    equations = linearise(problem, x, c)
    scale = np.sqrt(np.diag(problem.constants.covariance))
    for i, name in enumerate(problem.constants.names):
        step = np.zeros(len(c))
        # The cost is large and rounds: a shorter step misses the tolerance under some kernels.
        step[i] = 1e-3 * scale[i]
        slope = (linearise(problem, x, c + step).cost - linearise(problem, x, c - step).cost) / (
            2 * step[i]
        )
        # what a gust adds to a reading does not move with the latency: its part of the derivative
        # is left out
        tolerance = 1e-3 if (air, name) == ("shown", "delay.air_data") else 1e-4
        assert slope == pytest.approx(2 * equations.gc[i], rel=tolerance, abs=1e-3 / scale[i]), name
    for j in range(problem.states):
        # samples inside, where the prior on the start (which moves with the iteration) does not act
        k, h = 70, 1e-5  # a cost of 4e8 rounds to 6e-8: the difference quotient is good to 3e-3
        bump = np.zeros_like(x)
        bump[k, j] = h
        slope = (linearise(problem, x + bump, c).cost - linearise(problem, x - bump, c).cost) / (
            2 * h
        )
        assert slope == pytest.approx(2 * equations.gx[k, j], rel=1e-4, abs=1e-2), j


def test_held_constants_keep_their_prior_and_pass_it_on(setup):
    problem = setup.problem
    held = ("factor.alpha_vane",)
    free, kept = (
        estimate_trajectory(problem, setup.x, setup.c),
        estimate_trajectory(problem, setup.x, setup.c, held=held),
    )
    names = problem.constants.names
    at, offset = names.index("factor.alpha_vane"), names.index("bias.alpha_vane")
    assert kept.c[at] == setup.c[at]
    assert kept.covariance[at, at] == problem.constants.covariance[at, at]
    assert kept.covariance[offset, offset] > free.covariance[offset, offset]
    assert (
        np.linalg.eigvalsh(
            kept.covariance / np.sqrt(np.outer(np.diag(kept.covariance), np.diag(kept.covariance)))
        )
        > 0
    ).all()


def test_equations_written_over_are_those_of_new_memory(setup):
    problem, rng = setup.problem, np.random.default_rng(5)
    elsewhere = linearise(problem, setup.x + rng.normal(0, 1e-3, setup.x.shape), setup.c)
    elsewhere.solve()
    spare = [elsewhere]
    again, new = linearise(problem, setup.x, setup.c, spare), linearise(problem, setup.x, setup.c)
    assert again is elsewhere
    assert not spare
    assert again.cost == new.cost
    for name in ("D", "O", "G", "C", "gx", "gc"):
        np.testing.assert_array_equal(getattr(again, name), getattr(new, name), name)
    for old, expected in zip(again.solve(), new.solve(), strict=True):
        np.testing.assert_array_equal(old, expected)


@pytest.mark.parametrize("gusts", [False, True])
@pytest.mark.parametrize("vanes", [0, 2])
def test_steps_of_a_path_are_those_written_out(vanes, gusts):
    rng = np.random.default_rng(8)
    around = Surroundings(9.81, 3e-6, 700.0, *earth_rotation(0.9), np.array([5e-5, 0.0, -4e-5]))
    n, inputs = 10 + vanes, [SCALE + 1, BIAS, WIND + 2, SCALE + 5, LAG, BIAS + 4, WIND, BIAS + 2]
    x = rng.normal(
        [0.2, 0.1, 2.0, 60.0, -30.0, 2.0, 800.0], [0.5, 0.5, 2.0, 5.0, 5.0, 5.0, 90.0], (40, 7)
    )
    x = np.concatenate([x, rng.normal(size=(40, n - 7))], axis=1)
    inertial = Inertial(
        *rng.normal(size=(3, 40, 3)), 1.0 + 0.1 * rng.normal(size=6), rng.normal(size=3)
    )
    carried = Vanes(
        [2, 1][:vanes],
        rng.normal(size=(vanes, 3)),
        rng.normal(size=3),
        np.array([0.3, 0.3, 0.4]),
        rng.normal(size=3),
    )
    path = DrivenPath(inertial, x, 0.02, around, inputs, carried, gusts, rng.uniform(size=39) < 0.2)
    weight, columns = rng.uniform(0.5, 2.0, (39, 7 + vanes)), rng.permutation(11)[:8]
    weight[11] = 0.0  # two windows
    found, expected = NormalSums(40, n, 11), NormalSums(40, n, 11)
    found.path_steps(path, weight, columns)
    r, A, B, J = path_steps(path, weight[:, 0] != 0.0)
    expected.steps(r, weight, A, B, columns, J)
    assert found.cost == pytest.approx(expected.cost, rel=1e-13)
    for name in ("D", "O", "G", "C", "gx", "gc"):
        one, other = getattr(found, name), getattr(expected, name)
        np.testing.assert_allclose(
            one, other, rtol=1e-9, atol=1e-12 * np.abs(other).max(), err_msg=name
        )
