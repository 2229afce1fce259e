"""Data of the page of the records: channels at the resolution of a screen, marks, coverage."""

import json
import sys
import warnings
from pathlib import Path

import numpy as np
import pandas as pd
import pytest

sys.path.insert(0, str(Path(__file__).parent))
from bench import RECORD, small_project

import aerodb
import flighttest
from aeromatch.workbench import records
from aeromatch.workbench.opened import FACTOR, Levels, OpenProject, decimate_channels
from aeromatch.workflow.aerodynamics import a_priori
from flightmech.aircraft.writing import write_aircraft
from flightmech.errors import AeromatchWarning, SchemaError
from flightmech.steady_flight.trim_point import trimmed_at


@pytest.fixture(scope="module")
def opened(tmp_path_factory):
    folder = tmp_path_factory.mktemp("opened")
    return OpenProject(small_project(folder / "t37"), folder / "work")


def unpack(found):
    size = int.from_bytes(found[:4], "little")
    head, place, groups = json.loads(found[4 : 4 + size]), 4 + size, []
    assert place % 8 == 0
    for about in head:
        arrays = []
        for _ in range(1 + len(about["channels"])):
            arrays.append(np.frombuffer(found, "<f8", about["samples"], place))
            place += 8 * about["samples"]
        groups.append((about, arrays[0], dict(zip(about["channels"], arrays[1:], strict=True))))
    assert place == len(found)
    return groups


def test_levels_keep_every_extreme():
    """One spike in a million samples is on the screen at every zoom."""
    rng = np.random.default_rng(1)
    time, values = np.arange(1_000_003) / 100.0, rng.normal(size=1_000_003)
    values[777_777], values[123_456], values[500_000:500_100] = 50.0, -60.0, np.nan
    channel = {"x": Levels(values)}
    for start, stop in ((-np.inf, np.inf), (1000.0, 9000.0), (7777.0, 7778.5)):
        at, found = decimate_channels(time, channel, start, stop, 900)
        inside = values[(time >= start) & (time <= stop)]
        assert np.nanmax(found["x"]) == np.nanmax(inside)
        assert np.nanmin(found["x"]) == np.nanmin(inside)
        assert np.all(np.diff(at) >= 0.0)
        assert len(at) <= max(2 * 900 * FACTOR + 4, len(inside) + 2)
    at, found = decimate_channels(time, channel, 10.0, 11.0, 900)
    assert at[0] <= 10.0 <= 11.0 <= at[-1]
    np.testing.assert_array_equal(found["x"], values[np.searchsorted(time, at[0]) :][: len(at)])


@pytest.mark.parametrize("samples", [0, 1, 7, 8, 9, 64])
def test_levels_of_short_channels(samples):
    time = np.arange(float(samples))
    at, found = decimate_channels(time, {"x": Levels(time)}, 0.0, 100.0, 3)
    assert len(at) == len(found["x"])
    if samples:
        assert (found["x"].min(), found["x"].max()) == (0.0, samples - 1.0)


def test_channels_come_in_the_units_of_the_field(opened):
    query = {
        "name": RECORD,
        "channels": "record/imu/p,record/imu/q,record/air/V_cas",
        "start": "2",
        "stop": "6",
        "points": "4000",
    }
    about = records.show_record(opened, {"name": RECORD}, None)
    leaf = next(one["leaf"] for one in about["channels"] if one["channel"] == "V_cas")
    groups = unpack(
        records.pack_channels(
            opened, {**query, "channels": query["channels"].replace("air", leaf)}, None
        )
    )
    imu = opened.record(RECORD)["imu"].to_dataset()
    part = imu.sel(time=slice(2.0, 6.0))
    _, time, values = groups[0]
    inside = (time >= 2.0) & (time <= 6.0)
    np.testing.assert_array_equal(time[inside], part["time"].values)
    np.testing.assert_allclose(values["p"][inside], np.degrees(part["p"].values), rtol=1e-14)
    units = {one["channel"]: one["unit"] for one in about["channels"]}
    assert (units["p"], units["V_cas"]) == ("deg/s", "kt")


@pytest.mark.nightly
def test_marks_faults_and_coverage(opened):
    about = records.show_record(opened, {"name": RECORD}, None)
    assert about["manoeuvres"]["source"] == "record"
    own = flighttest.records.marked_manoeuvres(opened.record(RECORD))
    assert [row["start"] for row in about["manoeuvres"]["rows"]] == own["start"].tolist()
    assert records.list_check_findings(opened, {"name": RECORD}, None)["verdict"]
    found = records.list_test_points(opened, {"names": RECORD}, None)
    assert len(found["points"]) == len(own)
    assert found["units"]["alpha"] == "deg"
    alpha = opened.record(RECORD)
    leaf = next(node for node in alpha.children.values() if "alpha_vane" in node)
    first = leaf["alpha_vane"].sel(time=slice(own["start"][0], own["end"][0])).mean()
    point = found["points"][0]
    assert point["alpha"] == pytest.approx(np.degrees(float(first)), rel=1e-12)
    assert point["configuration"] == "clean"
    span = slice(own["start"][0], own["end"][0])
    air = (
        next(node for node in alpha.children.values() if "p_static" in node)
        .to_dataset()
        .sel(time=span)
        .mean()
    )
    assert point["mach"] == pytest.approx(
        np.sqrt(5.0 * ((1.0 + float(air["q_c"] / air["p_static"])) ** (2.0 / 7.0) - 1.0)), rel=1e-3
    )
    assert point["h"] == pytest.approx(float(air["h_baro"]) / 0.3048, rel=1e-12)


@pytest.mark.nightly
def test_one_g_lines_are_level_flight_of_the_database_in_the_units_of_the_field(opened):
    """At the Mach number of the first manoeuvre, steady flight, the line has the trim of DATCOM;
    the vane, with its upwash, is near it.
    """
    query = {"names": RECORD}
    assert records.list_one_g_lines(opened, query, None) == {
        "lines": [],
        "model": None,
        "remarks": [],
    }
    match = opened.work / "match"
    match.mkdir(parents=True)
    with warnings.catch_warnings():
        warnings.simplefilter(
            "ignore", AeromatchWarning
        )  # of the listing of the flaps; tests/aerodb has them
        aerodb.save(a_priori(opened.project, opened.aircraft), match / "datcom.nc")
    write_aircraft(opened.aircraft, match / "datcom.toml")
    found = records.list_one_g_lines(opened, query, None)
    (line,) = found["lines"]
    assert (found["model"], found["remarks"], line["configuration"]) == ("datcom", [], "clean")
    point = records.list_test_points(opened, query, None)["points"][0]
    alpha = float(np.interp(point["mach"], line["mach"], line["alpha"]))
    level = {
        "mach": point["mach"],
        "h": point["h"] * 0.3048,
        "mass": line["mass"],
        "mode.engine": 2.0,
    }
    trimmed = trimmed_at(opened.aircraft, aerodb.open(match / "datcom.nc"), level)
    assert alpha == pytest.approx(np.degrees(trimmed["alpha"]), abs=0.05)
    assert alpha == pytest.approx(point["alpha"], abs=1.2)
    assert np.interp(point["mach"], line["mach"], line["V_cas"]) == pytest.approx(
        point["V_cas"], rel=0.01
    )
    assert line["mass"] == pytest.approx(2100.0, abs=100.0)


def test_what_a_mark_covers_is_not_proposed(opened):
    """Of the movements found, those with a mark over more than half of them are left out, whatever
    its name.
    """
    everything = records.not_marked(opened, RECORD, pd.DataFrame({"start": [], "end": []}))
    first = everything.iloc[0]
    middle = 0.5 * (first["start"] + first["end"])
    for end, left in ((middle + 0.1, len(everything) - 1), (middle - 0.1, len(everything))):
        assert (
            len(
                records.not_marked(
                    opened, RECORD, pd.DataFrame({"start": [first["start"] - 5.0], "end": [end]})
                )
            )
            == left
        )
    rows = records.show_record(opened, {"name": RECORD, "find": "1"}, None)["manoeuvres"]["rows"]
    assert [row["manoeuvre"] for row in rows if not row["found"]] == [
        "trim",
        "doublet",
    ]  # as the record marks them
    assert not any(
        row["found"]
        for row in records.show_record(opened, {"name": RECORD}, None)["manoeuvres"]["rows"]
    )


@pytest.mark.parametrize(
    ("remedy", "found"),
    [
        ('delta_r = "c r"   # in [controls] of the name map', [("controls.delta_r", '"c r"')]),
        (
            'p = { column = "p", delay = 0.05 }   # in [imu] of the name map, and the same '
            "delay for the other channels of that instrument",
            [("imu.p", '{ column = "p", delay = 0.05 }')],
        ),
        (
            'ax = "ay"   # in [imu] of the name map\n    ay = "ax"   # in [imu] of the name map',
            [("imu.ax", '"ay"'), ("imu.ay", '"ax"')],
        ),
        ("exchange the columns of ax and ay in the name map", []),
        ("delta_a = -1 * delta_a +0 on what it is made of: left and right", []),
        ('ax = "ay"   # in [imu] of the name map\n    fly again', []),
        ("", []),
    ],
)
def test_a_remedy_that_is_lines_of_the_name_map(remedy, found):
    assert [(one["key"], one["value"]) for one in records.parse_remedy(remedy)] == found


def test_files_are_read_once_until_they_change(opened, tmp_path):
    file, calls = tmp_path / "x", []
    file.write_text("1")
    make = lambda: calls.append(1) or file.read_text()  # noqa: E731
    assert [opened.kept(("x",), [file], make) for _ in range(3)] == ["1"] * 3
    assert len(calls) == 1
    file.write_text("22")
    assert opened.kept(("x",), [file], make) == "22"


def test_a_source_that_is_none(opened):
    with pytest.raises(SchemaError, match="record or path"):
        records.pack_channels(
            opened,
            {"name": RECORD, "channels": "x/imu/p", "start": "0", "stop": "1", "points": "9"},
            None,
        )
