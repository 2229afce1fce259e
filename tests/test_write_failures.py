"""Verbs of the command line whose calls that write fail, one call after the other.

Each call fails once (no space on the disk), or with all later ones (defective disk), or the process
is killed there. Each file or folder must then be as before the verb or as after it. A verb that
did not write has exit code 2 and one line with the name of the file.
"""

from __future__ import annotations

import ctypes
import errno
import hashlib
import itertools
import json
import os
import random
import shutil
import sys
from collections.abc import Iterable, Iterator
from importlib.util import find_spec
from pathlib import Path

import click
import pytest
import typst
import write_calls
from write_verbs import EXTRAS, VERBS, Verb, make_inputs, run_verb

from aeromatch.cli import cli

# errno of the failed call, 0 for a kill; whether all later calls fail too
KINDS = {"full disk": (errno.ENOSPC, 0), "defective disk": (errno.EIO, 1), "killed": (0, 0)}
# Greatest number of failed calls of a verb and kind: in .ci/run, and in .ci/nightly.
FEW, MANY = 3, 40
# Verbs that take seconds, whose calls of .ci/nightly are fewer.
LONG = {
    *("package make", "package folder", "spread"),
    *("plan", "multibody", "gear", "ground-effect", "controls", "stall", "estimate", "fit"),
}
SOME = 13
# Verbs of two seconds and more.
LONGER = {"match", "demo", "reconstruct all", "tune", "resume", "pom run"}
FEWER = 6
_COMPILE = typst.compile


def compile_in_child(*words: object, **more: object) -> bytes:
    """Return the PDF of a child process.

    The first PDF starts threads, for which each later PDF waits. A fork does not copy them, so a
    trial would wait without end if its parent had made a PDF.
    """
    reader, writer = os.pipe()
    child = os.fork()
    if child == 0:
        code = 1
        try:
            os.close(reader)
            with os.fdopen(writer, "wb") as pipe:
                pipe.write(_COMPILE(*words, **more))
            code = 0
        finally:
            os._exit(code)
    os.close(writer)
    with os.fdopen(reader, "rb") as pipe:
        content = pipe.read()
    assert os.waitstatus_to_exitcode(os.waitpid(child, 0)[1]) == 0
    return content


def state_of(path: Path, is_random: bool) -> object:
    """Return what a file or folder holds, or only how long it is; None without one."""
    if path.is_dir():
        files = sorted(item for item in path.rglob("*") if item.is_file())
        return [(str(file.relative_to(path)), state_of(file, is_random)) for file in files]
    if not path.exists():
        return None
    return path.stat().st_size if is_random else hashlib.sha256(path.read_bytes()).hexdigest()


class Trials:
    """Runs of one verb in children of this process, each in a fresh folder with the inputs."""

    def __init__(self, verb: Verb, folder: Path, store: str) -> None:
        self.verb, self.log = verb, folder / "log"
        self.inputs, self.work = folder / "inputs", folder / "run"
        self.library = ctypes.CDLL(os.environ["LD_PRELOAD"])
        self.library.count_of_calls.restype = ctypes.c_long
        # what matches keep of their stages is no part of their output
        os.environ["AEROMATCH_STORE"] = store
        make_inputs(verb.inputs, self.inputs)
        if verb.before:
            verb.before()
        self.targets = verb.targets.split()
        options = dict(itertools.pairwise(verb.command()))
        self.kept = [options["--resume"]] if "--resume" in options else []

    def refresh(self) -> list[object]:
        """Make a fresh folder, and return the states of the targets."""
        os.chdir(self.inputs)
        shutil.rmtree(self.work, ignore_errors=True)
        # links: a verb that changes a file in place would change the inputs, which is a fault too
        shutil.copytree(self.inputs, self.work, copy_function=os.link)
        return self.states()

    def states(self) -> list[object]:
        return [state_of(self.work / name, self.verb.is_random) for name in self.targets]

    def name_targets(self) -> None:
        """Replace each pattern among the targets by the files that the verb has written."""
        patterns, self.targets = self.targets, []
        for pattern in patterns:
            files = sorted(self.work.glob(pattern)) if "*" in pattern else [self.work / pattern]
            self.targets += [str(file.relative_to(self.work)) for file in files]

    def run(self, number: int = 0, error: int = 0, stays: int = 0) -> tuple[int, str, int]:
        """Run the verb in a child, and return its exit code, its output and its calls."""
        child = os.fork()
        if child == 0:
            log = os.open(self.log, os.O_WRONLY | os.O_CREAT | os.O_TRUNC)
            os.dup2(log, 1)
            os.dup2(log, 2)
            os.chdir(self.work)
            typst.compile = _COMPILE
            folder, call = str(self.work).encode(), ctypes.c_long(number)
            if number and not error:
                self.library.kill_at_call(folder, call)
            else:
                self.library.fail_at_call(folder, call, error or errno.EIO, stays)
            code = run_verb(self.verb.command())
            sys.stdout.flush()
            sys.stderr.flush()
            os.write(log, b"\n@@%d" % self.library.count_of_calls())
            os._exit(code)
        code = os.waitstatus_to_exitcode(os.waitpid(child, 0)[1])
        output, _, calls = self.log.read_text(errors="replace").partition("\n@@")
        return code, output, int(calls or 0)

    def find_faults(self, most: int) -> list[str]:
        """Return what is wrong after failed calls."""
        assert run_verb_quietly(self, self.verb) in (0, 1)
        self.name_targets()
        old = self.refresh()
        code, output, calls = self.run()
        assert code in (0, 1), output
        new = self.states()
        assert old != new, "the verb writes nothing"
        assert calls > 2
        numbers = list(range(1, calls + 1))
        if calls > most:
            # the first and the last calls are those of files, folders and renamings, the middle
            # one is mostly of the numbers
            middle = (calls + 1) // 2
            inner = [number for number in numbers[1:-1] if number != middle]
            numbers = sorted({1, middle, calls, *random.Random(1).sample(inner, max(most - 3, 0))})
        faults = []
        for kind in KINDS:
            for number in numbers:
                self.refresh()
                found = self.judge(kind, number, old=old, new=new)
                faults += [f"{kind}, call {number} of {calls}: {text}" for text in found]
        print(f"{self.verb.words}: {calls} calls, {len(numbers) * len(KINDS)} trials", flush=True)
        return faults

    def judge(self, kind: str, number: int, old: list[object], new: list[object]) -> list[str]:
        """Let one call fail, and return what is wrong afterwards."""
        code, output, _ = self.run(number, *KINDS[kind])
        now, faults = self.states(), []
        names = self.targets
        for name, is_, was, will_be in zip(names, now, old, new, strict=True):
            if is_ not in (was, will_be):
                faults.append(f"{name} is neither old nor new (exit code {code})")
        if kind != "killed":
            if code in (0, 1) and now != new:
                faults.append(f"exit code {code} without the new files")
            if code not in (0, 1, 2):
                faults.append(f"exit code {code}: {output[-300:]}")
            lines = [line for line in output.splitlines() if line.startswith("error:")]
            # the file, or its folder; what --resume keeps is written too
            words = {word for name in (*names, *self.kept) for word in Path(name).parts}
            is_named = any(word in line for line in lines for word in words)
            if code == 2 and (len(lines) != 1 or not is_named):
                faults.append(f"not one line with the name of the file: {output[-300:]}")
        if "Traceback" in output:
            faults.append("a traceback")
        if now == new and not self.kept:
            # some verbs do not write over their own file
            return faults
        again, output, _ = self.run()
        if again not in (0, 1):
            faults.append(f"the next run ends with {again}: {output[-300:]}")
        # a flight that could not be kept is flown again, and a torn one is not read
        elif self.kept and self.states() != new:
            faults.append(f"the next run has another result: {output[-300:]}")
        left = [path.name for path in self.work.rglob("*.part*")]
        return faults + [f"{name} is left after the next run" for name in left]


def run_verb_quietly(trials: Trials, verb: Verb) -> int:
    """Run a verb once in this process, so that its modules are loaded in all children."""
    trials.refresh()
    os.chdir(trials.work)
    return run_verb(verb.command())


def find_faults_of_verbs(folder: Path) -> None:
    """Try the verbs of the environment; this function runs in a process of `run_preloaded`."""
    names, most, store = json.loads(os.environ["AEROMATCH_FAILED_WRITES"])
    typst.compile = compile_in_child
    faults = []
    for number, name in enumerate(names):
        place = folder / str(number)
        place.mkdir()
        trials = Trials(VERBS[name], place, store)
        faults += [f"{name}: {text}" for text in trials.find_faults(most)]
    assert not faults, "\n".join([f"{len(faults)} faults", *faults[:20]])


@pytest.fixture(scope="session")
def store(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Return the folder of the stages of all matches: many verbs need the same match as an
    input.
    """
    return tmp_path_factory.mktemp("stages")


def try_verbs(
    names: list[str], most: int, folder: Path, store: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("AEROMATCH_FAILED_WRITES", json.dumps([names, most, str(store)]))
    write_calls.run_preloaded(find_faults_of_verbs, folder)


pytestmark = pytest.mark.skipif(sys.platform != "linux", reason="a library in front of the C one")


def outputs(command: click.Command, words: tuple[str, ...] = ()) -> Iterator[tuple[str, str]]:
    """Yield each verb and option (or argument) below a command that names what need not exist."""
    if isinstance(command, click.Group):
        context = click.Context(command)
        for name in command.list_commands(context):
            yield from outputs(command.get_command(context, name), (*words, name))
        return
    for parameter in command.params:
        if getattr(parameter.type, "exists", True) is False:
            is_option = isinstance(parameter, click.Option)
            yield " ".join(words), parameter.opts[0] if is_option else ""


def is_call(name: str, words: Iterable[str]) -> bool:
    """Return whether a command line is one of a verb; the file of ``db edit`` is between its
    words.
    """
    rest = iter(words)
    return all(word in rest for word in name.split())


@pytest.mark.slow
def test_a_new_verb_or_option_that_writes_is_tried():
    tried = [verb.command() for verb in VERBS.values()]
    named = [*outputs(cli)]
    left = {
        (name, option)
        for name, option in named
        if not any(is_call(name, it) and option in ("", *it) for it in tried)
    }
    assert left == set()
    assert ("pom run", "--junit") in named
    assert ("package key", "") in named


@pytest.mark.slow
@pytest.mark.serial
def test_failed_writes_of_common_verbs(tmp_path, store, monkeypatch):
    try_verbs(["set", "convert"], FEW, tmp_path, store, monkeypatch)


@pytest.mark.nightly
@pytest.mark.serial
@pytest.mark.parametrize("name", VERBS)
def test_failed_writes(name, tmp_path, store, monkeypatch):
    if name in EXTRAS and find_spec(EXTRAS[name]) is None:
        pytest.skip(f"needs {EXTRAS[name]}")
    most = FEWER if name in LONGER else SOME if name in LONG else MANY
    try_verbs([name], most, tmp_path, store, monkeypatch)
