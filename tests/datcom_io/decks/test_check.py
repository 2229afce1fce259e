from collections import Counter
from pathlib import Path

import pytest

import datcom_io
from datcom_io.decks.check import check_case

SHIPPED = Path(__file__).parents[3] / "data" / "t37" / "datcom"
CORPUS = Path(__file__).parents[3] / ".." / "shared" / "data" / "datcom"
LISTINGS = sorted(
    [
        *SHIPPED.glob("*.out"),
        *(path for path in CORPUS.glob("*/*.out") if path.parent.name != "t37"),
    ]
)

# words of the program's messages to words of our findings; its other lines belong to one of these
SAME = {
    "PLANFORM PRESENT BUT SECTION": "without section",
    "NO SPEED REFERENCE": "no speed",
    "REYNOLDS NUMBER IS NOT INPUT": "Reynolds number 5E6",
    "FLAP INBOARD SPAN": "lies inside the body",
    "VARIABLE NAME NOT IN NAMELIST": "has no variable",
    "ERROR IN CARD BELOW": "comment: ",
}
COMPANIONS = (
    "ABORTED",
    "NEXT CASE WILL BE",
    "WILL BE SET TO",
    "IS REDEFINED",
    "THIS CASE NOT RUN",
    "EXECUTION TERMINATING",
    "*A  0*B",
    "ILLEGAL",
)


def of_the_program(case):
    """Return the keys of SAME that the program printed in a case."""
    texts = [message.text for message in case.messages if message.origin == "program"]
    found = {key for key in SAME for text in texts if key in text}
    unknown = [
        text
        for text in texts
        if "ERROR" in text and not any(key in text for key in (*SAME, *COMPANIONS))
    ]
    assert not unknown
    return found, any("EXECUTION TERMINATING" in text for text in texts)


def of_ours(deck, number):
    case = deck[number]
    last = deck[number + 1].line if number + 1 < len(deck) else 10**9
    texts = [
        f.text
        for f in check_case(case)
        if f.severity == "error" or "the program prints ERROR and computes" in f.text
    ]
    texts += [
        f.text
        for f in deck.findings
        if f.severity == "error" and (number == 0 or case.line <= f.line) and f.line < last
    ]
    found = {key for key, words in SAME.items() for text in texts if words in text}
    assert all(any(words in text for words in SAME.values()) for text in texts)
    return found


@pytest.mark.nightly
@pytest.mark.parametrize("path", LISTINGS, ids=lambda path: path.name)
def test_errors_are_those_that_the_program_printed(path):
    """A deck that ran without complaint gives no error; one that did not gives the same ones, case
    by case.
    """
    deck = datcom_io.read_deck(path.with_name(path.name.split(".")[0] + ".inp"))
    listing = datcom_io.read(path)
    assert len(deck) == len(listing)
    for number, case in enumerate(listing):
        printed, stopped = of_the_program(case)
        ours = of_ours(deck, number)
        # a run that stops at a namelist cannot print what comes after
        assert printed <= ours if stopped else printed == ours


@pytest.mark.nightly
def test_the_corpus_holds_every_kind_of_error():
    if not CORPUS.is_dir():
        pytest.skip("the corpus ../shared/data/datcom is not there")
    printed = Counter(
        key for path in LISTINGS for case in datcom_io.read(path) for key in of_the_program(case)[0]
    )
    assert printed == {
        "PLANFORM PRESENT BUT SECTION": 1,
        "NO SPEED REFERENCE": 1,
        "REYNOLDS NUMBER IS NOT INPUT": 2,
        "FLAP INBOARD SPAN": 3,
        "VARIABLE NAME NOT IN NAMELIST": 1,
        "ERROR IN CARD BELOW": 1,
    }


GOOD = {
    "FLTCON": "LOOP=2.0,NMACH=2.0,MACH(1)=0.2,0.3,NALT=1.0,ALT(1)=0.0,NALPHA=3.0,ALSCHD(1)=0.0,"
    "2.0,4.0",
    "OPTINS": "SREF=24.2,CBARR=2.022,BLREF=13.36",
    "SYNTHS": "XCG=6.3,XW=5.42,XH=11.3",
    "BODY": "NX=3.0,X(1)=0.0,6.0,13.0,R(1)=0.0,0.8,0.1",
    "WGPLNF": "CHRDR=2.86,CHRDTP=0.762,SSPN=6.68,SSPNE=5.9,TYPE=1.0",
}
FLAP = (
    "FTYPE=1.0,NDELTA=2.0,DELTA(1)=0.0,10.0,SPANFI=1.0,SPANFO=3.0,CHRDFI=0.5,CHRDFO=0.4,PHETE=0.05"
)
TAIL = "CHRDR=1.5,CHRDTP=0.75,SSPN=2.9,SSPNE=2.8,TYPE=1.0"
WING_SECTION = "NACA W 4 2412"


def cards(*control, **groups):
    named = {**GOOD, **groups}
    lines = [
        line
        for name, text in named.items()
        if text is not None
        for line in f" ${name} {text}$".replace(",", ",\n   ").split("\n")
    ]
    return [*lines, WING_SECTION, *control, "NEXT CASE"]


def found(*control, lines=None, **groups):
    """Return severity and text of the findings."""
    return [
        (f.severity, f.text)
        for f in datcom_io.check_deck(datcom_io.read_deck(lines or cards(*control, **groups)))
    ]


def texts(*control, severity="error", **groups):
    return [text for level, text in found(*control, **groups) if level == severity]


def test_a_good_deck_has_no_finding():
    assert found() == []


def one(text, *control, severity="error", **groups):
    """Demand exactly one finding of a severity, with certain words."""
    assert [text in other for other in texts(*control, severity=severity, **groups)] == [True], (
        texts(*control, severity=severity, **groups)
    )


def test_names_types_and_sizes():
    one("unknown namelist $WGPLN; near it: WGPLNF", WGPLN="CHRDR=1.0")
    one(
        "$OPTINS has no variable CBAR; near it: CBARR",
        OPTINS="SREF=1.0,CBAR=1.0,CBARR=1.0,BLREF=1.0",
    )
    one(
        "$OPTINS: SREF is given up to place 2; it holds one value",
        OPTINS="SREF=1.0,2.0,CBARR=1.0,BLREF=1.0",
    )
    one("$SYNTHS: XCG must be a number", SYNTHS="XCG=.TRUE.")
    one("$SYNTHS: VERTUP must be .TRUE. or .FALSE.", SYNTHS="XCG=1.0,VERTUP=1.0")
    assert "$BODY: X is given up to place 21; it holds 20 values, it stops the program" in texts(
        BODY="NX=3.0,X(20)=1.0,2.0,R(1)=3*1.0"
    )


def test_control_cards():
    one("DIM MM: allowed are FT, IN, M, CM", "DIM MM")
    one("surface 'X' in column 6; allowed are W wing", "NACA X 4 2412")
    one("type '7' in column 8; allowed are 1, 4, 5, 6, S", "NACA W 7 2412")
    one("no designation from column 10", "NACA W 4")
    assert found("NACA-W-4-2412") == []


def test_counts():
    flight = "LOOP=2.0,NALT=1.0,ALT(1)=0.0,NALPHA=3.0,ALSCHD(1)=0.0,2.0,4.0"
    one("MACH has 2 values, NMACH=3", FLTCON=f"{flight},NMACH=3.0,MACH(1)=0.2,0.3")
    one("NMACH is not given, MACH is", FLTCON=f"{flight},MACH(1)=0.2,0.3")
    one(
        "NMACH=21; allowed are whole numbers from 1 to 20",
        FLTCON=f"{flight},NMACH=21.0,MACH(1)=0.2",
    )
    one("NMACH=1.5; allowed are whole numbers", FLTCON=f"{flight},NMACH=1.5,MACH(1)=0.2,0.3")
    one("MACH has no value at place 2", FLTCON=f"{flight},NMACH=3.0,MACH(1)=0.2,MACH(3)=0.4")
    one(
        "MACH has 3 values, NMACH=2; the rest is not used",
        severity="note",
        FLTCON=f"{flight},NMACH=2.0,MACH(1)=0.2,0.3,0.4",
    )
    one("NX=21; allowed are whole numbers from 1 to 20", BODY="NX=21.0,X(1)=0.0,1.0,R(1)=0.0,1.0")
    one(
        "CPRMEI has 1 values, NDELTA=2",
        severity="warning",
        SYMFLP=f"{FLAP},CPRMEI(1)=2.0",
        FLTCON=ONE_CONDITION,
    )
    few = "LOOP=2.0,NMACH=1.0,MACH(1)=0.3,NALT=1.0,ALT(1)=0.0,NALPHA=3.0,ALSCHD(1)=0.0,2.0"
    one(
        "ALSCHD has 2 values, NALPHA=3; the program takes the missing ones as 1E-30, prints NDM",
        severity="warning",
        FLTCON=few,
    )
    one("NGH=11; allowed are whole numbers from 1 to 10", GRNDEF="NGH=11.0,GRDHT(1)=2.0,3.0")


ONE_CONDITION = (
    "LOOP=2.0,NMACH=1.0,MACH(1)=0.2,NALT=1.0,ALT(1)=0.0,NALPHA=3.0,ALSCHD(1)=0.0,2.0,4.0"
)
ANGLES = "NALPHA=2.0,ALSCHD(1)=0.0,2.0"


def test_flight_conditions():
    one(
        "no speed, neither MACH nor VINF", FLTCON=f"LOOP=2.0,NMACH=1.0,NALT=1.0,ALT(1)=0.0,{ANGLES}"
    )
    one("no angles of attack", FLTCON="LOOP=2.0,NMACH=1.0,MACH(1)=0.2,NALT=1.0,ALT(1)=0.0")
    assert any(
        "LOOP=2 and no NALT" in text
        for text in texts(FLTCON=f"LOOP=2.0,NMACH=1.0,MACH(1)=0.2,ALT(1)=0.0,{ANGLES}")
    )
    one(
        "LOOP=7; allowed are 1, 2, 3",
        severity="warning",
        FLTCON=f"LOOP=7.0,NMACH=1.0,MACH(1)=0.2,NALT=1.0,ALT(1)=0.0,{ANGLES}",
    )
    one(
        "LOOP=1, NMACH=2 and NALT=1",
        FLTCON=f"NMACH=2.0,MACH(1)=0.2,0.3,NALT=1.0,ALT(1)=0.0,{ANGLES}",
    )
    one("the Reynolds number 5E6", FLTCON=f"NMACH=1.0,MACH(1)=0.2,{ANGLES}")
    assert found(FLTCON=f"NMACH=1.0,MACH(1)=0.2,RNNUB(1)=5.0E6,{ANGLES}") == []
    assert (
        found(FLTCON=f"NMACH=1.0,MACH(1)=0.2,NALT=1.0,PINF(1)=2116.0,TINF(1)=518.0,{ANGLES}") == []
    )
    one(
        "LOOP=2 without atmosphere",
        FLTCON=f"LOOP=2.0,NMACH=1.0,MACH(1)=0.2,NALT=1.0,RNNUB(1)=5.0E6,{ANGLES}",
    )
    one(
        "ALT and PINF with TINF",
        severity="warning",
        FLTCON=f"NMACH=1.0,MACH(1)=0.2,NALT=1.0,ALT(1)=0.0,PINF(1)=2116.0,TINF(1)=518.0,{ANGLES}",
    )
    one(
        "MACH and VINF",
        severity="warning",
        FLTCON=f"NMACH=1.0,MACH(1)=0.2,VINF(1)=200.0,NALT=1.0,ALT(1)=0.0,{ANGLES}",
    )
    one(
        "VINF with a NACA card: some builds hang",
        FLTCON=f"NMACH=1.0,VINF(1)=200.0,NALT=1.0,ALT(1)=0.0,{ANGLES}",
    )
    assert any(
        "1000 ft/s" in text
        for text in texts(FLTCON=f"NMACH=1.0,VINF(1)=200.0,RNNUB(1)=5.0E6,{ANGLES}")
    )
    one(
        "do not rise: 2 is followed by 2",
        FLTCON="NMACH=1.0,MACH(1)=0.2,NALT=1.0,ALT(1)=0.0,NALPHA=3.0,ALSCHD(1)=0.0,2.0,2.0",
    )
    one(
        "STMACH=0.5; allowed is 0.6 ... 0.99",
        severity="warning",
        FLTCON=f"{ONE_CONDITION},STMACH=0.5",
    )
    one(
        "TSMACH=1.5; allowed is 1.01 ... 1.4",
        severity="warning",
        FLTCON=f"{ONE_CONDITION},TSMACH=1.5",
    )


def test_namelists_that_need_each_other():
    one("no $FLTCON (flight conditions); the program leaves the case out", FLTCON=None)
    one("no $SYNTHS", SYNTHS=None)
    one("$HTPLNF without section: neither $HTSCHR nor a NACA H card", HTPLNF=TAIL)
    one("$VTPLNF without section", severity="warning", VTPLNF=TAIL)
    one("a section for the vertical tail without $VTPLNF", "NACA V 4 0012")
    one("a section for the ventral fin without $VFPLNF", "NACA F 4 0012", severity="warning")
    one("$CONTAB needs $SYMFLP with FTYPE=1.0", CONTAB="TTYPE=1.0")
    one("a case without any namelist", lines=["DAMP", "NEXT CASE"])


def test_special_cases_need_no_aircraft():
    jet = [
        " $FLTCON NMACH=1.0,MACH(1)=8.0,RNNUB(1)=1.0E6,NALPHA=1.0,ALSCHD(1)=0.0$",
        " $TRNJET NT=1.0,TIME(1)=0.0,FC(1)=1.0$",
    ]
    assert found(lines=jet) == []


def test_aircraft():
    one("of R, S and P there is R, S", BODY="NX=2.0,X(1)=0.0,6.0,R(1)=0.0,0.8,S(1)=0.0,1.0")
    one("no stations X", BODY="NX=2.0,R(1)=0.0,0.8")
    one("TYPE=5; allowed is 1 ... 4", WGPLNF="CHRDR=2.86,SSPN=6.68,SSPNE=5.9,TYPE=5.0")
    one("CBARR, BLREF not given", severity="warning", OPTINS="SREF=1.0")
    one("SREF, CBARR, BLREF not given", severity="warning", OPTINS=None)
    one("WT with DIM M", "DIM M", severity="warning", FLTCON=f"{ONE_CONDITION},WT=100.0")


def test_devices():
    flap = {"SYMFLP": FLAP, "FLTCON": ONE_CONDITION}
    assert found(**flap) == []
    one(
        "SYMFLP and ASYFLP in one case: the program drops the first",
        **flap,
        ASYFLP="STYPE=4.0,SPANFI=1.0,SPANFO=2.0",
    )
    one("SYMFLP and HYPEFF in one case", **flap, HYPEFF="XHL=1.0")
    one(
        "SPANFI=0.1 lies inside the body",
        severity="warning",
        SYMFLP=FLAP.replace("SPANFI=1.0", "SPANFI=0.1"),
        FLTCON=ONE_CONDITION,
    )
    one(
        "SPANFO=9 lies beyond the tip",
        severity="warning",
        SYMFLP=FLAP.replace("SPANFO=3.0", "SPANFO=9.0"),
        FLTCON=ONE_CONDITION,
    )
    # the only finding: none on the span
    one(
        "STYPE=5 deflects the halves of",
        severity="warning",
        ASYFLP="STYPE=5.0",
        FLTCON=ONE_CONDITION,
    )
    tail = {"HTPLNF": TAIL, **flap}
    one(
        "with a wing and a horizontal tail the program puts the device on the tail",
        "NACA H 4 0012",
        severity="warning",
        **tail,
    )
    # The program computes an aileron on the wing, with or without a tail (run: the same roll moment
    # of -0.035328 for SPANFO beyond the tip of the tail), and tests SPANFI at the tail.
    aileron = {"FLTCON": ONE_CONDITION, "HTPLNF": TAIL}
    span = "STYPE=4.0,NDELTA=1.0,DELTAL(1)=5.0,DELTAR(1)=-5.0,CHRDFI=0.2,CHRDFO=0.2"
    good = found("NACA H 4 0012", **aileron, ASYFLP=f"{span},SPANFI=3.5,SPANFO=6.5")
    assert good == []
    for inner, words in (
        (0.01, "of $HTPLNF; the program prints ERROR"),
        (0.5, "of $WGPLNF; the program does not notice it"),
    ):
        one(
            words,
            "NACA H 4 0012",
            severity="warning",
            **aileron,
            ASYFLP=f"{span},SPANFI={inner},SPANFO=6.5",
        )
    one("TRIM without device", "TRIM", severity="warning")
    one("TRIM with $ASYFLP", "TRIM", severity="warning", ASYFLP="STYPE=4.0,SPANFI=1.0,SPANFO=2.0")
    assert found("TRIM", **flap) == []
    one("at 2 flight conditions of one run", severity="warning", SYMFLP=FLAP)
    twice = [*cards(**flap)[:-1], f" $SYMFLP {FLAP}$", "NEXT CASE"]
    one("$SYMFLP 2 times in one case", severity="warning", lines=twice)


def test_ground():
    ground = {"GRNDEF": "NGH=2.0,GRDHT(1)=2.0,3.0", "FLTCON": ONE_CONDITION, "HTPLNF": TAIL}
    flap = FLAP.replace("SPANFO=3.0", "SPANFO=2.5")
    one(
        "the heights are printed 2 times with identical headings",
        "NACA H 4 0012",
        severity="warning",
        SYMFLP=flap,
        **ground,
    )
    one(
        "the program prints ground heights in feet",
        "NACA H 4 0012",
        "DIM M",
        severity="warning",
        **ground,
    )


def test_deflections_over_ground():
    """The program adds the ground effect of each deflection to those after it."""
    wing = {"GRNDEF": "NGH=2.0,GRDHT(1)=2.0,3.0", "FLTCON": ONE_CONDITION}
    one(
        "but the first holds the ground effect of those before; make one deck per deflection",
        severity="warning",
        SYMFLP=FLAP,
        **wing,
    )
    alone = FLAP.replace("NDELTA=2.0,DELTA(1)=0.0,10.0", "NDELTA=1.0,DELTA(1)=10.0")
    assert found(SYMFLP=alone, **wing) == []
    aileron = "STYPE=4.0,NDELTA=2.0,DELTAL(1)=5.0,10.0,DELTAR(1)=-5.0,-10.0,SPANFI=1.0,SPANFO=2.0"
    one(
        "2 deflections of $ASYFLP: the heights are printed 2 times with identical headings",
        severity="warning",
        ASYFLP=aileron,
        **wing,
    )


def test_no_damping_is_reported_once_for_a_run():
    tail = {"HTPLNF": TAIL, "FLTCON": ONE_CONDITION}
    one(
        "no DAMP card: the program prints no derivatives with q, alpha dot, p and r",
        "NACA H 4 0012",
        severity="warning",
        **tail,
    )
    assert found("NACA H 4 0012", "DAMP", **tail) == []
    whole = cards("NACA H 4 0012", **tail)
    assert (
        len([text for text in texts(lines=[*whole, *whole], severity="warning") if "DAMP" in text])
        == 1
    )
    assert [
        text
        for text in texts("NACA H 4 0012", severity="warning", SYMFLP=FLAP, **tail)
        if "DAMP" in text
    ] == []  # a device: its derivatives are static


def test_a_series_of_saved_cases_too_long_to_replay():
    lines = []
    for _ in range(60):
        lines += [*cards()[:-1], "SAVE", "NEXT CASE"]
    assert next(text for text in texts(lines=lines[:-2]) if "series" in text).startswith(
        "300 namelists and NACA cards in a series of SAVE cases"
    )


def test_another_unit_behind_save():
    lines = [*cards()[:-1], "SAVE", "NEXT CASE", "DIM M", "NEXT CASE"]
    words = "DIM M behind SAVE of a case in FT"
    assert [text for _, text in found(lines=lines) if words in text]
    assert not [text for _, text in found(lines=[*lines[:-2], "DIM FT"]) if "behind" in text]


def test_save_before_the_last_next_case():
    one("the program runs the saved case once more", "SAVE", severity="warning")
    assert found(lines=[*cards()[:-1], "SAVE"]) == []


def test_findings_come_by_line_and_from_a_file(tmp_path):
    path = tmp_path / "deck.inp"
    path.write_text("* COMMENT\n" + "\n".join(cards(OPTINS="SREF=1", BODY="R(1)=0.0,0.8")) + "\n")
    result = datcom_io.check_deck(path)
    assert [(f.line, f.severity) for f in result] == [
        (1, "error"),
        (12, "warning"),
        (12, "warning"),
        (16, "error"),
        (16, "error"),
    ]
    assert datcom_io.check_deck(datcom_io.read_deck(path)[0]) == [f for f in result if f.line != 1]
