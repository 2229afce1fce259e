"""Control circuits: what drives them, hinge moments, cables, ailerons, friction, trim, flight with
the stick free; bad numbers.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
import xarray as xr
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.integrate import solve_ivp

import flightmech
from flightmech.aircraft.aircraft_file import read_aircraft
from flightmech.aircraft.controls import Circuit, ControlGeometry
from flightmech.aircraft.landing_gear import Contact, LandingGear, Steering
from flightmech.errors import AeromatchWarning, SchemaError, SimulationError
from flightmech.simulation.kernel import INPUT, OUTPUT, PARAMETER
from flightmech.terms import make_term

G0 = 9.80665
CONTROLS = {
    "delta_e": ControlGeometry(1.0, 0.35, -1.5),
    "delta_a": ControlGeometry(0.8, 0.25, -0.3),
    "delta_r": ControlGeometry(0.6, 0.4, -3.0),
}
COLUMN = Circuit((-0.15, 0.2), 6.0, inertia=1.0, damping=10.0)
WHEEL = Circuit((-1.2, 1.2), 0.2, inertia=0.4, damping=0.5, arm=4.0)
PEDAL = Circuit((-0.1, 0.1), 8.0, inertia=0.5, damping=20.0)
CABLE = {"order": 4, "cable_stiffness": 2e4, "cable_damping": 20.0}
CIRCUITS = {"column": COLUMN, "wheel": WHEEL, "pedal": PEDAL}
HINGES = {
    "Ch_e/delta": make_term(-0.35, regressors=["delta_e"]),
    "Ch_e/alpha": make_term(-0.1, regressors=["alpha"]),
    "Ch_e/tab": make_term(-0.2, regressors=["delta_t"]),
    "Ch_a/delta": make_term(-0.3, regressors=["delta_a"]),
    "Ch_a/alpha": make_term(-0.12, regressors=["alpha"]),
    "Ch_a/tab": make_term(-0.15, regressors=["delta_ta"]),
    "Ch_r/delta": make_term(-0.3, regressors=["delta_r"]),
    "Ch_r/beta": make_term(0.1, regressors=["beta"]),
}
BALLISTIC = {"init.V": 200.0, "init.h": 3000.0, "mode.earth": 0.0}
FLIGHT = {"init.V": 90.0, "init.h": 1500.0, "mode.trim": 1.0}


@pytest.fixture(scope="module")
def build(make_aircraft, make_tree, content):
    """A jet with circuits; with `air` only hinge moments act, so that it falls."""

    def compiled(air: bool = True, hinges=HINGES, **fields) -> flightmech.SimModel:
        terms = {**content, **hinges} if air else {"CD/basic": make_term(0.0), **hinges}
        circuits = fields.pop("circuits", CIRCUITS)
        engines = {} if air else {"engines": ()}
        return flightmech.compile(
            make_aircraft(
                **{"controls": CONTROLS, "circuits": circuits, "limits": {}, **engines, **fields}
            ),
            make_tree(terms),
        )

    return compiled


@pytest.fixture(scope="module")
def every(build) -> flightmech.SimModel:
    return build()


def flown(sim, time, inputs=None, step=0.01, **parameters) -> xr.Dataset:
    """Fly; a dot in the name of a parameter is written __."""
    values = {name.replace("__", "."): value for name, value in parameters.items()}
    table = xr.Dataset(
        {
            name: ("time", np.broadcast_to(value, len(time)))
            for name, value in (inputs or {}).items()
        },
        {"time": time},
    )
    return flightmech.simulate(sim, table, values, step=step)


def grid(end: float, h: float = 0.01) -> np.ndarray:
    return h * np.arange(round(end / h) + 1)


# ---- surfaces drive
# --------------------------------------------------------------------------------------------------


def test_hinge_moment_and_the_force_that_holds_it(every):
    """Mode 0 at rest: H = qbar S c Ch, and the pilot pulls against it with -gearing H."""
    y = flown(
        every,
        grid(0.0),
        {"delta_e": -0.05, "delta_t": 0.02, "delta_r": 0.04},
        **BALLISTIC,
        init__alpha=0.03,
        init__beta=0.02,
    ).isel(time=0)
    H = float(y["qbar"]) * 1.0 * 0.35 * (-0.35 * -0.05 - 0.1 * 0.03 - 0.2 * 0.02)
    assert float(y["column.hinge_moment"]) == pytest.approx(H, rel=1e-9)
    assert float(y["column.F_aer"]) == pytest.approx(1.5 * H, rel=1e-9)
    assert float(y["applied.F_column"]) == pytest.approx(1.5 * H, rel=1e-9)
    assert float(y["applied.column"]) == pytest.approx(-0.05 / -1.5)
    assert float(y["column.deflection"]) == pytest.approx(-0.05)
    H_r = float(y["qbar"]) * 0.6 * 0.4 * (-0.3 * 0.04 + 0.1 * float(y["beta"]))
    assert float(y["applied.F_pedal"]) == pytest.approx(3.0 * H_r, rel=1e-9)


def test_force_of_a_recorded_motion(build):
    """F = m s'' + W s' + C (s - neutral) + F_aer + F_coul + F_g, the elevator deflected along a
    parabola.
    """
    column = replace(
        COLUMN,
        stiffness=120.0,
        neutral=0.01,
        friction=14.0,
        hinge_friction=2.0,
        hinge_damping=3.0,
        bob_weight=0.7,
    )
    t = grid(0.5)
    y = flown(
        build(air=False, circuits={"column": column}), t, {"delta_e": -0.3 * t**2}, **BALLISTIC
    )
    s, rate, acceleration = 0.2 * t**2, 0.4 * t, 0.4
    mass, damping, friction = 6.0 + 1.5**2, 10.0 + 3.0 * 1.5**2, 14.0 + 2.0 * 1.5
    assert y["applied.column"].values == pytest.approx(s, abs=1e-12)
    # the rate is the mean over the last step, half a step old
    F = (
        mass * acceleration
        + damping * (rate - 0.002)
        + 120.0 * (s - 0.01)
        + y["column.F_aer"].values
        + friction
        + y["column.F_g"].values
    )
    assert y["applied.F_column"].values[2:] == pytest.approx(F[2:], rel=1e-9)
    assert y["column.F_coul"].values[1:] == pytest.approx(friction)


def test_cockpit_leads_the_surface_by_the_stretch_of_the_cable(build):
    y = flown(
        build(circuits={"column": replace(COLUMN, **CABLE)}),
        grid(0.0),
        {"delta_e": -0.1},
        **BALLISTIC,
    ).isel(time=0)
    assert float(y["applied.column"]) == pytest.approx(
        0.1 / 1.5 + float(y["applied.F_column"]) / 2e4, rel=1e-12
    )
    assert float(y["column.F_aer"]) > 300.0


# ---- cockpit positions drive
# ---------------------------------------------------------------------------------------------


def test_positions_move_the_surfaces(build):
    """Order 2: deflection = rigging + gearing s + slope s^2 / 2, ailerons with opposite travel;
    biases come on top.
    """
    column = replace(COLUMN, gearing_slope=-2.0, rigging=0.01)
    wheel = replace(WHEEL, gearing_slope=-0.06, rigging=0.02)
    sim = build(circuits={"column": column, "wheel": wheel})
    t = grid(0.2)
    y = flown(
        sim,
        t,
        {"column": 0.5 * t, "wheel": -2.0 * t, "delta_r": 0.03},
        mode__controls=1,
        bias__delta_e=0.004,
        **BALLISTIC,
    )
    s, w = 0.5 * t, -2.0 * t
    assert y["applied.delta_e"].values == pytest.approx(0.01 - 1.5 * s - s**2 + 0.004, abs=1e-14)
    right, left = 0.02 - 0.3 * w - 0.03 * w**2, 0.02 + 0.3 * w - 0.03 * w**2
    assert y["applied.delta_a"].values == pytest.approx(0.5 * (right - left), abs=1e-14)
    assert y["wheel.symmetric"].values == pytest.approx(0.5 * (right + left), abs=1e-14)
    assert y["applied.delta_r"].values == pytest.approx(0.03)
    assert y["applied.column"].values == pytest.approx(s)


def test_positions_stop_at_the_stops(every):
    with pytest.warns(AeromatchWarning, match="column reaches 50 cm, its limit is 20 cm"):
        y = flown(every, grid(0.0), {"column": 0.5}, mode__controls=1, **BALLISTIC)
    assert float(y["applied.column"][0]) == 0.2
    assert float(y["applied.delta_e"][0]) == pytest.approx(-0.3)


def test_surface_is_held_by_its_cable(build):
    """Order 4 at rest under a held column: the cable carries the hinge moment, before and after a
    move.
    """
    sim = build(
        air=False,
        circuits={"column": replace(COLUMN, cable_damping=150.0, order=4, cable_stiffness=8e3)},
    )
    t = grid(3.0)
    y = flown(sim, t, {"column": np.clip(0.3 * (t - 0.1), 0.0, 0.1)}, mode__controls=1, **BALLISTIC)
    stretch = y["column.deflection"].values / -1.5 - y["applied.column"].values
    assert stretch[0] == pytest.approx(-y["column.F_aer"].values[0] / 8e3, rel=1e-10)
    # the hinge moment goes on growing with alpha as the aircraft falls, against inertia and dampers
    assert stretch[-1] == pytest.approx(-y["column.F_aer"].values[-1] / 8e3, rel=4e-3)
    assert y["column.F_aer"].values[-1] > 200.0
    assert y["applied.F_column"].values[-1] == pytest.approx(y["column.F_aer"].values[-1], rel=4e-3)


# ---- forces drive
# --------------------------------------------------------------------------------------------------


@pytest.mark.nightly
def test_response_to_a_force_against_an_integrator(build):
    """Order 4 and order 6 under a pulse of force: the equations once more, with the dynamic
    pressure that the aircraft meets.
    """
    column = replace(COLUMN, **CABLE, stiffness=100.0)
    wheel = replace(WHEEL, order=6, cable_stiffness=300.0, cable_damping=0.3, arm=0.0, damping=0.8)
    sim = build(
        air=False,
        hinges={name: leaf for name, leaf in HINGES.items() if name.endswith("delta")},
        circuits={"column": column, "wheel": wheel},
    )
    t = grid(1.0, 0.005)
    F, torque = 60.0 * np.sin(4.0 * t) ** 2, 8.0 * np.sin(6.0 * t)
    y = flown(
        sim,
        t,
        {"F_column": F, "F_wheel": torque},
        step=0.005,
        mode__controls=2,
        column__step=2.5e-4,
        wheel__step=2.5e-4,
        **BALLISTIC,
    )
    qbar = lambda at: np.interp(at, t, y["qbar"].values)  # noqa: E731

    def elevator(at, x):
        k_aer = qbar(at) * 1.0 * 0.35 * 0.35 * 1.5**2
        pull = 2e4 * (x[1] - x[0]) + 20.0 * (x[3] - x[2])
        return (
            x[2],
            x[3],
            (np.interp(at, t, F) + pull - 10.0 * x[2] - 100.0 * x[0]) / 6.0,
            (-pull - k_aer * x[1]) / (1.0 * 1.5**2),
        )

    def ailerons(at, x):
        k_aer = qbar(at) * 0.4 * 0.25 * 0.3 * 0.3**2
        pulls = 300.0 * (x[1:3] - x[0]) + 0.3 * (x[4:6] - x[3])
        return (
            *x[3:],
            (np.interp(at, t, torque) + pulls.sum() - 0.8 * x[3]) / 0.2,
            *((-pulls - k_aer * x[1:3]) / (0.2 * 0.3**2)),
        )

    for rates, n, item, gearing in ((elevator, 2, "column", -1.5), (ailerons, 3, "wheel", -0.3)):
        counterpart = solve_ivp(
            rates, (0.0, 1.0), np.zeros(2 * n), t_eval=t, rtol=1e-9, atol=1e-12, max_step=0.005
        ).y
        # midpoint rule in sub-steps and load linear over steps of 5 ms: 2nd order
        assert y[f"applied.{item}"].values == pytest.approx(
            counterpart[0], abs=2e-4 * np.abs(counterpart[0]).max()
        )
        assert y[f"{item}.deflection"].values == pytest.approx(
            gearing * counterpart[1], abs=2e-4 * np.abs(gearing * counterpart[1]).max()
        )


def test_coupling_with_the_flight_is_of_second_order(build):
    """Stick free after a pull: halving the step of the rigid body divides the error by four."""
    sim = build(circuits={"column": replace(COLUMN, **CABLE)})
    t = grid(1.6, 0.04)
    F = np.interp(t, [0.0, 0.2, 0.4], [0.0, 25.0, 0.0])

    def end(step):
        y = flown(sim, t, {"F_column": F}, step=step, mode__controls=2, column__step=2e-4, **FLIGHT)
        return float(y["q"][-1])

    coarse, middle, fine = end(0.02), end(0.01), end(0.005)
    assert abs(middle - fine) > 1e-9
    assert (coarse - middle) / (middle - fine) == pytest.approx(4.0, abs=0.7)


def test_pull_raises_the_nose(every):
    """On top of the trimmed forces: aft column, nose up; wheel right, roll right; right foot, nose
    right.
    """
    t = grid(0.4)
    more = {"F_column": 40.0, "F_wheel": 4.0, "F_pedal": 60.0}
    trimmed = flown(every, t, mode__controls=2, **FLIGHT)
    forces = {
        name: float(trimmed[f"trim.{name}"][0]) + np.where(t > 0.0, push, 0.0)
        for name, push in more.items()
    }
    pushed = flown(every, t, forces, mode__controls=2, **FLIGHT)
    for item, rate in (("column", "q"), ("wheel", "p"), ("pedal", "r")):
        assert float(pushed[f"applied.F_{item}"][-1]) == pytest.approx(
            forces[f"F_{item}"][-1], abs=1e-6
        )
        assert float(pushed[f"applied.{item}"][-1]) > float(trimmed[f"applied.{item}"][-1])
        assert float(pushed[rate][-1]) > float(trimmed[rate][-1])


def test_controls_at_rest_in_flight_stay_at_rest(build):
    """Trimmed, hands off: friction holds every circuit to the last bit, however the loads
    wander.
    """
    items = {
        "column": replace(COLUMN, friction=12.0, **CABLE),
        "wheel": replace(WHEEL, friction=1.5),
        "pedal": replace(PEDAL, friction=25.0),
    }
    items["column"] = replace(items["column"], hinge_friction=10.0)
    y = flown(build(circuits=items), grid(60.0, 0.02), step=0.02, mode__controls=2, **FLIGHT)
    for item in items:
        assert np.ptp(y[f"applied.{item}"].values) == 0.0
        assert np.ptp(y[f"{item}.deflection"].values) == 0.0
        assert np.ptp(y[f"{item}.hinge_moment"].values) > 0.0
        assert float(np.abs(y[f"{item}.F_coul"]).max()) <= items[item].friction + items[
            item
        ].hinge_friction * abs(CONTROLS["delta_e"].gearing)


def test_stick_free_surface_floats(build):
    """Without friction and force the elevator goes where its hinge moment is zero, and the tab
    moves it.
    """
    sim = build(air=False, circuits={"column": replace(COLUMN, damping=150.0)})
    y = flown(
        sim,
        grid(4.0),
        {"delta_t": 0.03},
        mode__controls=2,
        column__trim_limit=0.0,
        init__alpha=0.05,
        **BALLISTIC,
    ).isel(time=-1)
    # alpha goes on changing as the aircraft falls: the surface lags by the damping
    floating = (0.1 * float(y["alpha"]) + 0.2 * 0.03) / -0.35
    assert float(y["applied.delta_e"]) == pytest.approx(floating, abs=4e-4)
    assert floating < -0.02


def test_stop_takes_the_rest(build):
    sim = build(
        air=False,
        circuits={"column": replace(COLUMN, damping=100.0)},
        limits={"delta_e": (-0.27, 0.3)},
    )
    y = flown(
        sim, grid(2.0), {"F_column": 2000.0}, mode__controls=2, column__trim_limit=0.0, **BALLISTIC
    ).isel(time=-1)
    assert float(y["applied.column"]) == pytest.approx(0.18, rel=1e-14)
    assert float(y["applied.delta_e"]) == pytest.approx(-0.27)
    assert float(y["column.rate"]) == 0.0
    assert float(y["column.F_stop"]) == pytest.approx(2000.0 - float(y["column.F_aer"]), rel=1e-3)


# ---- trim
# --------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("order", [2, 4])
def test_start_with_forces_holds_the_trimmed_deflection(build, order):
    """The lacking force is reported, and with it as the recorded force nothing lacks."""
    circuits = {
        "column": replace(COLUMN, **(CABLE | {"order": order}), bob_weight=0.6, unbalance=0.2),
        "wheel": replace(
            WHEEL, order=2 if order == 2 else 6, cable_stiffness=40.0, gearing_slope=-0.05
        ),
        "pedal": replace(PEDAL, stiffness=300.0, preload=4.0),
    }
    sim = build(circuits=circuits)
    surfaces = flown(sim, grid(0.0), **FLIGHT, init__beta=0.02, init__phi=0.1).isel(time=0)
    forced = flown(sim, grid(0.0), **FLIGHT, init__beta=0.02, init__phi=0.1, mode__controls=2).isel(
        time=0
    )
    for item, control in (("column", "delta_e"), ("wheel", "delta_a"), ("pedal", "delta_r")):
        assert float(forced[f"applied.{control}"]) == pytest.approx(
            float(surfaces[f"applied.{control}"]), abs=1e-9
        )
        # ailerons on soft cables droop one by one in mode 2; mode 0 holds both to the recorded
        # deflection
        assert float(forced[f"trim.F_{item}"]) == pytest.approx(
            float(surfaces[f"applied.F_{item}"]), rel=1e-7 if order == 2 else 2e-3
        )
    given = {f"F_{item}": float(forced[f"trim.F_{item}"]) for item in circuits}
    again = flown(sim, grid(2.0), given, **FLIGHT, init__beta=0.02, init__phi=0.1, mode__controls=2)
    for item, control in (("column", "delta_e"), ("wheel", "delta_a"), ("pedal", "delta_r")):
        assert float(again[f"trim.F_{item}"][0]) == pytest.approx(0.0, abs=1e-7)
        assert again[f"applied.{control}"].values[:10] == pytest.approx(
            float(again[f"applied.{control}"][0]), abs=2e-5
        )


def test_trim_limit_and_bias(build):
    sim = build(circuits={"column": COLUMN})
    full = float(flown(sim, grid(0.0), mode__controls=2, **FLIGHT)["trim.F_column"][0])
    assert abs(full) > 5.0
    cut = flown(sim, grid(0.5), mode__controls=2, column__trim_limit=3.0, **FLIGHT)
    assert float(cut["trim.F_column"][0]) == np.sign(full) * 3.0
    assert abs(float(cut["applied.column"][-1] - cut["applied.column"][0])) > 1e-3
    biased = flown(sim, grid(0.0), mode__controls=2, bias__F_column=7.0, **FLIGHT)
    assert float(biased["trim.F_column"][0]) == pytest.approx(full - 7.0)
    assert float(biased["applied.F_column"][0]) == pytest.approx(full)


@pytest.mark.parametrize("order", [2, 4])
def test_friction_holds_the_start_as_far_as_it_can(build, order):
    """A force that is within friction of that which holds the control lacks nothing; beyond, only
    the excess is added.
    """
    column = replace(
        COLUMN,
        **(CABLE | {"order": order}),
        friction=6.0,
        stiction=1.0,
        hinge_friction=2.0,
        trim_friction=1.0,
    )
    sim = build(circuits={"column": column})
    full = float(
        flown(sim, grid(0.0), mode__controls=2, column__trim_friction=0.0, **FLIGHT)[
            "trim.F_column"
        ][0]
    )
    band = (
        7.0 + 2.0 * 1.5
    )  # friction and stiction in the cockpit, friction at the hinge times the gearing
    for off in (-band - 3.0, 0.0, 0.5 * band, band + 5.0):
        y = flown(sim, grid(0.5), {"F_column": full - off}, mode__controls=2, **FLIGHT)
        assert float(y["trim.F_column"][0]) == pytest.approx(
            off - np.clip(off, -band, band), abs=1e-7
        )
        if abs(off) < band:  # at its edge the least change of the loads moves the elevator
            assert float(np.ptp(y["applied.delta_e"].values)) < 1e-6
    half = flown(
        sim,
        grid(0.0),
        {"F_column": full - band},
        mode__controls=2,
        column__trim_friction=0.5,
        **FLIGHT,
    )
    assert float(half["trim.F_column"][0]) == pytest.approx(0.5 * band, abs=1e-7)
    with pytest.raises(
        SimulationError, match=r"column\.trim_friction is 1\.5; it must be between 0 and 1"
    ):
        flown(sim, grid(0.0), mode__controls=2, column__trim_friction=1.5, **FLIGHT)


def test_positions_and_surfaces_trim_to_the_same_flight(every):
    """In mode 1 the deflection of the linkage is only what the biases start from."""
    by_surface = flown(every, grid(0.0), **FLIGHT).isel(time=0)
    by_column = flown(every, grid(0.0), {"column": 0.02}, mode__controls=1, **FLIGHT).isel(time=0)
    assert float(by_column["applied.delta_e"]) == pytest.approx(
        float(by_surface["applied.delta_e"]), abs=1e-9
    )
    assert float(by_column["trim.delta_e"]) == pytest.approx(
        float(by_surface["trim.delta_e"]) + 0.03, abs=1e-9
    )
    assert float(by_column["column.hinge_moment"]) == pytest.approx(
        float(by_surface["column.hinge_moment"]), rel=1e-6
    )


# ---- loads
# --------------------------------------------------------------------------------------------------


def test_ailerons_each_see_their_own_air(build):
    """Level, their moments of angle of attack cancel at the wheel; rolling they do not, and each
    floats up on its cable.
    """
    wheel = replace(WHEEL, order=6, cable_stiffness=60.0)
    sim = build(air=False, circuits={"wheel": wheel})
    still = flown(sim, grid(0.0), mode__controls=1, init__alpha=0.1, **BALLISTIC).isel(time=0)
    qS = float(still["qbar"]) * 0.4 * 0.25
    assert float(still["wheel.F_aer"]) == pytest.approx(0.0, abs=1e-12)
    up = qS * 0.12 * 0.1 / (qS * 0.3 + 60.0 / 0.3**2)  # own hinge moment against air and cable
    assert float(still["wheel.symmetric"]) == pytest.approx(-up, rel=1e-9)
    rigid = build(air=False, circuits={"wheel": WHEEL})
    rolling = flown(rigid, grid(0.0), init__p=0.5, init__alpha=0.1, **BALLISTIC).isel(time=0)
    change = np.arctan(0.5 * 4.0 / 200.0)
    assert float(rolling["wheel.hinge_moment"]) == pytest.approx(
        qS * -0.12 * 2.0 * change, rel=1e-9
    )
    tab = flown(rigid, grid(0.0), {"delta_ta": 0.1}, **BALLISTIC).isel(time=0)
    assert float(tab["wheel.hinge_moment"]) == pytest.approx(qS * -0.15 * 0.1, rel=1e-9)
    both = flown(rigid, grid(0.0), {"delta_ta": 0.1}, wheel__tab_left=1.0, **BALLISTIC).isel(time=0)
    assert float(both["wheel.hinge_moment"]) == pytest.approx(0.0, abs=1e-12)


def test_masses_are_pulled_by_the_load_factor(build):
    """Bob weight and a tail-heavy elevator, at 1 g and in a pull-up with angular acceleration."""
    column = replace(COLUMN, bob_weight=0.8, unbalance=0.3, arm=-4.2)
    pedal, wheel = replace(PEDAL, unbalance=0.2, arm=-4.5), replace(WHEEL, unbalance=0.1)
    sim = build(circuits={"column": column, "wheel": wheel, "pedal": pedal})
    y = flown(
        sim,
        grid(0.0),
        {"delta_e": -0.1, "delta_r": 0.05, "delta_a": -0.05},
        init__alpha=0.06,
        **BALLISTIC,
    ).isel(time=0)
    a = {name: float(y[name]) for name in ("az", "ay", "q_dot", "p_dot", "r_dot")}
    assert abs(a["q_dot"]) > 0.5
    x_cg = 0.06
    H = 0.3 * -(a["az"] - a["q_dot"] * (-4.2 - x_cg))
    assert float(y["column.F_g"]) == pytest.approx(0.8 * -a["az"] + 1.5 * H, rel=1e-9)
    assert float(y["pedal.F_g"]) == pytest.approx(
        3.0 * 0.2 * (a["ay"] + a["r_dot"] * (-4.5 - x_cg)), rel=1e-9
    )
    assert float(y["wheel.F_g"]) == pytest.approx(0.3 * 0.1 * -a["p_dot"] * 4.0, rel=1e-9)
    level = flown(sim, grid(0.0), **FLIGHT).isel(time=0)
    assert float(level["column.F_g"]) == pytest.approx((0.8 + 1.5 * 0.3) * G0, rel=0.02)


def test_spring_trim_moves_neutral(build):
    sim = build(
        hinges={},
        circuits={
            "column": replace(
                COLUMN, stiffness=200.0, neutral=0.01, neutral_trim=-0.5, damping=80.0
            )
        },
    )
    held = flown(sim, grid(0.0), {"delta_t": 0.04}, **BALLISTIC).isel(time=0)
    assert float(held["applied.F_column"]) == pytest.approx(200.0 * (0.0 - (0.01 - 0.5 * 0.04)))
    free = flown(
        sim, grid(3.0), {"delta_t": 0.04}, mode__controls=2, column__trim_limit=0.0, **BALLISTIC
    ).isel(time=-1)
    assert float(free["applied.column"]) == pytest.approx(-0.01, abs=1e-5)


@pytest.fixture(scope="module")
def legs() -> tuple[Contact, ...]:
    leg = {
        "stiffness": 60e3,
        "damping": 8e3,
        "tyre_stiffness": 300e3,
        "side_stiffness": 100e3,
        "cornering_stiffness": 20e3,
    }
    leg |= {"cornering_load": 8e3, "radius": 0.25}
    return (
        Contact("nose", (1.6, 0.0, 0.8), steering=1.0, **leg),
        Contact("left", (-0.3, -0.9, 0.8), **leg),
        Contact("right", (-0.3, 0.9, 0.8), **leg),
    )


def test_nose_wheel_pulls_at_the_pedals(build, legs):
    """On the ground the rudder pedals work against the steering spring; in the air the wheel
    follows and they do not.
    """
    gear = LandingGear(
        legs, Steering(limit=0.5, stiffness=800.0, trail=0.05, scrub=0.08, rudder=0.4)
    )
    sim = build(
        air=False, gear=gear, circuits={"pedal": replace(PEDAL, damping=200.0, friction=10.0)}
    )
    stand = {"init__V": 0.0, "init__h": 0.45, "mode__earth": 0.0, "gear": 1.0}
    t = grid(3.0)
    y = flown(
        sim,
        t,
        {"F_pedal": np.clip(40.0 * t, 0.0, 60.0), "gear": 1.0},
        mode__controls=2,
        pedal__trim_limit=0.0,
        **stand,
    ).isel(time=-1)
    aim = -0.4 * float(y["applied.delta_r"])
    spring = 800.0 * (aim - float(y["gear.steering"]))
    assert aim > 0.0
    assert spring > 5.0
    assert float(y["pedal.F_nose"]) == pytest.approx(3.0 * 0.4 * spring, rel=1e-9)
    assert float(y["pedal.F_nose"]) == pytest.approx(
        60.0 - 10.0 - 200.0 * float(y["pedal.rate"]), abs=0.3
    )
    air = flown(
        sim,
        t,
        {"F_pedal": np.clip(40.0 * t, 0.0, 60.0)},
        mode__controls=2,
        pedal__trim_limit=0.0,
        **BALLISTIC,
    ).isel(time=-1)
    assert float(air["applied.pedal"]) > 0.002
    assert abs(float(air["pedal.F_nose"])) < 1.0


def test_a_spring_of_the_nose_wheel_acts_on_the_ground_alone(build, legs):
    gear = LandingGear(legs, Steering(limit=0.5, stiffness=800.0, trail=0.05, scrub=0.08))
    pedal = replace(PEDAL, damping=200.0, friction=10.0, nose_spring=1500.0)
    sim = build(air=False, hinges={}, gear=gear, circuits={"pedal": pedal})
    t = grid(3.0)
    force = np.clip(40.0 * t, 0.0, 60.0)
    stand = {
        "init__V": 0.0,
        "init__h": 0.45,
        "mode__earth": 0.0,
        "mode__controls": 2,
        "pedal__trim_limit": 0.0,
    }
    y = flown(sim, t, {"F_pedal": force, "gear": 1.0}, **stand).isel(time=-1)
    assert float(y["pedal.F_nose"]) == pytest.approx(1500.0 * float(y["applied.pedal"]), rel=1e-12)
    # it comes to rest a little beyond the balance of 50 N, by its momentum, and friction holds it
    # there
    assert float(y["applied.pedal"]) == pytest.approx((60.0 - 10.0) / 1500.0, rel=1e-2)
    air = flown(
        sim, t, {"F_pedal": force}, mode__controls=2, pedal__trim_limit=0.0, **BALLISTIC
    ).isel(time=-1)
    assert float(air["pedal.F_nose"]) == 0.0
    assert float(air["applied.pedal"]) > 2.0 * float(y["applied.pedal"])


# ---- the same bits, any numbers
# ------------------------------------------------------------------------------------------


def test_outputs_between_do_not_change_the_run(build, start):
    """Outputs taken at every step, at the end only, and going on from a copy give the same bits."""
    circuits = {
        "column": replace(COLUMN, friction=8.0, stiction=2.0, **CABLE),
        "wheel": replace(WHEEL, order=6, cable_stiffness=300.0),
    }
    sim = build(circuits=circuits)
    t = grid(1.0)
    F = 30.0 * np.sin(5.0 * t)
    every = flown(sim, t, {"F_column": F, "F_wheel": F / 10.0}, mode__controls=2, **FLIGHT)
    values = {name.replace(".", "__"): value for name, value in FLIGHT.items()}
    run = start(sim, **values, mode__controls=2.0)
    u = np.zeros((len(t), len(sim.inputs)))
    u[:, sim.inputs.index("F_column")], u[:, sim.inputs.index("F_wheel")] = F, F / 10.0
    for k in range(len(t) - 1):
        if k == 40:
            ahead = run.copy()
            run.step(t[k], t[k + 1] - t[k], u[k], u[k + 1])
            run = ahead
        run.step(t[k], t[k + 1] - t[k], u[k], u[k + 1])
    last = dict(zip(sim.outputs, run.outputs(), strict=True))
    assert {name: last[name] for name in sim.outputs} == {
        name: float(every[name][-1]) for name in sim.outputs
    }


NUMBER = st.one_of(
    st.floats(allow_nan=False, allow_infinity=False),
    st.floats(-10.0, 10.0),
    st.sampled_from([2.0, 4.0, 6.0]),
)


def refused(sim, start, values) -> str:
    """Return why the values are refused, or nothing when 50 ms with them end in finite outputs."""
    try:
        run = start(sim, init__V=90.0, init__h=1500.0, **values)
        u = np.zeros(len(sim.inputs))
        for k in range(5):
            run.step(0.01 * k, 0.01, u, u)
    except SimulationError as error:
        return str(error)
    return "" if np.isfinite(run.outputs()).all() else "outputs that are not finite"


@pytest.mark.nightly
@settings(max_examples=settings.default.max_examples, deadline=None)
@given(data=st.data(), controls=st.sampled_from([0.0, 1.0, 2.0]))
def test_any_finite_constants_fly_or_are_refused(every, start, data, controls):
    names = [
        name
        for name in every.parameters
        if name.split(".")[0] in CIRCUITS or name.startswith("bias.F_")
    ]
    names = [
        name for name in names if not name.endswith(".step")
    ]  # short steps are allowed but slow
    chosen = data.draw(st.dictionaries(st.sampled_from(names), NUMBER, min_size=1, max_size=6))
    text = refused(
        every,
        start,
        {name.replace(".", "__"): value for name, value in chosen.items()}
        | {"mode__controls": controls},
    )
    assert text == "" or "must be" in text or "not finite at" in text


@pytest.mark.parametrize(
    ("name", "value", "text"),
    [
        ("column.mass", 0.0, "column.mass is 0; it must be at least 1e-9"),
        ("column.order", 6.0, "column.order is 6; it must be 2 or 4"),
        ("wheel.order", 3.0, "wheel.order is 3; it must be 2, 4 or 6"),
        ("column.friction", -1.0, "column.friction is -1; it must be zero or positive"),
        (
            "pedal.order",
            4.0,
            "pedal.cable_stiffness is 0; it must be positive when the order is 4 or 6",
        ),
        ("column.gearing", 0.0, "column.gearing is 0; it must be other than zero"),
        ("column.stop_low", 0.3, "column.stop_low is 0.3; it must be below stop_high"),
        (
            "column.gearing_slope",
            20.0,
            "column.gearing_slope is 20; it must be so small that the gearing keeps",
        ),
        (
            "column.delta_high",
            -0.4,
            "column.delta_low is -1.5708; it must be such that the surface and the stops "
            "leave some travel",
        ),
        ("column.restitution", 1.5, "column.restitution is 1.5; it must be between 0 and 1"),
        ("column.step", 1e-7, "column.step is 1e-07; it must be at least 1e-6 s"),
        ("column.bob_weight", 1e10, "column.bob_weight is 1e+10; it must be between -1e9 and 1e9"),
    ],
)
def test_parameters_without_meaning_are_refused(every, start, name, value, text):
    with pytest.raises(SimulationError, match=text.replace("+", r"\+")):
        start(every, **{name.replace(".", "__"): value})


# ---- catalogue
# --------------------------------------------------------------------------------------------------


def test_rows_have_units_and_start_values(every):
    rows = {row.name: row for kind in (INPUT, OUTPUT, PARAMETER) for row in every.entries(kind)}
    assert (rows["column"].units, rows["column"].low, rows["column"].high) == ("m", -0.15, 0.2)
    assert (rows["F_wheel"].units, rows["F_pedal"].units) == ("N m", "N")
    assert (rows["wheel.mass"].units, rows["wheel.mass"].value) == ("kg m2", 0.2)
    assert (rows["column.gearing"].units, rows["column.gearing"].value) == ("m-1", -1.5)
    assert rows["column.step"].value == 1e-3
    assert rows["wheel.delta_low"].value == pytest.approx(-np.pi / 2.0)
    assert rows["trim.F_column"].units == rows["bias.F_column"].units == "N"
    assert all(row.description for row in rows.values())


def test_circuits_are_written_and_read_back(tmp_path, make_aircraft):
    craft = make_aircraft(controls=CONTROLS, circuits=CIRCUITS, engines=())
    assert (
        read_aircraft(flightmech.write_aircraft(craft, tmp_path / "written.toml")).circuits
        == CIRCUITS
    )


def test_circuit_without_its_control_is_no_model(build):
    with pytest.raises(
        SchemaError, match=r"circuit.column: \[control.delta_e\] with a gearing is missing"
    ):
        build(controls={"delta_e": ControlGeometry(1.0, 0.35)}, circuits={"column": COLUMN})
