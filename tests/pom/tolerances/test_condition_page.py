"""The page of the conditions has a row for every condition and for every configuration."""

import runpy
from pathlib import Path

from pom.tolerances import rows
from pom.tolerances.stated_conditions import CONDITIONS

ROOT = Path(__file__).parents[3]


def test_the_page_of_the_conditions_is_complete():
    page = runpy.run_path(str(ROOT / "docs" / "scripts" / "make_row_conditions.py"))["page"]()
    for condition in CONDITIONS.values():
        assert f" | {condition.text} | {condition.how or '*not checked*'} | " in page
    for row in rows.tolerance_rows():
        words = row["flight_condition"].replace("_", " ").replace(";", ", ")
        assert f"\n| {words} | " in page
