"""Footnotes, messages and the numbers in them; texts that no listing of the corpus has are those of
the program's FORMAT statements.
"""

from pathlib import Path

import numpy as np
import pytest

import datcom_io
from datcom_io.printout.layouts.notes import FOOTNOTE_WORDS
from flightmech.units import POUND_FORCE

DATA = Path(__file__).parents[3] / "data" / "t37" / "datcom"
STATIC_NOTES = {
    "shock_detached": "0ANALYSIS TERMINATED AT ALPHA= 10.0 BECAUSE LEADING EDGE SHOCK IS DETACHED.",
    "cranked_wing": "0***NOTE*** CRANKED WING ANALYSIS PERFORMED EVEN THOUGH WING HAS A LOW "
    "ASPECT RATIO.",
    "double_delta": "0***NOTE*** DOUBLE DELTA WING ANALYSIS DONE EVEN THOUGH WING HAS A HIGH "
    "ASPECT RATIO.",
    "ground_beyond_linear": (
        "0***NOTE***GROUND EFFECT ANALYSIS IS PERFORMED ACROSS THE COMPLETE ANGLE OF ATTACK "
        "RANGE EVEN THOUGH THE METHODS ARE ONLY\n"
        " APPLICABLE TO THE LINEAR LIFT REGION."
    ),
    "twin_panels_left_out": (
        "0**NOTE*LATERAL STABILITY DERIVATIVES DO NOT INCLUDE THE EFFECTS OF "
        "TWIN VERTICAL PANELS. (NO DATCOM METHODS)"
    ),
    "experimental_data": "0*NOTE* OUTPUT REFLECTS EXPERIMENTAL DATA INPUTS",
    "tail_off_body": (
        "0**NOTE*  THE HORIZONTAL TAIL LIES OFF THE BODY%  LATERAL STABILITY DERIVATIVES DO "
        "NOT INCLUDE THE EFFECTS OF THE HORIZONTAL TAIL."
    ),
    "canard": (
        "0NOTE - CANARD CONFIGURATION EFFECTIVE EPSOLN AND D(EPSOLN)/D(ALPHA) ARE AVAILABLE "
        "AS PARTIAL OUTPUT AND IN THE FACT ARRAY"
    ),
}
DYNAMIC_NOTES = {
    "tail_increments": (
        "*** BECAUSE OF A LIMITATION ON BETA*(ASPECT RATIO) FOR THE WING METHODS, ANY VALUES "
        "APPEARING ABOVE FOR,\n"
        "     CLQ, CMQ, CLAD AND CMAD ARE ONLY THE HORIZONTAL TAIL INCREMENTS."
    ),
    "tail_alphadot_increments": (
        "*** FOR CONFIGURATIONS WITH A WING TAPER RATIO OTHER THAN ZERO, ANY VALUES "
        "APPEARING ABOVE FOR,\n"
        "    CLAD AND CMAD ARE ONLY THE HORIZONTAL TAIL INCREMENTS."
    ),
    "vertical_tail_CLP": "0*** CLP CALCULATIONS ARE ONLY THE VERTICAL TAIL INCREMENTS",
}
CONTROL_NOTES = {
    "controls_ahead_of_mach_lines": (
        "0*NOTE* METHODS VALID FOR CONFIGURATIONS WITH LEADING(HINGE LINE) AND TRAILING "
        "EDGES OF THE CONTROL SURFACE "
        "SWEPT AHEAD OF THE MACH\n"
        "        LINES FROM THE DEFLECTED CONTROLS."
    ),
    "biconvex_airfoils": (
        "0*NOTE* CH(A) AND CH(D) DERIVATIVES ARE FOR STRAIGHT SIDED SYMMETRICAL BICONVEX "
        "AIRFOILS BASED ON TWICE THE AREA-MOMENT OF THE\n"
        "        CONTROL ABOUT ITS HINGE LINE."
    ),
}
MESSAGES = (
    "0ERROR-FLIGHT CONDITIONS NOT PRESENT-MISSING NAME*FLTCON*",
    "0ERROR-SYNTHESIS DATA MISSING-MISSING NAME*SYNTHS*",
    "0ERROR-WING SECTION CHARACTERISTICS PRESENT BUT PLANFORM ABSENT-MISSING NAME*WGPLNF*",
    "0MISSING PLANFORM FOR HORIZONTAL TAIL-MISSING NAME IS*HTPLNF*",
    "0MISSING SECTION CHARACTERISTICS FOR HORIZONTAL TAIL-NAME IS*HTSCHR*",
    "0ERROR-MUST HAVE VERTICAL TAIL PLANFORM WHEN V.T.PRESENT-MISSING NAME IS*VTPLNF*",
    "0THIS CASE ABORTED FOR THE ABOVE REASON(S)\n ALL NAMES REFER TO NAMELIST NAMES",
    "0 ERROR - MUST HAVE PLAIN TRAILING EDGE FLAP WHEN CONTROL TABS ARE INPUT,\n         "
    "CONTROL TAB DATA WILL NOT BE CALCULATED",
    " -ERROR--NUMBER OF NAMELISTS IN A SERIES OF SAVE CASES EXCEEDS 300",
    " ERROR TYPE CANNOT BE GREATER THAN 4.TYPE= 0.50000E+01SET TO 1.",
    "0 *** WARNING *** THIS IS A SAVE CASE AND THE DIMENSION SYSTEM HAS BEEN CHANGED",
    "0*** WARNING *** WING NOT STRAIGHT TAPERED. UNIFORM SECTION ASSUMED.",
    "0*** WARNING *** H.T. NOT STRAIGHT TAPERED. UNIFORM SECTION ASSUMED.",
    "0*** ERROR *** NO SPEED REFERENCE IS INPUT MACH(1) = VINF(1) = UNUSED\n               "
    "THE NEXT CASE WILL BE ATTEMPTED",
    "0*** ERROR *** VELOCITY IS INPUT AND ATMOSPHERIC DATA ARE NOT DEFINED (ALT(1) = PINF(1) "
    "= TINF(1) = UNUSED)\n"
    "               MACH WILL BE CALCULATED USING A SPEED-OF-SOUND OF 1000 FPS",
    "0*** ERROR *** REYNOLDS NUMBER IS NOT INPUT AND ATMOSPHERIC DATA ARE NOT DEFINED "
    "(ALT(1) = PINF(1) = TINF(1) = UNUSED)\n"
    "               REYNOLDS NUMBER WILL BE SET TO 5*10**6",
    "0*** ERROR *** LOOP = 1 AND NALT IS NOT EQUAL TO NMACH (NALT =  2, NMACH =  4)\n        "
    "       NMACH AND NALT ARE BOTH SET TO  2",
    "0*** ERROR *** LOOP =  2 AND ATMOSPHERIC DATA ARE NOT DEFINED, SET LOOP = 1",
    "0ERROR ** FLAP INBOARD SPAN, SPANI = 0.80000E-01, IT IS INSIDE THE BODY AS DEFINED BY "
    "SSPN AND SSPNE\n"
    "          SPANI IS REDEFINED, SPANI = SSPN-SSPNE = 0.80000E-01",
    "0*** WARNING - SLEQ ERRORS ***",
    (
        " ********* COMPUTATIONS IN SUBROUTINE SLOPE HAVE FAILED. ANALYSIS FOR THIS AIRFOIL "
        "IMPOSSIBLE."
    ),
    "0**** REYNOLDS NUMBER TOO LOW FOR THE AIRFOIL SECTION MODULE, SECTION CHARACTERISTICS "
    "BASED ON A VALUE OF 2.718E5 ***",
    " FLAP IS NOT EXTERNALLY BLOWN",
    "        LATERAL STABILITY DERIVATIVES ARE DELETED BECAUSE ALL OR PART OF THE HORIZONTAL "
    "TAIL EXPOSED ROOT CHORD LIES OFF OF THE\n\n"
    "        FUSELAGE. FOR THIS CASE THE NAMELIST HTPLNF PARAMETERS SHB, SEXT, AND RLPH MUST "
    "BE INPUT BY THE USER.",
    " WARNING*** BODY ALONE DYNAMIC DERIVATIVE METHOD VALID FOR NOSE CYLINDER ONLY\n         "
    "   TAIL EFFECTS IGNORED]",
    "1***** THE BODY IS NOT ADEQUATELY DEFINED *****\n IN NAMELIST BODY, ONLY THE FOLLOWING "
    "COMBINATIONS OF VARIABLES CAN BE USED\n"
    " FOR A CIRCULAR BODY, SPECIFY X AND R OR X AND S\n"
    " FOR AN ELLIPTICAL BODY, SPECIFY X AND R OR X AND S, AND THE VARIABLE ELLIP\n"
    " FOR OTHER BODY SHAPES X, R, S, AND P MUST ALL BE SPECIFIED",
)


def words(text):
    """Return a printed text as one line, without control column and blanks around it."""
    lines = [line if line.startswith("*** ") else line[1:] for line in text.split("\n")]
    return " ".join(part.strip() for part in lines if part.strip())


def with_note(lines, title, note):
    """Insert a note at the end of the first page under a title."""
    at = next(k for k, line in enumerate(lines) if line.strip() == title)
    end = next(k for k in range(at, len(lines)) if lines[k].startswith("1"))
    return [*lines[:end], *note.split("\n"), *lines[end:]]


@pytest.fixture(scope="module")
def clean_lines():
    return (DATA / "t37_clean.out").read_text().split("\n")


@pytest.fixture(scope="module")
def flap_lines():
    return (DATA / "t37_flaps.out").read_text().split("\n")


@pytest.mark.nightly
@pytest.mark.parametrize("word", STATIC_NOTES)
def test_footnote_of_a_static_page(clean_lines, word):
    listing = datcom_io.read(
        with_note(
            clean_lines, "CHARACTERISTICS AT ANGLE OF ATTACK AND IN SIDESLIP", STATIC_NOTES[word]
        )
    )
    assert listing.unread == []
    page = next(page for page in listing.pages if page.kind == "static")
    assert page.notes[-1].text == words(STATIC_NOTES[word])
    static = listing[0].to_datatree()["static"]
    assert static["notes"].values.tolist() == [word] + [""] * (static.sizes["condition"] - 1)
    assert static["notes"].attrs == {word: FOOTNOTE_WORDS[word]}


@pytest.mark.slow
@pytest.mark.parametrize("word", DYNAMIC_NOTES)
def test_footnote_of_a_dynamic_page(clean_lines, word):
    listing = datcom_io.read(with_note(clean_lines, "DYNAMIC DERIVATIVES", DYNAMIC_NOTES[word]))
    assert listing.unread == []
    page = next(page for page in listing.pages if page.kind == "dynamic")
    assert page.notes[-1].text == words(DYNAMIC_NOTES[word])
    tree = listing[0].to_datatree()
    assert tree["dynamic"]["notes"].values.tolist()[:2] == [word, ""]
    assert not any(tree["static"]["notes"].values)


@pytest.mark.parametrize("word", CONTROL_NOTES)
def test_footnote_of_a_control_page(flap_lines, word):
    listing = datcom_io.read(
        with_note(
            flap_lines, "CHARACTERISTICS OF HIGH LIFT AND CONTROL DEVICES", CONTROL_NOTES[word]
        )
    )
    assert listing.unread == []
    assert listing[0].to_datatree()["symflp"]["notes"].values.tolist()[0] == word


def test_notes_without_control_column(clean_lines):
    """A printer filter takes the first asterisk of the two notes that begin in the control
    column.
    """
    lines = with_note(clean_lines, "DYNAMIC DERIVATIVES", DYNAMIC_NOTES["tail_increments"])
    printed = []
    for line in lines:
        printed += {"1": ["\f" + line[1:]], "0": ["", line[1:]]}.get(line[:1], [line[1:]])
    listing = datcom_io.read(printed)
    assert listing.unread == []
    assert listing[0].to_datatree()["dynamic"]["notes"].values.tolist()[:2] == [
        "tail_increments",
        "",
    ]


def test_numbers_of_footnotes(clean_lines):
    note = STATIC_NOTES["shock_detached"] + "\n0**  CD0= 1.234E-02"
    case = datcom_io.read(
        with_note(clean_lines, "CHARACTERISTICS AT ANGLE OF ATTACK AND IN SIDESLIP", note)
    )[0]
    found = {
        label: value
        for _, group in case.values("note")
        for label, value in zip(group.labels, group.values)
    }
    assert found == {"ANALYSIS TERMINATED AT ALPHA": 10.0, "CD0": 0.01234}
    assert len(next(page for page in case.pages if page.kind == "static").notes) >= 2


@pytest.mark.nightly
@pytest.mark.parametrize("text", MESSAGES)
@pytest.mark.parametrize("place", ["on a page", "after a page", "behind the cards"])
def test_messages_wherever_they_stand(clean_lines, text, place):
    if place == "behind the cards":
        at = next(k for k, line in enumerate(clean_lines) if line.startswith("0 INPUT DIMENSIONS"))
    else:
        at = next(
            k
            for k, line in enumerate(clean_lines)
            if line.startswith("1") and "DYNAMIC DERIVATIVES" in clean_lines[k + 1]
        )
    before = ["1"] if place == "after a page" else []
    listing = datcom_io.read([*clean_lines[:at], *before, *text.split("\n"), *clean_lines[at:]])
    plain = datcom_io.read(clean_lines)
    assert listing.unread == []
    assert listing[0].deck.namelists == plain[0].deck.namelists
    assert [page.kind for page in listing.pages] == [page.kind for page in plain.pages]
    new = [
        message
        for message in listing[0].messages
        if message.origin == "program" and message.line in range(at + 1, at + 8)
    ]
    assert [message.text for message in new] == [words(text)]


@pytest.mark.nightly
@pytest.mark.parametrize("text", MESSAGES)
def test_messages_of_a_last_case_without_next_case(clean_lines, text):
    start = next(k for k, line in enumerate(clean_lines) if "LIST OF ALL INPUT CARDS" in line)
    at = next(k for k in range(start, len(clean_lines)) if clean_lines[k].startswith(" NEXT CASE"))
    lines = [*clean_lines[:at], *text.split("\n"), *clean_lines[at + 1 :]]
    case = datcom_io.read(lines)[0]
    assert words(text) in [message.text for message in case.messages if message.origin == "program"]
    assert case.deck.problems == ()


def test_bad_cases_keep_their_messages(corpus):
    listing = corpus("errors_missing")
    reported = {
        case.name: [message.text for message in case.messages if message.origin == "program"]
        for case in listing
    }
    assert reported["WING SECTION MISSING"] == [
        "ERROR-WING PLANFORM PRESENT BUT SECTION CHARACTERISTICS ABSENT-MISSING NAME*WGSCHR*",
        "THIS CASE ABORTED FOR THE ABOVE REASON(S) ALL NAMES REFER TO NAMELIST NAMES",
    ]
    everything = " / ".join(text for texts in reported.values() for text in texts)
    assert (
        "NO SPEED REFERENCE IS INPUT MACH(1) = VINF(1) = UNUSED THE NEXT CASE WILL BE ATTEMPTED"
        in everything
    )
    assert "UNUSED) REYNOLDS NUMBER WILL BE SET TO 5*10**6" in everything
    assert "SSPNE SPANI IS REDEFINED, SPANI = SSPN-SSPNE = 0.78000E+00" in everything
    assert listing.unread == []


def test_a_run_that_stops(corpus):
    listing = corpus("errors")
    texts = [message.text for message in listing.messages if message.origin == "program"]
    assert texts[-3:] == [
        "*** NAMELIST INPUT ERROR.  VARIABLE NAME NOT IN NAMELIST.",
        "$FLTCON NMACH=1.0,MACH(1)=0.3,NALPHA=3.0,ALSCHD(1)=0.0,2.0,4.0,BADVAR=1.0$",
        "*** EXECUTION TERMINATING DUE TO NAMELIST ERROR.",
    ]
    assert listing.unread == []


def test_experimental_data_are_reported_with_the_table(corpus):
    tree = corpus("experimental_data")[0].to_datatree()
    assert str(tree["static"]["notes"].values.ravel()[0]) == "experimental_data"


def test_ground_note_with_every_table_of_the_case(corpus):
    tree = corpus("ce500_ground")[0].to_datatree()
    assert set(tree["static"]["notes"].values.ravel().tolist()) == {"ground_beyond_linear"}
    assert set(tree["dynamic"]["notes"].values.ravel().tolist()) == {""}


def test_trim_that_ends_is_reported_with_the_table(corpus):
    found = {
        note
        for case in corpus("ce500_trim")
        for leaf in case.to_datatree().children.values()
        for note in notes_of(leaf)
    }
    assert "trim_without_wing_body_moment" in found


def notes_of(leaf):
    return leaf["notes"].values.ravel().tolist() if "notes" in leaf.coords else []


def test_weight_in_pounds(corpus):
    case = corpus("ce500_ft")[0]
    groups = [group for _, group in case.values("weight")]
    assert (groups[0].lines, groups[0].labels, groups[0].texts, groups[0].units) == (
        (260,),
        ("VEHICLE WEIGHT",),
        ("10026.00",),
        ("lbf",),
    )
    assert groups[1].values.tolist() == [0.41572]  # line 261
    notes = [note.text for page in case.pages for note in page.notes]
    assert "*** VEHICLE WEIGHT =  10026.00 LB." in notes
    leaf = case.to_datatree()["weight"]
    np.testing.assert_allclose(leaf["weight"], 10026.0 * POUND_FORCE)
    assert leaf["CL_level_flight"].values.tolist() == [0.41572, 0.12831, 0.60072, 0.18541]
    assert leaf["weight"].attrs["units"] == "N"
    assert str(leaf["lines"][0].values) == "260-261"


def test_weight_that_grows(corpus):
    case = corpus("ce500_clean")[0]
    leaf = case.to_datatree()["weight"]
    assert leaf["weight"].values[:3].tolist() == [44600.0, 198390.7, 882486.0]
    assert leaf["CL_level_flight"].values[:2].tolist() == [5.13695, 8.22611]
    flags = [datcom_io.FLAGS[code] for code in leaf["weight_flag"].values]
    assert flags == ["ok"] * 3 + ["overflow"] * 21
    assert any("divides the weight by 0.2248 again" in message.text for message in case.messages)


def test_weight_that_comes_again_on_the_trim_page_counts_once(corpus):
    case = corpus("ce500_trim")[0]
    weights = [group for _, group in case.values("weight") if group.labels == ("VEHICLE WEIGHT",)]
    leaf = case.to_datatree()["weight"]
    assert leaf.sizes["condition"] < len(weights)
    assert leaf["lines"].values[0].startswith(str(weights[0].lines[0]))
