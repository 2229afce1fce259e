"""Sums of normal equations and the elimination of the states by the kernel, against dense
matrices.
"""

import numpy as np
import pytest

from flightmech.simulation.normal_sums import NormalSums, Readings, driven_products

SAMPLES, STATES, CONSTANTS = 7, 5, 6


@pytest.fixture
def system():
    """Return sums over steps and readings, and the same residuals as dense rows (residuals,
    unknowns) with their values.
    """
    rng = np.random.default_rng(3)
    sums, rows, values = NormalSums(SAMPLES, STATES, CONSTANTS), [], []

    def row(blocks, columns, J, value):
        made = np.zeros(SAMPLES * STATES + CONSTANTS)
        for k, d in blocks:
            made[k * STATES : k * STATES + len(d)] += d
        made[SAMPLES * STATES + columns] += J
        rows.append(made)
        values.append(value)

    r, weight = rng.normal(size=(2, SAMPLES - 1, 4))
    weight[2, 1] = 0.0
    A, B = rng.normal(size=(2, SAMPLES - 1, 4, 3))  # by the first three states only
    columns, J = np.array([4, 0, 2]), rng.normal(size=(SAMPLES - 1, 4, 3))
    sums.steps(r, weight, A, B, columns, J)
    for k, m in np.ndindex(r.shape):
        w = weight[k, m]
        row([(k, w * A[k, m]), (k + 1, w * B[k, m])], columns, w * J[k, m], w * r[k, m])
    k, f = (
        np.array([6, 0, 3, 3, 5, 0]),
        np.array([0.0, 0.0, 0.25, 0.5, 0.75, 0.125]),
    )  # in any order, repeated, one on the last sample
    r, J = rng.normal(size=(6, 2)), rng.normal(size=(6, 2, 1))
    A, sigma = rng.normal(size=(6, 2, STATES)), np.array([0.5, 2.0])
    sums.readings(r, 1.0 / sigma, k, f, A, np.array([5]), J)
    for i, m in np.ndindex(r.shape):
        blocks = [
            (at, share * A[i, m] / sigma[m])
            for at, share in ((k[i], 1.0 - f[i]), (k[i] + 1, f[i]))
            if share
        ]
        row(blocks, np.array([5]), J[i, m] / sigma[m], r[i, m] / sigma[m])
    return sums, np.array(rows), np.array(values)


def test_sums_are_those_of_dense_rows(system):
    sums, X, y = system
    n, normal, gradient = SAMPLES * STATES, X.T @ X, X.T @ y
    for k in range(SAMPLES):
        at = slice(k * STATES, (k + 1) * STATES)
        np.testing.assert_allclose(sums.D[k], normal[at, at], atol=1e-13)
        np.testing.assert_allclose(sums.G[k], normal[at, n:], atol=1e-13)
        if k:
            np.testing.assert_allclose(
                sums.O[k - 1], normal[at, at.start - STATES : at.start], atol=1e-13
            )
    np.testing.assert_allclose(sums.C, normal[n:, n:], atol=1e-13)
    np.testing.assert_allclose(np.append(sums.gx.ravel(), sums.gc), gradient, atol=1e-13)
    assert sums.cost == pytest.approx(y @ y, rel=1e-14)


def test_states_are_eliminated(system):
    sums, X, _ = system
    sums.D += np.eye(STATES)
    n, normal = SAMPLES * STATES, X.T @ X
    T, G = normal[:n, :n] + np.eye(n), np.column_stack([sums.G.reshape(n, -1), sums.gx.ravel()])
    rest = sums.eliminate()
    np.testing.assert_allclose(rest.border, G.T @ np.linalg.solve(T, G), rtol=1e-11)
    right = rest.right.copy()
    np.testing.assert_allclose(
        rest.substitute_back(right.copy()).reshape(n, -1),
        np.linalg.solve(T, G),
        rtol=1e-11,
        atol=1e-13,
    )
    np.testing.assert_array_equal(rest.right, right)


def chain(rng, samples, states, constants, scale):
    """Return residuals of neighbouring samples as dense rows, by states of units of any size."""
    unknowns = samples * states
    X = rng.normal(size=(samples, states + 2, unknowns + constants))
    for k in range(samples):
        X[k, :, : k * states] = 0.0
        X[k, :, (k + 2) * states : unknowns] = 0.0
    X[..., :unknowns] *= 10.0 ** rng.uniform(-scale, scale, unknowns)
    return X.reshape(-1, unknowns + constants)


def put_blocks(X, y, samples, states):
    """Return the sums over the rows X of residuals y."""
    unknowns = samples * states
    sums, normal = NormalSums(samples, states, X.shape[1] - unknowns), X.T @ X
    for k in range(samples):
        at = slice(k * states, (k + 1) * states)
        sums.D[k], sums.G[k] = normal[at, at], normal[at, unknowns:]
        if k:
            sums.O[k - 1] = normal[at, at.start - states : at.start]
    sums.gx[:] = (X.T @ y)[:unknowns].reshape(samples, states)
    return sums


@pytest.mark.parametrize("scale", [0.0, 5.0])
def test_any_number_of_states_is_eliminated(scale):
    """Against a dense solution of the scaled system, to the rounding that its condition allows."""
    rng = np.random.default_rng(11)
    for states in range(1, 33):
        samples, constants = int(rng.integers(1, 5)), int(rng.integers(0, 7))
        X = chain(rng, samples, states, constants, scale)
        n, y = samples * states, rng.normal(size=len(X))
        T, G = X[:, :n].T @ X[:, :n], X[:, :n].T @ np.column_stack([X[:, n:], y])
        unit = 1.0 / np.sqrt(np.diag(T))
        scaled = T * np.outer(unit, unit)
        rest = put_blocks(X, y, samples, states).eliminate()
        found = rest.substitute_back(rest.right.copy()).reshape(n, -1) / unit[:, None]
        expected = np.linalg.solve(scaled, unit[:, None] * G)
        # 640 systems of each kind differed by 4e-16 times their condition at most
        allowed = 4e-15 * np.linalg.cond(scaled) * np.abs(expected).max()
        np.testing.assert_allclose(found, expected, rtol=0.0, atol=allowed, err_msg=f"{states}")
        border = G.T @ (unit[:, None] * expected)
        size = np.sqrt(np.outer(np.diag(border), np.diag(border)))
        error = np.abs(rest.border - border) / size
        assert error.max() < 4e-15 * np.linalg.cond(scaled), states


@pytest.mark.parametrize("states", [0, 33, 64])
def test_more_states_than_the_kernel_holds_are_refused(states):
    """The kernel kept its pivots in an array of 32 numbers on the stack."""
    sums = NormalSums(2, states, 1)
    sums.D += np.eye(states)
    with pytest.raises(ValueError, match=r"eliminates 1 \.\.\. 32"):
        sums.eliminate()


def test_two_states_that_do_the_same_are_not_determined():
    """Rounding leaves a pivot of either sign, 1e-16 of the diagonal; half of them are positive."""
    rng, refused = np.random.default_rng(5), 0
    for _ in range(100):
        X = chain(rng, 3, 6, 2, scale=3.0)
        X[:, 8] = 0.3 * X[:, 7]
        sums = put_blocks(X, rng.normal(size=len(X)), 3, 6)
        with pytest.raises(np.linalg.LinAlgError) as found:
            sums.eliminate()
        refused += found.value.args == (1, 2)
    assert refused == 100


def test_what_nothing_determines_is_named(system):
    sums, _, _ = system
    sums.D[4, 3] = sums.D[4, :, 3] = 0.0
    sums.O[3:5] = 0.0
    for k in range(SAMPLES):
        sums.D[k] += np.eye(STATES) * (k != 4)
    sums.D[4] = np.diag([1.0, 1.0, 1.0, 0.0, 1.0])
    with pytest.raises(np.linalg.LinAlgError) as found:
        sums.eliminate()
    assert found.value.args == (4, 3)


def test_wrong_arrays_are_refused(system):
    sums, _, _ = system
    nothing = np.zeros((SAMPLES, 1, 0))
    with pytest.raises(IndexError, match=r"samples 6 \.\.\. 7 of 7"):
        sums.readings(
            np.zeros((1, 1)),
            1.0,
            np.array([6]),
            np.array([0.5]),
            np.zeros((1, 1, STATES)),
            np.zeros(0, int),
            nothing[:1],
        )
    with pytest.raises(ValueError, match="expected"):
        sums.readings(
            np.zeros((1, 1)),
            1.0,
            np.array([0]),
            np.array([0.0]),
            np.zeros((1, 1, STATES)),
            np.arange(2),
            nothing[:1],
        )
    with pytest.raises(IndexError, match=r"constants 6 \.\.\. 6 of 6"):
        sums.readings(
            np.zeros((1, 1)),
            1.0,
            np.array([0]),
            np.array([0.0]),
            np.zeros((1, 1, STATES)),
            np.array([6]),
            np.zeros((1, 1, 1)),
        )
    many = NormalSums(2, 33, 0)
    with pytest.raises(ValueError, match="more than the kernel sums at once, 32"):
        many.readings(
            np.zeros((1, 1)),
            1.0,
            np.array([0]),
            np.array([0.0]),
            np.zeros((1, 1, 33)),
            np.zeros(0, int),
            nothing[:1],
        )


def test_together_is_one_after_the_other():
    """More samples than are added in one stretch, readings in an order of their own."""
    rng = np.random.default_rng(9)
    r, A, B, J = (
        rng.normal(size=size) for size in ((299, 2), (299, 2, 3), (299, 2, 3), (299, 2, 1))
    )
    k, f = rng.integers(0, 299, 500), rng.uniform(size=500)
    z, H, K = rng.normal(size=(500, 1)), rng.normal(size=(500, 1, 3)), rng.normal(size=(500, 1, 2))
    one, other = NormalSums(300, 3, 4), NormalSums(300, 3, 4)

    def add(sums):
        sums.steps(r, np.ones_like(r), A, B, np.array([2]), J)
        for order in (np.arange(500), np.argsort(k)):
            sums.readings(z[order], 1.0, k[order], f[order], H[order], np.array([3, 0]), K[order])

    add(one)
    with other.collect_groups():
        add(other)
        assert other.cost == 0.0
    assert other.cost == pytest.approx(one.cost, rel=1e-14)
    for name in ("D", "O", "G", "C", "gx", "gc"):
        np.testing.assert_allclose(
            getattr(other, name), getattr(one, name), rtol=1e-11, atol=1e-11, err_msg=name
        )


def test_derivatives_that_all_readings_share():
    rng = np.random.default_rng(12)
    A, J, k, f = (
        rng.normal(size=(1, 2, STATES)),
        rng.normal(size=(20, 2, 3)),
        rng.integers(0, SAMPLES - 1, 20),
        rng.uniform(size=20),
    )
    r, columns = rng.normal(size=(20, 2)), np.array([5, 0, 2])
    one, other = NormalSums(SAMPLES, STATES, CONSTANTS), NormalSums(SAMPLES, STATES, CONSTANTS)
    one.readings(r, 1.0, k, f, A, columns, J)
    other.readings(r, 1.0, k, f, np.repeat(A, 20, axis=0), columns, J)
    for name in ("D", "O", "G", "C", "gx", "gc", "cost"):
        np.testing.assert_array_equal(getattr(one, name), getattr(other, name), err_msg=name)
    X = rng.normal(size=(SAMPLES, STATES, 8))
    shared, own = (
        driven_products(X, 9, Readings(r, k, f, item, np.array([8, -1, 1]), J))
        for item in (A, np.repeat(A, 20, axis=0))
    )
    np.testing.assert_array_equal(shared, own)


def test_elimination_in_the_memory_of_other_sums(system):
    sums, _, _ = system
    sums.D += np.eye(STATES)
    other = NormalSums(SAMPLES, STATES, CONSTANTS)
    other.D += 2.0 * np.eye(STATES)
    room = other.eliminate()
    alone = sums.eliminate().border
    sums.reuse_elimination(other)
    assert sums.eliminate() is room
    np.testing.assert_array_equal(room.border, alone)
    assert other.eliminate() is not room
