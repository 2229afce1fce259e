"""What is in an FMU, and that it gives the numbers of the direct kernel call."""

from __future__ import annotations

import os
import re
import zipfile
from pathlib import Path
from xml.etree import ElementTree

import fmpy
import numpy as np
import pytest
import xarray as xr
from fmpy.validation import validate_fmu

import flightmech
from flightmech.errors import ParseError, SchemaError
from flightmech.fmu_export.description import CHOICES
from flightmech.fmu_export.fmu_file import write_fmu
from flightmech.fmu_export.fmu_reading import read_fmu
from flightmech.simulation.kernel import INTEGER, PARAMETER

VERSIONS = ("2.0", "3.0")
TRACE = (
    "V",
    "alpha",
    "beta",
    "p",
    "q",
    "r",
    "phi",
    "theta",
    "psi",
    "h",
    "az",
    "CL",
    "Cm",
    "engine1.thrust",
)


@pytest.fixture(scope="module")
def inputs() -> xr.Dataset:
    """Six seconds of elevator, aileron, rudder and throttle at 50 Hz, each a smooth pulse."""
    time = 0.02 * np.arange(301)

    def pulse(start: float, size: float) -> np.ndarray:
        return size * np.sin(np.clip((time - start) / 1.5, 0.0, 1.0) * 2.0 * np.pi)

    signals = {
        "delta_e": pulse(0.5, -0.03),
        "delta_a": pulse(1.5, 0.02),
        "delta_r": pulse(2.5, 0.03),
    }
    return xr.Dataset({name: ("time", values) for name, values in signals.items()}, {"time": time})


def table_of(inputs: xr.Dataset) -> np.ndarray:
    """Return inputs as the structured array that FMPy takes."""
    names = ["time", *map(str, inputs.data_vars)]
    table = np.zeros(inputs.sizes["time"], [(name, float) for name in names])
    for name in names:
        table[name] = inputs[name].values
    return table


def replay(folder: Path, inputs: xr.Dataset, condition: dict[str, float]) -> dict[str, np.ndarray]:
    """Run FMPy's own loop over the sample times of `inputs`."""
    time = inputs["time"].values
    found = fmpy.simulate_fmu(
        str(folder),
        start_time=time[0],
        stop_time=time[-1],
        output_interval=time[1] - time[0],
        start_values=condition,
        input=table_of(inputs),
        output=TRACE,
    )
    return {name: found[name] for name in found.dtype.names}


# ---- the file


@pytest.mark.nightly
@pytest.mark.parametrize("version", VERSIONS)
def test_the_standard_finds_nothing(trainer, tmp_path, version):
    path = write_fmu(trainer, tmp_path / "x.fmu", version)
    assert validate_fmu(str(path)) == []
    assert read_fmu(path)["findings"] == []
    assert os.listdir(tmp_path) == ["x.fmu"]


NAMES = [
    "delta_e", "_a1.b_2", "a[1]", "a[1,22].b[3].c", "der(a.b)", "der(a[1],2)",
    "'q 1'", "a b", "1a", "a..b", ".a", "a.", "a[", "a[]", "a[x]", "der(a", "der(der(a))",
    "der()", "der(a,)", "a-b", "\u00e4", "a\u0661", "a[1 ]", "a\n",
]  # fmt: skip


@pytest.fixture(scope="module")
def short_description(trainer, tmp_path_factory):
    """The description of an FMU with its first twelve variables only: the standard's check parses
    each name, 1 ms and more.
    """
    path = write_fmu(trainer, tmp_path_factory.mktemp("short") / "x.fmu")
    with zipfile.ZipFile(path) as archive:
        root = ElementTree.fromstring(archive.read("modelDescription.xml"))
    variables, structure = root.find("ModelVariables"), root.find("ModelStructure")
    for variable in list(variables)[12:]:
        variables.remove(variable)
    for kind in list(structure):
        structure.remove(kind)
    return ElementTree.tostring(root, encoding="unicode")


@pytest.mark.nightly
@pytest.mark.parametrize("convention", ["structured", "flat"])
@pytest.mark.parametrize("name", NAMES, ids=ascii)
def test_the_findings_are_those_of_the_standard_s_check(
    short_description, tmp_path, name, convention
):
    """Plain names are not parsed by its grammar; whatever it finds of any other, of a unit or of a
    file name is found here.
    """
    first = re.search('<ScalarVariable name="([^"]*)"', short_description)[1]
    written = name.encode("ascii", "xmlcharrefreplace").decode().replace("\n", "&#10;")
    text = short_description.replace(f'name="{first}"', f'name="{written}"', 1)
    changed = tmp_path / "changed.fmu"
    with zipfile.ZipFile(changed, "w") as new:
        new.writestr("modelDescription.xml", text.replace('"structured"', f'"{convention}"'))
    assert read_fmu(changed)["findings"] == validate_fmu(str(changed))


@pytest.mark.nightly
@pytest.mark.parametrize(("old", "new"), [('unit="rad"', 'unit="rod"'), ("start=", "begin=")])
def test_the_findings_of_a_wrong_description(trainer, tmp_path, old, new):
    path, changed = write_fmu(trainer, tmp_path / "x.fmu"), tmp_path / "changed.fmu"
    with zipfile.ZipFile(path) as archive, zipfile.ZipFile(changed, "w") as other:
        text = archive.read("modelDescription.xml").decode()
        assert old in text
        other.writestr("modelDescription.xml", text.replace(old, new, 1))
    assert read_fmu(changed)["findings"] == validate_fmu(str(changed)) != []


@pytest.mark.nightly
@pytest.mark.parametrize("version", VERSIONS)
def test_the_standard_finds_nothing_in_a_model_with_every_submodel(everything, tmp_path, version):
    assert validate_fmu(str(write_fmu(everything, tmp_path / "x.fmu", version))) == []


def test_every_mode_is_an_enumeration_of_all_its_values(everything):
    """A value that the enumeration leaves out could not be set by an importer."""
    modes = [
        row
        for row in everything.entries(PARAMETER)
        if row.name.startswith("mode.") and row.flags & INTEGER
    ]
    assert {row.name for row in modes} == {name for name in CHOICES if name.startswith("mode.")}
    for row in modes:
        assert sorted(CHOICES[row.name].values()) == list(range(int(row.low), int(row.high) + 1)), (
            row.name
        )


@pytest.mark.nightly
@pytest.mark.parametrize("version", VERSIONS)
def test_same_model_same_bytes(trainer, tmp_path, version):
    first, second = (
        write_fmu(trainer, tmp_path / name, version).read_bytes() for name in ("a.fmu", "b.fmu")
    )
    assert first == second


def test_the_interface_is_the_catalogue(trainer, fmus):
    for version in VERSIONS:
        variables = [
            v
            for v in fmpy.read_model_description(str(fmus[version])).modelVariables
            if not v.name.startswith("replay.")
        ]
        for causality, names in (
            ("input", trainer.inputs),
            ("output", trainer.outputs),
            ("parameter", trainer.parameters),
        ):
            assert [v.name for v in variables if v.causality == causality] == list(names)


def test_what_is_in_the_file(trainer, tmp_path):
    with zipfile.ZipFile(write_fmu(trainer, tmp_path / "x.fmu", "3.0")) as zf:
        names = zf.namelist()
        page = zf.read("documentation/index.html").decode()
        assert zf.read("resources/model.bin") == trainer.block
        assert b"Apache License" in zf.read("documentation/licenses/aeromatch-kernel.txt")
    assert {"modelDescription.xml", "resources/model.bin", "documentation/index.html"} < set(names)
    assert sum(name.startswith("binaries/") for name in names) >= 1
    for term in trainer.terms:
        assert f"<td>{term}</td>" in page
    assert (
        "<td>alpha -11.46 ... 17.19 deg (4), mach 0.1 ... 0.6 (2)</td><td></td><td>datcom 8</td>"
        in page
    )


def test_a_failed_write_leaves_the_old_file(trainer, tmp_path):
    path = tmp_path / "x.fmu"
    path.write_bytes(b"old")
    with pytest.raises(SchemaError, match=r"FMI version '1.0'; allowed: 2.0, 3.0"):
        write_fmu(trainer, path, "1.0")
    assert path.read_bytes() == b"old"
    with pytest.raises(FileNotFoundError):
        write_fmu(trainer, tmp_path / "absent" / "x.fmu")


def test_no_fmu_is_a_parse_error(tmp_path):
    path = tmp_path / "x.fmu"
    path.write_bytes(b"no zip")
    with pytest.raises(
        ParseError, match=r"expected an FMU: a zip archive with a modelDescription\.xml"
    ):
        read_fmu(path)


# ---- the same numbers


@pytest.mark.parametrize("version", VERSIONS)
def test_fmpy_and_the_direct_call_agree_to_the_bit(trainer, fmus, inputs, version, condition):
    direct = flightmech.simulate(trainer, inputs, condition, hold="zero")
    found = replay(fmus[version], inputs, condition)
    np.testing.assert_array_equal(found["time"], inputs["time"])
    assert abs(found["theta"] - found["theta"][0]).max() > 0.02  # the manoeuvre is one
    for name in TRACE:
        np.testing.assert_array_equal(found[name], direct[name].values, err_msg=name)


def test_both_standards_agree_to_the_bit(fmus, inputs, condition):
    second, third = (replay(fmus[v], inputs, condition) for v in VERSIONS)
    for name in TRACE:
        np.testing.assert_array_equal(second[name], third[name], err_msg=name)


def test_input_derivatives_give_linear_inputs(trainer, inputs, instance, condition):
    direct = flightmech.simulate(trainer, inputs, condition, hold="linear")
    names, time = [str(name) for name in inputs.data_vars], inputs["time"].values
    u = np.stack([inputs[name].values for name in names], axis=1)
    slave = instance("2.0").start()
    references = [slave.references[name] for name in names]
    rows = [slave.get(*TRACE)]
    for k in range(len(time) - 1):
        dt = time[k + 1] - time[k]
        slave.fmu.setReal(references, u[k])
        slave.fmu.setRealInputDerivatives(references, [1] * len(names), (u[k + 1] - u[k]) / dt)
        slave.step(time[k], dt)
        rows.append(slave.get(*TRACE))
    for name, found in zip(TRACE, np.transpose(rows), strict=True):
        # the end value of a step is rebuilt from the slope: one rounding per input and step, 6 s of
        # flight
        scale = abs(direct[name].values).max()
        np.testing.assert_allclose(
            found, direct[name].values, rtol=0.0, atol=1e-12 * scale, err_msg=name
        )


def test_derivatives_act_in_one_step_only(instance):
    slave = instance("2.0").start()
    slave.fmu.setRealInputDerivatives([slave.references["delta_e"]], [1], [-0.5])
    slave.step(0.0, 0.02)
    assert slave.get("delta_e") == [pytest.approx(-0.01, rel=1e-15)]
    slave.step(0.02, 0.02)
    assert slave.get("delta_e") == [pytest.approx(-0.01, rel=1e-15)]


def test_steps_of_any_size(trainer, inputs, instance, condition):
    held = inputs.isel(time=[0, 1, 26, 27, 80])
    direct = flightmech.simulate(trainer, held, condition, hold="zero")
    slave = instance("3.0").start()
    time = held["time"].values
    for k in range(len(time) - 1):
        slave.set({str(name): float(held[name][k]) for name in held.data_vars})
        slave.step(time[k], time[k + 1] - time[k])
        assert slave.get(*TRACE) == [float(direct[name][k + 1]) for name in TRACE]


def test_outputs_follow_inputs_without_a_step(slave):
    slave.start()
    slave.step(0.0, 0.02)
    before, q = slave.get("q_dot", "q")
    slave.set({"delta_e": 0.05})
    after, q_now = slave.get("q_dot", "q")
    assert after < before  # trailing edge down pitches down
    assert q_now == q


def test_trim_at_the_start_is_reported(trainer, slave, condition):
    direct = flightmech.trim(trainer, condition)
    slave.start()
    for name in ("trim.alpha", "trim.delta_e", "trim.thrust", "trim.w_dot", "trim.q_dot"):
        assert slave.get(name) == [float(direct[name])]
    w_dot, q_dot = slave.get("trim.w_dot", "trim.q_dot")
    assert abs(w_dot) < 1e-6
    assert abs(q_dot) < 1e-6


def test_initial_outputs_can_be_read_before_the_end_of_initialization(slave, condition):
    slave.enter()
    slave.set(condition)
    early = slave.get(*TRACE)
    slave.set({"init.V": 95.0})
    assert slave.get("V") == [pytest.approx(95.0, rel=1e-14)]
    slave.set({"init.V": condition["init.V"]})
    slave.fmu.exitInitializationMode()
    assert slave.get(*TRACE) == early
