import math

from datcom_io.decks.deck import parse_cards


def deck(text, before=None):
    return parse_cards(list(enumerate(text.strip("\n").split("\n"), 1)), before)


def test_namelists_over_several_cards():
    found = deck(
        """
DIM M
 $FLTCON NMACH=2.0,MACH(1)=0.2,
   0.3,NALPHA=3.0,ALSCHD(1)=-2.0,0.0,
   2.0,HYPERS=.TRUE.$
 $OPTINS SREF=24.2, CBARR = 2.022 $
CASEID A CASE, 100 $ OF TEXT
DAMP
NEXT CASE
"""
    )
    assert found.values("FLTCON", "MACH") == [0.2, 0.3]
    assert found.schedule("FLTCON", "ALSCHD", "NALPHA") == [-2.0, 0.0, 2.0]
    assert found.namelists["FLTCON"]["HYPERS"] == [True]
    assert found.value("OPTINS", "CBARR") == 2.022
    assert (found.caseid, found.dim, found.deriv) == ("A CASE, 100 $ OF TEXT", "M", "DEG")
    assert found.has("DAMP")
    assert not found.problems


def test_index_repeat_and_overwrite():
    found = deck(" $SYMFLP DELTA(2)=3*2.5,DELTA(1)=-1.0,NDELTA=4.0$\n $SYMFLP DELTA(4)=9.0$")
    assert found.schedule("SYMFLP", "DELTA", "NDELTA") == [-1.0, 2.5, 2.5, 9.0]


def test_an_index_left_out_is_not_a_number():
    first, second = deck(" $GRNDEF GRDHT(2)=5.0$").values("GRNDEF", "GRDHT")
    assert math.isnan(first)
    assert second == 5.0


def test_alpha_is_another_spelling_of_alschd():
    assert deck(" $FLTCON ALPHA(1)=1.0,2.0$").values("FLTCON", "ALSCHD") == [1.0, 2.0]


def test_save_keeps_namelists_and_units_and_a_new_device_replaces_the_other():
    first = deck(
        "DIM M\nDERIV RAD\n $OPTINS SREF=1.0,CBARR=2.0$\n $SYMFLP "
        "NDELTA=1.0,DELTA(1)=5.0$\nNACA W 4 2415\nCASEID ONE\nSAVE\nNEXT CASE"
    )
    second = deck(" $OPTINS SREF=3.0$\n $ASYFLP NDELTA=1.0,DELTAL(1)=5.0$\nNEXT CASE", first)
    assert second.value("OPTINS", "SREF") == 3.0
    assert second.value("OPTINS", "CBARR") == 2.0
    assert "SYMFLP" not in second.namelists
    assert second.caseid == ""
    assert (second.dim, second.deriv) == ("M", "RAD")
    assert [card.text for card in second.cards if card.name == "NACA"] == ["W 4 2415"]
    assert first.value("OPTINS", "SREF") == 1.0


def test_without_save_only_units_last():
    first = deck("DIM CM\n $OPTINS SREF=1.0$\nNEXT CASE")
    second = deck("NEXT CASE", first)
    assert second.dim == "CM"
    assert second.namelists == {}


def test_loop_orders_the_conditions():
    cards = " $FLTCON LOOP=%s,NMACH=2.0,MACH(1)=0.2,0.3,NALT=2.0,ALT(1)=0.0,1000.0$"
    assert deck(cards % "1.0").conditions() == [(0.2, 0.0), (0.3, 1000.0)]
    assert deck(cards % "2.0").conditions() == [
        (0.2, 0.0),
        (0.3, 0.0),
        (0.2, 1000.0),
        (0.3, 1000.0),
    ]
    assert deck(cards % "3.0").conditions() == [
        (0.2, 0.0),
        (0.2, 1000.0),
        (0.3, 0.0),
        (0.3, 1000.0),
    ]


def test_regime_takes_the_limits_of_the_deck():
    assert [deck("").regime(mach) for mach in (0.6, 0.61, 1.4)] == [
        "subsonic",
        "transonic",
        "supersonic",
    ]
    assert deck(" $FLTCON STMACH=0.8,TSMACH=1.1$").regime(0.8) == "subsonic"


def test_faults_are_reported_by_line():
    found = deck(
        "* A COMMENT\n $FLTCON MACH(1)=0.2,ABC,0.3,WT=1.0\n  $\n $BODY X(9999)=1.0$\n "
        "$WGPLNF SSPN=1.0"
    )
    assert found.problems == (
        (1, "not a control card: * A COMMENT"),
        (2, "$FLTCON: MACH has the value 'ABC', which is not a number"),
        (4, "$BODY: X(9999) holds 1 values; an array has at most 300"),
    )
    assert found.findings[-1] == (
        5,
        "warning",
        "namelist without closing $: WGPLNF; the program adds it in some places only: write it",
    )
    assert found.values("FLTCON", "MACH") == [0.2, 0.3]


def test_a_variable_without_value_is_not_given():
    found = deck(" $BODY DS=,BLN=2.0$")
    assert found.value("BODY", "DS") is None
    assert found.value("BODY", "BLN") == 2.0


def test_a_jet_comes_back_as_it_was_when_the_propeller_goes():
    """The program keeps the values of a power namelist that another one only hides."""
    first = deck(" $JETPWR AIETLJ=2.0,NENGSJ=1.0$\nSAVE\nNEXT CASE")
    second = deck(" $PROPWR AIETLP=3.0$\nSAVE\nNEXT CASE", first)
    third = deck(" $JETPWR AIETLJ=4.0$\nNEXT CASE", second)
    assert "JETPWR" not in second.namelists
    assert third.namelists == {"JETPWR": {"AIETLJ": [4.0], "NENGSJ": [1.0]}}


def test_a_flap_replaced_within_a_case_is_gone():
    found = deck(" $SYMFLP NDELTA=1.0,PHETE=0.05$\n $ASYFLP NDELTA=2.0$\n $SYMFLP NDELTA=3.0$")
    assert found.namelists == {"SYMFLP": {"NDELTA": [3.0]}}


def test_spellings_belong_to_their_namelist():
    found = deck(" $TRNJET ALPHA(1)=1.0$\n $WGSCHR CM0=0.1,CLAM0=0.2,CM0T=0.3,ALPHA0=0.4$")
    assert found.namelists["TRNJET"] == {"ALPHA": [1.0]}
    assert found.namelists["WGSCHR"] == {
        "CMO": [0.1],
        "CLAMO": [0.2],
        "CMOT": [0.3],
        "ALPHAO": [0.4],
    }


def test_control_cards_are_known_by_their_first_columns():
    found = deck("NACA-W-4-2412\nCASEIDABC\nPRINT EXTRAP\nDUMP A,B\nPLOTTED\nDIM CM\nDERIV RAD")
    assert [(card.name, card.text) for card in found.cards] == [
        ("NACA", "W-4-2412"),
        ("CASEID", "ABC"),
        ("PRINT", "EXTRAP"),
        ("DUMP", "A,B"),
        ("PLOT", "TED"),
        ("DIM", "CM"),
        ("DERIV", "RAD"),
    ]
    assert found.sections == {"W": "4 2412"}
    assert (found.dim, found.deriv) == ("CM", "RAD")
    assert not found.findings


def test_a_namelist_ends_where_the_next_begins():
    found = deck(
        " $FLTCON NMACH=1.0,\n   MACH(1)=0.3\n $OPTINS SREF=2.0\n $END\n $BODY NX=1.0$ $END"
    )
    assert found.namelists == {
        "FLTCON": {"NMACH": [1.0], "MACH": [0.3]},
        "OPTINS": {"SREF": [2.0]},
        "BODY": {"NX": [1.0]},
    }
    assert [finding.line for finding in found.findings] == [1]


def test_lines_are_remembered():
    first = deck(" $FLTCON NMACH=1.0,\n   MACH(1)=0.3$\nSAVE\nNEXT CASE")
    second = deck(" $OPTINS SREF=2.0$", first)
    assert (
        second.line_of("FLTCON", "MACH"),
        second.line_of("FLTCON"),
        second.line_of("OPTINS", "CBARR"),
    ) == (2, 1, 1)


def findings(text):
    return [tuple(finding) for finding in deck(text).findings]


def test_what_the_program_stumbles_over_in_a_namelist():
    assert findings(" $FLTCON MACH(1)=0.2 NALPHA=3.0$") == [
        (1, "error", "$FLTCON: no comma before NALPHA; it stops the program")
    ]
    assert findings(" $FLTCON MACH(1)=0.2,,0.3$") == [
        (1, "error", "$FLTCON: an empty place between commas; every value must be written")
    ]
    assert findings(" $BODY DS=,BLN=2.0$") == [
        (1, "error", "$BODY: DS has no value on its card; write it behind the =")
    ]
    assert findings(" $BODY 2.0,BLN=2.0$") == [
        (1, "error", "$BODY: 2.0 stands before any variable")
    ]
    assert findings(" $BODY BLN=2$") == [
        (
            1,
            "warning",
            "$BODY: BLN has the value 2 without a point; the program uses it and flags a "
            "syntax error",
        )
    ]
    assert (
        findings(" $BODY BLN=2.0D1$")[0][2]
        == "$BODY: BLN has the value 2.0D1; the program reads only E exponents in upper case"
    )
    assert (
        findings(" $SYNTHS VERTUP=T$")[0][2]
        == "$SYNTHS: VERTUP has the value T; the program knows .TRUE. and .FALSE. with both points"
    )
    assert findings(" $BODY BLN=1.12345678901$")[0][2].startswith(
        "$BODY: BLN has the value 1.12345678901: too many digits"
    )
    assert findings(" $BODY BLN=1 .5$")[0][1:] == (
        "warning",
        "$BODY: BLN has the value '1 .5' with a blank in it",
    )
    assert (
        findings(" $BODY X(1)=0*1.0$")[0][2]
        == "$BODY: X has the repeat count 0; allowed is 1 ... 300"
    )


def test_what_the_program_stumbles_over_in_columns():
    assert findings("  $BODY BLN=2.0$") == [
        (1, "error", "$ stands in column 3: the program looks for it in column 2 only")
    ]
    assert findings(" $BODY BLN=2.0\n $")[0][2].startswith(
        "a $ alone in column 2: the program takes it for a new namelist"
    )
    assert findings(" $BODY BLN=2.0,\nX(1)=0.0$") == [
        (
            2,
            "error",
            "a namelist goes on in column 1: the program takes it for a control card; leave "
            "column 1 blank",
        )
    ]
    assert findings(" DAMP") == [
        (1, "error", "DAMP does not start in column 1: the program overlooks it; move it there")
    ]
    assert findings(" BLN=2.0") == [
        (1, "error", "belongs to no namelist: BLN=2.0; open one with $NAME")
    ]
    assert findings(" $ BODY BLN=2.0$") == [
        (1, "error", "no name follows $; write $NAME without a blank between")
    ]
    assert findings(" $BODY BLN=2.0$ $OPTINS SREF=1.0$")[0][1:] == (
        "error",
        "after the closing $: $OPTINS SREF=1.0$; the program does not read it: put it on a "
        "card of its own",
    )
    assert (
        findings(" &BODY BLN=2.0 &END\n $OPTINS SREF=1.0$")[0][2]
        == "&BODY: & opens no namelist in this program, which ignores it; write $"
    )
    assert findings(" $BODY BLN=2.0,\nNACA W 4 2412\n BLA=1.0$")[0][2] == (
        "NACA card inside namelist $BODY: it stops the program; close the namelist with $ first"
    )
    assert (
        findings("DERIV  RAD")[0][2]
        == "DERIV RAD: allowed are DERIV DEG and DERIV RAD, with one blank"
    )
    assert (
        findings("DIM  M")[0][2]
        == "the unit of a DIM card stands in columns 5-6; write DIM and one blank"
    )
    assert findings("next case\n $body bln=2.0$") == [
        (
            1,
            "error",
            "lower case: the program knows upper case only; write the deck with write_deck",
        ),
        (
            2,
            "error",
            "lower case: the program knows upper case only; write the deck with write_deck",
        ),
    ]


def test_an_ampersand_group_is_left_out():
    assert deck(" &BODY BLN=2.0 &END\n $OPTINS SREF=1.0$").namelists == {"OPTINS": {"SREF": [1.0]}}


def test_numbers_at_the_edge_of_the_program():
    assert findings(" $BODY BLN=1.0E99$") == [
        (1, "error", "$BODY: BLN has the value 1.0E99, which is too large")
    ]
    assert findings(f" $BODY BLN={'9' * 5000}.0$")[0][2].endswith("9..., which is too large")
    assert deck(" $BODY BLN=0.00000000002147483647$").findings == ()
    assert "too many digits" in findings(" $BODY BLN=0.2147483648$")[0][2]


def test_control_cards_inside_a_namelist_do_not_end_it():
    found = deck(" $BODY BLN=2.0,\nDAMP\n   BLA=3.0$\nCASEID X\nNEXT CASE")
    assert found.namelists == {"BODY": {"BLN": [2.0], "BLA": [3.0]}}
    assert [item.name for item in found.items] == ["BODY", "DAMP", "CASEID", "NEXT"]


def test_a_card_of_any_length_is_read():
    """Quadratic time would make this test hang for minutes."""
    texts = [
        deck(" $BODY X=" + piece * 100_000 + "$").findings[0].text
        for piece in ("1.0,", "A ( ", "A  ", "1 ")
    ]
    assert texts[0] == "$BODY: X(1) holds 100000 values; an array has at most 300"
    assert all(
        "not a number" in text or "a blank in it" in text or "too large" in text
        for text in texts[1:]
    )
