"""What a report hands to programs: ``results.json``, JUnit XML for build servers, one CSV per case."""

from __future__ import annotations

import csv
import io
import math
import os
from collections.abc import Hashable, Iterator, Mapping, Sequence
from typing import Any
from xml.etree import ElementTree

import numpy as np
import xarray as xr

from flightmech.support.atomic_write import write_text

from ..result import PomResult, record_remarks, trim_remarks
from ..tolerances.remarks import text_of
from .case.case import keys
from .csv_lines import csv_lines

# a verdict of a group -> the element JUnit has for it; a pass has none
_ELEMENTS = {"fail": "failure", "invalid": "error", "not_tested": "skipped", "advisory": "skipped"}


def junit(results: Sequence[PomResult], title: str) -> str:
    """Return the verdicts as JUnit XML: a suite per case, a test per model and group of criteria.

    Criteria of one group are alternatives, so a group is one test: it fails only when none of them passes.  A trim beyond
    its limits is a failed test of its own, and so is a flight record with errors.
    """
    root = ElementTree.Element("testsuites", name=_clean(title))
    for key, result in zip(keys(results), results, strict=True):
        suite = ElementTree.SubElement(root, "testsuite", name=_clean(f"{result.case.id} {result.case.title}"))
        for run in result.runs:
            for name, verdict, why in _tests(result, run):
                test = ElementTree.SubElement(suite, "testcase", classname=f"{key}.{run}", name=_clean(name))
                if verdict in _ELEMENTS:
                    ElementTree.SubElement(test, _ELEMENTS[verdict], message=_clean(why))
            if beyond := trim_remarks(result, run):
                test = ElementTree.SubElement(suite, "testcase", classname=f"{key}.{run}", name="trim within its limits")
                ElementTree.SubElement(test, "failure", message=_clean("; ".join(beyond)))
            if wrong := record_remarks(result, run):
                test = ElementTree.SubElement(suite, "testcase", classname=f"{key}.{run}", name="flight record without errors")
                ElementTree.SubElement(test, "failure", message=_clean("; ".join(wrong)))
        _count(suite, [suite])
    _count(root, list(root))
    ElementTree.indent(root)
    return '<?xml version="1.0" encoding="UTF-8"?>\n' + ElementTree.tostring(root, encoding="unicode") + "\n"


def write_junit(path: str | os.PathLike, results: Sequence[PomResult], title: str) -> None:
    """Write `junit` to a file, atomically."""
    write_text(path, junit(results, title))


def _tests(result: PomResult, run: str) -> Iterator[tuple[str, str, str]]:
    """Yield name, verdict and reason of every group of criteria that applies."""
    rows = [row for row in result.rows if row["run"] == run]
    applying = {c.name for c in result.case.criteria if c.applies}
    for group, verdict in result.groups(run).items():
        mine = [row for row in rows if row["group"] == group and row["criterion"] in applying]
        yield " or ".join(row["criterion"] for row in mine), verdict, "; ".join(_reason(row) for row in mine)


def _reason(row: Mapping[Hashable, Any]) -> str:
    if not math.isfinite(row["worst_ratio"]):
        return f"{row['criterion']}: {row['verdict'].replace('_', ' ')}: {text_of(row['remarks'])}"
    at = f" at {row['at']:.2f} s" if math.isfinite(row["at"]) else ""
    return f"{row['criterion']}: {row['worst_ratio']:.3g} x tolerance, {row['worst']:+.3g} {row['unit']}{at} ({row['tolerance_text']})"


def _count(element: ElementTree.Element, suites: Sequence[ElementTree.Element]) -> None:
    element.set("tests", str(sum(len(suite.findall("testcase")) for suite in suites)))
    for kind in ("failure", "error", "skipped"):
        plural = kind if kind == "skipped" else f"{kind}s"
        element.set(plural, str(sum(len(suite.findall(f"testcase/{kind}")) for suite in suites)))


def _clean(text: str) -> str:
    """Return a text without the control characters that XML cannot hold."""
    return "".join(c if c in "\t\n" or (ord(c) >= 32 and not 0xD800 <= ord(c) <= 0xDFFF and ord(c) < 0xFFFE) else "?" for c in text)


def case_csv(result: PomResult) -> Iterator[str]:
    """Give the samples of a case: time, every channel per run, half widths, inputs; SI, nine significant digits.

    A missing sample is an empty cell.  Inputs on another time base are read off by straight lines.  The text comes in parts of some
    hundred lines: a flight of 90 minutes would take many times its file in memory.
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
