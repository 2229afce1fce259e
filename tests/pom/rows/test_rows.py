"""Every entry of Table A2A of 2014 is judged end to end: record, replay by the final model of the
T-37, verdict.
"""

import importlib.util
import runpy
from pathlib import Path

import pytest
import short_demo

from pom.tolerances import rows

HERE = Path(__file__).parent
_SPEC = importlib.util.spec_from_file_location("judge_rows", HERE / "judge_rows.py")
judge_rows = importlib.util.module_from_spec(_SPEC)
_SPEC.loader.exec_module(judge_rows)

TABLE = judge_rows.read_table()
ENTRIES = list(
    dict.fromkeys(
        row["test_id"]
        for row in rows.tolerance_rows()
        if row["standard"] == rows.STANDARD and row["edition"] == rows.EDITION
    )
)
BEYOND = ("2.a.4", "2.a.6", "2.a.7", "2.a.9")
"""Entries whose quantities the model does not have: tiller, trim indicator, drive of the trim
surface, force on the brake pedals.
"""


def test_the_table_has_every_entry():
    assert list(dict.fromkeys(row["entry"] for row in TABLE)) == sorted(
        ENTRIES, key=judge_rows.order
    )
    # without a judged row; others lack the pilot forces of an aeroplane with reversible controls
    open_rows = [row for row in TABLE if row["status"] == "not_tested"]
    assert {row["entry"] for row in open_rows if not row["judged"]} == set(BEYOND)
    assert all(
        "force" in row["reason"] or "F_" in row["reason"] for row in open_rows if row["judged"]
    )


def test_the_page_of_the_site_has_every_line_of_the_table():
    program = runpy.run_path(str(HERE.parents[2] / "docs" / "scripts" / "make_tolerance_rows.py"))
    lines = [line for line in program["page"]().splitlines() if line.startswith("| ")]
    entries = [line.split(" | ")[0].removeprefix("| ") for line in lines[1:]]
    assert entries[: len(TABLE)] == [row["entry"] for row in TABLE]


def test_every_verdict_that_is_no_pass_has_its_reason():
    assert [row["entry"] for row in TABLE if row["status"] != "pass" and not row["reason"]] == []


def criteria(row):
    """Return the criteria that were judged; an alternative that does not decide may pass or
    fail.
    """
    return [text.rpartition(" ")[0] for text in row["judged"].split("; ")]


@pytest.fixture(scope="module")
def verdicts(whole_demo, request):
    """Return the judged rows of all tests that run, by entry and case."""
    folder, run = whole_demo
    assert run.returncode == 0, run.stderr
    names = {
        item.callspec.params["row"]["case"]
        for item in request.session.items
        if item.name.startswith("test_entry_is_judged[")
    }
    return {(row["entry"], row["case"]): row for row in judge_rows.judged(folder, names)}


@pytest.mark.slow
def test_rows_of_the_short_demo_are_those_of_the_table(demo):
    folder, _ = demo
    expected = {(row["entry"], row["case"]): row for row in TABLE}
    found = judge_rows.demo_rows(folder)
    assert len(found) == len(short_demo.CASES)
    for row in found:
        assert_judged_as(row, expected[row["entry"], row["case"]])


@pytest.mark.nightly
@pytest.mark.parametrize("row", TABLE, ids=[f"{row['entry']}-{row['case']}" for row in TABLE])
def test_entry_is_judged(row, verdicts):
    assert_judged_as(verdicts[row["entry"], row["case"]], row)


def assert_judged_as(found, row):
    """Assert record, status, criteria and reason of a judged row."""
    assert (found["record"], found["status"]) == (row["record"], row["status"]), (
        "after a change that is meant: judge_rows.py writes the table"
    )
    assert criteria(found) == criteria(row)
    if row["entry"] in BEYOND:
        assert "has no" in found["reason"] or "is driven by the record" in found["reason"]
    else:
        assert found["judged"]
