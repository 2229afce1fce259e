"""Chapters of a report kept with its results: it is written again with them, byte by byte, without
databases, fits and submodels.
"""

import re
import sys
from html import unescape
from pathlib import Path

import numpy as np
import pandas as pd
import pytest
import xarray as xr
from click.testing import CliRunner

import pom
from flightmech.errors import SchemaError
from pom.cli.group import pom as group
from pom.diagnosis.culprits.project_ranking import ProjectRanking
from pom.report.chapters import draw_chapters, restore_chapters, with_kept
from pom.report.models.fit_figures import sample_map
from pom.report.submodels.section import Picture, Section, SectionTable

sys.path.insert(0, str(Path(__file__).parents[1]))
sys.path.insert(0, str(Path(__file__).parent))
import report_fixture as fixture
import report_pages

BOTH = ("identification", "database")
LINES = {
    "5000 ft, 2000 kg, clean": xr.Dataset(
        {"alpha": ("mach", np.radians([12.0, 4.0, np.nan]))}, {"mach": [0.15, 0.3, 0.45]}
    ),
    "5000 ft, 2100 kg, flaps 20 deg": xr.Dataset(
        {"alpha": ("mach", np.radians([9.0, 2.0, 0.0]))}, {"mach": [0.15, 0.3, 0.45]}
    ),
}


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    """A report with databases, fits and a term swap; both chapters on paper."""
    place = tmp_path_factory.mktemp("chapters") / "old"
    more = {
        "databases": fixture.databases(),
        "fits": fixture.fits(),
        "level_lines": LINES,
        "chapters": BOTH,
    }
    pom.write_report(
        [fixture.roll_result()], place, title="T-37", provenance=fixture.PROVENANCE, jobs=1, **more
    )
    return place


@pytest.mark.nightly
def test_warnings_of_a_database_are_on_the_first_page_and_in_the_pdf(tmp_path):
    """And in a report that is written again from its results; without warnings there is no such
    section.
    """
    databases, warning = (
        fixture.databases(),
        "no place in the database, the estimate is left out: CL: delta_e of 'multisine'",
    )
    last = list(databases)[-1]
    databases[last].attrs["notices"] = f"{warning}\nincompatible fits: Cn"
    more = {"title": "T-37", "provenance": fixture.PROVENANCE, "jobs": 1}
    pom.write_report([fixture.roll_result()], tmp_path / "old", databases=databases, **more)
    html = (tmp_path / "old" / "report.html").read_text(encoding="utf-8")
    rows = re.search(r'<table[^>]* id="notices">.*?</table>', html, re.S)[0]
    assert unescape(rows).count(f'<th scope="row">{last}</th>') == 2
    assert warning in unescape(rows)
    archive = pom.read_archive(tmp_path / "old")
    pom.write_report(archive.results, tmp_path / "new", kept=archive.chapters, **more)
    for name in ("report.html", "report.pdf"):
        assert (tmp_path / "new" / name).read_bytes() == (tmp_path / "old" / name).read_bytes()


@pytest.mark.slow
def test_a_report_from_its_results_is_the_same_in_every_byte(folder, tmp_path):
    archive = pom.read_archive(folder)
    assert archive.chapters
    assert 'id="notices"' not in (folder / "report.html").read_text(encoding="utf-8")
    provenance = {**archive.provenance}
    pom.write_report(
        archive.results,
        tmp_path / "new",
        title="T-37",
        provenance=provenance,
        kept=archive.chapters,
        jobs=1,
    )
    for name in ("report.html", "report.pdf", "results.nc", "results.json"):
        assert (tmp_path / "new" / name).read_bytes() == (folder / name).read_bytes(), name
    assert [item.state for item in pom.verify(tmp_path / "new") if item.kind == "statement"] == [
        "same"
    ] * 6


@pytest.mark.nightly
def test_the_verb_writes_the_chapters_again(folder, tmp_path):
    done = CliRunner().invoke(
        group, ["report", str(folder), "-o", str(tmp_path / "letter"), "--paper", "letter"]
    )
    assert done.exit_code == 0, done.output
    old, new = (
        report_pages.parcels((place / "report.html").read_text(encoding="utf-8"))
        for place in (folder, tmp_path / "letter")
    )
    for name in ("models", "identification"):
        assert new[name] == old[name]
    assert restore_chapters(pom.read_archive(tmp_path / "letter").chapters).on_paper == BOTH
    one = ["report", str(folder), "-o", str(tmp_path / "one"), "--chapter", "database"]
    assert CliRunner().invoke(group, one).exit_code == 0
    sizes = [
        len((place / "report.pdf").read_bytes())
        for place in (tmp_path / "one", tmp_path / "letter")
    ]
    assert sizes[0] < sizes[1]


@pytest.mark.nightly
def test_what_was_not_kept_is_named(tmp_path):
    """Figures of the fits for paper are kept where they were wanted; without databases there is
    nothing to compare.
    """
    fits = {
        "title": "T-37",
        "provenance": fixture.PROVENANCE,
        "fits": fixture.fits(),
        "paper": None,
        "jobs": 1,
    }
    pom.write_report([fixture.roll_result()], tmp_path / "old", **fits)
    words = ["report", str(tmp_path / "old"), "-o", str(tmp_path / "new")]
    with pytest.raises(
        SchemaError, match="identification: the results hold no figures of it; match again"
    ):
        CliRunner().invoke(group, [*words, "--chapter", "identification"], catch_exceptions=False)
    with pytest.raises(
        SchemaError, match="database: the results compare no databases; give them as --database"
    ):
        CliRunner().invoke(group, [*words, "--chapter", "database"], catch_exceptions=False)
    assert not (tmp_path / "new").exists()
    archive, now = (
        pom.read_archive(tmp_path / "old"),
        {**fits, "databases": fixture.databases(), "fits": (), "chapters": ("database",)},
    )
    pom.write_report(
        archive.results, tmp_path / "more", kept=archive.chapters, **now
    )  # given now, it need not have been kept
    more = restore_chapters(pom.read_archive(tmp_path / "more").chapters)
    assert (more.on_paper, list(more.databases), bool(more.identification)) == (
        ("database",),
        list(fixture.databases()),
        True,
    )
    assert CliRunner().invoke(group, [*words, "--no-pdf"]).exit_code == 0
    assert "identification" in report_pages.parcels(
        (tmp_path / "new" / "report.html").read_text(encoding="utf-8")
    )


@pytest.mark.slow
def test_sections_pictures_and_traces_come_back_as_they_were():
    section = Section(
        "gear",
        (("strut", "type 2", "3 %"),),
        (SectionTable("constants", ("name", "value"), (("k", "1"),)),),
        (Picture("<g/>", 9.0, "x"),),
    )
    made = draw_chapters(fixture.databases(), {}, fixture.fits(), LINES, [section], {}, BOTH)
    again = restore_chapters(made.kept())
    assert again.submodels[0].pictures == [Picture("<g/>", 9.0, "x")]
    assert again.submodels[0].grids[0].caption == "constants"
    assert again.identification["body"] == made.identification["body"]
    assert again.identification["fits"][0]["drawing"] == made.identification["fits"][0]["drawing"]
    assert list(again.roots) == list(fixture.databases())
    assert restore_chapters(b"").kept() == b""


@pytest.mark.nightly
def test_the_ranking_over_all_cases_comes_back_and_is_shown(tmp_path):
    ranking = _ranking()
    made = draw_chapters(
        fixture.databases(), {}, fixture.fits(), LINES, (), {}, (), ranking=ranking
    )
    again = restore_chapters(made.kept())
    assert list(again.ranking_text) == ranking.sentences
    assert again.ranking.rows == [list(row) for row in ranking.rows()]
    # A report that is written again without the ranking keeps it.
    now = draw_chapters(fixture.databases(), {}, fixture.fits(), LINES, (), {}, ())
    assert with_kept(now, again).ranking == again.ranking
    pom.write_report([fixture.roll_result()], tmp_path / "report", title="T", kept=made, paper=None)
    text = (tmp_path / "report" / "report.html").read_text(encoding="utf-8")
    page, _ = report_pages.parcels(text)["models"]
    table = page["page"].partition("Wrong terms over all cases")[2]
    assert ranking.sentences[0] in unescape(table)
    assert "8.2" in table


def _ranking() -> ProjectRanking:
    """Return a ranking of one term that one case feels."""
    culprits = pd.DataFrame(
        [
            {
                "term": "Cm/basic",
                "score": 3.0,
                "effect": 1.5,
                "distance": 8.25,
                "alone": 0.5,
                "without": 1.75,
                "case": "short_period",
                "felt": 1,
            }
        ]
    )
    states = [("", 2.0, 0), ("Cm/basic", 0.5, 1), ("final", 0.25, 1)]
    rows = []
    for term, mismatch, matched in states:
        row = {"term": term, "mismatch": mismatch, "matched": matched, "cases": 1}
        rows.append(row | {"partner": "", "correlation": float("nan")})
    return ProjectRanking(culprits, pd.DataFrame(rows))


def test_the_map_of_the_flights_has_the_one_g_lines():
    bare, found = sample_map(fixture.fits()), sample_map(fixture.fits(), LINES)
    assert "1 g lines: 5000 ft, 2000 kg, clean, 5000 ft, 2100 kg, flaps 20 deg" in found.words
    assert (
        found.body.count('class="trace run-') - bare.body.count('class="trace run-') == 4
    )  # a line and its sample each
    assert found.height > bare.height
