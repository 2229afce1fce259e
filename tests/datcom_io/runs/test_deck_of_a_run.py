"""Tests of the deck that a run hands to the program, and of prints of another program."""

import pytest

import datcom_io
from datcom_io.runs.running import _deck_bytes
from flightmech.errors import ParseError

TWO_CASES = """DAMP
PART
 $FLTCON NMACH=1.0,MACH(1)=0.3,NALPHA=1.0,ALSCHD(1)=0.0,NALT=1.0,ALT(1)=0.0$
 $OPTINS SREF=160.0,CBARR=5.0,BLREF=32.0$
 $SYNTHS XCG=7.0,ZCG=0.0,XW=5.0,ZW=0.0,ALIW=0.0$
CASEID FIRST
SAVE
NEXT CASE
CASEID SECOND
 $FLTCON MACH(1)=0.4$
NEXT CASE
"""


@pytest.mark.parametrize(("suffix", "count"), [(".dcm", 2), (".inp", 1)])
def test_the_cards_that_datcom_plus_repeats_reach_the_program(tmp_path, suffix, count) -> None:
    """DATCOM+ repeats DAMP and PART after SAVE; a plain deck goes to the program as it is."""
    file = tmp_path / f"deck{suffix}"
    file.write_text(TWO_CASES)
    lines = _deck_bytes(datcom_io.read_deck(file), file).decode().splitlines()
    assert [lines.count("DAMP"), lines.count("PART")] == [count, count]
    if suffix == ".inp":
        assert "\n".join(lines) + "\n" == TWO_CASES


def test_a_print_of_missile_datcom_is_named(tmp_path) -> None:
    file = tmp_path / "for006.dat"
    file.write_text(
        "1         ***** THE USAF AUTOMATED MISSILE DATCOM * REV 3/99 *****\n"
        "    CONERR - INPUT ERROR CHECKING\n"
    )
    with pytest.raises(ParseError, match="a file of Missile DATCOM, another program"):
        datcom_io.read(file)
