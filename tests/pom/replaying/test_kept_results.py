"""Results of a batch that are kept: the same to the last bit, and judged anew as soon as anything
they depend on is another.
"""

import math
from dataclasses import replace as changed

import numpy as np
import pytest
import xarray as xr

from pom.cases.case import read_case
from pom.fmu.models import Models
from pom.replaying import batch, batch_plans
from pom.replaying.batch import replay_all
from pom.replaying.caches import KeptResults, KeptStates, ResultKeys


@pytest.fixture
def case(write_case):
    return read_case(write_case(case='show = ["q", "theta", "nz"]', more="trim = false"))


@pytest.fixture
def judged(monkeypatch):
    """Names of the cases that are flown and judged."""
    made, perform = [], batch.perform_plan

    def counted(plan, *rest):
        made.append(plan.case.name)
        return perform(plan, *rest)

    monkeypatch.setattr(batch, "perform_plan", counted)
    return made


def assert_identical(one, other):
    """Whether two results are the same to the last bit, with types and order."""
    assert one.case == other.case
    assert one.conditions == other.conditions
    for part in ("signals", "tolerance", "inputs"):
        found, due = getattr(one, part), getattr(other, part)
        assert found.identical(due)
        assert list(found.variables) == list(due.variables)
        assert all(found[name].dtype == due[name].dtype for name in due.variables)
        assert all(
            found[name].values.tobytes() == due[name].values.tobytes()
            for name in due.variables
            if name != "run"
        )
    for table in ("trim", "verdict"):
        found, due = getattr(one, table), getattr(other, table)
        assert found.equals(due)
        assert list(found.columns) == list(due.columns)
        assert found.index.name == due.index.name
        assert (found.dtypes == due.dtypes).all()
    assert one.failure == other.failure
    assert one.to_json() == other.to_json()


def test_a_kept_result_is_what_was_judged(case, toy, lag_states, tmp_path, judged):
    runs, paths = {"a": toy(), "b": toy(interpolates=False)}, {"record": lag_states}
    (first,) = replay_all([case], runs, paths, jobs=1, resume=tmp_path)
    (kept,) = replay_all([case], runs, paths, jobs=1, resume=tmp_path)
    assert judged == ["a_case"]
    assert_identical(kept, first)
    kept.signals["theta"][:] = 0.0  # its arrays are its own


def test_no_number_and_infinity_are_kept(case, toy, lag_states, tmp_path):
    (result,) = replay_all([case], {"a": toy()}, {"record": lag_states}, jobs=1)
    verdict = result.verdict.assign(worst_ratio=math.inf, worst=-math.inf, at=math.nan)
    signals = result.signals.copy(deep=True)
    signals["q"][0, :3] = [math.nan, -0.0, 1e-310]
    odd = changed(
        result, verdict=verdict, signals=signals, conditions={**result.conditions, "h": 0.1 + 0.2}
    )
    KeptResults(tmp_path).write("ab12", odd)
    assert_identical(KeptResults(tmp_path).read("ab12"), odd)


def test_nothing_is_kept_without_a_folder_or_a_name(case, toy, lag_states, tmp_path):
    (result,) = replay_all([case], {"a": toy()}, {"record": lag_states}, jobs=1)
    KeptResults(None).write("ab12", result)
    KeptResults(tmp_path / "kept").write("", result)
    assert not (tmp_path / "kept").exists()
    assert KeptResults(None).read("ab12") is None
    assert KeptResults(tmp_path / "kept").read("ab12") is None


@pytest.mark.slow
@pytest.mark.parametrize(
    "damage",
    [lambda content: content[:-8], lambda content: content[:-1] + b"\x00", lambda content: b""],
)
def test_a_damaged_file_is_judged_anew(case, toy, lag_states, tmp_path, judged, damage):
    runs, paths = {"a": toy()}, {"record": lag_states.assign(q=lag_states["q"] + 0.1)}
    (first,) = replay_all([case], runs, paths, jobs=1, resume=tmp_path)
    (file,) = (file for file in (tmp_path / "results").rglob("*") if file.is_file())
    content = file.read_bytes()
    assert damage(content) != content
    file.write_bytes(damage(content))
    (again,) = replay_all([case], runs, paths, jobs=1, resume=tmp_path)
    assert judged == ["a_case"] * 2
    assert_identical(again, first)
    assert file.read_bytes() == content


def test_a_result_with_a_failed_flight_is_not_kept(case, toy, lag_states, tmp_path, judged):
    for _ in range(2):
        replay_all(
            [case], {"a": toy(), "b": toy("error")}, {"record": lag_states}, jobs=1, resume=tmp_path
        )
    assert judged == ["a_case"] * 2
    assert not (tmp_path / "results").exists()


def test_new_cases_join_the_kept_ones_in_order(case, toy, lag_states, tmp_path, judged):
    cases = [changed(case, name=f"case_{k}") for k in range(5)]
    runs, paths = {"a": toy()}, {"record": lag_states}
    replay_all(cases[1:4:2], runs, paths, jobs=1, resume=tmp_path)
    reported = []
    results = replay_all(
        cases,
        runs,
        paths,
        jobs=2,
        resume=tmp_path,
        progress=lambda result: reported.append(result.case.name),
    )
    assert [result.case.name for result in results] == reported == [case.name for case in cases]
    assert sorted(judged) == [f"case_{k}" for k in range(5)]


def test_whatever_decides_a_result_is_in_its_name(case, toy, lag_states, tmp_path):
    record = tmp_path / "record.csv"
    record.write_text("time [s],q [rad/s]\n0,0\n")
    case = changed(case, record=str(record))
    evidence = xr.DataTree.from_dict({"/CL/basic": xr.Dataset({"value": 1.0, "stderr": 0.1})})

    def name(case=case, path=None, runs=None, program="1", evidence=evidence, biases=None):
        models = Models(runs or {"a": toy()}).of(case)
        return ResultKeys(KeptStates(None, biases), program, evidence).of(case, path, models)

    other = lag_states.copy(deep=True)
    other["delta_e"][320] += 1e-12
    names = {
        "as it is": name(),
        "case": name(case=changed(case, fraction=0.5)),
        "criterion": name(case=changed(case, criteria=case.criteria[:1])),
        "path": name(path=lag_states),
        "another path": name(path=other),
        "file": name(runs={"a": toy(units={"theta": ""})}),
        "name of the model": name(runs={"b": toy()}),
        "more models": name(runs={"a": toy(), "b": toy(interpolates=False)}),
        "program": name(program="2"),
        "no evidence": name(evidence=None),
        "evidence": name(
            evidence=xr.DataTree.from_dict({"/CL/basic": xr.Dataset({"value": 1.0, "stderr": 0.2})})
        ),
        "biases": name(biases=xr.Dataset({"estimate": 1.0})),
    }
    assert name() == names["as it is"]
    assert name(path=lag_states.copy(deep=True)) == names["path"]
    record.write_text("time [s],q [rad/s]\n0,1\n")
    names["record"] = name()
    assert name(path=lag_states) == names["path"]  # the record is not read
    measured = changed(case, wind="measured")
    names["measured wind"] = name(case=measured, path=lag_states)
    record.write_text("time [s],q [rad/s]\n0,2\n")
    names["measured wind of another record"] = name(case=measured, path=lag_states)
    assert len(set(names.values())) == len(names)
    record.unlink()
    assert name() == ""


@pytest.mark.slow
def test_a_record_that_changes_while_it_is_read_leaves_no_result(
    case, toy, lag_states, tmp_path, monkeypatch, judged
):
    record, kept, plan_of = tmp_path / "path.nc", tmp_path / "kept", batch_plans.plan_of
    lag_states.to_netcdf(record, engine="h5netcdf")
    case = changed(case, record=str(record))

    def later(*arguments):
        record.touch()
        return plan_of(*arguments)

    monkeypatch.setattr(batch_plans, "plan_of", later)
    replay_all([case], {"a": toy()}, jobs=1, resume=kept)
    assert not (kept / "results").exists()
    monkeypatch.undo()
    replay_all([case], {"a": toy()}, jobs=1, resume=kept)
    assert len([file for file in (kept / "results").rglob("*") if file.is_file()]) == 1
    assert np.isfinite(
        replay_all([case], {"a": toy()}, jobs=1, resume=kept)[0].signals["theta"]
    ).all()
