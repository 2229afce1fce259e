"""The page of names is the one that its program writes, and names only what exists."""

import runpy
from pathlib import Path

from flightmech.names import VOCABULARY

DOCS = Path(__file__).parents[1] / "docs"


def test_page_is_up_to_date():
    program = runpy.run_path(str(DOCS / "scripts" / "make_nomenclature.py"))
    assert (DOCS / "reference" / "nomenclature.md").read_text(encoding="utf-8") == program[
        "page"
    ](), "run: python docs/scripts/make_nomenclature.py"


def test_every_equivalent_belongs_to_a_quantity():
    program = runpy.run_path(str(DOCS / "scripts" / "make_nomenclature.py"))
    for table in ("LR743", "DATCOM", "SIDPAC"):
        assert set(program[table]) <= set(VOCABULARY), table
