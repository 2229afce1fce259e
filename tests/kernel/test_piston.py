"""Piston engines and motors against closed forms: manifold, power, fuel, start, battery."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
import xarray as xr

import flightmech
from flightmech import air
from flightmech.aircraft import ElectricMotor, Engine, PistonEngine, Propeller
from flightmech.errors import SchemaError
from flightmech.simulation.kernel import STATE, Simulation
from flightmech.terms import make_term

D, RATED = 1.9, 280.0
FLIGHT = {"init__V": 50.0, "init__h": 1000.0, "mode__earth": 0.0, "mode__engine": 0.0}
J = [0.0, 1.2]
BLADES = {
    "CT_prop": make_term([0.1, -0.045], {"J": J}),
    "CP_prop": make_term([0.06, -0.02], {"J": J}),
}
MAP = [2e4, 1.2e5]
# chart: power proportional to manifold pressure and speed, 130 kW at 1e5 Pa and 280 rad/s
CHART = make_term(
    130e3 / 1e5 / 280.0 * np.outer(MAP, [0.0, 400.0]),
    {"manifold_pressure": MAP, "engine_rpm": [0.0, 400.0]},
)
MANIFOLD = {"intake_impedance": 2e-4, "throttle_impedance": 0.02}


def chart(**changes) -> PistonEngine:
    fields = {
        "tables": {"corrected_power": CHART, "bsfc": make_term(8e-8)},
        "map_time": 0.3,
        **MANIFOLD,
    }
    return PistonEngine(**(fields | changes))


@pytest.fixture(scope="module")
def compiled(make_aircraft, make_tree):
    """Compile the jet without aerodynamics and with one engine that turns a propeller."""

    def of(propeller: dict[str, float] | None = None, **mover):
        blades = Propeller(
            **{"tables": BLADES, "diameter": D, "inertia": 2.0, "rpm_high": RATED}
            | (propeller or {})
        )
        engine = Engine((0.0, 0.0, 0.0), propeller=blades, **mover)
        return flightmech.compile(
            make_aircraft(engines=(engine,), mass=1e9, cg=(0.0, 0.0, 0.0)),
            make_tree({"CD/basic": make_term(0.0)}),
        )

    return of


class _Bench:
    """A run with its names, and inputs that stay."""

    def __init__(self, sim: flightmech.SimModel, **values: float):
        self.sim, self.run, self.time = sim, Simulation(sim.model), 0.0
        self.u = np.array([row.value for row in sim.entries(0)])
        for key, value in (FLIGHT | values).items():
            name = key.replace("__", ".")
            if name in sim.inputs:
                self.u[sim.inputs.index(name)] = value
            else:
                self.run.set_parameter(sim.parameters.index(name), value)
        self.run.set_inputs(self.u)
        self.run.initialize()

    def __getitem__(self, name: str) -> float:
        return self.output(f"engine1.{name}")

    def output(self, name: str) -> float:
        return float(self.run.outputs()[self.sim.outputs.index(name)])

    def rate(self, name: str) -> float:
        names = [row.name for row in self.sim.entries(STATE)]
        rates = self.run.derivative(self.run.state, self.u)
        return float(rates[names.index(f"state.engine1.{name}")])

    def fly(self, seconds: float, **inputs: float) -> _Bench:
        for key, value in inputs.items():
            self.u[self.sim.inputs.index(f"engine1.{key}")] = value
        for _ in range(round(seconds / 0.01)):
            self.run.step(self.time, 0.01, self.u, self.u)
            self.time += 0.01
        return self


def pressure(h: float = 1000.0) -> float:
    return float(air.atmosphere(h).p_static)


@pytest.mark.parametrize(("throttle", "offset"), [(1.0, 0.0), (0.6, 0.0), (0.8, 15.0)])
def test_power_of_a_chart(compiled, throttle, offset):
    """MAP = p / (1 + w (z_i + z_t (1 - throttle)^2)), P = chart sqrt(T_ISA / T), fuel = bsfc P."""
    bench = _Bench(compiled(piston=chart()), engine1__throttle=throttle, env__delta_T=offset)
    w = bench["rpm"]
    # with an offset of the temperature the pressure at a height differs too
    p = bench.output("p_static")
    manifold = p / (1.0 + w * (2e-4 + 0.02 * (1.0 - throttle) ** 2))
    assert bench["manifold_pressure"] == pytest.approx(manifold, rel=1e-9)
    # standard temperature at this pressure: the lapse has the exponent 0.190263
    standard = 288.15 * (p / 101325.0) ** 0.190263
    hot = np.sqrt(standard / bench.output("temperature"))
    power = 130e3 * manifold / 1e5 * w / 280.0 * hot
    assert bench["shaft_power"] == pytest.approx(power, rel=2e-6)
    assert bench["fuel_flow"] == pytest.approx(8e-8 * power, rel=2e-6)
    rho, n = bench.output("rho"), w / (2.0 * np.pi)
    assert bench["CP_prop"] * rho * n**3 * D**5 == pytest.approx(power, rel=2e-6)


def test_manifold_follows_with_its_lag(compiled):
    bench = _Bench(compiled(piston=chart()), engine1__throttle=0.5)
    start, w = bench["manifold_pressure"], bench["rpm"]
    bench.fly(0.0, throttle=1.0)
    end = pressure() / (1.0 + w * 2e-4)
    assert bench.rate("manifold_pressure") == pytest.approx((end - start) / 0.3, rel=1e-9)


def test_turbocharger_holds_its_pressure_to_the_critical_altitude(compiled):
    """MAP is the limit where ratio x ambient pressure reaches it, and falls with it above."""
    boosted = chart(boost_ratio=2.0, boost_limit=1.1e5, intake_impedance=0.0)
    sim = compiled(piston=boosted)
    for h in (0.0, 2000.0, 4500.0, 7000.0):
        bench = _Bench(sim, engine1__throttle=1.0, init__h=h)
        assert bench["manifold_pressure"] == pytest.approx(min(1.1e5, 2.0 * pressure(h)), rel=1e-9)
    # 2 p = 1.1e5 Pa at 4865 m of the standard atmosphere
    assert pressure(4865.0) == pytest.approx(0.55e5, rel=1e-3)


def test_geared_compressor(compiled):
    geared = chart(boost_ratio=1.5, boost_rpm=RATED, intake_impedance=0.0)
    bench = _Bench(compiled(piston=geared), engine1__throttle=1.0)
    expected = pressure() * (1.0 + 0.5 * bench["rpm"] / RATED)
    assert bench["manifold_pressure"] == pytest.approx(expected, rel=1e-9)


FUEL = PistonEngine(
    {
        "fuel_work": make_term(
            [0.0, 0.0, 1.2e7, 1.2e7, 0.0, 0.0],
            {"fuel_air_ratio": [0.0, 0.05, 0.07, 0.09, 0.125, 0.2]},
        ),
        "friction_pressure": make_term([5e4, 2e5], {"engine_rpm": [0.0, 450.0]}),
        "friction_power": make_term(1e3),
    },
    displacement=5.9e-3,
    pumping=0.85,
    enrichment=0.5,
    full_rich=0.088,
    fire_rpm=45.0,
    crank_torque=80.0,
    crank_rpm=100.0,
    **MANIFOLD,
)


def test_power_of_the_fuel(compiled):
    """Air, mixture, indicated power, friction and pumping by hand, in balance with the
    propeller.
    """
    bench = _Bench(compiled(piston=FUEL), engine1__throttle=0.8, engine1__mixture=0.9)
    atm, w = air.atmosphere(1000.0), bench["rpm"]
    p, manifold = pressure(), bench["manifold_pressure"]
    swept = 5.9e-3 * w / (4.0 * np.pi)
    filled = 0.3 / 1.3 + (8.5 - p / manifold) / (1.3 * 7.5)
    flow = 0.85 * filled * swept * manifold / (287.05287 * float(atm.temperature))
    assert bench["air_flow"] == pytest.approx(flow, rel=1e-9)
    ratio = 0.088 * 0.9 * (p / 101325.0) ** -0.5
    assert bench["fuel_air_ratio"] == pytest.approx(ratio, rel=1e-9)
    assert 0.07 < ratio < 0.09
    assert bench["fuel_flow"] == pytest.approx(ratio * flow, rel=1e-9)
    friction = swept * (5e4 + 1.5e5 * w / 450.0) + 1e3
    power = 1.2e7 * ratio * flow - friction + 0.85 * swept * (manifold - p)
    assert bench["shaft_power"] == pytest.approx(power, rel=1e-9)


def test_lean_mixture_stops_the_engine(compiled):
    sim = compiled(piston=FUEL)
    rich = _Bench(sim, engine1__throttle=0.8, engine1__mixture=0.9)
    lean = _Bench(sim, engine1__throttle=0.8, engine1__mixture=0.5)
    assert lean["shaft_power"] < 0.0 < rich["shaft_power"]
    rich.fly(3.0, cutoff=1.0)
    assert rich["burning"] < 1e-6
    assert rich["fuel_flow"] == 0.0
    assert rich["thrust"] < 0.0


def test_engine_starts_with_the_starter(compiled):
    """At rest on the ground: no start without the starter, idle with it, and then without it."""
    sim = compiled(piston=FUEL)
    bench = _Bench(sim, init__V=0.0, init__h=0.0, engine1__cutoff=1.0, engine1__throttle=0.3)
    assert bench["rpm"] == pytest.approx(0.0, abs=1e-6)
    bench.fly(1.0, cutoff=0.0)
    assert bench["burning"] == 0.0
    torque = 80.0 - 1e3  # of the starter and the friction at rest
    assert bench.fly(0.0, starter=1.0)["torque"] >= max(torque, 0.0)
    light = compiled(
        piston=PistonEngine(
            **{**vars(FUEL), "tables": FUEL.tables | {"friction_power": make_term(20.0)}}
        )
    )
    bench = _Bench(light, init__V=0.0, init__h=0.0, engine1__cutoff=1.0, engine1__throttle=0.3)
    bench.fly(4.0, cutoff=0.0, starter=1.0)
    assert bench["burning"] == pytest.approx(1.0, abs=1e-3)
    bench.fly(5.0, starter=0.0)
    assert bench["burning"] == pytest.approx(1.0, abs=1e-6)
    assert bench["rpm"] > 60.0


def test_windmilling_engine_restarts_in_flight(compiled):
    sim = compiled(piston=chart(fire_rpm=100.0))
    bench = _Bench(sim, engine1__throttle=0.7, init__V=60.0)
    running = bench["rpm"]
    bench.fly(4.0, flameout=1.0)
    windmilling = bench["rpm"]
    assert 100.0 < windmilling < running
    # CP is zero at J 0.9: the tables of this engine have no friction
    assert bench["J"] == pytest.approx(0.9, rel=2e-2)
    bench.fly(4.0, flameout=0.0)
    assert bench["rpm"] == pytest.approx(running, rel=1e-2)


MOTOR = ElectricMotor(
    {"open_voltage": make_term([40.0, 50.0], {"charge": [0.0, 1.0]})},
    speed_constant=6.0,
    motor_resistance=0.02,
    idle_current=3.0,
    battery_resistance=0.01,
    capacity=3.6e4,
    charge_start=0.8,
)


def test_motor_by_hand(compiled):
    """I = (d E - w/k) / (R + d^2 R_b), Q = (I - I_0) / k, and the balance of power."""
    bench = _Bench(compiled(motor=MOTOR), engine1__throttle=0.9, init__V=20.0)
    w, open_voltage = bench["rpm"], 48.0
    current = (0.9 * open_voltage - w / 6.0) / (0.02 + 0.81 * 0.01)
    assert bench["torque"] == pytest.approx((current - 3.0) / 6.0, rel=1e-9)
    assert bench["current"] == pytest.approx(0.9 * current, rel=1e-9)
    assert bench["battery_voltage"] == pytest.approx(open_voltage - 0.009 * current, rel=1e-12)
    # drawn from the battery = heat of the windings + shaft + idle losses
    drawn = bench["battery_voltage"] * bench["current"]
    spent = 0.02 * current**2 + bench["shaft_power"] + 3.0 * w / 6.0
    assert drawn == pytest.approx(spent, rel=1e-12)
    assert bench.rate("charge") == pytest.approx(-bench["current"] / 3.6e4, rel=1e-12)


def test_empty_battery_gives_no_current(compiled):
    bench = _Bench(compiled(motor=MOTOR), engine1__throttle=1.0, engine1__charge_start=0.0)
    assert bench["current"] == 0.0
    assert bench["shaft_power"] <= 0.0


def refusal(make) -> str:
    with pytest.raises(SchemaError) as error:
        make()
    return str(error.value)


def test_refusals(make_aircraft, make_tree):
    assert "no table of the power" in refusal(lambda: PistonEngine({}))
    work = {"fuel_work": make_term(1e7)}
    assert "fuel_work needs the air of the engine; give its displacement" in refusal(
        lambda: PistonEngine(work)
    )
    assert "unknown table of a piston engine 'powr'" in refusal(
        lambda: PistonEngine({"powr": make_term(1.0), "power": make_term(1.0)})
    )
    assert "piston is given without a propeller" in refusal(
        lambda: Engine((0.0, 0.0, 0.0), piston=chart())
    )
    blades = Propeller(BLADES, diameter=D, inertia=2.0, rpm_high=RATED)
    assert "piston and motor turn one propeller; keep one" in refusal(
        lambda: Engine((0.0, 0.0, 0.0), propeller=blades, piston=chart(), motor=MOTOR)
    )
    assert "charge_start is 1.5; it must be between 0 and 1" in refusal(
        lambda: ElectricMotor(
            MOTOR.tables, speed_constant=6.0, motor_resistance=0.1, capacity=1.0, charge_start=1.5
        )
    )
    mixed = (
        Engine((0.0, 0.0, 0.0), propeller=blades, piston=chart()),
        Engine((0.0, 0.0, 0.0), propeller=blades, motor=MOTOR),
    )
    assert "give every engine one or none" in refusal(
        lambda: flightmech.compile(
            make_aircraft(engines=mixed), make_tree({"CD/basic": make_term(0.0)})
        )
    )


def test_trim_with_the_lever(make_aircraft, make_tree):
    """The lever trims level flight, with the speed of the propeller at its steady value."""
    blades = Propeller(BLADES, diameter=D, inertia=2.0, rpm_high=RATED)
    engine = Engine((1.0, 0.0, 0.0), propeller=blades, piston=chart())
    craft = make_aircraft(engines=(engine,), mass=1100.0, limits={"delta_e": (-0.4, 0.4)})
    leaves = {
        "CL/basic": make_term([-0.6, 1.4], {"alpha": [-0.2, 0.2]}),
        "CD/basic": make_term(0.035),
        "Cm/basic": make_term([0.2, -0.2], {"alpha": [-0.2, 0.2]}),
        "Cm/elevator": make_term(-1.2, regressors=["delta_e"]),
        "CY/beta": make_term(-0.5, regressors=["beta"]),
        "Cn/beta": make_term(0.1, regressors=["beta"]),
        "Cn/rudder": make_term(-0.1, regressors=["delta_r"]),
        "Cl/aileron": make_term(-0.1, regressors=["delta_a"]),
        # power effect: the slipstream at the tail over the thrust coefficient of the propeller
        "Cm/slipstream": make_term([0.0, -0.05], {"engine1.CT_prop": [0.0, 0.1]}),
    }
    sim = flightmech.compile(craft, make_tree(leaves))
    parameters = {"init.V": 50.0, "init.h": 1000.0, "mode.trim": 2.0, "mode.earth": 0.0}
    data = xr.Dataset(coords={"time": np.arange(0.0, 10.01, 0.5)})
    flown = flightmech.simulate(sim, data, parameters | {"engine1.throttle": 0.5})
    assert float(flown["trim.throttle"][0]) != 0.0
    for name in ("V", "h", "engine1.rpm", "engine1.manifold_pressure"):
        np.testing.assert_allclose(flown[name].values, float(flown[name][0]), rtol=1e-6)
    thrust = float(flown["engine1.thrust"][0])
    drag = 0.035 * float(flown["qbar"][0]) * 17.0
    assert thrust == pytest.approx(drag, rel=0.05)


def test_lever_trims_from_a_flat_chart(make_aircraft, make_tree):
    """The chart ends above the manifold pressure of idle; the search of the lever does not start
    there.  The failed engine windmills.
    """
    blades = Propeller(BLADES, diameter=D, inertia=2.0, rpm_high=RATED)
    engines = [
        Engine((1.0, y, 0.0), propeller=replace(blades, rotation=rotation), piston=chart())
        for y, rotation in ((-1.5, 1), (1.5, -1))
    ]
    limits = dict.fromkeys(("delta_e", "delta_a", "delta_r"), (-0.5, 0.5))
    craft = make_aircraft(
        engines=tuple(engines), mass=1800.0, limits=limits, Ixy=0.0, Ixz=0.0, Iyz=0.0
    )
    leaves = {
        "CL/basic": make_term([-0.6, 1.4], {"alpha": [-0.2, 0.2]}),
        "CD/basic": make_term(0.035),
        "Cm/basic": make_term([0.2, -0.2], {"alpha": [-0.2, 0.2]}),
        "Cm/elevator": make_term(-1.2, regressors=["delta_e"]),
        "CY/beta": make_term(-0.5, regressors=["beta"]),
        "Cn/beta": make_term(0.1, regressors=["beta"]),
        "Cn/rudder": make_term(-0.1, regressors=["delta_r"]),
        "Cl/aileron": make_term(-0.1, regressors=["delta_a"]),
    }
    sim = flightmech.compile(craft, make_tree(leaves))
    start = {"init.V": 55.0, "init.h": 1000.0, "mode.engine": 0.0}
    both = flightmech.trim(sim, start, kind="level")
    assert both.attrs["converged"]
    # The trim at the start of a run finds the same lever, and shaft and propeller balance.
    first = flightmech.trim(sim, start)
    lever = dict(zip(both["unknown"].values, both["found"].values, strict=True))["throttle"]
    assert abs(float(first["trim.u_dot"])) < 3e-4
    assert float(first["trim.thrust"]) == 0.0
    assert float(first["trim.throttle"]) == pytest.approx(lever, rel=1e-3)
    n, rho = float(first["engine1.rpm"]) / (2.0 * np.pi), float(first["rho"])
    absorbed = float(first["engine1.CP_prop"]) * rho * n**3 * D**5
    assert float(first["engine1.torque"]) * 2.0 * np.pi * n == pytest.approx(absorbed, rel=1e-9)
    pull = float(first["engine1.CT_prop"]) * rho * n**2 * D**4
    assert float(first["engine1.thrust"]) == pytest.approx(pull, rel=1e-9)
    # Without a rudder the torque of one propeller leaves a side acceleration, whatever the lever.
    del leaves["Cn/rudder"]
    single = replace(craft, engines=(replace(engines[0], position=(1.0, 0.0, 0.0)),))
    left = flightmech.trim(flightmech.compile(single, make_tree(leaves)), start)
    assert abs(float(left["trim.u_dot"])) < 3e-4
    assert abs(float(left["trim.v_dot"])) > 3e-4
    # the Earth turns, so that both differ a little
    assert float(both["engine1.thrust"]) == pytest.approx(float(both["engine2.thrust"]), rel=1e-5)
    one = flightmech.trim(sim, start, kind="level", fixed={"engine1.failed": 1.0})
    assert one.attrs["converged"]
    # the rudder turns against the windmilling left engine
    assert float(one["engine1.thrust"]) < 0.0 < float(one["engine2.thrust"])
    assert float(one["applied.delta_r"]) < -1e-3
    # under a recorded speed or pressure the drag of the failed engine is that of the record
    failed = {"kind": "level", "fixed": {"engine1.failed": 1.0}}
    for mode, drive in ((3.0, "torque"), (4.0, "rpm"), (5.0, "manifold_pressure")):
        with pytest.raises(SchemaError, match=rf"engine1\.{drive}_drive, which is not given"):
            flightmech.trim(sim, start | {"mode.engine": mode}, **failed)
    driven = start | {"mode.engine": 4.0, "engine1.rpm_drive": float(one["engine1.rpm"])}
    again = flightmech.trim(sim, driven, **failed)
    assert float(again["engine1.thrust"]) == pytest.approx(float(one["engine1.thrust"]), rel=1e-4)


@pytest.mark.parametrize("motor", [None, MOTOR], ids=["table", "motor"])
def test_a_failed_engine_without_fuel_windmills(make_aircraft, make_tree, motor):
    """It has no fuel to cut off: its power is taken away, or its lever is closed."""
    tables = dict(BLADES)
    if motor is None:
        tables["shaft_power"] = make_term([0.0, 2e5], {"throttle": [0.0, 1.0]})
    blades = Propeller(tables, diameter=D, inertia=2.0, rpm_high=RATED)
    engines = tuple(Engine((1.0, y, 0.0), propeller=blades, motor=motor) for y in (-1.5, 1.5))
    sim = flightmech.compile(
        make_aircraft(engines=engines), make_tree({"CD/basic": make_term(0.0)})
    )
    found = flightmech.trim(
        sim,
        {"init.V": 55.0, "engine1.throttle": 0.9},
        unknowns=["alpha"],
        residuals=["p_dot"],
        fixed={"engine1.failed": 1.0},
    )
    assert float(found["engine1.thrust"]) < 0.0
    if motor is None:
        assert float(found["engine1.torque"]) == pytest.approx(0.0, abs=1e-6)
        assert float(found["engine1.rpm"]) > 50.0
