import sys
from pathlib import Path

import numpy as np
import pytest

sys.path.insert(0, str(Path(__file__).parents[1]))
from recorders import ulog

import flighttest
from flightmech.errors import ParseError, UnknownName
from flighttest.records.readers.formats.ulog import quaternion_to_euler

STEPS = np.arange(500)
STAMPS = (5_000_000 + 20_000 * STEPS).tolist()
ROLL, PITCH, YAW = 0.3 * np.sin(STEPS / 20), 0.1 + 0.05 * np.cos(STEPS / 30), 6.0 + 0.001 * STEPS


def quaternion(roll, pitch, yaw):
    """Scalar first, turns about z, y, x in this order."""
    (cr, sr), (cp, sp), (cy, sy) = ((np.cos(a / 2), np.sin(a / 2)) for a in (roll, pitch, yaw))
    return np.stack(
        [
            cr * cp * cy + sr * sp * sy,
            sr * cp * cy - cr * sp * sy,
            cr * sp * cy + sr * cp * sy,
            cr * cp * sy - sr * sp * cy,
        ],
        axis=-1,
    )


def topics(extra=()):
    attitude = [(t, *q) for t, q in zip(STAMPS, quaternion(ROLL, PITCH, YAW).tolist(), strict=True)]
    rates = [(t + 3, t - 100, 0.01 * i, 0.02 * i, -0.01 * i) for i, t in enumerate(STAMPS)]
    force = [(t + 3, 0.1, 0.2, -9.8) for t in STAMPS]
    servos = [(t + 5, 0.0, 0.0, np.sin(i / 10), *[0.0] * 5) for i, t in enumerate(STAMPS)]
    utc = 1_520_848_800_000_000
    gps = [
        (t, t - 5_000_000 + utc, 48.1, 11.5, 500.0 + i, 1.0, 2.0, -0.5)
        for i, t in enumerate(STAMPS[::10])
    ]
    found = {
        ("vehicle_attitude", 0): ([("uint64_t", "timestamp"), ("float[4]", "q")], attitude),
        ("vehicle_angular_velocity",
            0): ([("uint64_t", "timestamp"), ("uint64_t", "timestamp_sample"), ("float[3]", "xyz")],
                rates),
        ("vehicle_acceleration", 0): ([("uint64_t", "timestamp"), ("float[3]", "xyz")], force),
        ("actuator_servos", 0): ([("uint64_t", "timestamp"), ("float[8]", "control")], servos),
        ("vehicle_gps_position", 0): (
            [
                ("uint64_t", "timestamp"), ("uint64_t", "time_utc_usec"),
                ("double", "latitude_deg"), ("double", "longitude_deg"),
                ("double", "altitude_msl_m"), ("float", "vel_n_m_s"), ("float", "vel_e_m_s"),
                ("float", "vel_d_m_s"),
            ],
            gps,
        ),
        ("wind", 0): (
            [("uint64_t", "timestamp"), ("float", "windspeed_north"), ("float", "windspeed_east")],
            [(t, 3.0, -4.0) for t in STAMPS]
        ),
        ("differential_pressure",
            0): ([("uint64_t", "timestamp"), ("float", "differential_pressure_pa")],
                [(t, 100.0) for t in STAMPS]),
        ("differential_pressure",
            1): ([("uint64_t", "timestamp"), ("float", "differential_pressure_pa")],
                [(t, 101.0) for t in STAMPS]),
    }  # fmt: skip
    return {**found, **dict(extra)}


@pytest.fixture
def log(tmp_path):
    (tmp_path / "flight.ulg").write_bytes(ulog.written(topics(), dropouts=[(8_000_000, 120)]))
    return tmp_path / "flight.ulg"


OWN = """
extends = "px4"
[controls]
delta_e = { column = "actuator_servos/control[2]", unit = "deg", table = [[-1, 21.5], [0, 0.8], [1, -24.0]] }
"""


def test_fixed_wing_log_with_the_shipped_map_and_bench_table(log, tmp_path):
    (tmp_path / "mine.toml").write_text(OWN)
    record = flighttest.read(log, tmp_path / "mine.toml")
    attitude = record["attitude"].to_dataset()
    for name, true in (("phi", ROLL), ("theta", PITCH), ("psi", np.mod(YAW, 2 * np.pi))):
        np.testing.assert_allclose(attitude[name].values, true, atol=2e-6)  # single precision
    np.testing.assert_allclose(attitude["time"].values, np.array(STAMPS) * 1e-6)
    np.testing.assert_allclose(record["rates/q"].values, 0.02 * STEPS, rtol=1e-6)
    np.testing.assert_allclose(record["accelerations/az_imu"].values, -9.8, rtol=1e-6)
    np.testing.assert_allclose(record["estimator/wind_e"].values, -4.0)
    demand = np.sin(STEPS / 10)
    np.testing.assert_allclose(
        np.degrees(record["controls/delta_e"].values),
        np.interp(demand, [-1, 0, 1], [21.5, 0.8, -24.0]),
        atol=1e-5,
    )
    np.testing.assert_allclose(np.degrees(record["gps/lat"].values), 48.1)
    # the log's clock shows 5 s when UTC shows 10:00
    assert record.attrs["start"].startswith("2018-03-12T09:59:55")
    assert "logger dropped 120 ms at 8 s" in flighttest.records.faults(record)
    assert "airspeed_validated/calibrated_airspeed_m_s" in record.attrs["absent"]
    assert record.attrs["px4_sys_name"] == "PX4"


def test_time_of_the_measurement_as_clock(log, tmp_path):
    (tmp_path / "n.toml").write_text(
        '[time.vehicle_angular_velocity]\ncolumn = "timestamp_sample"\nunit = "us"\n'
        '[rates]\np = { column = "vehicle_angular_velocity/xyz[0]", unit = "rad/s" }\n'
    )
    record = flighttest.read(log, tmp_path / "n.toml")
    np.testing.assert_allclose(record["rates/time"].values, (np.array(STAMPS) - 100) * 1e-6)


def test_second_instance_of_a_topic(log, tmp_path):
    (tmp_path / "n.toml").write_text(
        '[a]\nq_c = { column = "differential_pressure.1/differential_pressure_pa", unit = "Pa" }\n'
    )
    np.testing.assert_allclose(flighttest.read(log, tmp_path / "n.toml")["a/q_c"].values, 101.0)


def test_unknown_topic_and_field_name_the_near_ones(log, tmp_path):
    (tmp_path / "n.toml").write_text(
        '[a]\np = { column = "vehicle_angular_velocity/xyz[3]", unit = "rad/s" }\n'
    )
    with pytest.raises(UnknownName, match=r"'xyz\[3\]'; near it: .*xyz\[0\]"):
        flighttest.read(log, tmp_path / "n.toml")


def test_contents_without_a_map(log):
    found = flighttest.records.contents(log)
    assert found["format"] == "PX4 ULog"
    tables = {table["table"]: table for table in found["tables"]}
    assert tables["vehicle_attitude"]["rate"] == pytest.approx(50.0)
    assert {column["column"] for column in tables["vehicle_attitude"]["columns"]} == {
        "q[0]",
        "q[1]",
        "q[2]",
        "q[3]",
        "roll",
        "pitch",
        "yaw",
    }
    assert "differential_pressure.1" in tables


def test_log_that_was_cut_off_gives_what_is_there(log):
    whole = log.read_bytes()
    log.write_bytes(whole[: len(whole) // 2 + 7])
    record = flighttest.read(log, "px4")
    assert 200 < record["attitude"].sizes["time"] < 300


def test_header_alone(log):
    log.write_bytes(log.read_bytes()[:16])
    with pytest.raises(ParseError, match=r"flight\.ulg"):
        flighttest.records.contents(log)


def test_euler_angles_of_known_turns():
    half = np.sqrt(0.5)
    np.testing.assert_allclose(
        np.array(quaternion_to_euler([half], [half], [0.0], [0.0])).ravel(),
        [np.pi / 2, 0, 0],
        atol=1e-15,
    )
    np.testing.assert_allclose(
        np.array(quaternion_to_euler([half], [0.0], [0.0], [-half])).ravel(),
        [0, 0, 1.5 * np.pi],
        atol=1e-15,
    )


def test_topics_of_one_sample_are_left_out_and_named(tmp_path):
    once = {
        ("wind", 0): (
            [("uint64_t", "timestamp"), ("float", "windspeed_north"), ("float", "windspeed_east")],
            [(STAMPS[0], 3.0, -4.0)],
        )
    }
    once[("vehicle_acceleration", 0)] = (
        [("uint64_t", "timestamp"), ("float[3]", "xyz")],
        [(STAMPS[3], 0.1, 0.2, -9.8)],
    )
    (tmp_path / "flight.ulg").write_bytes(ulog.written(topics(once)))
    (tmp_path / "mine.toml").write_text(
        OWN + '[wind]\nax_imu = { column = "vehicle_acceleration/xyz[0]", unit = "m/s2" }\n'
    )
    record = flighttest.read(tmp_path / "flight.ulg", tmp_path / "mine.toml")
    assert flighttest.records.record.find_channel_leaf(record, "p")
    assert (
        "vehicle_acceleration (1 sample; a clock needs two samples): left out, and with it ay_imu"
        in record.attrs["notes"]
    )
    found = flighttest.records.contents(tmp_path / "flight.ulg")
    assert {one["name"] for one in found["left_out"]} == {"wind", "vehicle_acceleration"}
    assert not any(table["clock_fault"] for table in found["tables"])
