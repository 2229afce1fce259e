"""Flight modes in the logs of autopilots: PX4 and ArduPilot, on the clock of the record, as
manoeuvres of tables and projects.
"""

import json
import sys
from pathlib import Path

import numpy as np
import pytest
from click.testing import CliRunner

sys.path.insert(0, str(Path(__file__).parents[1]))
from recorders import dataflash, ulog

import flighttest
from flightmech.errors import SchemaError
from flighttest.cli.group import flight
from flighttest.records.files import save_record
from flighttest.records.manoeuvre_table import read_manoeuvres
from flighttest.records.readers.recording import ARDUPLANE, PX4, flight_mode_changes
from flighttest.records.record import flight_modes

STAMPS = [5_000_000 + 20_000 * i for i in range(500)]  # 5.00 to 14.98 s
SPANS = [
    ("stabilized", 5.0, 8.0),
    ("auto_mission", 8.0, 11.0),
    ("mode_9", 11.0, 12.5),
    ("stabilized", 12.5, 14.98),
]


def px4(
    path,
    modes_at=((1_000_000, 15), (6_000_000, 15), (8_000_000, 3), (11_000_000, 9), (12_500_000, 15)),
):
    topics = {
        ("vehicle_angular_velocity", 0): ([("uint64_t", "timestamp"), ("float[3]", "xyz")],
         [(t, 0.1, 0.2, 0.3) for t in STAMPS]),
        ("vehicle_status", 0): ([("uint64_t", "timestamp"), ("uint8_t", "nav_state")],
         list(modes_at)),
    }  # fmt: skip
    path.write_bytes(ulog.written(topics))
    return path


def ardupilot(path, vehicle=b"ArduPlane V4.5.1", form="QMBB", columns="TimeUS,Mode,ModeNum,Rsn"):
    messages = {
        "IMU": (
            "QBfff",
            "TimeUS,I,GyrX,GyrY,GyrZ",
            "s#EEE",
            "F-000",
            [(t, 0, 0.1, 0.2, 0.3) for t in STAMPS],
        ),
        "MODE": (
            form,
            columns,
            "s---",
            "F---",
            [(1_000_000, 5, 5, 1), (8_000_000, 8, 8, 2), (11_000_000, 99, 99, 2)],
        ),
        "MSG": (
            "QZ",
            "TimeUS,Message",
            "s-",
            "F-",
            [(900_000, b"Frame: Plane"), (1_000_000, vehicle)],
        ),
    }
    path.write_bytes(dataflash.written(messages, {"s": "s", "E": "rad/s", "#": "instance"}))
    return path


def spans(record):
    return [(row.manoeuvre, row.start, row.end) for row in flight_modes(record).itertuples()]


def test_modes_of_px4(tmp_path):
    record = flighttest.read(px4(tmp_path / "a.ulg"), "px4")
    assert [name for name, _, _ in spans(record)] == [name for name, _, _ in SPANS]
    np.testing.assert_allclose([span[1:] for span in spans(record)], [span[1:] for span in SPANS])
    assert (
        len(flighttest.records.marked_manoeuvres(record)) == 0
    )  # modes are not marks: the movements of the controls are still searched
    assert "vehicle_status" not in record.attrs["unmapped"]
    assert set(flight_modes(record)["note"]) == {"flight mode of the log"}


def test_modes_follow_the_clock_of_the_record(tmp_path):
    (tmp_path / "own.toml").write_text('extends = "px4"\n[time]\noffset = 100.0\ndrift = 0.01\n')
    record = flighttest.read(px4(tmp_path / "a.ulg"), tmp_path / "own.toml")
    time = record["rates/time"].values
    start, end = spans(record)[1][1:]
    np.testing.assert_allclose([start, end], [105.0 + 3.0 / 1.01, 105.0 + 6.0 / 1.01], atol=1e-6)
    assert time[0] < start < end < time[-1]


def test_modes_follow_the_clock_of_their_own_table(tmp_path):
    (tmp_path / "own.toml").write_text(
        'extends = "px4"\n[time.vehicle_status]\noffset = 0.5\ndrift = 0.01\n'
    )
    record = flighttest.read(px4(tmp_path / "a.ulg"), tmp_path / "own.toml")
    # The drift counts from the first stamp of the topic, at 1 s.
    start, end = spans(record)[1][1:]
    np.testing.assert_allclose([start, end], [1.5 + 7.0 / 1.01, 1.5 + 10.0 / 1.01], atol=1e-6)
    np.testing.assert_allclose(record["rates/time"].values[[0, -1]], [5.0, 14.98])


def test_modes_of_ardupilot_by_the_vehicle_that_the_log_states(tmp_path):
    record = flighttest.read(ardupilot(tmp_path / "a.bin"), "ardupilot")
    assert [name for name, _, _ in spans(record)] == ["fbwa", "autotune", "mode_99"]
    np.testing.assert_allclose(
        [span[1:] for span in spans(record)], [(5.0, 8.0), (8.0, 11.0), (11.0, 14.98)]
    )
    assert record.attrs["vehicle"] == "ArduPlane"
    other = flighttest.read(ardupilot(tmp_path / "b.bin", b"ArduCopter V4.5.1"), "ardupilot")
    assert [name for name, _, _ in spans(other)] == ["mode_5", "mode_8", "mode_99"]


def test_a_log_without_changes_of_mode(tmp_path):
    record = flighttest.read(px4(tmp_path / "a.ulg", ()), "px4")
    assert "modes" not in record.attrs
    assert len(flight_modes(record)) == 0


def test_numbers_without_a_name_keep_their_number():
    assert flight_mode_changes(np.array([2.0, 1.0, 3.0]), np.array([0, 0, 7]), PX4) == (
        (1.0, "manual"),
        (3.0, "mode_7"),
    )
    assert ARDUPLANE[5] == "fbwa"
    assert ARDUPLANE[17] == "qstabilize"
    assert PX4[14] == "offboard"
    assert PX4[17] == "auto_takeoff"


def call(*arguments):
    return CliRunner().invoke(flight, [*map(str, arguments)], catch_exceptions=False)


def test_the_verb_shows_modes_and_writes_them_as_a_table(tmp_path):
    log = px4(tmp_path / "a.ulg")
    done = call("manoeuvres", log, "--names", "px4", "--modes", "-o", tmp_path / "m.csv")
    assert "a: 4 manoeuvres, flight modes of the log" in done.output
    table = read_manoeuvres(tmp_path / "m.csv")["a"]
    assert list(zip(table["manoeuvre"], table["start"], table["end"], strict=True)) == [
        (n, pytest.approx(a), pytest.approx(b)) for n, a, b in SPANS
    ]
    with pytest.raises(SchemaError, match="exclude each other"):
        call("manoeuvres", log, "--names", "px4", "--modes", "--find")
    save_record(flighttest.read(log, "px4"), tmp_path / "a.nc")  # they stay with the record
    assert (
        json.loads(call("manoeuvres", tmp_path / "a.nc", "--modes", "--json").output)["manoeuvres"][
            1
        ]["manoeuvre"]
        == "auto_mission"
    )


def test_records_of_other_recorders_have_none(tmp_path):
    t37 = Path(__file__).parents[3] / "data" / "t37"
    record = t37 / "flight" / "t37_23_val_power_chop.nc"
    with pytest.raises(SchemaError, match="no flight modes; logs of PX4 and ArduPilot have them"):
        call("manoeuvres", record, "--names", t37 / "names.toml", "--modes")
