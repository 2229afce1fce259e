"""Tests of the rules of devices, bodies and sections that the program runs without a word."""

import pytest

import datcom_io
from datcom_io.decks.check import check_case

DECK = """DIM FT
DAMP
 $FLTCON NMACH=1.0,MACH(1)=0.3,NALPHA=2.0,ALSCHD(1)=0.0,4.0,NALT=1.0,ALT(1)=0.0$
 $OPTINS SREF=160.0,CBARR=5.0,BLREF=32.0$
 $SYNTHS XCG=7.0,ZCG=0.0,XW=5.0,ZW=0.0,ALIW=0.0$
 $BODY NX=3.0,X(1)=0.0,2.0,9.0,R(1)=0.0,1.0,0.5,ZU(1)=0.0,1.0,0.5,ZL(1)=0.0,-1.0,-0.5$
 $WGPLNF CHRDR=5.0,CHRDTP=5.0,SSPN=16.0,SSPNE=15.0,SAVSI=0.0,CHSTAT=0.25,TYPE=1.0$
 $SYMFLP FTYPE=1.0,NDELTA=2.0,DELTA(1)=0.0,10.0,SPANFI=2.0,SPANFO=8.0,CHRDFI=1.0,CHRDFO=1.0$
 $JETPWR NENGSJ=1.0,THSTCJ=0.1$
 $WGSCHR TOVC=0.12,CLAMO=0.105$
NACA-W-4-2412
NEXT CASE
"""


def findings(*changes: tuple[str, str]) -> list[str]:
    text = DECK
    for old, new in changes:
        assert old in text
        text = text.replace(old, new)
    return [item.text for item in check_case(datcom_io.read_deck(text.splitlines())[0])]


@pytest.mark.parametrize(
    ("changes", "words"),
    [
        ([("NDELTA=2.0,DELTA(1)=0.0,10.0,", "")], "SYMFLP without NDELTA and DELTA"),
        ([("NDELTA=2.0,", "")], "SYMFLP without NDELTA:"),
        ([("DELTA(1)=0.0,10.0,", "")], "SYMFLP without DELTA:"),
        ([("ZU(1)=0.0", "ZU(1)=-0.5"), ("ZL(1)=0.0", "ZL(1)=-0.5")], "takes the step as camber"),
        ([("TOVC=0.12", "TOVC=1.0")], "TOVC=1 is a section as thick"),
        ([("TOVC=0.12", "TOVC=12.0")], "TOVC=12 is a section as thick as 1200%"),
        ([("TOVC=0.12", "TOVCO=0.5")], "TOVCO=0.5 is a section"),
        ([("CLAMO=0.105", "CLAMO=1.0")], "CLAMO=1 per degree"),
        ([("CLAMO=0.105", "CLALPA(1)=0.1,6.1")], "CLALPA=6.1 per degree is 55 times"),
        ([("DIM FT", "DIM IN")], "JETPWR with DIM IN"),
        ([("CHRDFO=1.0", "CHRDFO=5.1")], "CHRDFO=5.1 is larger than the chord 5 of $WGPLNF"),
        ([("TYPE=1.0", "TYPE=3.0")], "cranked wing (TYPE=3) of SAVSI=0"),
        ([(",TYPE=1.0", ",TYPE=3.0,SSPNOP=8.0,CHRDBP=4.0")], "TYPE=3 with an aspect ratio of 7.11"),
        ([("DAMP\n", "TRIM\n"), ("DELTA(1)=0.0,10.0", "DELTA(1)=10.0,0.0")], "10 is followed by 0"),
    ],
)
def test_a_fault_is_found_and_only_where_it_is(changes, words: str) -> None:
    assert not any(words in text for text in findings())
    assert any(words in text for text in findings(*changes))


def test_the_height_of_a_whole_body_does_not_count() -> None:
    raised = [
        ("ZU(1)=0.0,1.0,0.5", "ZU(1)=0.5,1.5,1.0"),
        ("ZL(1)=0.0,-1.0,-0.5", "ZL(1)=0.5,-0.5,0.0"),
    ]
    assert findings(*raised) == findings()


def test_a_crank_without_damping_or_with_sweep_is_no_fault() -> None:
    crank = ("TYPE=1.0", "TYPE=3.0")
    assert not any("cranked" in text for text in findings(crank, ("DAMP\n", "")))
    assert not any("cranked" in text for text in findings(crank, ("SAVSI=0.0", "SAVSI=5.0")))


def test_the_chord_of_a_cranked_surface_is_that_of_its_panel() -> None:
    """Chord 5 at the root, 2 at the crank of 8 ft and 2 at the tip: 3.5 at 4 ft, 2 from 8 ft on."""
    crank = ("CHRDTP=5.0", "CHRDTP=2.0,CHRDBP=2.0,SSPNOP=8.0")
    kind = ("TYPE=1.0", "TYPE=2.0")
    station = ("SPANFI=2.0", "SPANFI=4.0")
    large = [text for text in findings(crank, kind, station, ("CHRDFI=1.0", "CHRDFI=3.6"))]
    assert any("CHRDFI=3.6 is larger than the chord 3.5 of" in text for text in large)
    fits = findings(crank, kind, station, ("CHRDFI=1.0", "CHRDFI=3.4"))
    assert not any("larger than the chord" in text for text in fits)
    # a straight planform has no crank: 5 - 3 / 16 * 4
    straight = findings(crank, station, ("CHRDFI=1.0", "CHRDFI=4.2"))
    assert not any("larger than the chord" in text for text in straight)
