"""The shipped cases of the T-37: rows, records and windows fit together."""

from pathlib import Path

import numpy as np
import pytest
import xarray as xr

import flightmech
from pom.cases.case import read_case
from pom.judging.applicability import reason_not_judged
from pom.replaying.replay_case import replay

FOLDER = Path(__file__).parents[2] / "data" / "t37" / "cases"
ROWS = {
    "21_short_period": "2.c.10",
    "22_roll_response": "2.d.2",
    "23_power_chop": "2.c.1",
    "23_power_chop_lever": "2.c.1",
    "24_power_slam": "2.c.1",
    "25_normal_takeoff": "1.b.4",
    "26_phugoid": "2.c.9",
    "27_dutch_roll": "2.d.7",
    "28_spiral": "2.d.4",
    "29_flap_change": "2.c.2",
    "30_gear_change": "2.c.4",
    "31_landing": "2.e.1",
    "32_rudder_response": "2.d.6",
    "53_stick_free_short_period": "2.c.10",
    "54_roll_response_wheel": "2.d.2",
    "55_dutch_roll_pedals_free": "2.d.7",
    "56_stick_force_per_g": "2.c.6",
    "71_brake_stop": "1.b.7",
    "72_taxi_turn": "1.a.2",
}


FORCES = {
    "22_roll_response": "wheel_force",
    "25_normal_takeoff": "column_force",
    "31_landing": "column_force",
}
"""Cases without the pilot forces that their rows require, and the row."""


def test_every_validation_run_has_its_case():
    assert {file.stem for file in FOLDER.glob("*.toml")} == set(ROWS)
    assert len({read_case(file).name for file in FOLDER.glob("*.toml")}) == len(ROWS)


@pytest.mark.nightly
@pytest.mark.parametrize("stem", ROWS)
def test_case_is_sound_and_inside_its_record(stem):
    case = read_case(FOLDER / f"{stem}.toml")
    assert case.id == ROWS[stem]
    assert Path(case.record).stem[4:6] == stem[:2]
    judged = [c for c in case.criteria if c.applies]
    assert judged
    # the controls of the T-37 are reversible: where its surfaces drive, a row of forces is open
    open_rows = {c.name for c in judged if reason_not_judged(case, c)}
    assert open_rows == ({FORCES[stem]} if stem in FORCES else set())
    with xr.open_dataset(case.record, group="imu", engine="h5netcdf") as imu:
        assert imu["time"].values[0] <= case.window[0]
        assert imu["time"].values[-1] >= case.window[1]


@pytest.mark.slow
def test_a_recording_is_reconstructed_and_replayed(trainer, tmp_path):
    case = read_case(FOLDER / "32_rudder_response.toml")
    aircraft = flightmech.read_aircraft(case.aircraft)
    x, y, z = aircraft.reference
    db = trainer.database()
    db.attrs |= {
        "S": aircraft.S,
        "cbar": aircraft.cbar,
        "b": aircraft.b,
        "x_ref": x,
        "y_ref": y,
        "z_ref": z,
    }
    sim = flightmech.compile(aircraft, db)
    flightmech.write_fmu(sim, tmp_path / "trainer.fmu")
    result = replay(case, {"trainer": tmp_path / "trainer.fmu"})
    assert result.failure == ""
    assert np.isfinite(result.signals["r"].values).all()
    assert result.conditions["delta_f"] == pytest.approx(np.radians(40.0), abs=0.01)
    assert np.degrees(result.signals["r"].sel(run="flight").values).min() == pytest.approx(
        -3.9, abs=0.1
    )  # answer to the rudder
    # the wind of the reconstruction is an input, and the start of the model is that of the flight
    assert float(np.hypot(result.inputs["wind_n"], result.inputs["wind_e"]).mean()) > 1.0
    assert result.trim.loc["V", "trainer"] == pytest.approx(
        result.trim.loc["V", "flight"], rel=1e-9
    )
    assert result.trim.loc["h", "trainer"] == pytest.approx(
        result.trim.loc["h", "flight"], rel=1e-9
    )
    air = result.trim.loc["V_cas"]  # temperature and pressure of the day are met
    assert air["trainer"] == pytest.approx(air["flight"], rel=1e-5)
