"""Changes of reference, axes and moment centre, against vector algebra done another way."""

import numpy as np
import pytest
import xarray as xr

from aerodb.store.effects import (
    Effect,
    change_reference_quantities,
    rate_shift,
    rates_to_body,
    rotate_rolling_to_body,
    transfer_moments,
    with_added,
    without_partial_sums,
)
from flightmech.errors import AeromatchWarning

ALPHA = xr.DataArray(np.radians([-5.0, 0.0, 10.0, 20.0]), dims="alpha").pipe(
    lambda a: a.assign_coords(alpha=a)
)


def table(*values):
    return xr.DataArray(np.array(values) * np.ones(4), {"alpha": ALPHA.values}, "alpha")


def test_rates_turn_as_a_tensor():
    D_s = np.array([[-0.46, 0.08], [-0.02, -0.09]])  # rows Cl, Cn; columns p, r; stability axes
    roll = Effect(
        "phat", {"CY": table(-0.06), "Cl": table(D_s[0, 0]), "Cn": table(D_s[1, 0])}, "phat"
    )
    yaw = Effect("rhat", {"Cl": table(D_s[0, 1]), "Cn": table(D_s[1, 1])}, "rhat")
    roll_b, yaw_b = rates_to_body(roll, yaw)
    for i, alpha in enumerate(ALPHA.values):
        # body from stability axes: turn by alpha about y; x and z components only
        T = np.array([[np.cos(alpha), -np.sin(alpha)], [np.sin(alpha), np.cos(alpha)]])
        found = np.array([[e.tables[c].values[i] for e in (roll_b, yaw_b)] for c in ("Cl", "Cn")])
        np.testing.assert_allclose(found, T @ D_s @ T.T, rtol=0, atol=1e-15)
        rate_s = T.T @ [1.0, 0.0]  # a body roll rate, in stability axes
        np.testing.assert_allclose(roll_b.tables["CY"].values[i], -0.06 * rate_s[0], atol=1e-15)


def test_moments_of_a_fin_turn_to_constant_arms():
    # a fin force CY at (x, z) of body axes: in stability axes the arms depend on alpha, in body
    # axes they do not
    x, z, b, CY = -4.53, -1.11, 10.31, -0.2163
    s, c = np.sin(ALPHA), np.cos(ALPHA)
    x_s, z_s = x * c + z * s, -x * s + z * c
    effect = Effect("beta", {"CY": table(CY), "Cl": -z_s * CY / b, "Cn": x_s * CY / b}, "beta")
    turned = rotate_rolling_to_body(effect, ALPHA)
    np.testing.assert_allclose(turned.tables["Cl"], -z * CY / b, atol=1e-15)
    np.testing.assert_allclose(turned.tables["Cn"], x * CY / b, atol=1e-15)


def test_a_derivative_without_method_counts_as_zero_and_stays_absent():
    roll = Effect("phat", {"Cl": table(-0.46), "Cn": table(-0.02)}, "phat")
    yaw = Effect("rhat", {"Cn": table(-0.09)}, "rhat")
    roll_b, yaw_b = rates_to_body(roll, yaw)
    assert set(roll_b.tables) == {"Cl", "Cn"}
    assert set(yaw_b.tables) == {"Cn"}
    np.testing.assert_allclose(yaw_b.tables["Cn"].values[1], -0.09)  # alpha zero: as it was


def test_rates_without_a_printed_moment_stay_as_they_are():
    """Supersonic pages print no lateral damping of an aeroplane with a vertical tail."""
    roll_b, yaw_b = rates_to_body(Effect("phat", {}, "phat"), Effect("rhat", {}, "rhat"))
    assert (roll_b.tables, yaw_b.tables) == ({}, {})
    # without a fin the side force alone is printed
    roll = Effect("phat", {"CY": table(0.046)}, "phat")
    roll_b, _ = rates_to_body(roll, Effect("rhat", {}, "rhat"))
    np.testing.assert_allclose(roll_b.tables["CY"].values, 0.046 * np.cos(ALPHA.values))


@pytest.mark.parametrize("d", [(0.3, 0.0, 0.0), (0.0, 0.0, -0.2), (-0.4, 0.0, 0.15)])
def test_moment_transfer_is_a_cross_product(d):
    cbar, b = 1.6, 10.0
    CL, CD, Cm = (
        table(-0.2, 0.3, 1.1, 1.4),
        table(0.03, 0.02, 0.09, 0.2),
        table(0.2, 0.05, -0.1, -0.4),
    )
    side = Effect("beta", {"CY": table(-0.4), "Cl": table(-0.07), "Cn": table(0.05)}, "beta")
    lift = transfer_moments(Effect("basic", {"CL": CL, "CD": CD, "Cm": Cm}), d, cbar, b, ALPHA)
    fin = transfer_moments(side, d, cbar, b, ALPHA)
    for i, alpha in enumerate(ALPHA.values):
        # forces along stability axes -CD, -CL turned to body axes by the rotation matrix about y
        R = np.array(
            [[np.cos(alpha), 0, -np.sin(alpha)], [0, 1, 0], [np.sin(alpha), 0, np.cos(alpha)]]
        )
        F = R @ [-CD.values[i], 0.0, -CL.values[i]]
        np.testing.assert_allclose(
            lift.tables["Cm"].values[i], Cm.values[i] + np.cross(d, F)[1] / cbar, atol=1e-14
        )
        M = np.cross(d, [0.0, -0.4, 0.0]) / b
        np.testing.assert_allclose(fin.tables["Cl"].values[i], -0.07 + M[0], atol=1e-15)
        np.testing.assert_allclose(fin.tables["Cn"].values[i], 0.05 + M[2], atol=1e-15)
    assert lift.tables["CL"] is CL  # forces do not change


def test_other_reference_quantities_give_the_same_forces_and_moments():
    old, new = {"S": 16.0, "cbar": 1.6, "b": 10.0}, {"S": 18.0, "cbar": 1.7, "b": 10.5}
    V, qbar, q = 60.0, 2205.0, 0.2
    effect = Effect("qhat", {"CL": table(8.0), "Cm": table(-17.0)}, "qhat")
    there = change_reference_quantities(effect, old, new)
    for c, length in (("CL", ""), ("Cm", "cbar")):
        force = [
            qbar * r["S"] * r.get(length, 1.0) * e.tables[c].values * q * r["cbar"] / (2 * V)
            for e, r in ((effect, old), (there, new))
        ]
        np.testing.assert_allclose(force[1], force[0], rtol=1e-14)
    rolling = change_reference_quantities(Effect("phat", {"Cl": table(-0.46)}, "phat"), old, new)
    np.testing.assert_allclose(
        rolling.tables["Cl"], -0.46 * (16 / 18) * (10 / 10.5) ** 2, rtol=1e-14
    )
    steady = change_reference_quantities(Effect("beta", {"Cn": table(0.05)}, "beta"), old, new)
    np.testing.assert_allclose(steady.tables["Cn"], 0.05 * (16 / 18) * (10 / 10.5), rtol=1e-14)


def test_tables_keep_their_own_alphas():
    other = xr.DataArray(
        [0.1, 0.2], {"alpha": [0.01, 0.11]}, "alpha"
    )  # not among those of the basic tables
    moved = transfer_moments(Effect("ground", {"CL": other}), (0.5, 0.0, 0.0), 1.0, 10.0, ALPHA)
    np.testing.assert_allclose(moved.tables["Cm"], 0.5 * other * np.cos(other["alpha"]))
    flat = xr.DataArray([0.0, -0.05], {"delta_a": [0.0, 0.3]}, "delta_a")
    turned = rotate_rolling_to_body(
        Effect("aileron", {"Cl": flat}), ALPHA
    )  # no yawing moment printed
    np.testing.assert_allclose(turned.tables["Cl"].sel(delta_a=0.3), -0.05 * np.cos(ALPHA))
    assert set(turned.tables) == {"Cl"}


def test_rates_about_another_point_are_those_of_the_moved_flow():
    """A pitch, roll or yaw rate about the new point moves the flow at the old one, which lies 0.4 m
    forward and 0.3 m below: velocities by hand, forces of the old point in the axes of the new one.
    """
    alpha = np.radians(np.arange(-8.0, 17.0, 2.0))
    chord, span, (dx, dz), V, rate = 2.0, 10.0, (0.4, 0.3), 100.0, 1e-3

    def forces(alpha):
        return 0.2 + 4.5 * alpha, 0.02 + 0.3 * alpha**2, 0.05 - 0.6 * alpha

    tables = [xr.DataArray(values, {"alpha": alpha}, "alpha") for values in forces(alpha)]
    basic = Effect("basic", dict(zip(("CL", "CD", "Cm"), tables, strict=True)))
    side = Effect(
        "beta", {"CY": xr.DataArray(np.full(alpha.size, -0.6), {"alpha": alpha}, "alpha")}
    )
    change = rate_shift(basic, side, (dx, 0.0, dz), chord, span)

    def at_the_old_point(q):
        u, w = V * np.cos(alpha) + q * dz, V * np.sin(alpha) - q * dx
        CL, CD, Cm = forces(np.arctan2(w, u))
        pressure = (u**2 + w**2) / V**2
        turn = np.arctan2(w, u) - alpha
        lift, drag = CL * np.cos(turn) + CD * np.sin(turn), CD * np.cos(turn) - CL * np.sin(turn)
        return pressure * np.array([lift, drag, Cm])

    by_hand = (at_the_old_point(rate) - at_the_old_point(-rate)) / (rate * chord / V)
    inside = slice(1, -1)  # one-sided slopes of the tables at the ends
    for name, expected in zip(("CL", "CD", "Cm"), by_hand, strict=True):
        np.testing.assert_allclose(change["qhat"][name][inside], expected[inside], atol=1e-7)
    # beta at the old point is (r dx - p dz) / V higher
    np.testing.assert_allclose(change["phat"]["CY"], -0.6 * -dz / V / (span / (2.0 * V)))
    np.testing.assert_allclose(change["rhat"]["CY"], -0.6 * dx / V / (span / (2.0 * V)))


def test_one_angle_of_attack_has_no_slope():
    """Only the tilt of the axes and the airspeed are left of the change, by hand at 4 deg."""
    angle = np.radians([4.0])
    tables = {"CL": 0.55, "CD": 0.02, "Cm": -0.01}
    basic = {
        name: xr.DataArray([value], {"alpha": angle}, "alpha") for name, value in tables.items()
    }
    with pytest.warns(AeromatchWarning, match="one angle of attack: .* without the slopes"):
        change = rate_shift(Effect("basic", basic), Effect("beta", {}), (0.0, 0.0, -0.1), 1.6, 10.0)
    tilt, speed = 0.125 * np.sin(angle), -0.125 * np.cos(angle)
    np.testing.assert_allclose(change["qhat"]["CL"], 0.02 * tilt + 2.0 * 0.55 * speed)
    np.testing.assert_allclose(change["qhat"]["Cm"], 2.0 * -0.01 * speed)


def test_a_move_of_the_reference_point_makes_no_derivative_of_its_own():
    """Cm_qhat is unknown about every point if it is unknown about one; CD_qhat has no method."""
    effect = Effect("qhat", {"CL": 8.0 + 0.0 * ALPHA}, "qhat")
    moved = transfer_moments(effect, (0.4, 0.0, 0.3), 2.0, 10.0, ALPHA)
    moved = with_added(moved, {"CL": 0.1 + 0.0 * ALPHA, "CD": 0.2 + 0.0 * ALPHA})
    assert set(moved.tables) == {"CL", "CD", "Cm"}
    assert set(without_partial_sums(moved, effect.tables).tables) == {"CL", "CD"}
