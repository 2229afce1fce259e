"""Texts of the overview that several databases, chapters or criteria share."""

from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import report_fixture as fixture
import xarray as xr

from pom.report.case.page import outcome_rows, run_line_classes
from pom.report.overview import absent_terms
from pom.report.presentation.verdict_text import criterion_words
from pom.report.submodels.sections import chapter_title, identified_names
from pom.result import make_verdict_table
from pom.result_notices import unprobed_text
from pom.status import unprobed_remark
from pom.tolerances.bands import RowRemark


def lacking(*terms):
    return xr.DataTree(xr.Dataset(attrs={"absent": " ".join(terms)}))


def test_terms_that_all_databases_lack_stand_once():
    databases = {"datcom": lacking("CL/flap", "Cm/tab"), "final": lacking("CL/flap")}
    assert absent_terms(databases) == [
        ("all databases", ["CL/flap"]),
        ("datcom, further", ["Cm/tab"]),
    ]
    assert absent_terms({"final": lacking("CL/flap")}) == [("final", ["CL/flap"])]
    assert absent_terms({}) == []


def test_the_chapter_of_a_lone_envelope_has_its_name():
    engine, envelope = SimpleNamespace(name="engine"), SimpleNamespace(name="validity envelope")
    assert chapter_title([envelope]) == "Validity envelope of the identified model"
    assert chapter_title([engine]) == "Submodels identified from flight"
    assert chapter_title([engine, envelope]).endswith(", and validity envelope")
    assert identified_names([envelope]) == ""
    assert identified_names([engine, SimpleNamespace(name="stall"), envelope]) == "engine, stall"


def test_symbols_of_engine_rows_have_words():
    assert criterion_words("tt") == "total response time (Tt)"
    assert criterion_words("ti") == "initial response time (Ti)"


def test_the_index_counts_conditions_that_are_not_checked():
    result = fixture.roll_result()
    texts = ("not checked: yaw damper off", "not checked: augmentation")
    more = tuple(RowRemark("not_checked", text, "c") for text in texts)
    rows = [{**row, "remarks": (*row["remarks"], *more)} for row in result.rows]
    result = replace(result, verdict=make_verdict_table(rows))
    for row in outcome_rows(result, run_line_classes(result.runs)):
        assert row["unchecked"] == "2 conditions not checked"
        assert np.isin(texts, row["notices"]).all()


def test_the_index_counts_probes_that_were_not_made_and_the_terminal_states_why():
    result = fixture.roll_result()
    reasons = (("late inputs", "a wheel (nose)"), ("mass", "no tables"), ("jump", "a wheel (nose)"))
    more = tuple(unprobed_remark(*pair) for pair in reasons)
    rows = [{**row, "remarks": (*row["remarks"], *more)} for row in result.rows]
    result = replace(result, verdict=make_verdict_table(rows))
    assert (
        outcome_rows(result, run_line_classes(result.runs))[0]["unchecked"]
        == "3 probes not checked"
    )
    line = "not checked: late inputs, jump (a wheel (nose)); mass (no tables)"
    assert unprobed_text(result, result.runs[0]) == line
