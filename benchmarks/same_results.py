"""Compare the results of two versions of the program: ``out/t37`` of two runs of ``./run demo``.

Databases, FMUs, records and tables must have the same bytes. Of an FMU the members that differ are
listed: a library from another compilation may carry the same model. Of ``results.json`` paths of
files and digests of inputs are left out, because they depend on the folder and on comments in
input files. Pages and manifests contain those digests and are listed only.

    python benchmarks/same_results.py BEFORE AFTER
"""

from __future__ import annotations

import json
import sys
from pathlib import Path
from typing import Any
from zipfile import ZipFile

LISTED = {"report.html", "report.pdf", "manifest.json", "results.nc", "results.json"}
LEFT_OUT = {"command", "inputs", "aircraft", "names", "path", "record", "models"}


def main(before: Path, after: Path) -> int:
    """Print what differs; return 1 if a result differs."""
    differing = compare_bytes(before, after)
    numbers = list(differences(read_results(before), read_results(after), place="results.json"))
    for line in [*differing, *numbers]:
        print(line)
    print(f"{len(differing)} files and {len(numbers)} values of results.json differ")
    return 1 if differing or numbers else 0


def compare_bytes(before: Path, after: Path) -> list[str]:
    """Return a line for each file whose bytes must be equal and are not."""
    lines = []
    names = {file.relative_to(before) for file in before.rglob("*") if file.is_file()}
    names |= {file.relative_to(after) for file in after.rglob("*") if file.is_file()}
    for name in sorted(names):
        one, other = before / name, after / name
        if not (one.exists() and other.exists()):
            lines.append(f"{name}: only in one folder")
        elif name.name not in LISTED and one.read_bytes() != other.read_bytes():
            lines.append(f"{name}: other bytes{describe_members(one, other)}")
    return lines


def describe_members(before: Path, after: Path) -> str:
    """Return the members of two FMUs that differ; empty for other files."""
    if before.suffix != ".fmu":
        return ""
    with ZipFile(before) as one, ZipFile(after) as other:
        names = sorted({*one.namelist()} | {*other.namelist()})
        common = {*one.namelist()} & {*other.namelist()}
        differing = [
            name for name in names if name not in common or one.read(name) != other.read(name)
        ]
    return f" of {', '.join(differing) or 'the archive alone'}"


def read_results(folder: Path) -> Any:
    """Return the content of results.json."""
    return json.loads((folder / "report" / "results.json").read_text(encoding="utf-8"))


def differences(one: Any, other: Any, place: str) -> Any:
    """Yield the places at which two JSON documents differ."""
    if isinstance(one, dict) and isinstance(other, dict):
        for key in sorted({*one, *other} - LEFT_OUT):
            yield from differences(one.get(key), other.get(key), f"{place}/{key}")
    elif isinstance(one, list) and isinstance(other, list) and len(one) == len(other):
        for index, pair in enumerate(zip(one, other, strict=True)):
            yield from differences(*pair, f"{place}[{index}]")
    elif one != other:
        yield f"{place}: {str(one)[:60]} and {str(other)[:60]}"


if __name__ == "__main__":
    sys.exit(main(Path(sys.argv[1]), Path(sys.argv[2])))
