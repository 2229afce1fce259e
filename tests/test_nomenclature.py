"""Pages that programs write are those that the programs write, and name only what exists."""

import runpy
from pathlib import Path

import pytest

from aeromatch.drafting.columns import HEADING_WORDS, guess_quantity
from flightmech.names import VOCABULARY

DOCS = Path(__file__).parents[1] / "docs"


@pytest.mark.parametrize("script", ["make_nomenclature.py", "make_column_headings.py"])
def test_page_is_up_to_date(script):
    program = runpy.run_path(str(DOCS / "scripts" / script))
    text = program["PAGE"].read_text(encoding="utf-8")
    assert text == program["page"](), f"run: python docs/scripts/{script}"


@pytest.mark.parametrize("name", HEADING_WORDS)
def test_every_listed_heading_is_recognised(name):
    """A canonical name is its own quantity, also among the words of another one."""
    expected = name.replace("engine.", "engine1.")
    guesses = {word: guess_quantity(word) for word in HEADING_WORDS[name].split()}
    assert None not in guesses.values()
    others = {word: guess.name for word, guess in guesses.items() if guess.name != expected}
    assert others == {word: word for word in set(others) & set(VOCABULARY)}


def test_every_equivalent_belongs_to_a_quantity():
    program = runpy.run_path(str(DOCS / "scripts" / "make_nomenclature.py"))
    for table in ("LR743", "DATCOM", "SIDPAC"):
        assert set(program[table]) <= set(VOCABULARY), table
