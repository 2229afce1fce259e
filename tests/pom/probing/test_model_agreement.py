"""An FMU whose answer is not that of its tables, and a model of another aircraft, are named."""

from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest

import flightmech
from pom.cases.job import LawInputs, ReplayJob
from pom.probing.model_agreement import compare_aircraft, compare_controls
from pom.replaying.kernel_replay import fly_once
from pom.replaying.table_agreement import compare_tables

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
    assert "(nz)" in remark.text


def test_a_control_law_is_stated_as_not_compared(sim, job):
    law = replace(job, law=LawInputs((), {}, {}))
    (remark,) = compare_tables(sim, law, {})
    assert remark.kind == "probe"
    assert "not compared" in remark.text


def case_of(tmp_path, aircraft):
    flightmech.write_aircraft(aircraft, tmp_path / "aircraft.toml")
    return SimpleNamespace(aircraft=str(tmp_path / "aircraft.toml"))


def test_the_aircraft_of_the_model_is_no_departure(tmp_path, sim, job, trainer):
    assert compare_aircraft(case_of(tmp_path, trainer.AIRCRAFT), sim, job) == ()
    assert compare_aircraft(SimpleNamespace(aircraft=""), sim, job) == ()


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
