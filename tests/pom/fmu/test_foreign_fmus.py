"""FMUs that know nothing of ours: plain C by the headers of the standards, in degrees, with their
own names and no modes.
"""

import importlib.util
import inspect
import re
import subprocess
import sys
from dataclasses import replace
from pathlib import Path

import fmpy
import numpy as np
import pytest
from fmpy import fmi2, fmi3

from flightmech.errors import SchemaError
from pom.cases.case import read_case
from pom.fmu.description import read_fmu_interface
from pom.fmu.variable_map import links_of
from pom.replaying.batch import replay_all
from pom.replaying.replay_case import replay
from pom.result_notices import run_notices

SOURCES = Path(__file__).parents[1] / "foreign"
HEADERS = Path(fmpy.__file__).parent / "c-code"
spec = importlib.util.spec_from_file_location("pom_conftest", SOURCES.with_name("conftest.py"))
tools = importlib.util.module_from_spec(spec)
spec.loader.exec_module(tools)

DESCRIPTIONS = {
    2: """<?xml version="1.0" encoding="UTF-8"?>
<fmiModelDescription fmiVersion="2.0" modelName="sim" guid="sim">
<CoSimulation modelIdentifier="toy" canHandleVariableCommunicationStepSize="true"/>
<UnitDefinitions><Unit name="deg"/><Unit name="deg/s"/></UnitDefinitions>
<TypeDefinitions><SimpleType name="Switch"><Enumeration><Item name="off" value="0"/>
<Item name="on" value="1"/></Enumeration></SimpleType>
</TypeDefinitions>
<ModelVariables>
<ScalarVariable name="ELEV" valueReference="1" causality="input"><Real start="0"/></ScalarVariable>
<ScalarVariable name="PITCH" valueReference="2" causality="output"><Real unit="deg"/>
</ScalarVariable>
<ScalarVariable name="PITCH_RATE" valueReference="3" causality="output"><Real unit="deg/s"/>
</ScalarVariable>
<ScalarVariable name="NZ" valueReference="4" causality="output"><Real/></ScalarVariable>
<ScalarVariable name="PITCH_IC" valueReference="5" causality="parameter" variability="fixed">
<Real unit="deg" start="0"/></ScalarVariable>
<ScalarVariable name="ACTUATOR" valueReference="6" causality="input" variability="discrete">
<Enumeration declaredType="Switch" start="0"/>
</ScalarVariable>
</ModelVariables><ModelStructure/></fmiModelDescription>
""",
    3: """<?xml version="1.0" encoding="UTF-8"?>
<fmiModelDescription fmiVersion="3.0" modelName="sim" instantiationToken="sim">
<CoSimulation modelIdentifier="toy" canHandleVariableCommunicationStepSize="true"/>
<UnitDefinitions><Unit name="deg"/><Unit name="deg/s"/></UnitDefinitions>
<TypeDefinitions><EnumerationType name="Switch"><Item name="off" value="0"/>
<Item name="on" value="1"/></EnumerationType></TypeDefinitions>
<ModelVariables>
<Float64 name="ELEV" valueReference="1" causality="input" start="0"/>
<Float64 name="PITCH" valueReference="2" causality="output" unit="deg"/>
<Float64 name="PITCH_RATE" valueReference="3" causality="output" unit="deg/s"/>
<Float64 name="NZ" valueReference="4" causality="output"/>
<Float64 name="PITCH_IC" valueReference="5" causality="parameter" variability="fixed" unit="deg" start="0"/>
<Enumeration name="ACTUATOR" valueReference="6" causality="input" variability="discrete" declaredType="Switch" start="0"/>
</ModelVariables><ModelStructure/></fmiModelDescription>
""",
}
LACKING = [
    "engine1.thrust_drive",
    "init.V",
    "init.phi",
    "init.psi",
    "init.p",
    "init.q",
    "init.r",
    "init.h",
    "mode.engine",
]
NAMES = """waived = {waived}
[inputs]
delta_e = {{ variable = "ELEV", unit = "deg", sign = -1 }}
[outputs]
theta = "PITCH"
q = "PITCH_RATE"
nz = "NZ"
[parameters]
"init.theta" = "PITCH_IC"
[fixed]
ACTUATOR = 1
"""


@pytest.fixture(scope="module", params=[2, 3])
def foreign(request, tmp_path_factory):
    """An FMU of FMI 2.0 or 3.0; what the sources do not need for a replay is there and fails, for
    FMPy looks it up.
    """
    folder = tmp_path_factory.mktemp(f"foreign{request.param}")
    source = SOURCES / f"slave{request.param}.c"
    kind = {2: fmi2.FMU2Slave, 3: fmi3.FMU3Slave}[request.param]
    known = {name for name, _ in inspect.getmembers(kind) if re.match(r"fmi[23][A-Z]", name)}
    words = (HEADERS / f"fmi{request.param}Functions.h").read_text()
    known |= set(re.findall(rf"TYPE\s+(fmi{request.param}\w+);", words))
    missing = sorted(name for name in known if f"{name}(" not in source.read_text())
    (folder / "missing.c").write_text(
        "".join(f"int {name}(void) {{ return 3; }}\n" for name in missing)
    )
    library = folder / f"toy{fmpy.sharedLibraryExtension}"
    command = [
        sys.executable,
        "-m",
        "ziglang",
        "cc",
        "-shared",
        "-fPIC",
        "-O1",
        f"-I{HEADERS}",
        f"-I{SOURCES}",
        "-Wall",
        "-Werror",
    ]
    subprocess.run(
        [*command, "-o", str(library), str(source), str(folder / "missing.c")],
        check=True,
        capture_output=True,
    )
    return tools.write_fmu(folder / "sim.fmu", DESCRIPTIONS[request.param], library)


@pytest.fixture
def table(tmp_path):
    def write(waived):
        (tmp_path / "names.toml").write_text(NAMES.format(waived=waived))
        return tmp_path / "names.toml"

    return write


@pytest.mark.slow
def test_a_simulator_with_names_of_its_own_replays(foreign, table, write_case, lag_states):
    case = read_case(write_case(case='show = ["theta", "q"]', more="trim = false"))
    result = replay(case, {"sim": foreign}, lag_states, names={"sim": table(LACKING)})
    assert result.failure == ""
    # inputs and parameters that the simulator does not have are waived: a departure
    assert result.status("sim") == "pass_with_departures"
    # the middle of a step is held, an error of s h^2/(12 tau), and 5 ms steps of the fourth order
    assert (
        np.abs(result.signals["theta"][1] - result.signals["theta"][0]).max()
        < 2.0 * 0.02 * 0.02**2 / (12.0 * 0.5) * 1.01
    )
    untrimmed, *notices = run_notices(result, "sim")
    assert "without trim (drive.trim = false)" in untrimmed
    assert notices == [
        "not checked: record not compared with those that identified: the FMU does not hold the "
        "samples that identified it",
        f"flown without {', '.join(LACKING)}, waived by the table of names",
    ]


@pytest.mark.slow
def test_what_a_simulator_lacks_is_listed_once_for_all_cases(
    foreign, table, write_case, lag_states
):
    case = read_case(write_case(more="trim = false"))
    second = replace(case, name="second")
    with pytest.raises(SchemaError) as caught:
        replay_all(
            [case, second],
            {"sim": foreign},
            {"record": lag_states},
            names={"sim": table(LACKING[2:])},
        )
    assert [text.split("'")[1] for text in caught.value.problems] == [
        "engine1.thrust_drive",
        "init.V",
    ]
    assert all(text.startswith(f"FMU {foreign} (sim): unknown ") for text in caught.value.problems)
    assert all(
        text.endswith("or waive an input or parameter there; case a_case, second")
        for text in caught.value.problems
    )


def test_what_is_waived_must_be_needed_and_absent(toy, tmp_path):
    (tmp_path / "names.toml").write_text('waived = ["delta_e", "mode.engine", "delta_x"]\n')
    with pytest.raises(SchemaError) as caught:
        links_of(read_fmu_interface(toy()), tmp_path / "names.toml")
    assert caught.value.problems == [
        "waived: the FMU has 'delta_e' as 'delta_e'; delete it from the list",
        "waived: the FMU has 'mode.engine' as 'mode.engine'; delete it from the list",
        "waived: 'delta_x' is not a canonical name of an input or parameter",
    ]
