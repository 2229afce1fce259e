"""How a listing and its cases represent themselves as text."""

import datcom_io
from aeromatch.cli.actions.examples import example_folder
from datcom_io.listing import Case, Listing

LONGEST = 2000  # letters; a console shows what an expression returns


def test_a_listing_is_shown_by_its_cases():
    listing = datcom_io.read(example_folder("t37") / "datcom" / "t37_clean.out")
    text = repr(listing)
    assert "T-37 OWN DECK CLEAN AIRCRAFT" in text
    assert "lines 1774" in text
    assert len(text) < 300
    case = repr(listing[0])
    assert "T-37 OWN DECK CLEAN AIRCRAFT" in case
    assert "downwash" in case
    assert len(case) < 300


def test_many_cases_with_long_names_are_counted():
    cases = [
        Case(ordinal=number, run=1, line=1, file="a.out", name=f"CASE {number} " + 80 * "X")
        for number in range(1, 200)
    ]
    text = repr(Listing("a.out", cases=cases))
    assert len(text) <= LONGEST
    assert "'CASE 1 XX" in text
    assert "and 174 more" in text
    assert "cases 199" in text
    assert (
        repr(datcom_io.Listing("empty.out"))
        == "<Listing 'empty.out': runs 0, lines 0, not understood 0, messages 0; cases 0: >"
    )
