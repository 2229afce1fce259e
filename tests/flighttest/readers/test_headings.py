"""Columns whose headings carry a unit in brackets, in every format, in name maps and as ``aeromatch
init`` drafts them.
"""

import time

import h5py
import numpy as np
import pytest

import flighttest
from aeromatch.drafting.name_map.columns import guess_quantity
from flightmech.errors import UnitError, UnknownName
from flightmech.units import known_unit
from flighttest.records.readers.channel_correction import recorder_units
from flighttest.records.readers.columns import (
    clear_unit,
    column_called,
    split_heading,
    split_headings,
    unit_of_column,
)
from flighttest.records.readers.recording import RecordedTable

T = np.arange(0.0, 2.0, 0.02)


@pytest.mark.parametrize(
    ("heading", "name", "unit"),
    [
        ("Roll Rate (deg/s)", "Roll Rate", "deg/s"),
        ("alpha [deg]", "alpha", "deg"),
        ("OAT(°C)", "OAT", "°C"),
        ("az [m/s^2]", "az", "m/s^2"),
        ("t [us]", "t", "us"),
        ("Elevator (left) [deg]", "Elevator (left)", "deg"),
        ("alpha [grad]", "alpha", "grad"),  # a canonical name: the unit is an error of its own
        ("Elevator (left)", "Elevator (left)", ""),
        ("Speed (IAS)", "Speed (IAS)", ""),
        ("xyz[0]", "xyz[0]", ""),
        ("xyz[1]", "xyz[1]", ""),
        ("throttle [1]", "throttle", "1"),
        ("throttle[1]", "throttle[1]", ""),
        ("plain", "plain", ""),
        ("Thrust, lbf", "Thrust", "lbf"),
        ("Doe, J", "Doe, J", ""),
        ("Elevator (deg TEU)", "Elevator TEU", "deg"),
        ("alpha_deg", "alpha_deg", ""),
        ("[deg]", "[deg]", ""),
    ],
)
def test_a_unit_in_brackets(heading, name, unit):
    assert split_heading(heading) == (name, unit)


def test_headings_that_would_share_a_name_keep_their_text():
    assert split_headings(["q [deg/s]", "q [rad/s]", "p [deg/s]"]) == (
        ["q [deg/s]", "q [rad/s]", "p"],
        {"p": "deg/s"},
    )


SPELT = {
    "°/s": "deg/s",
    "°C": "degC",
    "deg/sec": "deg/s",
    "m/s²": "m/s2",
    "ft/s^2": "ft/s2",
    "feet": "ft",
    "-": "1",
}


@pytest.mark.parametrize(("text", "unit"), SPELT.items())
def test_units_as_recorders_spell_them(text, unit):
    assert known_unit(text) == unit


def test_columns_are_found_with_and_without_brackets():
    table = RecordedTable(
        {"alpha": T, "rate [counts]": T, "v (a)": T, "v (b)": T, "xyz[0]": T}, {"alpha": "deg"}
    )
    assert column_called("alpha", table) == "alpha"
    assert column_called("alpha [deg]", table) == "alpha"
    assert column_called("alpha [rad]", table) is None
    assert column_called("rate", table) == "rate [counts]"
    assert column_called("v", table) is None
    assert column_called("xyz", table) is None


def csv(path, heads, *columns):
    rows = (",".join(f"{x:.6g}" for x in row) for row in zip(T, *columns, strict=True))
    path.write_text("\n".join([",".join(heads), *rows]), encoding="utf-8")
    return path


MAPS = (
    'q = "Roll Rate (deg/s)"',
    'q = "Roll Rate"',
    'q = "data/Roll Rate (deg/s)"',
    'q = { column = "Roll Rate (deg/s)", sign = 1 }',
)


@pytest.mark.parametrize("line", MAPS)
def test_a_name_map_takes_headings_as_they_stand(tmp_path, line):
    file = csv(
        tmp_path / "a.csv", ["Time (s)", "Roll Rate (deg/s)", "OAT (°C)"], 10.0 + T, 15.0 + 0.0 * T
    )
    (tmp_path / "n.toml").write_text(
        f'[time]\ncolumn = "Time (s)"\n[imu]\n{line}\ntemperature = "OAT (°C)"\n', encoding="utf-8"
    )
    record = flighttest.read(file, tmp_path / "n.toml")
    np.testing.assert_allclose(record["imu/q"].values, np.radians(10.0 + T), rtol=1e-5)
    np.testing.assert_allclose(record["imu/temperature"].values, 288.15)
    assert record.attrs["unmapped"] == ""


def test_canonical_names_with_units_need_no_map_in_any_format(tmp_path):
    with h5py.File(tmp_path / "a.h5", "w") as file:
        file["imu/time"], file["imu/q [deg s-1]"], file["imu/alpha_vane (deg)"] = (
            T,
            10.0 + T,
            3.0 + 0.0 * T,
        )
    record = flighttest.read(tmp_path / "a.h5")
    np.testing.assert_allclose(record["imu/q"].values, np.radians(10.0 + T))
    np.testing.assert_allclose(record["imu/alpha_vane"].values, np.radians(3.0))


def test_arrays_and_sides_in_brackets_are_names(tmp_path):
    file = csv(
        tmp_path / "a.csv",
        ["time", "xyz[0]", "xyz[1]", "Elevator (left)", "Elevator (right)"],
        T,
        T,
        T,
        T,
    )
    assert list(flighttest.records.contents(file,
        None)["tables"][0]["columns"][k]["column"] for k in range(1, 5)) == [
        "xyz[0]", "xyz[1]", "Elevator (left)", "Elevator (right)"
    ]  # fmt: skip


def test_a_unit_that_nothing_knows_is_named(tmp_path):
    with pytest.raises(UnitError, match="unknown unit 'grad'"):
        flighttest.read(csv(tmp_path / "a.csv", ["time", "alpha_vane [grad]"], T))
    (tmp_path / "n.toml").write_text('[a]\nq = "Pitch Rate (rad/s)"\n')
    with pytest.raises(UnknownName, match="Pitch Rate"):
        flighttest.read(
            csv(tmp_path / "b.csv", ["time", "Pitch Rate (deg/s)"], T), tmp_path / "n.toml"
        )


def test_drafted_names_of_headings_with_units():
    assert [
        guess_quantity(text).name for text in ("Roll Rate (deg/s)", "alpha [deg]", "Press Alt (ft)")
    ] == ["p", "alpha_vane", "h_baro"]
    assert guess_quantity("Roll Rate (deg/s)").unit == "deg/s"


ENDS = [  # heading, quantity of the map, its unit, and the unit that is certain without a map
    ("alpha_deg", "alpha_vane", "deg", "deg"),
    ("q_deg_s", "q", "deg/s", "deg/s"),
    ("ELEV_DEG_TEU", "delta_e", "deg", "deg"),
    ("Mass_lb", "mass", "lb", "lb"),
    ("Thrust_lb", "engine1.thrust", "lbf", "lb"),
    ("Thrust_kN", "engine1.thrust", "kN", ""),
    ("P_hPa", "p_static", "hPa", "hPa"),
    ("V_ms", "V", "m/s", ""),
    ("T_c", "temperature", "degC", ""),
    ("V_c", "V_cas", None, ""),
    ("P_in", "p_static", None, ""),
    ("flap_1", "delta_f", None, ""),
    ("az_m_s2", "az_imu", "m/s2", "m/s2"),
    ("XN_kN_M0.2", "engine1.thrust", None, ""),
    # a share of the travel is not an angle, a frequency is not a rate, degrees are not a share
    ("Elevator pct", "delta_e", None, "%"),
    ("throttle deg", "engine1.throttle", None, "deg"),
    ("Pitch Rate Hz", "q", None, "Hz"),
    ("Prop RPM", "engine1.rpm", "rpm", "rpm"),
    ("Pitch Rate RPM", "q", None, "rpm"),
]


@pytest.mark.parametrize(("heading", "name", "unit", "clear"), ENDS)
def test_a_unit_at_the_end_counts_where_it_fits_the_quantity(heading, name, unit, clear):
    assert unit_of_column(RecordedTable({heading: T}), heading, name) == unit
    assert clear_unit(heading) == clear


def test_units_of_recorders_are_those_of_the_quantity():
    assert recorder_units("beta") == ("rad", "deg")
    assert recorder_units("engine1.throttle") == ("1", "%")
    assert recorder_units("q") == ("rad/s", "deg/s")
    assert recorder_units("engine2.rpm") == ("rad/s", "rpm")


def test_the_unit_of_an_ending_converts_the_column(tmp_path):
    file = csv(
        tmp_path / "a.csv", ["time_ms", "q_deg_s", '"Thrust, kN"'], 10.0 + 0.0 * T, 2.0 + 0.0 * T
    )
    file.write_text(file.read_text().replace("time_ms", "time"))
    (tmp_path / "n.toml").write_text('[imu]\nq = "q_deg_s"\nengine1.thrust = "Thrust"\n')
    record = flighttest.read(file, tmp_path / "n.toml")
    np.testing.assert_allclose(record["imu/q"].values, np.radians(10.0))
    np.testing.assert_allclose(record["imu/engine1.thrust"].values, 2000.0)
    assert record["imu/q"].attrs["file_unit"] == "deg/s"


SENSES = {
    "ELEV_DEG_TEU": ("delta_e", -1), "Elevator TED (deg)": ("delta_e", 1),
    "RUD_TER": ("delta_r", -1), "rudder_deg_tel": ("delta_r", 1),
    "AIL_RWD_DEG": ("delta_a", -1), "Aileron LWD": ("delta_a", 1), "ROLL_LWD": ("phi", -1),
    "PITCH_NU_DEG": ("theta", 1),
    "Pitch ND": ("theta", -1), "L AIL TEU": ("delta_a_left", -1), "Flap TED": ("delta_f", 1),
    "Gear_Down": ("gear", 1),
}  # fmt: skip


@pytest.mark.parametrize("heading", SENSES)
def test_the_sense_of_a_heading(heading):
    found = guess_quantity(heading)
    assert (found.name, found.sign) == SENSES[heading]


def test_a_heading_without_end_takes_no_time():
    text = "speed " + "(" * 20_000
    begin = time.process_time()
    assert split_heading(text) == (text, "")
    table = RecordedTable({text: T})
    assert column_called("speed", table) is None
    assert time.process_time() - begin < 1.0
