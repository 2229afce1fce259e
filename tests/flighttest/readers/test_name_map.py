import copy
import pickle

import pytest
from pydantic import ValidationError

from flightmech.errors import ParseError, SchemaError, UnitError
from flighttest.records.readers.name_map import Channel
from flighttest.records.readers.name_map_reading import read_names


def written(tmp_path, text):
    file = tmp_path / "names.toml"
    file.write_text(text)
    return file


def test_a_channel_is_validated_changed_and_copied_and_is_immutable():
    channel = Channel(column=["a", "b"], delay="60 ms", scale=2)
    assert (channel.column, channel.delay, channel.scale) == (("a", "b"), 0.06, 2.0)
    assert channel == Channel(column=("a", "b"), delay=0.06, scale=2.0)
    assert channel.stated() == {"column": ("a", "b"), "delay": 0.06, "scale": 2.0}
    changed = channel.changed(lag="-50 ms")
    assert changed.stated() == {**channel.stated(), "lag": -0.05}
    assert changed.changed(lag=0.0) == channel
    assert hash(changed.changed(lag=0.0)) == hash(channel)
    assert pickle.loads(pickle.dumps(channel)) == copy.deepcopy(channel) == channel
    with pytest.raises(ValidationError, match="frozen"):
        channel.delay = 0.1
    with pytest.raises(ValidationError, match="unit 'm' cannot be converted to 's'"):
        channel.changed(delay="5 m")
    with pytest.raises(ValidationError, match="cuont"):
        Channel(column="a", cuont=5)


def test_errors_of_a_table_name_the_place_and_what_is_allowed(tmp_path):
    text = """
    [record]
    temperature = 50
    [imu]
    q = { colum = "x", sign = 2, delay = "5 m" }
    """
    with pytest.raises(SchemaError) as raised:
        read_names(written(tmp_path, text))
    assert raised.value.problems == [
        "record.temperature: input should be greater than 100; found 50",
        "imu.q.column: missing; give it",
        "imu.q.sign: input should be 1 or -1; found 2",
        "imu.q.delay: unit 'm' cannot be converted to 's'; give a unit of the same quantity; "
        "found '5 m'",
        "imu.q.colum: unknown key; near it: column",
    ]


@pytest.mark.parametrize("value", ["48", '"48 rad"', '"-91 deg"', "nan"])
def test_a_latitude_beyond_the_poles(tmp_path, value):
    with pytest.raises(SchemaError, match=r"record\.latitude: .*a latitude is from -90 to 90 deg"):
        read_names(written(tmp_path, f"[record]\nlatitude = {value}\n"))
    assert read_names(written(tmp_path, '[record]\nlatitude = "-90 deg"\n')).facts.latitude < -1.5


def test_reads_leaves_facts_and_clock(tmp_path):
    names = read_names(
        written(
            tmp_path,
            """
            [record]
            latitude = "45 deg"
            [time]
            column = "t"
            unit = "ms"
            [imu]
            q = "pitch_rate"
            az_imu = { column = "acc/nz", unit = "g", sign = -1 }
            [controls]
            engine1.throttle = "lever_left"
            delta_f = { column = "flap", scale = "40 deg" }
            """,
        )
    )
    assert list(names.leaves) == ["imu", "controls"]
    assert names.leaves["imu"]["az_imu"] == Channel(column="acc/nz", unit="g", sign=-1)
    assert names.leaves["controls"]["engine1.throttle"].column == "lever_left"
    assert names.facts.latitude == pytest.approx(0.7853981634)
    assert names.clock.unit == "ms"


def test_all_problems_at_once_with_near_names(tmp_path):
    text = """
    [imu]
    q = { column = "q", units = "deg/s" }
    alfa = "aoa"
    p = "first"
    r = 3
    [controls]
    delta_f = { column = "flap", scale = "40 kg" }
    [more]
    p = "second"
    """
    with pytest.raises(SchemaError) as caught:
        read_names(written(tmp_path, text))
    message = str(caught.value)
    assert len(caught.value.problems) == 5
    assert "imu.q.units: unknown key; near it: unit" in message
    assert "unknown quantity 'alfa'; near it: alpha" in message
    assert "imu.r: expected a column name" in message
    assert "controls.delta_f.scale" in message


def test_a_quantity_has_one_channel(tmp_path):
    with pytest.raises(SchemaError, match=r"b\.q: already in leaf a"):
        read_names(written(tmp_path, '[a]\nq = "x"\n[b]\nq = "y"\n'))


def test_not_toml(tmp_path):
    with pytest.raises(ParseError, match=r"names\.toml, line 1"):
        read_names(written(tmp_path, "[imu\n"))


@pytest.mark.parametrize(
    ("channel", "name", "raw", "expected"),
    [
        (Channel(column="x", unit="deg"), "theta", 180.0, 3.141592653589793),
        (Channel(column="x", scale="40 deg"), "delta_f", 0.5, 0.3490658503988659),
        (Channel(column="x", unit="g", sign=-1, offset="-1 g"), "az_imu", 0.0, -9.80665),
        (Channel(column="x", unit="degC"), "temperature", 15.0, 288.15),
        (Channel(column="x", unit="pct"), "engine1.n1", 85.0, 0.85),
        (Channel(column="x", unit="1", scale=2.0), "gear", 0.5, 1.0),
    ],
)
def test_conversion(channel, name, raw, expected):
    assert channel.convert(raw, None, name) == pytest.approx(expected, rel=1e-14)


def test_unit_of_another_quantity():
    with pytest.raises(UnitError, match="cannot be converted"):
        Channel(column="x", unit="kg").convert(1.0, None, "theta")


def test_column_without_a_unit():
    with pytest.raises(UnitError, match="give unit"):
        Channel(column="x").convert(1.0, None, "theta")


def test_calibration_is_described_in_words():
    assert (
        Channel(column="acc", unit="g", sign=-1, offset="-1 g").calibration(None)
        == "- acc [g] + -1 g"
    )


def test_names_of_parts_that_toml_splits_are_joined(tmp_path):
    """The keys without quotes are tables of tables in TOML, the quoted ones are names."""
    names = read_names(
        written(
            tmp_path,
            """
            [time]
            column = "t"
            unit = "s"

            [controls]
            gear = { column = "Gear", unit = "1" }
            device.ice.setting = { column = "Ice", unit = "1", optional = true }

            [fuel]
            tank.left.fuel = "Left"
            tank.right.fuel = { column = "Right", unit = "lb" }
            "tank.tip.fuel" = "Tip"
            transfer.tip.left.pump = { column = "Pump", unit = "1" }
            """,
        )
    )
    assert set(names.leaves["fuel"]) == {
        *("tank.left.fuel", "tank.right.fuel", "tank.tip.fuel", "transfer.tip.left.pump"),
    }
    assert names.leaves["fuel"]["tank.right.fuel"].unit == "lb"
    assert set(names.leaves["controls"]) == {"gear", "device.ice.setting"}
    text = '[time]\ncolumn = "t"\n[fuel]\ntank.left.fuel = "a"\n"tank.left.fuel" = "b"\n'
    with pytest.raises(SchemaError, match=r"tank\.left\.fuel"):
        read_names(written(tmp_path, text))
