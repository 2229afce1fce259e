"""The remedy of a mistake is a line of the name map: pasted in the place of the old one, it makes
the record right.
"""

import tomllib
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest

import flighttest
from flightmech.errors import SchemaError
from flighttest.reconstruction.quality.finding import add_delay_line, exchange_channels, map_entry
from flighttest.records.readers.channel_correction import correct_channel, line_of, recorder_units
from flighttest.records.readers.name_map import Channel
from flighttest.records.sensors.instruments import IMU as GYROS
from flighttest.records.sensors.instruments import instruments_of

IMU = {
    "position": [0.0, 0.0, 0.0],
    "noise": dict.fromkeys(GYROS, 1e-3),
    "bias_sigma": dict.fromkeys(GYROS, 1e-3),
}
HEAD = "time,aN [g],nose,oat,l,r,psi\n"
MAP = """
[imu]
az_imu = { column = "aN", unit = "g", sign = -1 }
theta = { column = "nose", unit = "deg", offset = "2 deg" }
psi = { column = "psi", unit = "rad" }
[air]
temperature = { column = "oat", unit = "K" }
[controls]
delta_a_left = { column = "l", unit = "deg", polynomial = [0.5, 2.0] }
delta_a_right = { column = "r", scale = "20 deg" }
"""


@pytest.fixture
def recording(tmp_path):
    time = np.arange(0.0, 4.0, 0.02)
    rows = np.stack(
        [
            time,
            0.05 * np.sin(time),
            3.0 + np.cos(time),
            12.0 + time,
            np.sin(time),
            0.1 * np.cos(time),
            time,
        ],
        axis=1,
    )
    (tmp_path / "flight.csv").write_text(
        HEAD + "\n".join(",".join(f"{x:.9g}" for x in row) for row in rows) + "\n"
    )
    (tmp_path / "names.toml").write_text(MAP)
    return tmp_path / "flight.csv", tmp_path / "names.toml"


def pasted(file: Path, remedy: str) -> None:
    """Put the lines of a remedy in the place of the lines of the same names."""
    names = {line.split("=")[0].strip(): line.strip() for line in remedy.splitlines()}
    kept = [names.get(line.split("=")[0].strip(), line) for line in file.read_text().splitlines()]
    file.write_text("\n".join(kept) + "\n")


def channel(recording, name):
    record = flighttest.read(*recording)
    return next(
        node.to_dataset()[name].values
        for node in record.children.values()
        if name in node.data_vars
    )


@pytest.mark.nightly
@pytest.mark.parametrize(
    ("name", "slope", "shift"),
    [
        ("az_imu", -1.0, 0.0),
        ("az_imu", 1.0, -9.80665),  # load factor minus one: the unit g stays
        ("theta", -1.0, 0.0),
        ("theta", 180.0 / np.pi, 0.0),
        ("temperature", 1.0, 273.15),
        ("delta_a_left", -1.0, 0.0),
        ("delta_a_right", -2.0, 0.0),
        ("delta_a", -1.0, 0.0),
    ],
)
def test_pasted_line_makes_the_channel_right(recording, name, slope, shift):
    before = channel(recording, name)
    pasted(recording[1], map_entry(flighttest.read(*recording), name, slope, shift))
    np.testing.assert_allclose(
        channel(recording, name), slope * before + shift, rtol=1e-9, atol=1e-9
    )


def test_pasted_line_keeps_what_stands_there(recording):
    remedy = map_entry(flighttest.read(*recording), "az_imu", 1.0, -9.80665)
    assert (
        remedy
        == 'az_imu = { column = "aN", unit = "g", sign = -1, offset = "-1 g" }   # in [imu] of '
        "the name map"
    )


def test_exchanged_channels_are_two_lines(recording):
    before = {name: channel(recording, name) for name in ("theta", "psi")}
    pasted(recording[1], exchange_channels(flighttest.read(*recording), "theta", "psi"))
    np.testing.assert_allclose(channel(recording, "theta"), before["psi"])
    np.testing.assert_allclose(channel(recording, "psi"), before["theta"])


@pytest.mark.parametrize(
    "name",
    [
        "p",
        "theta",
        "V",
        "h_baro",
        "az_imu",
        "p_static",
        "temperature",
        "engine1.n1",
        "engine1.thrust",
    ],
)
def test_every_pair_of_units_is_corrected_by_a_unit(name):
    """A channel that was taken for one unit and stands in another: the corrected line states it."""
    x = np.array([0.3, 1.7, -2.0])
    for wrong in recorder_units(name):
        for right in recorder_units(name):
            taken, true = (
                Channel(column="c", unit=unit).convert(x, None, name) for unit in (wrong, right)
            )
            slope, shift = np.polyfit(taken, true, 1)
            found = correct_channel(
                Channel(column="c", unit=wrong),
                name,
                None,
                float(slope),
                float(shift) if abs(shift) > 1e-6 else 0.0,
            )
            np.testing.assert_allclose(found.convert(x, None, name), true, rtol=1e-6, atol=1e-6)
            assert tomllib.loads(line_of(name, found))


def test_constant_channel_is_stated_in_the_map(recording):
    recording[1].write_text(MAP + '[constants]\ndelta_f = "20 deg"\n')
    np.testing.assert_allclose(channel(recording, "delta_f"), np.radians(20.0))
    recording[1].write_text(MAP + "[constants]\ntheta = 0.1\n")
    with pytest.raises(SchemaError, match=r"constants\.theta: a column shows it too"):
        flighttest.read(*recording)


def test_lag_and_delay_are_lines_too(recording):
    record = flighttest.read(*recording)
    assert add_delay_line(record, "theta", delay=0.12) == (
        'theta = { column = "nose", unit = "deg", offset = "2 deg", delay = 0.12 }   # in '
        "[imu] of the name map"
    )
    before = channel(recording, "delta_a_right")
    pasted(recording[1], add_delay_line(record, "delta_a_right", lag=-0.1))
    after = channel(recording, "delta_a_right")
    time = record["controls"]["time"].values
    true = (
        np.radians(20.0) * 0.1 * (np.cos(time) + 0.1 * np.sin(time)) / 1.01
    )  # of 0.1 cos t behind a lag of 0.1 s, once it has settled
    np.testing.assert_allclose(
        after[50:], true[50:], atol=2e-6
    )  # lines between samples: a twelfth of step^2 times curvature
    assert np.abs(after - before).max() > 1e-3
    assert add_delay_line(record, "delta_a", lag=-0.1) == ""


def test_instruments_of_the_name_map_go_before_those_of_the_aircraft(recording):
    aircraft = SimpleNamespace(name="a", instruments={"imu": IMU, "air": {"noise": {"q_c": 5.0}}})
    recording[1].write_text(
        MAP + '[instruments.air]\nnoise = { V = "1 kt" }\nfactor = { V = [1.0, 0.02] }\n'
    )
    record = flighttest.read(*recording)
    found = instruments_of(aircraft, record.attrs)
    assert found.name_of("q_c") is None
    assert found.noise("V") == pytest.approx(0.514444, rel=1e-5)
    assert found.of("V").factor["V"] == (1.0, 0.02)
    assert found.noise("p") == 1e-3
    recording[1].write_text(MAP + "[instruments.air]\nnoize = { V = 0.1 }\n")
    with pytest.raises(SchemaError, match=r"instruments\.air\.noize: unknown key; near it: noise"):
        flighttest.read(*recording)


def motion(folder, more=""):
    """Steady level flight with a little motion and no temperature; canonical names."""
    time = np.arange(0.0, 60.0, 0.02)
    rng = np.random.default_rng(3)
    columns = {
        "p": 0.0,
        "q": 0.0,
        "r": 0.0,
        "phi": 0.0,
        "theta": 0.05,
        "ax_imu": 0.49,
        "ay_imu": 0.0,
        "az_imu": -9.79,
        "V_cas": 80.0,
    }
    units = ["rad/s"] * 3 + ["rad"] * 2 + ["m/s2"] * 3 + ["m/s"]
    noise = {"rad/s": 1e-3, "rad": 1e-3, "m/s2": 0.02, "m/s": 0.1}
    values = [
        time,
        *(
            x + noise[unit] * rng.standard_normal(len(time))
            for x, unit in zip(columns.values(), units, strict=True)
        ),
    ]
    head = ",".join(
        [
            "time",
            *(f"{name} [{unit}]" for name, unit in zip(columns, units, strict=True)),
            "h_baro [m]",
        ]
    )
    rows = np.stack([*values, 1000.0 + 0.3 * rng.standard_normal(len(time))], axis=1)
    (folder / "level.csv").write_text(
        head + "\n" + "\n".join(",".join(f"{x:.6g}" for x in row) for row in rows) + "\n"
    )
    names = "\n".join(f'{name} = "{name}"' for name in [*columns, "h_baro"])
    (folder / "level.toml").write_text(f"[record]\n{more}\n[imu]\n{names}\n")
    return flighttest.read(folder / "level.csv", folder / "level.toml")


@pytest.mark.nightly
def test_no_record_is_sound_that_the_reconstruction_refuses(tmp_path):
    quality = flighttest.assess(motion(tmp_path))
    found = next(one for one in quality.findings if one.kind == "reconstruction")
    assert "no channel temperature" in found.text
    assert not quality.verdict.startswith("sound")
    stated = flighttest.assess(motion(tmp_path, 'temperature = "12 degC"'))
    assert stated.verdict.startswith("sound")


@pytest.mark.slow
def test_stamps_are_named_with_their_table(recording, tmp_path):
    original = flighttest.read(*recording)
    flighttest.records.save_record(original, tmp_path / "el.nc")
    for column in ("imu/time", "time"):
        (tmp_path / "el.toml").write_text(
            f'[time]\ncolumn = "{column}"\n[imu]\ntheta = "theta"\n[air]\ntemperature = '
            f'"temperature"\n'
        )
        record = flighttest.read(tmp_path / "el.nc", tmp_path / "el.toml")
        for leaf in ("imu", "air"):
            np.testing.assert_allclose(record[leaf]["time"].values, original[leaf]["time"].values)


@pytest.mark.slow
def test_a_converted_record_needs_no_map(recording, tmp_path):
    record = flighttest.read(*recording)
    assert flighttest.records.needs_names(recording[0])
    flighttest.records.save_record(record, tmp_path / "converted.nc")
    assert not flighttest.records.needs_names(tmp_path / "converted.nc")
