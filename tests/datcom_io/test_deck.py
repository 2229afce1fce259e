import math

from datcom_io.deck import parse_cards


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
        "DIM M\nDERIV RAD\n $OPTINS SREF=1.0,CBARR=2.0$\n $SYMFLP NDELTA=1.0,DELTA(1)=5.0$\nNACA W 4 2415\nCASEID ONE\nSAVE\nNEXT CASE"
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
    assert deck(cards % "2.0").conditions() == [(0.2, 0.0), (0.3, 0.0), (0.2, 1000.0), (0.3, 1000.0)]
    assert deck(cards % "3.0").conditions() == [(0.2, 0.0), (0.2, 1000.0), (0.3, 0.0), (0.3, 1000.0)]


def test_regime_takes_the_limits_of_the_deck():
    assert [deck("").regime(mach) for mach in (0.6, 0.61, 1.4)] == ["subsonic", "transonic", "supersonic"]
    assert deck(" $FLTCON STMACH=0.8,TSMACH=1.1$").regime(0.8) == "subsonic"


def test_faults_are_told_by_line():
    found = deck("* A COMMENT\n $FLTCON MACH(1)=0.2,ABC,0.3,WT=1.0\n  $\n $BODY X(9999)=1.0$\n $WGPLNF SSPN=1.0")
    assert found.problems == (
        (1, "not a control card: * A COMMENT"),
        (2, "$FLTCON: MACH has the value 'ABC', which is no number"),
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
