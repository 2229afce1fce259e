"""Lines of a CSV file as ``%.9g`` writes every number, from whole columns in less than half of the
time.

A number is brought to nine digits in front of the point and rounded there.  Where a product of two
doubles does not show which way to round, one sample in a million, ``%.9g`` itself writes it.
"""

from __future__ import annotations

import csv
import io
import math
import os
from collections.abc import Hashable, Iterator, Mapping, Sequence
from functools import cache
from typing import Any, NamedTuple
from xml.etree import ElementTree

import numpy as np
import xarray as xr

from flightmech.support.atomic_write import write_text
from pom.report.case.page import case_keys
from pom.result import PomResult, record_remarks, trim_remarks
from pom.tolerances.bands import remarks_text

_DIGITS = 9
_ZEROS = 4  # smallest exponent below zero that is written without one
_LEAST, _LARGEST = -290, 290  # exponents of numbers whose power of ten is a double
# to the middle of two integers of nine digits: six times the error of the product that they come
# from
_NEAR = 2e-6
_BLOCK = 512  # lines whose numbers stay in the cache
# places of a number: sign, "0.000", digits before the point and after it, exponent
_SIGN, _ZERO, _WHOLE, _POINT, _REST, _EXPONENT, _WIDTH = 0, 1, 6, 15, 16, 25, 30
_PLACES = np.frombuffer(b"-0.000#########.#########e?000", np.uint8)
_WITH_EXPONENT, _EMPTY = (
    _ZEROS + _DIGITS,
    _ZEROS + _DIGITS + 2,
)  # kinds behind those of numbers without one; two and three digits


class _Tables(NamedTuple):
    """What is looked up: powers of ten by exponent, four digits of 0 to 9999 and how many to the
    last that is not zero, places written.
    """

    powers: np.ndarray
    digits: np.ndarray
    used: np.ndarray
    kept: np.ndarray


def csv_lines(columns: Sequence[np.ndarray]) -> Iterator[str]:
    """Give the lines of columns, some hundred at once, each with its end; a NaN is an empty cell.

    Parameters
    ----------
    columns : sequence of array (line,)

    Examples
    --------
    >>> list(csv_lines([np.array([1.0, -0.5]), np.array([1e-9, np.nan])]))
    ['1,1e-09\\n-0.5,\\n']
    """
    moving: list[np.ndarray] = []
    texts = [
        b""
    ]  # before the first column that moves, and behind each; what does not move is written into the line once
    for number, values in enumerate(columns, 1):
        end = b"\n" if number == len(columns) else b","
        if _still(values):
            texts[-1] += _written(values[0]) + end
        else:
            moving.append(values)
            texts.append(end)
    return _blocks(moving, texts) if moving else iter([texts[0].decode("ascii") * len(columns[0])])


def _still(values: np.ndarray) -> bool:
    """Whether all samples are the same number to the bit."""
    bits = np.ascontiguousarray(values, float).view(np.int64)
    return bool(bits.size and (bits == bits[0]).all())


def _written(value: float) -> bytes:
    return b"" if np.isnan(value) else b"%.9g" % value


def _blocks(columns: Sequence[np.ndarray], texts: Sequence[bytes]) -> Iterator[str]:
    """Give the lines of columns, some hundred at once, with a text before the first column and one
    behind each.
    """
    first = np.cumsum(
        [len(texts[0]), *(_WIDTH + len(text) for text in texts[1:-1])]
    )  # place of every column in a line
    line = np.frombuffer(
        texts[0] + b"".join(_PLACES.tobytes() + text for text in texts[1:]), np.uint8
    )
    page = np.empty((min(_BLOCK, len(columns[0])), line.size), np.uint8)
    kept = np.ones(page.shape, bool)
    for start in range(0, len(columns[0]), _BLOCK):
        values = np.stack([column[start : start + _BLOCK] for column in columns])
        count = values.shape[1]
        page[:count] = line
        _fill(page[:count], kept[:count], values, first)
        yield np.compress(kept[:count].ravel(), page[:count].ravel()).tobytes().decode("ascii")


def _fill(page: np.ndarray, kept: np.ndarray, values: np.ndarray, first: np.ndarray) -> None:
    """Write numbers (column, line) into lines (line, place), and which places are kept, every
    column from its first place on.
    """
    tables = _tables()
    digits, exponent, doubtful = _rounded(values, tables)
    leading, high, low = digits // 100_000_000, digits // 10_000 % 10_000, digits % 10_000
    used = np.where(low, 5 + tables.used.take(low), 1 + tables.used.take(high))
    kind = np.where(
        (exponent >= -_ZEROS) & (exponent < _DIGITS),
        exponent + _ZEROS,
        _WITH_EXPONENT + (np.abs(exponent) > 99),
    )
    kind[np.isnan(values)] = _EMPTY
    written = tables.kept.take((kind * (_DIGITS + 1) + used) * 2 + np.signbit(values))
    groups = (
        (0, (leading + ord("0")).astype(np.uint8)),
        (1, tables.digits.take(high)),
        (5, tables.digits.take(low)),
    )
    for column, at in enumerate(first.tolist()):
        _places(kept, at, written.dtype)[:] = written[column]
        for behind, group in groups:
            _places(page, at + _WHOLE + behind, group.dtype)[:] = _places(
                page, at + _REST + behind, group.dtype
            )[:] = group[column]
    found, lines = np.nonzero((kind >= _WITH_EXPONENT) & (kind < _EMPTY))
    power, places = exponent[found, lines], first[found] + _EXPONENT + 1
    page[lines, places] = np.where(power < 0, ord("-"), ord("+"))
    for place, unit in enumerate((100, 10, 1), 1):
        page[lines, places + place] = np.abs(power) // unit % 10 + ord("0")
    for column, row in zip(*np.nonzero(doubtful), strict=True):
        text, at = b"%.9g" % values[column, row], first[column]
        page[row, at : at + len(text)] = np.frombuffer(text, np.uint8)
        kept[row, at : at + _WIDTH] = np.arange(_WIDTH) < len(text)


def _places(page: np.ndarray, at: int, kind: np.dtype) -> np.ndarray:
    """Return places of every line, from one on, as one array of several bytes each."""
    return np.ndarray(len(page), kind, page, at, page.strides[:1])


def _rounded(values: np.ndarray, tables: _Tables) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Return nine digits and the exponent of the first of them, and which numbers have to be
    written otherwise; a NaN is zero.
    """
    size = np.abs(values)
    known = (size >= 10.0**_LEAST) & (size < 10.0**_LARGEST)
    size = np.where(known, size, 1.0)
    exponent = np.floor(np.log10(size)).astype(np.intp)
    scaled = size * tables.powers[_DIGITS - 1 - exponent]  # a negative place counts from the end
    whole = np.rint(scaled)
    doubtful = np.abs(np.abs(scaled - whole) - 0.5) < _NEAR
    grown = whole >= 10.0**_DIGITS
    exponent += grown
    digits = np.where(grown, 10 ** (_DIGITS - 1), whole).astype(np.int32)
    digits[~known] = 0  # and the exponent is zero
    return digits, exponent, doubtful | (~known & (values != 0.0) & ~np.isnan(values))


@cache
def _tables() -> _Tables:
    powers = np.ones(2 * _LARGEST + 2 * _DIGITS)
    for power in range(-_LARGEST - _DIGITS + 1, _LARGEST + _DIGITS):
        powers[power] = float(f"1e{power}")
    texts = [f"{number:04d}" for number in range(10_000)]
    digits = np.array(texts, "S4").view(np.uint32)
    used = np.array([len(text.rstrip("0")) for text in texts], np.uint8)
    kept = np.zeros((_EMPTY + 1, _DIGITS + 1, 2, _WIDTH), bool)
    for kind in range(_EMPTY):
        for count in range(1, _DIGITS + 1):
            kept[kind, count] = _kept(kind, count)
    kept[:_EMPTY, :, 1, _SIGN] = True
    return _Tables(powers, digits, used, kept.view(f"V{_WIDTH}").ravel())


def _kept(kind: int, count: int) -> np.ndarray:
    """Return the places of a number of `count` digits that are written, without that of the sign."""
    kept = np.zeros(_WIDTH, bool)
    exponent = kind - _ZEROS
    if exponent < 0:
        kept[_ZERO : _ZERO + 1 - exponent] = kept[_WHOLE : _WHOLE + count] = True
        return kept
    whole = exponent + 1 if kind < _WITH_EXPONENT else 1
    kept[_WHOLE : _WHOLE + whole] = True
    kept[_POINT] = count > whole
    kept[_REST + whole : _REST + max(count, whole)] = True
    if kind >= _WITH_EXPONENT:
        kept[_EXPONENT : _EXPONENT + 2] = kept[_EXPONENT + 3 :] = True
        kept[_EXPONENT + 2] = kind > _WITH_EXPONENT  # a third digit of the exponent
    return kept


# a verdict of a group -> the element JUnit has for it; a pass has none
_ELEMENTS = {"fail": "failure", "invalid": "error", "not_tested": "skipped", "advisory": "skipped"}


def junit_xml(results: Sequence[PomResult], title: str) -> str:
    """Return the verdicts as JUnit XML: a suite per case, a test per model and group of criteria.

    Criteria of one group are alternatives, so a group is one test: it fails only when none of them
    passes.  A trim beyond its limits is a failed test of its own, and so is a flight record with
    errors.
    """
    root = ElementTree.Element("testsuites", name=_clean(title))
    for key, result in zip(case_keys(results), results, strict=True):
        suite = ElementTree.SubElement(
            root, "testsuite", name=_clean(f"{result.case.id} {result.case.title}")
        )
        for run in result.runs:
            for name, verdict, why in _tests(result, run):
                test = ElementTree.SubElement(
                    suite, "testcase", classname=f"{key}.{run}", name=_clean(name)
                )
                if verdict in _ELEMENTS:
                    ElementTree.SubElement(test, _ELEMENTS[verdict], message=_clean(why))
            if beyond := trim_remarks(result, run):
                test = ElementTree.SubElement(
                    suite, "testcase", classname=f"{key}.{run}", name="trim within its limits"
                )
                ElementTree.SubElement(test, "failure", message=_clean("; ".join(beyond)))
            if wrong := record_remarks(result, run):
                test = ElementTree.SubElement(
                    suite, "testcase", classname=f"{key}.{run}", name="flight record without errors"
                )
                ElementTree.SubElement(test, "failure", message=_clean("; ".join(wrong)))
        _count(suite, [suite])
    _count(root, list(root))
    ElementTree.indent(root)
    return (
        '<?xml version="1.0" encoding="UTF-8"?>\n'
        + ElementTree.tostring(root, encoding="unicode")
        + "\n"
    )


def write_junit(path: str | os.PathLike, results: Sequence[PomResult], title: str) -> None:
    """Write `junit_xml` to a file, atomically."""
    write_text(path, junit_xml(results, title))


def _tests(result: PomResult, run: str) -> Iterator[tuple[str, str, str]]:
    """Yield name, verdict and reason of every group of criteria that applies."""
    rows = [row for row in result.rows if row["run"] == run]
    applying = {c.name for c in result.case.criteria if c.applies}
    for group, verdict in result.groups(run).items():
        mine = [row for row in rows if row["group"] == group and row["criterion"] in applying]
        yield (
            " or ".join(row["criterion"] for row in mine),
            verdict,
            "; ".join(_reason(row) for row in mine),
        )


def _reason(row: Mapping[Hashable, Any]) -> str:
    if not math.isfinite(row["worst_ratio"]):
        return (
            f"{row['criterion']}: {row['verdict'].replace('_', ' ')}: "
            f"{remarks_text(row['remarks'])}"
        )
    at = f" at {row['at']:.2f} s" if math.isfinite(row["at"]) else ""
    return (
        f"{row['criterion']}: {row['worst_ratio']:.3g} x tolerance, {row['worst']:+.3g} "
        f"{row['unit']}{at} ({row['tolerance_text']})"
    )


def _count(element: ElementTree.Element, suites: Sequence[ElementTree.Element]) -> None:
    element.set("tests", str(sum(len(suite.findall("testcase")) for suite in suites)))
    for kind in ("failure", "error", "skipped"):
        plural = kind if kind == "skipped" else f"{kind}s"
        element.set(plural, str(sum(len(suite.findall(f"testcase/{kind}")) for suite in suites)))


def _clean(text: str) -> str:
    """Return a text without the control characters that XML cannot hold."""
    return "".join(
        c
        if c in "\t\n" or (ord(c) >= 32 and not 0xD800 <= ord(c) <= 0xDFFF and ord(c) < 0xFFFE)
        else "?"
        for c in text
    )


def case_csv(result: PomResult) -> Iterator[str]:
    """Give the samples of a case: time, every channel per run, half widths, inputs; SI, nine
    significant digits.

    A missing sample is an empty cell.  Inputs on another time base are read off by straight lines.
    The text comes in parts of some hundred lines: a flight of 90 minutes would take many times its
    file in memory.
    """
    time = result.signals["time"].values
    columns = {"time [s]": time}
    runs = result.signals["run"].values
    for name, item in _channels(result.signals):
        for run, values in zip(runs, item.values, strict=True):
            columns[_head(f"{name} {run}", item.attrs)] = values
    for name, item in _channels(result.tolerance):
        columns[_head(f"{name} tolerance", item.attrs)] = item.values
    clock = result.inputs["time"].values
    for name, item in _channels(result.inputs):
        values = item.values if np.array_equal(clock, time) else np.interp(time, clock, item.values)
        columns[_head(f"{name} input", item.attrs)] = values
    head = io.StringIO()
    csv.writer(head, lineterminator="\n").writerow(columns)
    yield head.getvalue()
    yield from csv_lines([*columns.values()])


def _channels(data: xr.Dataset) -> Iterator[tuple[Hashable, xr.Variable]]:
    """Give the channels of a part of a result, without the coordinates that each would get."""
    return ((name, data.variables[name]) for name in data.data_vars)


def _head(name: str, attrs: Mapping[Hashable, Any]) -> str:
    units = attrs.get("units", "")
    return f"{name} [{units}]" if units else name
