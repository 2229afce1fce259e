import numpy as np
import pytest

import flighttest
from flightmech.errors import SchemaError, UnknownName
from flighttest.records.readers.name_map import Channel, NameMap
from flighttest.records.readers.name_map_reading import read_names, shipped_maps


def mapped(tmp_path, text):
    (tmp_path / "names.toml").write_text(text)
    return tmp_path / "names.toml"


def test_polynomial_by_ascending_power():
    channel = Channel(column="x", unit="deg", polynomial=(-10.0, 0.5, 0.01), sign=-1)
    np.testing.assert_allclose(
        channel.convert(np.array([0.0, 10.0]), "V", "delta_e"), np.radians([10.0, 4.0])
    )
    assert channel.calibration("V") == "- polynomial [-10.0, 0.5, 0.01] of x [deg]"


def test_a_rotor_speed_in_hertz_counts_turns():
    channel = Channel(column="x", unit="Hz")
    found = channel.convert(np.array([40.0]), "rpm", "engine1.rpm")
    assert found == pytest.approx(80.0 * np.pi)


def test_table_is_linear_between_and_nothing_beyond(tmp_path):
    file = tmp_path / "f.csv"
    file.write_text(
        "time,pot\n"
        + "".join(f"{i / 10},{v}\n" for i, v in enumerate([100, 150, 200, 250, 300, 301, 99]))
    )
    names = mapped(
        tmp_path,
        '[c]\ndelta_e = { column = "pot", unit = "deg", table = [[300, 20], [100, -20], '
        "[200, 0]] }\n",
    )
    record = flighttest.read(file, names)
    np.testing.assert_allclose(
        np.degrees(record["c/delta_e"].values[:5]), [-20, -10, 0, 10, 20], atol=1e-12
    )
    assert np.isnan(record["c/delta_e"].values[5:]).all()
    rows = flighttest.signals.flags(record).set_index("kind")
    assert (rows.loc["outside", "start"], rows.loc["outside", "samples"]) == (0.5, 2)
    assert (
        "raw values beyond the calibration table, or infinite, now NaN: delta_e 2 from 0.5 s"
        in flighttest.records.faults(record)[0]
    )


def test_table_in_a_file_next_to_the_map(tmp_path):
    (tmp_path / "bench.csv").write_text("count,degrees\n# bench of Tuesday\n0,-10\n10,10\n")
    channel = read_names(
        mapped(tmp_path, '[c]\ndelta_e = { column = "pot", unit = "deg", table = "bench.csv" }\n')
    ).leaves["c"]["delta_e"]
    assert channel.table == ((0.0, -10.0), (10.0, 10.0))


def test_every_fault_of_calibrations_and_clocks_at_once(tmp_path):
    text = """
    [time]
    unit = "fortnight"
    [time.gps]
    wrap = "-1 s"
    offzet = 3
    [c]
    delta_e = { column = "a", polynomial = [1, 2] }
    delta_r = { column = "b", unit = "deg", polynomial = [1], table = [[0, 0], [1, 1]] }
    delta_f = { column = "c", unit = "deg", table = [[0, 0], [0, 1]] }
    V = { column = [], unit = "deg" }
    h = { column = "h", unit = "ft", table = "nowhere.csv" }
    [decode.x]
    kind = "can"
    [decode.adc]
    kind = "arinc429"
    channel = 1
    labels = "octal"
    [decode.adc.parameters]
    tas = { label = "290", code = "bnr", bits = 40, unit = "kt" }
    """
    with pytest.raises(SchemaError) as caught:
        read_names(mapped(tmp_path, text))
    found = "\n".join(caught.value.problems)
    for words in (
        "time.unit: unknown unit 'fortnight'",
        "time.gps.offzet: unknown key; near it: offset",
        "c.delta_e.unit: a calibration needs the unit",
        "c.delta_r.table: stands next to a polynomial",
        "c.delta_f.table: needs two rows",
        "c.V.unit: 'deg' cannot be converted to 'm s-1'",
        "c.V.column: an empty list",
        "c.h.table: ",
        "decode.x.kind: found 'can'; allowed: arinc429, mil1553, pcm, analog",
        "decode.adc.parameters.tas.label: found '290'",
        "decode.adc.parameters.tas.range: missing",
        "decode.adc.parameters.tas.bits: found 40; allowed 1 to 20",
    ):
        assert words in found


def test_first_column_of_a_list_that_is_there(tmp_path):
    file = tmp_path / "f.csv"
    file.write_text("time,new\n0,1\n1,2\n")
    record = flighttest.read(
        file, mapped(tmp_path, '[a]\np = { column = ["old", "new"], unit = "rad/s" }\n')
    )
    assert record["a/p"].attrs["calibration"] == "new [rad/s]"


def test_optional_channels_are_left_out_and_reported(tmp_path):
    file = tmp_path / "f.csv"
    file.write_text("time,p\n0,1\n1,2\n")
    names = mapped(
        tmp_path,
        'optional = true\n[a]\np = { column = "p", unit = "rad/s" }\nq = "pitch"\n[b]\nV = "tas"\n',
    )
    record = flighttest.read(file, names)
    assert list(record.children) == ["a"]
    assert record.attrs["absent"] == "pitch tas"


def test_nothing_of_the_map_in_the_file(tmp_path):
    file = tmp_path / "f.csv"
    file.write_text("time,p\n0,1\n1,2\n")
    with pytest.raises(SchemaError, match=r"nothing that it names is in f\.csv"):
        flighttest.read(file, "px4")


def test_extends_takes_a_shipped_map_and_goes_before_it(tmp_path):
    text = (
        'extends = "px4"\n[controls]\ndelta_e = { column = "actuator_servos/control[2]", unit '
        '= "deg", table = [[-1, 20], [1, -25]] }\n'
    )
    text += 'q = { column = "mine/q", unit = "deg/s" }\n'
    names = read_names(mapped(tmp_path, text))
    assert names.leaves["controls"]["q"].columns == ("mine/q",)
    assert "q" not in names.leaves["rates"]
    assert names.leaves["rates"]["p"].optional
    assert not names.leaves["controls"]["delta_e"].optional
    assert names.utc is not None


def test_maps_that_extend_each_other(tmp_path):
    (tmp_path / "a.toml").write_text('extends = "b.toml"\n')
    (tmp_path / "b.toml").write_text('extends = "a.toml"\n')
    with pytest.raises(SchemaError, match="extends this map in turn"):
        read_names(tmp_path / "a.toml")


def test_shipped_maps_are_valid():
    assert shipped_maps() == ["ardupilot", "px4"]
    assert all(isinstance(read_names(name), NameMap) for name in shipped_maps())


def test_unknown_shipped_map():
    with pytest.raises(UnknownName, match="unknown name map 'px5'; near it: px4"):
        read_names("px5")
