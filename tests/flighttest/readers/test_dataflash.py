import sys
from pathlib import Path

import numpy as np
import pytest

sys.path.insert(0, str(Path(__file__).parents[1]))
from recorders import dataflash

import flighttest
from flightmech.errors import ParseError

UNITS = {
    "s": "s",
    "d": "deg",
    "h": "degheading",
    "E": "rad/s",
    "o": "m/s/s",
    "#": "instance",
    "P": "Pa",
    "D": "deglatitude",
    "m": "m",
}
COUNT = 300


def stamps(step=20_000):
    return [1_000_000 + step * i for i in range(COUNT)]


MESSAGES = {
    "ATT": ("QcccCf", "TimeUS,DesRoll,Roll,Pitch,Yaw,AEKF", "sdddh-", "FBBBB-",
            [(t, 0, 0.25 * i % 90, -0.5, 359.99, 0.1) for i, t in enumerate(stamps())]),
    "IMU": ("QBffffff", "TimeUS,I,GyrX,GyrY,GyrZ,AccX,AccY,AccZ", "s#EEEooo", "F-000000",
            [(t, k, 0.01 * i, 0.0, 0.0, 0.0, 0.0, -9.5 - k) for i,
                t in enumerate(stamps()) for k in (0, 1)]),
    "BARO": ("QfffH", "TimeUS,Alt,Press,Temp,Raw", "smPO-", "F00-C",
        [(t, 100.0 + i, 95000.0, 40.0, 1234) for i, t in enumerate(stamps())]),
    "GPS": ("QLLf", "TimeUS,Lat,Lng,Alt", "sDDm", "FGG0",
        [(t, 48.1, -11.5, 500.0) for t in stamps()[::10]]),
    "RCOU": ("QHH", "TimeUS,C1,C2", "sYY", "F--",
        [(t, 1500, 1100 + i) for i, t in enumerate(stamps())]),
    "MSG": ("QZ", "TimeUS,Message", "s-", "F-", [(1_000_000, b"ArduPlane V4.5")]),
}  # fmt: skip


@pytest.fixture
def log(tmp_path):
    (tmp_path / "00000012.bin").write_bytes(dataflash.written(MESSAGES, UNITS))
    return tmp_path / "00000012.bin"


def test_shipped_map_extended_by_the_bench(log, tmp_path):
    table = "[[1100, 22.5], [1500, 0.4], [1900, -21.0]]"
    (tmp_path / "mine.toml").write_text(
        f'extends = "ardupilot"\n[controls]\ndelta_e = {{ column = "RCOU/C2", unit = "deg", '
        f"table = {table} }}\n"
    )
    record = flighttest.read(log, tmp_path / "mine.toml")
    index = np.arange(COUNT)
    np.testing.assert_allclose(
        np.degrees(record["attitude/phi"].values), 0.25 * index % 90, atol=1e-9
    )
    np.testing.assert_allclose(np.degrees(record["attitude/psi"].values), 359.99, atol=1e-9)
    np.testing.assert_allclose(record["imu/p"].values, 0.01 * index, rtol=1e-6)
    np.testing.assert_allclose(record["imu/az_imu"].values, -9.5)
    np.testing.assert_allclose(record["air_data/h_baro"].values, 100.0 + index)
    np.testing.assert_allclose(np.degrees(record["gps/lon"].values), -11.5, atol=1e-9)
    np.testing.assert_allclose(record["imu/time"].values, 1.0 + 0.02 * index)
    np.testing.assert_allclose(
        np.degrees(record["controls/delta_e"].values[[0, -1]]), [22.5, 22.5 - 299 / 400 * 22.1]
    )
    assert record["gps"].attrs["rate"] == pytest.approx(5.0)


def test_units_multipliers_and_instances_of_the_log(log):
    tables = {
        table["table"]: {c["column"]: c for c in table["columns"]}
        for table in flighttest.records.contents(log)["tables"]
    }
    assert tables["ATT"]["Yaw"]["unit"] == "deg"
    assert tables["IMU.1"]["AccZ"]["unit"] == "m/s2"
    assert tables["IMU.1"]["AccZ"]["max"] == pytest.approx(-10.5)
    assert tables["BARO"]["Raw"]["max"] == pytest.approx(1.234)  # multiplier C: 1e-3
    assert tables["GPS"]["Lat"]["max"] == pytest.approx(48.1)
    assert "Message" not in tables.get("MSG", {})  # a text is not a channel


def test_header_bytes_inside_a_message_are_no_message(tmp_path):
    trap = int.from_bytes(dataflash.head(140) + b"\0", "little")  # the header of ATT as a number
    rows = [(t, trap, i) for i, t in enumerate(stamps())]
    messages = {
        **MESSAGES,
        "TRAP": (
            "QBB".replace("BB", "de"),
            "TimeUS,Bits,I",
            "s--",
            "F--",
            [(t, 0.5, i) for i, t in enumerate(stamps())],
        ),
    }
    raw = bytearray(dataflash.written(messages, UNITS))
    place = 0
    while (place := raw.find(np.float64(0.5).tobytes(), place)) >= 0:
        raw[place : place + 4] = trap.to_bytes(4, "little")
        place += 8
    (tmp_path / "f.bin").write_bytes(raw)
    tables = {
        table["table"]: table["samples"]
        for table in flighttest.records.contents(tmp_path / "f.bin")["tables"]
    }
    assert tables["ATT"] == COUNT
    assert tables["TRAP"] == len(rows)


def test_damage_in_the_middle_is_skipped_and_reported(log):
    raw = bytearray(log.read_bytes())
    middle = len(raw) // 2
    raw[middle : middle + 500] = bytes(500)
    log.write_bytes(raw)
    record = flighttest.read(log, "ardupilot")
    assert COUNT - 10 < record["attitude"].sizes["time"] < COUNT
    assert (
        "bytes of the log fit no message and were skipped" in flighttest.records.faults(record)[0]
    )


def test_no_message_at_all(log):
    log.write_bytes(log.read_bytes()[:300])
    with pytest.raises(ParseError, match="no message with a clock"):
        flighttest.records.contents(log)
    log.write_bytes(dataflash.head(128) + bytes(20))
    with pytest.raises(ParseError, match="no message FMT"):
        flighttest.records.contents(log)


def test_texts_and_messages_without_a_clock_are_named(tmp_path):
    more = {
        "EV": ("QB", "TimeUS,Id", "s-", "F-", [(1_000_000, 10)]),
        "NOTE": ("QZf", "TimeUS,Text,Level", "s--", "F--", [(t, b"x", 1.0) for t in stamps()]),
        "OLD": ("fB", "Value,Id", "--", "--", [(1.0, 2)] * 5),
    }
    (tmp_path / "a.bin").write_bytes(dataflash.written({**MESSAGES, **more}, UNITS))
    found = {
        one["name"]: one["reason"]
        for one in flighttest.records.contents(tmp_path / "a.bin")["left_out"]
    }
    one = "1 sample; a clock needs two samples"
    assert found == {
        "MSG": one,
        "EV": one,
        "NOTE/Text": "text",
        "OLD": "5 messages without a time stamp",
    }


def test_bytes_behind_the_end_of_a_unit_label_are_no_part_of_it(log, tmp_path):
    """A fixed field of C holds anything behind its zero byte, and HDF5 refuses a text with one."""
    harmed = {**UNITS, "E": "rad/s\0s2", "o": "m/s/s\0", "P": "\0Pa"}
    log.write_bytes(dataflash.written(MESSAGES, harmed))
    tables = {}
    for table in flighttest.records.contents(log)["tables"]:
        tables[table["table"]] = {one["column"]: one["unit"] for one in table["columns"]}
    assert tables["IMU"]["GyrX"] == "rad/s"
    assert tables["IMU"]["AccZ"] == "m/s2"  # the label is looked up without the zero byte
    assert tables["BARO"]["Press"] == ""
    (tmp_path / "rates.toml").write_text('[imu]\np = "IMU/GyrX"\naz_imu = "IMU/AccZ"\n')
    record = flighttest.read(log, tmp_path / "rates.toml")
    flighttest.save_record(record, tmp_path / "rates.nc")
    kept = flighttest.read(tmp_path / "rates.nc")["imu"]
    np.testing.assert_allclose(kept["p"].values, 0.01 * np.arange(COUNT), rtol=1e-6)
    np.testing.assert_allclose(kept["az_imu"].values, -9.5)
