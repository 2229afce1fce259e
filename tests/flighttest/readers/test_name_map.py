import pytest

from flightmech.errors import ParseError, SchemaError, UnitError
from flighttest.records.readers.name_map import Channel
from flighttest.records.readers.name_map_reading import read_names


def written(tmp_path, text):
    file = tmp_path / "names.toml"
    file.write_text(text)
    return file


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
