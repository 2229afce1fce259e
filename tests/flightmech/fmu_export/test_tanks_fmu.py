"""An aircraft with a cross-feed and a transfer pump as an FMU: the bits of the kernel, a serialised state, the
names.
"""

from __future__ import annotations

import fmpy
import numpy as np
import pytest
import xarray as xr
from fmpy.fmi2 import FMU2Slave
from fmpy.validation import validate_fmu

import flightmech
from flightmech.aircraft import Engine, EngineDeck
from flightmech.aircraft.fuel import Fuel
from flightmech.aircraft.propulsion.fuel_transfer import Transfer
from flightmech.aircraft.propulsion.tank import Tank
from flightmech.fmu_export.fmu_file import write_fmu
from flightmech.terms import make_term

TANKS = (
    Tank((0.1, -2.0, 0.1), 100.0, name="left", content=60.0),
    Tank((0.1, 2.0, 0.1), 100.0, name="right", content=60.0),
)
OUTPUTS = (
    "tank.left.fuel",
    "tank.right.fuel",
    "fuel",
    "transfer.left.right.flow",
    "y_cg_b",
    "Ixx",
    "Ixy",
    "p",
    "phi",
)
START = {"init.V": 90.0, "init.h": 1500.0, "mode.engine": 0.0, "init.tank.left.fuel": 75.0}
TIME = 0.02 * np.arange(151)
OPEN = np.where(TIME < 1.0, 0.0, 1.0)
PUMP = OPEN
CUT = np.where(TIME < 2.0, 0.0, 1.0)


@pytest.fixture(scope="module")
def sim(plain, plain_aircraft) -> flightmech.SimModel:
    deck = EngineDeck(
        {
            "n2_command": make_term([0.5, 1.0], {"throttle": [0.0, 1.0]}),
            "n2_up_time": make_term(0.5),
            "thrust": make_term([0.0, 4000.0], {"n2": [0.5, 1.0]}),
            "fuel_flow": make_term(5.0),
        }
    )
    transfers = (Transfer("left", "right", rate=2.0, fill=100.0, band=5.0),)
    engines = (
        Engine((0.0, -0.5, 0.0), deck=deck, feed=("left",), crossfeed=("right",)),
        Engine((0.0, 0.5, 0.0), deck=deck, feed=("right",), crossfeed=("left",)),
    )
    return plain(
        plain_aircraft(engines=engines, fuel=Fuel(120.0, tanks=TANKS, transfers=transfers))
    )


@pytest.fixture(scope="module")
def fmu(sim, tmp_path_factory):
    path = tmp_path_factory.mktemp("fmu") / "tanks.fmu"
    write_fmu(sim, path, version="2.0")
    return path


@pytest.mark.slow
@pytest.mark.parametrize("version", ["2.0", "3.0"])
def test_names_of_tanks_are_those_of_fmi(sim, tmp_path, version):
    path = write_fmu(sim, tmp_path / "tanks.fmu", version=version) or tmp_path / "tanks.fmu"
    assert validate_fmu(tmp_path / "tanks.fmu") == []
    description = fmpy.read_model_description(path)
    variables = {variable.name: variable for variable in description.modelVariables}
    assert variables["crossfeed"].causality == "input"
    assert float(variables["tank.left.cutoff"].start) == 0.0
    assert variables["init.tank.left.fuel"].variability == "fixed"
    assert int(variables["feed.engine1.right"].start) == 2
    pump = variables["transfer.left.right.pump"]
    assert (pump.causality, float(pump.start)) == ("input", 0.0)
    assert variables["transfer.left.right.flow"].unit == "kg s-1"
    assert variables["state.tank.left.fuel"].unit == variables["tank.left.fuel"].unit == "kg"


def test_a_flight_with_the_crossfeed_has_the_bits_of_the_kernel(sim, fmu):
    """The valve opens and the pump runs after 1 s, the right tank is cut off after 2 s; again from
    a stored state.
    """
    channels = {
        "crossfeed": ("time", OPEN),
        "tank.right.cutoff": ("time", CUT),
        "transfer.left.right.pump": ("time", PUMP),
    }
    inputs = xr.Dataset(channels, {"time": TIME})
    flown = flightmech.simulate(sim, inputs, START, hold="zero")
    description = fmpy.read_model_description(fmu)
    reference = {v.name: v.valueReference for v in description.modelVariables}
    slave = FMU2Slave(
        guid=description.guid,
        unzipDirectory=fmpy.extract(fmu),
        modelIdentifier=description.coSimulation.modelIdentifier,
        instanceName="one",
    )
    slave.instantiate()
    slave.setupExperiment(startTime=0.0)
    slave.enterInitializationMode()
    for name, value in START.items():
        if name == "mode.engine":
            slave.setInteger([reference[name]], [int(value)])
        else:
            slave.setReal([reference[name]], [value])
    slave.exitInitializationMode()

    def fly(first: int, last: int) -> list[float]:
        for k in range(first, last):
            slave.setReal([reference[name] for name in channels], [OPEN[k], CUT[k], PUMP[k]])
            slave.doStep(TIME[k], 0.02)
        return slave.getReal([reference[name] for name in OUTPUTS])

    fly(0, 80)
    stored = slave.serializeFMUState(state := slave.getFMUState())
    slave.freeFMUState(state)
    end = fly(80, 150)
    np.testing.assert_allclose(end, [float(flown[name][-1]) for name in OUTPUTS], rtol=1e-12)
    # both tanks give 5 kg/s for two seconds, the left one alone gives 10 kg/s for one; the pump
    # moves 4 kg
    assert end[:3] == pytest.approx([51.0, 54.0, 105.0], abs=1e-9)
    state = slave.deserializeFMUState(stored)
    slave.setFMUState(state)
    slave.freeFMUState(state)
    assert fly(80, 150) == end
    slave.terminate()
    slave.freeInstance()
