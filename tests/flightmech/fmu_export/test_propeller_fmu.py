"""An aircraft with propellers as an FMU: units, the bits of the kernel, a serialised state."""

from __future__ import annotations

import fmpy
import numpy as np
import pytest
import xarray as xr
from fmpy.fmi2 import FMU2Slave
from fmpy.validation import validate_fmu

import flightmech
from flightmech.aircraft import ElectricMotor, Engine, Propeller
from flightmech.fmu_export.fmu_file import write_fmu
from flightmech.terms import make_term

J, ANGLES = [0.0, 1.0, 2.5], [0.2, 0.7]
NAMES = ("engine1.rpm", "engine1.blade_angle", "engine1.J", "engine1.torque", "engine1.charge")


@pytest.fixture(scope="module")
def sim() -> flightmech.SimModel:
    value = np.add.outer([0.1, -0.02, -0.2], [0.0, 0.12])
    blades = Propeller(
        {
            "CT_prop": make_term(value, {"J": J, "blade_angle": ANGLES}),
            "CP_prop": make_term(0.08 + value, {"J": J, "blade_angle": ANGLES}),
        },
        diameter=0.6,
        inertia=0.02,
        rpm_high=500.0,
        rpm_low=300.0,
        low_pitch=0.2,
        high_pitch=0.7,
        governor_time=0.05,
    )
    motor = ElectricMotor(
        {"open_voltage": make_term([40.0, 50.0], {"charge": [0.0, 1.0]})},
        speed_constant=20.0,
        motor_resistance=0.03,
        capacity=2e4,
    )
    craft = flightmech.Aircraft(
        "drone",
        1.2,
        0.3,
        4.0,
        25.0,
        4.0,
        6.0,
        9.0,
        engines=(Engine((0.5, 0.0, 0.0), propeller=blades, motor=motor),),
    )
    leaves = {"CL/basic": make_term([-0.6, 1.4], {"alpha": [-0.2, 0.2]})}
    tree = xr.DataTree.from_dict({f"/{name}": leaf for name, leaf in leaves.items()})
    return flightmech.compile(craft, tree)


@pytest.fixture(scope="module")
def fmu(sim, tmp_path_factory):
    path = tmp_path_factory.mktemp("fmu") / "drone.fmu"
    write_fmu(sim, path, version="2.0")
    return path


@pytest.mark.slow
def test_description(fmu):
    """Valid, with the units of a motor; the propeller lever starts at the highest speed."""
    assert validate_fmu(fmu) == []
    description = fmpy.read_model_description(fmu)
    variables = {variable.name: variable for variable in description.modelVariables}
    assert variables["engine1.rpm"].unit == "rad s-1"
    assert float(variables["engine1.prop_command"].start) == 1.0
    units = {unit.name: unit.baseUnit for unit in description.unitDefinitions}
    assert units["A"].A == 1
    volt = units["V"]
    assert (volt.kg, volt.m, volt.s, volt.A) == (1, 2, -3, -1)


def test_flight_has_the_bits_of_the_kernel(sim, fmu):
    """Speed, blade angle, torque and charge over a slam, and again from a serialised state."""
    time = 0.02 * np.arange(101)
    lever = np.where(time < 0.5, 0.5, 0.9)
    start = {"init.V": 20.0, "init.h": 100.0, "mode.engine": 0.0}
    inputs = xr.Dataset({"engine1.throttle": ("time", lever)}, {"time": time})
    flown = flightmech.simulate(sim, inputs, start, hold="zero")

    description = fmpy.read_model_description(fmu)
    reference = {v.name: v.valueReference for v in description.modelVariables}
    folder = fmpy.extract(fmu)
    slave = FMU2Slave(
        guid=description.guid,
        unzipDirectory=folder,
        modelIdentifier=description.coSimulation.modelIdentifier,
        instanceName="one",
    )
    slave.instantiate()
    slave.setupExperiment(startTime=0.0)
    slave.enterInitializationMode()
    for name, value in (start | {"engine1.throttle": 0.5}).items():
        set_value(slave, description, name, value)
    slave.exitInitializationMode()
    outputs = [reference[name] for name in NAMES]
    for k in range(1, 101):
        slave.setReal([reference["engine1.throttle"]], [lever[k - 1]])
        slave.doStep(time[k - 1], 0.02)
        if k == 40:
            stored = slave.serializeFMUState(state := slave.getFMUState())
            slave.freeFMUState(state)
    end = slave.getReal(outputs)
    np.testing.assert_allclose(end, [float(flown[name][-1]) for name in NAMES], rtol=1e-12)
    assert end[0] > float(flown["engine1.rpm"][0]) * 0.99
    state = slave.deserializeFMUState(stored)
    slave.setFMUState(state)
    slave.freeFMUState(state)
    for k in range(41, 101):
        slave.setReal([reference["engine1.throttle"]], [lever[k - 1]])
        slave.doStep(time[k - 1], 0.02)
    assert slave.getReal(outputs) == end
    slave.terminate()
    slave.freeInstance()


def set_value(slave: FMU2Slave, description, name: str, value: float) -> None:
    """Set a parameter of either type."""
    variable = next(v for v in description.modelVariables if v.name == name)
    if variable.type == "Integer":
        slave.setInteger([variable.valueReference], [int(value)])
    else:
        slave.setReal([variable.valueReference], [value])
