"""FMI 3.0 from elsewhere: a slave and a model in C with inputs of Float32, Int8, Boolean and
Enumeration.
"""

import importlib.util
import inspect
from pathlib import Path

import numpy as np
import pytest
from fmpy import fmi3

from pom.cases.case import read_case
from pom.replaying.replay_case import replay

spec = importlib.util.spec_from_file_location(
    "pom_conftest", (Path(__file__).parents[1] / "conftest.py")
)
tools = importlib.util.module_from_spec(spec)
spec.loader.exec_module(tools)

DESCRIPTION = """<?xml version="1.0" encoding="UTF-8"?>
<fmiModelDescription fmiVersion="3.0" modelName="toy" instantiationToken="toy">
{kind}
<TypeDefinitions>
<EnumerationType name="Positions"><Item name="up" value="0"/><Item name="down" value="1"/>
</EnumerationType>
</TypeDefinitions>
<ModelVariables>
<Float32 name="delta_e" valueReference="0" causality="input" start="0"/>
<Float64 name="engine1.thrust_drive" valueReference="1" causality="input" start="0"/>
<Boolean name="gear" valueReference="2" causality="input" variability="discrete" start="false"/>
<Int8 name="delta_s" valueReference="3" causality="input" variability="discrete" start="0"/>
<Enumeration name="speedbrake" valueReference="4" causality="input" variability="discrete" declaredType="Positions" start="0"/>
<Float64 name="theta" valueReference="10" causality="output"/>
<Float64 name="q" valueReference="11" causality="output"/>
<Float64 name="nz" valueReference="12" causality="output"/>
{parameters}
</ModelVariables>
<ModelStructure><ContinuousStateDerivative valueReference="11"/></ModelStructure>
</fmiModelDescription>
"""
PARAMETER = (
    '<Float64 name="{}" valueReference="{}" causality="parameter" variability="fixed" start="0"/>'
)
KINDS = {
    "slave": '<CoSimulation modelIdentifier="toy" canHandleVariableCommunicationStepSize="true"/>',
    "model": '<ModelExchange modelIdentifier="toy"/>',
}


@pytest.fixture(scope="session")
def library(tmp_path_factory):
    """The toy with functions that fail for all that it does not have: FMPy looks up every one of
    its class.
    """
    text = (Path(__file__).parents[1] / "toy3.c").read_text()
    known = {
        name
        for kind in (fmi3.FMU3Slave, fmi3.FMU3Model)
        for name, _ in inspect.getmembers(kind)
        if name.startswith("fmi3")
    }
    missing = sorted(name for name in known if f"{name}(" not in text and f"({name}," not in text)
    source = tmp_path_factory.mktemp("toy3") / "toy3.c"
    source.write_text(text + "".join(f"API int {name}(void) {{ return 3; }}\n" for name in missing))
    return tools.compiled(source, source.parent)


@pytest.fixture
def fmu(library, tmp_path):
    def write(kind):
        names = [*tools.PARAMETERS, "mode.engine"]
        parameters = "\n".join(PARAMETER.format(name, 100 + i) for i, name in enumerate(names))
        return tools.write_fmu(
            tmp_path / f"{kind}.fmu",
            DESCRIPTION.format(kind=KINDS[kind], parameters=parameters),
            library,
        )

    return write


@pytest.mark.parametrize(
    ("kind", "error"),
    [
        (
            "slave",
            2.0 * 0.02 * 0.02**2 / (12.0 * 0.5) * 1.01 + 2.0 * 0.14 * 2.0**-24,
        ),  # the middle held, slope h^2/(12 tau), as Float32
        (
            "model",
            2.0 * 0.14 * 2.0**-24 + 1e-7,
        ),  # Float32 of 0.14 rad at most, and the tolerance of CVode
    ],
)
def test_inputs_of_every_type_reach_the_model_at_their_sample(
    write_case, lag_states, fmu, kind, error
):
    case = read_case(write_case(case='show = ["q", "theta"]', more="trim = false"))
    time = lag_states["time"].values
    gear, notch, brake = (
        (time >= 5.0).astype(float),
        np.where(time >= 6.0, -3.0, 0.0),
        (time >= 4.0).astype(float),
    )
    nz = lag_states["nz"].values - 0.1 * gear + 0.01 * notch + 0.001 * brake
    states = lag_states.assign(
        gear=("time", gear), delta_s=("time", notch), speedbrake=("time", brake), nz=("time", nz)
    )
    result = replay(case, {"toy": fmu(kind)}, states)
    assert result.failure == ""
    assert np.abs(result.signals["theta"][1] - result.signals["theta"][0]).max() < error
    assert np.abs(result.signals["nz"][1] - result.signals["nz"][0]).max() < 4.0 * 0.14 * 2.0**-24
    assert result.status("toy") == "pass_with_departures"  # it is not trimmed
