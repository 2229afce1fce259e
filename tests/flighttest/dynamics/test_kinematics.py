import numpy as np
import pytest

from flighttest.reconstruction.dynamics.kinematics import (
    body_rates_from_angles,
    body_to_ned_rotation,
    cross_product_matrix,
    earth_rotation,
    gravity,
    incidence_rates,
    ned_to_body,
    rate_matrix,
)
from flighttest.records.sensors.position_corrections import force_at_cg, vane_angles, vane_at_cg

RNG = np.random.default_rng(1)
ATTITUDE = RNG.uniform(-1.0, 1.0, (7, 3))


def numerical(function, x, h=1e-6):
    """Central differences over the last axis: shape (samples, outputs, inputs)."""
    columns = [
        (function(x + h * np.eye(x.shape[1])[i]) - function(x - h * np.eye(x.shape[1])[i]))
        / (2 * h)
        for i in range(x.shape[1])
    ]
    return np.stack(columns, axis=-1)


def test_rotation_is_orthogonal_and_points_the_nose():
    R = body_to_ned_rotation(ATTITUDE)
    np.testing.assert_allclose(R @ np.swapaxes(R, 1, 2), np.tile(np.eye(3), (7, 1, 1)), atol=1e-15)
    np.testing.assert_allclose(
        body_to_ned_rotation(np.array([[0.0, np.pi / 6, np.pi / 2]]))[0, :, 0],
        [0.0, np.sqrt(0.75), -0.5],
        atol=1e-15,
    )


def test_rate_matrix_agrees_with_the_turning_rotation():
    rate = RNG.uniform(-1, 1, (7, 3))
    h = 1e-6
    turned = (
        body_to_ned_rotation(ATTITUDE + h * rate) - body_to_ned_rotation(ATTITUDE - h * rate)
    ) / (2 * h)
    omega = (rate_matrix(ATTITUDE) @ rate[..., None])[..., 0]
    np.testing.assert_allclose(
        np.swapaxes(body_to_ned_rotation(ATTITUDE), 1, 2) @ turned,
        cross_product_matrix(omega),
        atol=1e-9,
    )  # R' dR/dt = [omega x]


def test_derivatives_of_rates_and_body_vectors():
    rate, m = RNG.uniform(-1, 1, (7, 3)), RNG.uniform(-5, 5, (7, 3))
    np.testing.assert_allclose(
        body_rates_from_angles(ATTITUDE, rate)[1],
        numerical(lambda a: body_rates_from_angles(a, rate)[0], ATTITUDE),
        atol=1e-8,
    )
    np.testing.assert_allclose(
        ned_to_body(ATTITUDE, m)[1], numerical(lambda a: ned_to_body(a, m)[0], ATTITUDE), atol=1e-8
    )


def test_gravity():
    assert gravity(None, 0.0) == 9.80665
    assert gravity(None, 7500.0) == pytest.approx(
        9.7836, abs=5e-5
    )  # what the Citation 500 simulation of that height flies with
    # WGS-84 normal gravity on the ellipsoid: equator 9.7803253359, pole 9.8321849378 (NIMA
    # TR8350.2, table 3.4)
    assert gravity(0.0, 0.0) == pytest.approx(9.7803253359, abs=1e-9)
    assert gravity(np.pi / 2, 0.0) == pytest.approx(9.8321849378, abs=2e-9)
    assert gravity(0.8, 1000.0) - gravity(0.8, 0.0) == pytest.approx(
        -0.003086, rel=0.01
    )  # free-air gradient


def test_earth_deflects_to_the_right_in_the_north_and_lifts_what_flies_east():
    spin, transport = earth_rotation(np.radians(45.0))
    v = np.array([0.0, 100.0, 0.0])
    needed = -np.cross(2 * spin + transport @ v, v)
    assert needed[0] < 0.0  # east turns to the south
    assert needed[2] < 0.0  # Eoetvoes
    np.testing.assert_array_equal(earth_rotation(None)[0], 0.0)


def test_incidence_rates_against_differences():
    U, omega, force, g_b = (RNG.uniform(-1, 1, (5, 3)) + s for s in ([80, 0, 5], 0, 0, [0, 0, 9.8]))
    h = 1e-4
    rate = force + g_b - np.cross(omega, U)

    def angles(U):
        return np.arctan2(U[:, 2], U[:, 0]), np.arcsin(U[:, 1] / np.linalg.norm(U, axis=1))

    plus, minus = angles(U + h * rate), angles(U - h * rate)
    for found, a, b in zip(
        incidence_rates(U.T, omega.T, (force + g_b).T), plus, minus, strict=True
    ):
        np.testing.assert_allclose(found, (a - b) / (2 * h), atol=1e-9)


def test_force_moves_to_the_cg_and_back():
    omega, omega_dot, force = (RNG.uniform(-1, 1, (6, 3)) for _ in range(3))
    arm = np.array([0.9, 0.25, 0.3])
    there = force_at_cg(force, omega, omega_dot, arm)
    np.testing.assert_allclose(force_at_cg(there, omega, omega_dot, -arm), force, atol=1e-14)
    p, q, r = omega.T
    x, y, z = arm
    # identification text: ax + (q2 + r2) x - (p q - r_dot) y - (p r + q_dot) z
    ax = (
        force[:, 0]
        + (q**2 + r**2) * x
        - (p * q - omega_dot[:, 2]) * y
        - (p * r + omega_dot[:, 1]) * z
    )
    np.testing.assert_allclose(there[:, 0], ax, atol=1e-14)


@pytest.mark.parametrize("arm", [[4.0, 0.0, 0.0], [0.0, 4.0, 0.0], [0.0, 0.0, 4.0]])
@pytest.mark.parametrize("rate", range(3))
def test_small_angle_vane_correction_has_every_arm_and_rate(arm, rate):
    U, omega = np.array([[90.0, 0.02, 0.05]]), np.zeros((1, 3))
    omega[0, rate] = 1e-3
    at_vane, at_cg = vane_angles(U, omega, arm), vane_angles(U, omega, np.zeros(3))
    corrected = vane_at_cg(*at_vane, np.linalg.norm(U, axis=1), omega, arm)
    # a term of the first order is 4e-3/90 = 4.4e-5
    np.testing.assert_allclose(corrected, at_cg, rtol=0.0, atol=1e-7)


def test_small_angle_vane_correction_is_of_second_order():
    U, omega, arm = (
        np.array([[90.0, 2.0, 5.0]]),
        np.array([[0.05, 0.1, 0.05]]),
        np.array([4.0, 0.0, 0.0]),
    )
    at_vane, at_cg = vane_angles(U, omega, arm), vane_angles(U, omega, np.zeros(3))
    corrected = vane_at_cg(*at_vane, np.linalg.norm(U, axis=1), omega, arm)
    for raw, found, true in zip(at_vane, corrected, at_cg, strict=True):
        assert abs(raw - true)[0] > 2e-3
        assert abs(found - true)[0] < 3e-5
