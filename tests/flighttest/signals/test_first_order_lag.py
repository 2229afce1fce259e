"""A first-order lag taken off a channel, or put behind a command."""

import numpy as np
import pytest

import flighttest
from flighttest.records.signals.delays import follow_command, remove_lag
from flighttest.records.signals.differentiation import derivative_noise

STEP = 0.02
TIME = np.arange(0.0, 20.0, STEP)


def truth(time):
    return 0.1 * np.sin(2.0 * time) + 0.03 * np.sin(7.0 * time + 0.4)


def behind(time, tau):
    """Steady response of a first-order lag to `truth`, in closed form."""
    parts = [(0.1, 2.0, 0.0), (0.03, 7.0, 0.4)]
    return sum(
        a / np.hypot(1.0, w * tau) * np.sin(w * time + p - np.arctan(w * tau)) for a, w, p in parts
    )


@pytest.mark.parametrize("jitter", [0.0, 0.002])
def test_a_lag_is_taken_off(jitter):
    time = TIME + jitter * np.random.default_rng(1).uniform(-1.0, 1.0, len(TIME))
    found = remove_lag(time, behind(time, 0.08), 0.08, "alpha_vane")
    assert np.abs(found - truth(time)).max() < (
        2e-5 if jitter == 0.0 else 2e-3
    )  # of 0.13; the polynomial of a ninth part of a second


@pytest.mark.parametrize("jitter", [0.0, 0.002])
def test_an_actuator_follows_its_command(jitter):
    time = TIME + jitter * np.random.default_rng(1).uniform(-1.0, 1.0, len(TIME))
    found = remove_lag(time, truth(time), -0.08, "delta_e")
    late = time > 1.0  # twelve time constants behind the start at rest
    # straight lines between samples of a sine of 7 rad/s: (0.14)^2/12 of 0.03
    assert np.abs(found - behind(time, 0.08))[late].max() < (1e-4 if jitter == 0.0 else 3e-4)


def test_step_of_a_command_in_closed_form():
    step = np.where(TIME >= 2.0, 1.0, 0.0)
    found = remove_lag(TIME, step, -0.1, "delta_e")
    at = TIME > 2.01
    # the recorded step is a ramp over one sample: its response in closed form
    ramp = 1.0 - 0.1 / STEP * (
        np.exp(-(TIME[at] - 2.0) / 0.1) - np.exp(-(TIME[at] - 2.0 + STEP) / 0.1)
    )
    np.testing.assert_allclose(found[at], ramp, atol=1e-12)
    assert found[TIME < 1.97].max() == 0.0


def test_forth_and_back():
    x = truth(TIME)
    again = remove_lag(TIME, remove_lag(TIME, x, -0.05, "theta"), 0.05, "theta")
    assert np.abs(again - x)[50:].max() < 3e-4  # behind the start at rest


def test_noise_grows_as_stated():
    noise = np.random.default_rng(2).normal(0.0, 1.0, 20_000)
    found = remove_lag(STEP * np.arange(len(noise)), noise, 0.05, "alpha_vane")
    assert found.std() == pytest.approx(np.hypot(1.0, 0.05 * derivative_noise(STEP)), rel=0.03)


def test_missing_samples_stay_and_gaps_start_anew():
    x = truth(TIME)
    x[400] = np.nan
    time = np.where(TIME > 12.0, TIME + 5.0, TIME)
    for lag in (0.08, -0.08):
        found = remove_lag(time, x, lag, "alpha_vane")
        assert np.flatnonzero(np.isnan(found)).tolist() == [400]
    first, second = 401, int(np.argmax(time > 12.5))
    assert found[first] == x[first]
    assert found[second] == x[second]


def test_heading_that_passes_north():
    psi = 0.2 * TIME
    shown = (psi - 0.2 * 0.5) % (2.0 * np.pi)
    found = remove_lag(TIME, shown, 0.5, "psi")
    np.testing.assert_allclose(np.cos(found - psi), 1.0, atol=1e-12)


def test_lag_of_the_name_map(tmp_path):
    rows = zip(TIME, np.degrees(behind(TIME - 0.06, 0.08)), np.degrees(truth(TIME)))
    (tmp_path / "flight.csv").write_text(
        "time,vane,demand\n" + "".join(f"{t:.2f},{a:.9f},{b:.9f}\n" for t, a, b in rows)
    )
    (tmp_path / "names.toml").write_text(
        '[vane]\nalpha_vane = { column = "vane", unit = "deg", delay = "60 ms", lag = "80 ms" }\n'
        '[controls]\ndelta_e = { column = "demand", unit = "deg", lag = "-0.08 s" }\n'
    )
    record = flighttest.read(tmp_path / "flight.csv", tmp_path / "names.toml")
    inner = (TIME > 1.0) & (TIME < 19.0)
    assert np.abs(record["vane/alpha_vane"].values - truth(TIME))[inner].max() < 1e-4
    assert np.abs(record["controls/delta_e"].values - behind(TIME, 0.08))[inner].max() < 1e-4
    assert record["vane/alpha_vane"].attrs["lag_removed"] == pytest.approx(0.08)
    assert record["controls/delta_e"].attrs["lag_removed"] == pytest.approx(-0.08)


def test_limits_of_an_actuator_in_closed_form():
    """A step of one: a straight rise at the rate limit to the stop; without limits the lag alone,
    to the last bit of it.
    """
    step = np.where(TIME >= 2.0, 1.0, 0.0)
    found = follow_command(TIME, step, 0.0, 2.0, (-0.3, 0.7))
    np.testing.assert_allclose(found, np.clip(2.0 * (TIME - 2.0 + STEP), 0.0, 0.7), atol=1e-9)
    np.testing.assert_allclose(
        follow_command(TIME, truth(TIME), 0.08),
        remove_lag(TIME, truth(TIME), -0.08, "delta_e"),
        atol=1e-12,
    )
    fast = np.abs(np.diff(follow_command(TIME, step, 0.1, 1.5)))
    assert fast.max() == pytest.approx(1.5 * STEP)


def test_an_actuator_starts_anew_behind_a_hole():
    x = np.where(TIME < 2.0, 0.0, 0.5)
    x[(TIME >= 2.0) & (TIME < 2.5)] = np.nan
    found = follow_command(TIME, x, 0.1, 0.2)
    assert np.isnan(found[(TIME >= 2.0) & (TIME < 2.5)]).all()
    assert (found[TIME >= 2.5] == 0.5).all()
