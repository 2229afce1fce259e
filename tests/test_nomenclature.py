"""Pages that programs write are those that the programs write, and name only what exists."""

import re
import runpy
from pathlib import Path

import pytest

from aeromatch.drafting.name_map.columns import guess_quantity
from aeromatch.drafting.name_map.heading_words import HEADING_WORDS
from flightmech.names import VOCABULARY
from pom.status import STATUSES

ROOT = Path(__file__).parents[1]
DOCS = ROOT / "docs"


def test_the_page_of_quantities_has_a_row_for_each():
    page = runpy.run_path(str(DOCS / "scripts" / "make_nomenclature.py"))["page"]()
    rows = re.findall(r"^\| `(.+?)` \| (.*?) \| .*? \| (.*?) \|", page, re.M)
    quantities = VOCABULARY.values()
    assert rows == [(one.name, one.units, one.long_name) for one in quantities]


def test_the_first_page_of_the_site_has_the_sections_of_the_readme():
    page = (DOCS / "index.md").read_text(encoding="utf-8")
    made = runpy.run_path(str(DOCS / "scripts" / "make_site.py"))["with_readme"](page)
    readme = (ROOT / "README.md").read_text(encoding="utf-8")
    program = readme.partition("```python\n")[2].partition("```")[0]
    assert program.count("\n") == 10
    assert program in made
    assert made.count("](images/report-case.png)") == 1
    assert "<!-- README" not in made


@pytest.mark.slow
def test_the_page_of_headings_names_every_quantity():
    page = runpy.run_path(str(DOCS / "scripts" / "make_column_headings.py"))["page"]()
    symbols = [name.replace("engine.", "engine1.") for name in HEADING_WORDS]
    assert re.findall(r"^\| `(.+?)` \|", page, re.M) == symbols


def test_the_gallery_shows_every_figure_once():
    page = runpy.run_path(str(DOCS / "scripts" / "make_gallery.py"))["page"]()
    shown = re.findall(r"\]\(\.\./images/(.+?\.png)\)", page)
    figures = (DOCS / "images").rglob("*.png")
    assert sorted(shown) == sorted(str(file.relative_to(DOCS / "images")) for file in figures)


@pytest.mark.slow
@pytest.mark.parametrize("name", HEADING_WORDS)
def test_every_listed_heading_is_recognised(name):
    """A canonical name is its own quantity, also among the words of another one."""
    expected = name.replace("engine.", "engine1.")
    guesses = {word: guess_quantity(word) for word in HEADING_WORDS[name].split()}
    assert None not in guesses.values()
    others = {word: guess.name for word, guess in guesses.items() if guess.name != expected}
    assert others == {word: word for word in set(others) & set(VOCABULARY)}


@pytest.mark.parametrize("heading", ["qbar", "Qbar_Pa", "QBAR (psf)", "qbar_meas"])
def test_a_dynamic_pressure_is_never_an_impact_pressure(heading):
    assert guess_quantity(heading).name == "qbar"


def test_every_equivalent_belongs_to_a_quantity():
    program = runpy.run_path(str(DOCS / "scripts" / "make_nomenclature.py"))
    for table in ("LR743", "DATCOM", "SIDPAC"):
        assert set(program[table]) <= set(VOCABULARY), table


def test_every_kind_of_remark_is_on_the_page_of_symptoms():
    kinds = set()
    for file in (ROOT / "flighttest").rglob("*.py"):
        text = file.read_text(encoding="utf-8")
        kinds.update(re.findall(r'\bRemark\(\s*"([a-z ]+)"', text))
    page = (DOCS / "how-to" / "when-something-looks-wrong.md").read_text(encoding="utf-8")
    assert len(kinds) > 15
    assert {kind for kind in kinds if f"`{kind}`" not in page} == set()


def test_every_status_that_is_not_a_pass_is_on_the_page_of_symptoms():
    page = (DOCS / "how-to" / "when-something-looks-wrong.md").read_text(encoding="utf-8")
    assert {status for status in STATUSES if f"`{status}`" not in page} == {"pass"}
