"""Expressions of channels: what they compute, their units, and that a text cannot run code."""

import json
import sys
from pathlib import Path

import numpy as np
import pytest
import xarray as xr

sys.path.insert(0, str(Path(__file__).parent))
from bench import RECORD, small_project

from aeromatch.workbench.channels import signals, views
from aeromatch.workbench.channels.dimensions import Dimension, dimension_of_channel
from aeromatch.workbench.channels.expressions import ChannelExpression, stretches
from aeromatch.workbench.channels.signals import find_channel, interpolate, signal_of
from aeromatch.workbench.opened import OpenProject
from flightmech.errors import AeromatchError, ParseError, SchemaError, UnknownName

TIME = np.arange(0.0, 4.0, 0.02)
CHANNELS = {
    "q": 0.1 * np.sin(2.0 * TIME),
    "V": 80.0 + TIME,
    "az": np.full(len(TIME), -9.8),
    "alpha": 0.05 + 0.01 * TIME,
    "imu.q": np.full(len(TIME), 0.2),
}


def value(text):
    given = {}
    for name, values in CHANNELS.items():
        given[name] = values, dimension_of_channel(name.rpartition(".")[2])
    return ChannelExpression(text).evaluate(TIME, given)


@pytest.mark.parametrize(
    ("text", "expected", "unit"),
    [
        ("az + V*q", CHANNELS["az"] + CHANNELS["V"] * CHANNELS["q"], "m s-2"),
        ("V*q + az", CHANNELS["az"] + CHANNELS["V"] * CHANNELS["q"], "m s-2"),
        ("q - imu.q", CHANNELS["q"] - 0.2, "deg/s"),
        ("alpha - 2 deg", CHANNELS["alpha"] - np.radians(2.0), "deg"),
        ("alpha - 2 degrees", CHANNELS["alpha"] - np.radians(2.0), "deg"),
        ("q - 5 dps", CHANNELS["q"] - np.radians(5.0), "deg/s"),
        ("q - 6 rpm", CHANNELS["q"] - 0.2 * np.pi, "deg/s"),
        ("sqrt(q**2 + imu.q**2)", np.hypot(CHANNELS["q"], 0.2), "deg/s"),
        ("-V^2/2", -(CHANNELS["V"] ** 2) / 2.0, "m2 s-2"),
        ("1 / V", 1.0 / CHANNELS["V"], "m-1 s"),
        ("sin(alpha)", np.sin(CHANNELS["alpha"]), "1"),
        ("atan2(V, V)", np.full(len(TIME), np.pi / 4.0), "deg"),
        ("maximum(V, 3000 kt)", np.full(len(TIME), 3000.0 * 1852.0 / 3600.0), "m s-1"),
        ("mean(V)", np.full(len(TIME), CHANNELS["V"].mean()), "m s-1"),
        ("V - V", np.zeros(len(TIME)), "m s-1"),
    ],
)
def test_value_and_unit(text, expected, unit):
    found = value(text)
    np.testing.assert_allclose(found.values, expected, rtol=1e-13, atol=1e-15)
    assert found.dimension.unit() == unit


def test_functions_over_time():
    """Derivative and integral of a line and of a sine, against their closed forms."""
    np.testing.assert_allclose(value("deriv(alpha)").values, 0.01, rtol=1e-9)
    assert value("deriv(alpha)").dimension.unit() == "deg/s"
    exact = 0.05 * (1.0 - np.cos(2.0 * TIME))
    np.testing.assert_allclose(value("integral(q)").values, exact, atol=0.1 * 4.0 * 0.02**2 / 12)
    np.testing.assert_allclose(value("detrend(alpha)").values, 0.0, atol=1e-15)
    slow = value("lowpass(q, 4 Hz)").values[50:-50]
    np.testing.assert_allclose(slow, CHANNELS["q"][50:-50], atol=1e-4)


@pytest.mark.parametrize(
    "text",
    [
        "__import__('os').system('true')",
        "q.__class__.__mro__",
        "(lambda: 1)()",
        "[x for x in q]",
        "q[0]",
        "q if q else V",
        "open('x')",
        "'text'",
        "q; V",
        "q := 3",
        "f'{q}'",
        "True*q",
        "sqrt(x=q)",
        "sqrt(*q)",
        "abs(q, q)",
        "3 + 4",
        "",
        "(" * 300 + "q" + ")" * 300,
        "q" * 501,
        "9**9**9*q",
        "9" * 400 + "*q",
        "1e999*q",
        "q**V",
        "q**9",
    ],
)
def test_what_is_not_an_expression_is_an_error(text):
    channels = {"q": (CHANNELS["q"], None), "V": (CHANNELS["V"], None)}

    def evaluate():
        given = ChannelExpression(text)
        for name in given.names:
            find_channel(name, {"imu": xr.Dataset({"q": ("time", TIME), "V": ("time", TIME)})})
        given.evaluate(TIME, channels)

    with pytest.raises(AeromatchError):
        evaluate()


@pytest.mark.parametrize(
    "text",
    [
        "V + q",
        "alpha + 3",
        "3 < 4 - q",
        "sin(30)*q",
        "log(V)",
        "maximum(alpha, 3)",
        "V - 3 deg",
        "q - 2 Hz",
    ],
)
def test_other_dimensions_are_not_added(text):
    """A bare number next to an angle could be degrees or radians."""
    with pytest.raises((SchemaError, ParseError)):
        value(text)


def test_gaps_are_not_bridged():
    time = np.concatenate([np.arange(0.0, 1.0, 0.1), np.arange(3.0, 4.0, 0.1)])
    found = interpolate(time, 2.0 * time, np.array([-0.5, 0.25, 0.5, 2.0, 3.05, 9.0]))
    np.testing.assert_allclose(found, [np.nan, 0.5, 1.0, np.nan, 6.1, np.nan])
    assert [(part.start, part.stop) for part in stretches(time)] == [(0, 10), (10, 20)]
    valid = np.ones(20, bool)
    valid[4] = False
    assert [(p.start, p.stop) for p in stretches(time, valid)] == [(0, 4), (5, 10), (10, 20)]
    x = np.where(valid, time, np.nan)
    given = {"V": (x, Dimension(1, 0, -1))}
    slope = ChannelExpression("deriv(V)").evaluate(time, given).values
    assert np.isnan(slope[4])
    np.testing.assert_allclose(slope[valid], 1.0)
    total = ChannelExpression("integral(V)").evaluate(time, given).values
    # trapezia of the three stretches: 0 to 0.3, 0.5 to 0.9, 3 to 3.9
    assert total[-1] == pytest.approx(0.045 + 0.28 + 3.105)


def test_a_name_of_two_clocks_needs_its_leaf():
    data = xr.Dataset({"q": ("time", TIME), "label": ("time", ["a"] * len(TIME))}, {"time": TIME})
    leaves = {"imu": data, "adc": data, "path": data}
    with pytest.raises(SchemaError, match=r"imu\.q or adc\.q"):
        find_channel("q", leaves)
    assert find_channel("adc.q", leaves) == ("adc", "q")
    assert find_channel("q", {"imu": data, "path": data}) == ("imu", "q")
    assert find_channel("q", {"path": data}) == ("path", "q")
    with pytest.raises(UnknownName):
        find_channel("label", leaves)


def test_spectrum_of_two_sampling_intervals():
    """0.0200 and 0.02006 s differ by more than their mean differs from each."""
    line = {"q": np.random.default_rng(2).standard_normal(400)}
    pieces = [(slice(0, 200), 0.0200), (slice(200, 400), 0.02006)]
    found = views.average_densities(line, pieces, 128)
    assert (found["step"], found["used"], found["left_out"]) == (0.02, [slice(0, 200)], 1)


TURNING = np.arange(0.0, 60.0, 0.1)  # s
HEADING = 350.0 + 4.0 * TURNING  # deg


class TurningRecord:
    """A record that turns at 4 deg/s through north, on two clocks, and its reconstruction."""

    def __init__(self, missing=slice(0, 0)):
        slow = slice(None, None, 10)
        recorded = np.radians(HEADING % 360.0)
        recorded[missing] = np.nan
        path = np.radians((HEADING + 180.5) % 360.0 - 180.0)
        self.leaves = {
            "imu": self.leaf(TURNING, psi=recorded, r=np.full(600, np.radians(4.0))),
            "gps": self.leaf(TURNING[slow], lon=recorded[slow], north=TURNING[slow]),
            "path": self.leaf(TURNING[slow], psi=path[slow]),
        }

    def leaf(self, time, **channels):
        data = {name: ("time", values) for name, values in channels.items()}
        return xr.Dataset(data, {"time": time})

    def signal(self, text, monkeypatch):
        monkeypatch.setattr(signals, "leaves_of", lambda opened, record: self.leaves)
        return signals._form_signal(None, "", ChannelExpression(text))


def test_angles_are_not_averaged_through_their_jump(monkeypatch):
    """A heading of 359 and of 1 deg is north between, not south."""
    record = TurningRecord()
    common = slice(0, 591)  # the slow clock ends earlier
    for text, expected, atol in (
        ("deriv(psi)", 4.0, 1e-9),
        ("detrend(psi)", 0.0, 1e-9),
        ("deriv(psi) - r", 0.0, 1e-9),
        ("path.psi - psi", 0.5, 1e-9),
        ("psi - path.psi", -0.5, 1e-9),
        # 0.0064 deg at the ends of the filter
        ("lowpass(psi, 1 Hz) - psi", 0.0, 0.01),
    ):
        found = record.signal(text, monkeypatch)
        np.testing.assert_allclose(found.values[common], expected, atol=atol, err_msg=text)
        assert "counted through full turns" in " ".join(found.remarks)
    moved = record.signal("lon - psi", monkeypatch)
    np.testing.assert_allclose(moved.values[common], 0.0, atol=1e-9)
    heading = record.signal("psi", monkeypatch)
    np.testing.assert_allclose(heading.values, HEADING % 360.0)
    assert (heading.turn, heading.remarks) == (360.0, ())
    assert record.signal("r", monkeypatch).turn == 0.0
    between = heading.interpolated(np.array([2.45, 2.5, 2.55, 92.0]))
    np.testing.assert_allclose(between, [359.8, 0.0, 0.2, np.nan], atol=1e-9)
    path = record.signal("path.psi", monkeypatch)
    np.testing.assert_allclose(path.interpolated(np.array([47.3, 47.5])), [179.7, -179.5])


def test_an_angle_with_missing_samples_is_counted_on(monkeypatch):
    found = TurningRecord(slice(20, 35)).signal("path.psi - psi", monkeypatch)
    assert np.isnan(found.values[20:35]).all()
    np.testing.assert_allclose(np.delete(found.values[:591], range(20, 35)), 0.5, atol=1e-9)


def test_cursors_count_an_angle_through_its_turns(monkeypatch):
    found = TurningRecord().signal("psi", monkeypatch)
    monkeypatch.setattr(views, "signal_of", lambda opened, name, line: found)
    query = {"lines": '["psi"]', "start": "1", "stop": "5"}
    (row,) = views.read_cursors(None, query, None)["rows"]
    shown = [row[key] for key in ("first", "last", "difference", "slope", "mean", "low", "high")]
    np.testing.assert_allclose(shown, [354.0, 370.0, 16.0, 4.0, 362.0, 354.0, 370.0])


@pytest.fixture(scope="module")
def opened(tmp_path_factory):
    folder = tmp_path_factory.mktemp("opened")
    return OpenProject(small_project(folder / "t37"), folder / "work")


def ask(function, opened, **query):
    texts = {key: one if isinstance(one, str) else json.dumps(one) for key, one in query.items()}
    return function(opened, {"name": RECORD, **texts}, None)


def test_signals_of_a_record(opened):
    """Display units; another clock is interpolated and named."""
    found = signal_of(opened, RECORD, "alpha_vane - 2 deg")
    data = opened.record(RECORD)["vanes"]["alpha_vane"].values
    np.testing.assert_allclose(found.values, np.degrees(data) - 2.0, rtol=1e-12, atol=1e-12)
    assert (found.unit, found.remarks) == ("deg", ())
    mixed = signal_of(opened, RECORD, "engine1.n1 * q")
    assert mixed.remarks == ("engine1.n1: interpolated linearly to the clock of imu",)
    # A difference of temperatures has no zero point of the scale.
    assert signal_of(opened, RECORD, "temperature - temperature").unit == "K"


def test_expressions_wait_for_a_record_that_has_them(opened):
    found = ask(views.check_expressions, opened, lines=["q - 1 deg", "q", "no_channel + q", "q +"])
    assert [bool(line["refused"]) for line in found["lines"]] == [True, False, True, True]
    assert found["lines"][1]["unit"] == "deg/s"
    words = ask(views.list_expression_words, opened)
    assert "imu.q" in words["channels"]


def test_cursors_read_samples(opened):
    time = opened.record(RECORD)["imu"]["time"].values
    p = np.degrees(opened.record(RECORD)["imu"]["p"].values)
    a, b = float(time[100]), float(time[400])
    (row,) = ask(views.read_cursors, opened, lines=["imu.p"], start=a, stop=b)["rows"]
    assert row["first"] == pytest.approx(p[100], abs=1e-12)
    assert row["difference"] == pytest.approx(p[400] - p[100], abs=1e-12)
    assert row["chord"] == pytest.approx((p[400] - p[100]) / (b - a), rel=1e-9)
    assert row["slope"] == pytest.approx(np.polyfit(time[100:401], p[100:401], 1)[0], rel=1e-6)
    assert (row["samples"], row["unit"]) == (301, "deg/s")
    assert row["high"] == pytest.approx(p[100:401].max(), rel=1e-12)


def test_curve_and_spectrum(opened):
    curve = ask(views.show_curve, opened, x="alpha_vane", y="engine1.n1", start=2, stop=12)
    assert curve["units"] == ["deg", "%"]
    assert len(curve["x"]) == len(curve["y"]) == curve["samples"]
    assert curve["time"][0] >= 2.0
    (found,) = ask(views.show_spectrum, opened, lines=["p"], start=0, stop=28)["lines"]
    assert found["unit"] == "deg/s"
    assert found["resolution"] == pytest.approx(50.0 / 1024, rel=1e-6)
    assert found["frequency"][0] == pytest.approx(found["resolution"], rel=1e-9)
    assert 0.5 < found["rms"] / found["deviation"] < 2.0
    with pytest.raises(SchemaError, match="16 samples"):
        ask(views.show_spectrum, opened, lines=["p"], start=0.0, stop=0.1)
    with pytest.raises(SchemaError, match="JSON list"):
        ask(views.read_cursors, opened, lines="p", start=0.0, stop=0.1)


def test_density_of_a_sine():
    """A sine of amplitude 2 has the mean square 2; white noise is level at twice variance x
    step.
    """
    rng, step = np.random.default_rng(1), 0.02
    time = np.arange(20_000) * step
    line = {"sine": 2.0 * np.sin(2.0 * np.pi * 3.0 * time), "noise": rng.standard_normal(20_000)}
    found = views.average_densities(line, [(slice(0, 20_000), step)], 1024)
    width = 1.0 / (found["samples"] * step)
    assert found["densities"]["sine"].sum() * width == pytest.approx(2.0, rel=1e-3)
    assert found["frequency"][np.argmax(found["densities"]["sine"])] == pytest.approx(
        3.0, abs=width
    )
    assert found["densities"]["noise"].mean() == pytest.approx(2.0 * step, rel=0.03)
