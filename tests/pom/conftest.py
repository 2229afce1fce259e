import importlib.util
import subprocess
import sys
import zipfile
from pathlib import Path

import numpy as np
import pytest
import xarray as xr

sys.path.insert(0, str(Path(__file__).parent))  # for report_fixture

TEXT = """
[case]
id = "{id}"
name = "a_case"
title = "A case"
record = "record.nc"
window = [1.0, 9.0]
{case}
[drive]
engine = "thrust"
{more}
"""


@pytest.fixture
def write_case(tmp_path):
    """Write a case file next to an empty record and return its path."""

    def write(id="2.c.10", case="", more=""):
        (tmp_path / "record.nc").touch()
        path = tmp_path / "case.toml"
        path.write_text(TEXT.format(id=id, case=case, more=more))
        return path

    return write


PARAMETERS = (
    "init.V",
    "init.theta",
    "init.phi",
    "init.psi",
    "init.p",
    "init.q",
    "init.r",
    "init.h",
    "mass.mass",
)
VARIABLE = (
    '<ScalarVariable name="{}" valueReference="{}" causality="{}" variability="{}"><{} '
    "{}/></ScalarVariable>"
)
DESCRIPTION = """<?xml version="1.0" encoding="UTF-8"?>
<fmiModelDescription fmiVersion="2.0" modelName="toy" guid="{kind}">
<CoSimulation modelIdentifier="toy" canHandleVariableCommunicationStepSize="true" canInterpolateInputs="{interpolates}"/>
<UnitDefinitions><Unit name="rad"/><Unit name="deg"/><Unit name="rad/s"/><Unit name="1"/>
</UnitDefinitions>
<ModelVariables>
{variables}
</ModelVariables><ModelStructure/></fmiModelDescription>
"""


def describe(kind, interpolates, units, rename):
    rows = [
        ("delta_e", 0, "input", units.get("delta_e", "rad")),
        ("engine1.thrust_drive", 1, "input", ""),
    ]
    rows += [
        ("theta", 10, "output", units.get("theta", "rad")),
        ("q", 11, "output", "rad/s"),
        ("nz", 12, "output", "1"),
    ]
    rows += [(name, 100 + i, "parameter", "") for i, name in enumerate(PARAMETERS)]
    variables = []
    for name, reference, causality, unit in rows:
        variability = "fixed" if causality == "parameter" else "continuous"
        kinds = (f'unit="{unit}" ' if unit else "") + ("" if causality == "output" else 'start="0"')
        variables.append(
            VARIABLE.format(
                rename.get(name, name), reference, causality, variability, "Real", kinds
            )
        )
    variables.append(
        VARIABLE.format("mode.engine", 120, "parameter", "fixed", "Integer", 'start="0"')
    )
    return DESCRIPTION.format(
        kind=kind, interpolates=str(interpolates).lower(), variables="\n".join(variables)
    )


def compiled(source, folder):
    """Compile a C file, of this folder or with its place, into a shared library of an FMU."""
    from fmpy import sharedLibraryExtension

    place = folder / f"toy{sharedLibraryExtension}"
    command = [
        sys.executable,
        "-m",
        "ziglang",
        "cc",
        "-shared",
        "-fPIC",
        "-O1",
        "-w",
        "-fno-sanitize=undefined",
        "-o",
        str(place),
    ]
    subprocess.run([*command, str(Path(__file__).parent / source)], check=True, capture_output=True)
    return place


def write_fmu(path, description, library):
    """Write an FMU of a description and a library."""
    from fmpy import platform, platform_tuple

    folder = platform_tuple if 'fmiVersion="3' in description else platform
    with zipfile.ZipFile(path, "w") as file:
        file.writestr("modelDescription.xml", description)
        file.write(library, f"binaries/{folder}/{library.name}")
    return path


@pytest.fixture(scope="session")
def toy_library(tmp_path_factory):
    """The shared library of the toy FMU, compiled once."""
    return compiled("toy.c", tmp_path_factory.mktemp("toy"))


@pytest.fixture(scope="session")
def toys(toy_library, tmp_path_factory):
    """Write a toy FMU of a description, once for each: its child process serves all tests."""
    return once(tmp_path_factory, toy_library)


def once(factory, library):
    """Return a function that writes an FMU of a name and a description and keeps it."""
    written = {}

    def write(name, description):
        if (name, description) not in written:
            written[name, description] = write_fmu(
                factory.mktemp("fmu") / f"{name}.fmu", description, library
            )
        return written[name, description]

    return write


@pytest.fixture
def toy(toys):
    """Write a toy FMU: first-order lag, or ``crash``, ``hang``, ``error``, ``nan``."""

    def write(kind="lag", interpolates=True, units=None, rename=None):
        return toys(
            f"{kind}{'' if interpolates else '_held'}",
            describe(kind, interpolates, units or {}, rename or {}),
        )

    return write


@pytest.fixture(scope="session")
def bad(tmp_path_factory):
    """Write an FMU of bad.c that does a kind of harm."""
    folder = tmp_path_factory.mktemp("bad")
    library = compiled("bad.c", folder)
    return lambda kind: write_fmu(
        folder / f"{kind.replace(':', '_')}.fmu", describe(kind, True, {}, {}), library
    )


LAW_ROW = (
    '<ScalarVariable name="{}" valueReference="{}" causality="{}" '
    'variability="continuous"><Real unit="{}" {}/></ScalarVariable>'
)
LAW_ABOUT = """<?xml version="1.0" encoding="UTF-8"?>
<fmiModelDescription fmiVersion="2.0" modelName="law" guid="{guid}">
<CoSimulation modelIdentifier="toy" canHandleVariableCommunicationStepSize="{any_step}"/>
<DefaultExperiment stepSize="0.01"/>
<UnitDefinitions><Unit name="rad"/><Unit name="deg"/><Unit name="rad/s"/><Unit name="deg/s"/>
<Unit name="m"/><Unit name="s"/></UnitDefinitions>
<ModelVariables>{rows}<ScalarVariable name="gain" valueReference="3" causality="parameter" variability="fixed"><Real unit="s" start="0.1"/>
</ScalarVariable></ModelVariables><ModelStructure/></fmiModelDescription>"""


@pytest.fixture(scope="session")
def law_library(tmp_path_factory):
    """The shared library of a control law, compiled once."""
    return compiled("law.c", tmp_path_factory.mktemp("law"))


@pytest.fixture
def law(law_library, tmp_path):
    """Write the FMU of the law next to the case."""

    def write(
        guid="plain", any_step=True, names=("column", "q", "delta_e"), units=("m", "rad/s", "rad")
    ):
        causes = ("input", "input", "output")
        starts = ('start="0"', 'start="0"', "")
        rows = "".join(
            LAW_ROW.format(*row) for row in zip(names, range(3), causes, units, starts, strict=True)
        )
        return write_fmu(
            tmp_path / "law.fmu",
            LAW_ABOUT.format(guid=guid, any_step=str(any_step).lower(), rows=rows),
            law_library,
        )

    return write


@pytest.fixture
def lag_states():
    """Flight states of the toy itself for an elevator ramp, exact at the samples: 10 s at 50 Hz."""
    return lag_flight(np.round(np.arange(0.0, 10.01, 0.02), 9))


def lag_flight(time, rate=0.02, start=2.0):
    delta_e = rate * np.maximum(time - start, 0.0)
    after = np.maximum(time - start, 0.0)
    theta = (
        2.0 * rate * (after - 0.5 * (1.0 - np.exp(-after / 0.5)))
    )  # theta' = (2 delta_e - theta) / 0.5
    zero = np.zeros_like(time)
    data = {
        name: zero
        for name in (
            "alpha",
            "beta",
            "phi",
            "psi",
            "p",
            "r",
            "delta_a",
            "delta_r",
            "delta_f",
            "gear",
        )
    }
    data |= {
        "V": zero + 80.0,
        "h": zero + 1000.0,
        "delta_e": delta_e,
        "theta": theta,
        "q": (2.0 * delta_e - theta) / 0.5,
    }
    data |= {"nz": 1.0 - 4.0 * delta_e, "engine1.thrust": zero + 3000.0, "mass": zero + 2900.0}
    return xr.Dataset(
        {name: ("time", values) for name, values in data.items()}, coords={"time": time}
    )


@pytest.fixture(scope="session")
def trainer():
    """The module ``trainer.py`` next to this file: an invented aeroplane and flights of it."""
    spec = importlib.util.spec_from_file_location(
        "pom_trainer", Path(__file__).with_name("trainer.py")
    )
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


@pytest.fixture
def judged():
    """Judge the rows of a test on signals made by hand; returns the verdict rows by criterion."""
    from pom.cases.case import PomCase
    from pom.cases.case_inputs import CaseInputs
    from pom.judging.applicability import settle_case
    from pom.judging.verdict import judge_criterion, verdict_row
    from pom.tolerances import rows as table

    def judge_rows(
        id,
        time,
        flight,
        model,
        standard=table.STANDARD,
        edition=table.EDITION,
        drive=None,
        window=None,
        **more,
    ):
        events, features = more.get("events", {}), more.get("features", ())
        found = table.rows_of_test(id, standard, edition)
        criteria = []
        for item, name in zip(found, table.names_of(found), strict=True):
            marks = {event: time[0] for event in table.window_events()} | events
            ends = zip(("applies_from", "applies_to"), window or (time[0], time[-1]), strict=True)
            start, stop = (float(table.bound_time(item[key], marks, end)) for key, end in ends)
            inside = (max(start, time[0]), min(stop, time[-1]))
            criteria.append(
                table.make_criterion(item, name, inside, features, engine_parameter="engine1.n1")
            )
        drive = drive or CaseInputs("cockpit", "throttle")
        case = PomCase(
            "c",
            "C",
            id,
            standard,
            edition,
            "c.toml",
            "r.nc",
            (time[0], time[-1]),
            drive=drive,
            criteria=tuple(criteria),
            **more,
        )
        case = settle_case(case, time, flight)
        return {
            c.name: verdict_row("m", c, judge_criterion(case, c, time, flight, model))
            for c in case.criteria
        }

    return judge_rows
