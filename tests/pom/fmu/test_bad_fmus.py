"""FMUs that crash, hang, fork, flood, forge or are broken: each spoils its own row, and nothing
else.
"""

import os
import signal
import sys
import time
import zipfile
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path

import numpy as np
import pytest

from flightmech.errors import ParseError, SchemaError
from pom.cases.case import read_case
from pom.fmu import process
from pom.fmu.description import read_fmu_interface
from pom.fmu.process import Child, WorkerLimits, read_worker_limits
from pom.fmu.worker.messages import read_reply, reply_bytes, reply_columns
from pom.replaying.replay_case import replay

pytestmark = pytest.mark.skipif(os.name != "posix", reason="signals and limits of POSIX")
# s, that those which hang are given, whatever the machine does; the others have as long as a busy
# machine takes
HANGING = 10.0
# guid of bad.c -> what its row states; "i:" in instantiation, "x:" in initialisation, "e:" in the
# end, else in a step
IN_FLIGHT = {
    "i:null": "instantiation failed",
    "i:segv": "SIGSEGV",
    "i:exit": "exit code 0",
    "i:hang": "no answer within",
    "x:error": "initialisation failed",
    "x:segv": "SIGSEGV",
    "segv": "SIGSEGV",
    "abort": "SIGABRT",
    "fpe": "SIGFPE",
    "ill": "SIGILL",
    "bus": "SIGBUS",
    "kill": "SIGKILL",
    "alarm": "SIGALRM",
    "stop": "no answer within",
    "exit": "exit code 0",
    "exit7": "exit code 7",
    "hang": "no answer within",
    "spin": "no answer within",
    "stack": "SIGSEGV",
    "thread": "SIGSEGV",
    "free": "SIGABRT",
    "memory": "SIGABRT",
    "exec": "exit code 5",
    "fork_segv": "SIGSEGV",
    "fork_hang": "no answer within",
    "fork_exit": "exit code 0",
    "leave_segv": "SIGSEGV",
    "leave_hang": "no answer within",
    "flood": "no answer within",
    "flood_out": "no answer within",
    "disk": "SIGABRT",
    "garbage": "its answer could not be read",
    "forged": "its answer could not be read",
    "huge": "its answer could not be read",
    "pickle": "its answer could not be read",
    "closed": "crashed: exit code 1",
    "discard": "the step to t = 1.54 s failed",
    "fatal": "the step to t = 1.54 s failed",
    "odd": "the step to t = 1.54 s failed",
    "no_outputs": "initialisation failed",
    "e:error": "the end failed",
    "e:segv": "SIGSEGV",
}


@pytest.fixture
def case(write_case):
    return read_case(write_case(more="trim = false"))


def broken(folder, toy):
    """Yield FMUs whose files are broken so that the child finds it: name, file, what the row
    states.
    """
    good = toy()
    with zipfile.ZipFile(good) as file:
        content = {name: file.read(name) for name in file.namelist()}
    library = next(name for name in content if name.startswith("binaries"))
    kinds = {
        "no_library": ({**content, library: None}, "failed"),
        "text_library": ({**content, library: b"no library"}, "failed"),
        "half_library": ({**content, library: content[library][:2000]}, "half_library: "),
        "bomb": (
            {**content, "resources/zeros": bytes(20_000_000)},
            "20 MB unpacked, allowed are 5 MB",
        ),
    }
    for name, (files, stated) in kinds.items():
        with zipfile.ZipFile(folder / f"{name}.fmu", "w", zipfile.ZIP_DEFLATED) as file:
            for inside, item in files.items():
                if item is not None:
                    file.writestr(inside, item)
        yield name, folder / f"{name}.fmu", stated


@pytest.mark.slow
@pytest.mark.parametrize("sandbox", [pytest.param("none", marks=pytest.mark.nightly), "auto"])
def test_every_kind_spoils_its_own_row_and_no_other(
    sandbox, case, bad, toy, lag_states, tmp_path, monkeypatch
):
    monkeypatch.setenv("AEROMATCH_FMU_SANDBOX", sandbox)
    monkeypatch.setenv("AEROMATCH_FMU_PROCESSES", "none" if sandbox == "none" else "0")
    monkeypatch.setenv("AEROMATCH_FMU_WRITTEN", "1 MB")
    monkeypatch.setenv("AEROMATCH_FMU_UNPACKED", "5 MB")
    monkeypatch.setenv("AEROMATCH_FMU_MEMORY", "1500 MB")
    monkeypatch.setenv("BAD_FILE", str(tmp_path / "written"))
    files = list(broken(tmp_path, toy))
    kinds = dict(IN_FLIGHT)
    if sandbox == "auto":
        # they have the name of a file from the environment, which is empty in the sandbox
        del kinds["disk"], kinds["pickle"]
    runs = {name: bad(name) for name in kinds} | {name: file for name, file, _ in files}
    stated = IN_FLIGHT | {name: text for name, _, text in files}
    assert len(runs) >= 38

    hanging = [name for name in runs if stated[name] == "no answer within"]
    others = [name for name in runs if name not in hanging]

    def flown(names):
        timeout = HANGING if names[0] in hanging else 300.0
        return replay(
            case,
            {"good": toy(), **{name: runs[name] for name in names}, "last": toy()},
            lag_states,
            timeout=timeout,
        )

    groups = [[name] for name in hanging] + [others[k::4] for k in range(4)]
    with ThreadPoolExecutor(12) as pool:  # most of the time they wait for those that hang
        results = list(pool.map(flown, groups))
    for names, result in zip(groups, results, strict=True):
        failures = result.failure.split("; ")
        unstated = [
            name
            for name in names
            if not any(text.startswith(f"{name}: ") and stated[name] in text for text in failures)
        ]
        assert unstated == [], result.failure
        assert [result.status(name) for name in names] == ["invalid"] * len(names)
        assert {result.status("good"), result.status("last")} == {"pass_with_departures"}
    inf = replay(case, {"inf": bad("inf")}, lag_states)
    assert inf.status("inf") == "invalid"
    assert (
        not (tmp_path / "written").exists() or (tmp_path / "written").stat().st_size == 1_000_000
    )  # and nothing was unpickled


def job(n=100):
    t = np.linspace(0.0, 2.0, n)
    inputs = {"delta_e": 0.1 * t, "engine1.thrust_drive": 0.0 * t}
    return {"time": t, "inputs": inputs, "parameters": {}, "outputs": ["theta", "q"]}


@pytest.fixture
def unlimited(monkeypatch):
    """No sandbox, and FMUs that may start processes."""
    monkeypatch.setenv("AEROMATCH_FMU_SANDBOX", "none")
    monkeypatch.setenv("AEROMATCH_FMU_PROCESSES", "none")


@pytest.mark.slow
@pytest.mark.skipif(sys.platform != "linux", reason="reads /proc")
def test_a_process_that_is_left_behind_holds_nobody_up(bad, unlimited):
    child = Child(bad("leave_hang"))
    child._start()
    folder = Path(
        child._folder
    ).name  # in the command line of this child and of what it forks, of no other test
    reply = child.run(job(), HANGING)
    left = _processes_of(folder)
    for number in left:
        os.kill(int(number), signal.SIGKILL)
    assert len(left) == 1  # the reply did not wait for its end
    assert reply.error == f"no answer within {HANGING:g} s; the process was stopped"


@pytest.mark.slow
@pytest.mark.skipif(sys.platform != "linux", reason="reads /proc")
def test_all_that_an_fmu_started_in_its_session_ends_with_it(bad, unlimited):
    child = Child(bad("fork_hang"))
    child.run(job(), HANGING)
    gone = time.monotonic() + 500.0  # by itself the process would end after 600 s
    while (left := _processes_of("fork_hang.fmu")) and time.monotonic() < gone:
        time.sleep(0.05)
    assert left == []


def _processes_of(word):
    found = []
    for place in Path("/proc").glob("[0-9]*"):
        try:
            line = (place / "cmdline").read_bytes()
            state = (place / "stat").read_text().rpartition(")")[2].split()[0]
        except OSError:
            continue
        found += [place.name] if word.encode() in line and state != "Z" else []
    return found


def frame(content):
    """Return a function that gives bytes in small parts, as a pipe does."""
    rest = bytearray(content)

    def read(count):
        part = bytes(rest[: min(count, 7)])
        del rest[: len(part)]
        return part

    return read


def test_a_reply_is_text_and_numbers_there_and_back():
    columns = np.array([[1.5, np.nan], [-0.0, np.inf]])
    text, found = read_reply(frame(reply_bytes(7, "Flügel ab", columns)), 7, (2, 2))
    assert text == "Flügel ab"
    np.testing.assert_array_equal(found, columns)
    assert read_reply(frame(reply_bytes(7, "no model", np.empty((0, 0)))), 7, (2, 2)) == (
        "no model",
        None,
    )


def test_the_columns_of_a_pilot_that_never_came_to_act_are_empty():
    columns = reply_columns(
        {"time": [0.0, 1.0], "pilot": {"move": {"delta_e": (0, 1.0)}}},
        {"outputs": np.zeros((2, 1)), "moved": {}},
    )
    np.testing.assert_array_equal(columns, [[0.0, np.nan], [0.0, np.nan]])


@pytest.mark.parametrize(
    ("content", "number", "error"),
    [
        (reply_bytes(7, "", np.zeros((2, 2))), 8, ValueError),
        (reply_bytes(7, "", np.zeros((2, 3))), 7, ValueError),
        (b"X" + reply_bytes(7, "", np.zeros((2, 2)))[1:], 7, ValueError),
        (reply_bytes(7, "", np.zeros((2, 2)))[:-1], 7, EOFError),
        (b"", 7, EOFError),
    ],
    ids=["another job", "another size", "no reply", "cut", "nothing"],
)
def test_what_is_no_reply_to_the_job_is_refused(content, number, error):
    with pytest.raises(error):
        read_reply(frame(content), number, (2, 2))


def test_limits_of_the_environment():
    assert read_worker_limits({}) == WorkerLimits()
    given = {
        "AEROMATCH_FMU_MEMORY": "8GB",
        "AEROMATCH_FMU_WRITTEN": "500 kB",
        "AEROMATCH_FMU_UNPACKED": "none",
        "AEROMATCH_FMU_PROCESSES": "none",
        "AEROMATCH_FMU_SANDBOX": "none",
    }
    assert read_worker_limits(given) == WorkerLimits(8_000_000_000, 500_000, 0, True, "none")
    with pytest.raises(SchemaError) as caught:
        read_worker_limits(
            {
                "AEROMATCH_FMU_MEMORY": "much",
                "AEROMATCH_FMU_UNPACKED": "0",
                "AEROMATCH_FMU_PROCESSES": "7",
                "AEROMATCH_FMU_SANDBOX": "jail",
            }
        )
    assert [text.split(";")[0] for text in caught.value.problems] == [
        "AEROMATCH_FMU_MEMORY is 'much'",
        "AEROMATCH_FMU_UNPACKED is '0'",
        "AEROMATCH_FMU_PROCESSES is '7'",
        "AEROMATCH_FMU_SANDBOX is 'jail'",
    ]


def test_a_sandbox_without_bubblewrap_is_refused(monkeypatch):
    monkeypatch.setenv("PATH", "")
    with pytest.raises(
        SchemaError,
        match="the program bwrap is missing; install bubblewrap, or leave the variable out",
    ):
        read_worker_limits({"AEROMATCH_FMU_SANDBOX": "bwrap"})


@pytest.mark.slow
def test_a_description_that_would_fill_the_memory_is_not_unpacked(tmp_path):
    with (
        zipfile.ZipFile(tmp_path / "bomb.fmu", "w", zipfile.ZIP_DEFLATED) as file,
        file.open("modelDescription.xml", "w") as xml,
    ):
        for _ in range(65):
            xml.write(bytes(1_000_000))
    with pytest.raises(ParseError, match=r"modelDescription\.xml has 65 MB"):
        read_fmu_interface(tmp_path / "bomb.fmu")


def test_folders_that_killed_processes_left_are_removed(tmp_path, monkeypatch):
    monkeypatch.setattr("tempfile.tempdir", str(tmp_path))
    mine = Path(process._new_folder())
    child = os.fork()
    if child == 0:
        os._exit(0)
    os.waitpid(child, 0)
    gone = tmp_path / mine.name.replace(f"-{os.getpid()}-", f"-{child}-")
    (gone / "binaries").mkdir(parents=True)
    other = Path(process._new_folder())
    assert {path.name for path in tmp_path.iterdir()} == {mine.name, other.name}
    assert mine.stat().st_mode & 0o777 == 0o700
