"""Control sweeps: force over position, breakout, dead band, force increments, against a control
with friction made by hand.
"""

import numpy as np
import pytest

from flightmech.units import POUND_FORCE
from pom.cases.case_inputs import CaseInputs
from pom.judging.measures.control_forces import motion_directions
from pom.tolerances.bands import remarks_text

TIME = np.arange(0.0, 100.001, 0.02)
COCKPIT = CaseInputs("cockpit", "throttle")


def position(start=5.0, stop=65.0, travel=0.15):
    """Neutral, 0.15 m aft, 0.15 m forward, neutral, in straight lines."""
    part = np.clip((TIME - start) / (stop - start), 0.0, 1.0)
    return travel * np.interp(part, [0.0, 0.25, 0.75, 1.0], [0.0, 1.0, -1.0, 0.0])


def force(x, spring=1000.0, friction=20.0, speed=0.0):
    """Spring and friction: N per m, N; the friction builds up over the first millimetre of
    movement.
    """
    v = np.gradient(x, TIME)
    return spring * x + friction * np.sign(np.where(np.abs(v) < 1e-6, 0.0, v)) + speed * v


def column(x, F, gearing=-1.5):
    return {"column": x, "F_column": F, "delta_e": gearing * x}


def test_a_turn_is_a_move_back_by_more_than_noise():
    x = np.array([0.0, 1.0, 2.0, 1.95, 3.0, 2.0, 1.0, 1.04, 0.0])
    assert list(motion_directions(x, 0.2)) == [1, 1, 1, 1, 1, -1, -1, -1, -1]
    assert list(motion_directions(-x, 0.2)) == [-1, -1, -1, -1, -1, 1, 1, 1, 1]


def test_branches_are_compared_apart(judged):
    """20 N of friction in flight, 20 N the wrong way round in the model: the mean line is the same,
    the branches are 40 N apart.
    """
    x = position()
    got = judged(
        "2.a.1.a", TIME, column(x, force(x)), column(x, force(x, friction=-20.0)), drive=COCKPIT
    )["column_force"]
    assert got["verdict"] == "fail"
    assert abs(got["worst"]) == pytest.approx(40.0 / POUND_FORCE)
    assert remarks_text(got["remarks"]).startswith("3 branches at equal column")


def test_the_percentage_is_of_the_flight_force_at_that_place(judged):
    """Spring 1100 instead of 1000 N/m: at full travel 15 N more on 170 N (10 % are 17, 5 lbf are
    22.2 N).
    """
    x = position()
    got = judged(
        "2.a.1.a", TIME, column(x, force(x)), column(x, force(x, spring=1100.0)), drive=COCKPIT
    )["column_force"]
    assert got["verdict"] == "pass"
    assert got["worst_ratio"] == pytest.approx(15.0 / (5.0 * POUND_FORCE), rel=2e-3)
    stiff = judged(
        "2.a.1.a",
        TIME,
        column(x, force(x, spring=3000.0)),
        column(x, force(x, spring=3290.0)),
        drive=COCKPIT,
    )["column_force"]
    # on the way back 290 x on 10 % of 3000 x - 20, worst where that has come down to 5 lbf, at
    # 0.081 m: 23.4 N of 22.2
    place = (50.0 * POUND_FORCE + 20.0) / 3000.0
    assert stiff["worst_ratio"] == pytest.approx(290.0 * place / (5.0 * POUND_FORCE), rel=1e-3)


def test_equal_place_not_equal_time(judged):
    """The model comes 1 s later to the same places: by time the forces differ by 10 N and at the
    turns by 40 N.
    """
    x, late = position(), position(6.0, 66.0)
    got = judged("2.a.1.a", TIME, column(x, force(x)), column(late, force(late)), drive=COCKPIT)[
        "column_force"
    ]
    assert got["worst_ratio"] < 1e-6
    surface = judged(
        "2.a.1.a", TIME, column(x, force(x)), column(late, force(late), gearing=-1.8), drive=COCKPIT
    )["elevator"]
    assert abs(surface["worst"]) == pytest.approx(np.degrees(0.3 * 0.15), rel=2e-2)  # 2.58 deg of 2
    assert surface["verdict"] == "fail"


def test_a_model_that_does_not_come_there_is_invalid(judged):
    x, short = position(), position(travel=0.12)
    got = judged("2.a.1.a", TIME, column(x, force(x)), column(short, force(short)), drive=COCKPIT)[
        "column_force"
    ]
    assert got["verdict"] == "invalid"
    assert (
        "the model comes through 79 % of the flight's increasing travel of column"
        in remarks_text(got["remarks"])
    )


def test_breakout_is_the_force_at_the_first_movement_both_ways(judged):
    """1 % of the travel is 3 mm: 3 N of spring on 20 N aft and -20 N forward; the model has 28 N: 8
    N of 2 lbf (8.9 N).
    """
    x = position()
    got = judged(
        "2.a.1.a", TIME, column(x, force(x)), column(x, force(x, friction=28.0)), drive=COCKPIT
    )["breakout_force"]
    assert got["worst_ratio"] == pytest.approx(8.0 / (2.0 * POUND_FORCE), rel=1e-6)
    assert remarks_text(got["remarks"]).startswith(
        "increasing: 23.0 N in flight, 31.0 N in the model; decreasing: -23.0 N in flight, "
        "-31.0 N in the model"
    )
    one_way = np.maximum(x, 0.0)
    got = judged(
        "2.a.1.a",
        TIME,
        column(one_way, force(one_way)),
        column(one_way, force(one_way)),
        drive=COCKPIT,
    )["breakout_force"]
    assert (got["verdict"], "decreasing" in remarks_text(got["remarks"])) == ("pass", False)


def test_a_wheel_force_is_torque_over_radius(judged):
    """0.2 m: 3 lbf at the rim are 2.67 N m."""
    x = position(travel=1.0)
    flight = {"wheel": x, "F_wheel": 10.0 * x}
    model = {"wheel": x, "F_wheel": 10.0 * x + 2.0 * np.sign(x)}
    got = judged("2.a.2.a", TIME, flight, model, drive=COCKPIT, conditions={"wheel_radius": 0.2})[
        "wheel_force"
    ]
    assert got["worst_ratio"] == pytest.approx(2.0 / 0.2 / (3.0 * POUND_FORCE))
    without = judged("2.a.2.a", TIME, flight, model, drive=COCKPIT)["wheel_force"]
    assert (without["verdict"], remarks_text(without["remarks"])) == (
        "not_tested",
        "the flight record has no F_rim",
    )


def test_forces_mean_nothing_when_the_surfaces_are_driven(judged):
    """Trap 8."""
    x = position()
    got = judged(
        "2.a.1.a",
        TIME,
        column(x, force(x)),
        column(x, force(x)),
        drive=CaseInputs("recorded", "throttle"),
    )
    assert (
        remarks_text(got["column_force"]["remarks"])
        == "the surfaces are driven, so pilot forces have no meaning"
    )
    assert remarks_text(got["elevator"]["remarks"]).startswith("delta_e is driven by the record")


def test_force_increments_are_above_the_slow_sweep(judged):
    """Alternate method of 2.b: slow sweep 5 to 65 s, rapid one 75 to 79 s (0.15 m/s, damping 200 N
    s/m: 30 N).

    The model has 270 N s/m, 10.5 N more: 2 lbf are 8.9 N.
    """
    x = position() + position(75.0, 79.0)
    events = {
        "static_sweep_start": 5.0,
        "static_sweep_end": 65.0,
        "sweep_start": 75.0,
        "sweep_end": 79.0,
    }
    kwargs = {
        "events": events,
        "drive": COCKPIT,
        "features": ("alternate_method_moderate_or_rapid_sweep",),
    }
    got = judged(
        "2.b.1", TIME, column(x, force(x, speed=200.0)), column(x, force(x, speed=270.0)), **kwargs
    )
    row = got["dynamic_force_increment"]
    assert abs(row["worst"]) * POUND_FORCE == pytest.approx(0.14 * 70.0, rel=1e-3)
    assert row["verdict"] == "fail"
    assert row["width"] == pytest.approx(2.0)  # 10 % of 28 N is less
    static = judged(
        "2.b.1",
        TIME,
        column(x, force(x, 1000.0, speed=200.0)),
        column(x, force(x, 1200.0, speed=200.0)),
        **kwargs,
    )
    assert (
        static["dynamic_force_increment"]["worst_ratio"] < 1e-6
    )  # another spring is the business of the static test
    assert remarks_text(got["p0"]["remarks"]).startswith(
        "applies only with a release instead of sweeps"
    )


def test_dead_band_of_the_steering(judged):
    """CCAR-60 2.a(5): the wheel lags 0.4 deg either way in flight, 0.7 deg in the model: 0.8 and
    1.4 deg between branches.
    """
    pedal = position(travel=0.08)

    def run(lag):
        steering = np.radians(50.0 * pedal / 0.08 - lag * np.sign(np.gradient(pedal)))
        return {"pedal": pedal, "gear.steering": steering}

    standard = {"standard": "CAAC CCAR-60 App A aeroplane simulator tests", "edition": "2005-09-01"}
    got = judged("2.a(5)", TIME, run(0.4), run(0.7), drive=COCKPIT, **standard)
    assert (
        got["nosewheel_deadband"]["flight_value"],
        got["nosewheel_deadband"]["model_value"],
    ) == pytest.approx((0.8, 1.4))
    assert got["nosewheel_deadband"]["worst_ratio"] == pytest.approx(1.2)
    assert got["nosewheel_angle"]["worst_ratio"] == pytest.approx(0.3 / 2.0)


def test_cycles_of_unequal_dead_bands_are_averaged_and_stated(judged):
    """Half of the cycles of the model lag 0.7 deg, the others 0.1 deg: the mean band is 0.8 deg."""
    phase = 4.0 * np.pi * (TIME - TIME[0]) / (TIME[-1] - TIME[0])
    pedal = 0.08 * np.sin(phase)

    def run(lag):
        steering = np.radians(50.0 * pedal / 0.08 - lag * np.sign(np.gradient(pedal)))
        return {"pedal": pedal, "gear.steering": steering}

    standard = {"standard": "CAAC CCAR-60 App A aeroplane simulator tests", "edition": "2005-09-01"}
    halves = np.where(phase < 2.0 * np.pi, 0.7, 0.1)
    got = judged("2.a(5)", TIME, run(0.4), run(halves), drive=COCKPIT, **standard)
    row = got["nosewheel_deadband"]
    alone = [
        judged("2.a(5)", TIME, run(0.4), run(lag), drive=COCKPIT, **standard) for lag in (0.7, 0.1)
    ]
    bands = [item["nosewheel_deadband"]["model_value"] for item in alone]
    assert min(bands) < row["model_value"] < max(bands)
    assert "the cycles differ by" in remarks_text(row["remarks"])
