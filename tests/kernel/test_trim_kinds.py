"""Kinds of steady flight: closed forms, balance of forces and moments from the outputs, and flights
that stay what they are.

The plain jet has constant derivatives, its centre of gravity at the reference point and thrust
through it, so that every kind has a closed form in the found angle of attack.  At sea level over
the flat Earth 100 m/s give 6125 Pa, on 17 m2 104 125 N (1.225 kg/m3 to 1e-7, hence the relative
tolerance of 1e-6).
"""

from __future__ import annotations

import numpy as np
import pytest
import xarray as xr

import flightmech
from flightmech import axes
from flightmech.aircraft.propulsion.engine_deck import EngineDeck
from flightmech.errors import SchemaError, SimulationError, UnknownName
from flightmech.steady_flight.trim_search import start_of
from flightmech.terms import make_term

G0 = 9.80665
V, QS, MASS, SPAN = 100.0, 104125.0, 2300.0, 10.3
WEIGHT = MASS * G0
LEVEL = {"init.V": V, "init.h": 0.0, "mode.earth": 0.0}
CRUISE = {"init.V": 110.0, "init.h": 3000.0, "init.psi": 0.7, "init.lat": 0.8}
PLAIN = {
    "CL/0": 0.1,
    "CL/a": (5.0, "alpha"),
    "CL/q": (6.0, "qhat"),
    "CD/0": 0.03,
    "CY/b": (-0.6, "beta"),
    "CY/r": (0.17, "delta_r"),
    "Cl/b": (-0.08, "beta"),
    "Cl/p": (-0.45, "phat"),
    "Cl/r": (0.1, "rhat"),
    "Cl/d": (-0.15, "delta_a"),
    "Cm/0": 0.04,
    "Cm/a": (-0.7, "alpha"),
    "Cm/q": (-13.0, "qhat"),
    "Cm/d": (-1.1, "delta_e"),
    "Cn/b": (0.1, "beta"),
    "Cn/r": (-0.14, "rhat"),
    "Cn/d": (-0.07, "delta_r"),
}
STEADY = ("V", "alpha", "beta", "gamma", "phi", "theta", "p", "q", "r")


def near(value, rel: float = 1e-6):
    return pytest.approx(value, rel=rel, abs=1e-9)


@pytest.fixture(scope="module")
def plain(make_aircraft, make_tree):
    """Compile the plain jet: two engines 0.8 m off the middle, driven by recorded thrust."""

    def build(more: dict | None = None, **changes) -> flightmech.SimModel:
        rows = {**PLAIN, **(more or {})}
        rows = {
            name: value if isinstance(value, tuple) else (value,) for name, value in rows.items()
        }
        engines = (
            flightmech.aircraft.Engine((0.0, -0.8, 0.0)),
            flightmech.aircraft.Engine((0.0, 0.8, 0.0)),
        )
        fixed = {"engines": engines, "cg": (0.0, 0.0, 0.0), "Ixy": 0.0, "Iyz": 0.0}
        leaves = {
            name: make_term(value, regressors=list(words)) for name, (value, *words) in rows.items()
        }
        return flightmech.compile(make_aircraft(**(fixed | changes)), make_tree(leaves))

    return build


@pytest.fixture(scope="module")
def steady(plain) -> flightmech.SimModel:
    return plain()


def numbers(found: xr.Dataset) -> dict[str, float]:
    return {str(name): float(item) for name, item in found.items() if not item.dims}


def solution(found: xr.Dataset) -> dict[str, float]:
    return dict(
        zip(map(str, found["unknown"].values), map(float, found["found"].values), strict=True)
    )


def earth_force(y: dict[str, float]) -> np.ndarray:
    """Specific force in axes along the horizontal track, to its right, and down."""
    turned = axes.matrix_from_euler(y["phi"], y["theta"], y["psi"]).T @ [y["ax"], y["ay"], y["az"]]
    track = np.arctan2(y["ve"], y["vn"])
    return (
        np.array(
            [
                [np.cos(track), np.sin(track), 0.0],
                [-np.sin(track), np.cos(track), 0.0],
                [0.0, 0.0, 1.0],
            ]
        )
        @ turned
    )


def rate_of_turn(y: dict[str, float]) -> float:
    return (y["q"] * np.sin(y["phi"]) + y["r"] * np.cos(y["phi"])) / np.cos(y["theta"])


KINDS = [
    ("level", {}),
    ("level", {"V_cas": 80.0}),
    ("climb", {"gamma": 0.06}),
    ("climb", {"hdot": -4.0}),
    ("climb", {"throttle": 0.9}),
    ("climb", {"theta": 0.05}),
    ("turn", {"phi": 0.8}),
    ("turn", {"phi": -0.8, "beta": 0.0}),
    ("turn", {"psi_dot": 0.06}),
    ("turn", {"nz": 1.5}),
    ("turn", {"phi": 0.5, "gamma": 0.05}),
    ("sideslip", {"beta": 0.08}),
    ("sideslip", {"delta_r": 0.1}),
    ("sideslip", {"phi": -0.05}),
    ("engine_out", {"engine1.failed": 1.0}),
    ("engine_out", {"engine2.failed": 1.0, "phi": 0.0}),
    ("engine_out", {"engine1.failed": 1.0, "delta_r": 0.05}),
    ("engine_out", {"engine2.failed": 1.0, "throttle": 1.0}),
]


@pytest.mark.nightly
@pytest.mark.parametrize("earth", [0.0, 1.0])
@pytest.mark.parametrize(("kind", "fixed"), KINDS)
def test_the_flight_stays_what_it_is(earth, kind, fixed, sim):
    """20 s on, without engine lag: nothing has moved, and heading and height went as they should.

    The jet with offset centre of gravity, all products of inertia and tables.  Over the rotating
    ellipsoid gravity changes on the way and the Coriolis acceleration, 0.016 m/s2, turns with the
    heading, hence the wider tolerances.
    """
    lag = {"engine1.time_constant": 0.0, "engine2.time_constant": 0.0}
    found = flightmech.trim(
        sim, {**CRUISE, **lag, "mode.earth": earth, "wind_n": 0.0}, kind=kind, fixed=fixed
    )
    assert found.attrs["verdict"] == "trimmed"
    assert found.attrs["converged"] == 1
    y = numbers(found)
    for name, value in fixed.items():
        if name in y:
            assert y[name] == near(value)
    climbs = abs(y["gamma"]) > 1e-9  # and the air changes with height: less time
    time = np.array([0.0, 0.05, 0.1]) if climbs else np.arange(0.0, 20.0, 0.1)
    flown = flightmech.simulate(sim, xr.Dataset(coords={"time": time}), start_of(found))
    tolerance = 1e-5 if climbs else 2e-6 if earth == 0.0 else 2e-3 if kind == "turn" else 2e-4
    for name in STEADY:
        assert float(np.abs(flown[name].values - y[name]).max()) < tolerance * max(
            1.0, abs(y[name])
        ), name
    heading = np.unwrap(flown["psi"].values) - y["psi"]
    np.testing.assert_allclose(heading, rate_of_turn(y) * time, atol=20.0 * tolerance)
    np.testing.assert_allclose(
        flown["h"] - y["h"],
        y["hdot"] * time,
        atol=2e-5 if earth == 0.0 else 2.0 if kind == "turn" else 2e-3,
    )


@pytest.mark.slow
@pytest.mark.parametrize(
    ("kind", "fixed"), [*KINDS, ("pull_up", {"nz": 1.8}), ("pull_up", {"q": 0.05})]
)
def test_force_and_acceleration_of_the_path(kind, fixed, sim):
    """What is felt, turned into axes of the path, carries the weight and bends the path: V^2
    cos(gamma) / R to the side, q V upward.
    """
    y = numbers(flightmech.trim(sim, {**CRUISE, "mode.earth": 0.0}, kind=kind, fixed=fixed))
    up = (
        y["q"] * np.cos(y["beta"]) if kind == "pull_up" else 0.0
    )  # the axis of q stands off the path by beta
    sideways = y["V"] * np.cos(y["gamma"]) * (0.0 if kind == "pull_up" else rate_of_turn(y))
    np.testing.assert_allclose(earth_force(y), [0.0, sideways, -G0 - y["V"] * up], atol=1e-9)
    assert max(abs(y[name]) for name in ("p_dot", "q_dot", "r_dot", "alpha_dot", "beta_dot")) < 1e-9
    if kind == "turn":
        assert y["beta" if "beta" in fixed else "ay"] == near(0.0)
        assert (y["p"], y["q"], y["r"]) == near(
            tuple(rate_of_turn(y) * axes.matrix_from_euler(y["phi"], y["theta"], 0.0)[:, 2])
        )  # theta and phi stand still


def test_climb_by_hand(steady):
    """Thrust 6000 N along body x: T cos a = 0.03 qS + W sin g along the path, (0.1 + 5 a) qS + T
    sin a = W cos g across it.
    """
    values = {**LEVEL, "mode.engine": 2.0}
    y = numbers(flightmech.trim(steady, values, kind="climb", fixed={"thrust": 3000.0}))
    a, g = y["alpha"], y["gamma"]
    assert 6000.0 * np.cos(a) == near(0.03 * QS + WEIGHT * np.sin(g))
    assert (0.1 + 5.0 * a) * QS + 6000.0 * np.sin(a) == near(WEIGHT * np.cos(g))
    assert y["hdot"] == near(V * np.sin(g))
    same = numbers(flightmech.trim(steady, values, kind="climb", fixed={"hdot": y["hdot"]}))
    assert same["engine1.thrust"] == near(3000.0)
    back = numbers(flightmech.trim(steady, values, kind="climb", fixed={"theta": y["theta"]}))
    assert (back["gamma"], back["engine2.thrust"]) == near((g, 3000.0))


def test_coordinated_turn_by_hand(steady):
    """Bank 45 deg, ay = 0: all force lies in the plane of symmetry, CY = 0 there, so beta = 0.17 /
    0.6 delta_r; moments with damping.

    Inertia: (Izz - Iyy) q r - Ixz p q and so on with Ixz = 350 kg m2 of the jet.
    """
    found = flightmech.trim(steady, LEVEL, kind="turn", fixed={"phi": np.pi / 4})
    y, deflection = numbers(found), solution(found)
    turn = deflection["psi_dot"]
    assert turn == near(rate_of_turn(y))
    assert turn * V * np.cos(y["gamma"]) == near(
        G0 * np.tan(np.pi / 4) * np.cos(y["theta"]), rel=2e-3
    )  # exact for alpha -> 0
    beta, delta_e, delta_a, delta_r = (
        deflection[name] for name in ("beta", "delta_e", "delta_a", "delta_r")
    )
    assert beta == near(0.17 / 0.6 * delta_r)
    phat, qhat, rhat = y["p"] * SPAN / (2 * V), y["q"] * 1.67 / (2 * V), y["r"] * SPAN / (2 * V)
    J = np.array([[10800.0, 0.0, -350.0], [0.0, 8100.0, 0.0], [-350.0, 0.0, 15100.0]])
    w = np.array([y["p"], y["q"], y["r"]])
    moment = QS * np.array(
        [
            SPAN * (-0.08 * beta - 0.45 * phat + 0.1 * rhat - 0.15 * delta_a),
            1.67 * (0.04 - 0.7 * y["alpha"] - 13.0 * qhat - 1.1 * delta_e),
            SPAN * (0.1 * beta - 0.14 * rhat - 0.07 * delta_r),
        ]
    )
    np.testing.assert_allclose(
        moment, np.cross(w, J @ w) + np.cross(w, 2 * 55.0 * np.array([0.0, 0.0, 0.0])), atol=1e-3
    )  # of 1e4 N m


def test_bank_rate_of_turn_and_load_factor_name_the_same_turn(steady):
    banked = flightmech.trim(steady, LEVEL, kind="turn", fixed={"phi": 1.0})
    y, turn = numbers(banked), solution(banked)["psi_dot"]
    for fixed in ({"psi_dot": turn}, {"nz": y["nz"]}):
        other = flightmech.trim(steady, LEVEL, kind="turn", fixed=fixed)
        assert float(other["phi"]) == near(1.0)
        assert solution(other)["delta_e"] == near(solution(banked)["delta_e"])


def test_the_turn_at_the_start_of_a_run_needs_no_body_rates(steady):
    """mode.trim 1 with init.psi_dot, bank and rate of turn of a coordinated turn: the same
    controls.
    """
    found = flightmech.trim(steady, {**LEVEL, "mode.engine": 2.0}, kind="turn", fixed={"phi": 0.6})
    y = flightmech.trim(
        steady, {**LEVEL, "init.phi": 0.6, "init.psi_dot": solution(found)["psi_dot"]}
    )
    assert max(abs(float(y[f"trim.{name}_dot"])) for name in "uvwpqr") < 1e-10
    for name in ("delta_e", "delta_a", "delta_r"):
        assert float(y[f"trim.{name}"]) == near(solution(found)[name])


def test_sideslip_by_hand(steady):
    """beta 4 deg: rudder and aileron hold Cn and Cl, the bank W sin(phi) cos(theta) = (0.6 beta -
    0.17 delta_r) qS.
    """
    beta = np.radians(4.0)
    found = flightmech.trim(steady, LEVEL, kind="sideslip", fixed={"beta": beta})
    delta_r = 0.1 * beta / 0.07
    deflection = solution(found)
    assert (deflection["delta_r"], deflection["delta_a"]) == near((delta_r, -0.08 * beta / 0.15))
    side = (0.6 * beta - 0.17 * delta_r) * QS
    assert np.sin(deflection["phi"]) * np.cos(float(found["theta"])) == near(side / WEIGHT)
    by_rudder = flightmech.trim(steady, LEVEL, kind="sideslip", fixed={"delta_r": delta_r})
    assert solution(by_rudder)["beta"] == near(beta)
    by_bank = flightmech.trim(steady, LEVEL, kind="sideslip", fixed={"phi": deflection["phi"]})
    assert solution(by_bank)["beta"] == near(beta)


def test_pull_up_by_hand(steady):
    """At the lowest point the lift carries W + m q V; nz is along body z, so n cos(a) + ax/g sin(a)
    = 1 + q V / g.
    """
    found = flightmech.trim(steady, LEVEL, kind="pull_up", fixed={"nz": 2.5})
    y, q = numbers(found), solution(found)["q"]
    assert y["nz"] == near(2.5)
    assert 2.5 * np.cos(y["alpha"]) + y["ax"] / G0 * np.sin(y["alpha"]) == near(1.0 + q * V / G0)
    qhat = q * 1.67 / (2 * V)
    assert solution(found)["delta_e"] == near((0.04 - 0.7 * y["alpha"] - 13.0 * qhat) / 1.1)
    assert (y["phi"], y["gamma"], y["p"], y["r"]) == near((0.0, 0.0, 0.0, 0.0))
    assert solution(flightmech.trim(steady, LEVEL, kind="pull_up", fixed={"q": q})).get("q") is None


def test_engine_out_by_hand(steady):
    """Left engine dead, beta = 0: the right one yaws left by 0.8 T, the rudder holds it, and its
    side force requires bank.
    """
    found = flightmech.trim(steady, LEVEL, kind="engine_out", fixed={"engine1.failed": 1.0})
    y, deflection = numbers(found), solution(found)
    T = y["engine2.thrust"]
    assert y["engine1.thrust"] == 0.0
    assert T * np.cos(y["alpha"]) == near(0.03 * QS)
    delta_r = -0.8 * T / (0.07 * QS * SPAN)
    assert deflection["delta_r"] == near(delta_r)
    assert np.sin(deflection["phi"]) * np.cos(y["theta"]) == near(-0.17 * delta_r * QS / WEIGHT)
    assert y["beta"] == near(0.0)
    level = flightmech.trim(
        steady, LEVEL, kind="engine_out", fixed={"engine1.failed": 1.0, "phi": 0.0}
    )
    beta = solution(level)["beta"]
    assert 0.6 * beta == near(0.17 * solution(level)["delta_r"])  # no side force with wings level
    assert 0.07 * solution(level)["delta_r"] == near(
        0.1 * beta - 0.8 * T / (QS * SPAN), rel=1e-4
    )  # the thrust changes with alpha


DECK = {
    "n1_command": make_term([0.3, 1.0], {"throttle": [0.0, 1.0]}),
    "n1_up_time": make_term(1.0),
    "corrected_thrust": make_term([0.0, 9000.0], {"corrected_n1": [0.2, 1.0]}),
    "corrected_n1_windmill": make_term([0.0, 0.3], {"mach": [0.0, 0.6]}),
    "windmill_thrust": make_term(-0.05, regressors=["qbar"]),
}


def test_a_dead_engine_with_a_deck_windmills(plain):
    """Fuel cut off: 0.05 m2 times dynamic pressure of drag on its side, n1 as the air turns it; the
    other one at full power climbs.
    """
    engines = tuple(
        flightmech.aircraft.Engine((0.0, y, 0.0), deck=EngineDeck(DECK)) for y in (-0.8, 0.8)
    )
    found = flightmech.trim(
        plain(engines=engines),
        LEVEL,
        kind="engine_out",
        fixed={"engine1.failed": 1.0, "throttle": 1.0},
    )
    assert found.attrs["verdict"] == "trimmed"
    y, deflection = numbers(found), solution(found)
    assert y["engine1.thrust"] == near(-0.05 * y["qbar"])
    theta = y["temperature"] / 288.15 * (1.0 + 0.2 * y["mach"] ** 2)  # of the total temperature
    assert y["engine1.n1"] == near(0.3 / 0.6 * y["mach"] * np.sqrt(theta))
    assert (y["engine2.n1"], deflection["gamma"] > 0.0) == (near(1.0), True)
    yaw = 0.8 * (y["engine1.thrust"] - y["engine2.thrust"])
    assert deflection["delta_r"] == near(yaw / (0.07 * y["qbar"] * 17.0 * SPAN))
    assert start_of(found)["engine1.cutoff"] == 1.0


def test_minimum_control_speed_by_hand(steady):
    """Full rudder, 5 deg of bank towards the live engine, full thrust there: the speed is unknown.
    Two equations for beta and qS.
    """
    thrust, full, bank = 9000.0, -0.35, np.radians(5.0)
    asked = ("alpha", "beta", "delta_e", "delta_a", "V", "gamma")
    fixed = {"engine1.failed": 1.0, "engine2.thrust": thrust, "delta_r": full, "phi": bank}
    found = flightmech.trim(
        steady, {**LEVEL, "mode.engine": 2.0}, kind="engine_out", unknowns=asked, fixed=fixed
    )
    assert found.attrs["verdict"] == "trimmed"
    y = numbers(found)
    qS = y["qbar"] * 17.0
    assert qS * (-0.6 * y["beta"] + 0.17 * full) == near(
        -WEIGHT * np.sin(bank) * np.cos(y["theta"])
    )
    assert qS * SPAN * (0.1 * y["beta"] - 0.07 * full) == near(0.8 * thrust)
    assert y["V"] < 70.0


def test_the_limit_that_was_hit_is_named(steady):
    """At 40 m/s the rudder cannot hold 9000 N on one side without sideslip."""
    values = {**LEVEL, "init.V": 40.0, "mode.engine": 2.0, "engine2.thrust_drive": 9000.0}
    fixed = {"engine1.failed": 1.0, "engine2.thrust": 9000.0}
    found = flightmech.trim(steady, values, kind="engine_out", fixed=fixed)
    assert (found.attrs["converged"], found.attrs["at_limit"]) == (0, "delta_r")
    assert float(found["limit"].sel(unknown="delta_r")) == -1.0
    assert found.attrs["verdict"].startswith(
        "not trimmed; delta_r at its lower limit -0.35; left over: "
    )
    rudder, qSb = 0.35 * 0.07, float(found["qbar"]) * 17.0 * SPAN
    assert (
        abs(float(found["left"].sel(residual="r_dot")))
        > 0.5 * (0.8 * 9000.0 - rudder * qSb) / 15100.0
        > 0.0
    )


def test_limits_are_those_of_the_aircraft(sim):
    found = flightmech.trim(sim, {**CRUISE, "mode.earth": 0.0}, kind="climb", fixed={"gamma": 0.5})
    assert found.attrs["at_limit"] == "throttle"
    assert float(found["engine1.thrust"]) > 2000.0
    assert "throttle at its upper limit 1;" in found.attrs["verdict"]
    assert float(found["left"].sel(residual="u_dot")) == pytest.approx(float(found["trim.u_dot"]))
    assert float(found["trim.u_dot"]) < -1.0


def test_unknowns_without_effect_and_those_that_do_the_same(plain):
    tab = plain({"Cm/t": (-0.2, "delta_t")})
    asked = ("alpha", "beta", "delta_e", "delta_a", "delta_r", "power", "delta_f", "delta_t")
    found = flightmech.trim(tab, LEVEL, unknowns=asked)
    assert found.attrs["without_effect"] == "delta_f"
    assert solution(found)["delta_f"] == 0.0
    assert found.attrs["rank"] == 6
    # a surplus is shared out by the smallest norm: in the proportion of the effects, 1.1 to 0.2
    assert solution(found)["delta_t"] == near(0.2 / 1.1 * solution(found)["delta_e"], rel=1e-3)
    pitch = flightmech.trim(
        tab,
        LEVEL,
        unknowns=("alpha", "delta_e", "delta_t", "power"),
        residuals=("u_dot", "w_dot", "q_dot", "CY"),
        fixed={"gamma": 0.0},
    )
    assert (pitch.attrs["alike"], pitch.attrs["rank"]) == ("delta_e delta_t", 3)
    assert "only together: delta_e, delta_t" in pitch.attrs["verdict"]


def test_any_parameter_can_be_unknown(steady):
    """The centre of gravity at which the elevator stays at zero: Cm + CL x / cbar cos(a) ... = 0
    about it.
    """
    asked = ("alpha", "beta", "delta_a", "delta_r", "power", "mass.x_cg_b")
    found = flightmech.trim(
        steady, {**LEVEL, "mode.engine": 2.0}, unknowns=asked, fixed={"delta_e": 0.0}
    )
    y = numbers(found)
    x, a = solution(found)["mass.x_cg_b"], y["alpha"]
    normal = (0.1 + 5.0 * a) * np.cos(a) + 0.03 * np.sin(
        a
    )  # of the aerodynamic force, up along body z
    assert 1.67 * (0.04 - 0.7 * a) == near(normal * x)
    assert y["q_dot"] == near(0.0)


def test_one_engine_at_a_given_thrust(sim):
    """The lever of the first engine brings it to 800 N, that of the other one does the rest."""
    found = flightmech.trim(sim, {**CRUISE, "mode.earth": 0.0}, fixed={"engine1.thrust": 800.0})
    assert found.attrs["verdict"] == "trimmed"
    assert float(found["engine1.thrust"]) == near(800.0)
    assert solution(found)["engine1.throttle"] != solution(found)["throttle"]


def test_power_given_in_level_flight_determines_the_speed(sim):
    level = flightmech.trim(sim, {**CRUISE, "mode.earth": 0.0}, kind="level")
    asked = flightmech.trim(
        sim,
        {**CRUISE, "init.V": 130.0, "mode.earth": 0.0},
        kind="level",
        fixed={"throttle": solution(level)["throttle"]},
    )
    assert solution(asked)["V"] == near(110.0)


def test_given_accelerations(steady):
    y = numbers(flightmech.trim(steady, LEVEL, fixed={"u_dot": 0.5}))
    assert y["engine1.thrust"] + y["engine2.thrust"] == near(
        y["qbar"] * 17.0 * y["CD"] / np.cos(y["alpha"]) + 0.5 * MASS, rel=2e-2
    )
    assert y["trim.u_dot"] == near(0.0)


def test_start_of_holds_what_was_given(sim):
    found = flightmech.trim(sim, {**CRUISE, "delta_f": 0.3, "mode.earth": 0.0}, kind="level")
    start = start_of(found)
    assert (start["delta_f"], start["mode.trim"], start["init.V"], start["init.psi"]) == (
        0.3,
        0.0,
        110.0,
        0.7,
    )
    y = flightmech.trim(sim, start)  # mode.trim 0: the kernel starts there and solves for nothing
    for name in ("alpha", "beta", "theta", "phi", "applied.delta_e", "engine2.thrust", "gamma"):
        assert float(y[name]) == pytest.approx(float(found[name]), abs=1e-14), name
    with pytest.raises(SchemaError, match="no variable start; trim with a kind"):
        start_of(flightmech.trim(sim, CRUISE))


def test_wind_in_a_climb_is_over_the_ground(sim):
    y = numbers(
        flightmech.trim(
            sim,
            {**CRUISE, "mode.earth": 0.0, "wind_n": -20.0, "wind_d": 3.0},
            kind="climb",
            fixed={"gamma": 0.05},
        )
    )
    assert y["gamma"] == near(0.05)
    assert y["V"] == near(110.0)


@pytest.mark.parametrize(
    ("arguments", "text"),
    [
        ({"kind": "turn"}, "no value of phi, psi_dot or nz; give one in fixed"),
        (
            {"kind": "turn", "fixed": {"phi": 0.5, "psi_dot": 0.1}},
            r"7 residuals \(.*ay\) against 6 unknowns \(.*\); free 1 more, fix fewer",
        ),
        ({"unknowns": ("alpha",)}, r"6 residuals \(.*\) against 1 unknowns \(alpha\); free 5 more"),
        (
            {"unknowns": ("alpha", "alpha"), "residuals": ("w_dot",)},
            "alpha is named twice among the unknowns",
        ),
        (
            {
                "unknowns": ("alpha", "throttle"),
                "residuals": ("w_dot",),
                "fixed": {"throttle": 1.0},
            },
            "throttle is fixed and unknown at once",
        ),
        (
            {"unknowns": ("alpha", "theta", "gamma"), "residuals": ("w_dot",)},
            "theta and gamma are both unknown",
        ),
        (
            {
                "kind": "engine_out",
                "unknowns": ("alpha", "throttle"),
                "residuals": ("w_dot",),
                "fixed": {"engine1.failed": 1, "engine2.failed": 1},
            },
            "no engine is left for throttle",
        ),
    ],
)
def test_requests_that_contradict_themselves(arguments, text, sim):
    with pytest.raises(SchemaError, match=text):
        flightmech.trim(sim, CRUISE, **arguments)


def test_no_speed_is_an_error(sim):
    with pytest.raises(SimulationError, match=r"init.V = 0.5 m/s; a trim needs more than 1 m/s"):
        flightmech.trim(sim, {"init.V": 0.5}, kind="level")


def test_a_mode_that_is_none_is_refused_by_the_kernel(sim):
    with pytest.raises(SimulationError, match=r"mode.engine is 7; it must be 0"):
        flightmech.trim(sim, CRUISE, fixed={"mode.engine": 7.0})


@pytest.mark.parametrize(
    ("arguments", "text"),
    [
        ({"kind": "looping"}, "unknown kind of trim 'looping'"),
        ({"fixed": {"bank": 0.1}}, "unknown quantity 'bank'"),
        (
            {"unknowns": ("nz",), "residuals": ("w_dot",)},
            "unknown quantity to solve for 'nz'.*an output cannot be moved, it can be fixed",
        ),
        ({"residuals": ("lift",)}, "unknown residual 'lift'"),
        ({"fixed": {"engine7.failed": 1.0}}, "unknown engine 'engine7.failed'"),
        (
            {"kind": "level", "parameters": {"init.speed": 1.0}},
            "unknown parameter or input 'init.speed'",
        ),
    ],
)
def test_names_that_the_model_does_not_have(arguments, text, sim):
    given = {"parameters": CRUISE} | arguments
    with pytest.raises(UnknownName, match=text):
        flightmech.trim(sim, **given)
