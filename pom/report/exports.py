"""Files of a report for other programs: verdicts as JUnit XML, samples as CSV."""

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
from pom.report.case.page import case_keys
from pom.result import PomResult
from pom.result_notices import collect_texts, departure_remarks, record_remarks, trim_remarks
from pom.status import BEYOND, ratio_shows_verdict
from pom.tolerances.bands import remarks_text

# Lines of a block.
_BLOCK = 512
# Verdict of a group to its element in JUnit.  A pass has no element.
_ELEMENTS = {
    "fail": "failure",
    "invalid": "error",
    **dict.fromkeys(("not_tested", "advisory", "demonstration"), "skipped"),
}


def junit_xml(results: Sequence[PomResult], title: str) -> str:
    """Return the verdicts as JUnit XML: a suite per case, a test per model and group of criteria.

    Criteria of one group are alternatives, so a group is one test.  It fails only if none of its
    criteria passes.  A trim beyond its limits is a failed test, and so is a flight record with
    errors.  Departures from the printed row are a skipped test, since the rows themselves pass.

    Parameters
    ----------
    results : sequence of PomResult
    title : str
        Title of the report.
    """
    root = ElementTree.Element("testsuites", name=_clean_text(title))
    for key, result in zip(case_keys(results), results, strict=True):
        name = _clean_text(f"{result.case.id} {result.case.title}")
        suite = ElementTree.SubElement(root, "testsuite", name=name)
        for run in result.runs:
            _add_tests(suite, f"{key}.{run}", result, run)
        _set_counts(suite, [suite])
    _set_counts(root, list(root))
    ElementTree.indent(root)
    body = ElementTree.tostring(root, encoding="unicode")
    return f'<?xml version="1.0" encoding="UTF-8"?>\n{body}\n'


def write_junit(path: str | os.PathLike, results: Sequence[PomResult], title: str) -> None:
    """Write `junit_xml` to a file, atomically."""
    write_text(path, junit_xml(results, title))


def _add_tests(suite: ElementTree.Element, classname: str, result: PomResult, run: str) -> None:
    """Add the tests of a model to the suite of a case."""
    for name, verdict, reason in _group_verdicts(result, run):
        test = ElementTree.SubElement(
            suite, "testcase", classname=classname, name=_clean_text(name)
        )
        if verdict in _ELEMENTS:
            ElementTree.SubElement(test, _ELEMENTS[verdict], message=_clean_text(reason))
    # These remarks concern the whole run, not a criterion.
    for name, outcome, remarks in (
        ("trim within its limits", "failure", trim_remarks(result, run)),
        ("flight record without errors", "failure", record_remarks(result, run)),
        ("record that did not identify", "failure", collect_texts(result, run, ("leak",))),
        ("driven by the inputs", "failure", collect_texts(result, run, ("not_driven",))),
        ("within the recurrent criterion", "failure", collect_texts(result, run, (BEYOND,))),
        ("no departure from the printed row", "skipped", departure_remarks(result, run)),
    ):
        if remarks:
            test = ElementTree.SubElement(suite, "testcase", classname=classname, name=name)
            ElementTree.SubElement(test, outcome, message=_clean_text("; ".join(remarks)))


def _group_verdicts(result: PomResult, run: str) -> Iterator[tuple[str, str, str]]:
    """Yield name, verdict and reason of every group of criteria that applies."""
    applying = {criterion.name for criterion in result.case.criteria if criterion.applies}
    rows = [row for row in result.rows if row["run"] == run and row["criterion"] in applying]
    for group, verdict in result.groups(run).items():
        members = [row for row in rows if row["group"] == group]
        name = " or ".join([row["criterion"] for row in members])
        yield name, verdict, "; ".join(map(_row_reason, members))


def _row_reason(row: Mapping[Hashable, Any]) -> str:
    """Return the worst ratio of a criterion, or why it has none."""
    criterion = row["criterion"]
    if not ratio_shows_verdict(row):
        return f"{criterion}: {row['verdict'].replace('_', ' ')}: {remarks_text(row['remarks'])}"
    instant = f" at {row['at']:.2f} s" if math.isfinite(row["at"]) else ""
    return (
        f"{criterion}: {row['worst_ratio']:.3g} x tolerance, {row['worst']:+.3g} "
        f"{row['unit']}{instant} ({row['tolerance_text']})"
    )


def _set_counts(element: ElementTree.Element, suites: Sequence[ElementTree.Element]) -> None:
    """Set the attributes of the numbers of tests, by outcome."""
    paths = {
        "tests": "testcase",
        "failures": "testcase/failure",
        "errors": "testcase/error",
        "skipped": "testcase/skipped",
    }
    for attribute, path in paths.items():
        count = sum(len(suite.findall(path)) for suite in suites)
        element.set(attribute, str(count))


def _clean_text(text: str) -> str:
    """Return a text with `?` for each character that XML cannot hold."""
    return "".join([char if _is_xml_char(char) else "?" for char in text])


def _is_xml_char(char: str) -> bool:
    """Return whether XML 1.0 can hold a character."""
    code = ord(char)
    if char in "\t\n":
        return True
    # Control characters, halves of surrogate pairs, U+FFFE and U+FFFF are refused.
    return code >= 32 and not 0xD800 <= code <= 0xDFFF and code not in (0xFFFE, 0xFFFF)


def case_csv(result: PomResult) -> Iterator[str]:
    """Yield the samples of a case as CSV text: time, channels per run, half widths, inputs.

    Numbers are in SI and have nine significant digits.  A missing sample is an empty cell.  Inputs
    on another time base are interpolated linearly.

    The text comes in blocks of some hundred lines.  The whole text of a flight of 90 minutes would
    need many times the size of its file in memory.
    """
    time = result.signals["time"].values
    columns = {"time [s]": time}
    runs = result.signals["run"].values
    for name, item in _channels(result.signals):
        for run, values in zip(runs, item.values, strict=True):
            columns[_column_title(f"{name} {run}", item.attrs)] = values
    for name, item in _channels(result.tolerance):
        columns[_column_title(f"{name} tolerance", item.attrs)] = item.values
    input_time = result.inputs["time"].values
    has_same_time = np.array_equal(input_time, time)
    for name, item in _channels(result.inputs):
        values = item.values
        if not has_same_time:
            values = np.interp(time, input_time, values)
        columns[_column_title(f"{name} input", item.attrs)] = values
    titles = io.StringIO()
    csv.writer(titles, lineterminator="\n").writerow(columns)
    yield titles.getvalue()
    yield from _format_rows([*columns.values()])


def _format_rows(columns: Sequence[np.ndarray]) -> Iterator[str]:
    """Yield the lines of columns (time,) in blocks of `_BLOCK` lines."""
    line = ",".join(["%.9g"] * len(columns)) + "\n"
    for start in range(0, len(columns[0]), _BLOCK):
        block = [column[start : start + _BLOCK].tolist() for column in columns]
        text = "".join([line % row for row in zip(*block, strict=True)])
        # No other number has these letters, so a missing sample becomes an empty cell.
        yield text.replace("nan", "")


def _channels(data: xr.Dataset) -> Iterator[tuple[Hashable, xr.Variable]]:
    """Yield the channels of a dataset as variables, without their coordinates."""
    for name in data.data_vars:
        yield name, data.variables[name]


def _column_title(name: str, attrs: Mapping[Hashable, Any]) -> str:
    units = attrs.get("units", "")
    return f"{name} [{units}]" if units else name
