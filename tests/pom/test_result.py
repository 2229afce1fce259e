from dataclasses import replace

import numpy as np
import pandas as pd
import pytest
import xarray as xr

from flightmech.errors import UnknownName
from pom.cases.case import PomCase
from pom.cli.actions.result_lines import result_lines
from pom.report.case.page import outcome_rows
from pom.report.exports import junit_xml
from pom.report.presentation.quantities import MISSING
from pom.report.presentation.verdict_text import criterion_words
from pom.result import PomResult, make_verdict_table
from pom.tolerances.bands import RowRemark
from pom.tolerances.criteria import Band, Criterion, Limit

BAND = Band(
    (Limit("percent", 10.0, "%"), Limit("absolute", 2.0, "deg/s")), "greater_of", "ref_local"
)


def criterion(name, group, applies=True):
    return Criterion(name, name, "p", "trace", group, BAND, (1.0, 2.0), applies=applies)


def result(rows, criteria):
    time = np.array([1.0, 1.5, 2.0])
    signals = xr.Dataset(
        {"p": (("run", "time"), [[0.0, 0.1, 0.2], [0.0, 0.1, np.nan]])},
        {"run": ["flight", "a"], "time": time},
    )
    return PomResult(
        case=PomCase(
            "c", "C", "2.d.2", "S", "E", "c.toml", "r.nc", (1.0, 2.0), criteria=tuple(criteria)
        ),
        conditions={"V": 80.0},
        signals=signals,
        tolerance=xr.Dataset({"p": ("time", [0.1, 0.1, 0.2])}, {"time": time}),
        inputs=xr.Dataset({"delta_a": ("time", [0.0, 0.0, 0.1])}, {"time": time}),
        trim=pd.DataFrame(
            {"flight": [0.1], "a": [0.11]}, index=pd.Index(["alpha"], name="quantity")
        ),
        verdict=make_verdict_table(
            [
                {"run": "a", "criterion": c, "group": g, "verdict": v, "worst_ratio": x}
                for c, g, v, x in rows
            ]
        ),
    )


def test_one_passing_alternative_carries_its_group_and_all_groups_must_pass():
    criteria = [criterion("theta", "pitch"), criterion("q", "pitch"), criterion("nz", "g3")]
    good = result(
        [("theta", "pitch", "fail", 3.0), ("q", "pitch", "pass", 0.4), ("nz", "g3", "pass", 0.7)],
        criteria,
    )
    assert good.passed("a")
    assert (
        good.worst("a")["criterion"] == "nz"
    )  # theta fails, but its alternative q carries the group
    bad = result(
        [("theta", "pitch", "pass", 0.3), ("q", "pitch", "pass", 0.4), ("nz", "g3", "fail", 1.7)],
        criteria,
    )
    assert bad.status("a") == "fail"


@pytest.mark.parametrize(
    ("other", "status"),
    [("advisory", "pass"), ("not_tested", "not_tested"), ("invalid", "invalid")],
)
def test_only_advice_leaves_a_pass_standing(other, status):
    got = result(
        [("p", "g1", "pass", 0.5), ("x", "g2", other, np.nan)],
        [criterion("p", "g1"), criterion("x", "g2")],
    )
    assert got.status("a") == status


@pytest.mark.parametrize(
    ("rows", "decides"),
    [
        # a ratio beyond its limit decides a failure
        ([("p", "g1", "fail", 1.2), ("q", "g2", "fail", np.nan)], "p"),
        # a ratio within its limit decides nothing about a case that has no verdict
        ([("p", "g1", "pass", 0.5), ("q", "g2", "not_tested", np.nan)], "q"),
        ([("p", "g1", "fail", 3.0), ("q", "g2", "invalid", np.nan)], "q"),
        # a failing alternative of a group that passes decides nothing
        ([("p", "g1", "fail", 0.9), ("q", "g1", "pass", 0.5), ("r", "g2", "fail", np.nan)], "r"),
        ([("p", "g1", "pass", 0.5), ("q", "g2", "pass", 0.7)], "q"),
    ],
)
def test_terminal_and_report_show_the_row_that_decides(rows, decides):
    got = result(rows, [criterion(name, group) for name, group, _, _ in rows])
    assert got.deciding_row("a")["criterion"] == decides
    (line,), (cell,) = result_lines(got), outcome_rows(got, {"a": "run-1"})
    assert cell["criterion"] == criterion_words(decides)
    ratio = dict((name, x) for name, _, _, x in rows)[decides]
    assert cell["ratio_text"] == (f"{ratio:.2f}" if np.isfinite(ratio) else MISSING)
    assert ("x tolerance" in line) == bool(np.isfinite(ratio))


def test_a_row_that_does_not_apply_does_not_block():
    got = result(
        [("p", "g1", "pass", 0.5), ("x", "g2", "not_tested", np.nan)],
        [criterion("p", "g1"), criterion("x", "g2", applies=False)],
    )
    assert got.passed("a")


def test_advice_alone_is_never_a_pass():
    assert (
        result([("p", "g1", "advisory", np.nan)], [criterion("p", "g1")]).status("a")
        == "not_tested"
    )


def test_json_there_and_back():
    before = result([("p", "g1", "pass", 0.5)], [criterion("p", "g1")])
    after = PomResult.from_json(before.to_json())
    assert after.case == before.case
    xr.testing.assert_identical(after.signals, before.signals)
    xr.testing.assert_identical(after.tolerance, before.tolerance)
    pd.testing.assert_frame_equal(after.trim, before.trim)
    pd.testing.assert_frame_equal(after.verdict, before.verdict)


def test_remarks_there_and_back_and_the_note_of_an_older_file():
    """Files written before 0.1.0 was released hold one text in a column `note`."""
    remark = {
        "kind": "cycles",
        "text": "6.2 cycles",
        "quantity": "theta",
        "values": {"flight": 6.2},
        "unit": "1",
    }
    table = make_verdict_table(
        [
            {"run": "a", "remarks": [remark]},
            {"run": "a", "note": "the model: no oscillation"},
            {"run": "a", "note": ""},
        ]
    )
    assert [item.as_dict() for item in table.loc[0, "remarks"]] == [remark]
    assert table.loc[1, "remarks"] == (RowRemark("note", "the model: no oscillation"),)
    assert table.loc[2, "remarks"] == ()


def test_tolerance_reads_as_printed():
    assert BAND.text == "10 % of the flight value or 2 deg/s, the greater"
    assert Band((Limit("absolute", 0.02, "-"),)).text == "0.02"


def test_a_result_shows_itself_in_display_units():
    pytest.importorskip("matplotlib")
    got = result([("p", "g1", "pass", 0.5)], [criterion("p", "g1")])
    assert "a: pass" in got._repr_html_()
    (ax,) = got.plot().axes
    flight, model = ax.lines
    np.testing.assert_allclose(flight.get_ydata(), np.degrees([0.0, 0.1, 0.2]))
    np.testing.assert_allclose(model.get_ydata(), np.degrees([0.0, 0.1, np.nan]))
    assert ax.get_ylabel() == "p [deg/s]"
    with pytest.raises(UnknownName, match="channel of the result"):
        got.plot(["q"])


def test_the_report_states_the_row_that_fails_without_a_ratio():
    rows = [("nz", "g3", "pass", 0.7), ("period", "mode", "fail", np.nan)]
    got = result(rows, [criterion("nz", "g3"), criterion("period", "mode")])
    table = got.verdict.to_dict("records")
    table[1]["remarks"] = (RowRemark("no_mode", "the model: no oscillation stands out"),)
    got = replace(got, verdict=make_verdict_table(table))
    last = got.report().splitlines()[-1]
    assert last == "a: fail, period: the model: no oscillation stands out"


def test_a_failure_within_the_tolerance_is_printed_with_its_reason():
    """A mode of the right damping that grows where the flight's decays."""
    got = result([("zeta", "mode", "fail", 0.3)], [criterion("zeta", "mode")])
    table = got.verdict.to_dict("records")
    table[0]["remarks"] = (RowRemark("stability", "stability differs"), RowRemark("cycles", "3"))
    got = replace(got, verdict=make_verdict_table(table))
    assert got.report().splitlines()[-1] == "a: fail, zeta: stability differs"
    assert result_lines(got)[0].endswith("FAIL  zeta: stability differs")
    assert 'message="zeta: fail: stability differs' in junit_xml([got], "t")
