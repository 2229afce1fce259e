"""The cause of a mismatch on the page: words, table and waterfall of a diagnosis."""

import re
import sys
from pathlib import Path

import numpy as np
import pandas as pd
import pytest

from pom.report.models import diagnosis
from pom.report.models import waterfall_figure as waterfall

sys.path.insert(0, str(Path(__file__).parents[1]))
import report_fixture as fixture


@pytest.fixture
def table():
    return fixture.diagnosis()


def rows(table):
    """Terms, shares and cells by title of the stage."""
    found = diagnosis.cause_section(fixture.short_period_result(), table)
    return {stage["title"]: stage for stage in found["stages"]}, found


def numbers(svg, css):
    """Left ends and widths of the rectangles of a class."""
    return [
        tuple(map(float, found))
        for found in re.findall(
            rf'<rect class="{css}" x="([-\d.]+)" y="[-\d.]+" width="([\d.]+)"', svg
        )
    ]


def test_the_cause_in_words(table):
    text = diagnosis.cause_sentences(table)
    assert (
        "the lift increment due to gear extension (CL/gear) explains most of the gap, 81 %." in text
    )
    assert (
        "With the lift increment due to gear extension (CL/gear) from the final model, the "
        "corrected a-priori model is within" in text
    )
    assert text.endswith(
        "Terms do not simply add up: CL/gear and Cm/qhat explain 81 % and 9 % alone, 100 % "
        "together."
    )


def test_the_table_shows_every_stage(table):
    stages, found = rows(table)
    single = stages["a-priori model with one term taken from the final model"]
    assert [row["term"] for row in single["rows"]] == ["CL/gear", "Cm/qhat"]
    assert single["hidden"] == 1
    left, width = single["rows"][0]["bar"]
    assert left == pytest.approx(100 * 0.2 / 1.4, abs=0.1)  # from no change ...
    assert width == pytest.approx(100 * 0.807 / 1.4, abs=0.1)  # ... to its share
    assert single["rows"][0]["cells"] == [
        "81 %",
        "0.61",
        "78 %",
        "0.42",
    ]  # what is explained, and the largest ratio
    (pair,) = next(stage for title, stage in stages.items() if "two terms" in title)["rows"]
    assert pair["names"] == ["CL/gear", "Cm/qhat"]
    assert found["linked"] == ["CL/gear", "Cm/qhat", "CL/basic"]
    share = next(stage for title, stage in stages.items() if "fair split" in title)["rows"]
    assert [row["explained"] for row in share] == ["−2 ± 3 %", "14 ± 3 %", "87 ± 3 %"]
    assert all(row["verdict"] is None for row in share)


@pytest.mark.slow
def test_the_terms_that_were_not_flown_alone_are_named(table):
    assert rows(table)[1]["idle"] == ""
    blank = {"stage": "idle", "verdict": "not_tested", "explained": np.nan}
    idle = [
        blank | {"term": "", "bound": 0.00123},
        blank | {"term": "Cn/rhat", "bound": 0.0031},
        blank | {"term": "Cl/phat", "bound": 4e-6},
    ]
    text = rows(pd.concat([table, pd.DataFrame(idle)], ignore_index=True))[1]["idle"]
    assert text.startswith(
        "2 terms were not flown alone, since no judged output moves by more than this share "
        "of its mismatch"
    )
    assert text.endswith(": Cn/rhat 0.31 %, Cl/phat below 0.01 %. All together move 0.12 %.")


def test_a_cause_that_no_term_explains(table):
    table = table[table["stage"].isin(["prior", "final", "single"])].assign(explained=np.nan)
    assert diagnosis.cause_sentences(table).endswith(
        "No single term of the final model brings it nearer to the flight."
    )
    stages, found = rows(table)
    assert found["figure"] == ""
    assert (
        stages["a-priori model with one term taken from the final model"]["rows"][0]["bar"] is None
    )
    table.loc[table["stage"] == "prior", "verdict"] = "pass"
    assert "no term has to be taken" in diagnosis.cause_sentences(table)


@pytest.mark.parametrize(
    ("verdict", "expected"),
    [
        ("not_tested", "there is no mismatch to explain"),
        ("invalid", "The a-priori model could not be judged. Of"),
    ],
)
def test_a_model_without_a_verdict_is_not_called_out_of_tolerance(table, verdict, expected):
    table.loc[table["stage"] == "prior", "verdict"] = verdict
    assert expected in diagnosis.cause_sentences(table)


def test_the_bars_of_the_waterfall_follow_each_other(table):
    svg = waterfall.cause_figure(table)
    (start, *_), (end, *_) = numbers(svg, "run-1-area"), numbers(svg, "run-3-area")
    scale = start[1] / 1.21  # units per half width
    (taken, *_), (added, *_), (open_, *_) = (
        numbers(svg, "run-2-area"),
        numbers(svg, "exit"),
        numbers(svg, "band frame"),
    )
    assert added[0] == pytest.approx(
        start[0] + start[1], abs=0.2
    )  # CL/basic adds to the right of the a-priori mismatch ...
    assert added[1] == pytest.approx(0.02 * scale, abs=0.2)
    assert open_[0] + open_[1] == pytest.approx(
        added[0] + added[1], abs=0.2
    )  # ... from there Cm/qhat goes back ...
    assert taken[0] == pytest.approx(
        end[0] + end[1], abs=0.2
    )  # ... and CL/gear down to the mismatch of the final model
    assert "87 ± 3 %" in svg


def test_the_waterfall_in_words(table):
    svg = waterfall.cause_figure(table)
    label = re.search(r'aria-label="([^"]*)"', svg).group(1)
    assert label.startswith(
        "Waterfall of the mismatch from the a-priori to the final model. all criteria, from "
        "1.21 to 0.02 half widths: CL/basic"
    )
    assert (
        "pitch rate, from 0.90 to 0.03 half widths: CL/basic −1 ± 3 %, Cm/qhat 13 ± 3 %, "
        "CL/gear 89 ± 3 %." in label
    )


def test_a_criterion_without_a_gap_has_no_panel(table):
    table["pitch_rate explained"] = np.nan
    svg = waterfall.cause_figure(table)
    assert ">pitch angle<" in svg
    assert "rate" not in svg
    assert len(numbers(svg, "run-1-area")) == 2


def test_long_titles_break_once():
    assert waterfall._two_lines("time to half or double", 12) == ["time to half", "or double"]
    assert waterfall._two_lines("airspeed", 4) == ["airspeed"]
