"""Reading DATCOM listings: against regular expressions over the text and against pandas.read_fwf,
ratios within one run; memory of 200 MB.

No published reader runs on these listings today (PyDatcom 0.2.5 is Python 2 and, converted, stops
at each T-37 listing), so its way is written down here in short: one regular expression per kind of
page over the whole text, rows cut by columns.  Like it, both peers read static and dynamic tables
only; the reader reads everything that is printed. T-37: the clean listing, nothing but such pages;
corpus: all listings.

    python benchmarks/datcom_reading.py [FOLDER]

FOLDER is that of the corpus, ../shared/data/datcom unless given; without it the T-37 listings.
"""

from __future__ import annotations

import io
import math
import re
import subprocess
import sys
import time
from collections.abc import Callable
from pathlib import Path
from tempfile import TemporaryDirectory

import pandas as pd

import datcom_io
from flightmech.support.console import print_table

ROOT = Path(__file__).parents[1]
T37 = ROOT / "data" / "t37" / "datcom"
REPEATS = 3
SMALL, LARGE = 100_000, 200_000_000  # bytes

# ends of the columns, as the format statements of the program set them
STATIC = dict(
    zip(
        ["ALPHA", "CD", "CL", "CM", "CN", "CA", "XCP", "CLA", "CMA", "CYB", "CNB", "CLB"],
        [
            (0, 8),
            (8, 17),
            (17, 26),
            (26, 36),
            (36, 44),
            (44, 53),
            (53, 63),
            (63, 76),
            (76, 89),
            (89, 102),
            (102, 115),
            (115, 128),
        ],
    )
)
DYNAMIC = dict(
    zip(
        ["ALPHA", "CLQ", "CMQ", "CLAD", "CMAD", "CLP", "CYP", "CNP", "CNR", "CLR"],
        [
            (0, 11),
            (11, 24),
            (24, 37),
            (37, 51),
            (51, 64),
            (64, 77),
            (77, 90),
            (90, 103),
            (103, 116),
            (116, 129),
        ],
    )
)
_PAGE = (
    r"{title}.*\n(?:.*\n){{1,12}}?.*MACH +ALTITUDE.*\n.*\n.*\n(?P<conditions>.*)\n"
    r"(?:.*\n){{1,3}}?0 *ALPHA +{second}.*\n0? *\n(?P<rows>(?: +-?\d*\.\d.*\n)+)"
)
PAGES = (
    (re.compile(_PAGE.format(title="CHARACTERISTICS AT ANGLE OF ATTACK", second="CD")), STATIC),
    (re.compile(_PAGE.format(title=" DYNAMIC DERIVATIVES", second="CLQ")), DYNAMIC),
)
_MISSING = ("NDM", "NA", "")
_NO_NUMBERS = [*_MISSING, *("*" * width for width in range(1, 14))]


def _number(text: str) -> float:
    text = text.strip()
    return math.nan if text in _MISSING or not text.strip("*") else float(text)


def by_expressions(files: list[Path]) -> int:
    """Return how many numbers the static and dynamic tables hold."""
    count = 0
    for file in files:
        text = file.read_text("latin-1")
        for page, columns in PAGES:
            for found in page.finditer(text):
                rows = found["rows"].splitlines()
                values = {
                    name: [_number(row[first:after]) for row in rows]
                    for name, (first, after) in columns.items()
                }
                count += sum(x == x for column in values.values() for x in column)
    return count


def by_pandas(files: list[Path]) -> int:
    """Return the same, the tables found line by line and read by `pandas.read_fwf`."""
    count = 0
    for file in files:
        columns, rows = None, []
        for line in [*file.read_text("latin-1").splitlines(keepends=True), "1"]:
            if columns is not None and line.startswith(" ") and re.match(r" *-?\d*\.\d", line):
                rows.append(line)
            elif columns is None or rows:
                if rows:
                    frame = pd.read_fwf(
                        io.StringIO("".join(rows)),
                        colspecs=list(columns.values()),
                        names=list(columns),
                        na_values=_NO_NUMBERS,
                    )
                    count += int(frame.notna().sum().sum())
                opened = re.match(r"0 *ALPHA +(?:CD +CL +CM +CN|(CLQ)) ", line)
                columns, rows = (DYNAMIC if opened[1] else STATIC) if opened else None, []
    return count


def read_only(files: list[Path]) -> None:
    for file in files:
        datcom_io.read(file)


def read_cells(files: list[Path]) -> int:
    return sum(int(datcom_io.read(file).cells()["value"].notna().sum()) for file in files)


def iterate_cells(files: list[Path]) -> int:
    return sum(
        int(case.cells()["value"].notna().sum())
        for file in files
        for case in datcom_io.iterate(file)
    )


def trees(files: list[Path]) -> None:
    for file in files:
        datcom_io.read(file).to_datatree()


WAYS: dict[str, Callable[[list[Path]], int | None]] = {
    "regular expressions": by_expressions,
    "pandas.read_fwf": by_pandas,
    "read": read_only,
    "read, Listing.cells": read_cells,
    "iterate, Case.cells": iterate_cells,
    "read, to_datatree": trees,
}


def time_ways(files: list[Path], title: str) -> None:
    """Time every way on the files, best of some repeats, and print."""
    size = sum(file.stat().st_size for file in files) / 1e6
    best = dict.fromkeys(WAYS, math.inf)
    numbers = {}
    for _ in range(REPEATS):
        for name, way in WAYS.items():
            start = time.process_time()
            numbers[name] = way(files)
            best[name] = min(best[name], time.process_time() - start)
    rows = [
        (
            name,
            f"{seconds:.2f}",
            f"{size / seconds:.1f}",
            *(
                ("", "")
                if (count := numbers[name]) is None
                else (f"{count:,}", f"{1e-3 * count / seconds:.0f}")
            ),
            *(f"{best[peer] / seconds:.1f}" for peer in list(WAYS)[:2]),
        )
        for name, seconds in best.items()
    ]
    columns = ("way", "s", "MB/s", "numbers", "1000 numbers/s", "x regular expressions", "x pandas")
    print_table(columns, rows, f"{title}: {len(files)} listings, {size:.1f} MB", right=columns[1:])


_USED = "print(resource.getrusage(resource.RUSAGE_SELF).ru_maxrss, time.process_time())"
MEMORY = {
    "import": "",
    "read": "listing = datcom_io.read(path); pages = len(listing.pages)",
    "iterate, Case.cells": "pages = sum(len(case.cells()) > 0 for case in datcom_io.iterate(path))",
}


def memory(files: list[Path], folder: Path) -> None:
    """Print the largest resident memory of a process that reads one large listing."""
    path = folder / "large.out"
    once = b"\n".join(file.read_bytes() for file in files) + b"\n"
    with path.open("wb") as stream:
        for _ in range(math.ceil(LARGE / len(once))):
            stream.write(once)
    rows = []
    for name, work in MEMORY.items():
        code = f"import resource, time, pandas, datcom_io\npath = {str(path)!r}\n{work}\n{_USED}"
        run = subprocess.run(
            [sys.executable, "-c", code], capture_output=True, text=True, check=True, cwd=ROOT
        )
        kilobytes, seconds = map(float, run.stdout.split())
        rows.append((name, f"{kilobytes * 1024 / 1e6:.0f}", f"{seconds:.1f}"))
    columns = ("way", "largest resident MB", "s")
    print_table(
        columns, rows, f"one listing of {path.stat().st_size / 1e6:.0f} MB", right=columns[1:]
    )


def main() -> None:
    corpus = Path(sys.argv[1]) if len(sys.argv) > 1 else ROOT / ".." / "shared" / "data" / "datcom"
    files = sorted(corpus.rglob("*.out")) or sorted(T37.glob("*.out"))
    time_ways([T37 / "t37_clean.out"], "T-37")
    time_ways(files, "corpus")
    time_ways([file for file in files if file.stat().st_size < SMALL], "its files below 100 kB")
    with TemporaryDirectory() as folder:
        memory(files, Path(folder))


if __name__ == "__main__":
    main()
