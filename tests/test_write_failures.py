"""Verbs of the command line whose calls that write fail, one call after the other.

Each call fails once (no space on the disk), or with all later ones (defective disk), or the process
is killed there. Each file or folder must then be as before the verb or as after it. A verb that
did not write has exit code 2 and one line with the name of the file.
"""

from __future__ import annotations

import ctypes
import errno
import hashlib
import importlib.util
import json
import os
import random
import shlex
import shutil
import sys
from collections.abc import Iterable, Iterator
from dataclasses import dataclass
from pathlib import Path

import click
import pytest
import write_calls

from aeromatch.cli import cli, main

C182 = Path(__file__).parents[1] / "data" / "c182"
# errno of the failed call, 0 for a kill; whether all later calls fail too
KINDS = {"full disk": (errno.ENOSPC, 0), "defective disk": (errno.EIO, 1), "killed": (0, 0)}
# Greatest number of failed calls of a verb and kind: in .ci/run, and in .ci/nightly.
FEW, MANY = 3, 40
FLIGHT = "flight/check_roll.csv"
# Small inputs by the name of their file.
TEXTS = {
    "inputs.csv": "time,delta_e\n0,0\n1,0.01\n2,0\n",
    "design.toml": """
kind = "multisine"
title = "elevator"
period = "10 s"
band = ["0.2 Hz", "1 Hz"]
[axis.delta_e]
amplitude = "2 deg"
""",
    "ice.toml": """
title = "tail ice"
reference = "NASA, 1993"
valid = "flap 0"
[terms."CL/basic"]
factor = 0.9
factor_stderr = 0.05
""",
    # stands for the program: it prints what it printed of the shipped deck
    "datcom.sh": f"#!/bin/sh\ncp {C182}/datcom/aileron.out for006.dat\n",
}


@dataclass(frozen=True)
class Verb:
    """A command in a folder with inputs, and the files or folders that it writes.

    Names are separated by blanks. ``folder/*`` is each file of the folder by itself.
    """

    words: str
    inputs: str
    targets: str

    def command(self) -> list[str]:
        return shlex.split(self.words)


VERBS = {
    "set": Verb("set aeromatch.toml title Hallo", "c182", "aeromatch.toml"),
    "trial": Verb(
        "set cases/dutch_roll.toml case.window.0 4.5 --trial cases/trial.toml",
        "c182",
        "cases/trial.toml",
    ),
    "mark": Verb(
        "flight mark manoeuvres.csv cruise --kind doublet --control elevator --span 1 2",
        "c182",
        "manoeuvres.csv",
    ),
    "convert": Verb(f"flight convert {FLIGHT} --names names.toml -o r.nc", "c182", "r.nc"),
    "cut": Verb("flight cut r.nc 2 5 -o cut.nc", "r.nc", "cut.nc"),
    "manoeuvres": Verb(
        f"flight manoeuvres {FLIGHT} --names names.toml --find -o m.csv --figure m.png",
        "c182",
        "m.csv m.png",
    ),
    "reconstruct": Verb("flight reconstruct r.nc --aircraft aircraft.toml -o p.nc", "r.nc", "p.nc"),
    "identify": Verb(
        "flight identify p.nc --aircraft aircraft.toml --model CY=1+beta -o fit.nc",
        "p.nc",
        "fit.nc",
    ),
    "select": Verb(
        "flight select p.nc --aircraft aircraft.toml --coefficient CY --variables 'beta phat rhat' -o s.nc",
        "p.nc",
        "s.nc",
    ),
    "validate": Verb(
        "flight validate fit.nc --path p.nc --aircraft aircraft.toml -o board.csv",
        "fit.nc",
        "board.csv",
    ),
    "design": Verb("flight design design.toml -o design", "c182", "design/*"),
    "coefficients": Verb("db coefficients c182.a4.st -o numbers.csv", "avl", "numbers.csv"),
    "from-estimate": Verb(
        "db from-estimate aircraft.toml c182.a0.st c182.a4.st --length-unit ft --CD0 0.02 "
        "--control elevator=+delta_e --control aileron=+delta_a --control rudder=-delta_r "
        "-o avl.nc",
        "avl",
        "avl.nc",
    ),
    "check": Verb(
        f"flight check {FLIGHT} --names names.toml --aircraft aircraft.toml -o q.html",
        "c182",
        "q.html",
    ),
    "plot a record": Verb("flight plot r.nc -o r.png", "r.nc", "r.png"),
    "datcom cells": Verb("datcom cells datcom/aileron.out -o c.csv", "c182", "c.csv"),
    "datcom convert": Verb("datcom convert datcom/aileron.out -o a.nc", "c182", "a.nc"),
    "datcom deck": Verb("datcom deck datcom/c182_study.inp -o d.dcm", "c182", "d.dcm"),
    "datcom draw": Verb("datcom draw datcom/c182_study.inp -o d.svg", "c182", "d.svg"),
    "datcom export": Verb("datcom export datcom/clean.out -o e.mat", "c182", "e.mat"),
    "datcom split": Verb("datcom split datcom/c182_study.inp -o split", "c182", "split/*"),
    "build": Verb("db build aircraft.toml datcom/clean.out -o db.nc", "c182", "db.nc"),
    "scale": Verb("db edit db.nc scale CL/basic --by 1.1 -o e.nc", "db.nc", "e.nc"),
    "edit": Verb("db edit db.nc scale CL/basic --by 1.1 -o db.nc", "db.nc", "db.nc"),
    "previous": Verb("db previous e.nc -o old.nc", "e.nc", "old.nc"),
    "forget": Verb("db forget e.nc -o e.nc", "e.nc", "e.nc"),
    "rescale": Verb(
        "db rescale db.nc aircraft.toml --length-ratio 1.2 -o big.nc --aircraft-output big.toml",
        "db.nc",
        "big.nc big.toml",
    ),
    "plot a term": Verb("db plot db.nc --term CL/basic -o f.png", "db.nc", "f.png"),
    "figures": Verb("db figures db.nc --lr743 --aircraft aircraft.toml -o figs", "db.nc", "figs"),
    "tabulate": Verb("flight tabulate fit.nc --database db.nc -o t.nc", "fit.nc db.nc", "t.nc"),
    "import": Verb("db import model.xml -o i.nc", "model.xml", "i.nc"),
    "import an aircraft": Verb(
        "db import-aircraft model.xml -o ac.nc --force", "model.xml", "ac.nc ac.toml"
    ),
    "export a folder": Verb("db export db.nc -o tables --to csv", "db.nc", "tables"),
    "export daveml": Verb("db export db.nc -o db.dml --to daveml", "db.nc", "db.dml"),
    "export jsbsim": Verb(
        "db export db.nc -o model.xml --to jsbsim --aircraft aircraft.toml", "db.nc", "model.xml"
    ),
    "export matlab": Verb("db export db.nc -o db.mat --to matlab", "db.nc", "db.mat"),
    "fmu": Verb("fmu write aircraft.toml db.nc -o m.fmu", "db.nc", "m.fmu"),
    "simulate": Verb(
        "fmu simulate aircraft.toml db.nc --inputs inputs.csv -o s.nc", "db.nc", "s.nc"
    ),
    "pom init": Verb(
        f"pom init {FLIGHT} --test 2.d.7 --names names.toml --aircraft aircraft.toml -o c.toml",
        "c182",
        "c.toml",
    ),
    "pom run": Verb(
        "pom run cases/dutch_roll.toml --model m=m.fmu --no-pdf -o rep -j1", "m.fmu", "rep"
    ),
    "pom report": Verb("pom report rep -o again --no-pdf", "rep", "again"),
    "tolerances": Verb("pom tolerances --write t.csv", "c182", "t.csv"),
    "pom schema": Verb("pom schema -o s.json", "c182", "s.json"),
    "schema": Verb("schema project -o p.json", "c182", "p.json"),
    "init": Verb(
        f"init new --records {FLIGHT} --names names.toml",
        "c182",
        "new/cases new/aeromatch.toml new/aircraft.toml new/manoeuvres.csv new/.draft/aeromatch.toml "
        "new/.draft/aircraft.toml new/.draft/manoeuvres.csv new/.draft/answers.json",
    ),
    "example": Verb("example c182 new --inputs-only", "c182", "new"),
    "blend": Verb("db edit db.nc blend e.nc CL/basic -o b.nc", "db.nc e.nc", "b.nc"),
    "ice": Verb("db edit db.nc ice ice.toml -o b.nc", "db.nc", "b.nc"),
    "delete": Verb("db edit db.nc delete CL/basic -o b.nc", "db.nc", "b.nc"),
    "extend": Verb("db edit db.nc extend CL/basic --axis 'alpha=40 deg' -o b.nc", "db.nc", "b.nc"),
    "move-reference": Verb("db edit db.nc move-reference --x -2.1 -o b.nc", "db.nc", "b.nc"),
    "regrid": Verb(
        "db edit db.nc regrid CL/basic --axis 'alpha=0 4 8 deg' -o b.nc", "db.nc", "b.nc"
    ),
    "replace": Verb("db edit db.nc replace e.nc CL/basic -o b.nc", "db.nc e.nc", "b.nc"),
    "set a node": Verb("db edit db.nc set CL/qhat --value 5 -o b.nc", "db.nc", "b.nc"),
    "shift": Verb("db edit db.nc shift CL/basic --by 0.01 -o b.nc", "db.nc", "b.nc"),
    "datcom run": Verb(
        "datcom run datcom/c182_study.inp --program ./datcom.sh -o ran", "c182", "ran"
    ),
    "datcom plot": Verb(
        "datcom plot no_first_page.for013 --listing no_first_page.out -o fine.nc",
        "listing",
        "fine.nc",
    ),
    "fit-linear": Verb(
        "flight fit-linear p.nc --motion lateral --window 2 6 -o lat.nc", "p.nc", "lat.nc"
    ),
    "balance": Verb(
        "flight balance tail_1.csv tail_2.csv --setup balance.toml --model 'CL = 1 + alpha' -o fits",
        "tunnel",
        "fits",
    ),
    "balance at set points": Verb(
        "flight balance tail_1.csv tail_2.csv --setup balance.toml --table points "
        "--step '2 deg' --x-ref '0 m'",
        "tunnel",
        "points",
    ),
    "markers": Verb(
        "flight markers cameras.csv --setup markers.toml -o body.nc", "cameras", "body.nc"
    ),
    "diagnose": Verb(
        "pom diagnose cases/dutch_roll.toml --prior e.nc --final db.nc --replays 8 -j1 -o c.nc",
        "db.nc e.nc",
        "c.nc",
    ),
}
# Verbs with an output that are not tried: their inputs take minutes to make (a match, flights with
# an engine or a gear, a mechanism of several bodies).
NOT_TRIED = {
    *("demo", "match", "package make", "view", "pom tune", "pom spread"),
    *("flight fit", "flight plan", "flight report", "flight multibody"),
    *("flight controls", "flight engine", "flight gear", "flight ground-effect"),
    "flight stall",
    "db estimate",  # with a package of an extra
    # needs a database that keeps its flown states; it writes a text by the usual writer
    "db envelope",
}
# Folders whose files are copied, and examples that write their files, by the name of an input.
COPIED = {
    "avl": C182.parent / "avl",
    "listing": Path(__file__).parent / "datcom_io" / "listings",
}
EXAMPLES = Path(__file__).parents[1] / "examples" / "flapping_vehicle"
WRITTEN = ("tunnel", "cameras")
# Verbs that make the inputs of others.
MAKERS = {
    "r.nc": "convert",
    "e.nc": "scale",
    "fit.nc": "identify",
    "model.xml": "export jsbsim",
    "p.nc": "reconstruct",
    "db.nc": "build",
    "m.fmu": "fmu",
    "rep": "pom run",
}


def run_verb(words: list[str]) -> int:
    """Run the command line in this process, and return its exit code."""
    sys.argv = ["aeromatch", *words]
    try:
        main()
    except SystemExit as end:
        return end.code if isinstance(end.code, int) else int(bool(end.code))
    return 0


def write_example(name: str, folder: Path) -> None:
    """Write the files of a module of the examples into a folder."""
    spec = importlib.util.spec_from_file_location(name, EXAMPLES / f"{name}.py")
    module = importlib.util.module_from_spec(spec)
    sys.modules[name] = module
    spec.loader.exec_module(module)
    module.main(folder)


def make_inputs(names: str, folder: Path) -> None:
    """Fill a folder with the inputs of a verb."""
    shutil.copytree(C182, folder, dirs_exist_ok=True)
    for file, text in TEXTS.items():
        (folder / file).write_text(text)
        (folder / file).chmod(0o700 if file.endswith(".sh") else 0o600)
    for name in names.split():
        if name in COPIED:
            shutil.copytree(COPIED[name], folder, dirs_exist_ok=True)
        if name in WRITTEN:
            write_example(name, folder)
        if name in MAKERS:
            verb = VERBS[MAKERS[name]]
            make_inputs(verb.inputs, folder)
            os.chdir(folder)
            assert run_verb(verb.command()) in (0, 1), name


def state_of(path: Path) -> object:
    """Return what a file or folder holds; None without one."""
    if path.is_dir():
        files = sorted(item for item in path.rglob("*") if item.is_file())
        return [(str(file.relative_to(path)), state_of(file)) for file in files]
    return hashlib.sha256(path.read_bytes()).hexdigest() if path.exists() else None


class Trials:
    """Runs of one verb in children of this process, each in a fresh folder with the inputs."""

    def __init__(self, verb: Verb, folder: Path) -> None:
        self.verb, self.log = verb, folder / "log"
        self.inputs, self.work = folder / "inputs", folder / "run"
        self.library = ctypes.CDLL(os.environ["LD_PRELOAD"])
        self.library.count_of_calls.restype = ctypes.c_long
        make_inputs(verb.inputs, self.inputs)
        self.targets = verb.targets.split()

    def refresh(self) -> list[object]:
        """Make a fresh folder, and return the states of the targets."""
        os.chdir(self.inputs)
        shutil.rmtree(self.work, ignore_errors=True)
        # links: a verb that changes a file in place would change the inputs, which is a fault too
        shutil.copytree(self.inputs, self.work, copy_function=os.link)
        return self.states()

    def states(self) -> list[object]:
        return [state_of(self.work / name) for name in self.targets]

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
            # the first and the last calls are those of files, folders and renamings
            inner = random.Random(1).sample(numbers[1:-1], most - 2)
            numbers = [1, *sorted(inner), calls]
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
            # the file, or its folder
            words = {word for name in names for word in Path(name).parts}
            is_named = any(word in line for line in lines for word in words)
            if code == 2 and (len(lines) != 1 or not is_named):
                faults.append(f"not one line with the name of the file: {output[-300:]}")
        if "Traceback" in output:
            faults.append("a traceback")
        if now == new:
            # some verbs do not write over their own file
            return faults
        again, output, _ = self.run()
        if again not in (0, 1):
            faults.append(f"the next run ends with {again}: {output[-300:]}")
        left = [path.name for path in self.work.rglob("*.part")]
        return faults + [f"{name} is left after the next run" for name in left]


def run_verb_quietly(trials: Trials, verb: Verb) -> int:
    """Run a verb once in this process, so that its modules are loaded in all children."""
    trials.refresh()
    os.chdir(trials.work)
    return run_verb(verb.command())


def find_faults_of_verbs(folder: Path) -> None:
    """Try the verbs of the environment; this function runs in a process of `run_preloaded`."""
    names, most = json.loads(os.environ["AEROMATCH_FAILED_WRITES"])
    faults = []
    for number, name in enumerate(names):
        place = folder / str(number)
        place.mkdir()
        faults += [f"{name}: {text}" for text in Trials(VERBS[name], place).find_faults(most)]
    assert not faults, "\n".join([f"{len(faults)} faults", *faults[:20]])


def try_verbs(names: list[str], most: int, folder: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("AEROMATCH_FAILED_WRITES", json.dumps([names, most]))
    write_calls.run_preloaded(find_faults_of_verbs, folder)


pytestmark = pytest.mark.skipif(sys.platform != "linux", reason="a library in front of the C one")


def writing_verbs(command: click.Command, words: tuple[str, ...] = ()) -> Iterator[str]:
    """Yield the verbs with an output below a command."""
    if isinstance(command, click.Group):
        context = click.Context(command)
        for name in command.list_commands(context):
            yield from writing_verbs(command.get_command(context, name), (*words, name))
    elif any("-o" in option.opts for option in command.params):
        yield " ".join(words)


def is_call(name: str, words: Iterable[str]) -> bool:
    """Return whether a command line is one of a verb; the file of ``db edit`` is between its words."""
    rest = iter(words)
    return all(word in rest for word in name.split())


@pytest.mark.slow
def test_a_new_verb_that_writes_is_tried():
    tried = [verb.command() for verb in VERBS.values()]
    left = {name for name in writing_verbs(cli) if not any(is_call(name, it) for it in tried)}
    assert left == NOT_TRIED


@pytest.mark.slow
@pytest.mark.serial
def test_failed_writes_of_common_verbs(tmp_path, monkeypatch):
    try_verbs(["set", "convert"], FEW, tmp_path, monkeypatch)


@pytest.mark.nightly
@pytest.mark.serial
@pytest.mark.parametrize("name", VERBS)
def test_failed_writes(name, tmp_path, monkeypatch):
    try_verbs([name], MANY, tmp_path, monkeypatch)
