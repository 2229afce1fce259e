"""Drives that the engines of an aircraft take: the rule of Python, and the check of the kernel."""

import numpy as np
import pytest
import xarray as xr

import flightmech
from flightmech.aircraft.aircraft_file import read_engines
from flightmech.aircraft.engine import engine_drives
from flightmech.errors import SchemaError, SimulationError
from flightmech.simulation.run import initialise_run
from flightmech.steady_flight.trim_kinds import DRIVES
from flightmech.terms import make_term

HEAD = """
name = "a"
S = 16.2
cbar = 1.5
b = 11.0
mass = 1000.0
Ixx = 1300.0
Iyy = 1800.0
Izz = 2700.0
"""
BARE = "[[engine]]\nposition = [1.8, 0.0, 0.0]\n"
TABLE = BARE + "thrust = { throttle = [0.0, 1.0], value = [100.0, 2000.0] }\n"
DECK = """[engine.deck.tables]
n2_command = { throttle = [0.0, 1.0], value = [0.6, 1.0] }
n2_up_time = 0.4
n2_down_time = 0.4
fuel_flow = 0.01
thrust = { n2 = [0.5, 1.0], value = [100.0, 900.0] }
"""
SPOOL = """[engine.deck.tables]
n1_command = { throttle = [0.0, 1.0], value = [0.6, 1.0] }
n1_up_time = 0.4
n1_down_time = 0.4
fuel_flow = 0.01
thrust = { n1 = [0.5, 1.0], value = [100.0, 900.0] }
"""
PROPELLER = """[engine.propeller]
diameter = 1.9
inertia = 2.26
rpm_high = "2700 rpm"
tables.CT_prop = { J = [0.0, 0.6, 1.2], value = [0.1, 0.05, -0.02] }
tables.CP_prop = { J = [0.0, 0.6, 1.2], value = [0.06, 0.045, -0.01] }
"""
PISTON = """[engine.piston]
intake_impedance = "0.0002 s"
throttle_impedance = "0.02 s"
tables.bsfc = 8e-8
[engine.piston.tables.corrected_power]
manifold_pressure = ["15 inHg", "28 inHg"]
engine_rpm = ["2000 rpm", "2700 rpm"]
value = [["40 kW", "52 kW"], ["98 kW", "134 kW"]]
"""
MOTOR = """[engine.motor]
speed_constant = 20.0
motor_resistance = 0.03
capacity = 18000.0
tables.open_voltage = { charge = [0.0, 1.0], value = ["36 V", "50 V"] }
"""
SHAFT = 'tables.shaft_power = "80 kW"\n'
ENGINES = {
    "bare": BARE,
    "table": TABLE,
    "one table of two": TABLE + BARE,
    "deck": BARE + DECK,
    "fan": BARE + SPOOL,
    "piston": BARE + PROPELLER + PISTON,
    "motor": BARE + PROPELLER + MOTOR,
    "shaft power": BARE + PROPELLER + SHAFT,
}


@pytest.mark.parametrize("name", ENGINES)
def test_the_kernel_takes_exactly_these_drives(name, tmp_path):
    file = tmp_path / "aircraft.toml"
    file.write_text(HEAD + ENGINES[name])
    aircraft = flightmech.read_aircraft(file)
    leaves = {"/CL/alpha": make_term(5.0, regressors=["alpha"]), "/CD/basic": make_term(0.03)}
    sim = flightmech.compile(aircraft, xr.DataTree.from_dict(leaves))
    taken = set()
    for mode, drive in DRIVES.items():
        values = {"init.V": 50.0, "init.h": 1000.0, "mode.engine": mode}
        try:
            initialise_run(sim, values, np.zeros(len(sim.inputs)), 0.0)
        except SimulationError:
            continue
        if any(text.endswith(f".{drive}") for text in sim.inputs):
            taken.add(drive)
    assert engine_drives(aircraft.engines) == taken
    # The engines are read before mass and inertia are known.
    file.write_text(HEAD.replace("1000.0", '"?"') + ENGINES[name])
    assert engine_drives(read_engines(file)) == taken


def test_an_aircraft_without_engines_has_no_drive(tmp_path):
    file = tmp_path / "aircraft.toml"
    file.write_text(HEAD)
    assert engine_drives(read_engines(file)) == frozenset()
    file.write_text(HEAD + BARE.replace("1.8", '"?"'))
    with pytest.raises(SchemaError, match=r"position.0: not given yet"):
        read_engines(file)
