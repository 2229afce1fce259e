"""Tests of reference quantities against the planform, and of styles of ASYFLP."""

import pytest

from datcom_io.decks.check import check_deck
from datcom_io.decks.deck_file import read_deck
from datcom_io.decks.planforms import measure_main_wing, measure_wing
from datcom_io.decks.rules_reference import describe_reference_quantities

# Area 634.3, mean aerodynamic chord 7.582, span 90.42 ft.
WING = " $WGPLNF CHRDTP=3.56,SSPNE=45.21,SSPN=45.21,CHRDR=10.47,SAVSI=10.45,CHSTAT=0.25,TYPE=1.0$"
REFERENCE = {"SREF": 634.3, "CBARR": 7.582, "BLREF": 90.42}


def deck(*more: str, **changes: float):
    values = ",".join(f"{name}={value}" for name, value in {**REFERENCE, **changes}.items())
    lines = [" $FLTCON NMACH=1.0,MACH(1)=0.2,NALT=1.0,ALT(1)=0.0,NALPHA=1.0,ALSCHD(1)=0.0$"]
    lines += [f" $OPTINS {values}$", " $SYNTHS XW=25.81,XH=51.23,XCG=33.22$", WING, *more]
    (case,) = read_deck(lines)
    return case


def test_the_planform_of_a_straight_wing() -> None:
    wing = measure_wing(deck())
    taper = 3.56 / 10.47
    mean = 2.0 / 3.0 * 10.47 * (1.0 + taper + taper**2) / (1.0 + taper)
    assert (wing.area, wing.span) == (pytest.approx(45.21 * (10.47 + 3.56)), 90.42)
    assert wing.mean_chord == pytest.approx(mean, rel=1e-6)


def test_a_larger_surface_behind_is_the_wing() -> None:
    tail = " $HTPLNF CHRDR=26.62,CHRDTP=3.8,SSPN=48.0,SSPNE=46.0,SAVSI=38.5,CHSTAT=0.0,TYPE=1.0$"
    assert measure_main_wing(deck()) == measure_wing(deck())
    assert measure_main_wing(deck(tail)).area == pytest.approx(48.0 * (26.62 + 3.8))


@pytest.mark.parametrize(
    ("name", "value", "text"),
    [
        (
            "CBARR",
            10.47,
            "1.38 times the mean aerodynamic chord of the planform, 7.582 (it is the ",
        ),
        ("BLREF", 45.21, "0.5 times the span of the planform, 90.42 (it is the semispan)"),
        ("SREF", 1268.6, "2 times the area of the planform, 634.3 (it is twice that)"),
        ("SREF", 6828.0, "10.8 times the area of the planform, 634.3 (it is that in ft2, with a "),
        ("BLREF", 27.56, "0.305 times the span of the planform, 90.42 (it is that in m, with a "),
        ("CBARR", 27.0, "3.56 times the mean aerodynamic chord of the planform, 7.582;"),
    ],
)
def test_a_reference_quantity_of_another_kind(name: str, value: float, text: str) -> None:
    found = describe_reference_quantities(deck(**{name: value}))
    assert list(found) == [name]
    assert text in found[name]
    texts = [
        item.text for item in check_deck([deck(**{name: value})]) if item.severity == "warning"
    ]
    assert found[name] in texts


def test_usual_reference_quantities() -> None:
    assert describe_reference_quantities(deck()) == {}
    # A reference area with its extensions, a mean geometric chord.
    assert describe_reference_quantities(deck(SREF=761.0, CBARR=7.01, BLREF=95.0)) == {}


@pytest.mark.parametrize(
    ("card", "text"),
    [
        ("STYPE=1.0,NDELTA=2.0,DELTAL(1)=-5.0,5.0", "STYPE=1 is a spoiler, and no height DELTAS"),
        ("STYPE=5.0,NDELTA=2.0,DELTAL(1)=-5.0,5.0", "STYPE=5 deflects the halves of a horizontal"),
        ("STYPE=1.0,NDELTA=2.0,DELTAS(1)=0.0,0.05", ""),
    ],
)
def test_a_style_without_what_it_needs(card: str, text: str) -> None:
    texts = [item.text for item in check_deck([deck(f" $ASYFLP {card}$")])]
    found = [item for item in texts if "$ASYFLP: STYPE" in item]
    assert len(found) == bool(text)
    assert all(text in item for item in found)


TAIL = " $HTPLNF CHRDR=6.0,CHRDTP=3.0,SSPN=15.0,SSPNE=14.0,SAVSI=10.0,CHSTAT=0.25,TYPE=1.0$"
FIN = " $VTPLNF CHRDR=8.0,CHRDTP=4.0,SSPN=10.0,SSPNE=9.0,SAVSI=30.0,CHSTAT=0.25,TYPE=1.0$"
BODY = " $BODY NX=3.0,X(1)=0.0,30.0,60.0,R(1)=0.0,4.0,0.5$"


@pytest.mark.parametrize(
    ("places", "text"),
    [
        ("XW=25.81,XH=51.23,XCG=28.0,XV=48.0", ""),
        ("XW=25.81,XH=51.23,XCG=280.0,XV=48.0", "XCG=280 is outside of the body, whose X is 0 ..."),
        ("XW=25.81,XH=5.123,XCG=28.0,XV=48.0", "in front of that of the wing, and the wing is"),
        ("XW=25.81,XH=33.0,XCG=28.0,XV=48.0", "behind that of the wing: a tail volume of 0.11"),
        ("XW=25.81,XH=51.23,XCG=28.0,XV=4.8", "XV=4.8 with CHRDR=8 puts the fin in front of XCG"),
    ],
)
def test_a_surface_or_the_centre_of_gravity_in_an_unusual_place(places: str, text: str) -> None:
    lines = [" $FLTCON NMACH=1.0,MACH(1)=0.2,NALT=1.0,ALT(1)=0.0,NALPHA=1.0,ALSCHD(1)=0.0$"]
    lines += [f" $SYNTHS {places}$", WING, TAIL, FIN, BODY]
    found = [item.text for item in check_deck(read_deck(lines)) if "$SYNTHS: X" in item.text]
    assert len(found) == bool(text)
    assert text in "".join(found)
