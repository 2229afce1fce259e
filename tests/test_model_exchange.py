"""The aircraft that ship with aeromatch fly in model exchange at the tolerance of their FMUs, under
controls that move all the time.
"""

from pathlib import Path

import fmpy
import numpy as np
import pytest
from click.testing import CliRunner

import aerodb
import flightmech
from aerodb.cli.group import db

C182 = Path(__file__).parents[1] / "data" / "c182"
SECONDS = 5.0
STARTS = {
    "c182": {"init.V": 50.0, "init.h": 1500.0, "mode.trim": 1},
    "t37": {"init.V": 100.0, "init.h": 3000.0, "mode.trim": 1},
}


@pytest.fixture(scope="module")
def c182(tmp_path_factory):
    """Build the FMU of the C182 from its listings."""
    folder = tmp_path_factory.mktemp("c182")
    listings = [str(path) for path in sorted((C182 / "datcom").glob("*.out"))]
    command = ["build", str(C182 / "aircraft.toml"), *listings, "-o", str(folder / "c182.nc")]
    built = CliRunner().invoke(db, command)
    assert built.exit_code == 0, built.output
    aircraft = flightmech.read_aircraft(C182 / "aircraft.toml")
    model = flightmech.compile(aircraft, aerodb.open(folder / "c182.nc"))
    return fmpy.extract(str(flightmech.write_fmu(model, folder / "c182.fmu")), str(folder / "fmu"))


def fly(folder, name, control, signal, interval):
    """Return the flight under one moving control; FMPy holds it over each interval."""
    time = np.arange(0.0, SECONDS + 0.5 * interval, interval)
    rows = np.array(list(zip(time, signal(time), strict=True)), [("time", float), (control, float)])
    return fmpy.simulate_fmu(
        folder,
        fmi_type="ModelExchange",
        stop_time=SECONDS,
        output_interval=interval,
        start_values=STARTS[name],
        input=rows,
        output=["V", "q"],
    )


def sine(time):
    """Elevator of 0.1 rad at 0.5 Hz."""
    return 0.1 * np.sin(np.pi * time)


def steps(time):
    """Full steps to and fro at 2 Hz."""
    return 0.3 * np.sign(np.sin(4.0 * np.pi * time))


def fly_all(folder, name):
    """Fly every control in both ways, with the inputs held for 0.02 and 0.1 s."""
    for control in ("delta_e", "delta_a", "delta_r"):
        for signal in (sine, steps):
            for interval in (0.02, 0.1):
                found = fly(folder, name, control, signal, interval)
                assert found["time"][-1] == pytest.approx(SECONDS), (control, signal, interval)
                assert np.isfinite(found["V"]).all()


@pytest.mark.nightly  # 4 s
def test_c182_flies_under_moving_controls(c182):
    fly_all(c182, "c182")


@pytest.mark.nightly
def test_t37_flies_under_moving_controls(demo, tmp_path):
    folder, _ = demo
    # the FMU is written anew from the model of the demo, with the description of today
    aircraft = flightmech.read_aircraft(folder / "final.toml")
    model = flightmech.compile(aircraft, aerodb.open(folder / "final.nc"))
    flightmech.write_fmu(model, tmp_path / "t37.fmu")
    fly_all(fmpy.extract(str(tmp_path / "t37.fmu"), str(tmp_path / "fmu")), "t37")
