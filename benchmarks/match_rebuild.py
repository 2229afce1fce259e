"""How much of a match is done again after a change: times as a ratio to a run from nothing, same
bytes, and resumes after kills.

For both examples, side by side on this machine: a run from nothing, one without a change, one with
one case file changed, one with one fit changed; every output is compared byte by byte with that of
a run from nothing of the same input.  Then a run is killed at ten random moments, each attempt
going on from the store of the one before; no result that was kept is computed twice.

    python benchmarks/match_rebuild.py [t37 | c182] [--kills 10] [--only-kills] [--jobs 2]

Processor time is given next to wall time: on a machine that has other work it is the fairer ratio.
"""

from __future__ import annotations

import argparse
import os
import random
import resource
import shutil
import signal
import subprocess
import sys
import tempfile
import time
from pathlib import Path

ROOT = Path(__file__).resolve().parents[1]
# case and its change (its title), fit and its change (a term that is left out)
CHANGES = {
    "t37": (
        ("cases/21_short_period.toml", "title = ", 'title = "Changed: '),
        ("CY = 1 + beta + phat + rhat", "CY = 1 + beta + rhat"),
    ),
    "c182": (
        ("cases/short_period.toml", "title = ", 'title = "Changed: '),
        ("CY = 1 + beta + phat + rhat", "CY = 1 + beta + rhat"),
    ),
}
LIMITS = {"no change": 0.03, "one case": 0.10, "one fit": 0.50}


class Place:
    """A copy of an example with an output folder, and a store."""

    def __init__(self, example: str, folder: Path, jobs: int) -> None:
        self.folder, self.jobs = folder, jobs
        shutil.copytree(ROOT / "data" / example, folder / "project")

    def command(self, store: str, *options: str) -> tuple[list[str], dict[str, str]]:
        words = [
            sys.executable,
            "-m",
            "aeromatch",
            "match",
            "project/aeromatch.toml",
            "-o",
            "out",
            "-j",
            str(self.jobs),
            *options,
        ]
        return words, {
            **os.environ,
            "AEROMATCH_STORE": str(self.folder / store),
            "PYTHONPATH": str(ROOT),
        }

    def run(self, store: str, *options: str) -> tuple[float, float, str]:
        """Return wall time, processor time and what was printed as remarks."""
        words, environment = self.command(store, *options)
        before, start = resource.getrusage(resource.RUSAGE_CHILDREN), time.perf_counter()
        done = subprocess.run(
            words, cwd=self.folder, env=environment, capture_output=True, text=True, check=True
        )
        wall, after = time.perf_counter() - start, resource.getrusage(resource.RUSAGE_CHILDREN)
        return (
            wall,
            after.ru_utime + after.ru_stime - before.ru_utime - before.ru_stime,
            done.stderr,
        )

    def output(self) -> dict[str, bytes]:
        out = self.folder / "out"
        return {
            str(path.relative_to(out)): path.read_bytes()
            for path in sorted(out.rglob("*"))
            if path.is_file()
        }

    def clear(self, *names: str) -> None:
        for name in names:
            shutil.rmtree(self.folder / name, ignore_errors=True)


def changed(file: Path, old: str, new: str) -> str:
    """Change a file once, and return its text from before."""
    text = file.read_text(encoding="utf-8")
    if old not in text:
        raise SystemExit(f"{file}: nothing reads {old!r}")
    quoted = f"{old}{text.split(old, 1)[1][0]}" if new.endswith(": ") else old
    file.write_text(text.replace(quoted, new, 1), encoding="utf-8")
    return text


def rebuilds(place: Place, example: str) -> None:
    """Print the times of a run from nothing and of rebuilds."""
    (case, old_title, new_title), (old_model, new_model) = CHANGES[example]
    whole = place.run("store")
    print(f"{example}: from nothing {whole[0]:.1f} s, processor {whole[1]:.1f} s", flush=True)
    report("no change", place.run("store"), whole, True)
    for name, file, old, new in (
        ("one case", case, old_title, new_title),
        ("one fit", "aeromatch.toml", old_model, new_model),
    ):
        path = place.folder / "project" / file
        text = changed(path, old, new)
        times = place.run("store", "--explain")
        found = place.output()
        place.clear("out", "fresh")
        place.run("fresh")
        report(name, times, whole, found == place.output())
        path.write_text(text, encoding="utf-8")
        place.run("store")  # back to the start


def report(
    name: str, times: tuple[float, float, str], whole: tuple[float, float, str], same: bool
) -> None:
    """Print one row."""
    wall, processor = times[0] / whole[0], times[1] / whole[1]
    verdict = "within" if processor <= LIMITS[name] else "beyond"
    print(
        f"  {name:<10} {times[0]:6.2f} s {100 * wall:6.1f} %   processor {times[1]:6.2f} s "
        f"{100 * processor:6.1f} %  "
        f"({verdict} {100 * LIMITS[name]:.0f} %)  {'same bytes' if same else 'OTHER BYTES'}",
        flush=True,
    )


def kills(place: Place, count: int) -> None:
    """Kill runs at random moments, each going on from the one before, and count results that were
    computed although they were kept.
    """
    place.clear("out", "fresh", "killed")
    wall, _, _ = place.run("fresh")
    expected = place.output()
    place.clear("out")
    random.seed(1)
    killed = repeated = 0
    before: dict[str, int] = {}
    same = True
    while killed < count:
        words, environment = place.command("killed")
        process = subprocess.Popen(
            words,
            cwd=place.folder,
            env=environment,
            stdout=subprocess.DEVNULL,
            stderr=subprocess.DEVNULL,
            start_new_session=True,
        )
        moment = random.uniform(0.1, 0.6) * wall
        try:
            process.wait(moment)
        except subprocess.TimeoutExpired:
            os.killpg(process.pid, signal.SIGKILL)
            process.wait()
            killed += 1
        made = [
            str(file)
            for file in (place.folder / "killed").rglob("output.pkl")
            if "judgements" not in str(file)
        ]
        inodes = {
            file: os.stat(file).st_ino for file in made
        }  # an entry that is made again is another file
        repeated += sum(before.get(file, inode) != inode for file, inode in inodes.items())
        before |= inodes
        print(
            f"  kill {killed}: after {moment:5.1f} s, {len(made)} results kept, {repeated} "
            f"computed twice",
            flush=True,
        )
        if process.returncode == 0:  # it came to its end: from nothing again
            same = same and place.output() == expected
            place.clear("out", "killed")
            before = {}
    place.run("killed")
    same = same and place.output() == expected
    print(
        f"  resumed: {'same bytes' if same else 'OTHER BYTES'}, {repeated} results computed twice",
        flush=True,
    )


def main() -> None:
    """Print the table of one or both examples."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("examples", nargs="*", default=sorted(CHANGES), choices=sorted(CHANGES))
    parser.add_argument("--kills", type=int, default=10)
    parser.add_argument("--only-kills", action="store_true")
    parser.add_argument("--jobs", type=int, default=2)
    given = parser.parse_args()
    for example in given.examples:
        with tempfile.TemporaryDirectory() as folder:
            place = Place(example, Path(folder), given.jobs)
            if not given.only_kills:
                rebuilds(place, example)
            if given.kills:
                kills(place, given.kills)


if __name__ == "__main__":
    main()
