"""FMI 1.0: a slave and a model in C with degrees, a nose-down elevator, Booleans and an Integer,
joined by a table of names.
"""

import importlib.util
from pathlib import Path

import numpy as np
import pytest

from pom.cases.case import read_case
from pom.fmu.description import read_fmu_interface
from pom.replaying.replay_case import replay

spec = importlib.util.spec_from_file_location(
    "pom_conftest", (Path(__file__).parents[1] / "conftest.py")
)
tools = importlib.util.module_from_spec(spec)
spec.loader.exec_module(tools)

VARIABLE = '<ScalarVariable name="{}" valueReference="{}" {}><{}/></ScalarVariable>'
SLAVE = """<Implementation><CoSimulation_StandAlone>
<Capabilities canHandleVariableCommunicationStepSize="true" canInterpolateInputs="{}"/>
</CoSimulation_StandAlone></Implementation>"""
DESCRIPTION = """<?xml version="1.0" encoding="UTF-8"?>
<fmiModelDescription fmiVersion="1.0" modelName="toy" modelIdentifier="toy" guid="{guid}" numberOfContinuousStates="1"
 numberOfEventIndicators="0">
<ModelVariables>
{variables}
</ModelVariables>
{implementation}
</fmiModelDescription>
"""
NAMES = """
[inputs]
delta_e = {variable = "Elevator", sign = -1}
gear = "Down"
delta_f = {variable = "Notch", scale = "10 deg"}
brake_left = "Lever"
"engine1.thrust_drive" = {variable = "Thrust", unit = "lbf"}
[outputs]
theta = "Pitch"
q = {variable = "PitchRate", unit = "deg/s"}
nz = "LoadFactor"
[parameters]
"init.theta" = {variable = "Pitch0", unit = "deg"}
"init.V" = {variable = "V0", unit = "kt"}
"init.phi" = "P2"
"init.psi" = "P3"
"init.p" = "P4"
"init.q" = "P5"
"init.r" = "P6"
"init.h" = {variable = "P7", unit = "ft"}
"mode.engine" = "P8"
"""


def describe(guid="lag", slave=True, interpolates=True):
    start, real = 'variability="parameter" causality="internal"', 'Real start="0"'
    rows = [
        ("Elevator", 0, 'causality="input"', 'Real unit="deg"'),
        ("Thrust", 1, 'causality="input"', "Real"),
    ]
    rows += [
        ("Down", 2, 'causality="input" variability="discrete"', "Boolean"),
        ("Lever", 4, 'causality="input"', "Boolean"),
    ]
    rows += [("Notch", 3, 'causality="input" variability="discrete"', "Integer")]
    rows += [
        ("Pitch", 10, 'causality="output"', 'Real unit="deg"'),
        ("PitchRate", 11, 'causality="output"', "Real"),
    ]
    rows += [("LoadFactor", 12, 'causality="output"', "Real")]
    rows += [
        ("V0", 100, start, real),
        ("Pitch0", 101, start, real),
        *((f"P{i}", 100 + i, start, real) for i in range(2, 9)),
    ]
    implementation = SLAVE.format(str(interpolates).lower()) if slave else ""
    variables = "\n".join(VARIABLE.format(*row) for row in rows)
    return DESCRIPTION.format(guid=guid, variables=variables, implementation=implementation)


@pytest.fixture(scope="module")
def fmu(tmp_path_factory):
    write = tools.once(tmp_path_factory, tools.compiled("toy1.c", tmp_path_factory.mktemp("toy1")))
    return lambda **kinds: write("lag", describe(**kinds))


@pytest.fixture
def case(write_case):
    return read_case(write_case(case='show = ["q", "theta"]', more="trim = false"))


@pytest.fixture
def names(tmp_path):
    path = tmp_path / "names.toml"
    path.write_text(NAMES)
    return path


@pytest.fixture
def flown(case, names, lag_states):
    """Return results of models against a flight with the gear going out at 5 s and 20 deg of flaps
    from 6 s on.
    """
    time = lag_states["time"].values
    gear, flap = (time >= 5.0).astype(float), np.where(time >= 6.0, np.radians(20.0), 0.0)
    nz = lag_states["nz"].values - 0.1 * gear + 0.02 * (flap > 0.0) + 0.001 * (time >= 4.0)
    lever = (time >= 4.0).astype(float)
    states = lag_states.assign(
        gear=("time", gear), delta_f=("time", flap), nz=("time", nz), brake_left=("time", lever)
    )
    return lambda **runs: replay(case, runs, states, names=dict.fromkeys(runs, names))


def worst(result, channel, run=1):
    return np.abs(result.signals[channel][run] - result.signals[channel][0]).max()


def test_a_slave_with_input_derivatives_is_exact_in_the_canonical_sign_and_unit(flown, fmu):
    result = flown(slave=fmu())
    assert result.failure == ""
    assert worst(result, "theta") < 1e-14
    assert (
        worst(result, "nz") < 1e-14
    )  # Booleans and the Integer are read at their sample, not one later
    assert result.status("slave") == "pass_with_departures"  # it is not trimmed
    assert result.signals.attrs["model.slave"].startswith("lag.fmu, FMI 1.0, sha256 ")
    assert result.signals.attrs["names.slave"].startswith("names.toml, sha256 ")


def test_a_slave_without_them_holds_the_middle(flown, fmu):
    error = worst(flown(held=fmu(interpolates=False)), "theta")
    assert 0.0 < error < 2.0 * 0.02 * 0.02**2 / (12.0 * 0.5) * 1.01  # slope h^2/(12 tau)


@pytest.mark.slow
def test_a_model_for_exchange_is_integrated_by_us(flown, fmu):
    result = flown(exchange=fmu(slave=False))
    assert result.failure == ""
    assert worst(result, "theta") < 1e-7  # CVode, relative tolerance 1e-8 per step
    assert worst(result, "nz") < 1e-14
    assert ", model exchange, sha256 " in result.signals.attrs["model.exchange"]


@pytest.mark.parametrize(
    ("guid", "message"),
    [
        ("error", "the step to t = 2.02 s failed"),
        ("refuse", "initialisation failed: fmi1InitializeSlave"),
    ],
)
def test_a_status_that_fmpy_takes_for_a_text_is_an_error_and_not_a_crash(flown, fmu, guid, message):
    result = flown(bad=fmu(guid=guid))
    assert message in result.failure
    assert "crashed" not in result.failure
    assert result.status("bad") == "invalid"


def test_the_words_of_the_fmu_come_with_their_numbers(flown, fmu):
    assert "flap 2 has left the wing" in flown(bad=fmu(guid="error")).failure


def test_the_capabilities_that_fmpy_leaves_out_are_read(fmu):
    assert not read_fmu_interface(fmu()).even
    assert not read_fmu_interface(fmu()).once
