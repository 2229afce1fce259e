"""Model exchange: inputs inside a step, discrete inputs at their sample, events of the FMU."""

import importlib.util
from pathlib import Path

import numpy as np
import pytest

from pom.cases.case import read_case
from pom.replaying.replay_case import replay

spec = importlib.util.spec_from_file_location(
    "pom_conftest", (Path(__file__).parents[1] / "conftest.py")
)
tools = importlib.util.module_from_spec(spec)
spec.loader.exec_module(tools)


def exchanged(text):
    """Return the description of the toy as one for model exchange, with a Boolean and an Integer
    input.
    """
    start = text.index("<CoSimulation")
    text = (
        text[:start]
        + '<ModelExchange modelIdentifier="toy"/>'
        + text[text.index("/>", start) + 2 :]
    )
    gear = (
        '<ScalarVariable name="gear" valueReference="2" causality="input" '
        'variability="discrete"><Boolean start="0"/></ScalarVariable>'
    )
    notch = (
        '<ScalarVariable name="delta_s" valueReference="3" causality="input" '
        'variability="discrete"><Integer start="0"/></ScalarVariable>'
    )
    text = text.replace("</ModelVariables>", f"{gear}{notch}</ModelVariables>")
    return text.replace(
        "<ModelStructure/>",
        '<ModelStructure><Derivatives><Unknown index="4"/></Derivatives></ModelStructure>',
    )


@pytest.fixture
def model(toys):
    return lambda kind="lag": toys(f"{kind}_me", exchanged(tools.describe(kind, False, {}, {})))


@pytest.fixture
def case(write_case):
    return read_case(write_case(case='show = ["q", "theta"]', more="trim = false"))


def test_the_right_hand_side_sees_inputs_inside_a_step(case, model, lag_states):
    coarse = lag_states.isel(
        time=slice(None, None, 25)
    )  # 0.5 s: FMPy's own loop holds the input that long and is 13 mrad off
    result = replay(case, {"me": model()}, coarse)
    assert result.failure == ""
    assert (
        np.abs(result.signals["theta"][1] - result.signals["theta"][0]).max() < 5e-7
    )  # CVode, 1e-8 per step
    assert np.abs(result.signals["nz"][1] - result.signals["nz"][0]).max() < 1e-14


def test_discrete_inputs_change_at_their_sample(case, model, lag_states):
    time = lag_states["time"].values
    gear, spoiler = (time >= 5.0).astype(float), np.where(time >= 6.0, 3.0, 0.0)
    nz = lag_states["nz"].values - 0.1 * gear + 0.01 * spoiler
    states = lag_states.assign(gear=("time", gear), delta_s=("time", spoiler), nz=("time", nz))
    result = replay(case, {"me": model()}, states)
    assert result.failure == ""
    assert np.abs(result.signals["nz"][1] - result.signals["nz"][0]).max() < 1e-14


def test_a_pulse_is_not_stepped_over(case, model, toy, lag_states):
    time = lag_states["time"].values
    pulse = lag_states.assign(delta_e=("time", 0.1 * ((time > 5.0) & (time < 5.09))))
    result = replay(case, {"me": model(), "slave": toy()}, pulse)
    me, slave = (result.signals["theta"].sel(run=run).values for run in ("me", "slave"))
    assert slave.max() > 0.02
    assert np.abs(me - slave).max() < 1e-6  # two kinks for each of two steps of CVode


def test_a_time_event_between_samples_is_met(case, model, lag_states):
    result = replay(case, {"me": model("event")}, lag_states)
    after = np.maximum(
        result.signals["time"].values - 1.0 - 3.01, 0.0
    )  # the replay starts at 1 s of the record
    jump = 0.05 * 0.5 * (1.0 - np.exp(-after / 0.5))
    difference = result.signals["theta"][1].values - result.signals["theta"][0].values
    assert (
        np.abs(difference - jump).max() < 5e-7
    )  # an error of 1e-8 per step, some ten of them remembered; seen 1.1e-7


@pytest.mark.parametrize("side", [0.0, 9.0])
def test_an_event_that_differs_from_a_sample_by_rounding_is_that_sample(
    case, model, lag_states, side
):
    """CVode refuses to integrate over 1e-16 s."""
    time = lag_states["time"].values
    states = tools.lag_flight(np.sort([*time, np.nextafter(4.01, side)]))
    result = replay(case, {"me": model("event")}, states)
    assert result.failure == ""
    sample = int(np.argmin(np.abs(states["time"].values - 4.01))) - int(
        np.argmin(np.abs(states["time"].values - 1.0))
    )
    assert 0.0 < abs(result.signals["time"].values[sample] - 1.0 - 3.01) < 1e-14
    q = result.signals["q"]
    assert float(q[1][sample] - q[0][sample]) == pytest.approx(0.05, abs=1e-6)


def test_a_control_law_in_model_exchange_is_integrated_next_to_the_model(
    toys, toy, write_case, lag_states, tmp_path
):
    """A lag of the column as the law: its output after a step of the column is known in closed
    form, at the samples.
    """
    law = toys("law_me", exchanged(tools.describe("lag", False, {"delta_e": ""}, {})))
    (tmp_path / "law.toml").write_text(
        '[inputs]\ncolumn = "delta_e"\n[outputs]\ndelta_e = '
        '"theta"\n[fixed]\n"engine1.thrust_drive" = 0.0\ndelta_s = 0.0\n'
    )
    (tmp_path / "law.fmu").write_bytes(law.read_bytes())
    more = 'trim = false\n[control_law]\nfmu = "law.fmu"\nnames = "law.toml"\nmoves = ["delta_e"]\n'
    case = read_case(write_case(case='show = ["theta"]', more=more))
    result = replay(
        case,
        {"cs": toy()},
        lag_states.drop_vars("delta_e").assign(
            column=("time", np.full(lag_states.sizes["time"], 0.01))
        ),
    )
    assert result.failure == ""
    elapsed = result.signals["time"].values - result.signals["time"].values[0]
    elevator = result.signals["delta_e"].values[1]
    assert (
        np.abs(elevator - 2.0 * 0.01 * (1.0 - np.exp(-elapsed / 0.5))).max() < 5e-7
    )  # CVode, as above
