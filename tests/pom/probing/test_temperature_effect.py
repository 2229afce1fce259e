"""A doubtful temperature is weighed by what it moves, in tolerances of the rows."""

import sys
from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest

from flightmech.air import P_SEA, atmosphere, calibrated_airspeed, impact_pressure
from pom.cases.job import ReplayJob
from pom.judging.air_checks import AIR, SPEED
from pom.probing import temperature_effect
from pom.probing.model_probes import with_run_remarks
from pom.tolerances.bands import Judgement, RowRemark

sys.path.insert(0, str(Path(__file__).parents[1]))
import report_fixture as fixture

RUN = "final"
H, WARMTH, V = 2000.0, 25.0, 90.0


def job(time):
    parameters = {"env.delta_T": WARMTH, "env.qnh": 101000.0, "init.V": V, "init.h": H}
    return ReplayJob(time, {}, parameters, (), ())


def doubt(quantity=AIR, error=WARMTH):
    text = "record: the air is +25 K off the standard atmosphere"
    return RowRemark("record_warning", text, quantity, {"error": error}, "K")


def result_with(*remarks, conditions=None):
    result = with_run_remarks(fixture.roll_result(), {RUN: remarks})
    return replace(result, case=replace(result.case, conditions=conditions or {}))


def weigh(result, size, monkeypatch):
    """Return the remarks for an answer whose roll rate moves by `size` of its band."""
    time = result.signals["time"].values
    names = [str(name) for name in result.signals.data_vars]
    outputs = {name: result.signals[name].sel(run="flight").values for name in names}
    # the band of the row is 2 deg/s or 10 %; ours is a change of all channels
    after = {name: values * (1.0 + size) for name, values in outputs.items()}
    monkeypatch.setattr(temperature_effect, "fly_job", lambda *given, **more: (after, ""))
    model = SimpleNamespace(links=SimpleNamespace(outputs=dict.fromkeys(names)))
    return temperature_effect.weigh_temperature(
        result, RUN, model=model, job=job(time), outputs=outputs, timeout=1.0
    )


def test_the_supposed_air_has_the_same_pressure_and_calibrated_airspeed():
    changed = temperature_effect.supposed_air(job(np.arange(3.0)), doubt()).parameters
    pressures, speeds = [], []
    for qnh, delta_T, speed in (
        (101000.0, WARMTH, V),
        (changed["env.qnh"], 0.0, changed["init.V"]),
    ):
        air = atmosphere(H, delta_T)
        p = qnh / P_SEA * float(air.p_static)
        pressures.append(p)
        speeds.append(float(calibrated_airspeed(impact_pressure(speed / air.a_sound, p))))
    assert changed["env.delta_T"] == 0.0
    assert pressures[1] == pytest.approx(pressures[0], rel=1e-12)
    # V ~ sqrt(T) is exact at equal Mach number
    assert speeds[1] == pytest.approx(speeds[0], rel=1e-9)
    # a true airspeed that contradicts the temperature is taken as right
    kept = temperature_effect.supposed_air(job(np.arange(3.0)), doubt(SPEED)).parameters
    assert kept["init.V"] == V


def test_an_effect_of_a_quarter_of_a_tolerance_is_a_departure(monkeypatch):
    (small,) = weigh(result_with(doubt()), 1e-4, monkeypatch)
    assert small.kind == "probe"
    (large,) = weigh(result_with(doubt()), 0.2, monkeypatch)
    assert large.kind == "departure"
    assert "air -25 K off the record moves the answer by" in large.text


def test_a_row_that_fails_without_a_ratio_is_a_departure(monkeypatch):
    def lose_the_mode(*given):
        return Judgement("fail")

    monkeypatch.setattr(temperature_effect, "judge_criterion", lose_the_mode)
    (found,) = weigh(result_with(doubt()), 0.0, monkeypatch)
    assert found.kind == "departure"
    assert "air -25 K off the record makes rows fail that have no ratio: " in found.text


def test_without_doubt_nothing_is_flown(monkeypatch):
    assert weigh(result_with(), 0.2, monkeypatch) == ()
    confirmed = result_with(doubt(), conditions={"delta_T": WARMTH})
    assert weigh(confirmed, 0.2, monkeypatch)[0].kind == "probe"
