"""Engines driven by recorded torque, speed of the propeller or manifold pressure.

A run by the lever is the record. Its torque, speed or manifold pressure drives the same aircraft
again, which then has the same thrust.
"""

from __future__ import annotations

import numpy as np
import pytest
import xarray as xr

import flightmech
from flightmech import air
from flightmech.aircraft import Engine, EngineDeck, PistonEngine, Propeller
from flightmech.errors import SimulationError
from flightmech.terms import make_term

D, RATED = 2.0, 270.0
LOW, HIGH = 0.2, 0.7
J = np.array([0.0, 0.5, 1.0, 2.0, 4.0])
ANGLES = np.array([LOW, HIGH])
CT = 0.06 + 0.2 * ANGLES[None, :] - 0.12 * J[:, None]
CP = 0.01 + 0.2 * ANGLES[None, :] - 0.05 * J[:, None]
MAP = [2e4, 1.2e5]
CHART = 130e3 / 1e5 / 280.0 * np.outer(MAP, [0.0, 400.0])
PISTON = PistonEngine(
    {
        "corrected_power": make_term(CHART, {"manifold_pressure": MAP, "engine_rpm": [0.0, 400.0]}),
        "friction_power": make_term(2e3),
    },
    intake_impedance=2e-4,
    throttle_impedance=0.02,
    displacement=7e-3,
    pumping=0.8,
    boost_ratio=1.3,
    boost_limit=1.1e5,
)
START = {"init.V": 55.0, "init.h": 1000.0, "mode.earth": 0.0, "mode.trim": 0.0}
TIME = np.arange(0.0, 12.01, 0.02)
LEVER = np.interp(TIME, [0.0, 1.0, 1.4, 6.0, 6.3, 12.0], [0.5, 0.5, 0.9, 0.9, 0.3, 0.3])


def blades(*, governed: bool) -> Propeller:
    columns = [0, 1] if governed else [0]
    axes = {"J": J, "blade_angle": ANGLES} if governed else {"J": J}

    def table(values: np.ndarray) -> xr.Dataset:
        return make_term(values[:, columns] if governed else values[:, 0], axes)

    stops = {"low_pitch": LOW, "high_pitch": HIGH} if governed else {}
    return Propeller(
        {"CT_prop": table(CT), "CP_prop": table(CP)},
        diameter=D,
        inertia=2.0,
        rpm_high=RATED,
        rpm_low=150.0,
        **stops,
    )


@pytest.fixture(scope="module")
def compiled(make_aircraft, make_tree):
    """Compile the jet, heavy and without aerodynamics, with one engine."""

    def of(**engine):
        craft = make_aircraft(
            engines=(Engine((0.0, 0.0, 0.0), **engine),), mass=1e9, cg=(0.0, 0.0, 0.0)
        )
        return flightmech.compile(craft, make_tree({"CD/basic": make_term(0.0)}))

    return of


def fly(sim: flightmech.SimModel, mode: float, **inputs: np.ndarray) -> xr.Dataset:
    columns = {f"engine1.{name}": ("time", values) for name, values in inputs.items()}
    return flightmech.simulate(
        sim, xr.Dataset(columns, {"time": TIME}), START | {"mode.engine": mode}
    )


def column(flown: xr.Dataset, name: str) -> np.ndarray:
    return flown[f"engine1.{name}"].values


@pytest.fixture(scope="module")
def sims(compiled):
    return {
        governed: compiled(propeller=blades(governed=governed), piston=PISTON)
        for governed in (True, False)
    }


@pytest.mark.parametrize("governed", [True, False], ids=["governor", "fixed pitch"])
@pytest.mark.parametrize(
    ("mode", "quantity"), [(3.0, "torque"), (4.0, "rpm"), (5.0, "manifold_pressure")]
)
def test_recorded_quantity_gives_the_recorded_thrust(sims, governed, mode, quantity):
    """The lever is idle but where it is the power of a governed propeller."""
    sim = sims[governed]
    commanded = np.interp(TIME, [0.0, 3.0, 4.0, 12.0], [0.6, 0.6, 0.8, 0.8])
    record = fly(sim, 0.0, throttle=LEVER, prop_command=commanded)
    thrust = column(record, "thrust")
    assert np.ptp(thrust) > 400.0
    assert np.ptp(column(record, "rpm")) > 3.0
    drives = {f"{quantity}_drive": column(record, quantity)}
    lever = np.zeros_like(LEVER)
    if governed and quantity == "rpm":
        lever, commanded = LEVER, 0.0 * commanded
    again = fly(sim, mode, throttle=lever, prop_command=commanded, **drives)
    # Torque and pressure differ by the line between samples.  A shaft is behind its recorded speed
    # by 0.02 s; a governor holds it within the rate of its blades, which the record needed in full.
    speed = 130.0 if governed else 50.0
    most = speed if quantity == "rpm" else 4.0
    assert np.abs(column(again, "thrust") - thrust).max() < most
    assert column(again, "thrust")[0] == pytest.approx(thrust[0], rel=1e-9)
    rpm = {True: 6.5, False: 2.0}[governed] if quantity == "rpm" else 1.0
    assert column(again, "rpm") == pytest.approx(column(record, "rpm"), abs=rpm)


def test_governor_holds_the_recorded_speed_under_a_recorded_pressure(sims):
    """Without a propeller lever the recorded speed is the command (mode.engine 5)."""
    manifold, speed = np.full_like(TIME, 8e4), np.full_like(TIME, 240.0)
    flown = fly(sims[True], 5.0, manifold_pressure_drive=manifold, rpm_drive=speed)
    # the aircraft gains speed, and the blades follow
    assert column(flown, "rpm")[0] == pytest.approx(240.0, rel=1e-9)
    assert column(flown, "rpm") == pytest.approx(speed, abs=0.05)
    p = float(air.atmosphere(1000.0).p_static)
    swept = 7e-3 * 240.0 / (4.0 * np.pi)
    # in front of the compressor the pressure is lower by its ratio
    power = 130e3 * 0.8 * 240.0 / 280.0 - 2e3 + 0.8 * swept * (8e4 / 1.3 - p)
    assert column(flown, "shaft_power")[0] == pytest.approx(power, rel=1e-6)
    assert column(flown, "manifold_pressure") == pytest.approx(manifold, rel=1e-15)


def test_a_shaft_that_follows_loads_the_aircraft_with_its_torque(sims):
    """Torque of the air and of the inertia, as the speed grows by 10 rad/s each second."""
    speed = 200.0 + 10.0 * TIME
    flown = fly(sims[False], 4.0, rpm_drive=speed)
    n = column(flown, "rpm") / (2.0 * np.pi)
    rho = flown["rho"].values
    drag = column(flown, "CP_prop") * rho * n**2 * D**5 / (2.0 * np.pi)
    late = TIME > 0.5
    assert column(flown, "torque")[late] == pytest.approx((drag + 2.0 * 10.0)[late], rel=1e-4)
    # behind the recorded speed by its lag of 0.02 s
    assert column(flown, "rpm")[late] == pytest.approx((speed - 0.2)[late], rel=1e-6)


@pytest.mark.parametrize(
    ("quantity", "mode"), [("torque", 3.0), ("rpm", 4.0), ("manifold_pressure", 5.0)]
)
def test_trim_by_the_quantity_that_drives(make_aircraft, make_tree, quantity, mode):
    """The trim finds the thrust of the lever, with the quantity of the lever as its unknown."""
    craft = make_aircraft(
        engines=(Engine((1.0, 0.0, 0.0), propeller=blades(governed=False), piston=PISTON),),
        mass=1100.0,
        limits={"delta_e": (-0.4, 0.4)},
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
    point = {"init.V": 50.0, "init.h": 1000.0}
    lever = flightmech.trim(sim, point | {"mode.engine": 0.0}, kind="level")
    found = flightmech.trim(sim, point | {"mode.engine": mode}, kind="level")
    assert lever.attrs["converged"]
    assert found.attrs["converged"]
    name = f"engine1.{quantity}"
    assert float(found[name]) == pytest.approx(float(lever[name]), rel=1e-6)
    assert float(found["engine1.thrust"]) == pytest.approx(float(lever["engine1.thrust"]), rel=1e-6)


def refusal(sim: flightmech.SimModel, **parameters: float) -> str:
    values = START | {name.replace("__", "."): value for name, value in parameters.items()}
    with pytest.raises(SimulationError) as error:
        flightmech.simulate(sim, xr.Dataset(coords={"time": TIME[:2]}), values)
    return str(error.value)


def test_drives_that_the_engine_does_not_have_are_refused(compiled, sims):
    jet = compiled(thrust=make_term(1e3))
    assert "torque of a propeller, but the engines have none" in refusal(jet, mode__engine=3.0)
    assert "speed of a propeller, but the engines have none" in refusal(jet, mode__engine=4.0)
    assert "use mode.engine = 0, 1 or 2" in refusal(jet, mode__engine=5.0)
    tables = {
        "CT_prop": make_term(CT[:, 0], {"J": J}),
        "CP_prop": make_term(CP[:, 0], {"J": J}),
        "shaft_power": make_term([0.0, 9e4], {"throttle": [0.0, 1.0]}),
    }
    propeller = Propeller(tables, diameter=D, inertia=2.0, rpm_high=RATED, gear_ratio=15.0)
    turbine = compiled(
        propeller=propeller,
        deck=EngineDeck({"thrust": make_term(0.0)}, coupled=True, n1_rated=4000.0),
    )
    assert "the engines are no piston engines; use mode.engine = 0, 2, 3 or 4" in refusal(
        turbine, mode__engine=5.0
    )
    assert "turns with the propeller; use mode.engine = 0, 3 or 4" in refusal(
        turbine, mode__engine=1.0
    )
    assert "mode.engine = 5 does not fly by the lever" in refusal(
        sims[False], mode__engine=5.0, mode__trim=2.0
    )
    assert "5 (manifold pressure driven)" in refusal(sims[False], mode__engine=6.0)
