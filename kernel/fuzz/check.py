"""The kernel under sanitizers and fuzzers: ``python kernel/fuzz/check.py [--seconds 20] [--only
NAME]``; needs clang.

Compiles the kernel and the shell with address, undefined-behaviour, memory and thread sanitizers
into a temporary folder, flies every model of ``models.py`` in every mode (``flights.c``), and runs
the libFuzzer targets (``fuzz_*.c``) for a bounded time each, from seeds made here.  An input that
breaks a promise is kept in the folder of ``--keep`` and ends the run with exit code 1.
"""

from __future__ import annotations

import argparse
import os
import random
import re
import shutil
import subprocess
import sys
import tempfile
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path

KERNEL = Path(__file__).resolve().parents[1]
TARGETS = ("block", "calls", "fmu")
FLAGS = [
    "-std=c11",
    "-g",
    "-O1",
    "-ffp-contract=off",
    "-fno-omit-frame-pointer",
    "-fno-sanitize-recover=all",
    "-pthread",
    "-Wall",
    "-Wextra",
    "-Wno-psabi",
]
# float-cast-overflow is not part of `undefined`; division by zero is defined for IEEE numbers and
# meant where it occurs
FOUND = "address,undefined,float-cast-overflow"
MOST_MEMORY = 2048  # of a fuzzer [MB]
SEEDS = 40


def clang() -> str | None:
    """Return the compiler, the plain name before a numbered one; None when there is none."""
    names = ["clang", *(f"clang-{version}" for version in range(22, 13, -1))]
    return next((found for name in names if (found := shutil.which(name))), None)


def run(command: list[str], environment: dict[str, str], what: str) -> str:
    """Run a command and return its output; end with it when it fails."""
    done = subprocess.run(
        command, env=environment, capture_output=True, text=True, errors="replace"
    )
    if done.returncode:
        sys.exit(
            f"{what}: exit code {done.returncode}\n{done.stdout[-2000:]}\n{done.stderr[-6000:]}"
        )
    return done.stdout + done.stderr


def objects(compiler: str, sanitize: str, folder: Path) -> list[str]:
    """Compile the kernel, the shell and what all programs share; return the object files."""
    folder.mkdir()
    sources = [
        *(KERNEL / "src").glob("*/*.c"),
        *(KERNEL / "shell").glob("*.c"),
        *(KERNEL / "fuzz").glob("drive*.c"),
    ]
    with ThreadPoolExecutor(os.cpu_count()) as pool:
        return list(pool.map(lambda source: compiled(compiler, sanitize, source, folder), sources))


def compiled(compiler: str, sanitize: str, source: Path, folder: Path) -> str:
    """Compile one source and return the object file."""
    to = folder / f"{source.parent.name}_{source.stem}.o"
    include = [
        f"-I{folder}"
        for folder in (
            KERNEL / "include",
            *(KERNEL / "src").glob("*/"),
            KERNEL / "shell",
            KERNEL / "fuzz",
        )
    ]
    command = [
        compiler,
        *FLAGS,
        f"-fsanitize={sanitize}",
        *include,
        "-c",
        str(source),
        "-o",
        str(to),
    ]
    if subprocess.run(command).returncode:
        sys.exit(f"{source} did not compile; the compiler's messages stand above")
    return str(to)


def linked(
    compiler: str, sanitize: str, source: Path, parts: list[str], folder: Path, extra: str = ""
) -> str:
    """Compile and link a program and return its path."""
    own = compiled(compiler, sanitize + (",fuzzer-no-link" if extra else ""), source, folder)
    to = str(folder / source.stem)
    command = [compiler, *FLAGS, f"-fsanitize={sanitize}{extra}", own, *parts, "-lm", "-o", to]
    if subprocess.run(command).returncode:
        sys.exit(f"{source} did not link; the messages stand above")
    return to


def write_models(folder: Path) -> None:
    """Compile the models in a process of their own and write ``<name>/model.bin``."""
    code = (
        "import sys, pathlib; sys.path[:0] = sys.argv[1:3]; import models\n"
        "for name, sim in models.compiled().items():\n"
        "    place = pathlib.Path(sys.argv[3]) / name; place.mkdir(); (place / "
        "'model.bin').write_bytes(sim.block)"
    )
    subprocess.run(
        [sys.executable, "-c", code, str(KERNEL / "fuzz"), str(KERNEL.parent), str(folder)],
        check=True,
    )


def write_seeds(target: str, models: Path, folder: Path) -> None:
    """Write the first inputs of a fuzzer: whole blocks, or choices at random."""
    folder.mkdir()
    if target == "block":
        for block in models.glob("*/model.bin"):
            shutil.copy(block, folder / block.parent.name)
        return
    rng = random.Random(target)
    for k in range(SEEDS):
        (folder / str(k)).write_bytes(rng.randbytes(rng.choice((100, 400, 1500))))


def fly(
    compiler: str, sanitize: str, folder: Path, environment: dict[str, str], *arguments: str
) -> None:
    """Fly every model under one set of sanitizers."""
    place = folder / sanitize.split(",")[0]
    program = linked(
        compiler, sanitize, KERNEL / "fuzz" / "flights.c", objects(compiler, sanitize, place), place
    )
    print(f"{sanitize}: {run([program, *arguments], environment, sanitize).strip()}", flush=True)


def fuzz(
    compiler: str,
    targets: list[str],
    seconds: int,
    keep: Path,
    folder: Path,
    environment: dict[str, str],
) -> None:
    """Run the fuzzers, one after the other."""
    place, models = folder / "fuzz", Path(environment["AEROMATCH_MODELS"])
    parts = objects(compiler, FOUND + ",fuzzer-no-link", place)
    for target in targets:
        program = linked(
            compiler, FOUND, KERNEL / "fuzz" / f"fuzz_{target}.c", parts, place, ",fuzzer"
        )
        write_seeds(target, models, folder / f"seeds_{target}")
        limits = [
            f"-max_total_time={seconds}",
            "-timeout=120",
            "-report_slow_units=120",
            f"-rss_limit_mb={MOST_MEMORY}",
            "-max_len=131072",
            "-print_final_stats=1",
        ]
        seeds = str(folder / f"seeds_{target}")
        output = run(
            [program, *limits, f"-artifact_prefix={keep}/{target}-", seeds],
            environment,
            f"fuzzer of {target}",
        )
        stat = {name: int(value) for name, value in re.findall(r"stat::(\w+): +(\d+)", output)}
        edges = re.findall(r"cov: (\d+)", output)[-1]
        print(
            f"{target}: {stat['number_of_executed_units']} inputs tried, {edges} edges "
            f"reached, slowest {stat['slowest_unit_time_sec']} s",
            flush=True,
        )


def main() -> None:
    """Run what the command line requests."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--seconds", type=int, default=20, help="time of each fuzzer [s]")
    parser.add_argument(
        "--only", choices=("address", "memory", "thread", *TARGETS), help="one of the checks"
    )
    parser.add_argument(
        "--keep", type=Path, default=Path.cwd(), help="folder for inputs that break a promise"
    )
    given = parser.parse_args()
    compiler = clang()
    if not compiler:
        sys.exit("no clang here; on Debian and Ubuntu: sudo apt-get install clang libclang-rt-dev")
    given.keep.mkdir(parents=True, exist_ok=True)
    with tempfile.TemporaryDirectory() as temporary:
        folder = Path(temporary)
        environment = os.environ | {
            "AEROMATCH_MODELS": str(folder / "models"),
            "ASAN_OPTIONS": "detect_leaks=1:detect_stack_use_after_return=1",
        }
        (folder / "models").mkdir()
        write_models(folder / "models")
        for sanitize, *arguments in ((FOUND,), ("memory",), ("thread", "threads")):
            if given.only in (None, sanitize.split(",")[0]):
                fly(compiler, sanitize, folder, environment, *arguments)
        targets = [target for target in TARGETS if given.only in (None, target)]
        if targets:
            fuzz(compiler, targets, given.seconds, given.keep, folder, environment)


if __name__ == "__main__":
    main()
