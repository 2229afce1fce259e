"""Fuzzing of every reader through the commands: real files of each kind, harmed, given to the verbs
that read them; see README.md.

``python tests/fuzz/fuzz_readers.py SECONDS [KIND ...]`` spends SECONDS on each kind of file.
"""

from __future__ import annotations

import argparse
import os
import random
import re
import resource
import shutil
import signal
import sys
import tempfile
import time
from collections import Counter
from collections.abc import Sequence
from contextlib import suppress
from pathlib import Path
from typing import NamedTuple

import harm_files
import reader_kinds

# Promises of a command about any file. Time of the processor, because a busy machine is no fault
# of a reader; a process that only waits ends after `WAIT`, in which a busy machine gives it
# `SECONDS`.
SECONDS, WAIT, MEMORY = 20, 400, 2 * 1024**3  # s, s, byte
# Address space of a process: a fault that allocates without end must not end the machine.
ADDRESSES = 8 * 1024**3
_TRACE = re.compile(r'File "[^"]*?((?:\w+/){0,2}\w+\.py)", line (\d+)')


class Outcome(NamedTuple):
    """What became of a command: the broken promise or an empty text, exit code, what it printed."""

    broken: str
    code: int
    printed: str
    seconds: float
    memory: int


def run_command(arguments: Sequence[str], folder: Path, listing: Path | None = None) -> Outcome:
    """Run ``aeromatch`` with arguments in a forked process with limits.

    Parameters
    ----------
    arguments : sequence of str
    folder : Path
        Working folder.
    listing : Path, optional
        File to which the names of the imported modules are written.
    """
    output = folder / "printed.txt"
    start = time.monotonic()
    child = os.fork()
    if child == 0:
        _become_command(arguments, folder, output, listing)
    status, usage = _wait(child, start)
    printed = output.read_text("utf-8", "replace")
    code = os.waitstatus_to_exitcode(status)
    memory = 1024 * usage.ru_maxrss
    seconds = usage.ru_utime + usage.ru_stime
    return Outcome(_broken_promise(code, printed, memory), code, printed, seconds, memory)


def _become_command(
    arguments: Sequence[str], folder: Path, output: Path, listing: Path | None
) -> None:
    """Replace this forked process by a command; does not return."""
    code = 70
    try:
        os.setsid()
        stream = os.open(output, os.O_WRONLY | os.O_CREAT | os.O_TRUNC)
        os.dup2(stream, 1)
        os.dup2(stream, 2)
        resource.setrlimit(resource.RLIMIT_CORE, (0, 0))
        resource.setrlimit(resource.RLIMIT_CPU, (SECONDS, SECONDS + 1))
        resource.setrlimit(resource.RLIMIT_AS, (ADDRESSES, ADDRESSES))
        os.chdir(folder)
        sys.argv = ["aeromatch", *arguments]
        from aeromatch.cli import main  # here, so that a kind imports no more than it needs

        try:
            main()
        except SystemExit as error:
            code = error.code if isinstance(error.code, int) else 0
        sys.stdout.flush()
        sys.stderr.flush()
        if listing:
            listing.write_text("\n".join(sys.modules))
    finally:
        os._exit(code)


def _wait(child: int, start: float) -> tuple[int, resource.struct_rusage]:
    """Wait for a process; end its group when it takes too long."""
    while True:
        done, status, usage = os.wait4(child, os.WNOHANG)
        if done:
            break
        if time.monotonic() - start > WAIT:
            os.killpg(child, signal.SIGKILL)
            _, status, usage = os.wait4(child, 0)
            break
        time.sleep(0.004)
    with suppress(ProcessLookupError, PermissionError):
        os.killpg(child, signal.SIGKILL)  # what the command has left running
    return status, usage


def _broken_promise(code: int, printed: str, memory: int) -> str:
    """Return which promise a command broke and where, as one line; an empty text for none."""
    if code in (-signal.SIGXCPU, -signal.SIGKILL):
        return f"more than {SECONDS} s"
    if code < 0:
        return f"ended by {signal.Signals(-code).name}"
    if memory > MEMORY:
        return f"{memory / 1024**3:.1f} GB"
    if "Traceback (most recent call last)" in printed or code not in (0, 1, 2):
        places = [f"{file}:{line}" for file, line in _TRACE.findall(printed)]
        own = [place for place in places if place.split("/")[0] not in ("concurrent", "click")]
        faults = re.findall(r"^\w[\w.]*(?:Error|Exception|Interrupt|Warning)\b.*", printed, re.M)
        last = faults[-1] if faults else f"exit code {code}"
        return f"{' > '.join(own[-4:])}: {last[:120]}"
    return ""


def import_needed(kind: reader_kinds.Kind, folder: Path) -> None:
    """Import here what the commands of a kind import, and demand that they accept sound files.

    A forked process then starts in milliseconds.
    """
    listing = folder / "modules.txt"
    for verb in kind.verbs:
        outcome = run_command(verb, folder, listing)
        if outcome.code not in (0, 1) or outcome.broken:
            sys.exit(
                f"{kind.name}: aeromatch {' '.join(verb)}, of a sound "
                f"file:\n{outcome.printed[-2000:]}"
            )
        _clear_output(folder)
        for name in listing.read_text().split("\n"):
            try:
                __import__(name)
            except Exception:
                continue  # a module of the command's own


def _clear_output(folder: Path) -> None:
    for path in folder.glob("out*"):
        shutil.rmtree(path) if path.is_dir() and not path.is_symlink() else path.unlink()


def fuzz_kind(kind: reader_kinds.Kind, folder: Path, seconds: float, seed: int, keep: Path) -> int:
    """Fuzz the reader of one kind for a time; print and return the number of different faults."""
    place = folder / kind.file
    sound = place.read_bytes()
    harm = {"hdf5": harm_files.harm_hdf5, "text": harm_files.harm_text}.get(
        kind.harm, harm_files.harm_bytes
    )
    import_needed(kind, folder)
    counts: Counter[str] = Counter()
    faults: Counter[str] = Counter()
    slowest, largest, number = 0.0, 0, 0
    start = time.monotonic()
    while time.monotonic() - start < seconds:
        number += 1
        choice = random.Random(f"{kind.name} {seed} {number}")
        content = harm(sound, choice)
        place.write_bytes(content)
        verb = choice.choice(kind.verbs)
        outcome = run_command(verb, folder)
        slowest, largest = max(slowest, outcome.seconds), max(largest, outcome.memory)
        if not outcome.broken:
            counts["refused" if outcome.code == 2 else "read"] += 1
        else:
            if outcome.broken not in faults:
                name = f"{kind.name}-{seed}-{number}"
                (keep / f"{name}{place.suffix}").write_bytes(content)
                (keep / f"{name}.txt").write_text(
                    f"aeromatch {' '.join(verb)}\n{outcome.printed[-6000:]}"
                )
                print(f"  {name}: {' '.join(verb)}: {outcome.broken}", flush=True)
            faults[outcome.broken] += 1
        _clear_output(folder)
    place.write_bytes(sound)
    print(
        f"{kind.name}: {number} files, {dict(counts)}, {faults.total()} broke a promise in "
        f"{len(faults)} ways; slowest {slowest:.1f} s, most memory {largest / 1024**2:.0f} MB",
        flush=True,
    )
    return len(faults)


def without_seal(content: bytes) -> bytes:
    """Return an HDF5 file as another program writes it, without the seal behind its end."""
    # HDF5 File Format Specification 3.0, section II.A: address of the end of the file
    at = {0: 40, 1: 44}.get(content[8], 28)
    return content[: int.from_bytes(content[at : at + 8], "little")]


def main() -> int:
    """Fuzz the kinds of the command line; return 1 when a promise was broken."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("seconds", type=float, help="time of each kind [s]")
    parser.add_argument("kinds", nargs="*", help=f"of {', '.join(reader_kinds.NAMES)}; all if none")
    parser.add_argument("--seed", type=int, default=int(time.time()) % 100000)
    parser.add_argument(
        "--keep", type=Path, default=Path.cwd(), help="folder for files that break a promise"
    )
    given = parser.parse_args()
    unknown = set(given.kinds) - {*reader_kinds.NAMES}
    if unknown:
        parser.error(f"no kind {', '.join(unknown)}; there are {', '.join(reader_kinds.NAMES)}")
    given.keep.mkdir(parents=True, exist_ok=True)
    os.environ["OPENBLAS_NUM_THREADS"] = "1"
    faults = 0
    with tempfile.TemporaryDirectory() as temporary:
        folder = Path(temporary)
        kinds = reader_kinds.make_kinds(folder, given.kinds, run_command, without_seal)
        print(f"seed {given.seed}, {len(kinds)} kinds, {given.seconds:.0f} s each", flush=True)
        for kind in kinds:
            faults += fuzz_kind(kind, folder, given.seconds, given.seed, given.keep)
    return min(faults, 1)


if __name__ == "__main__":
    sys.exit(main())
