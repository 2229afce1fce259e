"""Channels without a tolerance: what passes its row and is off elsewhere gets a remark."""

import numpy as np
import pytest

from pom.cases.case import PomCase
from pom.judging.watched_channels import BANDS, watch_channels
from pom.tolerances import rows as table

TIME = np.arange(0.0, 120.0, 0.05)
DEG = np.pi / 180.0


def case(id, reference="flight"):
    window = (0.0, float(TIME[-1]))
    rows = table.rows_of_test(id)
    criteria = [
        table.make_criterion(r, name, window, ())
        for r, name in zip(rows, table.names_of(rows), strict=True)
    ]
    return PomCase(
        "c",
        "C",
        id,
        table.STANDARD,
        table.EDITION,
        "c.toml",
        "r.nc",
        window,
        criteria=tuple(criteria),
        reference=reference,
    )


def phugoid(phase=0.0, amplitude=6.0, drift=0.0):
    """Speed and pitch of a phugoid: period 50 s, time to half 60 s."""
    wave = np.exp(-TIME * np.log(2.0) / 60.0) * np.cos(2.0 * np.pi * TIME / 50.0 + phase)
    return {
        "V_cas": 90.0 + amplitude * wave + drift * TIME,
        "theta": 0.6 * amplitude * DEG * wave,
        "phi": 0.0 * TIME,
    }


@pytest.mark.parametrize(
    ("model", "about"),
    [
        (phugoid(phase=np.pi), {"V_cas", "theta"}),  # opposite phase: period and damping are right
        (phugoid(amplitude=18.0), {"V_cas", "theta"}),  # three times the amplitude
        (phugoid(drift=0.05), {"V_cas"}),  # 6 m/s at the end
        (phugoid() | {"phi": np.where(TIME > 60.0, 5.0 * DEG, 0.0)}, {"phi"}),
        (phugoid(phase=0.1), set()),
    ],
)
def test_a_mode_of_the_right_period_and_damping_is_watched(model, about):
    assert {
        remark.quantity for remark in watch_channels(case("2.c.9"), TIME, phugoid(), model)
    } == about


def test_the_remark_states_channel_size_time_and_band():
    model = phugoid() | {"phi": np.where((TIME > 60.0) & (TIME < 61.0), -5.0 * DEG, 0.0)}
    (remark,) = watch_channels(case("2.c.9"), TIME, phugoid(), model)
    assert remark.kind == "watch"
    assert (
        remark.text
        == "bank angle off by 5 deg at 60.1 s, without a tolerance, watched within 4 deg"
    )
    assert remark.values == pytest.approx({"off": 5.0, "band": 4.0})


def test_the_band_widens_with_the_motion_of_the_flight():
    flight = {"p": 40.0 * DEG * np.sin(TIME)}
    assert watch_channels(case("2.c.9"), TIME, flight, {"p": flight["p"] * 0.76}) == ()
    (remark,) = watch_channels(case("2.c.9"), TIME, flight, {"p": flight["p"] * 0.74})
    assert remark.values["band"] == pytest.approx(10.0, rel=1e-3)


def test_a_sample_without_a_value_does_not_end_the_watch_of_an_angle():
    """A bank that leaves its band by 20 deg after a gap of one second in the flight."""
    flight = phugoid()
    flight["phi"] = np.where((TIME > 10.0) & (TIME < 11.0), np.nan, 0.0)
    model = {**phugoid(), "phi": np.where(TIME > 60.0, 20.0 * DEG, 0.0) + 2.0 * np.pi}
    (remark,) = watch_channels(case("2.c.9"), TIME, flight, model)
    assert (remark.kind, remark.quantity) == ("departure", "phi")
    assert remark.values["off"] == pytest.approx(20.0)


def test_what_a_time_history_judges_is_not_watched_again():
    """2.d.2 judges the roll rate."""
    flight = {"p": 0.0 * TIME, "beta": 0.0 * TIME}
    model = {"p": 20.0 * DEG + 0.0 * TIME, "beta": 3.0 * DEG + 0.0 * TIME}
    assert [remark.quantity for remark in watch_channels(case("2.d.2"), TIME, flight, model)] == [
        "beta"
    ]


def test_what_cannot_be_compared_is_not():
    """A missing channel, samples without a number, flow angles at rest, a footprint."""
    flight = {"beta": 0.0 * TIME, "V_cas": np.where(TIME < 60.0, 5.0, 60.0), "r": 0.0 * TIME}
    model = {
        "beta": np.where(TIME < 60.0, 1.5, 0.0),
        "V_cas": flight["V_cas"],
        "r": np.full(TIME.size, np.nan),
        "q": TIME,
    }
    assert watch_channels(case("2.c.9"), TIME, flight, model) == ()
    assert (
        watch_channels(case("2.c.9", reference="footprint"), TIME, phugoid(), phugoid(phase=np.pi))
        == ()
    )
    assert set(BANDS) == {"V_cas", "h", "theta", "phi", "psi", "alpha", "beta", "p", "q", "r", "nz"}


@pytest.mark.parametrize(
    ("size", "seconds", "kind"),
    [(8.0, 20.0, "watch"), (16.0, 20.0, "departure"), (16.0, 0.4, "watch")],
)
def test_a_channel_far_off_for_half_a_second_is_a_departure(size, seconds, kind):
    bank = np.where((TIME > 60.0) & (60.0 + seconds > TIME), size * DEG, 0.0)
    model = phugoid() | {"phi": bank}
    (remark,) = watch_channels(case("2.c.9"), TIME, phugoid(), model)
    assert remark.kind == kind
    assert remark.text.startswith("departure: ") == (kind == "departure")
