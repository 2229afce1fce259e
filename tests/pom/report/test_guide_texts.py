"""Texts of a qualification test guide: on the page where they are given, counted where they are
not.
"""

from dataclasses import replace

import pytest
import report_fixture as fixture

import pom
from pom.report.guide_texts import missing_texts

TEXTS = {
    "objective": "The roll response",
    "description": "Half aileron",
    "procedure": "recorded inputs",
    "manual": "turn the wheel",
    "evaluation": "roll rate",
    "source": {
        "document": "FT-7",
        "revision": "B",
        "date": "1990-04-02",
        "engine": "J69-T-25",
        "avionics": "as built",
    },
    "compliance": {"control loading": "forces are measured at the column"},
}


def with_texts(**changes):
    result = fixture.roll_result()
    return replace(result, case=replace(result.case, **{**TEXTS, **changes}))


def test_missing_texts_are_counted_over_the_cases():
    assert missing_texts([with_texts()]) == []
    (found,) = missing_texts([with_texts(), with_texts(evaluation=" ")])
    assert (found.name, found.key, found.missing, found.total) == (
        *("evaluation", "case.evaluation", 1, 2),
    )
    source = {**TEXTS["source"], "engine": ""}
    (found,) = missing_texts([with_texts(source=source)])
    assert (found.name, found.key) == ("engine standard", "source.engine")


@pytest.mark.slow
def test_the_page_has_the_texts_and_the_index_their_count(tmp_path):
    results = [with_texts(), with_texts(name="other", compliance={}, manual="")]
    page = pom.write_report(results, tmp_path / "report", title="T", paper=None)
    text = page.read_text(encoding="utf-8")
    assert "2 texts of 2 kinds in 2 cases" in text
    assert '<td>compliance</td><td class="num">1 of 2</td>' in text
    stored = pom.read_archive(tmp_path / "report").results[0].case
    assert stored.compliance == TEXTS["compliance"]
