"""Estimates during flight: against the batch at every second, faults of the stream, evidence,
goals.
"""

import numpy as np
import pytest
from click.testing import CliRunner
from flown_lift import LIFT, STEP, coloured_noise, record
from flown_lift import TRUTH as _TRUTH

from flightmech.aircraft.aircraft import Aircraft
from flightmech.errors import IdentificationError, ParseError, UnknownName
from flighttest.cli.group import flight
from flighttest.in_flight.flight_estimate import AccuracyGoal
from flighttest.in_flight.following import FlightFollower
from flighttest.in_flight.sample_stream import SampleStream
from flighttest.reconstruction.dynamics.force_coefficients import coefficients
from flighttest.regression.equation_error.frequency.frequency_domain import regress_frequency
from flighttest.regression.equation_error.model import RegressionModel

BAND, SPACING = (0.2, 2.0), 0.04
TRUTH = np.array(list(_TRUTH.values()))[1:]


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


def assert_same(estimate, data):
    """Compare with the batch on the windows of 1/SPACING seconds so far."""
    length = round(1.0 / SPACING / STEP)
    whole = data.isel(time=slice(0, estimate.samples))
    windows = []
    for first in range(0, estimate.samples, length):
        window = whole.isel(time=slice(first, first + length))
        if window.sizes["time"] * STEP * BAND[0] >= 1.0 - 1e-9:
            windows.append(window)
    batch = regress_frequency(LIFT, windows, BAND, spacing=SPACING).estimates.isel(term=slice(1, 4))
    np.testing.assert_allclose(estimate.values, batch["estimate"], rtol=1e-10)
    np.testing.assert_allclose(estimate.stderr, batch["stderr"], rtol=1e-9)


@pytest.mark.nightly
def test_every_second_is_the_batch_of_the_samples_so_far():
    data = record(np.random.default_rng(0), duration=60.0)
    found, _, _ = follow(text_of(data))
    used = [estimate for estimate in found if not estimate.waiting]
    assert len(found) == 60
    assert found[0].waiting.startswith("waiting for 5 s")
    assert [round(estimate.time) for estimate in used[:3]] == [5, 6, 7]
    for estimate in (used[0], used[10], used[25], used[-1]):
        assert_same(estimate, data)


@pytest.mark.slow
def test_the_size_of_the_pieces_changes_nothing():
    data = record(np.random.default_rng(1), duration=12.0)
    text = text_of(data)
    a, b = follow(text, piece=1)[0], follow(text, piece=10**7)[0]
    assert len(a) == len(b)
    for one, other in zip(a, b):
        assert one.time == other.time
        np.testing.assert_allclose(one.values, other.values, rtol=1e-11)


def test_large_means_cost_no_digits():
    data = record(np.random.default_rng(2), duration=20.0)
    moved = data.assign(alpha=data["alpha"] + 1e3, CL=data["CL"] - 1e3)
    a, b = follow(text_of(data))[0][-1], follow(text_of(moved))[0][-1]
    np.testing.assert_allclose(a.values, b.values, rtol=1e-8)


@pytest.mark.slow
def test_a_change_of_rounding_size_changes_nothing():
    data = record(np.random.default_rng(3), duration=20.0)
    rng = np.random.default_rng(0)
    moved = data.copy()
    for name in data.data_vars:
        moved[name] = data[name] * (1.0 + 1e-12 * rng.normal(size=data.sizes["time"]))
    options = {"candidates": ["alpha**2", "alpha*qhat"]}
    a, b = follow(text_of(data), **options)[0][-1], follow(text_of(moved), **options)[0][-1]
    assert a.terms == b.terms
    assert np.abs((a.values - b.values) / a.stderr).max() < 1e-8


@pytest.mark.nightly
def test_two_standard_errors_cover_the_truth():
    """12 records of 30 s; benchmarks/follow.py has 200."""
    inside = []
    for seed in range(12):
        follower = FlightFollower(LIFT, band=BAND)
        data = record(np.random.default_rng(seed))
        names = follower.choose_channels([str(name) for name in data.data_vars])
        values = np.column_stack([data[name].values for name in names])
        last = list(follower.add(data["time"].values, values, final=True))[-1]
        inside.append(np.abs(last.values - TRUTH) < 2 * last.stderr)
    assert np.mean(inside) == pytest.approx(0.94, abs=0.08)


@pytest.mark.nightly
def test_short_gaps_are_bridged_and_long_ones_begin_a_new_stretch():
    data = record(np.random.default_rng(4), duration=40.0)
    keep = np.ones(data.sizes["time"], bool)
    keep[[300, 700, 701, 702]] = False
    short = follow(text_of(data.isel(time=keep)))[0][-1]
    assert short.counts["bridged"] == 4
    assert short.counts["gaps"] == 0
    whole = follow(text_of(data))[0][-1]
    assert np.abs((short.values - whole.values) / whole.stderr).max() < 0.2
    keep[900:1000] = False
    long = follow(text_of(data.isel(time=keep)))[0][-1]
    assert long.counts["gaps"] == 1
    assert np.abs(long.values - TRUTH).max() < 4 * long.stderr.max()


@pytest.mark.slow
def test_jumps_of_the_clock_repeated_stamps_and_broken_lines_are_counted():
    data = record(np.random.default_rng(5), duration=40.0)
    time = data["time"].values.copy()
    time[1000:] -= 7.0
    lines = text_of(data.assign_coords(time=time)).splitlines()
    lines.insert(200, lines[199])
    lines[400] = lines[400][: len(lines[400]) // 3]
    lines[401] = lines[401].replace(lines[401].split(",")[1], "nan")
    lines[402] = "garbage"
    found, _, stream = follow("\n".join(lines) + "\n0.1,0.2")
    last = found[-1]
    assert last.counts["clock_jumps"] == 1
    assert last.counts["repeated"] == 1
    assert stream.left_out == 3
    assert last.counts["bridged"] == 3
    assert stream.has_rest
    assert np.abs((last.values - TRUTH) / last.stderr).max() < 4.0


@pytest.mark.slow
def test_coarse_stamps_of_60_hz_are_one_stretch():
    data = record(np.random.default_rng(6), duration=40.0)
    time = np.round(np.arange(data.sizes["time"]) / 60.0, 3)
    found, follower, _ = follow(text_of(data.assign_coords(time=time)))
    assert follower.clock.step == pytest.approx(1.0 / 60.0, rel=1e-12)
    assert found[-1].counts["gaps"] == found[-1].counts["bridged"] == 0


@pytest.mark.nightly
def test_a_candidate_enters_by_evidence_only():
    data = record(np.random.default_rng(7), duration=40.0, noise=0.002)
    with_product = data.assign(CL=data["CL"] + 60.0 * data["alpha"] ** 2)
    idle = follow(text_of(data), candidates=["alpha**2", "alpha*delta_e"])[0][-1]
    assert idle.terms == ("alpha", "qhat", "delta_e")
    found = follow(text_of(with_product), candidates=["alpha**2", "alpha*delta_e"])[0][-1]
    assert found.terms == ("alpha", "qhat", "delta_e", "alpha**2")
    assert abs(found.values[3] - 60.0) < 4.0 * found.stderr[3]


@pytest.mark.slow
def test_the_stream_may_end_when_the_goals_are_met():
    data = record(np.random.default_rng(8), duration=40.0)
    goals = [AccuracyGoal("alpha", 0.05, True), AccuracyGoal("delta_e", 0.2, False)]
    found, _, _ = follow(text_of(data), goals=goals)
    first = next(k for k, estimate in enumerate(found) if estimate.is_accurate)
    for estimate in found[first - 2 : first + 1]:
        assert estimate.stderr[0] <= 0.05 * abs(estimate.values[0])
        assert estimate.stderr[2] <= 0.2
    with pytest.raises(UnknownName):
        follow("", goals=[AccuracyGoal("beta", 0.1, False)])


@pytest.mark.slow
def test_terms_that_wander_do_not_end_the_stream():
    """After 15 s the lift slope is another one, by 40 %: the goal of 5 % is met, the term moves."""
    data = record(np.random.default_rng(13), duration=30.0, noise=0.002)
    late = data["time"].values > 15.0
    data["CL"] = data["CL"] + np.where(late, 2.0 * data["alpha"].values, 0.0)
    found, _, _ = follow(text_of(data), goals=[AccuracyGoal("alpha", 0.1, True)])
    assert found[9].is_accurate
    moving = [estimate for estimate in found if "alpha" in estimate.unsteady]
    assert moving
    assert not any(estimate.is_accurate for estimate in moving)
    assert "unsteady" in moving[0].line()


def flown():
    """Readings at the c.g. with a moment that rolls, pitches and yaws."""
    t = np.arange(0.0, 20.0, STEP)
    rng = np.random.default_rng(9)
    data = record(rng, duration=20.0)
    q = 0.05 * np.sin(2.1 * t) + 0.03 * np.sin(5.3 * t + 1.0)
    columns = {
        "V": np.full(len(t), 80.0),
        "qbar": 4000.0 + 20.0 * np.sin(0.4 * t),
        "beta": 0.01 * np.sin(3.0 * t),
        "p": 0.02 * np.cos(1.7 * t),
        "q": q,
        "r": 0.01 * np.sin(2.2 * t),
        "ax": 0.1 * np.sin(t),
        "ay": 0.1 * np.cos(t),
        "az": -9.8 + np.sin(2.0 * t) + 0.1 * coloured_noise(rng, len(t)),
    }
    data = data.drop_vars(["CL", "qhat"])
    return data.assign({name: ("time", values) for name, values in columns.items()})


CRAFT = Aircraft("test", 16.0, 1.6, 10.0, 2000.0, 11000.0, 8000.0, 15000.0)


@pytest.mark.nightly
@pytest.mark.parametrize("coefficient", ["CL", "Cm"])
def test_coefficients_are_those_of_the_batch(coefficient):
    data = flown()
    model = RegressionModel.parse(f"{coefficient} = 1 + alpha + qhat + delta_e")
    last = follow(text_of(data), model, aircraft=CRAFT)[0][-1]
    inner = data.copy()
    for name in ("p", "q", "r"):
        x, rate = data[name].values, np.zeros(data.sizes["time"])
        rate[2:-2] = (x[:-4] - 8 * x[1:-3] + 8 * x[3:-1] - x[4:]) / (12 * STEP)
        inner[f"{name}_dot"] = "time", rate
    batch = coefficients(inner, CRAFT).isel(time=slice(2, -2))
    assert last.samples == batch.sizes["time"]
    expected = regress_frequency(model, batch, BAND, spacing=SPACING).estimates
    np.testing.assert_allclose(last.values, expected["estimate"].values[1:], rtol=1e-9)


@pytest.mark.slow
def test_samples_on_the_ground_end_a_stretch():
    data = flown()
    wheel = np.zeros(data.sizes["time"])
    wheel[500:520] = 1.0
    data["wow_left"] = "time", wheel
    model = RegressionModel.parse("CL = 1 + alpha + delta_e")
    last = follow(text_of(data), model, aircraft=CRAFT)[0][-1]
    assert last.samples == data.sizes["time"] - 4 - 20
    assert last.counts["without_coefficient"] == 20


def test_what_the_stream_lacks_is_named():
    data = record(np.random.default_rng(10), duration=2.0)
    with pytest.raises(UnknownName, match="qhat"):
        follow(text_of(data.drop_vars("qhat")))
    with pytest.raises(ParseError, match="clock"):
        follow(text_of(data).replace("time", "tick", 1))
    with pytest.raises(IdentificationError, match="half the sampling rate"):
        follow(text_of(data.isel(time=slice(None, None, 25))))
    still = data.isel(time=slice(0, 30)).assign_coords(time=np.zeros(30))
    with pytest.raises(IdentificationError, match="time must rise"):
        follow(text_of(still))


def test_a_rate_that_is_not_that_of_the_stamps_is_refused():
    data = record(np.random.default_rng(15), duration=8.0)
    with pytest.raises(IdentificationError, match="50 Hz, 100 Hz is stated"):
        follow(text_of(data), rate=100.0)
    found, follower, _ = follow(text_of(data), rate=50.0)
    assert follower.clock.step == 0.02
    assert not found[-1].waiting
    still = data.assign(CL=0.0 * data["CL"])
    assert "constant" in follow(text_of(still))[0][-1].waiting


def test_decimal_commas_are_refused(tmp_path):
    file = tmp_path / "commas.csv"
    file.write_text("time;CL;alpha\n" + "".join(f"0,{k:02d};1,5;0,1\n" for k in range(50)))
    done = CliRunner().invoke(flight, ["follow", str(file), "--model", "CL = 1 + alpha"])
    assert isinstance(done.exception, ParseError)
    assert "no sample in 50 lines" in str(done.exception)
