"""An FMU whose answer is not that of its tables, and a model of another aircraft, are named."""

import zipfile
from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest

import flightmech
from flightmech.fmu_export.fmu_file import is_unaltered
from pom.cases.job import LawInputs, ReplayJob
from pom.fmu.description import read_fmu_interface
from pom.fmu.models import FmuModel
from pom.fmu.variable_map import links_of
from pom.probing.model_agreement import compare_aircraft, compare_controls
from pom.replaying.kernel_replay import fly_once
from pom.replaying.table_agreement import compare_model_tables, compare_tables

TIME = np.arange(0.0, 4.0, 0.02)


@pytest.fixture(scope="module")
def sim(trainer):
    return flightmech.compile(trainer.AIRCRAFT, trainer.database())


@pytest.fixture(scope="module")
def job():
    delta_e = np.where((TIME > 1.0) & (TIME < 2.0), np.radians(1.0), 0.0)
    parameters = {"init.V": 90.0, "init.h": 1500.0, "init.alpha": 0.05, "init.theta": 0.05}
    return ReplayJob(TIME, {"delta_e": delta_e}, parameters, (), ())


def test_the_answer_of_the_tables_is_no_finding(sim, job):
    outputs, failure = fly_once(sim, job, ["q", "theta", "nz"])
    assert not failure
    (remark,) = compare_tables(sim, job, outputs)
    assert remark.kind == "probe"
    assert max(remark.values.values()) < 1e-9


def test_an_answer_of_another_program_is_named(sim, job):
    outputs, _ = fly_once(sim, job, ["q", "theta", "nz"])
    # it follows its inputs, so the probe of the inputs does not show it
    outputs["nz"] = outputs["nz"] + 0.05 * np.sin(2.0 * TIME)
    (remark,) = compare_tables(sim, job, outputs)
    assert remark.kind == "not_driven"
    assert "not driven by its tables" in remark.text
    assert "(load factor at the c.g.)" in remark.text


def rewritten(path, out, changes):
    """Write an FMU with other contents of some files."""
    with zipfile.ZipFile(path) as old, zipfile.ZipFile(out, "w") as new:
        for name in old.namelist():
            new.writestr(name, changes.get(name, lambda content: content)(old.read(name)))
        for name in changes.keys() - set(old.namelist()):
            new.writestr(name, changes[name](b""))
    return out


def test_an_fmu_of_this_program_needs_no_flight_of_its_tables(tmp_path, sim, job):
    own = flightmech.write_fmu(sim, tmp_path / "own.fmu")
    model = FmuModel(read_fmu_interface(own), links_of(read_fmu_interface(own), None))
    wrong = {"nz": np.full(TIME.size, 9.0)}
    # the files decide: these outputs were not flown
    (remark,) = compare_model_tables(model, sim, job, wrong)
    assert "byte by byte" in remark.text
    # a table of names may exchange outputs
    named = replace(model, links=replace(model.links, table="names.toml"))
    (remark,) = compare_model_tables(named, sim, job, wrong)
    assert remark.kind == "not_driven"


@pytest.mark.slow
def test_a_change_of_any_file_of_the_program_is_seen(tmp_path, sim):
    own = flightmech.write_fmu(sim, tmp_path / "own.fmu", "3.0")
    assert is_unaltered(own)
    with zipfile.ZipFile(own) as archive:
        names = archive.namelist()
    (library, *_) = [name for name in names if name.startswith("binaries/")]
    changes = {
        "modelDescription.xml": lambda content: content.replace(b'"nz"', b'"n_z"', 1),
        library: lambda content: content + b"\0",
        "resources/flight.csv": lambda content: b"0,0",
        "binaries/other/model.so": lambda content: b"0",
    }
    for name, change in changes.items():
        assert not is_unaltered(rewritten(own, tmp_path / "other.fmu", {name: change})), name
    page = {"documentation/index.html": lambda content: content + b" "}
    assert is_unaltered(rewritten(own, tmp_path / "page.fmu", page))


def test_a_control_law_is_stated_as_not_compared(sim, job):
    law = replace(job, law=LawInputs((), {}, {}))
    (remark,) = compare_tables(sim, law, {})
    assert remark.kind == "not_probed"
    assert "against that of the tables in the FMU" in remark.text


def case_of(tmp_path, aircraft):
    flightmech.write_aircraft(aircraft, tmp_path / "aircraft.toml")
    return SimpleNamespace(aircraft=str(tmp_path / "aircraft.toml"))


def test_the_aircraft_of_the_model_is_no_departure(tmp_path, sim, job, trainer):
    assert compare_aircraft(case_of(tmp_path, trainer.AIRCRAFT), sim, job) == ()
    (remark,) = compare_aircraft(SimpleNamespace(aircraft=""), sim, job)
    assert remark.kind == "not_probed"
    assert "names no aircraft file" in remark.text


@pytest.mark.parametrize(
    ("change", "text"), [({"Iyy": 10000.0}, "Iyy 10000 and 8100"), ({"S": 16.0}, "S 16 and 17")]
)
def test_a_model_of_another_aircraft_is_a_departure(tmp_path, sim, job, trainer, change, text):
    (remark,) = compare_aircraft(case_of(tmp_path, replace(trainer.AIRCRAFT, **change)), sim, job)
    assert remark.kind == "departure"
    assert text in remark.text


def test_an_inertia_of_the_record_is_not_compared(tmp_path, sim, job, trainer):
    set_by_record = replace(job, parameters={**job.parameters, "mass.Iyy": 9000.0})
    case = case_of(tmp_path, replace(trainer.AIRCRAFT, Iyy=10000.0))
    assert compare_aircraft(case, sim, set_by_record) == ()


def test_hinge_moments_contradict_controls_that_are_not_reversible():
    loaded = SimpleNamespace(terms=("CL/basic", "Ch_e/alpha", "Ch_e/delta"))
    free = SimpleNamespace(terms=("CL/basic",))
    denied = SimpleNamespace(facts={"reversible_controls": False})
    (remark,) = compare_controls(denied, loaded)
    assert remark.kind == "departure"
    assert "Ch_e/alpha, Ch_e/delta" in remark.text
    assert compare_controls(denied, free) == ()
    # an aircraft that claims them, or states nothing, is judged elsewhere
    assert compare_controls(SimpleNamespace(facts={"reversible_controls": True}), loaded) == ()
    assert compare_controls(SimpleNamespace(facts={}), loaded) == ()
