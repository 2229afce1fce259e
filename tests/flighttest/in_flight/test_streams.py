"""Streams of estimates during flight: units, files that grow, gaps, vanes, constraints."""

import json
from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest
from click.testing import CliRunner
from flown_lift import LIFT, record

from flightmech.aircraft.aircraft_file import read_aircraft
from flightmech.errors import AeromatchError, ParseError, SchemaError
from flighttest.cli.actions.follow import _pieces_of_file
from flighttest.cli.group import flight
from flighttest.in_flight.coefficient_samples import CoefficientSamples
from flighttest.in_flight.following import FlightFollower
from flighttest.in_flight.sample_stream import SampleStream
from flighttest.in_flight.vane_angles import VaneAngles
from flighttest.records.readers.name_map import Channel, Clock, NameMap
from flighttest.records.signals.delays import remove_lag
from flighttest.regression.equation_error.frequency.frequency_domain import regress_frequency
from flighttest.regression.equation_error.model import RegressionModel

T37 = Path(__file__).parents[3] / "data" / "t37" / "aircraft.toml"
BAND, SPACING = (0.2, 2.0), 0.04


def text_of(data, digits=17):
    """A record as CSV."""
    names = [str(name) for name in data.data_vars]
    lines = [",".join(["time", *names])]
    table = np.column_stack([data["time"].values, *(data[name].values for name in names)])
    lines += [",".join(f"{x:.{digits}g}" for x in row) for row in table]
    return "\n".join(lines) + "\n"


def follow(text, model=LIFT, piece=1000, aircraft=None, **options):
    """Estimates of a text that arrives in pieces; the follower and the stream."""
    follower = FlightFollower(model, aircraft, band=BAND, spacing=SPACING, **options)
    stream = SampleStream(follower.choose_channels)
    found = []
    for first in range(0, len(text), piece):
        found += follower.add(*stream.feed(text[first : first + piece]), stream.left_out)
    found += follower.add(np.zeros(0), np.zeros((0, len(stream.channels))), 0, final=True)
    return found, follower, stream


def test_units_of_headings_and_name_maps():
    data = record(np.random.default_rng(11), duration=8.0)
    degrees = data.assign(alpha=np.degrees(data["alpha"]))
    plain = follow(text_of(data))[0][-1]
    text = text_of(degrees).replace(",alpha,", ",alpha [deg],", 1)
    np.testing.assert_allclose(follow(text)[0][-1].values, plain.values, rtol=1e-9)
    names = NameMap(
        {"all": {name: Channel(column=name, unit="1") for name in ("CL", "qhat")}
         | {"alpha": Channel(column="AOA", unit="deg"),
            "delta_e": Channel(column="delta_e", unit="rad", sign=-1)}},
        Clock(column="stamp", unit="ms"),
    )  # fmt: skip
    mapped = degrees.assign(AOA=degrees["alpha"], delta_e=-degrees["delta_e"]).drop_vars("alpha")
    mapped = mapped.assign_coords(time=1e3 * mapped["time"].values)
    follower = FlightFollower(LIFT, band=BAND, spacing=SPACING)
    stream = SampleStream(follower.choose_channels, names)
    time, values = stream.feed(text_of(mapped).replace("time", "stamp", 1))
    last = list(follower.add(time, values, final=True))[-1]
    np.testing.assert_allclose(last.values, plain.values, rtol=1e-9)
    late = NameMap({"all": {"CL": Channel(column="CL", unit="1", delay=0.1)}}, Clock(column="time"))
    with pytest.raises(AeromatchError, match="whole record"):
        SampleStream(follower.choose_channels, late).feed(text_of(data))


@pytest.mark.slow
def test_the_command_on_a_file_and_on_an_input(tmp_path):
    data = record(np.random.default_rng(12), duration=12.0)
    file = tmp_path / "stream.csv"
    file.write_text(text_of(data) + "12.0,0.1")
    options = ["--model", str(LIFT), "--band", "0.2", "2", "--spacing", "0.04"]
    done = CliRunner().invoke(flight, ["follow", str(file), *options, "--json"])
    assert done.exit_code == 0, done.output
    rows = [json.loads(line) for line in done.stdout.splitlines()]
    assert rows[-1]["terms"]["alpha"]["stderr"] > 0.0
    assert "no end" in done.stderr
    piped = CliRunner().invoke(flight, ["follow", "-", *options], input=file.read_text())
    assert piped.exit_code == 0
    assert len(piped.stdout.splitlines()) == len(rows)
    early = CliRunner().invoke(flight, ["follow", str(file), *options, "--until", "alpha", "20%"])
    assert early.exit_code == 0
    assert early.stdout.splitlines()[-1].endswith("accurate")
    never = CliRunner().invoke(flight, ["follow", str(file), *options, "--until", "alpha", "1e-9"])
    assert never.exit_code == 1
    wrong = CliRunner().invoke(flight, ["follow", str(file), *options, "--until", "alpha", "-5%"])
    assert wrong.exit_code != 0


def test_the_work_is_bounded(monkeypatch):
    """Of four windows of 5 s two are kept: the estimates are those of the later half."""
    monkeypatch.setattr("flighttest.in_flight.kept_windows.KEPT", 10.0)
    data = record(np.random.default_rng(14), duration=20.0)
    follower = FlightFollower(LIFT, band=BAND, spacing=0.2)
    names = follower.choose_channels([str(name) for name in data.data_vars])
    values = np.column_stack([data[name].values for name in names])
    last = list(follower.add(data["time"].values, values, final=True))[-1]
    assert last.counts["forgotten_windows"] == 2
    assert last.samples == 500
    later = [data.isel(time=slice(500, 750)), data.isel(time=slice(750, 1000))]
    batch = regress_frequency(LIFT, later, BAND, spacing=0.2).estimates["estimate"].values[1:]
    np.testing.assert_allclose(last.values, batch, rtol=1e-9)


@pytest.mark.nightly
def test_gaps_do_not_shorten_what_is_kept():
    """A gap every 6 s makes 22 stretches of 5.4 s; two that another gap makes are too short."""
    data = record(np.random.default_rng(16), duration=138.0)
    number = np.arange(data.sizes["time"])
    keep = (number % 300 >= 30) & ~((number >= 3200) & (number < 3230))
    last = follow(text_of(data.isel(time=keep)))[0][-1]
    assert last.counts["gaps"] == 23
    assert last.counts["forgotten_windows"] == 0
    assert last.counts["too_short"] == 240
    assert last.samples == keep.sum() - 240
    windows = []
    for first in range(30, len(number), 300):
        if first != 3030:
            windows.append(data.isel(time=slice(first, first + 270)))
    batch = regress_frequency(LIFT, windows, BAND, spacing=SPACING).estimates.isel(term=slice(1, 4))
    np.testing.assert_allclose(last.values, batch["estimate"], rtol=1e-9)


def test_a_file_that_grows_is_followed_to_its_end(tmp_path):
    """The second half arrives while the reader waits, in the middle of a line."""
    file = tmp_path / "growing.csv"
    text = "time,CL\n" + "".join(f"{0.02 * k:.2f},{k}\n" for k in range(100))
    file.write_text(text[:703])
    pieces = []
    for piece in _pieces_of_file(str(file), wait=5.0):
        pieces.append(piece)
        if len(pieces) > 1:
            break
        with open(file, "a") as more:
            more.write(text[703:])
    assert b"".join(pieces).decode() == text
    assert list(_pieces_of_file(str(file), wait=0.0)) == [text.encode()]
    cut = _pieces_of_file(str(file), wait=5.0)
    next(cut)
    file.write_text("short")
    with pytest.raises(ParseError, match="cut"):
        next(cut)


INSTRUMENTS = {
    "vanes": {
        "position": [4.35, 0.0, 0.15],
        "noise": {"alpha_vane": 1.5e-3, "beta_vane": 1.5e-3},
        "factor": {"alpha_vane": [1.08, 0.04], "beta_vane": [1.05, 0.04]},
        "lag": [0.05, 0.02],
    }
}


def vane_stream(lag=0.0):
    """A motion with its angles at the centre of gravity, and what vanes 4 m ahead of it show."""
    t = np.arange(0.0, 20.0, 0.02)
    d = {"V": 60.0 + np.sin(0.3 * t), "alpha": 0.08 + 0.04 * np.sin(2.0 * t)}
    d["beta"] = 0.05 * np.sin(1.1 * t + 1.0)
    for k, name in enumerate("pqr"):
        d[name] = 0.2 * np.sin((1.3 + 0.4 * k) * t + k)
    velocity = d["V"] * np.stack(
        [
            np.cos(d["alpha"]) * np.cos(d["beta"]),
            np.sin(d["beta"]),
            np.sin(d["alpha"]) * np.cos(d["beta"]),
        ]
    )
    arm = np.array([4.35, 0.0, 0.15]) - np.array([0.1, 0.0, 0.2])
    flow = velocity.T + np.cross(np.stack([d[name] for name in "pqr"], axis=1), arm)
    for name, column, factor in (("alpha", 2, 1.08), ("beta", 1, 1.05)):
        angle = factor * np.arctan2(flow[:, column], flow[:, 0])
        if lag:
            angle = remove_lag(t, angle, -lag, name)
        d[f"{name}_vane"] = angle
    return t, d


def vanes_of(lag):
    vanes = {**INSTRUMENTS["vanes"], "lag": [lag, 0.02]}
    return SimpleNamespace(instruments={"vanes": vanes}, name="test", cg=(0.1, 0.0, 0.2))


@pytest.mark.parametrize("kept", [(), ("alpha",), ("beta",)])
def test_vanes_give_the_angles_at_the_centre_of_gravity(kept):
    _, d = vane_stream()
    given = {name: x for name, x in d.items() if name not in ("alpha", "beta") or name in kept}
    vanes = VaneAngles.of(vanes_of(0.0), given)
    assert set(vanes.angles) == {"alpha", "beta"} - set(kept)
    assert not vanes.has_lag
    found = vanes.at_cg(given)
    for name in ("alpha", "beta"):
        np.testing.assert_allclose(found[name], d[name], atol=1e-12)
    # the correction matters: a vane as the angle itself is wrong by degrees
    assert np.abs(d["alpha_vane"] / 1.08 - d["alpha"]).max() > 0.01


def test_the_lag_of_a_vane_is_led():
    """To first order: at 0.32 Hz and 0.05 s, 0.5 % of the amplitude remains."""
    t, d = vane_stream(lag=0.05)
    vanes = VaneAngles.of(vanes_of(0.05), ["alpha_vane", "V", "beta"])
    assert vanes.has_lag
    led = vanes.without_lag(d, lambda x, step: np.gradient(x, step), t[1])
    exact = vane_stream()[1]["alpha_vane"]
    inside = slice(50, -50)
    before = np.abs(d["alpha_vane"] - exact)[inside].max()
    assert np.abs(led["alpha_vane"] - exact)[inside].max() < 0.05 * before


def test_a_vane_without_a_position_is_refused():
    aircraft = SimpleNamespace(instruments={}, name="test", cg=(0.0, 0.0, 0.0))
    with pytest.raises(SchemaError, match="alpha_vane has no position"):
        VaneAngles.of(aircraft, ["alpha_vane"])
    assert VaneAngles.of(aircraft, ["alpha", "alpha_vane"]).angles == []


@pytest.mark.slow
@pytest.mark.parametrize("lag", [0.0, 0.05])
def test_a_stream_of_vanes_gives_the_regressors_of_a_stream_at_the_centre_of_gravity(lag):
    vanes = {**INSTRUMENTS["vanes"], "lag": [lag, 0.02]}
    shipped = read_aircraft(T37)
    aircraft = replace(shipped, instruments={"vanes": vanes}, cg=(0.1, 0.0, 0.2))
    t, d = vane_stream(lag)
    thrust = {f"engine{k}.thrust": 1000.0 + 0.0 * t for k in (1, 2)}
    extra = {"qbar": 0.5 * 1.1 * d["V"] ** 2, "ax": 0.0 * t, "ay": 0.0 * t, "az": -9.8 + 0.0 * t}
    columns = {**d, **thrust, **extra, **{f"{name}_dot": 0.0 * t for name in "pqr"}}
    model = RegressionModel.parse("Cm = 1 + alpha + beta + qhat")
    tables = []
    for left_out in (("alpha", "beta"), ("alpha_vane", "beta_vane")):
        source = CoefficientSamples(model, aircraft)
        names = source.choose_channels([name for name in columns if name not in left_out])
        times, table = source.convert(t, np.stack([columns[name] for name in names], axis=1))
        assert source.delay == (2 if lag and "alpha" in left_out else 0)
        tables.append(table[np.isin(times, t[100:-100])])
    # with a lag: what the lead to first order leaves
    np.testing.assert_allclose(*tables, atol=1e-3 if lag else 1e-10)


def test_constraints_are_those_of_the_batch():
    data = record(np.random.default_rng(21), duration=20.0)
    batch = regress_frequency(
        LIFT, data, BAND, spacing=SPACING, constraints=["delta_e = 0.1*alpha", "qhat > 10"]
    ).estimates
    found = follow(text_of(data), constraints=["delta_e = 0.1*alpha", "qhat > 10"])[0][-1]
    np.testing.assert_allclose(found.values, batch["estimate"].values[1:], rtol=1e-9)
    np.testing.assert_allclose(found.stderr, batch["stderr"].values[1:], rtol=1e-9, atol=1e-12)
    rows = found.as_dict()["constraints"]
    assert [row["text"] for row in rows] == ["delta_e = 0.1*alpha", "qhat > 10"]
    for row, expected in zip(rows, json.loads(batch.attrs["constraints"])):
        assert row["active"] == expected["active"]
        assert row["t"] == pytest.approx(expected["t"], rel=1e-6)


@pytest.mark.slow
def test_a_candidate_that_a_limit_holds_does_not_end_the_choice():
    data = record(np.random.default_rng(5), duration=30.0, noise=0.002)
    extra = -50.0 * data["alpha"] ** 2 + 1200.0 * data["alpha"] * data["qhat"]
    options = {"candidates": ["alpha**2", "alpha*qhat"], "constraints": ["alpha**2 > 0"]}
    found = follow(text_of(data.assign(CL=data["CL"] + extra)), **options)[0][-1]
    assert found.terms == ("alpha", "qhat", "delta_e", "alpha*qhat")
    # The limit that keeps the candidate out is stated with its contradiction.
    (row,) = found.as_dict()["constraints"]
    assert row["active"]
    assert row["t"] < -30.0
    assert "contradicts alpha**2 > 0 by" in found.line()


def test_candidates_of_an_equality_are_in_the_model(tmp_path):
    data = record(np.random.default_rng(22), duration=12.0)
    tie = ["alpha**2 = 0.02*alpha*qhat"]
    options = {"candidates": ["alpha*qhat", "alpha**2", "alpha*delta_e"], "constraints": tie}
    last = follow(text_of(data), **options)[0][-1]
    terms = dict(zip(last.terms, last.values))
    assert {"alpha**2", "alpha*qhat"} < set(terms)
    assert terms["alpha**2"] == pytest.approx(0.02 * terms["alpha*qhat"], rel=1e-12)
    file = tmp_path / "stream.csv"
    file.write_text(text_of(data))
    words = ["follow", str(file), "--model", "CL = 1 + alpha + qhat", "--band", "0.2", "2"]
    words += ["--constraint", "qhat = 5", "--json"]
    done = CliRunner().invoke(flight, words, catch_exceptions=False)
    row = json.loads(done.stdout.splitlines()[-1])
    assert row["terms"]["qhat"] == {"estimate": pytest.approx(5.0), "stderr": 0.0}
    assert [one["active"] for one in row["constraints"]] == [True]
    wrong = follow(text_of(data), constraints=["alpha = 1"])[0][-1]
    assert "contradicts alpha = 1 by" in wrong.line()
    with pytest.raises(SchemaError, match="contradict"):
        follow(text_of(data), constraints=["alpha > 2", "alpha < 1"])
