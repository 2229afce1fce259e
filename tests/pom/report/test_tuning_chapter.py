"""The chapter on tuning: on the page, on paper, in results.json, and checked against what was
flown.
"""

import json
import sys
from pathlib import Path

import pytest

import pom
from flightmech.errors import UnknownName
from pom.archive.results_document import join_reports
from pom.archive.statements import differences_from_log
from pom.report.models.tuning import tuning_context

sys.path.insert(0, str(Path(__file__).parents[1]))  # for report_fixture
sys.path.insert(0, str(Path(__file__).parent))  # for report_pages
import report_fixture as fixture
from report_pages import paper, texts, write
from test_pdf import everything


@pytest.mark.slow
def test_the_log_is_a_chapter_and_kept(tmp_path):
    results = [fixture.roll_result()]
    log = fixture.tuning(results)
    html = texts(
        write(tmp_path / "report", results=results, diagnoses={}, tunings={"final": log}).read_text(
            encoding="utf-8"
        )
    )
    chapter = html[html.index('<article id="tuning">') :]
    assert "Tuned for roll_response" in chapter
    for cell in (
        "Cm/elevator",
        "1.31",
        "93 %",
        "mach 0.2, alpha 4 deg",
        "horn &lt;worn&gt;",
        "1 further term, with less than 1 % of the distance and less than 0.5 standard errors",
        "old.nc (abab",
    ):
        assert cell in chapter
    worst = results[0].worst("final")["worst_ratio"]
    assert f'<td class="num">1.70</td><td>pass</td><td class="num">{worst:.2f}</td>' in chapter
    assert f'<td class="num">{worst:.2f} pass</td>' in chapter
    assert json.loads((tmp_path / "report" / "results.json").read_text())["tunings"] == {
        "final": log
    }
    assert pom.read_archive(tmp_path / "report").tunings == {"final": log}
    assert join_reports([tmp_path / "report"]).tunings == {"final": log}
    assert not [
        item
        for item in pom.verify(tmp_path / "report")
        if item.kind == "statement" and item.state != "same"
    ]


@pytest.mark.slow
def test_the_chapter_on_paper():
    results = [fixture.roll_result()]
    chapter = tuning_context({"final": fixture.tuning(results)}, results)
    pdf = paper(results, tunings=chapter)
    assert b"Tuning inside the standard errors" in everything(pdf)


def test_a_model_that_does_otherwise_than_its_log_is_found():
    results = [fixture.roll_result(), fixture.short_period_result()]
    log = fixture.tuning(results)
    assert list(differences_from_log(results, "final", log)) == []
    log["rows"][0]["ratio_after"] += 0.01
    log["rows"][1]["after"] = "fail"
    assert [text.split(":")[0] for text in differences_from_log(results, "final", log)] == [
        result.case.name for result in results
    ]


@pytest.mark.slow
def test_a_log_of_no_model_is_refused(tmp_path):
    with pytest.raises(
        UnknownName, match="unknown model 'fynal'; near it: final; a tuning is that of a model"
    ):
        write(tmp_path, tunings={"fynal": fixture.tuning(fixture.results()[:1])})
