"""Tests of sizes, places, angles and conditions that no aeroplane has."""

from pathlib import Path

import pytest

from datcom_io.decks.check import check_deck, describe_doubts
from datcom_io.decks.deck_file import read_deck
from datcom_io.decks.rules_sizes import describe_size, list_sizes

DATA = Path(__file__).parents[3] / "data"
DECK = (DATA / "c182" / "datcom" / "c182_study.inp").read_text()
# With both devices in one case the program keeps the aileron only.
START = DECK.index("* AILERON")
DECK = DECK[:START] + DECK[DECK.index("CASEID") :]
DEGREES = "DELTA(1)=-25.0,-20.0,-15.0,-10.0,-5.0,0.0,5.0,\n   10.0,20.0"
RADIANS = "DELTA(1)=-.44,-.35,-.26,-.17,-.09,0.0,.09,\n   .17,.35"

MISTAKES = [
    ("ZH=0.8", "ZH=8.0", "ZH=8 puts the horizontal tail outside of the body and fin"),
    ("ZH=0.8", "ZH=-8.0", "ZH=-8 puts the horizontal tail outside of the body and fin"),
    ("ZW=1.65", "ZW=16.5", "ZW=16.5 puts the wing outside of the body, which has heights of -1.9"),
    ("ZV=1.0", "ZV=10.0", "ZV=10 puts the root of the fin outside of the body"),
    ("XH=22.3", "XH=223.0", "XH=223 puts the apex of the horizontal tail outside of the body"),
    ("XCG=7.6", "XCG=22.3", "XCG=22.3 is 3.3 mean chords behind the leading edge"),
    ("XW=6.0", "XW=16.0", "XCG=7.6 is 1.8 mean chords in front of the leading edge"),
    ("SREF=174.0", "SREF=156.6", "SREF=156.6 is 0.9 times the area of the planform, 174;"),
    ("BLREF=35.8", "BLREF=38.0", "BLREF=38 is 1.06 times the span of the planform, 35.8;"),
    ("CBARR=4.9", "CBARR=4.0", "CBARR=4 is 0.817 times the mean aerodynamic chord"),
    ("SSPN=17.9,SSPNE=16.1", "SSPN=35.8,SSPNE=34.0", "it is SSPN=35.8, which is the semispan"),
    ("SSPN=5.83,SSPNE=5.23", "SSPN=11.66,SSPNE=11.", "SSPN=11.66 makes a tail with 0.44 of the"),
    ("SSPN=5.1,", "SSPN=51.,", "SSPN=51 is a fin as high as 1.4 of the span of the wing, 35.8"),
    ("SSPNE=16.1", "SSPNE=19.0", "SSPNE=19 is larger than SSPN=17.9"),
    ("CHRDR=5.56,CHRDTP=4.16", "CHRDR=4.16,CHRDTP=5.56", "CHRDTP=5.56 is larger than CHRDR=4.16"),
    ("CHSTAT=0.25", "CHSTAT=25.0", "CHSTAT=25 is a station of the chord; give a fraction"),
    ("TC=0.09", "TC=12.0", "TC=12 is the thickness of the device at its hinge"),
    ("CB=0.1", "CB=10.0", "CB=10 is the chord of its balance"),
    ("PHETE=0.0522", "PHETE=6.0", "PHETE=6 is the tangent of half the angle"),
    ("DHDADI=1.7", "DHDADI=-1.7", "DHDADI=-1.7 points the tips of a wing without sweep down"),
    ("DHDADI=1.7", "DHDADI=17.0", "DHDADI=17 is a dihedral of the wing; usual is 0 to 10 deg"),
    ("SAVSI=35.0", "SAVSI=-35.0", "SAVSI=-35 sweeps the vertical tail by that angle"),
    ("TWISTA=-3.0", "TWISTA=-30.0", "TWISTA=-30 twists the wing; usual is -5 to 0 deg"),
    ("ALIW=1.5", "ALIW=15.0", "ALIW=15 is the incidence; usual is -5 to 5 deg"),
    ("ALIW=1.5", "ALIW=0.026", "ALIW=0.026 is an incidence that no jig holds; the program takes"),
    ("ALT(1)=5000.0", "RNNUB(1)=0.15,0.2,0.2", "RNNUB=0.15 is a Reynolds number per length"),
    ("ALT(1)=5000.0", "ALT(1)=500000.0", "ALT=500000 is 152.4 km with DIM FT"),
    ("MACH(1)=0.1,0.15,0.2", "MACH(1)=100.,150.,200.", "MACH=100 is beyond the Mach numbers"),
    ("MACH(1)=0.1,0.15,0.2", "VINF(1)=0.1,0.15,0.2", "VINF=0.1 is 0.0305 m/s with DIM FT"),
    ("ALT(1)=5000.0", "ALT(1)=5000.0,WT=265.0", "WT=265 lb is a wing loading of 72.9 N/m2"),
    ("ALT(1)=5000.0", "ALT(1)=5000.0,TINF=15.0", "TINF=15 is an absolute temperature in deg R"),
    (DEGREES, RADIANS, "DELTA has 9 deflections up to 0.44; the program takes degrees: 0.44 rad"),
]


@pytest.mark.parametrize(("right", "wrong", "text"), MISTAKES)
def test_a_mistake_in_one_number_is_one_line(right: str, wrong: str, text: str) -> None:
    assert right in DECK
    (case,) = read_deck(DECK.replace(right, wrong, 1).splitlines())
    assert text in "\n".join(describe_doubts(case))
    assert text in "\n".join(finding.text for finding in check_deck(case))


UNUSUAL = [
    # the second wing of a tandem in front, as large as the first
    ("XH=22.3", "XH=1.0", "SSPN=5.83,SSPNE=5.23", "SSPN=13.6,SSPNE=12.9"),
    # an inverted gull: anhedral at the root and dihedral outside
    ("DHDADI=1.7,DHDADO=0.0", "DHDADI=-8.0,DHDADO=6.0", "SAVSI=0.0", "SSPNOP=9.0,CHRDBP=4.9"),
    # a steep V tail
    ("DHDADI=0.0,DHDADO=0.0", "DHDADI=50.0", "", ""),
    # an ultralight, and a glider of 1930
    ("ALT(1)=5000.0", "ALT(1)=5000.0,WT=550.0", "", ""),
    # a tail on booms, behind the end of the body
    ("XH=22.3", "XH=36.0", "", ""),
]


@pytest.mark.parametrize(("right", "other", "second", "instead"), UNUSUAL)
def test_no_doubt_about_a_size_of_an_unusual_aeroplane(
    right: str, other: str, second: str, instead: str
) -> None:
    assert right in DECK
    assert second in DECK
    (case,) = read_deck(DECK.replace(right, other, 1).replace(second, instead, 1).splitlines())
    assert [text for _, _, text in list_sizes(case)] == []


def test_no_doubt_about_the_own_decks() -> None:
    decks = sorted(DATA.glob("**/*.inp"))
    assert len(decks) > 20
    for file in decks:
        for case in read_deck(file):
            assert describe_doubts(case) == [], file.name


def test_the_size_shows_a_deck_in_feet_with_dim_m() -> None:
    def size(text: str) -> str:
        (case,) = read_deck(text.splitlines())
        return describe_size(case)

    assert size(DECK) == "span 10.91 m (35.8 with DIM FT)"
    assert size(DECK.replace("DIM FT", "DIM M")) == "span 35.8 m (35.8 with DIM M)"
    assert size(DECK.replace("DIM FT\n", "")) == "span 10.91 m (35.8 ft, without a card DIM)"


def test_a_designation_has_the_digits_of_its_type() -> None:
    """Of NACA W 5 4415 the program of 1996 makes another aerofoil, without a message."""
    (case,) = read_deck(DECK.replace("NACA W 4 2412", "NACA W 5 2412", 1).splitlines())
    texts = [finding.text for finding in check_deck(case)]
    assert [text for text in texts if text.startswith("NACA W: type 5")] == [
        "NACA W: type 5 with the designation 2412, which has 4 digits; the program reads another "
        "aerofoil: write type 4, or 5 digits"
    ]
    (short,) = read_deck(DECK.replace("NACA W 4 2412", "NACA W 4 12", 1).splitlines())
    # there is no type 2
    assert any(finding.text.endswith("aerofoil: write 4 digits") for finding in check_deck(short))
    (modified,) = read_deck(DECK.replace("NACA W 4 2412", "NACA W 4 0012-64", 1).splitlines())
    assert not [x for x in check_deck(modified) if "designation" in x.text]
