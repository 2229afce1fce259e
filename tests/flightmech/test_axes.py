"""Axis changes there and back, against definitions and against each other."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from flightmech import axes

ANGLE = st.floats(-3.1, 3.1)
PITCH = st.floats(-1.5, 1.5)


@given(ANGLE, PITCH, ANGLE)
def test_euler_angles_there_and_back(phi, theta, psi):
    found = axes.euler_from_matrix(axes.matrix_from_euler(phi, theta, psi))
    np.testing.assert_allclose(found, [phi, theta, psi], atol=1e-12)


@pytest.mark.slow
@given(ANGLE, PITCH, ANGLE)
def test_quaternion_there_and_back(phi, theta, psi):
    C = axes.matrix_from_euler(phi, theta, psi)
    q = axes.quaternion_from_matrix(C)
    assert q[0] >= 0.0
    assert np.linalg.norm(q) == pytest.approx(1.0)
    np.testing.assert_allclose(axes.matrix_from_quaternion(3.0 * q), C, atol=1e-14)


def test_quaternion_of_a_bank_is_its_half_angle():
    np.testing.assert_allclose(
        axes.quaternion_from_matrix(axes.matrix_from_euler(0.6, 0.0, 0.0)),
        [np.cos(0.3), np.sin(0.3), 0.0, 0.0],
        atol=1e-15,
    )


def test_rotation_is_three_turns_in_order():
    def turn(axis: int, angle: float) -> np.ndarray:
        C = np.eye(3)
        i, j = (axis + 1) % 3, (axis + 2) % 3
        C[i, i] = C[j, j] = np.cos(angle)
        C[i, j], C[j, i] = np.sin(angle), -np.sin(angle)
        return C

    expected = turn(0, 0.3) @ turn(1, -0.4) @ turn(2, 1.2)
    np.testing.assert_allclose(axes.matrix_from_euler(0.3, -0.4, 1.2), expected, atol=1e-15)


def test_arrays_keep_their_shape():
    C = axes.matrix_from_euler(np.zeros((4, 1)), 0.1, np.linspace(0.0, 1.0, 5))
    assert C.shape == (4, 5, 3, 3)
    assert axes.quaternion_from_matrix(C).shape == (4, 5, 4)
    assert axes.euler_from_matrix(C).psi.shape == (4, 5)


@pytest.mark.slow
@given(st.floats(-1.5, 1.5))
def test_stability_axes_there_and_back(alpha):
    vector = np.array([0.3, -0.2, 0.9])
    np.testing.assert_allclose(
        axes.to_stability(axes.stability_to_body(vector, alpha), alpha), vector, atol=1e-15
    )


def test_lift_and_drag_of_body_forces():
    alpha, CL, CD = np.array([0.0, 0.2, 1.4]), 0.8, 0.05
    body = axes.stability_to_body(
        np.stack(np.broadcast_arrays(-CD, 0.0, -CL), axis=-1)[None, :].repeat(3, 0), alpha
    )
    found = axes.lift_drag(body[:, 0], body[:, 2], alpha)
    np.testing.assert_allclose(found, [[CL] * 3, [CD] * 3], atol=1e-15)


def test_at_no_angle_of_attack_nothing_turns():
    D = np.array([[-0.4, 0.1], [-0.03, -0.15]])
    assert (axes.rate_derivatives_to_body(D, 0.0) == D).all()


@given(st.floats(-1.0, 1.0))
def test_rate_derivatives_give_the_same_moment(alpha):
    """Moments from body rates by the body derivatives are the stability moments turned into body
    axes.
    """
    D = np.array([[-0.4, 0.1], [-0.03, -0.15]])
    rates = np.array([0.02, 0.0, -0.05])
    p, _, r = axes.to_stability(rates, alpha)
    roll, yaw = D @ [p, r]
    expected = axes.stability_to_body([roll, 0.0, yaw], alpha)
    found = axes.rate_derivatives_to_body(D, alpha) @ rates[[0, 2]]
    np.testing.assert_allclose(found, expected[[0, 2]], atol=1e-16)


def test_moment_transfer_is_undone_by_going_back():
    M, F, a, b = np.random.default_rng(0).normal(size=(4, 3))
    there = axes.transfer_moment(M, F, a, b)
    np.testing.assert_allclose(axes.transfer_moment(there, F, b, a), M, atol=1e-15)
    np.testing.assert_allclose(there, M + np.cross(a - b, F), atol=1e-15)


def test_accelerometer_off_the_centre_of_gravity():
    """Steady yaw at 2 rad/s, sensor 0.5 m ahead: 2 m/s2 towards the axis; a yaw acceleration shows
    to the right.
    """
    found = axes.acceleration_at(
        [0.0, 0.0, -9.8], [0.0, 0.0, 2.0], [0.0, 0.0, 3.0], [0.5, 0.0, 0.0]
    )
    np.testing.assert_allclose(found, [-2.0, 1.5, -9.8])


def test_velocity_of_a_vane():
    """Nose-up rate lowers the tail and lifts the nose: a vane ahead of the c.g. feels less air from
    below.
    """
    np.testing.assert_allclose(
        axes.velocity_at_position([80.0, 0.0, 4.0], [0.0, 0.2, 0.0], [4.0, 0.0, 0.0]),
        [80.0, 0.0, 3.2],
    )
