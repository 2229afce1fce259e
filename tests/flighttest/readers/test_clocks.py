import numpy as np
import pytest

import flighttest
from flightmech.errors import SchemaError
from flighttest.records.readers.clocks import Clocks, rising_clock
from flighttest.records.readers.name_map import Clock, NameMap
from flighttest.records.readers.recording import RecordedTable


def kinds(found):
    return [flag.kind for flag in found.flags]


@pytest.mark.parametrize(
    ("step", "scale", "period"),
    [(2**16 / 1000, 1e-3, 2**16), (0.02, 1.0, 60.0), (0.02, 1.0, 604800.0), (20000.0, 1e-6, 2**32)],
    ids=["16-bit milliseconds", "minute", "week of satellite time", "32-bit microseconds"],
)
def test_counters_that_wrap_are_unrolled(step, scale, period):
    true = period - 20 * step + step * np.arange(60)
    found = rising_clock(np.mod(true, period), Clock(), scale, "x")
    np.testing.assert_allclose(found.time, true * scale, rtol=1e-12)
    assert kinds(found) == ["wrap"]
    assert found.flags[0].note == f"period {period * scale:g} s"


def test_stated_period_of_a_counter():
    true = 990.0 + 0.5 * np.arange(60)
    found = rising_clock(np.mod(true, 1000.0), Clock(wrap=1000.0), 1.0, "x")
    np.testing.assert_allclose(found.time, true)


def test_stray_stamps_are_dropped_and_marked():
    time = 0.02 * np.arange(100)
    raw = time.copy()
    raw[[30, 60, 80]] = [1e6, -5.0, np.nan]
    found = rising_clock(raw, Clock(), 1.0, "x")
    np.testing.assert_array_equal(found.samples, np.delete(np.arange(100), [30, 60, 80]))
    np.testing.assert_array_equal(found.time, np.delete(time, [30, 60, 80]))
    assert kinds(found) == ["stray"]
    assert found.flags[0].samples == 3


def test_clock_set_back_is_refused_unless_the_map_allows_it():
    raw = np.concatenate([10.0 + 0.1 * np.arange(50), 2.0 + 0.1 * np.arange(50)])
    with pytest.raises(SchemaError, match=r"14\.9 s is followed by 2 s .*reset = true"):
        rising_clock(raw, Clock(), 1.0, "x")
    found = rising_clock(raw, Clock(reset=True), 1.0, "x")
    np.testing.assert_allclose(found.time, 10.0 + 0.1 * np.arange(100))
    assert (kinds(found), found.flags[0].note) == (["reset"], "by 12.9 s")


def test_stamps_too_coarse_for_their_samples():
    raw = np.floor(np.arange(500) / 50)
    with pytest.raises(
        SchemaError,
        match=r"490 of 500 stamps repeat.*50 samples to each: the clock is too coarse; give rate",
    ):
        rising_clock(raw, Clock(), 1.0, "x")
    found = rising_clock(raw, Clock(rate=50.0), 1.0, "x")
    np.testing.assert_allclose(found.time, np.arange(500) / 50)
    with pytest.raises(SchemaError, match="drift apart"):
        rising_clock(raw, Clock(rate=40.0), 1.0, "x")


def test_offset_and_drift():
    true = np.arange(0.0, 1000.0, 0.5)
    found = rising_clock(700.0 + true * (1 + 40e-6), Clock(drift=40e-6, offset=-700.0), 1.0, "x")
    np.testing.assert_allclose(found.time, true, atol=1e-9)


def test_tables_of_one_clock_have_one_drift():
    """A receiver that starts 60 s after the inertial unit, on the same clock, 1 % fast."""
    stamps = {"imu": np.arange(5.0, 105.0, 0.1), "gps": np.arange(65.0, 105.0, 0.2)}
    stamps |= {"boot": 1e9 + stamps["imu"], "own": stamps["gps"]}
    tables = {name: RecordedTable({}, time=time) for name, time in stamps.items()}
    names = NameMap({}, clock=Clock(drift=0.01), clocks={"own": Clock(drift=0.01)})
    clocks = Clocks(tables, names, "x")
    found = {name: clocks.table_clock(name, "x").time for name in tables}
    np.testing.assert_allclose(found["imu"], 5.0 + (stamps["imu"] - 5.0) / 1.01)
    np.testing.assert_allclose(found["gps"], 5.0 + (stamps["gps"] - 5.0) / 1.01)
    np.testing.assert_allclose(found["boot"][0], 1e9 + 5.0)
    np.testing.assert_allclose(found["own"][0], 65.0)


def test_flags_follow_the_drift_of_their_clock():
    raw = np.delete(0.1 * np.arange(1000), [500])
    raw[700] = np.nan
    (stray,) = rising_clock(raw, Clock(drift=0.01), 1.0, "x").flags
    assert stray.start == pytest.approx(70.2 / 1.01)


def test_gaps_are_marked_on_the_clock_of_the_record():
    raw = np.concatenate([np.arange(10), 20 + np.arange(10)]) * 0.1
    found = rising_clock(raw, Clock(offset=5.0), 1.0, "x")
    assert [(m.kind, m.start, m.stop) for m in found.flags] == [
        ("gap", pytest.approx(5.9), pytest.approx(7.0))
    ]


def test_clock_of_one_table(tmp_path):
    import xarray as xr

    a = xr.Dataset({"q": ("time", [1.0, 2.0, 3.0], {"units": "rad/s"})}, {"time": [0.0, 1.0, 2.0]})
    b = xr.Dataset(
        {"itow": ("n", [1000.0, 1200.0, 1400.0]), "V": ("n", [50.0, 51.0, 52.0], {"units": "kt"})}
    )
    xr.DataTree.from_dict({"/a": a, "/b": b}).to_netcdf(tmp_path / "f.nc", engine="h5netcdf")
    (tmp_path / "n.toml").write_text(
        '[time.b]\ncolumn = "itow"\nunit = "ms"\noffset = "-1 s"\n[imu]\nq = "a/q"\n[air]\nV '
        '= "b/V"\n'
    )
    record = flighttest.read(tmp_path / "f.nc", tmp_path / "n.toml")
    np.testing.assert_allclose(record["air/time"].values, [0.0, 0.2, 0.4])
    np.testing.assert_allclose(record["imu/time"].values, [0.0, 1.0, 2.0])
    assert record.attrs["unmapped"] == ""


def gps_file(tmp_path, drift, outliers=0):
    rng = np.random.default_rng(3)
    time = np.arange(0.0, 600.0, 0.2)
    utc = 1_520_848_800.25 + time / (1 + drift) + rng.normal(0, 2e-3, len(time))
    utc[:5] = 0.0
    utc[100 : 100 + outliers] += 3600.0
    text = "time,utc,alpha\n" + "".join(
        f"{t:.3f},{u:.6f},1\n" for t, u in zip(time, utc, strict=True)
    )
    (tmp_path / "f.csv").write_text(text)
    (tmp_path / "n.toml").write_text(
        '[utc]\ncolumn = "data/utc"\n[a]\nalpha = { column = "alpha", unit = "deg" }\n'
    )
    return flighttest.read(tmp_path / "f.csv", tmp_path / "n.toml")


def test_time_of_the_world_names_the_start_and_the_drift(tmp_path):
    record = gps_file(tmp_path, 35e-6, outliers=4)
    assert record.attrs["start"].startswith("2018-03-12T10:00:00.25")
    # 3000 stamps of 2 ms noise over 600 s: 2 ms / (173 s sqrt(3000)) = 2.1e-7; four sigma
    assert record.attrs["clock_drift"] == pytest.approx(35e-6, abs=8.5e-7)
    assert record.attrs["clock_drift_stderr"] == pytest.approx(2.1e-7, rel=0.1)
    assert record.attrs["clock_scatter"] == pytest.approx(2e-3, rel=0.1)
    assert record.attrs["unmapped"] == ""
    assert "4 stamps off the line were not used" in flighttest.records.faults(record)[0]


def test_satellite_time_is_ahead_of_utc(tmp_path):
    (tmp_path / "f.csv").write_text("time,gps,alpha\n0,1204880418,1\n1,1204880419,2\n")
    (tmp_path / "n.toml").write_text(
        '[utc]\ncolumn = "data/gps"\nepoch = "gps"\n[a]\nalpha = { column = "alpha", unit = '
        '"deg" }\n'
    )
    # 1204880418 s after 1980-01-06 is 2018-03-12T09:00:18, 18 leap seconds earlier in UTC
    assert (
        flighttest.read(tmp_path / "f.csv", tmp_path / "n.toml").attrs["start"]
        == "2018-03-12T09:00:00.000000Z"
    )


def test_records_of_two_recorders_on_one_clock(tmp_path):
    for name, start, column in (
        ("a", "2018-03-12T10:00:00Z", "alpha"),
        ("b", "2018-03-12T10:00:02.5Z", "beta"),
    ):
        (tmp_path / f"{name}.csv").write_text(f"time,{column}\n0,1\n1,2\n5,3\n6,3\n7,4\n")
        (tmp_path / f"{name}.toml").write_text(
            f'[record]\nstart = "{start}"\n[air]\n{column} = {{ column = "{column}", unit = '
            f'"deg" }}\n'
        )
    records = [
        flighttest.read(tmp_path / f"{name}.csv", tmp_path / f"{name}.toml") for name in "ab"
    ]
    both = flighttest.merge(records)
    assert list(both.children) == ["air", "air_2"]
    np.testing.assert_allclose(both["air_2/time"].values, [2.5, 3.5, 7.5, 8.5, 9.5])
    gaps = flighttest.signals.flags(both).query("kind == 'gap'").set_index("leaf")["start"]
    assert gaps.to_dict() == {"air": 1.0, "air_2": 3.5}
    shifted = flighttest.merge(records, offsets=[-1.0])
    np.testing.assert_allclose(shifted["air_2/time"].values[0], -1.0)
    with pytest.raises(SchemaError, match=r"alpha is in a\.csv and in a\.csv"):
        flighttest.merge([records[0], records[0]])


def test_records_without_a_start_need_offsets(tmp_path):
    (tmp_path / "a.csv").write_text("time [s],alpha [deg]\n0,1\n1,2\n")
    record = flighttest.read(tmp_path / "a.csv")
    with pytest.raises(SchemaError, match="start '' is not a date and time; pass offsets="):
        flighttest.merge([record, record])
