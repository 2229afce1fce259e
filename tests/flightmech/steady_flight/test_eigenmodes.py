"""Modes against closed forms, and their names against order, units, merging and divergence."""

from __future__ import annotations

import numpy as np
import pytest
import xarray as xr

import flightmech
from flightmech.steady_flight.eigenmodes import DUTCH_ROLL, PHUGOID, ROLL, SHORT_PERIOD, SPIRAL
from flightmech.steady_flight.linear_model import subset
from flightmech.units import G0

V = 90.0
LEVEL = {"init.V": V, "init.h": 1500.0}
STIFF = {"alpha": -400.0, "qhat": -1.0, "delta_e": -400.0}


def of(frame, name):
    rows = frame[frame["mode"] == name]
    assert len(rows) == 1, frame["mode"].tolist()
    return rows.iloc[0]


def matrix(A, states) -> xr.Dataset:
    return xr.Dataset(
        {"A": (("state", "state_"), np.asarray(A, float))},
        {"state": list(states), "state_": list(states)},
    )


def test_phugoid_of_lanchester(plain, plain_aircraft):
    """Without drag and with a pitch stiffness that holds alpha, omega = sqrt(2) g / V and no
    damping (Lanchester 1908; Etkin sec. 9.2).
    """
    sim = plain(CD={"": 0.0, "alpha alpha": 0.0}, Cm=STIFF)
    phugoid = of(flightmech.modes(flightmech.linearize(sim, LEVEL)), PHUGOID)
    # alpha still gives way by M_q / M_alpha of the pitch rate, 2e-5
    assert phugoid["omega_n"] == pytest.approx(np.sqrt(2.0) * G0 / V, rel=1e-4)
    assert phugoid["period"] == pytest.approx(np.pi * np.sqrt(2.0) * V / G0, rel=1e-4)
    assert abs(phugoid["damping_ratio"]) < 1e-3


def test_phugoid_damping_is_drag_over_lift(plain):
    """2 zeta omega = rho V S CD / m for constant thrust (Etkin sec. 9.2), so zeta = CD / (sqrt(2)
    CL), again with stiff pitch.
    """
    sim = plain(CD={"": 0.05, "alpha alpha": 0.0}, Cm=STIFF)
    phugoid = of(flightmech.modes(flightmech.linearize(sim, LEVEL)), PHUGOID)
    y = flightmech.trim(sim, {**LEVEL, "mode.earth": 0.0})
    assert phugoid["damping_ratio"] == pytest.approx(
        float(y["CD"] / y["CL"]) / np.sqrt(2.0), rel=0.02
    )  # terms of second order in CD/CL


def test_short_period_of_two_degrees(plain, plain_aircraft):
    """alpha and q alone: omega^2 = Z M_q - M_alpha, 2 zeta omega = Z - M_q - M_alphadot with Z =
    (qS CL_alpha + T cos alpha) / (m V).
    """
    sim, craft = plain(Cm={"alphadothat": -5.0}), plain_aircraft()
    found = of(
        flightmech.modes(flightmech.linearize(sim, LEVEL, states=("alpha", "q"))), SHORT_PERIOD
    )
    y = flightmech.trim(sim, {**LEVEL, "mode.earth": 0.0})
    qS, c = float(y["qbar"]) * craft.S, craft.cbar
    Z = (qS * 5.2 + float(y["engine1.thrust"]) * np.cos(float(y["alpha"]))) / (craft.mass * V)
    M, M_q, M_ad = (qS * c / craft.Iyy * x for x in (-0.8, -14.0 * c / (2 * V), -5.0 * c / (2 * V)))
    omega = np.sqrt(-Z * M_q - M)
    assert found["omega_n"] == pytest.approx(omega, rel=1e-8)
    assert found["damping_ratio"] == pytest.approx((Z - M_q - M_ad) / (2 * omega), rel=1e-8)
    assert found["period"] == pytest.approx(
        2 * np.pi / (omega * np.sqrt(1 - found["damping_ratio"] ** 2)), rel=1e-8
    )
    assert found["t_half"] == pytest.approx(
        np.log(2.0) / (omega * found["damping_ratio"]), rel=1e-8
    )


def test_roll_of_one_degree(plain, plain_aircraft):
    craft = plain_aircraft()
    found = of(flightmech.modes(flightmech.linearize(plain(), LEVEL, states=("p",))), ROLL)
    qbar = float(flightmech.trim(plain(), {**LEVEL, "mode.earth": 0.0})["qbar"])
    assert found["real"] == pytest.approx(
        qbar * craft.S * craft.b**2 * -0.45 / (2 * V * craft.Ixx), rel=1e-8
    )
    assert np.isnan(found["period"])
    assert found["damping_ratio"] == 1.0


def test_spiral_boundary(plain):
    """The spiral is neutral where Cl_beta Cn_r = Cn_beta Cl_r, for level flight at theta = 0 (Etkin
    sec. 9.7); theta is tan 2 deg here.
    """
    stable, unstable = (
        of(flightmech.modes(flightmech.linearize(plain(Cl={"rhat": r}), LEVEL)), SPIRAL)
        for r in (0.08, 0.16)
    )
    assert stable["t_half"] > 0.0
    assert np.isnan(stable["t_double"])
    assert unstable["t_double"] > 0.0
    assert np.isnan(unstable["t_half"])
    assert unstable["damping_ratio"] == -1.0
    assert unstable["remark"] == "unstable"


def test_names_depend_on_neither_order_nor_units(plain):
    found = flightmech.linearize(
        plain(), LEVEL, states=("V", "alpha", "q", "theta", "h", "beta", "p", "r", "phi", "psi")
    )
    expected = flightmech.modes(found)
    assert set(expected["mode"]) == {
        ROLL,
        SHORT_PERIOD,
        DUTCH_ROLL,
        PHUGOID,
        SPIRAL,
        "height",
        "heading",
    }
    rng = np.random.default_rng(3)
    for _ in range(5):
        order = rng.permutation(found.sizes["state"])
        scale = 10.0 ** rng.uniform(-2, 2, len(order))
        A = (found["A"].values * scale[:, None] / scale[None, :])[np.ix_(order, order)]
        again = flightmech.modes(matrix(A, found["state"].values[order]))
        by_name = {row["mode"]: row["omega_n"] for _, row in again.iterrows()}
        for _, row in expected.iterrows():
            assert by_name[row["mode"]] == pytest.approx(row["omega_n"], rel=1e-6, abs=1e-8)


def test_short_period_that_does_not_oscillate(plain):
    found = flightmech.modes(flightmech.linearize(plain(Cm={"qhat": -80.0}), LEVEL))
    pair = found[found["mode"] == SHORT_PERIOD]
    assert len(pair) == 2
    assert pair["remark"].str.contains("aperiodic").all()
    assert pair["period"].isna().all()


def test_aft_centre_of_gravity_merges_modes_and_diverges(plain):
    """Behind the neutral point a real mode diverges; between it and the manoeuvre point phugoid and
    short period make a third oscillation (Etkin sec. 9.4).
    """
    found = flightmech.modes(
        subset(flightmech.linearize(plain(Cm={"alpha": 0.15}), LEVEL), "longitudinal")
    )
    diverging = found[found["t_double"].notna()]
    assert len(diverging) == 1
    assert "unstable" in diverging.iloc[0]["remark"]
    pairs = found[found["period"].notna()]
    assert len(pairs) == 1
    assert pairs.iloc[0]["mode"] == "third oscillation"
    assert "merged of phugoid and short period" in pairs.iloc[0]["remark"]


def test_roll_and_spiral_that_merge():
    """Small roll damping with a strong Cl_r feedback of bank: p' = -0.4 p - 0.3 phi is an
    oscillation of p and phi.
    """
    A = [
        [-0.4, -0.3, 0.0, 0.0],
        [1.0, 0.0, 0.0, 0.0],
        [0.0, 0.01, -0.2, -1.0],
        [0.0, 0.0, 4.0, -0.3],
    ]
    found = flightmech.modes(matrix(A, ("p", "phi", "beta", "r")))
    merged = of(found, "roll-spiral oscillation")
    assert merged["omega_n"] == pytest.approx(np.sqrt(0.3), rel=1e-9)
    assert of(found, DUTCH_ROLL)["omega_n"] == pytest.approx(np.sqrt(4.06), rel=1e-9)


def test_ratio_of_bank_to_sideslip():
    """beta' = -r, r' = 4 beta, p = -3 beta for a roll that follows at once: phi = -3 int beta, so
    |phi/beta| = 3/2.
    """
    A = [[0.0, -1.0, 0.0], [4.0, 0.0, 0.0], [-3.0, 0.0, 0.0]]
    found = of(flightmech.modes(matrix(A, ("beta", "r", "phi"))), DUTCH_ROLL)
    assert found["phi_beta"] == pytest.approx(1.5, rel=1e-9)


def test_repeated_eigenvalues_are_stated():
    found = flightmech.modes(matrix([[-1.0, 1.0], [0.0, -1.0]], ("alpha", "q")))
    assert found["remark"].str.contains("repeated eigenvalues: the name is a guess").all()


def test_participation_sums_to_one(plain):
    found = flightmech.modes(flightmech.linearize(plain(), LEVEL))
    text = of(found, SHORT_PERIOD)["participation"]
    words = text.split()
    assert {words[0], words[2]} == {"alpha", "q"}
    assert float(words[1]) + float(words[3]) == pytest.approx(1.0, abs=0.05)
