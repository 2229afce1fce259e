import math

import numpy as np
import pytest

from pom.criteria import Band, Criterion, Limit
from pom.measures import end_value, response, steady, trend
from pom.tolerance import Invalid

TIME = np.arange(0.0, 30.001, 0.02)
DEG = math.pi / 180.0
TWO_DEG = Band((Limit("percent", 10.0, "%"), Limit("absolute", 2.0, "deg")), "greater_of", "ref_local")


def criterion(measure, channel="phi", band=TWO_DEG, window=(0.0, 30.0)):
    return Criterion("c", "", channel, measure, "g", band, window)


def test_snapshot_compares_means_of_a_steady_window():
    flight = {"phi": np.full(TIME.size, 10.0 * DEG) + 0.2 * DEG * np.sin(2.0 * np.pi * TIME)}
    model = {"phi": np.full(TIME.size, 11.0 * DEG)}
    got = steady(criterion("steady"), TIME, flight, model, capture=20.0)
    assert got.verdict == "pass"
    assert got.worst / DEG == pytest.approx(1.0, abs=1e-3)
    assert got.worst_ratio == pytest.approx(0.5, abs=1e-3)


def test_snapshot_of_a_drifting_record_is_invalid():
    level = np.full(TIME.size, 10.0 * DEG)
    drifting = level + 0.2 * DEG * TIME  # 1 deg in 5 s, one third of 2 deg is 0.67
    with pytest.raises(Invalid, match=r"flight is not steady: drift 0.50"):
        steady(criterion("steady"), TIME, {"phi": drifting}, {"phi": level}, 20.0)
    with pytest.raises(Invalid, match="the model is not steady"):
        steady(criterion("steady"), TIME, {"phi": level}, {"phi": drifting}, 20.0)


def test_snapshot_needs_4_s_before_and_1_s_after():
    level = {"phi": np.zeros(TIME.size)}
    with pytest.raises(Invalid, match=r"the window is -1.00 ... 4.00 s"):
        steady(criterion("steady"), TIME, level, level, 3.0)


def test_spiral_is_judged_by_the_bank_at_the_end():
    flight = {"phi": 20.0 * DEG * np.exp(-TIME / 60.0)}  # 20 s after 5 s: 20 exp(-25/60) = 13.18 deg
    model = {"phi": flight["phi"] + np.where(TIME < 20.0, 5.0 * DEG, 1.0 * DEG)}
    got = end_value(criterion("end_value", window=(5.0, 25.0)), TIME, flight, model)
    assert (got.verdict, got.at) == ("pass", 25.0)
    assert got.worst_ratio == pytest.approx(0.5, rel=1e-9)  # 2 deg governs over 10 % of 13.18 deg


def test_engine_response_times():
    def run(tau):
        return {"n": np.where(TIME < 2.0, 1000.0, 3000.0 - 2000.0 * np.exp(-np.maximum(TIME - 2.0, 0.0) / tau))}

    band = Band((Limit("percent", 10.0, "%"), Limit("absolute", 0.25, "s")), "greater_of", "ref_scalar")
    flight = {"engine1.thrust": run(1.0)["n"]}
    model = {"engine1.thrust": run(2.0)["n"]}
    got = response(criterion("response_initial", "engine1.thrust", band, (2.0, 30.0)), TIME, flight, model)
    # time to 10 % of a lag of tau: -ln(0.9) tau
    assert got.worst == pytest.approx(-math.log(0.9) * (2.0 - 1.0), abs=2e-3)
    assert got.verdict == "pass"  # 0.105 s of 0.25 s
    got = response(criterion("response_total", "engine1.thrust", band, (2.0, 30.0)), TIME, flight, model)
    # 90 % of 3000 N: 3000 - 2000 exp(-t/tau) = 2700
    assert got.worst == pytest.approx(math.log(2000.0 / 300.0), abs=2e-3)
    assert got.verdict == "fail"


def test_a_power_level_never_reached_is_invalid():
    flight = {"engine1.thrust": np.where(TIME < 2.0, 1000.0, 3000.0)}
    model = {"engine1.thrust": np.full(TIME.size, 1000.0)}
    with pytest.raises(Invalid, match="the model does not reach"):
        response(criterion("response_total", "engine1.thrust", Band((Limit("percent", 10.0, "%"),)), (1.0, 30.0)), TIME, flight, model)


def test_trend_is_advice_only():
    flight = {"phi": 20.0 * DEG * np.exp(-TIME / 60.0)}
    same = trend(criterion("trend"), TIME, flight, {"phi": 0.5 * flight["phi"]})
    # 20 (exp(-0.5) - 1) = -7.87 deg
    assert same.note.startswith("change of flight -7.87 deg, of model -3.93 deg, correlation 1.00")
    assert same.verdict == "advisory"
    opposite = trend(criterion("trend"), TIME, flight, {"phi": -flight["phi"]})
    assert "of model +7.87 deg, correlation -1.00" in opposite.note
