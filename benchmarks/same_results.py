"""Compare the results of two versions of the program, file by file: the output folders of two runs
of ``aeromatch match`` on one project (or of ``./run demo``).

Each file is one of these: *equal*, the same bytes; *words*, other texts, paths, digests or
compiled libraries, but every number is equal; *numbers*, at least one number differs; *missing*,
the file is in one folder only. The differing members of an FMU and values of a JSON file are
listed. Pages and manifests repeat the numbers of ``results.json``, so only their texts can differ.

    python benchmarks/same_results.py BEFORE AFTER
"""

from __future__ import annotations

import json
import re
import sys
from collections import Counter
from collections.abc import Iterator
from functools import partial
from pathlib import Path
from typing import Any
from zipfile import ZipFile

import numpy as np
import xarray as xr

# Pages of another layout are not parsed: their numbers are those of results.json.
PAGES = {"report.html", "report.pdf", "manifest.json"}
# Keys of results.json that are words: paths of files and digests of inputs.
LEFT_OUT = {"command", "inputs", "aircraft", "names", "path", "record", "models"}
# Libraries of an FMU, and its identifier, which follows from the description.
LIBRARIES = (".so", ".dll", ".dylib")
# Axes without a name are numbered in the order of the file.
open_tree = partial(xr.open_datatree, engine="h5netcdf", phony_dims="sort")
_WORDS = re.compile(r"\b[0-9a-f]{12,}\b|\{?[0-9a-fA-F-]{36}\}?|(?:[\w.-]*/)+[\w.-]*")
_NUMBER = re.compile(r"[-+]?(?:\d+\.?\d*|\.\d+)(?:[eE][-+]?\d+)?")


def main(before: Path, after: Path) -> int:
    """Print one line per file that differs, and the counts; return 1 if a number differs."""
    names = {file.relative_to(before) for file in before.rglob("*") if file.is_file()}
    names |= {file.relative_to(after) for file in after.rglob("*") if file.is_file()}
    counts: Counter[str] = Counter()
    for name in sorted(names):
        kind, details = compare_files(before / name, after / name)
        counts[kind] += 1
        if kind != "equal":
            print(f"{name}: {kind}")
        for line in details:
            print(f"    {line}")
    print(", ".join(f"{kind} {count}" for kind, count in counts.items()))
    return 1 if counts["numbers"] or counts["missing"] else 0


def compare_files(one: Path, other: Path) -> tuple[str, list[str]]:
    """Return the kind of difference of two files, and lines that describe it."""
    if not (one.exists() and other.exists()):
        return "missing", []
    if one.read_bytes() == other.read_bytes():
        return "equal", []
    if one.name in PAGES:
        return "words", []
    if one.suffix == ".fmu":
        return _compare_archives(one, other)
    if one.suffix == ".nc":
        details = list(tree_differences(one, other))
        return "numbers" if details else "words", details
    if one.suffix == ".json":
        first, second = (json.loads(file.read_text(encoding="utf-8")) for file in (one, other))
        details = list(json_differences(first, second, place=one.name))
        return "numbers" if details else "words", details
    return compare_texts(one.read_bytes(), other.read_bytes()), []


def _compare_archives(one: Path, other: Path) -> tuple[str, list[str]]:
    """Return the kind of difference of two FMUs, and the members that differ."""
    kinds, details = {"words"}, []
    with ZipFile(one) as before, ZipFile(other) as after:
        common = {*before.namelist()} & {*after.namelist()}
        for name in sorted({*before.namelist()} | {*after.namelist()}):
            kind = "missing"
            if name in common:
                texts = before.read(name), after.read(name)
                kind = "equal" if texts[0] == texts[1] else compare_texts(*texts)
            # another compilation of a library may hold the same model
            if kind == "numbers" and name.endswith(LIBRARIES):
                kind = "words"
            if kind != "equal":
                details.append(f"{name}: {kind}")
            kinds.add(kind)
    return "numbers" if kinds & {"numbers", "missing"} else "words", details


def compare_texts(one: bytes, other: bytes) -> str:
    """Return ``words`` if two texts have the same numbers outside paths and digests."""
    numbers = []
    for text in (one, other):
        plain = _WORDS.sub("", text.decode("utf-8", errors="replace"))
        numbers.append([float(number) for number in _NUMBER.findall(plain)])
    return "words" if numbers[0] == numbers[1] else "numbers"


def tree_differences(one: Path, other: Path) -> Iterator[str]:
    """Yield the variables of two netCDF files whose numbers differ."""
    with open_tree(one) as before, open_tree(other) as after:
        trees = [
            {node.path: node.to_dataset() for node in tree.subtree} for tree in (before, after)
        ]
        for path in sorted(trees[0].keys() | trees[1].keys()):
            first, second = (tree.get(path, xr.Dataset()) for tree in trees)
            for name in sorted({*map(str, first.variables), *map(str, second.variables)}):
                if name not in first.variables or name not in second.variables:
                    yield f"{path}/{name}: in one file only"
                elif _have_other_numbers(first[name].values, second[name].values):
                    yield f"{path}/{name}"


def _have_other_numbers(one: np.ndarray, other: np.ndarray) -> bool:
    """Return whether two arrays of numbers differ; texts have none."""
    if not all(np.issubdtype(array.dtype, np.number) for array in (one, other)):
        return False
    return not np.array_equal(one, other, equal_nan=True)


def json_differences(one: Any, other: Any, place: str) -> Iterator[str]:
    """Yield the places at which two JSON documents differ, texts of paths and digests left out."""
    if isinstance(one, dict) and isinstance(other, dict):
        for key in sorted({*one, *other} - LEFT_OUT):
            yield from json_differences(one.get(key), other.get(key), f"{place}/{key}")
    elif isinstance(one, list) and isinstance(other, list) and len(one) == len(other):
        for index, pair in enumerate(zip(one, other, strict=True)):
            yield from json_differences(pair[0], pair[1], f"{place}[{index}]")
    elif isinstance(one, str) and isinstance(other, str):
        if compare_texts(one.encode(), other.encode()) == "numbers":
            yield f"{place}: {one[:60]} and {other[:60]}"
    elif one != other:
        yield f"{place}: {str(one)[:60]} and {str(other)[:60]}"


if __name__ == "__main__":
    sys.exit(main(Path(sys.argv[1]), Path(sys.argv[2])))
