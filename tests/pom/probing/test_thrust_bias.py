"""A drag that the trim balances by a thrust that nobody recorded."""

import numpy as np
import pytest

from pom.cases.job import TRIM_THROTTLE, ReplayJob
from pom.probing.thrust_bias import CANCELLING, recorded_thrust_remarks, thrust_bias_remarks

TIME = np.arange(0.0, 5.0, 0.1)
LEVER = np.interp(TIME, [1.0, 2.0], [0.7, 0.4])


def remarks(lever=0.7, output=1000.0, recorded=(), mass=None, **biases):
    """Return the remarks on biases of the trim; `output` is the thrust of the model."""
    parameters = {} if mass is None else {"mass.mass": mass}
    job = ReplayJob(TIME, {"engine1.throttle": lever + 0.0 * TIME}, parameters, (), ())
    outputs = {f"trim.{name}": value + 0.0 * TIME for name, value in biases.items()}
    if output is not None:
        outputs["engine1.thrust"] = output + 0.0 * TIME
    return thrust_bias_remarks(job, outputs, recorded)


@pytest.mark.parametrize(("bias", "kind"), [(49.0, "probe"), (-90.0, "departure")])
def test_a_bias_is_compared_with_the_thrust_of_the_model(bias, kind):
    # the thrust that the model reports holds the bias
    (remark,) = remarks(thrust=bias, output=1000.0 + bias)
    assert remark.kind == kind
    assert remark.values["share"] == pytest.approx(abs(bias) / 1000.0)


def test_a_small_bias_of_a_lever_can_be_a_large_thrust():
    # 2 % of the lever, which is within the 5 % of its limit, at 3000 N per travel
    (remark,) = remarks(lever=LEVER, output=3000.0 * (LEVER + 0.02) - 800.0, throttle=0.02)
    assert remark.values["share"] == pytest.approx(60.0 / 1360.0, rel=1e-6)
    (remark,) = remarks(lever=LEVER, output=3000.0 * (LEVER + 0.03) - 800.0, throttle=0.03)
    assert remark.kind == "departure"
    assert "from +3 % of the lever" in remark.text


@pytest.mark.parametrize(("mass", "kind"), [(1200.0, "probe"), (800.0, "departure")])
def test_a_share_of_hardly_any_thrust_has_no_meaning(mass, kind):
    # 45 N with the engine at idle: 0.0375 m/s2 of the heavier aeroplane, 0.05625 of the other
    (remark,) = remarks(thrust=45.0, output=345.0, mass=mass)
    assert remark.kind == kind
    assert remark.values["share"] == pytest.approx(0.15)
    assert ("0.037 m/s2" in remark.text) == (kind == "probe")


def test_what_has_no_bias_or_a_recorded_thrust_has_no_remark():
    assert remarks() == ()
    # the limits of the trim apply there
    assert remarks(thrust=-90.0, recorded=["engine1.thrust"]) == ()
    (remark,) = remarks(thrust=-90.0, output=None)
    assert remark.kind == "not_probed"


def compared(model, drive="throttle", bias=0.0):
    """Return the remarks on a model of 700 N, more at the start, against a record of 700 N."""
    parameters = {"mass.mass": 500.0, "mode.trim": TRIM_THROTTLE}
    job = ReplayJob(TIME, {f"engine1.{drive}": 0.7 + 0.0 * TIME}, parameters, (), ())
    outputs = {
        "engine1.thrust": np.where(TIME <= 1.0, model, 700.0),
        "trim.throttle": bias + 0.0 * TIME,
    }
    return recorded_thrust_remarks(job, outputs, {"engine1.thrust": 700.0 + 0.0 * TIME})


def test_an_engine_and_a_drag_that_cancel_each_other_differ_from_the_recorded_thrust():
    (fits,) = compared(710.0)
    assert fits.kind == "probe"
    (high,) = compared(770.0)
    assert high.kind == "departure"
    assert high.values["share"] == pytest.approx(0.1)
    assert "Engine and drag of the model are wrong alike" in high.text


def test_a_lever_within_its_limit_can_be_worth_more_than_the_limit_of_the_thrust():
    # 700 N at 74 % of the lever: 4 % of the travel are 38 N, 5.4 % of the recorded thrust
    (_, lever) = compared(700.0, bias=0.04)
    assert lever.kind == "departure"
    assert lever.values["share"] == pytest.approx(0.04 / 0.74)
    assert "moves the lever by +4 % of its travel" in lever.text
    (_, small) = compared(700.0, bias=0.01)
    assert small.kind == "probe"


def test_a_thrust_that_drives_cannot_be_distinguished_from_a_drag():
    (remark,) = compared(700.0, drive="thrust_drive")
    assert (remark.kind, remark.text) == ("probe", CANCELLING)
