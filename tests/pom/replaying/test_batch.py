"""Many cases: the same results however the work is shared out, kept flights, workers that die."""

import json
import os
import pickle
import shutil
import signal
import subprocess
import sys
import tempfile
import time
from dataclasses import replace as changed

import numpy as np
import pytest
import xarray as xr

import pom
from flightmech.errors import OutOfRange, SchemaError, SimulationError
from flightmech.support.foreign_code.process import module_command
from pom.cases.case import read_case
from pom.fmu import simulate
from pom.fmu.process import Child
from pom.fmu.run_cache import RunCache
from pom.replaying import batch, batch_plans
from pom.replaying import caches as state_cache
from pom.replaying import worker_processes as processes
from pom.replaying.batch import replay_all
from pom.replaying.replay_case import replay


@pytest.fixture
def cases(write_case):
    """Eight cases of the toy, each with its own window."""
    case = read_case(write_case(case='show = ["q", "theta", "nz"]', more="trim = false"))
    windows = [(1.0, 5.0 + 0.5 * k) for k in range(8)]
    return [
        changed(
            case,
            name=f"case_{k}",
            window=window,
            criteria=tuple(changed(c, window=window) for c in case.criteria),
        )
        for k, window in enumerate(windows)
    ]


@pytest.fixture
def paths(lag_states):
    return {"record": lag_states}


def the_same(found, expected):
    """Whether two lists of results are the same to the last bit."""
    for one, other in zip(found, expected, strict=True):
        assert one.to_json() == other.to_json()
        xr.testing.assert_identical(one.signals, other.signals)
        assert one.signals["theta"].values.tobytes() == other.signals["theta"].values.tobytes()


@pytest.fixture
def flights(monkeypatch):
    """Count flights."""
    made, hired = [], simulate.hire_worker

    def counted(path):
        made.append(path.name)
        return hired(path)

    monkeypatch.setattr(simulate, "hire_worker", counted)
    return made


@pytest.mark.nightly
def test_a_batch_is_the_cases_one_by_one(cases, paths, toy, lag_states):
    runs = {"good": toy(), "bad": toy("error")}
    finished = []
    found = replay_all(
        cases, runs, paths, jobs=2, progress=lambda result: finished.append(result.case.name)
    )
    assert finished == [case.name for case in cases]
    the_same(found, [replay(case, runs, lag_states) for case in cases])
    assert {result.status("bad") for result in found} == {"invalid"}


@pytest.fixture
def shared(monkeypatch):
    """Share out to processes from four cases on."""
    monkeypatch.setattr(processes, "LEAST_SHARE", 2)


@pytest.fixture
def own_temporary(tmp_path, monkeypatch):
    """A folder for temporary files that no other test writes to."""
    folder = tmp_path / "temporary"
    folder.mkdir()
    monkeypatch.setenv("TMPDIR", str(folder))
    monkeypatch.setattr(tempfile, "tempdir", None)
    return folder


@pytest.mark.nightly
def test_processes_give_the_same_and_leave_nothing(
    cases, paths, toy, tmp_path, lag_states, shared, monkeypatch, own_temporary
):
    record = tmp_path / "path.nc"
    lag_states.to_netcdf(record, engine="h5netcdf")
    mixed = [changed(case, record=str(record)) if k % 2 else case for k, case in enumerate(cases)]
    runs, finished = {"good": toy(), "bad": toy("error")}, []
    found = replay_all(
        mixed,
        runs,
        paths,
        jobs=2,
        resume=tmp_path / "kept",
        progress=lambda result: finished.append(result.case.name),
    )
    assert finished == [case.name for case in cases]
    assert not list(
        own_temporary.glob("aeromatch-fmu.*")
    )  # this process keeps its own FMUs for the next job
    monkeypatch.setattr(processes, "LEAST_SHARE", 40)
    the_same(found, replay_all(mixed, runs, paths, jobs=1))
    good = {"good": runs["good"]}
    first = replay_all(mixed, good, paths, jobs=1)
    monkeypatch.setattr(processes, "LEAST_SHARE", 2)
    the_same(replay_all(mixed, good, paths, jobs=2, resume=tmp_path / "kept"), first)
    monkeypatch.setattr(batch, "_perform", None)  # all is kept
    the_same(replay_all(mixed, good, paths, jobs=2, resume=tmp_path / "kept"), first)


@pytest.mark.nightly
def test_a_record_is_read_once_and_its_error_is_that_of_one_process(
    cases, toy, tmp_path, lag_states, shared
):
    record = tmp_path / "path.nc"
    lag_states.to_netcdf(record, engine="h5netcdf")
    late = [changed(case, record=str(record), window=(1.0, 99.0)) for case in cases]
    with pytest.raises(
        OutOfRange, match=r"case case_0: the window 1 ... 99 s lies outside the record"
    ):
        replay_all(late, {"toy": toy()}, jobs=2)


@pytest.mark.nightly
def test_a_process_that_ends_is_one_line(shared):
    with (
        pytest.raises(SimulationError, match="a process that shares the work of the batch ended"),
        processes.start_processes(4, 2) as pool,
    ):
        list(pool.map(os._exit, [(1,)]))


@pytest.mark.parametrize(("cases", "jobs"), [(79, 2), (1000, 1)])
def test_few_cases_and_one_job_take_no_processes(cases, jobs):
    with processes.start_processes(cases, jobs) as pool:
        assert pool is None


@pytest.mark.slow
def test_what_is_kept_is_not_flown_again(cases, paths, toy, tmp_path, flights):
    runs = {"a": toy(), "b": toy(interpolates=False), "bad": toy("error")}
    first = replay_all(cases, runs, paths, jobs=1, resume=tmp_path / "kept")
    assert len(flights) == 72  # 24, and three probes of each of the 16 that pass
    flights.clear()
    the_same(replay_all(cases, runs, paths, jobs=1, resume=tmp_path / "kept"), first)
    assert flights == ["error.fmu"] * 8  # a flight that failed is tried again


@pytest.mark.slow
def test_a_batch_goes_on_where_it_was_interrupted(cases, paths, toy, tmp_path, flights):
    runs = {"toy": toy()}

    def stop(result):
        if result.case.name == "case_2":
            raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        replay_all(cases, runs, paths, jobs=1, resume=tmp_path / "kept", progress=stop)
    before = len(flights)
    assert 3 <= before < 16
    found = replay_all(cases, runs, paths, jobs=1, resume=tmp_path / "kept")
    assert len(flights) == 32  # each with its three probes
    the_same(found, replay_all(cases, runs, paths, jobs=1))


@pytest.mark.nightly
def test_what_changed_is_flown_again_and_only_that(
    cases, paths, toy, tmp_path, lag_states, flights
):
    runs, kept = {"toy": toy()}, tmp_path / "kept"
    replay_all(cases, runs, paths, jobs=1, resume=kept)
    flights.clear()
    stricter = [changed(case, criteria=case.criteria[:1]) for case in cases]
    assert [
        len(result.verdict) for result in replay_all(stricter, runs, paths, jobs=1, resume=kept)
    ] == [1] * 8
    assert flights == []  # another tolerance: judged anew, not flown
    states = lag_states.copy(deep=True)
    states["delta_e"][320] += 1e-9  # at 6.4 s of the record
    replay_all(cases, runs, {"record": states}, jobs=1, resume=kept)
    # the five windows that reach it, 6.5 s to 8.5 s, their probes, and the one that it reaches late
    assert len(flights) == 16
    flights.clear()
    replay_all(cases, {"toy": toy(units={"theta": ""})}, paths, jobs=1, resume=kept)
    assert len(flights) == 32  # another file under the same name


@pytest.mark.slow
def test_a_damaged_file_of_the_store_is_flown_again(cases, paths, toy, tmp_path, flights):
    runs, kept = {"toy": toy()}, tmp_path / "kept"
    first = replay_all(cases[:2], runs, paths, jobs=1, resume=kept)
    flights.clear()
    next(kept.rglob("*.flight")).write_bytes(b"half a file")
    shutil.rmtree(kept / "results")
    the_same(replay_all(cases[:2], runs, paths, jobs=1, resume=kept), first)
    assert len(flights) == 1


def test_a_store_keeps_doubles_as_they_are(tmp_path):
    values = np.array([[0.1, np.nan, -0.0], [1e-310, np.inf, 3.0]])
    RunCache(tmp_path / "kept").write("ab12", values)
    assert RunCache(tmp_path / "kept").read("ab12", (2, 3)).tobytes() == values.tobytes()
    assert RunCache(tmp_path / "kept").read("ab12", (3, 2)) is None
    assert RunCache(tmp_path / "kept").read("cd34", (2, 3)) is None
    (file,) = tmp_path.rglob("*.flight")
    content = file.read_bytes()
    place = content.index(np.float64(3.0).tobytes())
    file.write_bytes(
        content[:place] + bytes(8) + content[place + 8 :]
    )  # what a disk may leave of a file that was being written
    assert RunCache(tmp_path / "kept").read("ab12", (2, 3)) is None


def test_all_that_does_not_fit_is_reported_before_anything_flies(cases, paths, toy, flights):
    with pytest.raises(SchemaError) as caught:
        replay_all(
            cases[:2], {"good": toy(), "misspelt": toy("nan", rename={"theta": "thetta"})}, paths
        )
    (text,) = caught.value.problems  # once, with the cases that need it
    assert "(misspelt): unknown output 'theta'; near it: thetta" in text
    assert text.endswith("; case case_0, case_1")
    assert flights == []


@pytest.mark.slow
def test_a_record_that_cases_share_is_read_once(cases, toy, lag_states, tmp_path, monkeypatch):
    lag_states.to_netcdf(tmp_path / "record.nc", engine="h5netcdf")
    read, real = [], batch_plans.read_path_states
    monkeypatch.setattr(
        batch_plans, "read_path_states", lambda record: read.append(record) or real(record)
    )
    found = replay_all(cases[:3], {"toy": toy()}, jobs=1)
    assert len(read) == 1
    assert {result.status("toy") for result in found} == {"pass_with_departures"}  # not trimmed


def test_raw_records_are_reconstructed_once_each_and_then_flown(
    cases, toy, lag_states, monkeypatch
):
    raw = [changed(case, record=f"raw_{k % 2}.csv") for k, case in enumerate(cases[:4])]
    made = []
    monkeypatch.setattr(
        state_cache, "recorded_states", lambda case, biases: made.append(case.name) or lag_states
    )
    found = replay_all(raw, {"toy": toy()}, jobs=1)
    assert made == ["case_0", "case_1"]
    assert {result.status("toy") for result in found} == {"pass_with_departures"}  # not trimmed


@pytest.mark.nightly
def test_reconstructed_records_are_kept_until_what_they_come_from_changes(
    cases, lag_states, tmp_path, trainer, monkeypatch
):
    (tmp_path / "raw.csv").write_text("time")
    (tmp_path / "trainer.toml").write_text(trainer.TOML)
    case = changed(
        cases[0], record=str(tmp_path / "raw.csv"), aircraft=str(tmp_path / "trainer.toml")
    )
    made = []
    monkeypatch.setattr(
        state_cache, "recorded_states", lambda case, biases: made.append(case.record) or lag_states
    )
    records = state_cache.KeptStates(tmp_path / "kept", None)
    assert records.read(case) is None
    records.make(case)
    assert records.read(case)["theta"].values.tobytes() == lag_states["theta"].values.tobytes()
    xr.testing.assert_identical(records.read(case), lag_states)
    assert len(made) == 1
    assert (
        state_cache.KeptStates(tmp_path / "kept", xr.Dataset({"estimate": 1.0})).read(case) is None
    )
    for file, text in (
        ("raw.csv", "time,V"),
        ("trainer.toml", trainer.TOML.replace("mass = 2200.0", "mass = 2201.0")),
    ):
        (tmp_path / file).write_text(text)
        records = state_cache.KeptStates(tmp_path / "kept", None)
        assert records.read(case) is None
        records.make(case)
    assert state_cache.KeptStates(None, None).read(case) is None


@pytest.mark.nightly
def test_a_child_that_somebody_else_stopped_is_given_its_job_again(toy, tmp_path, monkeypatch):
    monkeypatch.setenv("TOY_KILLED", str(tmp_path / "mark"))
    monkeypatch.setenv("AEROMATCH_FMU_SANDBOX", "none")  # its environment is empty
    child = Child(toy("killed"))
    job = {"time": np.array([0.0, 0.1]), "inputs": {}, "parameters": {}, "outputs": ["theta"]}
    assert child.run(job, 20.0).error == ""
    assert (tmp_path / "mark").exists()
    child.close()


@pytest.mark.slow
@pytest.mark.skipif(os.name == "nt", reason="Windows shows no new parent")
def test_a_hanging_fmu_ends_with_a_parent_that_was_killed(toy):
    script = """
import sys, numpy as np
from pom.fmu.process import Child
child = Child(sys.argv[1])
print(child._start().process.pid, flush=True)
job = {"time": np.array([0.0, 0.1]), "inputs": {}, "parameters": {}, "outputs": ["theta"]}
child.run(job, 600.0)
"""
    parent = subprocess.Popen(
        [sys.executable, "-c", script, str(toy("hang"))], stdout=subprocess.PIPE, text=True
    )
    child = int(parent.stdout.readline())
    parent.kill()
    parent.wait()
    parent.stdout.close()
    for _ in range(6000):
        try:
            os.kill(child, 0)
        except ProcessLookupError:
            return
        time.sleep(0.1)
    os.kill(child, signal.SIGKILL)
    pytest.fail("the child still ran after 600 s")


@pytest.mark.slow
@pytest.mark.skipif(os.name == "nt", reason="Windows has no sandbox")
def test_a_hanging_fmu_ends_when_nobody_can_send_it_a_job(toy, tmp_path):
    # as in a sandbox, where the parent is not visible (number 0)
    command = module_command("pom.fmu.worker", str(toy("hang")), str(tmp_path), "0", "0", "0")
    child = subprocess.Popen(
        command, stdin=subprocess.PIPE, stdout=subprocess.PIPE, start_new_session=True
    )
    job = {"time": np.array([0.0, 0.1]), "inputs": {}, "parameters": {}, "outputs": ["theta"]}
    pickle.dump({**job, "number": 1}, child.stdin)
    child.stdin.close()
    assert child.wait(600.0) == -signal.SIGKILL
    child.stdout.close()


@pytest.mark.slow
@pytest.mark.serial
def test_no_scheduler_is_stated_plainly(cases, paths, toy, monkeypatch):
    pytest.importorskip("distributed", reason="dask.distributed is not installed (extra `cluster`)")
    monkeypatch.setattr("flightmech.support.kept_stages.sharing.WAIT", 1.0)
    with pytest.raises(
        SimulationError, match=r"no cluster at tcp://127.0.0.1:9: .*start a scheduler and workers"
    ):
        replay_all(cases[:1], {"toy": toy()}, paths, scheduler="tcp://127.0.0.1:9")


@pytest.mark.nightly
@pytest.mark.serial
def test_a_cluster_gives_the_same_and_a_dead_worker_loses_no_row(
    cases, paths, toy, tmp_path, monkeypatch
):
    distributed = pytest.importorskip(
        "distributed", reason="dask.distributed is not installed (extra `cluster`)"
    )
    runs = {"good": toy(), "bad": toy("error")}
    expected = replay_all(cases, runs, paths, jobs=1)
    with distributed.LocalCluster(
        n_workers=2, threads_per_worker=1, processes=True, dashboard_address=None
    ) as local:
        the_same(replay_all(cases, runs, paths, scheduler=local.scheduler_address), expected)
        with monkeypatch.context() as patch:
            patch.setattr("flightmech.support.kept_stages.program.machine", lambda: "another")
            pom.replaying.batch.hash_installation.cache_clear()
            with pytest.raises(SimulationError, match="another version of aeromatch"):
                replay_all(cases, runs, paths, scheduler=local.scheduler_address)
        pom.replaying.batch.hash_installation.cache_clear()
        with distributed.Client(local) as client:
            victim = sorted(client.run(os.getpid).values())[0]

        def kill(result):
            if result.case.name == cases[0].name:
                os.kill(victim, signal.SIGKILL)

        many = [changed(case, name=f"{case.name}_{k}") for k in range(4) for case in cases]
        many[0] = cases[0]
        found = replay_all(
            many,
            runs,
            paths,
            scheduler=local.scheduler_address,
            progress=kill,
            resume=tmp_path / "kept",
        )
    assert [result.case.name for result in found] == [case.name for case in many]
    the_same(found, replay_all(many, runs, paths, jobs=1))


@pytest.mark.slow
@pytest.mark.serial
def test_a_scheduler_that_is_killed_ends_the_batch_in_one_line(
    cases, paths, toy, tmp_path, monkeypatch, capfd
):
    pytest.importorskip("distributed", reason="dask.distributed is not installed (extra `cluster`)")
    file = tmp_path / "scheduler.json"
    words = [sys.executable, "-m"]
    environment = {**os.environ, "PYTHONPATH": os.pathsep.join(sys.path)}
    common = {"env": environment, "stderr": subprocess.DEVNULL, "stdout": subprocess.DEVNULL}
    options = ["--scheduler-file", str(file), "--no-dashboard"]
    scheduler = subprocess.Popen(
        [*words, "distributed.cli.dask_scheduler", "--port", "0", *options], **common
    )
    worker = subprocess.Popen(
        [*words, "distributed.cli.dask_worker", "--no-nanny", "--nthreads", "1", *options], **common
    )
    try:
        for _ in range(6000):
            if file.exists() and file.stat().st_size:
                break
            time.sleep(0.1)
        address = json.loads(file.read_text())["address"]
        many = [changed(case, name=f"{case.name}_{k}") for k in range(12) for case in cases]
        capfd.readouterr()
        with pytest.raises(
            SimulationError,
            match=rf"^the scheduler at {address} ended while the batch ran; start one and run",
        ):
            replay_all(
                many, {"toy": toy()}, paths, scheduler=address, progress=lambda _: scheduler.kill()
            )
        assert capfd.readouterr() == ("", "")
    finally:
        for process in (scheduler, worker):
            process.kill()
            process.wait()
