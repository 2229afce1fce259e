"""How much of a match is done again after a change: times as a ratio to a run from nothing, same
bytes, and resumes after kills.

For both examples, side by side on this machine: a run from nothing, one without a change, one with
one case file changed, one with one fit changed; every output is compared byte by byte with that of
a run from nothing of the same input.  Then a run is killed at ten random moments, each attempt
going on from the store of the one before; no result that was kept is computed twice.

    python benchmarks/match_rebuild.py [t37 | c182] [--kills 10] [--only-kills] [--jobs 2]
    python benchmarks/match_rebuild.py t37 --only-kills --folder PLACE --at-once 3  # repeated

Processor time is given next to wall time: on a machine that has other work it is the fairer ratio.
The program runs as installed without extras: from its bytecode, and without dask, which xarray
imports where it finds it.
"""

from __future__ import annotations

import argparse
import json
import os
import random
import resource
import shutil
import signal
import subprocess
import sys
import tempfile
import time
from contextlib import nullcontext
from pathlib import Path
from typing import Any

from flightmech.support.imports import PACKAGES

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
_AIDS = ("judgements", "swaps")  # stages that are written again as more becomes known
_WITHOUT_EXTRAS = 'import sys\nsys.modules.update(dict.fromkeys(("dask", "distributed")))\n'
LIMITS = {"no change": 0.03, "one case": 0.10, "one fit": 0.50}


class Place:
    """A copy of an example with an output folder, and a store."""

    def __init__(self, example: str, folder: Path, jobs: int) -> None:
        self.folder, self.jobs = folder, jobs
        if not (folder / "project").is_dir():
            shutil.copytree(ROOT / "data" / example, folder / "project")
        (folder / "site").mkdir(exist_ok=True)
        (folder / "site" / "sitecustomize.py").write_text(_WITHOUT_EXTRAS, encoding="utf-8")
        subprocess.run(
            [sys.executable, "-m", "compileall", "-q", *PACKAGES],
            cwd=ROOT,
            env=self.environment(),
            check=True,
        )

    def environment(self) -> dict[str, str]:
        """Return the environment of a match and of its child processes."""
        own = {name: text for name, text in os.environ.items() if name != "PYTHONDONTWRITEBYTECODE"}
        return own | {"PYTHONPATH": os.pathsep.join([str(self.folder / "site"), str(ROOT)])}

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
        return words, self.environment() | {"AEROMATCH_STORE": str(self.folder / store)}

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
        return contents(self.folder / "out")

    def clear(self, *names: str) -> None:
        for name in names:
            shutil.rmtree(self.folder / name, ignore_errors=True)


def contents(folder: Path) -> dict[str, bytes]:
    """Return the files of a folder by name."""
    return {
        str(path.relative_to(folder)): path.read_bytes()
        for path in sorted(folder.rglob("*"))
        if path.is_file()
    }


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


def kills(place: Place, count: int, seed: int, at_once: int) -> None:
    """Kill runs at random moments, each going on from the one before, and count results that were
    computed although they were kept.

    A place that holds kills already goes on from them, with at most so many at once; after the last
    of them the run is let come to its end.
    """
    state, expected = _begun(place), place.folder / "expected"
    last = min(count, state["killed"] + at_once)
    while state["killed"] < last:
        # a moment of its own for every kill, however many are done in one call
        moment = random.Random(f"{seed} {state['killed']}").uniform(0.1, 0.6) * state["wall"]
        ended = _killed_after(place, moment)
        state["killed"] += not ended
        _count(place, state)
        print(
            f"  kill {state['killed']}: after {moment:5.1f} s, {len(state['kept'])} results kept, "
            f"{state['repeated']} computed twice",
            flush=True,
        )
        if ended:  # from nothing again
            state["same"] = state["same"] and contents(place.folder / "out") == contents(expected)
            place.clear("out", "killed")
            state["kept"] = {}
        (place.folder / "kills.json").write_text(json.dumps(state), encoding="utf-8")
    if last < count:
        return
    place.run("killed")
    _count(place, state)
    same = state["same"] and contents(place.folder / "out") == contents(expected)
    print(
        f"  resumed: {'same bytes' if same else 'OTHER BYTES'}, "
        f"{state['repeated']} results computed twice",
        flush=True,
    )
    place.clear("out")


def _begun(place: Place) -> dict[str, Any]:
    """Return where the kills of a place stand; of a new one after a run from nothing, whose output
    is what the others have to make.
    """
    file = place.folder / "kills.json"
    if file.is_file():
        return json.loads(file.read_text(encoding="utf-8"))
    place.clear("out", "fresh", "killed", "expected")
    wall, _, _ = place.run("fresh")
    (place.folder / "out").rename(place.folder / "expected")
    return {"wall": wall, "killed": 0, "repeated": 0, "kept": {}, "same": True}


def _killed_after(place: Place, moment: float) -> bool:
    """Kill a run after so many seconds, and return whether it came to its end before."""
    words, environment = place.command("killed")
    process = subprocess.Popen(
        words,
        cwd=place.folder,
        env=environment,
        stdout=subprocess.DEVNULL,
        stderr=subprocess.DEVNULL,
        start_new_session=True,
    )
    try:
        process.wait(moment)
    except subprocess.TimeoutExpired:
        os.killpg(process.pid, signal.SIGKILL)
        process.wait()
    if process.returncode not in (0, -signal.SIGKILL):
        raise SystemExit(f"match ended with exit code {process.returncode}; see {place.folder}")
    return process.returncode == 0


def _count(place: Place, state: dict[str, Any]) -> None:
    """Add what was computed twice: an entry that is made again is another file."""
    entries = (place.folder / "killed").rglob("output.pkl")
    found = {str(file): file.stat().st_ino for file in entries if file.parts[-3] not in _AIDS}
    before = state["kept"]
    state["repeated"] += sum(before.get(file, inode) != inode for file, inode in found.items())
    state["kept"] = found


def main() -> None:
    """Print the table of one or both examples."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("examples", nargs="*", default=sorted(CHANGES), choices=sorted(CHANGES))
    parser.add_argument("--kills", type=int, default=10)
    parser.add_argument("--only-kills", action="store_true")
    parser.add_argument("--jobs", type=int, default=2)
    parser.add_argument(
        "--at-once", type=int, default=10**6, help="kills of one call, with --folder"
    )
    parser.add_argument("--seed", type=int, default=1, help="of the moments of the kills")
    parser.add_argument(
        "--folder", type=Path, help="keeps the kills of one example for the next call"
    )
    given = parser.parse_args()
    for example in given.examples:
        scratch = (
            tempfile.TemporaryDirectory() if given.folder is None else nullcontext(given.folder)
        )
        with scratch as folder:
            place = Place(example, Path(folder).absolute(), given.jobs)
            if not given.only_kills:
                rebuilds(place, example)
            if given.kills:
                kills(place, given.kills, given.seed, given.at_once)


if __name__ == "__main__":
    main()
