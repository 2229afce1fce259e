"""The page of the conditions is written from the list of the conditions."""

import runpy
from pathlib import Path

ROOT = Path(__file__).parents[3]


def test_the_page_of_the_conditions_is_up_to_date():
    program = runpy.run_path(str(ROOT / "docs" / "scripts" / "make_row_conditions.py"))
    page = ROOT / "docs" / "reference" / "row-conditions.md"
    assert page.read_text(encoding="utf-8") == program["page"](), (
        "run: python docs/scripts/make_row_conditions.py"
    )
