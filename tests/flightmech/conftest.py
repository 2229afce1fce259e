"""A small synthetic model, its FMUs, and an instance driven call by call."""

from __future__ import annotations

from functools import cache
from pathlib import Path

import fmpy
import numpy as np
import pytest
import xarray as xr
from fmpy.fmi2 import FMU2Model, FMU2Slave, fmi2CallbackFunctions, fmi2CallbackLoggerTYPE
from fmpy.fmi3 import FMU3Model, FMU3Slave

import flightmech
from flightmech.aircraft.controls import Circuit, ControlGeometry
from flightmech.aircraft.engine import Engine
from flightmech.aircraft.fuel import Fuel
from flightmech.aircraft.landing_gear import Contact, LandingGear, Steering
from flightmech.aircraft.propulsion.engine_deck import EngineDeck
from flightmech.terms import make_term

VERSIONS = ("2.0", "3.0")
START = {"init.V": 90.0, "init.h": 3000.0, "init.gamma": 0.0, "mode.trim": 1}


@pytest.fixture(scope="session")
def trainer() -> flightmech.SimModel:
    """A light trainer: every coefficient, tables of no to two axes, one engine with a lag."""
    alpha, mach = np.array([-0.2, 0.0, 0.15, 0.3]), np.array([0.1, 0.6])
    leaves = {
        "/CL/basic": make_term(
            [[-0.8, -0.9], [0.2, 0.25], [0.95, 1.1], [1.4, 1.5]],
            {"alpha": alpha, "mach": mach},
            source="datcom",
        ),
        "/CL/delta_e": make_term(0.4, regressors=["delta_e"]),
        "/CL/alphadothat": make_term(2.0, regressors=["alphadothat"]),
        "/CD/basic": make_term(
            [0.06, 0.025, 0.07, 0.2], {"alpha": alpha}, comment="parabola through 4 points"
        ),
        "/CY/beta": make_term(-0.6, regressors=["beta"]),
        "/Cl/beta": make_term([-0.05, -0.06, -0.08, -0.1], {"alpha": alpha}, ["beta"]),
        "/Cl/phat": make_term(-0.45, regressors=["phat"]),
        "/Cl/aileron": make_term(-0.12, regressors=["delta_a"]),
        "/Cm/basic": make_term([0.2, 0.02, -0.12, -0.35], {"alpha": alpha}),
        "/Cm/qhat": make_term(-14.0, regressors=["qhat"]),
        "/Cm/delta_e": make_term(-1.1, regressors=["delta_e"]),
        "/Cn/beta": make_term(0.09, regressors=["beta"]),
        "/Cn/rhat": make_term(-0.14, regressors=["rhat"]),
        "/Cn/rudder": make_term(-0.07, regressors=["delta_r"]),
    }
    thrust = make_term([[200.0, 100.0], [9000.0, 7000.0]], {"throttle": [0.0, 1.0], "mach": mach})
    aircraft = flightmech.Aircraft(
        "Trainer & co",
        17.0,
        1.67,
        10.3,
        2500.0,
        10000.0,
        8100.0,
        15000.0,
        Ixz=500.0,
        cg=(0.02, 0.0, 0.1),
        engines=(Engine((0.0, 0.0, 0.1), thrust=thrust, time_constant=0.8),),
    )
    return flightmech.compile(aircraft, xr.DataTree.from_dict(leaves))


@pytest.fixture(scope="session")
def fmus(trainer, tmp_path_factory) -> dict[str, Path]:
    """Both FMUs, unpacked."""
    folder = tmp_path_factory.mktemp("fmu")
    return {
        v: Path(
            fmpy.extract(
                str(flightmech.write_fmu(trainer, folder / f"v{v[0]}.fmu", v)), str(folder / v)
            )
        )
        for v in VERSIONS
    }


description = cache(fmpy.read_model_description)
KINDS = {"2.0": (FMU2Slave, FMU2Model), "3.0": (FMU3Slave, FMU3Model)}


def everything_aircraft() -> flightmech.Aircraft:
    """Return the plain jet with every submodel: deck of a turbofan with a slow lever, fuel,
    tricycle gear, column and pedals.
    """
    leg = {
        "stiffness": 80e3,
        "damping": 8e3,
        "tyre_stiffness": 3e5,
        "side_stiffness": 2e5,
        "cornering_stiffness": 45e3,
        "rolling": 0.02,
    }
    gear = LandingGear(
        (
            Contact("nose", (1.6, 0.0, 0.8), steering=1.0, **leg),
            Contact("left", (-0.2, -0.8, 0.8), brake=8e3, **leg),
            Contact("right", (-0.2, 0.8, 0.8), brake=8e3, **leg),
        ),
        Steering(stiffness=2000.0),
    )
    deck = EngineDeck(
        {
            "n2_command": make_term([0.5, 1.0], {"throttle": [0.0, 1.0]}),
            "n2_up_time": make_term(0.5),
            "n2_down_time": make_term(0.8),
            "thrust": make_term([0.0, 9000.0], {"n2": [0.5, 1.0]}),
            "fuel_flow": make_term([0.02, 0.15], {"n2": [0.5, 1.0]}),
        },
        lever_delay=0.3,
    )
    return linear_aircraft(
        engines=(Engine((0.0, 0.0, 0.0), deck=deck),),
        fuel=Fuel(400.0, (-0.1, 0.0, 0.0)),
        gear=gear,
        controls={
            "delta_e": ControlGeometry(1.5, 0.3, -1.5),
            "delta_r": ControlGeometry(1.0, 0.3, -2.0),
        },
        circuits={
            "column": Circuit((-0.2, 0.2), 5.0, friction=15.0, damping=40.0, stiffness=400.0),
            "pedal": Circuit(
                (-0.1, 0.1),
                5.0,
                order=4,
                inertia=1.0,
                friction=20.0,
                damping=60.0,
                stiffness=800.0,
                cable_stiffness=2e4,
            ),
        },
    )


@pytest.fixture(scope="session")
def everything() -> flightmech.SimModel:
    """The plain jet with every submodel."""
    return flightmech.compile(everything_aircraft(), linear_tree())


@pytest.fixture(scope="session")
def whole(everything, tmp_path_factory) -> dict[str, Path]:
    """FMUs of the jet with every submodel, unpacked."""
    folder = tmp_path_factory.mktemp("whole")
    files = {v: flightmech.write_fmu(everything, folder / f"v{v[0]}.fmu", v) for v in VERSIONS}
    return {v: Path(fmpy.extract(str(path), str(folder / v))) for v, path in files.items()}


class Slave:
    """An instance driven call by call, for co-simulation or model exchange; texts of the FMU's
    logger are kept.
    """

    def __init__(self, folder: Path, guid: str | None = None, exchange: bool = False):
        self.model = description(str(folder))
        self.references = {v.name: v.valueReference for v in self.model.modelVariables}
        self.version = self.model.fmiVersion
        self.messages: list[str] = []
        kind = KINDS[self.version][exchange]
        self.fmu = kind(
            guid=guid or self.model.guid,
            unzipDirectory=str(folder),
            modelIdentifier=self.model.coSimulation.modelIdentifier,
            instanceName="one",
        )

    def open(self) -> Slave:
        """Instantiate, with the FMU's logger."""
        if self.version == "2.0":
            self.logger = fmi2CallbackLoggerTYPE(
                lambda *message: self.messages.append(message[4].decode())
            )
            self.callbacks = fmi2CallbackFunctions(logger=self.logger)
            self.fmu.instantiate(callbacks=self.callbacks)
        else:
            self.fmu.instantiate(
                logMessage=lambda *message: self.messages.append(message[3].decode())
            )
        return self

    def set(self, values: dict[str, float]) -> None:
        """Set reals."""
        setter = self.fmu.setReal if self.version == "2.0" else self.fmu.setFloat64
        setter([self.references[name] for name in values], list(values.values()))

    def get(self, *names: str) -> list[float]:
        """Get reals."""
        getter = self.fmu.getReal if self.version == "2.0" else self.fmu.getFloat64
        return getter([self.references[name] for name in names])

    def start(self, values: dict[str, float] | None = None) -> Slave:
        """Initialise at the condition of all tests, with `values` set before the end of
        initialization mode.
        """
        self.enter()
        self.set({**START, **(values or {})})
        self.fmu.exitInitializationMode()
        return self

    def enter(self) -> None:
        """Enter initialization mode at time zero."""
        if self.version == "2.0":
            self.fmu.setupExperiment(startTime=0.0)
        self.fmu.enterInitializationMode()

    def step(self, t: float, dt: float) -> None:
        """Make a communication step."""
        self.fmu.doStep(t, dt)


@pytest.fixture(scope="session")
def condition() -> dict[str, float]:
    """Where `Slave.start` starts: trimmed level flight."""
    return START


@pytest.fixture(scope="session")
def instance(fmus):
    """Make an instance of the FMU of one version."""
    return lambda version: Slave(fmus[version]).open()


@pytest.fixture(scope="session")
def exchange(fmus):
    """Make an instance for model exchange of the FMU of one version."""
    return lambda version: Slave(fmus[version], exchange=True).open()


@pytest.fixture(scope="session")
def third_party():
    """Load another unpacked FMU, or one under a wrong token; `open` instantiates it."""
    return Slave


@pytest.fixture(params=VERSIONS)
def slave(fmus, request) -> Slave:
    """An instance of either version."""
    return Slave(fmus[request.param]).open()


LINEAR = {
    "CL": {"": 0.25, "alpha": 5.2},
    "CD": {"": 0.025, "alpha alpha": 1.4},
    "CY": {"beta": -0.7, "delta_r": 0.17},
    "Cl": {"beta": -0.09, "phat": -0.45, "rhat": 0.11, "delta_a": -0.14, "delta_r": 0.01},
    "Cm": {"": 0.03, "alpha": -0.8, "qhat": -14.0, "delta_e": -1.2},
    "Cn": {"beta": 0.1, "phat": -0.04, "rhat": -0.13, "delta_a": 0.005, "delta_r": -0.08},
}


def linear_aircraft(**changes) -> flightmech.Aircraft:
    """Return a jet without thrust tables, thrust through the c.g. at the moment reference point:
    closed forms stay short.
    """
    fields = {
        "name": "plain",
        "S": 17.0,
        "cbar": 1.67,
        "b": 10.3,
        "mass": 2400.0,
        "Ixx": 10800.0,
        "Iyy": 8100.0,
        "Izz": 15100.0,
        "engines": (Engine((0.0, 0.0, 0.0)),),
        "limits": {"delta_e": (-0.4, 0.4), "delta_a": (-0.35, 0.35), "delta_r": (-0.35, 0.35)},
    }
    return flightmech.Aircraft(**(fields | changes))


def linear_tree(**changes) -> xr.DataTree:
    """Return constant derivatives as a tree: ``Cm={"alpha": 0.1}`` replaces single ones, leaves are
    taken as they are.
    """
    leaves = {}
    for coefficient in {*LINEAR, *changes}:
        for words, value in {**LINEAR.get(coefficient, {}), **changes.get(coefficient, {})}.items():
            name = f"/{coefficient}/{words.replace(' ', '_') or 'basic'}"
            leaves[name] = (
                value
                if isinstance(value, xr.Dataset)
                else make_term(value, regressors=words.split())
            )
    return xr.DataTree.from_dict(leaves)


@pytest.fixture(scope="session")
def plain_aircraft():
    return linear_aircraft


@pytest.fixture(scope="session")
def plain_tree():
    return linear_tree


@pytest.fixture(scope="session")
def plain():
    """Compile the plain jet with changed derivatives."""
    return lambda aircraft=None, **changes: flightmech.compile(
        aircraft or linear_aircraft(), linear_tree(**changes)
    )
