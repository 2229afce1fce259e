"""Fuzzing of FMUs: descriptions and archives harmed as files get harmed, read, and flown in forked
processes; see README.md.

``python tests/fuzz/fuzz_fmu.py SECONDS [SEED]`` prints how many inputs a second were tried and
every promise that was broken.
"""

from __future__ import annotations

import importlib.util
import io
import os
import random
import re
import select
import signal
import sys
import tempfile
import time
import traceback
import zipfile
from collections import Counter
from collections.abc import Callable, Iterator
from pathlib import Path

import fmpy.fmi2
import fmpy.fmi3  # noqa: F401  what a child needs is loaded before it is forked
import numpy as np

from flightmech.errors import AeromatchError
from pom.fmu.description import read_fmu_interface
from pom.fmu.variable_map import links_of
from pom.fmu.worker import UnpackedFmu, replay_job
from pom.fmu.worker.messages import read_reply, reply_bytes, reply_columns

RUBBISH = (
    "",
    "NaN",
    "-1",
    "0",
    "1e400",
    "4294967296",
    "99999999999999999999",
    "true",
    "é٣",
    "&#0;",
    "x" * 5000,
    "input",
    "local",
    "2.0",
    "3.0",
)
RUBBISH += (
    "output",
    "independent",
    "structuralParameter",
    "constant",
    "calculated",
    "m/s/s/s",
    "deg",
    "furlong",
    "toy",
    "../toy",
    "\u2028",
)
ELEMENTS = (
    "<Real/>",
    "<Integer/>",
    "<String/>",
    "<Float64/>",
    "<Binary/>",
    "<Dimension start='3'/>",
    "<ModelExchange/>",
    "<Unknown index='9'/>",
)
ENTITIES = '<!DOCTYPE x [<!ENTITY a "aaaaaaaaaa">' + "".join(
    f'<!ENTITY {b} "{f"&{a};" * 10}">' for a, b in zip("abcdefgh", "bcdefghi", strict=True)
)
# s, that a forked process may take; it is killed then, which is its own row and no broken promise
TIME = 5.0
_VALUE = re.compile(r'="[^"]*"')
_ELEMENT = re.compile(r"<[A-Za-z][^>]*>")

Way = Callable[[str, random.Random], str]


def _some(pattern: re.Pattern[str], text: str, choice: random.Random) -> re.Match[str] | None:
    found = list(pattern.finditer(text))
    return choice.choice(found) if found else None


def value(text: str, choice: random.Random) -> str:
    """Put rubbish in the place of the value of an attribute."""
    place = _some(_VALUE, text, choice)
    return (
        f'{text[: place.start()]}="{choice.choice(RUBBISH)}"{text[place.end() :]}'
        if place
        else text
    )


def lose(text: str, choice: random.Random) -> str:
    """Take out an element's tag."""
    place = _some(_ELEMENT, text, choice)
    return text[: place.start()] + text[place.end() :] if place else text


def double(text: str, choice: random.Random) -> str:
    """Put a tag there twice."""
    place = _some(_ELEMENT, text, choice)
    return text[: place.end()] + text[place.start() :] if place else text


def element(text: str, choice: random.Random) -> str:
    """Put another element behind a tag."""
    place = _some(_ELEMENT, text, choice)
    return text[: place.end()] + choice.choice(ELEMENTS) + text[place.end() :] if place else text


def swap(text: str, choice: random.Random) -> str:
    """Exchange the values of two attributes."""
    one, other = sorted(
        (_some(_VALUE, text, choice), _some(_VALUE, text, choice)),
        key=lambda place: place.start() if place else 0,
    )
    if not one or not other or one.end() > other.start():
        return text
    return (
        text[: one.start()]
        + other[0]
        + text[one.end() : other.start()]
        + one[0]
        + text[other.end() :]
    )


def cut(text: str, choice: random.Random) -> str:
    """End in the middle."""
    return text[: choice.randrange(len(text) + 1)]


def entities(text: str, choice: random.Random) -> str:
    """Name an entity that stands for 1e8 letters."""
    head, tag, rest = text.partition("<fmiModelDescription")
    return f"{head}{ENTITIES}]>{tag}{rest.replace('toy', '&i;', 1)}"


WAYS: tuple[Way, ...] = (value, value, value, value, lose, double, element, swap, cut, entities)


def harmed(content: dict[str, bytes], choice: random.Random) -> bytes:
    """Return the bytes of an FMU whose description, files or archive are harmed."""
    files, text = dict(content), content["modelDescription.xml"].decode()
    for _ in range(1 + choice.randrange(2)):
        text = choice.choice(WAYS)(text, choice)
    files["modelDescription.xml"] = text.encode("utf-8", "replace")
    if choice.random() < 0.1:
        name = choice.choice([*files])
        files[name] = _flipped(files[name], choice)
    archive = io.BytesIO()
    with zipfile.ZipFile(archive, "w") as file:
        for name, item in files.items():
            file.writestr(name, item)
    return _flipped(archive.getvalue(), choice) if choice.random() < 0.1 else archive.getvalue()


def _flipped(content: bytes, choice: random.Random) -> bytes:
    changed = bytearray(content)
    for _ in range(1 + choice.randrange(4)):
        if changed:
            changed[choice.randrange(len(changed))] ^= 1 << choice.randrange(8)
    return bytes(changed)


def one_input(content: bytes, folder: Path) -> str:
    """Read and fly an FMU; return what became of it.

    Raises
    ------
    AssertionError
        A promise was broken: another error than ours, or a reply that is none.
    """
    path = folder / "harmed.fmu"
    path.write_bytes(content)
    try:
        fmu = read_fmu_interface(path)
        links = links_of(fmu)
    except (AeromatchError, OSError):
        return "refused"
    time_ = np.linspace(0.0, 0.2, 11)
    inputs = {link.variable: 0.01 * time_ for link in [*links.inputs.values()][:3]}
    parameters = {link.variable: 1.0 for link in [*links.parameters.values()][:3]}
    job = {
        "time": time_,
        "inputs": inputs,
        "parameters": parameters,
        "outputs": [link.variable for link in links.outputs.values()][:5],
    }
    return _forked(path, job)


def _forked(path: Path, job: dict) -> str:
    """Fly a job in a forked process, which has all modules loaded: a hundred times faster to start
    than a new one.
    """
    read, write = os.pipe()
    child = os.fork()
    if child == 0:
        code = 1
        try:
            os.close(read)
            os.dup2(os.open(os.devnull, os.O_WRONLY), 1)
            os.dup2(1, 2)
            with tempfile.TemporaryDirectory() as folder:
                try:
                    found = replay_job(UnpackedFmu(str(path), folder, 50_000_000), job)
                    content = reply_bytes(1, found["error"], reply_columns(job, found))
                except (
                    Exception
                ) as error:  # the worker's own answer to a model that cannot be loaded
                    content = reply_bytes(1, f"loading failed: {error}", np.empty((0, 0)))
                while content:
                    content = content[os.write(write, content) :]
            code = 0
        finally:
            os._exit(code)
    os.close(write)
    try:
        if not select.select([read], [], [], TIME)[0]:
            return "hung"
        text, _ = read_reply(
            lambda count: os.read(read, count), 1, (len(job["time"]), len(job["outputs"]))
        )
        return "failed" if text else "flown"
    except EOFError:
        return "crashed"
    finally:
        os.close(read)
        os.kill(child, signal.SIGKILL)
        os.waitpid(child, 0)


def inputs(bases: list[dict[str, bytes]], seed: int) -> Iterator[bytes]:
    """Yield harmed FMUs without end."""
    choice = random.Random(seed)
    while True:
        yield harmed(choice.choice(bases), choice)


def content_of(path: Path) -> dict[str, bytes]:
    """Return the files of an FMU."""
    with zipfile.ZipFile(path) as file:
        return {name: file.read(name) for name in file.namelist()}


def main(seconds: float, seed: int = 1) -> int:
    """Fuzz for a time; return the number of broken promises."""
    spec = importlib.util.spec_from_file_location(
        "pom_conftest", Path(__file__).parents[1] / "pom" / "conftest.py"
    )
    tools = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(tools)
    with tempfile.TemporaryDirectory() as place:
        folder, counts, broken = Path(place), Counter(), 0
        library = tools.compiled("toy.c", folder)
        bases = [
            content_of(
                tools.write_fmu(folder / "base.fmu", tools.describe(kind, True, {}, {}), library)
            )
            for kind in ("lag", "event")
        ]
        one_input(next(inputs(bases, seed)), folder)  # what is loaded late is loaded now
        start = time.monotonic()
        for content in inputs(bases, seed):
            try:
                counts[one_input(content, folder)] += 1
            except Exception:
                broken += 1
                Path(f"broken_{seed}_{sum(counts.values())}.fmu").write_bytes(content)
                traceback.print_exc()
            if time.monotonic() - start > seconds:
                break
    total = sum(counts.values()) + broken
    print(
        f"{total} inputs, {total / seconds:.0f} a second: {dict(counts)}; {broken} broke a promise"
    )
    return broken


if __name__ == "__main__":
    sys.exit(min(main(float(sys.argv[1]), *map(int, sys.argv[2:3])), 1))
