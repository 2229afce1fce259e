"""Aircraft that use everything the kernel can compute, and as little as it allows: what robustness
is tried on.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import xarray as xr

import flightmech
from flightmech.aircraft.controls import Circuit, ControlGeometry
from flightmech.aircraft.fuel import Fuel, Tank, tank_tables
from flightmech.aircraft.landing_gear import Contact, LandingGear, Steering
from flightmech.aircraft.propulsion.electric_motor import ElectricMotor
from flightmech.aircraft.propulsion.engine_deck import EngineDeck
from flightmech.aircraft.propulsion.piston_engine import PistonEngine
from flightmech.aircraft.propulsion.propeller import Propeller
from flightmech.aircraft.separation import FlowSeparation
from flightmech.flown_states import FLOWN_STATES, gather_states, pack_states
from flightmech.simulation.compiler import compile_with_envelope
from flightmech.terms import make_term

ALPHA, MACH = np.array([-0.2, 0.0, 0.2, 0.4]), np.array([0.1, 0.8])
BODY = {
    "S": 17.0,
    "cbar": 1.67,
    "b": 10.3,
    "mass": 2300.0,
    "Ixx": 10800.0,
    "Iyy": 8100.0,
    "Izz": 15100.0,
    "Ixy": 40.0,
    "Ixz": 350.0,
    "Iyz": -25.0,
}
LEG = {
    "radius": 0.25,
    "stroke": 0.3,
    "damping": 8e3,
    "damping_ext": 14e3,
    "orifice": 5e3,
    "orifice_ext": 9e3,
    "tyre_stiffness": 400e3,
    "rolling": 0.02,
}
MAIN = LEG | {
    "stiffness": 90e3,
    "side_stiffness": 150e3,
    "cornering_stiffness": 45e3,
    "cornering_load": 14e3,
    "brake": 8e3,
}
NOSE = LEG | {
    "stiffness": 40e3,
    "side_stiffness": 80e3,
    "cornering_stiffness": 15e3,
    "cornering_load": 5e3,
    "steering": 1.0,
}
MOVING = {
    "cable_stiffness": 12e3,
    "cable_damping": 60.0,
    "damping": 40.0,
    "friction": 20.0,
    "stiction": 5.0,
    "inertia": 1.1,
    "hinge_friction": 2.0,
}


def air() -> dict[str, xr.Dataset]:
    """Return terms of every form: tables of none to four axes, factors, powers, implicit variables,
    lift, hinge moments.
    """
    gear = xr.DataArray([0.0, 1.0], coords={"gear": [0.0, 1.0]}, dims="gear")
    four = {
        "alpha": ALPHA[::2],
        "mach": [0.2, 0.6],
        "delta_f": [0.0, 0.7],
        "beta": [-0.2, 0.0, 0.2],
    }
    near = make_term(0.05, regressors=["CL"])
    near.attrs |= {"power": "h_agl", "exponent": -1.2, "floor": 0.5}
    return {
        "CL/basic": make_term(
            (0.25 + 4.8 * ALPHA)[:, None] * (1.0 + 0.1 * MACH),
            {"alpha": ALPHA, "mach": MACH},
            outside="linear",
        ),
        "CL/elevator": make_term(0.36, regressors=["delta_e"]),
        "CL/alphadothat": make_term([1.2, 1.5], {"mach": [0.2, 0.7]}, ["alphadothat"]),
        "CD/basic": make_term(0.024 + 0.8 * ALPHA**2, {"alpha": ALPHA}),
        "CD/gear": make_term(0.02 + 0.01 * ALPHA, {"alpha": ALPHA}, K1=gear),
        "CD/load_factor": make_term(0.002, regressors=["dnz"]),
        "CD/polar": make_term([0.01, 0.002, 0.05], {"CL": [-0.4, 0.2, 1.2]}),
        "CY/beta": make_term(-0.6 - 0.1 * ALPHA, {"alpha": ALPHA}, ["beta"]),
        "CY/betadothat": make_term(-0.3, regressors=["betadothat"]),
        "Cl/beta": make_term(-0.08, regressors=["beta"]),
        "Cl/phat": make_term(-0.44, regressors=["phat"]),
        "Cl/aileron": make_term(-0.15, regressors=["delta_a"]),
        "Cm/basic": make_term(0.03 - 0.7 * ALPHA, {"alpha": ALPHA}),
        "Cm/elevator": make_term(-1.05, regressors=["delta_e"]),
        "Cm/qhat": make_term(-13.0, regressors=["qhat"]),
        "Cm/near": near,
        "Cn/basic": make_term(np.linspace(-0.003, 0.003, 24).reshape(2, 2, 2, 3), four),
        "Cn/beta": make_term(0.1, regressors=["beta"]),
        "Cn/rhat": make_term(-0.14, regressors=["rhat"]),
        "Cn/drag": make_term([0.1, 0.12], {"CD": [0.02, 0.1]}, ["beta", "CL"]),
        "Cn/rudder": make_term(-0.07, regressors=["delta_r"]),
        "Ch_e/alpha": make_term(-0.2 + 0.1 * MACH, {"mach": MACH}, ["alpha"]),
        "Ch_e/delta": make_term(-0.4, regressors=["delta_e"]),
        "Ch_a/delta": make_term(-0.4, regressors=["delta_a"]),
        "Ch_r/delta": make_term(-0.3, regressors=["delta_r"]),
    }


def deck() -> EngineDeck:
    """Return an engine deck of two spools with every switch at work."""
    return EngineDeck(
        {
            "n2_command": make_term([0.5, 1.0], {"throttle": [0.0, 1.0]}),
            "n2_up_time": make_term(0.5),
            "n2_down_time": make_term(0.8),
            "n2_up_limit": make_term(0.2),
            "n1_command": make_term([0.2, 0.9], {"n2": [0.5, 1.0]}),
            "n1_up_time": make_term(0.4),
            "corrected_thrust": make_term(
                [[100.0, -50.0], [5000.0, 4000.0]], {"corrected_n1": [0.2, 1.0], "mach": [0.0, 0.6]}
            ),
            "corrected_air_flow": make_term([5.0, 30.0], {"corrected_n1": [0.2, 1.0]}),
            "corrected_fuel_flow": make_term([0.02, 0.12], {"corrected_n2": [0.5, 1.0]}),
            "corrected_itt": make_term([600.0, 900.0], {"corrected_n2": [0.5, 1.0]}),
            "corrected_n1_windmill": make_term([0.0, 0.3], {"mach": [0.0, 0.6]}),
            "corrected_n2_windmill": make_term([0.0, 0.15], {"mach": [0.0, 0.6]}),
            "windmill_thrust": make_term(-0.02, regressors=["qbar"]),
        },
        lever_delay=0.15,
        itt_time=1.0,
        n1_inertia=0.4,
        n2_inertia=0.2,
        n1_rated=1800.0,
        n2_rated=3300.0,
    )


def whole() -> flightmech.Aircraft:
    """Return a twin jet with decks, fuel in tanks, gear with a tail skid, and three circuits of the
    highest order.
    """
    tanks = (
        Tank((0.1, -2.0, 0.15), 60.0, order=2),
        Tank((0.1, 2.0, 0.15), 60.0, order=2),
        Tank((0.8, 0.3, -0.1), 50.0),
    )
    contacts = (
        Contact("nose", (1.564, 0.0, 0.798), **NOSE),
        Contact(
            "left",
            (-0.17, -0.805, 0.759),
            strut=make_term([0.0, 900.0], {"compression": [0.0, 0.3]}),
            **MAIN,
        ),
        Contact("right", (-0.17, 0.805, 0.759), **MAIN),
        Contact(
            "tail",
            (-4.0, 0.0, -0.1),
            side_stiffness=200e3,
            stiffness=150e3,
            damping=3e3,
            friction=0.4,
            retracts=False,
        ),
    )
    return flightmech.Aircraft(
        name="whole",
        **BODY,
        cg=(0.06, 0.01, 0.22),
        engines=(
            flightmech.aircraft.Engine((-0.3, -0.76, 0.05), deck=deck()),
            flightmech.aircraft.Engine((-0.3, 0.76, 0.05), deck=deck(), time_constant=0.3),
        ),
        limits={"delta_e": (-0.35, 0.3), "delta_a": (-0.35, 0.35), "delta_r": (-0.35, 0.35)},
        fuel=Fuel(160.0, (0.0, 0.0, 0.0), tank_tables(tanks)),
        gear=LandingGear(
            contacts,
            Steering(
                order=4,
                limit=0.7,
                stiffness=2000.0,
                damping=20.0,
                inertia=1.0,
                trail=0.05,
                scrub=0.05,
                rudder=0.3,
                arm_stiffness=3000.0,
                arm_damping=30.0,
                arm_inertia=1.0,
            ),
            antiskid=0.8,
        ),
        controls={
            "delta_e": ControlGeometry(1.5, 0.35, -1.2),
            "delta_a": ControlGeometry(1.0, 0.3, 0.3),
            "delta_r": ControlGeometry(0.6, 0.3, -2.5),
        },
        circuits={
            "column": Circuit(
                (-0.15, 0.2),
                6.0,
                4,
                bob_weight=1.0,
                unbalance=0.3,
                neutral_trim=0.1,
                stiffness=300.0,
                preload=4.0,
                **MOVING,
            ),
            "wheel": Circuit(
                (-1.2, 1.2),
                0.08,
                6,
                stiffness=20.0,
                **(MOVING | {"friction": 1.0, "stiction": 0.5, "cable_stiffness": 120.0}),
            ),
            "pedal": Circuit((-0.08, 0.08), 4.0, 4, restitution=0.2, stiffness=900.0, **MOVING),
        },
    )


def plain() -> flightmech.Aircraft:
    """Return a jet with one static engine and nothing else."""
    thrust = make_term(
        [[300.0, 250.0], [4559.0, 4000.0]], {"throttle": [0.0, 1.0], "mach": [0.0, 0.6]}
    )
    engine = flightmech.aircraft.Engine(
        (-0.3, 0.0, 0.05), thrust=thrust, time_constant=1.2, angular_momentum=55.0
    )
    return flightmech.Aircraft(name="plain", **BODY, engines=(engine,))


def fed() -> flightmech.Aircraft:
    """Return a jet with two decks, fed from tanks with a cross-feed."""
    tanks = (
        Tank((0.1, -2.0, 0.15), 60.0, name="left", content=40.0),
        Tank((0.1, 2.0, 0.15), 60.0, name="right", content=30.0),
    )
    engine = flightmech.aircraft.Engine
    engines = (
        engine((-0.3, -0.8, 0.05), deck=deck(), feed=("left",), crossfeed=("right",)),
        engine((-0.3, 0.8, 0.05), deck=deck(), feed=("right",), crossfeed=("left",)),
    )
    return replace(plain(), name="fed", engines=engines, fuel=Fuel(70.0, tanks=tanks))


def _blades() -> dict[str, xr.Dataset]:
    angles = {"J": [0.0, 0.6, 1.5], "blade_angle": [0.1, 0.7, 1.5]}
    thrust = [[0.1, 0.15, 0.0], [0.0, 0.12, -0.02], [-0.1, -0.05, -0.1]]
    power = [[0.04, 0.1, 0.03], [0.02, 0.1, 0.02], [-0.2, -0.02, -0.05]]
    return {"CT_prop": make_term(thrust, angles), "CP_prop": make_term(power, angles)}


def piston() -> flightmech.Aircraft:
    """Return an aircraft with two piston engines, whose propellers have governors and feather."""
    propeller = Propeller(
        _blades(),
        diameter=2.0,
        inertia=2.0,
        rpm_high=270.0,
        rpm_low=150.0,
        rotation=-1,
        low_pitch=0.2,
        high_pitch=0.7,
        feather_rate=0.3,
        governor_time=0.05,
    )
    engine = PistonEngine(
        {
            "fuel_work": make_term([1.0e7, 1.3e7], {"fuel_air_ratio": [0.05, 0.1]}),
            "friction_pressure": make_term([5e4, 1.5e5], {"engine_rpm": [0.0, 320.0]}),
        },
        displacement=6e-3,
        intake_impedance=2e-4,
        throttle_impedance=0.02,
        boost_ratio=1.3,
        boost_limit=1.2e5,
        pumping=0.8,
        enrichment=1.0,
    )
    engines = tuple(
        flightmech.aircraft.Engine((1.8, side, 0.0), propeller=propeller, piston=engine)
        for side in (-2.0, 2.0)
    )
    return replace(plain(), name="piston", engines=engines)


def electric() -> flightmech.Aircraft:
    """Return an aircraft with a motor and a propeller of fixed pitch."""
    tables = {name: leaf.isel(blade_angle=1) for name, leaf in _blades().items()}
    motor = ElectricMotor(
        {"open_voltage": make_term([40.0, 50.0], {"charge": [0.0, 1.0]})},
        speed_constant=20.0,
        motor_resistance=0.03,
        capacity=2e4,
        idle_current=1.0,
    )
    engine = flightmech.aircraft.Engine(
        (0.5, 0.0, 0.0), propeller=Propeller(tables, 0.6, 0.02, 500.0), motor=motor
    )
    return replace(plain(), name="electric", engines=(engine,))


def stalling() -> flightmech.Aircraft:
    """Return the jet with one static engine and a flow separation, all its tables in use."""
    tables = {
        "a1": make_term([20.0, 24.0], {"delta_f": [0.0, 0.7]}),
        "alpha_star": make_term([0.28, 0.24], {"mach": [0.1, 0.5]}),
        "asymmetry": make_term(0.01),
        "tau1": make_term([6.0, 5.0], {"CT": [0.0, 0.4]}),
        "tau2": make_term(8.0),
        "buffet_rms": make_term([2.0, 0.5, 0.0], {"X": [0.2, 0.8, 1.0]}),
        "buffet_frequency": make_term(60.0),
        "buffet_damping": make_term(0.1),
    }
    return replace(plain(), name="stalling", stall=FlowSeparation(2.4, tables))


def separated() -> dict[str, xr.Dataset]:
    """Return terms over every variable of the separation."""
    return {
        "CL/attached": make_term(0.25),
        "CL/kirchhoff": make_term(4.8, regressors=["X_lift", "alpha"]),
        "CD/basic": make_term(0.024 + 0.8 * ALPHA**2, {"alpha": ALPHA}),
        "CD/separation": make_term([0.12, 0.0], {"X": [0.0, 1.0]}),
        "CY/beta": make_term(-0.6, regressors=["beta"]),
        "Cl/separation": make_term(0.5, regressors=["X_lift_diff", "alpha"]),
        "Cl/phat": make_term([-0.1, -0.44], {"X": [0.0, 1.0]}, ["phat"]),
        "Cl/aileron": make_term([-0.08, -0.15], {"X_right": [0.0, 1.0]}, ["delta_a"]),
        "Cm/basic": make_term(0.03 - 0.7 * ALPHA, {"alpha": ALPHA}),
        "Cm/separation": make_term([-0.15, 0.0], {"X": [0.0, 1.0]}),
        "Cm/elevator": make_term([-0.7, -1.05], {"X": [0.0, 1.0]}, ["delta_e"]),
        "Cm/qhat": make_term(-13.0, regressors=["qhat"]),
        "Cn/separation": make_term(-0.03, regressors=["X_diff"]),
        "Cn/beta": make_term([0.04, 0.1], {"X_left": [0.0, 1.0]}, ["beta"]),
        "Cn/rhat": make_term(-0.14, regressors=["rhat"]),
    }


def supported() -> xr.DataTree:
    """Return terms with the states of flights, for a validity envelope with tables of 2 to 3
    axes.
    """
    lift = np.add.outer(0.3 + 4.0 * ALPHA, 0.1 * MACH)
    found = _tree(
        {
            "CL/basic": make_term(
                lift, {"alpha": ALPHA, "mach": MACH}, stderr=0.01, source="flight"
            ),
            "CD/gear": make_term(0.03, regressors=["gear"], stderr=0.02, source="judgement"),
            "Cm/qhat": make_term(-13.0, regressors=["qhat"], stderr=0.5, source="flight"),
        }
    )
    flown = np.linspace(0.0, 0.2, 40)
    samples = {"alpha": flown, "mach": 0.5 - flown, "beta": flown - 0.1, "gear": 0.0 * flown}
    found.attrs[FLOWN_STATES] = pack_states(gather_states([samples]))
    return found


def compiled() -> dict[str, flightmech.SimModel]:
    """Return the models by name: every submodel; one engine and body axes; tanks that feed engines;
    propellers; flow separation; a validity envelope; one constant; no term at all.
    """
    body = {
        "CX/basic": make_term(-0.03),
        "CZ/alpha": make_term(-4.5, regressors=["alpha"]),
        "Cm/qhat": make_term(-9.0, regressors=["qhat"]),
    }
    return {
        "whole": flightmech.compile(whole(), _tree(air())),
        "plain": flightmech.compile(plain(), _tree(body, force_axes="body")),
        "fed": flightmech.compile(fed(), _tree(body, force_axes="body")),
        "piston": flightmech.compile(piston(), _tree(body, force_axes="body")),
        "electric": flightmech.compile(electric(), _tree(body, force_axes="body")),
        "stalling": flightmech.compile(stalling(), _tree(separated())),
        "supported": compile_with_envelope(plain(), supported()),
        "bare": flightmech.compile(
            flightmech.Aircraft(name="bare", **BODY),
            _tree({"CL/alpha": make_term(4.5, regressors=["alpha"])}),
        ),
        "empty": flightmech.compile(flightmech.Aircraft(name="empty", **BODY), _tree({})),
    }


def _tree(leaves: dict[str, xr.Dataset], **attrs: str) -> xr.DataTree:
    found = xr.DataTree.from_dict({f"/{name}": leaf for name, leaf in leaves.items()})
    found.attrs.update(attrs)
    return found
