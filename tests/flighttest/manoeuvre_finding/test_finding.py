"""Manoeuvres found in records without marks: own signals of every kind, the shipped T-37 records, a
real flight.
"""

import json
from pathlib import Path

import numpy as np
import pandas as pd
import pytest
import xarray as xr
from click.testing import CliRunner

import flighttest
from flightmech.errors import SchemaError, UnknownName
from flighttest.cli.group import flight
from flighttest.flight_programme.input_design import input_shapes as multisteps
from flighttest.flight_programme.manoeuvre_finding.finding import find_manoeuvres, named_by_response
from flighttest.records.files import save_record
from flighttest.records.manoeuvre_table import read_manoeuvres

DATA = Path(__file__).parents[3] / "data" / "t37"
CITATION = Path(__file__).parents[4] / "shared" / "data" / "flight" / "citation_phlab"
MAP = Path(__file__).parents[2] / "real" / "maps" / "citation_2018.toml"
DEGREE = np.pi / 180.0
RATE = 25.0
T = np.arange(0.0, 60.0, 1.0 / RATE)


def steps(levels, unit, start=20.0):
    """A control that takes each level for so many units."""
    x, at = np.zeros_like(T), start
    for level, length in levels:
        x[(at <= T) & (at + length * unit > T)] = level
        at += length * unit
    return x


def smoothed(x, seconds):
    width = round(seconds * RATE)
    return np.convolve(x, np.ones(width) / width, mode="same")


def record(seed=1, **channels):
    """A record in steady flight with noise, but for the channels given."""
    rng = np.random.default_rng(seed)
    units = {
        "V": "m s-1",
        "h_baro": "m",
        "az_imu": "m s-2",
        "ay_imu": "m s-2",
        "engine1.throttle": "1",
        "p": "rad s-1",
        "q": "rad s-1",
    }
    quiet = {"V": 80.0, "h_baro": 1500.0, "az_imu": -9.81, "ay_imu": 0.0, "engine1.throttle": 0.6}
    noise = {"V": 0.1, "h_baro": 0.3, "az_imu": 0.05, "ay_imu": 0.02, "engine1.throttle": 0.001}
    names = [
        "p",
        "q",
        "phi",
        "V",
        "h_baro",
        "az_imu",
        "ay_imu",
        "delta_e",
        "delta_a",
        "delta_r",
        "engine1.throttle",
    ]
    data = {}
    for name in names:
        x = (
            quiet.get(name, 0.0)
            + channels.get(name, 0.0)
            + noise.get(name, 5e-4) * rng.normal(size=len(T))
        )
        data[name] = "time", x, {"units": units.get(name, "rad")}
    leaf = xr.Dataset(data, {"time": ("time", T, {"units": "s"})}, {"rate": RATE})
    return xr.DataTree.from_dict({"/": xr.Dataset(attrs={"title": "run"}), "/all": leaf})


def found(**channels):
    table = find_manoeuvres(record(**channels))
    return [(row.manoeuvre, row.control) for row in table.itertuples()], table


def test_steady_flight_has_none():
    table = find_manoeuvres(record())
    assert table.columns.tolist() == ["manoeuvre", "control", "start", "end", "note", "confidence"]
    assert len(table) == 0


@pytest.mark.nightly
@pytest.mark.parametrize(
    ("surface", "control"), [("delta_e", "elevator"), ("delta_a", "aileron"), ("delta_r", "rudder")]
)
@pytest.mark.parametrize(
    ("kind", "levels"),
    [
        ("doublet", [(1, 1), (-1, 1)]),
        ("3211", [(1, 3), (-1, 2), (1, 1), (-1, 1)]),
        ("pulse", [(1, 2)]),
    ],
)
@pytest.mark.parametrize("unit", [0.6, 1.2])
def test_step_inputs_by_their_proportions(surface, control, kind, levels, unit):
    size = 3.0 * DEGREE
    x = smoothed(steps([(size * level, length) for level, length in levels], unit), 0.3)
    names, table = found(**{surface: x})
    assert names == [(kind, control)]
    last = 20.0 + unit * sum(length for _, length in levels)
    assert table["start"][0] == pytest.approx(19.5, abs=0.3)
    assert last + 7.0 < table["end"][0] <= last + 8.3
    assert table["confidence"][0] > 0.5


def test_the_free_response_ends_with_the_next_movement():
    x, y = (
        smoothed(steps([(3.0 * DEGREE, 1), (-3.0 * DEGREE, 1)], 1.0, start), 0.3)
        for start in (20.0, 26.0)
    )
    names, table = found(delta_e=x, delta_r=y)
    assert names == [("doublet", "elevator"), ("doublet", "rudder")]
    assert table["end"][0] == pytest.approx(26.0, abs=0.3)


def test_a_doublet_in_which_all_controls_move_is_unknown():
    x = smoothed(steps([(5.0 * DEGREE, 1), (-5.0 * DEGREE, 1)], 1.0), 0.3)
    names, table = found(delta_e=x, delta_a=x)
    assert set(names) == {("unknown", "elevator"), ("unknown", "aileron")}
    assert (table["confidence"] == 0.0).all()


def test_unequal_steps_are_unknown():
    names, _ = found(delta_e=smoothed(steps([(4.0 * DEGREE, 1), (-4.0 * DEGREE, 4)], 1.0), 0.3))
    assert names == [("unknown", "elevator")]


def test_a_sweep():
    sweep = multisteps.sweep("delta_e", 3.0 * DEGREE, (0.2, 1.5), 25.0, rate=RATE)
    x = np.zeros_like(T)
    values = sweep["delta_e"].values[: len(T) - 250]
    x[250 : 250 + len(values)] = values
    names, table = found(delta_e=x)
    assert names == [("sweep", "elevator")]
    assert 10.0 < table["start"][0] < table["end"][0] < 38.0


def test_a_multisine_moves_several_controls_over_the_same_time():
    inside = (T > 15.0) & (T < 45.0)
    waves = [
        sum(np.sin(2.0 * np.pi * k * (T - 15.0) / 15.0 + k * k) for k in harmonics)
        * inside
        * 1.5
        * DEGREE
        for harmonics in ((4, 7, 10), (5, 8, 11), (6, 9, 12))
    ]
    names, table = found(**dict(zip(("delta_e", "delta_a", "delta_r"), waves, strict=True)))
    assert names == [("multisine", "elevator aileron rudder")]
    # The confidence is the smallest common time of the first control with another one.
    assert table["confidence"].tolist() == [1.0]


def test_pull_up_push_down_by_the_load_factor():
    wave = np.where((T > 20.0) & (T < 32.0), np.sin(2.0 * np.pi * (T - 20.0) / 12.0), 0.0)
    assert found(az_imu=-0.4 * 9.81 * wave, delta_e=-2.0 * DEGREE * wave)[0] == [
        ("pull_up_push_down", "elevator")
    ]


def test_steady_sideslip():
    held = smoothed(steps([(8.0 * DEGREE, 8)], 1.0), 2.0)
    assert found(delta_r=held, delta_a=-0.3 * held, ay_imu=8.0 * held)[0] == [
        ("steady_sideslip", "rudder aileron")
    ]


def test_throttle_movements():
    chop = np.where(T > 20.0, -0.5, 0.0)
    assert found(**{"engine1.throttle": chop})[0] == [("throttle_chop", "throttle")]
    assert found(**{"engine1.throttle": -chop * 0.7})[0] == [("throttle_slam", "throttle")]
    assert found(**{"engine1.throttle": np.where(T > 26.0, 0.3, chop)})[0] == [
        ("throttle_chop_and_slam", "throttle")
    ]


def test_a_chop_to_which_the_aeroplane_responds_is_a_power_change():
    chop, slower = np.where(T > 20.0, -0.5, 0.0), np.interp(T, [20.0, 35.0], [0.0, -6.0])
    names, table = found(**{"engine1.throttle": chop, "V": slower, "h_baro": 10.0 * slower})
    assert names == [("power_change", "throttle")]
    assert table["end"][0] == pytest.approx(35.0, abs=0.3)
    kinds = {
        name
        for name, _ in found(
            **{
                "engine1.throttle": np.where(T > 26.0, 0.0, chop),
                "V": slower,
                "h_baro": 10.0 * slower,
            }
        )[0]
    }
    assert kinds == {"throttle_chop_and_slam"}  # power is constant for 6 s only


def pulse_and_speed(period, size):
    """A pulse of the elevator at 4 s, and the speed after it."""
    x = smoothed(steps([(3.0 * DEGREE, 2)], 1.0, 4.0), 0.3)
    return {
        "delta_e": x,
        "V": np.where(T > 6.0, size * np.sin(2.0 * np.pi * (T - 6.0) / period), 0.0),
    }


def test_a_pulse_and_a_period_of_free_motion_are_a_phugoid():
    names, table = found(**pulse_and_speed(35.0, 4.0))  # 80 m/s: pi sqrt(2) V / g is 36 s
    assert names == [("phugoid", "elevator")]
    assert table["end"][0] == pytest.approx(60.0, abs=0.1)
    assert found(**pulse_and_speed(35.0, 0.3))[0] == [
        ("pulse", "elevator")
    ]  # the speed does not oscillate
    held = pulse_and_speed(35.0, 4.0)
    held["delta_e"] = held["delta_e"] + np.interp(
        T, [15.0, 25.0], [0.0, 1.5 * DEGREE]
    )  # slowly, as a pilot who holds the height
    assert ("phugoid", "elevator") not in found(**held)[0]


def test_marks_of_pulses_are_named_by_the_motion_after_them():
    marks = pd.DataFrame(
        [("block", "elevator", 3.5, 60.0, ""), ("recover", "", 60.0, 60.0, "")],
        columns=["manoeuvre", "control", "start", "end", "note"],
    )
    assert named_by_response(record(**pulse_and_speed(35.0, 4.0)), marks)["manoeuvre"].tolist() == [
        "phugoid",
        "recover",
    ]
    assert named_by_response(record(**pulse_and_speed(35.0, 0.3)), marks)["manoeuvre"].tolist() == [
        "block",
        "recover",
    ]


def test_controls_at_rest_in_a_bank_are_a_spiral():
    bank = np.interp(T, [15.0, 18.0, 60.0], [0.0, 0.4, 0.7])
    assert found(phi=bank)[0] == [("spiral", "aileron")]
    assert (
        found(phi=bank, delta_r=np.where((T > 30.0) & (T < 45.0), 1.5 * DEGREE, 0.0))[0] == []
    )  # moved every 15 s


def test_changes_of_configuration():
    flaps, gear = (
        np.interp(T, [20.0, 25.0], [0.0, 20.0 * DEGREE]),
        np.interp(T, [40.0, 44.0], [1.0, 0.0]),
    )
    tree = record()
    leaf = tree["all"].to_dataset().assign(delta_f=("time", flaps), gear=("time", gear))
    table = find_manoeuvres(xr.DataTree.from_dict({"/": tree.to_dataset(), "/all": leaf}))
    assert list(zip(table["manoeuvre"], table["control"])) == [
        ("flaps_out", "flaps"),
        ("gear_in", "gear"),
    ]


def test_level_speed_changes_are_level():
    V = np.interp(T, [20.0, 40.0], [0.0, -20.0])
    assert found(V=V)[0] == [("level_deceleration", "throttle")]
    assert found(V=-V)[0] == [("level_acceleration", "throttle")]
    assert found(V=V, h_baro=-7.0 * V)[0] == []  # the energy goes into height


def test_a_record_without_controls():
    bare = record()
    names = ["delta_e", "delta_a", "delta_r", "engine1.throttle"]
    tree = xr.DataTree.from_dict({"/all": bare["all"].to_dataset().drop_vars(names)})
    with pytest.raises(
        SchemaError, match="no control channel; map at least one of delta_e, delta_a, delta_r"
    ):
        find_manoeuvres(tree)


@pytest.mark.slow
def test_the_programme_of_the_t37():
    flown = flighttest.read(DATA / "flight" / "t37_01_clean_low_speed_5kft.nc", DATA / "names.toml")
    table = find_manoeuvres(flown)
    for mark in flighttest.manoeuvres(flown).itertuples():
        if mark.manoeuvre in ("trim", "recover"):
            continue
        same = table[(table["manoeuvre"] == mark.manoeuvre) & (table["control"] == mark.control)]
        assert ((same["start"] < mark.end) & (mark.start < same["end"])).any(), mark


@pytest.mark.nightly
@pytest.mark.parametrize(
    ("flight_file", "map_file"),
    [
        ("20180312_1", "citation_2018"),
        ("20190305_2_partial", "citation_2019"),
        ("20200310_2", "citation_2020"),
    ],
)
def test_phugoid_and_spiral_of_real_flights(flight_file, map_file):
    if not CITATION.is_dir():
        pytest.skip("the Citation II flights (../shared/data/flight/citation_phlab) are not here")
    table = find_manoeuvres(
        flighttest.read(
            CITATION / f"flight_{flight_file}.csv.gz", MAP.with_name(f"{map_file}.toml")
        )
    )
    sheet = pd.read_csv(
        CITATION / f"manoeuvres_{flight_file.removesuffix('_partial')}.csv", index_col=0
    ).iloc[:, 0]
    for kind in ("phugoid", "spiral"):  # noted when the pilot begins to pull or to roll
        assert (abs(table["start"][table["manoeuvre"] == kind] - sheet[kind]) < 25.0).any(), kind
    assert (table["manoeuvre"] == "phugoid").sum() <= 2


@pytest.mark.nightly
def test_doublets_of_a_real_flight():
    if not CITATION.is_dir():
        pytest.skip("the Citation II flights (../shared/data/flight/citation_phlab) are not here")
    table = find_manoeuvres(flighttest.read(CITATION / "flight_20180312_1.csv.gz", MAP))
    rudder = table[table["control"] == "rudder"]
    for noted in (3717.0, 3767.0):  # Dutch roll without and with damper, by the sheet of the flight
        assert (abs(rudder["start"] - noted) < 5.0).any()
    assert "doublet" in set(rudder["manoeuvre"])


def call(*arguments):
    return CliRunner().invoke(flight, ["manoeuvres", *map(str, arguments)], catch_exceptions=False)


@pytest.mark.nightly
def test_the_verb_writes_a_table_and_a_figure_and_reads_them_back(tmp_path):
    x = smoothed(steps([(3.0 * DEGREE, 1), (-3.0 * DEGREE, 1)], 1.0), 0.3)
    save_record(record(delta_r=x), tmp_path / "run.nc")
    done = call(tmp_path / "run.nc", "-o", tmp_path / "m.csv", "--figure", tmp_path / "m.svg")
    assert done.exit_code == 0, done.output
    assert (
        "run: 1 manoeuvres, found in the movements of the controls; to be confirmed" in done.output
    )
    assert "1 doublet" in (tmp_path / "m.svg").read_text()
    assert read_manoeuvres(tmp_path / "m.csv")["run"]["manoeuvre"].tolist() == ["doublet"]
    (tmp_path / "m.csv").write_text("record,kind,control,start,end\nrun,3211,rudder,1,2\n")
    again = json.loads(call(tmp_path / "run.nc", "--table", tmp_path / "m.csv", "--json").output)
    assert [(row["manoeuvre"], row["start"]) for row in again["manoeuvres"]] == [("3211", 1.0)]
    (tmp_path / "m.csv").write_text("record,kind,control,start,end\nrun_2,3211,rudder,1,2\n")
    with pytest.raises(UnknownName, match=r"m\.csv has no row for it"):
        call(tmp_path / "run.nc", "--table", tmp_path / "m.csv")


@pytest.mark.slow
def test_marks_of_the_record_come_first():
    file = DATA / "flight" / "t37_23_val_power_chop.nc"
    assert "as the record marks them" in call(file, "--names", DATA / "names.toml").output
    assert "power_change" in call(file, "--names", DATA / "names.toml", "--find").output


@pytest.mark.slow
def test_pedals_show_the_doublet_that_a_yaw_damper_answers():
    doublet = smoothed(steps([(3.0 * DEGREE, 1), (-3.0 * DEGREE, 1)], 1.0), 0.3)
    late = np.clip(T - 20.0, 0.0, None)
    damper = 2.0 * DEGREE * np.sin(2.2 * late) * np.exp(-0.05 * late)
    kinds, table = found(delta_r=doublet + damper)
    assert ("doublet", "rudder") not in kinds
    assert "unknown" in table["manoeuvre"].tolist() or "sweep" in table["manoeuvre"].tolist()
    flown = record(delta_r=doublet + damper)
    leaf = flown["all"].to_dataset()
    leaf["pedal"] = "time", -0.4 * doublet, {"units": "m"}
    with_pedals = xr.DataTree.from_dict({"/": xr.Dataset(attrs=flown.attrs), "/all": leaf})
    (row,) = find_manoeuvres(with_pedals).itertuples()
    assert (row.manoeuvre, row.control) == ("doublet", "rudder")
    assert row.start == pytest.approx(19.5, abs=0.3)
    # pedals that rest, as with an autopilot, hide no movement of the surface
    leaf["pedal"] = "time", 1e-4 * np.sin(3.0 * T), {"units": "m"}
    resting = xr.DataTree.from_dict({"/": xr.Dataset(attrs=flown.attrs), "/all": leaf})
    assert find_manoeuvres(resting)["manoeuvre"].tolist() == table["manoeuvre"].tolist()
