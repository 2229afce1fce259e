"""What the program carries from one deflection, condition or case to the next is flagged; what it
does not carry is not.
"""

from pathlib import Path

import numpy as np
import pytest

import datcom_io
from datcom_io.cells import OK, SUSPECT

LONGITUDINAL = ["CD", "CL", "CM", "CN", "CA", "XCP", "CLA", "CMA"]


def suspects(listing, table):
    """Return the suspect cells of the tables of a kind."""
    cells = listing.cells()
    return cells[(cells["table"] == table) & (cells["flag"] == "suspect")]


def test_only_the_first_flap_setting_over_ground_counts(t37):
    """Alpha 4 deg, 30 ft, flap 40: CL 0.539 as third deflection of a run, 0.526 alone; 0.519 in
    free air.
    """
    listing, alone = t37("t37_ground_flap.out"), t37("t37_ground_flap_one_by_one.pdas.out")
    pages = [page for page in listing.pages if page.ground_height == 30.0]
    assert [page.table("static").values[4, 2] for page in pages] == [0.523, 0.53, 0.539]
    first_run, *_, last_run = [page for page in alone.pages if page.ground_height == 30.0]
    assert [page.table("static").values[4, 2] for page in (first_run, last_run)] == [0.523, 0.526]
    assert [page.table("static").flags[4, 2] for page in pages] == [OK, SUSPECT, SUSPECT]
    found = suspects(listing, "static")
    assert found["column"].unique().tolist() == LONGITUDINAL
    assert len(found) == 16 * 10 * len(LONGITUDINAL)
    assert suspects(alone, "static").empty
    assert [
        message.text.split(" hold")[0]
        for message in listing.messages
        if "pages over" in message.text
    ] == ["16 pages over ground"]


def test_the_first_page_of_an_elevator_over_ground_is_the_clean_one(t37):
    """The program has no elevator in its ground effect: the first deflection prints the clean
    pages, the others add to them.
    """
    clean, moved = (
        [
            page.table("static").rows
            for page in t37(f"t37_{name}.out").pages
            if page.kind == "static"
        ]
        for name in ("ground", "ground_elevator")
    )
    assert moved[1:9] == clean[1:9]
    found = suspects(t37("t37_ground_elevator.out"), "static")
    assert len(found) == 8 * 8 * 10 * len(LONGITUDINAL)


def test_moments_of_deflections_after_the_first_of_a_run(t37):
    single = suspects(t37("t37_elevator_one_by_one.pdas.out"), "symflp")
    assert single["column"].unique().tolist() == ["D(CM)"]
    assert single.groupby("case").size().tolist() == [8] * 6
    assert -25.0 not in single["delta"].values
    looped = suspects(t37("t37_elevator.out"), "symflp")
    assert len(looped) == 5 * 9 - 1
    dCm = t37("t37_elevator.out")[0].to_datatree()["symflp"]
    assert dCm["dCm"].notnull().all()
    assert (dCm["dCm_flag"] == SUSPECT).sum() == 44


@pytest.mark.parametrize("name", ["clean", "build", "aileron", "ground"])
def test_other_pages_carry_nothing_that_is_flagged(t37, name):
    assert "suspect" not in t37(f"t37_{name}.out").cells()["flag"].values


def test_summary_counts_suspects_apart_from_missing_cells(t37):
    from datcom_io.cli.summary import case_summary_rows

    (row,) = case_summary_rows(t37("t37_ground_flap.out"))
    assert row["suspect"] == 16 * 10 * len(LONGITUDINAL) + 2
    assert "suspect" not in row["missing"]


def test_ailerons_over_ground_are_taken_for_flaps_on_a_wing(ground_flap_lines):
    """GRDEFF takes STYPE 4 for a double-slotted flap: with the program CL is 0.012 off at 2.5 ft in
    the first block of heights already.
    """
    lines = [line.replace("$SYMFLP FTYPE=2.0", "$ASYFLP STYPE=4.0") for line in ground_flap_lines]
    static = [page.table("static") for page in datcom_io.read(lines).pages if page.kind == "static"]
    assert [bool((table.flags == SUSPECT).any()) for table in static] == [False] + [True] * 24
    np.testing.assert_array_equal(static[1].flags[0, [0, 11]], OK)
    spoilers = [
        line.replace("$SYMFLP FTYPE=2.0", "$ASYFLP STYPE=2.0") for line in ground_flap_lines
    ]
    static = [
        page.table("static") for page in datcom_io.read(spoilers).pages if page.kind == "static"
    ]
    assert [bool((table.flags == SUSPECT).any()) for table in static] == [False] * 9 + [True] * 16


@pytest.fixture
def ground_flap_lines():
    return (
        (Path(__file__).parents[3] / "data" / "t37" / "datcom" / "t37_ground_flap.out")
        .read_text()
        .split("\n")
    )


LISTINGS = Path(__file__).parents[1] / "listings"


def test_an_angle_that_the_cards_do_not_give():
    """The sixth angle is printed as NDM; CL at 8 deg is 0.903, with NALPHA=5 it is 0.929: the other
    rows are not right either.
    """
    listing = datcom_io.read(LISTINGS / "missing_angle.out")
    assert listing.unread == []
    static = next(table for _, table in listing[0].tables("static"))
    assert static.text(5, 0) == "NDM"
    assert static.values[:5, 0].tolist() == [-4.0, 0.0, 4.0, 8.0, 12.0]
    assert static.values[:, 2].tolist() == [-0.224, 0.143, 0.518, 0.903, 1.302, 0.143]
    assert (static.flags[:, 2] == SUSPECT).all()
    assert [
        message.text.split(":")[0] for message in listing.messages if "NALPHA" in message.text
    ] == ["NALPHA counts 6 angles of attack, the input cards give 5"]
    (case,) = listing.to_datatree().children.values()
    for leaf in ("static", "downwash", "dynamic"):
        np.testing.assert_allclose(case[leaf]["alpha"], np.radians([-4.0, 0.0, 4.0, 8.0, 12.0]))
    assert (case["symflp"]["dCDi_flag"] == OK).all()  # computed angle by angle
    assert case["symflp"].sizes["alpha"] == 5


def test_a_missing_angle_behind_negative_ones_spoils_its_row_only():
    """It counts as zero, and the angles rise: all rows but the last are those of NALPHA=5 within
    what a further point changes.
    """
    listing = datcom_io.read(LISTINGS / "missing_angle_below_zero.out")
    for name in ("static", "downwash", "dynamic"):
        table = next(table for _, table in listing[0].tables(name))
        assert (table.flags[:5] != SUSPECT).all()
        assert (table.flags[5] != OK).all()
    (case,) = listing.to_datatree().children.values()
    assert (case["static"]["CL_flag"] == OK).all()
