"""Real flights of the Citation II PH-LAB: reconstruction without ground velocity, modes, lift
slope, elevator trim slope.

The recordings may not be copied; they are read where they lie next to the repository.  Reference
values: the README of the data set, section "Reference results for the flights in this folder".
"""

from pathlib import Path

import numpy as np
import pandas as pd
import pytest

import flightmech
import flighttest
from flightmech.air import impact_pressure_at, mach_number
from flightmech.errors import SchemaError
from flightmech.units import DEGREE, FOOT, G0, KNOT, POUND
from flighttest.records.sensors.measurements import pressure
from pom.judging.measures.damped_sine import fit_mode

HERE = Path(__file__).parent
FLIGHTS = HERE.parents[1] / ".." / "shared" / "data" / "flight" / "citation_phlab"
pytestmark = pytest.mark.skipif(
    not FLIGHTS.is_dir(),
    reason="the Citation II flights (../shared/data/flight/citation_phlab) are not here",
)

FILES = {2018: "20180312_1", 2020: "20200310_2"}
PHUGOID = {2018: (42.2, 0.031), 2020: (47.9, 0.042)}  # period [s], damping ratio
DUTCH_ROLL = {2018: (3.10, 0.110), 2020: (3.06, 0.097)}
SPEED = {2018: (89.0, 98.0), 2020: (106.0, 114.0)}  # m/s, in phugoid and Dutch roll
LIFT_SLOPE = {
    "20180312_1": (4.585, 0.05),
    "20190305_2": (4.46, 0.06),
    "20200310_2": (4.44, 0.06),
}  # 1/rad, standard error
TRIM_SLOPE = {
    "20180312_1": (-0.480, 0.008),
    "20190305_2": (-0.534, 0.011),
    "20200310_2": (-0.445, 0.016),
}


@pytest.fixture(scope="module")
def aircraft():
    return flightmech.read_aircraft(HERE / "maps" / "citation.toml")


@pytest.fixture(scope="module", params=FILES)
def year(request):
    return request.param


@pytest.fixture(scope="module")
def record(year):
    return flighttest.read(
        FLIGHTS / f"flight_{FILES[year]}.csv.gz", HERE / "maps" / f"citation_{year}.toml"
    )


def start(year, motion):
    return float(
        pd.read_csv(FLIGHTS / f"manoeuvres_{FILES[year]}.csv")
        .set_index("motion")
        .loc[motion, "t_start_s"]
    )


def part(path, begin, end):
    time = path.states["time"].values - path.states["time"].values[0]
    return path.states.isel(time=(time >= begin) & (time <= end))


@pytest.fixture(scope="module")
def phugoid(record, aircraft, year):
    t = start(year, "phugoid")
    return flighttest.reconstruct(record, aircraft, windows=[(t, t + 160.0)], rate=10.0)


@pytest.fixture(scope="module")
def dutch_roll(record, aircraft, year):
    t = start(year, "dutch_roll")
    return flighttest.reconstruct(record, aircraft, windows=[(t, t + 30.0)], rate=10.0)


def test_clock_of_the_recorder_is_sound(record):
    assert flighttest.records.faults(record) == []
    assert record["ahrs"].attrs["rate"] == pytest.approx(10.0, rel=1e-6)


def test_load_factor_is_one_at_rest_and_forward_force_is_the_pitch(record):
    parked = record["ahrs"].to_dataset().isel(time=slice(0, 200))
    assert float(parked["az_imu"].mean()) == pytest.approx(
        -G0, abs=0.05
    )  # 0.005 g, as the README states of the offsets
    assert float(parked["ax_imu"].mean()) == pytest.approx(
        G0 * np.sin(float(parked["theta"].mean())), abs=0.05
    )


def test_phugoid(phugoid, year):
    free = part(phugoid, 20.0, 150.0)  # the elevator is still from about 14 s on
    mode = fit_mode(free["time"].values, free["V"].values)
    period, damping = PHUGOID[year]
    # period: 2.5 % (the reference of 2020 is from another window); damping: 0.005, its printed
    # figure has two digits
    assert mode.period == pytest.approx(period, rel=0.025)
    assert mode.damping_ratio == pytest.approx(damping, abs=0.005)
    assert float(free["V"].mean()) == pytest.approx(SPEED[year][0], rel=0.03)


def test_dutch_roll(dutch_roll, year):
    free = part(dutch_roll, 4.0, 16.0)
    period, damping = DUTCH_ROLL[year]
    for name in ("r", "beta"):  # sideslip was not measured: it comes out of the side force
        mode = fit_mode(free["time"].values, free[name].values)
        assert mode.period == pytest.approx(period, rel=0.02)
        assert mode.damping_ratio == pytest.approx(
            damping, abs=0.02
        )  # the pedals of 2018 come to rest at 4 to 5 s
    assert float(free["V"].mean()) == pytest.approx(SPEED[year][1], rel=0.03)


@pytest.mark.slow
def test_modes_of_the_flight_without_accelerations():
    """2019: no path, but period and damping need none."""
    record = flighttest.read(
        FLIGHTS / "flight_20190305_2_partial.csv.gz", HERE / "maps" / "citation_2019.toml"
    )
    motions = pd.read_csv(FLIGHTS / "manoeuvres_20190305_2.csv").set_index("motion")["t_start_s"]
    slow = flighttest.cut(record, motions["phugoid"] + 20.0, motions["phugoid"] + 150.0, rate=10.0)
    mode = fit_mode(slow["time"].values, slow["V"].values)
    assert mode.period == pytest.approx(41.6, rel=0.025)
    assert mode.damping_ratio == pytest.approx(0.051, abs=0.01)
    fast = flighttest.cut(
        record, motions["dutch_roll"] + 4.0, motions["dutch_roll"] + 16.0, rate=10.0
    )
    mode = fit_mode(fast["time"].values, fast["r"].values)
    assert mode.period == pytest.approx(3.09, rel=0.02)
    assert mode.damping_ratio == pytest.approx(0.121, abs=0.02)


def test_vane_factor_of_the_phugoid(phugoid):
    # README: in level flight the vane shows 1.08 to 1.13 times theta - gamma; the alpha of a
    # phugoid hardly moves (stderr 0.05)
    factor = phugoid.biases.sel(parameter="factor.alpha_vane")
    assert abs(float(factor["estimate"]) - 1.105) < 2.0 * float(factor["stderr"])


def test_residuals_stay_inside_the_stated_noise(phugoid, dutch_roll):
    for path in (phugoid, dutch_roll):
        assert set(path.fit["verdict"]) == {"use"}


@pytest.mark.slow
def test_flight_without_accelerations_is_refused(aircraft, tmp_path):
    names = tmp_path / "names.toml"
    names.write_text('[ahrs]\np = "Ahrs1_bRollRate"\nphi = "Ahrs1_Roll"\ntheta = "Ahrs1_Pitch"\n')
    record = flighttest.read(FLIGHTS / "flight_20190305_2_partial.csv.gz", names)
    with pytest.raises(SchemaError, match="no channel ax_imu"):
        flighttest.reconstruct(record, aircraft)


def stationary(flight, series):
    """Return the stationary points of a series with gross mass and qbar."""
    points = pd.read_csv(FLIGHTS / f"stationary_{flight}.csv")
    loading = pd.read_csv(FLIGHTS / f"loading_{flight}.csv")["mass_kg"].astype(float).sum()
    points = points[points["series"] == series]
    p = pressure(points["hp_ft"].to_numpy() * FOOT)
    mach = mach_number(impact_pressure_at(points["ias_kt"].to_numpy() * KNOT), p)
    return points.assign(mass=loading - points["fuel_used_lb"] * POUND, qbar=0.7 * p * mach**2)


@pytest.mark.parametrize("flight", LIFT_SLOPE)
def test_lift_slope_from_stationary_points(flight, aircraft):
    points = stationary(flight, "clcd")
    CL = points["mass"] * G0 / (points["qbar"] * aircraft.S)
    slope = np.polyfit(points["alpha_deg"] * DEGREE, CL, 1)[0]
    reference, stderr = LIFT_SLOPE[flight]
    assert slope == pytest.approx(reference, abs=2.0 * stderr)


@pytest.mark.parametrize("flight", TRIM_SLOPE)
def test_elevator_trim_slope(flight):
    points = stationary(flight, "trim")
    slope = np.polyfit(points["alpha_deg"], points["delta_e_deg"], 1)[0]
    reference, stderr = TRIM_SLOPE[flight]
    assert slope == pytest.approx(reference, abs=2.0 * stderr)
