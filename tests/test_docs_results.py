"""Every code block of README, front page, tutorial, how-tos and notebook is executed, and its
result is checked (`docs_results`).
"""

import json

import pytest
from docs_results import CHECKS, FOR_READING, PYTHON, ROOT
from test_docs import blocks, name, reason_not_run

PAGES = [
    ROOT / "README.md",
    ROOT / "docs/index.md",
    ROOT / "docs/tutorials/light-aircraft.md",
    *sorted((ROOT / "docs/how-to").glob("*.md")),
]


@pytest.mark.nightly
@pytest.mark.parametrize(("page", "number"), PYTHON)
def test_python_of_a_page_gives_what_it_promises(page, number, tmp_path, monkeypatch):
    (tmp_path / "data").symlink_to(ROOT / "data")
    monkeypatch.chdir(tmp_path)
    names: dict = {}
    exec(compile(blocks(ROOT / page)[number].text, page, "exec"), names)
    PYTHON[page, number](names)


@pytest.mark.parametrize("page", PAGES, ids=name)
def test_every_block_has_a_result_that_is_checked(page):
    """A block prints what the page has, or it has a check, or none of it is run here."""
    for number, block in enumerate(blocks(page)):
        place = name(page), number
        if block.title or place in FOR_READING or place in PYTHON:
            continue  # a file is what the commands of its page work with
        assert block.language in ("console", "sh"), (
            f"{place}: {block.language}, which nothing executes"
        )
        run = [
            (command, printed)
            for command, printed in block.commands()
            if not reason_not_run(command)
        ]
        assert place in CHECKS or all(
            printed or command.startswith("sed ") for command, printed in run
        ), place


def test_every_check_belongs_to_a_block():
    places = {(name(page), number) for page in PAGES for number, _ in enumerate(blocks(page))}
    assert set(CHECKS) | set(PYTHON) | set(FOR_READING) <= places


def test_the_results_of_every_notebook_are_checked():
    """`docs_results.NOTEBOOK` and `docs_results.UAV_NOTEBOOK` check them."""
    texts = {}
    for notebook in (ROOT / "docs" / "tutorials").glob("*.ipynb"):
        texts[notebook.stem] = json.dumps(json.loads(notebook.read_text(encoding="utf-8")))
    assert set(texts) == {"light-aircraft", "uav-log"}
    assert "updated = aerodb.replace_terms" in texts["light-aircraft"]
    assert "marks = " in texts["uav-log"]
