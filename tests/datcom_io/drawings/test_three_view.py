"""Three-view drawings of decks: places from the cards, and errors that the drawing names."""

import json
import re
import xml.etree.ElementTree as ET
from pathlib import Path

import numpy as np
import pytest
from click.testing import CliRunner

from aeromatch.cli import cli
from datcom_io import read_deck
from datcom_io.drawings import draw_deck, shape_of_deck
from datcom_io.drawings.doubts import doubts_of_deck
from flightmech.errors import SchemaError

ROOT = Path(__file__).parents[3]
T37 = ROOT / "data" / "t37" / "datcom" / "t37_study.inp"
SHARED = ROOT.parent / "shared" / "data" / "datcom"
SVG = "{http://www.w3.org/2000/svg}"
DECK = """DIM M
 $FLTCON NMACH=1.0,MACH(1)=0.1,NALPHA=2.0,ALSCHD(1)=0.0,2.0$
 $SYNTHS XCG=3.0,ZCG=0.1,XW=2.5,ZW=-0.2,ALIW=3.0,XH=8.0,ZH=0.5,XV=7.5,ZV=0.3$
 $BODY NX=4.0,X(1)=0.0,2.0,6.0,9.0,R(1)=0.0,0.6,0.6,0.1,ZU(1)=0.0,0.7,0.7,0.3,
   ZL(1)=0.0,-0.5,-0.5,0.1$
 $WGPLNF CHRDR=2.0,CHRDTP=1.0,SSPN=6.0,SSPNE=5.4,SAVSI=0.0,CHSTAT=0.25,TWISTA=-2.0,
   DHDADI=5.0,TYPE=1.0$
 $HTPLNF CHRDR=1.0,CHRDTP=0.6,SSPN=2.0,SSPNE=1.9,SAVSI=0.0,CHSTAT=0.0,TYPE=1.0$
 $VTPLNF CHRDR=1.5,CHRDTP=0.8,SSPN=1.6,SSPNE=1.5,SAVSI=45.0,CHSTAT=0.0,TYPE=1.0$
 $SYMFLP FTYPE=1.0,NDELTA=1.0,DELTA(1)=5.0,SPANFI=0.2,SPANFO=1.8,CHRDFI=0.3,CHRDFO=0.2$
CASEID Trial & <error>
"""


def case_of(text):
    return read_deck(text.splitlines())[0]


def outline(shape, part, view):
    return next(o.points for o in shape.outlines if o.part == part and view in o.views)


def test_a_wing_is_where_its_cards_put_it():
    shape = shape_of_deck(case_of(DECK))
    wing = outline(shape, "wing", "top")
    # Root: apex, and the chord turned by ALIW; tip: unswept quarter chord, dihedral, twist.
    np.testing.assert_allclose(wing[0], [2.5, 0.0, -0.2])
    incidence = np.radians(3.0)
    np.testing.assert_allclose(
        wing[-1], [2.5 + 2.0 * np.cos(incidence), 0.0, -0.2 - 2.0 * np.sin(incidence)]
    )
    np.testing.assert_allclose(wing[1], [2.5 + 0.25, 6.0, -0.2 + 6.0 * np.tan(np.radians(5.0))])
    assert wing[2][2] == pytest.approx(wing[1][2] - np.sin(np.radians(1.0)))
    assert "wing: apex X 2.5, Z -0.2, span 12, chord 2 to 1, area 18" in " ".join(shape.parts)


def test_body_fin_elevator_and_centre():
    shape = shape_of_deck(case_of(DECK))
    assert outline(shape, "body", "top")[:, 1].max() == 0.6
    side = outline(shape, "body", "side")
    assert (side[:, 2].min(), side[:, 2].max()) == (-0.5, 0.7)
    fin = outline(shape, "vertical tail", "side")
    np.testing.assert_allclose(fin[0], [7.5, 0.0, 0.3])
    np.testing.assert_allclose(fin[1], [7.5 + 1.6, 0.0, 1.9])
    flap = outline(shape, "plain flap", "top")
    # Trailing edge of the tail at 0.2: 8.0 + chord 0.96, and the device 0.3 ahead of it.
    assert flap[:, 1].min() == 0.2
    assert flap[0][0] == pytest.approx(8.0 + 0.96 - 0.3)
    assert flap[3][0] == pytest.approx(8.0 + 0.96)
    assert shape.points[0].place == (3.0, 0.0, 0.1)
    assert shape.omissions == ()


def test_dihedral_of_the_outer_panel_begins_at_its_break():
    text = DECK.replace("DHDADI=5.0", "DHDADI=0.0,SSPNDD=2.0,DHDADO=10.0")
    wing = outline(shape_of_deck(case_of(text)), "wing", "front")
    assert wing[1][1] == 4.0
    assert wing[1][2] == pytest.approx(-0.2)
    assert wing[2][2] == pytest.approx(-0.2 + 2.0 * np.tan(np.radians(10.0)))


def test_a_ventral_fin_points_down_and_a_fin_without_vertup_too():
    more = " $VFPLNF CHRDR=1.0,CHRDTP=0.5,SSPN=0.7,SSPNE=0.6,SAVSI=30.0,CHSTAT=0.25,TYPE=1.0$\n"
    text = DECK.replace("CASEID", more + "CASEID").replace("XV=7.5", "XVF=7.0,ZVF=-0.2,XV=7.5")
    shape = shape_of_deck(case_of(text))
    assert outline(shape, "ventral fin", "side")[:, 2].min() == pytest.approx(-0.9)
    below = DECK.replace("ZV=0.3", "ZV=0.3,VERTUP=.FALSE.")
    fin = outline(shape_of_deck(case_of(below)), "vertical tail", "side")
    assert fin[:, 2].min() == pytest.approx(-1.3)


def test_twin_panels_propellers_and_jets():
    more = """ $TVTPAN BVP=1.0,BV=1.4,BDV=0.9,BH=4.0,SV=1.4,VPHITE=15.0,VLP=5.0,ZP=0.9$
 $JETPWR NENGSJ=2.0,JIALOC=5.0,JEALOC=7.0,JEVLOC=0.4,JELLOC=1.0,JERAD=0.3$
"""
    shape = shape_of_deck(case_of(DECK.replace("CASEID", more + "CASEID")))
    panels = [o.points for o in shape.outlines if o.part == "twin vertical panels"]
    assert [p[0][1] for p in panels] == [-2.0, 2.0]
    # Mean chord SV/BV = 1, quarter chord at XCG + VLP.
    assert panels[0][0][0] == pytest.approx(3.0 + 5.0 - 0.25)
    assert "rectangles" in shape.omissions[0]
    jets = [o for o in shape.outlines if o.part == "jet" and "top" in o.views]
    assert [o.points[:, 0].max() for o in jets] == [7.0, 7.0]
    more = " $PROPWR NENGSP=2.0,PHALOC=2.0,PHVLOC=0.1,PRPRAD=0.8,YP=2.0$\n"
    shape = shape_of_deck(case_of(DECK.replace("CASEID", more + "CASEID")))
    discs = [o.points for o in shape.outlines if o.part == "propeller"]
    assert [float(d[:, 1].max()) for d in discs] == pytest.approx([2.8, -1.2])


@pytest.mark.parametrize(
    ("old", "new", "message"),
    [
        ("XH=8.0", "XH=0.8", "horizontal tail begins at X 0.8, ahead of the wing at X 2.5"),
        ("XV=7.5", "XV=75.0", "vertical tail at X 75 to 77.4 does not touch the body, X 0 to 9"),
        ("DIM M", "DIM CM", "length of 9.9 cm is 0.099 m.*is DIM CM the unit"),
        ("SSPN=6.0", "SSPN=60.0", "is 13.3 times the length of the body"),
        ("XCG=3.0", "XCG=12.0", "XCG 12 lies beyond the body"),
        ("XW=2.5", "XW=-1.0", "wing begins at X -1, ahead of the nose"),
        ("SPANFO=1.8", "SPANFO=5.5", "SPANFO=5.5 lies beyond the tip.*flap of a wing"),
        ("ZW=-0.2", "ZW=-20.0", "wing at Z -20.1.* more than the height of the body"),
    ],
)
def test_errors_of_a_deck_are_named(old, new, message):
    case = case_of(DECK.replace(old, new))
    doubts = doubts_of_deck(case, shape_of_deck(case))
    assert any(re.search(message, text) for text in doubts), doubts
    assert "check: " in draw_deck(case)
    assert doubts_of_deck(case_of(DECK), shape_of_deck(case_of(DECK))) == []


@pytest.mark.parametrize(
    ("old", "new", "message"),
    [
        ("DIM M\n", "", "the unit: without a card DIM it is FT"),
        ("XW=2.5,", "", r"the wing: \$SYNTHS has no XW"),
        ("ZW=-0.2,", "", "ZW of the wing: drawn at 0"),
        ("SAVSI=45.0,", "", r"the vertical tail: \$VTPLNF has no SAVSI"),
        ("SPANFI=0.2,", "", r"the plain flap: \$SYMFLP has no span or chord"),
        ("R(1)=0.0,0.6,0.6,0.1,", "", "the body: .* 4 stations X with 0 R and 0 S"),
        ("XCG=3.0,", "", "XCG, the centre of gravity"),
    ],
)
def test_what_the_deck_does_not_define_is_named_and_not_drawn(old, new, message):
    case = case_of(DECK.replace(old, new))
    omissions = shape_of_deck(case).omissions
    assert any(re.search(message, text) for text in omissions), omissions
    assert "not in the deck: " in draw_deck(case)


def test_the_drawing_is_accessible_and_equal_decks_give_equal_bytes():
    case = case_of(DECK)
    svg = draw_deck(case)
    assert svg == draw_deck(case_of(DECK))
    root = ET.fromstring(svg)
    assert root.get("role") == "img"
    assert root.get("aria-labelledby") == "title description"
    assert root.find(f"{SVG}title").text == "Three-view drawing: Trial & <error>"
    assert "wing: apex X 2.5" in root.find(f"{SVG}desc").text
    groups = [group.get("id") for group in root.findall(f"{SVG}g") if group.get("id")]
    assert groups == ["top", "side", "front"]
    texts = [text.text for text in root.iter(f"{SVG}text")]
    assert "span 12 m" in texts
    assert "length 9.9 m, height 2.4 m" in texts
    # All coordinates are on the page.
    wide, high = (float(x) for x in root.get("viewBox").split()[2:])
    for polygon in root.iter(f"{SVG}polygon"):
        places = np.array([pair.split(",") for pair in polygon.get("points").split()], float)
        assert (places >= 0.0).all()
        assert (places <= [wide, high]).all()


def test_lengths_are_in_the_unit_of_the_deck_and_in_metres():
    texts = draw_deck(case_of(DECK.replace("DIM M", "DIM FT")))
    assert "span 12 ft (3.658 m)" in texts


def test_the_picture_of_the_page_is_the_drawing_of_the_deck():
    picture = ROOT / "docs" / "images" / "three-view-t37.svg"
    assert picture.read_text() == draw_deck(read_deck(T37)[0])


@pytest.mark.nightly
@pytest.mark.skipif(not SHARED.is_dir(), reason="the public decks are not here (shared data)")
def test_every_public_deck_is_drawn_or_refused_with_a_reason():
    drawn, refused = 0, []
    for file in sorted(SHARED.glob("*/*.inp")):
        for number, case in enumerate(read_deck(file), 1):
            try:
                ET.fromstring(draw_deck(case))
                drawn += 1
            except SchemaError as error:
                refused.append((file.stem, number, str(error)))
    assert drawn == 84
    assert [(name, number) for name, number, _ in refused] == [
        ("hypersonic", 2),
        ("hypersonic", 3),
        ("low_aspect_ratio", 1),
    ]
    assert "$LARWB), whose cards give areas and no outlines" in refused[-1][2]


def test_the_verb_writes_the_drawing_and_states_what_is_doubtful(tmp_path):
    deck, target = tmp_path / "a.inp", tmp_path / "a.svg"
    deck.write_text(DECK.replace("XH=8.0", "XH=0.8") + "NEXT CASE\n")
    result = CliRunner().invoke(cli, ["datcom", "draw", str(deck), "-o", str(target), "--json"])
    assert result.exit_code == 0
    content = json.loads(result.stdout)
    assert (content["case"], content["unit"]) == (1, "M")
    assert content["doubts"][0].startswith("the horizontal tail begins at X 0.8")
    assert target.read_text().startswith("<svg")
    arguments = ["datcom", "draw", str(deck), "-o", str(target), "--case", "7"]
    assert "has 1 case" in CliRunner().invoke(cli, arguments).output
