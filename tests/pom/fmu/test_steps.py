"""FMUs that take steps of one length only, and none that can be instantiated twice."""

import importlib.util
from pathlib import Path

import numpy as np
import pytest

from pom.cases.case import read_case
from pom.fmu.description import read_fmu_interface
from pom.fmu.process import Child
from pom.replaying.replay_case import replay

spec = importlib.util.spec_from_file_location(
    "pom_conftest", (Path(__file__).parents[1] / "conftest.py")
)
tools = importlib.util.module_from_spec(spec)
spec.loader.exec_module(tools)
SIXTIETH = '<DefaultExperiment stepSize="0.016666666666666666"/>'


@pytest.fixture
def fixed(toys):
    """Write a toy that takes steps of 1/60 s only."""

    def write(**changes):
        text = tools.describe("fixed", True, {}, {}).replace('StepSize="true"', 'StepSize="false"')
        for old, new in {"<ModelVariables>": f"{SIXTIETH}<ModelVariables>", **changes}.items():
            text = text.replace(old, new)
        return toys("fixed", text)

    return write


@pytest.fixture
def case(write_case):
    return read_case(write_case(case='show = ["q", "theta"]', more="trim = false"))


def test_it_is_stepped_by_its_own_length_and_read_between(case, fixed, lag_states):
    fmu = read_fmu_interface(fixed())
    assert (fmu.even, fmu.step) == (True, 1.0 / 60.0)
    result = replay(case, {"fixed": fixed()}, lag_states)
    assert result.failure == ""
    error = np.abs(result.signals["theta"][1] - result.signals["theta"][0]).max()
    # inputs and outputs on straight lines: the corner of the ramp lies up to a step away, the curve
    # of theta bends by 0.08 rad/s2
    assert 0.0 < error < 2.0 * 0.02 * (1.0 / 60.0) ** 2 / 0.5
    assert result.status("fixed") == "pass_with_departures"  # it is not trimmed
    assert result.signals["time"].size == 401  # the samples of the record, not of the model


def test_uneven_samples_are_flown_at_even_steps(case, toys, lag_states):
    text = tools.describe("lag", True, {}, {}).replace('StepSize="true"', 'StepSize="false"')
    path = toys("even", text)
    uneven = lag_states.isel(time=np.r_[0:200, 203:501])
    result = replay(case, {"even": path}, uneven)
    assert result.failure == ""
    assert np.abs(result.signals["theta"][1] - result.signals["theta"][0]).max() < 1e-9


def test_a_step_that_divides_the_samples_is_exact_at_them(case, fixed, lag_states):
    sparse = lag_states.interp(
        time=np.arange(0.0, 9.91, 0.1)
    )  # six steps per sample, the corner of the ramp on a sample
    result = replay(case, {"fixed": fixed()}, sparse)
    assert np.abs(result.signals["nz"][1] - result.signals["nz"][0]).max() < 1e-12


@pytest.mark.slow
def test_an_fmu_that_lives_once_per_process_gets_a_new_process_every_time(fixed):
    path = fixed(**{"<CoSimulation ": '<CoSimulation canBeInstantiatedOnlyOncePerProcess="true" '})
    assert read_fmu_interface(path).once
    child = Child(path)
    time = np.arange(0.0, 0.1, 1.0 / 60.0)
    job = {"time": time, "inputs": {}, "parameters": {}, "outputs": ["theta"]}
    assert child.run(job, 20.0, once=True).error == ""
    assert child._foreign is None
    assert child.run(job, 20.0).error == ""
    assert child._foreign is not None
    child.close()
