"""Section on the validity envelope: maps kept with the results, flights and shares on the page."""

import sys
from dataclasses import replace
from html import unescape
from pathlib import Path

import numpy as np
import pytest

import pom
from flightmech.flown_states import FLOWN_STATES, gather_states, pack_states
from flightmech.terms import make_term
from pom.report.chapters import draw_chapters, restore_chapters
from pom.report.submodels.envelope import envelope_section
from pom.tolerances.bands import RowRemark

sys.path.insert(0, str(Path(__file__).parents[1]))
sys.path.insert(0, str(Path(__file__).parent))
import report_fixture as fixture
import report_pages


@pytest.fixture(scope="module")
def chapters():
    """Return the chapters of a lift curve from flight, flown from 0 to 6 deg at Mach 0.3."""
    nodes = np.radians([-10.0, 0.0, 10.0, 20.0])
    lift = make_term(0.3 + 5.0 * nodes, {"alpha": nodes}, stderr=0.01, source="flight")
    last = fixture.tree({"CL": {"basic": lift}}, "flight")
    alpha = np.radians(np.linspace(0.0, 6.0, 61))
    samples = {"alpha": alpha, "beta": 0.0 * alpha, "mach": np.full(61, 0.3)}
    last.attrs[FLOWN_STATES] = pack_states(gather_states([samples]))
    databases = {**fixture.databases(), "final": last}
    return draw_chapters(databases, {}, (), {}, (), {}, ())


def test_maps_come_back_as_they_were(chapters):
    again = restore_chapters(chapters.kept())
    assert [own.plane for own in again.maps] == [("alpha", "mach"), ("alpha", "beta")]
    for own, before in zip(again.maps, chapters.maps, strict=True):
        assert (own.plane, own.configuration, own.held) == (
            before.plane,
            before.configuration,
            before.held,
        )
        assert own.regions.dtype == before.regions.dtype
        assert (own.regions == before.regions).all()
        assert (own.leaving == before.leaving).all()
        assert all((a == b).all() for a, b in zip(own.edges, before.edges, strict=True))
    assert again.kept() == chapters.kept()


def test_databases_without_states_have_no_maps():
    assert draw_chapters(fixture.databases(), {}, (), {}, (), {}, ()).maps == ()


def test_flown_range_and_shares_of_a_case(chapters):
    result = fixture.roll_result()
    remark = RowRemark("low_confidence", "x", "alpha", values={"share": 0.25}, unit="1")
    reach = RowRemark("low_confidence", "no flight supports the model beyond the stall")
    first, run = result.verdict.iloc[0], result.runs[0]
    rows = result.verdict.copy()
    rows.at[rows.index[0], "remarks"] = (*first["remarks"], remark, reach)
    (flown, left) = envelope_section(chapters.maps, [replace(result, verdict=rows)]).grids
    # one and a half cells of 1 deg beyond the samples
    assert flown.rows == (("one configuration", "-1.5 ... 7.5", "-1.5 ... 1.5"),)
    assert left.rows == ((result.case.title or result.case.name, run, "25 %", "-"),)


def test_section_is_on_the_page(chapters, tmp_path):
    pom.write_report(
        [fixture.roll_result()], tmp_path / "report", title="T", kept=chapters, paper=None
    )
    text = (tmp_path / "report" / "report.html").read_text(encoding="utf-8")
    pages = [unescape(page["page"]) for page, _ in report_pages.parcels(text).values() if page]
    (page,) = [page for page in pages if "Maps of the regions of the validity envelope" in page]
    assert "Flown region of each configuration" in page
    assert "-1.5 ... 7.5" in page
    assert 'clip-path="url(#envelope-0' in page
