"""Paths that an inertial unit drives, and what readings along them say of their start: against
NumPy and against differences.
"""

import numpy as np
import pytest

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
from flightmech.simulation.normal_sums import Readings, driven_products, driven_series

DT, SAMPLES = 0.02, 101
AROUND = Surroundings(9.81, 3e-6, 0.0, np.zeros(3), np.zeros((3, 3)), np.zeros(3))
START = np.array([0.1, 0.05, 0.3, 80.0, 20.0, 1.0, 1000.0, 0.05, -0.02])


def driven(rates=0.0, force=0.0, inputs=(), before=None, lag=(0.0, 0.0, 1.0)):
    """Return the path of a gentle motion, with what is added to its rates and specific forces
    (samples, 3).
    """
    t = DT * np.arange(SAMPLES)
    omega = 0.1 * np.stack([np.sin(2.0 * t), np.cos(1.5 * t), 0.3 * np.sin(t)], axis=1) + rates
    f = np.stack([0.5 * np.sin(t), 0.3 * np.cos(t), -9.8 + np.sin(2.0 * t)], axis=1) + force
    inertial = Inertial(omega, f, f, np.ones(6), np.zeros(3))
    vanes = Vanes(
        [2, 1],
        np.array([[0.0, 0.0, 0.5], [0.0, 0.5, 0.0]]),
        np.array([3.0, -2.0, 0.0]),
        np.array(lag),
        np.zeros(3),
    )
    return DrivenPath(
        inertial,
        np.tile(START, (SAMPLES, 1)) if before is None else before,
        DT,
        AROUND,
        inputs,
        vanes,
    )


def followed(path):
    x = np.empty((SAMPLES, 9))
    path.follow(START, x)
    return x


def test_rolling_and_falling_in_closed_form():
    still = np.zeros((SAMPLES, 3))
    roll, vanes = (
        still + [0.4, 0.0, 0.0],
        Vanes([], np.zeros((0, 3)), np.zeros(3), np.zeros(3), np.zeros(3)),
    )
    path = DrivenPath(
        Inertial(roll, still, still, np.ones(6), np.zeros(3)),
        np.zeros((SAMPLES, 7)),
        DT,
        AROUND,
        (),
        vanes,
    )
    x = np.empty((SAMPLES, 7))
    path.follow(np.array([0.2, 0.0, -1.0, 50.0, 0.0, 0.0, 500.0]), x)
    t = DT * np.arange(SAMPLES)
    np.testing.assert_allclose(
        x[:, :3], np.stack([0.2 + 0.4 * t, 0.0 * t, -1.0 + 0.0 * t], axis=1), atol=1e-13
    )
    np.testing.assert_allclose(
        x[:, 3:],
        np.stack([50.0 + 0.0 * t, 0.0 * t, 9.81 * t, 500.0 - 4.905 * t**2], axis=1),
        atol=1e-11,
    )


def test_heading_goes_on_beyond_half_a_turn():
    still = np.zeros((SAMPLES, 3))
    vanes = Vanes([], np.zeros((0, 3)), np.zeros(3), np.zeros(3), np.zeros(3))
    path = DrivenPath(
        Inertial(still + [0.0, 0.0, 5.0], still, still, np.ones(6), np.zeros(3)),
        np.zeros((SAMPLES, 7)),
        DT,
        AROUND,
        (),
        vanes,
    )
    x = np.empty((SAMPLES, 7))
    path.follow(np.zeros(7), x)
    np.testing.assert_allclose(x[:, 2], 5.0 * DT * np.arange(SAMPLES), atol=1e-12)


def readings(rng, unknowns, constants):
    """Return readings of two channels, repeated and between samples, with derivatives by six
    states.
    """
    k, f = (
        np.sort(rng.integers(0, SAMPLES - 1, 40)),
        rng.uniform(size=40) * (rng.uniform(size=40) < 0.5),
    )
    A = rng.normal(size=(40, 2, 6)) * (rng.uniform(size=6) < 0.7)
    return Readings(
        rng.normal(size=(40, 2)),
        k,
        f,
        A,
        np.array(constants),
        rng.normal(size=(40, 2, len(constants))),
    )


def test_products_and_series_are_those_of_dense_rows():
    rng = np.random.default_rng(5)
    X, unknowns, weight = rng.normal(size=(SAMPLES, 9, 12)), 14, np.array([2.0, 0.5])
    given = readings(rng, unknowns, [13, -1, 4])
    rows = np.zeros((40, 2, unknowns))
    for i, (k, f) in enumerate(zip(given.k, given.f)):
        rows[i, :, :12] = given.A[i] @ ((1.0 - f) * X[k, :6] + f * X[k + 1, :6])
        rows[i, :, 13] += given.J[i, :, 0]
        rows[i, :, 4] += given.J[i, :, 2]
    whole = np.concatenate([rows, given.r[..., None]], axis=-1)
    np.testing.assert_allclose(
        driven_products(X, unknowns, given), np.einsum("ija,ijb->jab", whole, whole), atol=1e-12
    )
    pressed = np.ones((SAMPLES, 9, unknowns))
    np.testing.assert_allclose(
        driven_series(X, unknowns, given, weight, pressed), np.moveaxis(rows, 0, 2), atol=1e-13
    )
    expected = np.ones_like(pressed)
    for i, (k, f) in enumerate(zip(given.k, given.f)):
        for at, share in ((k, 1.0 - f), (k + 1, f)):
            expected[at, :6] += share * (given.A[i] * weight[:, None] ** 2).T @ rows[i]
    np.testing.assert_allclose(pressed, expected, atol=1e-12)


def test_noise_of_the_inertial_unit_by_differences():
    """Each sample of each channel disturbed in turn: what it does to weighted sums of the
    states.
    """
    rng = np.random.default_rng(8)
    before = followed(driven())
    nominal, noise = followed(driven(before=before)), np.array([1e-3, 2e-3, 3e-3, 0.02, 0.03, 0.01])
    pressed = np.zeros((SAMPLES, 9, 2))
    pressed[20:] = (
        rng.normal(size=(9, 2)) / np.array([0.1, 0.1, 0.1, 1.0, 1.0, 1.0, 1.0, 0.1, 0.1])[:, None]
    )
    found = np.zeros((2, 2))
    driven(before=before).add_noise(nominal, noise, pressed, found)
    expected = np.zeros((2, 2))
    for k in range(SAMPLES):
        for i in range(6):
            change = np.zeros((SAMPLES, 6))
            change[k, i] = 1e-4
            moved = followed(driven(change[:, :3], change[:, 3:], before=before))
            T = (
                np.tensordot(moved - nominal, pressed, 2)
                / 1e-4
                * noise[i]
                * (2.0 if k in (0, SAMPLES - 1) else 1.0)
            )  # it drives half a step
            expected += np.outer(T, T)
    assert (np.linalg.eigvalsh(expected) > 0.0).all()
    np.testing.assert_allclose(
        found, expected, rtol=0.02
    )  # a sample counts whole where it drives two steps


def test_wrong_arrays_and_inputs_are_refused():
    rng = np.random.default_rng(2)
    path = driven(inputs=(BIAS, SCALE + 5, WIND, LAG))
    with pytest.raises(
        ValueError, match=r"shape \(101, 8\), expected contiguous doubles \(101, 9\)"
    ):
        path.follow(START, np.empty((SAMPLES, 8)))
    with pytest.raises(ValueError, match=r"expected contiguous doubles \(101, 9, 13\)"):
        path.follow(START, np.empty((SAMPLES, 9)), np.empty((SAMPLES, 9, 12)))
    with pytest.raises(ValueError, match="follows no path"):
        driven(inputs=(LAG + 1,)).follow(START, np.empty((SAMPLES, 9)))
    X = rng.normal(size=(SAMPLES, 9, 12))
    with pytest.raises(IndexError, match=r"constants -1 \.\.\. 13 of 13 unknowns"):
        driven_products(X, 13, readings(rng, 13, [13, -1]))
    with pytest.raises(ValueError, match="97 unknowns"):
        driven_products(X, 97, readings(rng, 97, [13]))
