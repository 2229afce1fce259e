"""Cut and garbled listings: one clear error, or what is complete with a message; never a hang,
never another exception.
"""

import re
from pathlib import Path

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

import datcom_io
from flightmech.errors import ParseError

DATA = Path(__file__).parents[3] / "data" / "t37" / "datcom"

LINES = (DATA / "t37_flaps.out").read_text().split("\n")
SAMPLE = LINES[28:38] + LINES[64:160] + LINES[-4:]


def test_cut_in_the_middle_of_a_table(elevator_lines):
    with pytest.raises(ParseError) as caught:
        datcom_io.read(elevator_lines[:200])
    assert caught.value.line == 200
    assert caught.value.found == "13 rows in the static table"
    assert caught.value.expected.startswith("19 rows (NALPHA of the input cards)")


def test_cut_after_a_page(elevator_lines):
    with pytest.raises(
        ParseError,
        match=r"<text>, line 309: found the end of the print; expected the line END OF JOB",
    ):
        datcom_io.read(elevator_lines[:309])


def test_what_is_complete_of_a_cut_listing(elevator_lines):
    listing = datcom_io.read(elevator_lines[:200], partial=True)
    assert {page.kind for page in listing.pages if page.printed} == {"section"}
    listing = datcom_io.read(elevator_lines[:300], partial=True)
    names = [
        table.name for page in listing.pages for table in page.tables if page.kind != "section"
    ]
    assert names == ["static", "downwash", "dynamic", "symflp"]
    texts = [message.text for message in listing.messages]
    assert (
        "11 rows in the dcdi table instead of 19 rows (NALPHA of the input cards): left out"
        in texts
    )
    assert any(text.startswith("the listing is cut: no END OF JOB") for text in texts)
    tree = listing[0].to_datatree()
    assert tree["symflp"].sizes["condition"] == 1
    assert "dCDi" not in tree["symflp"]


def test_a_complete_last_table_may_be_cut_in_its_last_row(elevator_lines):
    cut = [*elevator_lines[:205], elevator_lines[205][:40]]
    listing = datcom_io.read(cut, partial=True)
    assert [page.kind for page in listing.pages] == ["section"] * 3
    assert "is left out" in listing.messages[-1].text


def test_a_row_lost_in_the_middle(elevator_lines):
    with pytest.raises(ParseError, match=r"line 205: found 18 rows in the static table"):
        datcom_io.read(elevator_lines[:195] + elevator_lines[196:])


def test_a_row_that_does_not_cut_into_the_columns(elevator_lines):
    lines = list(elevator_lines)
    lines[195] = lines[195][:30] + lines[195][33:]
    with pytest.raises(ParseError, match=r"line 195: found 8 rows in the static table"):
        datcom_io.read(lines)


def test_a_damaged_flight_condition_line(elevator_lines):
    lines = list(elevator_lines)
    lines[183] = lines[183].replace("167.45", "1#7.45")
    with pytest.raises(ParseError, match="no flight-condition line that can be read"):
        datcom_io.read(lines)
    static = datcom_io.read(lines, partial=True)[0].to_datatree()["static"]
    assert datcom_io.FLAGS[int(static["CL_flag"][0, 0])] == "absent"
    assert static["CL"].isnull().all("alpha").values.tolist() == [True, False, False, False, False]


def test_a_column_of_deflections_with_the_opposite_sign(elevator_lines):
    start = next(i for i, line in enumerate(elevator_lines) if "INCREMENTS DUE TO DEF" in line)
    lines = list(elevator_lines)
    for i in range(start + 1, start + 20):
        match = re.match(r"^(\s+)(-?)(\d+\.\d)(\s+[-.\d].*)$", lines[i])
        if match and float(match[3]):
            sign = " " if match[2] else "-"
            lines[i] = f"{match[1][:-1]}{match[2] and ' '}{sign}{match[3]}{match[4]}"
    with pytest.raises(
        ParseError, match=r"whole column DELTA has the opposite sign.*as DATCOM wro"
    ):
        datcom_io.read(lines)[0].to_datatree()


def test_alphas_that_are_not_those_of_the_deck(elevator_lines):
    lines = [line.replace("ALSCHD(1)=-8.0", "ALSCHD(1)=-7.0") for line in elevator_lines]
    case = datcom_io.read(lines)[0]
    with pytest.raises(
        ParseError, match=r"line 188: found ALPHA = -8 deg; expected -7 deg as in the input cards"
    ):
        case.to_datatree()


@pytest.mark.parametrize("lines", [[], [""], ["hello"], LINES[38:50]])
def test_no_listing(lines):
    with pytest.raises(ParseError, match="expected a print file"):
        datcom_io.read(lines)


def swallow(lines, partial):
    """Read lines and use everything that was read; only ParseError may come out."""
    try:
        listing = datcom_io.read(lines, partial=partial)
        listing.cells()
        listing.to_datatree()
    except ParseError:
        return


@pytest.mark.slow
@settings(max_examples=2 * settings.default.max_examples // 3, deadline=None)
@given(st.text(max_size=400), st.booleans())
def test_any_text(text, partial):
    swallow(text.split("\n"), partial)


@settings(max_examples=2 * settings.default.max_examples // 3, deadline=None)
@given(st.lists(st.sampled_from(SAMPLE), max_size=60), st.booleans())
def test_shuffled_lines(lines, partial):
    swallow(lines, partial)


@pytest.mark.slow
@settings(max_examples=2 * settings.default.max_examples // 3, deadline=None)
@given(
    st.lists(
        st.tuples(
            st.integers(0, len(SAMPLE) - 1),
            st.integers(0, 130),
            st.text("0.9-*N E$=,\f\x1a(é", min_size=1, max_size=6),
        ),
        max_size=8,
    ),
    st.integers(0, len(SAMPLE)),
    st.booleans(),
)
def test_garbled_lines(faults, end, partial):
    lines = list(SAMPLE)
    for line, column, text in faults:
        lines[line] = lines[line][:column] + text + lines[line][column + len(text) :]
    swallow(lines[:end], partial)


@pytest.mark.parametrize(
    "line",
    [
        " $" + "A" * 200_000,
        " $FLTCON" + " " * 200_000,
        " $FLTCON MACH(" + "1" * 100_000 + ")=1.0$",
        "1" * 100_000,
        "*" * 100_000,
    ],
)
def test_long_lines_do_not_hang(line):
    swallow([*LINES[64:70], line, *LINES[70:]], True)


def test_a_page_that_comes_twice_is_not_overwritten(elevator_lines):
    first = next(k for k, line in enumerate(elevator_lines) if "HIGH LIFT" in line) - 1
    after = next(
        k for k in range(first + 1, len(elevator_lines)) if elevator_lines[k].startswith("1")
    )
    case = datcom_io.read(elevator_lines[:after] + elevator_lines[first:])[0]
    assert len(list(case.tables("symflp"))) == 6
    with pytest.raises(
        ParseError, match="a second symflp table for the place of the one at lines 275-283"
    ):
        case.to_datatree()


LISTINGS = Path(__file__).parents[1] / "listings"


@pytest.mark.parametrize(
    ("name", "kinds"),
    [
        ("no_deflections", ["section", "section", "section", "static", "dynamic", "high-lift"]),
        ("no_angles", ["section", "static"]),
    ],
)
def test_headings_without_rows_that_the_cards_do_not_request_are_no_damage(name, kinds):
    """Run again, the program prints the same: SYMFLP without deflections, FLTCON without angles."""
    listing = datcom_io.read(LISTINGS / f"{name}.out")
    assert [page.kind for page in listing.pages] == kinds
    assert listing.pages[-1].printed == ()
    assert listing.unread == []


def test_a_missing_row_of_a_table_that_the_cards_request_is_damage(elevator_lines):
    heading = next(k for k, line in enumerate(elevator_lines) if "D(CDI)" in line)
    first = next(
        k for k in range(heading, len(elevator_lines)) if elevator_lines[k].startswith("    -8.0")
    )
    lines = elevator_lines[:first] + elevator_lines[first + 1 :]
    with pytest.raises(ParseError, match=r"18 rows in the dcdi table; expected 19 rows"):
        datcom_io.read(lines)
