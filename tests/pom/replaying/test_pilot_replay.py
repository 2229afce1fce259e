"""The math pilot in the child process: a proportional loop around the lag has a closed form, sample
by sample.
"""

from dataclasses import replace as changed

import numpy as np
import pytest

from pom.cases.case import read_case
from pom.cases.case_inputs import CaseInputs
from pom.cases.pilot import PilotLoop
from pom.replaying.replay_case import replay

GAIN, STEP, TAU = 0.4, 0.02, 0.5


@pytest.fixture
def case(write_case):
    """A start 2 deg too high, and a loop that moves the elevator until the pitch attitude is that
    of the flight.
    """
    case = read_case(
        write_case(case='show = ["theta"]', more='trim = false\n[conditions]\ntheta = "2 deg"')
    )
    return changed(
        case,
        drive=CaseInputs(
            surfaces="pilot", trim=False, pilot=(PilotLoop("delta_e", "theta", GAIN, 1.0),)
        ),
    )


@pytest.mark.parametrize(
    ("interpolates", "table"),
    [(True, ""), (False, ""), (True, '[inputs]\ndelta_e = {variable = "Elev"}\n')],
)
def test_the_error_decays_as_the_closed_form(case, toy, lag_states, tmp_path, interpolates, table):
    (tmp_path / "names.toml").write_text(table)
    fmu = toy(interpolates=interpolates, rename={"delta_e": "Elev"} if table else {})
    result = replay(
        case, {"toy": fmu}, lag_states, names={"toy": tmp_path / "names.toml"} if table else None
    )
    assert result.failure == ""
    held = np.exp(-STEP / TAU)
    k = np.arange(result.signals["time"].size)
    # error' = target - theta: over a step it decays by exp(-h/tau), and the held correction takes 2
    # gain (1 - exp(-h/tau)) of it
    error = -np.radians(2.0) * (held - 2.0 * GAIN * (1.0 - held)) ** k
    flight, model = result.signals["theta"].values
    tolerance = (
        1e-13 if interpolates else 2.0 * 0.02 * STEP**2 / (12.0 * TAU) * 1.01
    )  # the middle of a ramp, held
    assert np.abs(flight - model - error).max() < tolerance
    recorded, moved = result.signals["delta_e"].values
    assert np.abs(moved - recorded - GAIN * (flight - model)).max() < 1e-14
    assert moved[0] - recorded[0] == pytest.approx(-GAIN * np.radians(2.0), rel=1e-12)


def test_signs_and_units_of_the_model_are_turned(case, toy, lag_states, tmp_path):
    """An elevator of the opposite sign in the table of names: the same loop, the same flight."""
    (tmp_path / "names.toml").write_text('[inputs]\ndelta_e = {variable = "Elev", sign = -1}\n')
    turned = lag_states.assign(delta_e=-lag_states["delta_e"])
    flipped = changed(
        case,
        drive=CaseInputs(
            surfaces="pilot", trim=False, pilot=(PilotLoop("delta_e", "theta", -GAIN, 1.0),)
        ),
    )
    plain = replay(case, {"toy": toy()}, lag_states)
    strange = replay(
        flipped,
        {"toy": toy(rename={"delta_e": "Elev"})},
        turned,
        names={"toy": tmp_path / "names.toml"},
    )
    assert np.abs(strange.signals["theta"] - plain.signals["theta"]).max() < 1e-15
    assert np.abs(strange.signals["delta_e"] + plain.signals["delta_e"]).max() < 1e-15
