"""Propellers against closed forms: loads, shaft, governor, feathering, reverse, rotation."""

from __future__ import annotations

import numpy as np
import pytest
import xarray as xr

import flightmech
from flightmech import air
from flightmech.aircraft import Engine, EngineDeck, Propeller
from flightmech.aircraft.propulsion import propeller as propeller_module
from flightmech.errors import SchemaError, SimulationError
from flightmech.simulation.kernel import STATE, Simulation
from flightmech.terms import evaluate_term, make_term

D, INERTIA, RATED = 2.0, 5.0, 200.0
LOW, HIGH, FEATHER = np.radians([10.0, 40.0, 85.0])
J = np.array([0.0, 0.5, 1.0, 2.0, 4.0, 40.0])
ANGLES = np.array([LOW, HIGH, FEATHER])
POWER = 150e3  # of the engine [W]
FLIGHT = {"init__V": 60.0, "init__h": 1000.0, "mode__earth": 0.0, "mode__engine": 0.0}


def blades(a: float, b: float, c: float) -> xr.Dataset:
    """A coefficient a + b angle - c J, bilinear, so that the table is exact."""
    return make_term(
        a + b * ANGLES[None, :] - c * J[:, None], {"J": J, "blade_angle": ANGLES}, outside="hold"
    )


CT, CP = (0.06, 0.2, 0.12), (0.02, 0.3, 0.06)
TABLES = {
    "CT_prop": blades(*CT),
    "CP_prop": blades(*CP),
    "shaft_power": make_term([0.0, POWER], {"throttle": [0.0, 1.0]}),
}
FIXED_TABLES = {
    "CT_prop": make_term(0.11 - 0.1 * J[:4], {"J": J[:4]}),
    "CP_prop": make_term(0.065 - 0.05 * J[:4], {"J": J[:4]}),
    "shaft_power": TABLES["shaft_power"],
}


def turning(**changes) -> Propeller:
    """A propeller with a governor that can feather."""
    fields = {
        "tables": TABLES,
        "diameter": D,
        "inertia": INERTIA,
        "rpm_high": RATED,
        "rpm_low": 150.0,
        "low_pitch": LOW,
        "high_pitch": HIGH,
        "feather_pitch": FEATHER,
        "feather_rate": 0.3,
    }
    return Propeller(**(fields | changes))


def fixed(**changes) -> Propeller:
    """A propeller of fixed pitch."""
    fields = {"tables": FIXED_TABLES, "diameter": D, "inertia": INERTIA, "rpm_high": RATED}
    return Propeller(**(fields | changes))


@pytest.fixture(scope="module")
def compiled(make_aircraft, make_tree):
    """Compile the jet without aerodynamics and with propellers at given places."""

    def of(*propellers: Propeller, places=((0.0, 0.0, 0.0),), deck=None, **changes):
        engines = tuple(
            Engine(place, propeller=propeller, deck=deck)
            for place, propeller in zip(places, propellers, strict=True)
        )
        return flightmech.compile(
            make_aircraft(engines=engines, cg=(0.0, 0.0, 0.0), **changes),
            make_tree({"CD/basic": make_term(0.0)}),
        )

    return of


class _Flight:
    """A run with its names."""

    def __init__(self, sim: flightmech.SimModel, **values: float):
        self.sim = sim
        self.run = Simulation(sim.model)
        self.u = np.array([row.value for row in sim.entries(0)])
        self.time = 0.0
        for key, value in (FLIGHT | values).items():
            name = key.replace("__", ".")
            if name in sim.inputs:
                self.u[sim.inputs.index(name)] = value
            else:
                self.run.set_parameter(sim.parameters.index(name), value)
        self.run.set_inputs(self.u)
        self.run.initialize()

    def __getitem__(self, name: str) -> float:
        return float(self.run.outputs()[self.sim.outputs.index(name)])

    def state(self, name: str) -> int:
        """The place of a state."""
        return [row.name for row in self.sim.entries(STATE)].index(f"state.{name}")

    def rate(self, name: str, **states: float) -> float:
        """The rate of a state where others have these values."""
        x = self.run.state.copy()
        for key, value in states.items():
            x[self.state(key.replace("__", "."))] = value
        return float(self.run.derivative(x, self.u)[self.state(name)])

    def fly(self, seconds: float, **inputs: float) -> _Flight:
        """Step with constant inputs."""
        for key, value in inputs.items():
            self.u[self.sim.inputs.index(key.replace("__", "."))] = value
        for _ in range(round(seconds / 0.01)):
            self.run.step(self.time, 0.01, self.u, self.u)
            self.time += 0.01
        return self


def density(flight: _Flight) -> float:
    return float(air.atmosphere(flight["h"]).rho)


def test_loads_by_hand(compiled):
    """T = CT rho n^2 D^4 and P = CP rho n^3 D^5 at the steady speed of fixed pitch."""
    flight = _Flight(compiled(fixed()), engine1__throttle=0.8)
    n = flight["engine1.rpm"] / (2.0 * np.pi)
    advance = flight["V"] / (n * D)
    assert flight["engine1.J"] == pytest.approx(advance, rel=1e-14)
    thrust = (0.11 - 0.1 * advance) * density(flight) * n**2 * D**4
    power = (0.065 - 0.05 * advance) * density(flight) * n**3 * D**5
    assert flight["engine1.thrust"] == pytest.approx(thrust, rel=1e-9)
    # the steady speed balances the torques
    assert power == pytest.approx(0.8 * POWER, rel=1e-9)
    assert flight["engine1.shaft_power"] == pytest.approx(0.8 * POWER, rel=1e-12)
    tip = np.hypot(np.pi * n * D, flight["V"]) / float(air.atmosphere(flight["h"]).a_sound)
    assert flight["engine1.tip_mach"] == pytest.approx(tip, rel=1e-12)


def test_speed_follows_the_excess_of_torque(compiled):
    """I w' = P / w - CP rho n^2 D^5 / (2 pi)."""
    flight = _Flight(compiled(fixed()), engine1__throttle=0.5)
    for speed in (120.0, 260.0):
        n = speed / (2.0 * np.pi)
        torque = (0.065 - 0.05 * 60.0 / (n * D)) * density(flight) * n**2 * D**5 / (2.0 * np.pi)
        expected = (0.5 * POWER / speed - torque) / INERTIA
        assert flight.rate("engine1.rpm", engine1__rpm=speed) == pytest.approx(expected, rel=1e-9)


def test_energy_of_the_shaft_over_a_slam(compiled):
    """The work of the engine is that of the air and the kinetic energy of the rotor."""
    flight = _Flight(compiled(fixed(), mass=1e9, Ixx=1e9, Iyy=1e9, Izz=1e9), engine1__throttle=0.2)
    start = flight["engine1.rpm"]
    time = np.arange(0.0, 3.0001, 0.01)
    excess = []
    for k in range(len(time)):
        air_power = flight["engine1.CP_prop"] * density(flight)
        n = flight["engine1.rpm"] / (2.0 * np.pi)
        excess.append(flight["engine1.shaft_power"] - air_power * n**3 * D**5)
        if k == 0:
            # the lever jumps after the first sample
            flight.fly(0.0, engine1__throttle=1.0)
            n = flight["engine1.rpm"] / (2.0 * np.pi)
            excess[0] = POWER - air_power * n**3 * D**5
        flight.fly(0.01)
    end = flight["engine1.rpm"]
    # the last sample is one step before the end
    work = np.trapezoid([*excess, excess[-1]], dx=0.01)
    assert work == pytest.approx(0.5 * INERTIA * (end**2 - start**2), rel=2e-4)
    assert end > 1.3 * start


def test_governor_holds_the_speed_of_the_lever(compiled):
    """The steady blade angle solves P = CP rho n^3 D^5, linear in the angle."""
    for lever, speed, throttle in ((1.0, RATED, 0.9), (0.4, 170.0, 0.6)):
        flight = _Flight(
            compiled(turning()), engine1__throttle=throttle, engine1__prop_command=lever
        )
        assert flight["engine1.rpm"] == pytest.approx(speed, rel=1e-14)
        n = speed / (2.0 * np.pi)
        coefficient = throttle * POWER / (density(flight) * n**3 * D**5)
        angle = (coefficient - CP[0] + CP[2] * 60.0 / (n * D)) / CP[1]
        assert flight["engine1.blade_angle"] == pytest.approx(angle, rel=1e-12)
        assert LOW < angle < HIGH


def test_governor_has_a_rate_and_stops(compiled):
    """A chop of the speed lever turns the blades at the rate limit; idle leaves the low stop."""
    sim = compiled(turning(pitch_rate=0.05, governor_gain=0.1), mass=1e9)
    flight = _Flight(sim, engine1__throttle=0.4)
    before = flight["engine1.blade_angle"]
    flight.fly(0.5, engine1__prop_command=0.0)
    assert flight["engine1.blade_angle"] - before == pytest.approx(0.025, rel=1e-6)
    flight.fly(6.0)
    assert flight["engine1.rpm"] == pytest.approx(150.0, rel=2e-3)
    slow = _Flight(sim, engine1__throttle=0.02)
    assert slow["engine1.blade_angle"] == pytest.approx(LOW, rel=1e-14)
    assert slow["engine1.rpm"] < RATED
    fast = _Flight(compiled(turning(high_pitch=LOW + 0.02)), engine1__throttle=1.0)
    assert fast["engine1.blade_angle"] == pytest.approx(LOW + 0.02, rel=1e-14)
    assert fast["engine1.rpm"] > RATED


def test_governor_with_a_lag_returns_to_the_speed(compiled):
    flight = _Flight(compiled(turning(governor_time=0.1), mass=1e9), engine1__throttle=0.5)
    flight.fly(0.5, engine1__throttle=0.8)
    assert flight["engine1.rpm"] > 1.02 * RATED
    flight.fly(6.5)
    assert flight["engine1.rpm"] == pytest.approx(RATED, rel=2e-3)


def test_lever_turns_blades_without_a_governor(compiled):
    flight = _Flight(
        compiled(turning(governed=False)), engine1__throttle=0.5, engine1__prop_command=0.3
    )
    assert flight["engine1.blade_angle"] == pytest.approx(LOW + 0.3 * (HIGH - LOW), rel=1e-12)


def test_failed_engine_windmills_and_feathers(compiled):
    """Without power J is that of CP = 0; the drag of the feathered propeller is a part of it."""
    flight = _Flight(compiled(turning(), mass=1e9), engine1__throttle=0.0)
    assert flight["engine1.J"] == pytest.approx((CP[0] + CP[1] * LOW) / CP[2], rel=1e-9)
    windmilling = flight["engine1.thrust"]
    assert windmilling < 0.0
    flight.fly(30.0, engine1__feather=1.0)
    assert flight["engine1.blade_angle"] == pytest.approx(FEATHER, rel=1e-6)
    steady = _Flight(compiled(turning()), engine1__feather=1.0)
    assert steady["engine1.J"] == pytest.approx((CP[0] + CP[1] * FEATHER) / CP[2], rel=1e-9)
    assert windmilling < steady["engine1.thrust"] < 0.0
    assert flight["engine1.rpm"] == pytest.approx(steady["engine1.rpm"], rel=0.05)
    # unfeathered the blades return to the governor at their rate
    flight.fly(0.5, engine1__feather=0.0)
    assert FEATHER - flight["engine1.blade_angle"] == pytest.approx(0.1, rel=1e-3)


def test_stopped_propeller_keeps_its_drag(compiled):
    """Beyond the end of the tables thrust and torque depend on the airspeed alone."""
    flight = _Flight(compiled(fixed(tables=FIXED_TABLES | {"shaft_power": make_term(-10.0)})))
    at_rest = flight.rate("vx", engine1__rpm=0.0)
    slow = flight.rate("vx", engine1__rpm=10.0)
    assert at_rest == pytest.approx(slow, rel=1e-12)
    rho = density(flight)
    force = (0.11 - 0.1 * 2.0) * rho * (60.0 / (2.0 * D)) ** 2 * D**4
    assert at_rest == pytest.approx(force / 2300.0, rel=1e-9)
    # the air turns it, CP is negative at the end of the tables; friction alone stops nothing
    assert flight.rate("engine1.rpm", engine1__rpm=0.0) > 0.0


def test_propeller_does_not_turn_backwards(compiled):
    brake = FIXED_TABLES | {"shaft_power": make_term(-1e5)}
    flight = _Flight(compiled(fixed(tables=brake)), init__V=1.0)
    assert flight["engine1.rpm"] == 0.0
    flight.fly(1.0)
    assert flight["engine1.rpm"] == 0.0


def test_reverse_by_the_low_stop(compiled):
    """The lever behind idle draws the low stop to negative angles, and thrust reverses."""
    stop = make_term([-0.3, LOW, LOW], {"throttle": [-1.0, 0.0, 1.0]})
    angles = np.array([-0.3, LOW, HIGH])
    reach = J[:5]
    tables = {
        "CT_prop": make_term(
            0.05 + 0.2 * angles[None, :] - 0.1 * reach[:, None], {"J": reach, "blade_angle": angles}
        ),
        "CP_prop": make_term(
            0.03 + 0.2 * np.maximum(angles[None, :], 0.0) - 0.02 * reach[:, None],
            {"J": reach, "blade_angle": angles},
        ),
        "low_stop": stop,
        "shaft_power": make_term([20e3, 10e3, POWER], {"throttle": [-1.0, 0.0, 1.0]}),
    }
    sim = compiled(turning(tables=tables, feather_rate=0.0), limits={"throttle": (-1.0, 1.0)})
    flight = _Flight(sim, init__V=20.0, engine1__throttle=-1.0)
    assert flight["engine1.blade_angle"] == pytest.approx(-0.3, rel=1e-12)
    assert flight["engine1.thrust"] < 0.0
    assert _Flight(sim, init__V=20.0)["engine1.thrust"] > 0.0


@pytest.mark.parametrize("rotation", [1, -1])
def test_torque_rolls_the_aircraft_against_the_rotation(compiled, rotation):
    """Roll acceleration - rotation Q / Ixx; gyroscopic moment - w x H."""
    sim = compiled(fixed(rotation=rotation), Ixy=0.0, Ixz=0.0, Iyz=0.0)
    flight = _Flight(sim, engine1__throttle=1.0)
    torque = flight["engine1.torque"]
    assert torque == pytest.approx(POWER / flight["engine1.rpm"], rel=1e-12)
    assert flight["p_dot"] == pytest.approx(-rotation * torque / 10800.0, rel=1e-9)
    pitching = _Flight(sim, engine1__throttle=1.0, init__q=0.2)
    momentum = rotation * INERTIA * pitching["engine1.rpm"]
    # the axis of a right-handed rotor at a rising nose yaws to the right
    assert pitching["r_dot"] == pytest.approx(0.2 * momentum / 15100.0, rel=1e-9)


def test_counter_rotating_propellers_cancel(compiled):
    places = ((0.0, -2.0, 0.0), (0.0, 2.0, 0.0))
    symmetric = {"places": places, "Ixy": 0.0, "Ixz": 0.0, "Iyz": 0.0}
    pair = compiled(fixed(), fixed(rotation=-1), **symmetric)
    flight = _Flight(pair, engine1__throttle=1.0, engine2__throttle=1.0, init__q=0.1)
    same = compiled(fixed(), fixed(), **symmetric)
    alike = _Flight(same, engine1__throttle=1.0, engine2__throttle=1.0, init__q=0.1)
    assert flight["r_dot"] == pytest.approx(0.0, abs=1e-12)
    assert alike["r_dot"] > 1e-2
    # a failed left engine turns the nose to the left
    failed = _Flight(pair, engine1__throttle=0.0, engine2__throttle=1.0)
    assert failed["r_dot"] < 0.0


@pytest.mark.parametrize("rotation", [1, -1])
def test_inflow_lifts_and_yaws(compiled, rotation):
    """At positive alpha the force in the disk points up, and a right-handed propeller yaws left."""
    tables = FIXED_TABLES | {"CN_prop": make_term(0.1), "CM_prop": make_term(0.02)}
    craft = {"Ixy": 0.0, "Ixz": 0.0, "Iyz": 0.0, "places": ((1.5, 0.0, 0.0),)}
    sim = compiled(fixed(tables=tables, rotation=rotation), **craft)
    flight = _Flight(sim, engine1__throttle=1.0, init__alpha=0.1)
    plain = compiled(fixed(rotation=rotation), **craft)
    plain = _Flight(plain, engine1__throttle=1.0, init__alpha=0.1)
    load = density(flight) * (flight["engine1.rpm"] / (2.0 * np.pi)) ** 2 * D**4
    inflow = np.sin(0.1)
    lift = 0.1 * load * inflow
    assert flight["az"] - plain["az"] == pytest.approx(-lift / 2300.0, rel=1e-9)
    assert flight["q_dot"] - plain["q_dot"] == pytest.approx(1.5 * lift / 8100.0, rel=1e-9)
    yaw = -rotation * 0.02 * load * D * inflow
    assert flight["r_dot"] == pytest.approx(yaw / 15100.0, rel=1e-9)


def test_yawing_aircraft_has_two_advance_ratios(compiled):
    """The velocity of the hub is that of the centre of gravity plus rate x arm."""
    places = ((0.0, -2.0, 0.0), (0.0, 2.0, 0.0))
    flight = _Flight(compiled(fixed(), fixed(), places=places), init__r=0.3, init__V=60.0)
    speeds = [flight[f"engine{k}.J"] * flight[f"engine{k}.rpm"] for k in (1, 2)]
    expected = 2.0 * np.pi / D * (60.0 + np.array([0.6, -0.6]))
    np.testing.assert_allclose(speeds, expected, rtol=1e-12)


GENERATOR = {
    "thrust": make_term(300.0),
    "n1_command": make_term([0.6, 1.0], {"throttle": [0.0, 1.0]}),
    "n1_up_time": make_term(0.8),
    "itt": make_term([700.0, 1000.0], {"n1": [0.6, 1.0]}),
}
TURBINE = {
    **{name: TABLES[name] for name in ("CT_prop", "CP_prop")},
    "shaft_power": make_term([0.0, 20e3, 200e3], {"n1": [0.5, 0.6, 1.0]}),
    "shaft_bsfc": make_term(9e-8),
}


def test_free_turbine(compiled):
    """Power of the gas generator speed, which follows the lever with its lag; fuel by power."""
    sim = compiled(turning(tables=TURBINE), deck=EngineDeck(GENERATOR))
    flight = _Flight(sim, engine1__throttle=0.5)
    assert flight["engine1.n1"] == pytest.approx(0.8)
    assert flight["engine1.shaft_power"] == pytest.approx(110e3, rel=1e-12)
    assert flight["engine1.fuel_flow"] == pytest.approx(9e-8 * 110e3, rel=1e-12)
    assert flight["engine1.itt"] == pytest.approx(850.0)
    n = RATED / (2.0 * np.pi)
    thrust = flight["engine1.CT_prop"] * density(flight) * n**2 * D**4
    assert flight["engine1.thrust"] == pytest.approx(thrust + 300.0, rel=1e-12)
    flight.fly(0.8, engine1__throttle=1.0)
    assert flight["engine1.n1"] == pytest.approx(1.0 - 0.2 * np.exp(-1.0), rel=1e-6)
    flight.fly(10.0, engine1__cutoff=1.0)
    assert flight["engine1.shaft_power"] == pytest.approx(0.0, abs=1e-6)
    assert flight["engine1.fuel_flow"] < 1e-12


def test_torque_limit(compiled):
    limited = _Flight(
        compiled(turning(tables=TURBINE, torque_limit=600.0), deck=EngineDeck(GENERATOR)),
        engine1__throttle=1.0,
    )
    assert limited["engine1.torque"] == pytest.approx(600.0, rel=1e-12)
    flat = _Flight(
        compiled(turning(tables=TURBINE, power_limit=90e3), deck=EngineDeck(GENERATOR)),
        engine1__throttle=1.0,
    )
    assert flat["engine1.shaft_power"] == pytest.approx(90e3, rel=1e-12)


def test_single_shaft_turbine(compiled):
    """The gas generator turns with the propeller; its power follows the lever behind a lag."""
    deck = EngineDeck(
        {"thrust": make_term(0.0)},
        coupled=True,
        n1_rated=4000.0,
        starter_speed=0.3,
        starter_time=3.0,
    )
    propeller = turning(gear_ratio=20.0, power_time=0.5)
    sim = compiled(propeller, deck=deck)
    flight = _Flight(sim, engine1__throttle=0.5)
    assert flight["engine1.n1"] == pytest.approx(20.0 * RATED / 4000.0, rel=1e-12)
    flight.fly(0.5, engine1__throttle=1.0)
    power = POWER * (1.0 - 0.5 * np.exp(-1.0))
    assert flight["engine1.shaft_power"] == pytest.approx(power, rel=1e-4)
    assert flight["engine1.n1"] == pytest.approx(flight["engine1.rpm"] * 20.0 / 4000.0, rel=1e-12)
    at = [flight.run.state[flight.state(f"engine1.{name}")] for name in ("n1", "rpm")]
    assert at[0] == pytest.approx(at[1] * 20.0 / 4000.0, rel=1e-12)


def test_runs_side_by_side_have_the_same_bits(compiled):
    sim = compiled(turning(), turning(rotation=-1), places=((0.0, -2.0, 0.0), (0.0, 2.0, 0.0)))
    time = np.arange(0.0, 2.001, 0.05)
    lever = np.where(time < 1.0, 0.4, 0.9)
    names = {f"engine{k}.{what}": lever for k in (1, 2) for what in ("throttle", "prop_command")}
    data = xr.Dataset({name: ("time", values) for name, values in names.items()}, {"time": time})
    held = {"init.h": 500.0, "mode.earth": 0.0}
    speeds = [50.0, 60.0, 70.0, 80.0]
    outputs = ["engine1.rpm", "engine2.thrust", "engine1.blade_angle", "p"]
    together = flightmech.simulate_batch(sim, data, {"init.V": speeds}, held, outputs=outputs)
    for k, V in enumerate(speeds):
        alone = flightmech.simulate(sim, data, held | {"init.V": V})
        for name in outputs:
            np.testing.assert_array_equal(together[name].values[k], alone[name].values)


def test_copy_and_state_continue_with_the_same_bits(compiled):
    flight = _Flight(compiled(turning(governor_time=0.1)), engine1__throttle=0.3)
    flight.fly(0.5, engine1__throttle=0.9)
    copy = flight.run.copy()
    flight.fly(0.5)
    for k in range(50):
        copy.step(0.5 + 0.01 * k, 0.01, flight.u, flight.u)
    np.testing.assert_allclose(copy.state, flight.run.state, rtol=1e-13)


def refusal(make) -> str:
    with pytest.raises(SchemaError) as error:
        make()
    return str(error.value)


def test_refusals():
    """Tables that flight leaves, torque that falls with the blade angle, missing inertia."""
    short = {"CT_prop": make_term([0.1, 0.05], {"J": [0.0, 0.5]})}
    text = refusal(lambda: fixed(tables=FIXED_TABLES | short))
    assert "CT_prop is still 0.05 at J 0.5" in text
    assert "continue both tables until the thrust is negative" in text
    late = {"CT_prop": make_term([0.1, -0.05], {"J": [0.1, 1.5]})}
    assert "add the static value as the node J = 0" in refusal(
        lambda: fixed(tables=FIXED_TABLES | late)
    )
    falling = {"CP_prop": blades(0.2, -0.1, 0.06)}
    text = refusal(lambda: turning(tables=TABLES | falling, feather_rate=0.0))
    assert "a governor needs a torque that grows with the blade angle" in text
    ends = {name: TABLES[name].isel(J=slice(0, 5)) for name in ("CT_prop", "CP_prop")}
    assert "a feathered propeller slows down to any J" in refusal(
        lambda: turning(tables=TABLES | ends)
    )
    radians = {"CP_prop": make_term(0.01 - 0.008 * J[:4], {"J": J[:4]})}
    assert "J CT/CP is 5 at J 0.5, above 1" in refusal(lambda: fixed(tables=FIXED_TABLES | radians))
    assert "inertia is 0; it must be positive" in refusal(lambda: fixed(inertia=0.0))
    powerless = fixed(tables={name: FIXED_TABLES[name] for name in ("CT_prop", "CP_prop")})
    assert "nothing turns the propeller" in refusal(
        lambda: Engine((0.0, 0.0, 0.0), propeller=powerless)
    )


def test_a_check_reads_all_nodes_of_a_table_in_one_call(monkeypatch):
    """A call per node took a third of a second for the propeller of the C182."""
    calls = []

    def counted(leaf, point):
        calls.append(leaf)
        return evaluate_term(leaf, point)

    monkeypatch.setattr(propeller_module, "evaluate_term", counted)
    turning()
    # end of the tables, feathered blades, thrust and power over power, torque over the blade angle
    assert len(calls) == 5


def test_kernel_refuses_an_inertia_of_zero(compiled):
    with pytest.raises(SimulationError, match=r"engine1.inertia.*positive"):
        _Flight(compiled(fixed()), engine1__inertia=0.0)
