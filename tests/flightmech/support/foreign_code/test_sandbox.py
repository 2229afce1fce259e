"""The sandbox itself: what a process in the real bubblewrap can do, as user and as superuser."""

import os
import shutil
import signal
import socket
import subprocess
import sys
import threading
from pathlib import Path

import pytest

from flightmech.errors import SchemaError
from flightmech.support.foreign_code import sandbox
from flightmech.support.foreign_code.process import RunLimits, module_command, run_foreign
from flightmech.support.foreign_code.sandbox import (
    describe_sandbox,
    read_sandbox_mode,
    sandbox_problem,
    sandbox_words,
)

DEFAULT = RunLimits()
needs_bwrap = pytest.mark.skipif(bool(sandbox_problem()), reason=sandbox_problem() or "bwrap")
TRY = """
def tried(name, act):
    try:
        print(name, "DONE", act() or "")
    except OSError as error:
        print(name, "refused")
import ctypes, os, socket, sys
call = ctypes.CDLL(None, use_errno=True)
def system(name, *words):
    if getattr(call, name)(*words) < 0:
        raise OSError(ctypes.get_errno(), "")
"""


def run_inside(code, limits=DEFAULT, **options):
    words = sandbox_words(**options)
    program = [sys.executable, "-I", "-S", "-c", TRY + code]
    return run_foreign(
        program, b"", timeout=60.0, limits=limits, most=100_000, sandbox=words
    ).output.decode()


# Without the filter of calls the namespaces alone must hold.
@needs_bwrap
@pytest.mark.parametrize("filtered", [True, False])
def test_nothing_outside_is_written_and_no_mount_is_changed(filtered, tmp_path):
    limits = RunLimits(processes=not filtered, network=not filtered)
    text = run_inside(
        f"""
for path in ("/x", "/dev/x", "/usr/x", "/etc/x", sys.prefix + "/x", {str(tmp_path / "x")!r},
             "/proc/sys/kernel/core_pattern", "/proc/self/oom_score_adj", "/proc/sysrq-trigger"):
    tried(path, lambda: open(path, "w").close())
tried("remount", lambda: system("mount", None, b"/", None, 0x1020, None))
tried("tmpfs", lambda: system("mount", b"none", b"/tmp", b"tmpfs", 0, None))
tried("unmount", lambda: system("umount2", b"/proc", 2))
tried("namespace", lambda: system("unshare", 0x10020000))
tried("root", lambda: os.setuid(0))
tried("own", lambda: open("/tmp/x", "w").close())
""",
        limits,
    )
    lines = text.splitlines()
    assert [line for line in lines if "DONE" in line] == ["own DONE "]
    assert len(lines) == 15
    assert list(tmp_path.iterdir()) == []


@needs_bwrap
def test_only_a_folder_that_is_given_is_written(tmp_path):
    text = run_inside(
        f"tried('given', lambda: open({str(tmp_path / 'x')!r}, 'w').close())",
        writable=str(tmp_path),
    )
    assert text == "given DONE \n"
    assert [path.name for path in tmp_path.iterdir()] == ["x"]


@needs_bwrap
@pytest.mark.parametrize("filtered", [True, False])
def test_no_socket_of_a_service_answers(filtered, tmp_path):
    place = str(tmp_path / "service")
    with socket.socket(socket.AF_UNIX) as named, socket.socket() as local:
        named.bind(place)
        named.listen(1)
        local.bind(("127.0.0.1", 0))
        local.listen(1)
        abstract = socket.socket(socket.AF_UNIX)
        abstract.bind(b"\0aeromatch-test-%d" % os.getpid())
        abstract.listen(1)
        text = run_inside(
            f"""
def reach(family, address):
    with socket.socket(family) as item:
        item.settimeout(5.0)
        item.connect(address)
tried("named", lambda: reach(socket.AF_UNIX, {place!r}))
tried("abstract", lambda: reach(socket.AF_UNIX, {abstract.getsockname()!r}))
tried("local", lambda: reach(socket.AF_INET, {local.getsockname()!r}))
tried("network", lambda: reach(socket.AF_INET, ("192.0.2.1", 80)))
""",
            RunLimits(network=not filtered),
        )
        abstract.close()
    assert text.split() == ["named", "refused", "abstract", "refused", "local", "refused"] + [
        "network",
        "refused",
    ]


@needs_bwrap
def test_environment_and_other_processes_are_not_seen(monkeypatch, tmp_path):
    monkeypatch.setenv("SECRET", "4711")
    text = run_inside(
        f"""
print("SECRET" in os.environ, os.path.exists({str(tmp_path)!r}), os.path.exists("/etc/passwd"))
print(sum(item.isdigit() for item in os.listdir("/proc")) <= 3)
tried("signal", lambda: os.kill({os.getpid()}, 0))
lines = [line for line in open("/proc/self/status") if line.startswith("Cap")]
print(all(int(line.split()[1], 16) == 0 for line in lines), len(lines))
"""
    )
    assert text.splitlines() == ["False False False", "True", "signal refused", "True 5"]


BOMB = """
import os, threading
count = 0
try:
    for _ in range(100):
        if os.fork() == 0:
            os._exit(0)
        count += 1
except OSError:
    pass
for words in (["/bin/true"],):
    try:
        os.posix_spawn(words[0], words, {})
        count += 1
    except OSError:
        pass
thread = threading.Thread(target=print, args=["thread"])
thread.start()
thread.join()
print(count)
"""


@pytest.mark.skipif(sys.platform != "linux", reason="a filter of Linux")
@pytest.mark.parametrize("inside", [True, False])
def test_no_process_is_started_and_threads_are(inside):
    if inside and sandbox_problem():
        pytest.skip(sandbox_problem())
    words = sandbox_words() if inside else []
    program = [sys.executable, "-I", "-S", "-c", BOMB]
    done = run_foreign(program, b"", timeout=60.0, limits=RunLimits(), most=1000, sandbox=words)
    assert done.output.decode().split() == ["thread", "0"]
    free = RunLimits(processes=True)
    done = run_foreign(program, b"", timeout=60.0, limits=free, most=1000, sandbox=words)
    assert done.output.decode().split() == ["thread", "101"]


@needs_bwrap
def test_its_files_fill_no_disk():
    text = run_inside(
        """
def fill(path):
    with open(path, "wb", 0) as file:
        for _ in range(200):
            file.write(bytes(1_000_000))
tried("tmp", lambda: fill("/tmp/x"))
tried("shm", lambda: fill("/dev/shm/x"))
tried("run", lambda: fill("/run/x"))
""",
        size=50_000_000,
    )
    assert text.split() == ["tmp", "refused", "shm", "refused", "run", "refused"]


@needs_bwrap
@pytest.mark.skipif(os.geteuid() != 0, reason="only the superuser becomes another user")
@pytest.mark.skipif(shutil.which("setpriv") is None, reason="needs setpriv")
def test_the_sandbox_holds_for_another_user(tmp_path):
    tmp_path.chmod(0o777)
    # that user may not read this interpreter, so the words are those of the system alone
    words = sandbox_words()
    own = [str(Path(item)) for item in sandbox._interpreter_paths()]
    for path in own:
        at = words.index(path) - 1
        del words[at : at + 3]
    script = (
        f"id -u; grep CapEff /proc/self/status; echo x > {tmp_path}/x; echo x > /x; "
        f"mount -o remount,rw /"
    )
    done = subprocess.run(
        ["setpriv", "--reuid", "65534", "--regid", "65534", "--clear-groups", *words]
        + ["/bin/sh", "-c", script],
        capture_output=True,
        text=True,
        check=False,
        timeout=60,
    )
    assert done.stdout.split()[:3] == ["65534", "CapEff:", "0000000000000000"], done.stderr
    assert done.stderr.count("\n") >= 3
    assert list(tmp_path.iterdir()) == []


@needs_bwrap
def test_a_process_of_the_sandbox_outlives_the_thread_that_started_it():
    from flightmech.support.foreign_code.process import ForeignProcess

    found = []
    command = [sys.executable, "-I", "-S", "-c", "print(input())"]

    def start():
        found.append(ForeignProcess(command, RunLimits(), sandbox=sandbox_words()))

    thread = threading.Thread(target=start)
    thread.start()
    thread.join()
    (process,) = found
    process.stdin.write(b"alive\n")
    assert process.stdout.read(6) == b"alive\n"
    process.close()


@needs_bwrap
@pytest.mark.skipif(not hasattr(os, "fork"), reason="needs fork")
@pytest.mark.filterwarnings("ignore:.*multi-threaded.*fork:DeprecationWarning")
def test_a_forked_process_can_start_one_too():
    command = [sys.executable, "-I", "-S", "-c", "print(input())"]

    def answer() -> bytes:
        words = sandbox_words()
        return run_foreign(
            command, b"alive\n", timeout=60.0, limits=DEFAULT, most=100, sandbox=words
        ).output

    assert answer() == b"alive\n"  # the thread that starts them runs from here on
    child = os.fork()
    if child == 0:
        signal.alarm(600)
        os._exit(0 if answer() == b"alive\n" else 1)
    assert os.waitpid(child, 0)[1] == 0


def test_a_sandbox_that_is_demanded_and_missing_is_refused(monkeypatch):
    monkeypatch.setenv("PATH", "")
    assert read_sandbox_mode({}) == "auto"
    assert describe_sandbox("auto") == "without a sandbox (the program bwrap is missing)"
    with pytest.raises(
        SchemaError,
        match="the program bwrap is missing; install bubblewrap, or leave the variable out",
    ):
        read_sandbox_mode({"AEROMATCH_FMU_SANDBOX": "bwrap"})
    with pytest.raises(SchemaError, match="'jail'; give 'auto' or 'bwrap' or 'none'"):
        read_sandbox_mode({"AEROMATCH_FMU_SANDBOX": "jail"})


@pytest.mark.slow
@pytest.mark.parametrize(
    ("code", "failure"),
    [
        ("import time; time.sleep(60)", "it did not end within 2 s"),
        ("import sys; sys.exit(3)", "it ended with exit code 3"),
        ("import os; os.abort()", "it ended with signal SIGABRT"),
        ("print('x' * 3000)", "it wrote more than 0 MB"),
        ("x = bytes(3_000_000_000)", "it ended with exit code 1"),
    ],
    ids=["time", "exit", "crash", "output", "memory"],
)
def test_limits_of_a_run(code, failure):
    done = run_foreign(
        [sys.executable, "-I", "-S", "-c", code],
        b"",
        timeout=2.0 if "sleep" in code else 60.0,
        limits=RunLimits(),
        most=2000,
    )
    assert (done.failure, done.timed_out) == (failure, "sleep" in code)


def test_control_characters_of_a_foreign_text_are_not_printed():
    code = "import sys; sys.stderr.write('\\x1b[2Kall hold\\r')"
    done = run_foreign(
        [sys.executable, "-I", "-S", "-c", code],
        b"",
        timeout=60.0,
        limits=RunLimits(),
        most=10,
    )
    assert done.printed == " [2Kall hold"
    assert module_command("x", "y")[1:] == ["-P", "-m", "x", "y"]
