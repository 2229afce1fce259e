import re
from pathlib import Path

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

import datcom_io
from datcom_io.decks.cards import Card, Namelist, NamelistAssignment
from datcom_io.decks.deck import make_deck
from datcom_io.decks.deck_file import deck_text
from datcom_io.decks.namelists import VARIABLES, format_namelist_value
from flightmech.errors import ParseError, SchemaError

SHIPPED = Path(__file__).parents[3] / "data" / "t37" / "datcom"
CORPUS = Path(__file__).parents[3] / ".." / "shared" / "data" / "datcom"
DECKS = sorted(
    [
        *SHIPPED.glob("*.inp"),
        *(path for path in CORPUS.glob("*/*.inp") if path.parent.name != "t37"),
    ]
)
LISTINGS = sorted(
    [
        *SHIPPED.glob("*.out"),
        *(path for path in CORPUS.glob("*/*.out") if path.parent.name != "t37"),
    ]
)


def meanings(deck):
    return [case.meaning() for case in deck]


def again(deck, **options):
    return datcom_io.read_deck(deck_text(deck, **options).split("\n")[:-1])


def test_the_shipped_decks_are_there():
    assert len(DECKS) >= 10


@pytest.mark.nightly
@pytest.mark.parametrize("path", DECKS, ids=lambda path: path.name)
@pytest.mark.parametrize("resolved", [False, True])
def test_a_deck_written_again_is_equal_in_meaning(path, resolved, tmp_path):
    deck = datcom_io.read_deck(path)
    datcom_io.write_deck(deck, tmp_path / "again.inp", resolved=resolved)
    found = datcom_io.read_deck(tmp_path / "again.inp")
    assert meanings(found) == meanings(deck)
    assert not any(
        case.findings for case in found if "BADVAR" not in case.namelists.get("FLTCON", {})
    )
    lines = (tmp_path / "again.inp").read_text(encoding="latin-1").split("\n")
    assert max(map(len, lines)) <= 80
    if resolved:
        assert not any(case.has("SAVE") for case in found)


@pytest.mark.nightly
@pytest.mark.parametrize("path", LISTINGS, ids=lambda path: path.name)
def test_the_cards_in_a_listing_are_those_of_its_deck(path):
    """The program echoes the cards of each case; the reader of listings replays SAVE as the reader
    of decks does.
    """
    deck = datcom_io.read_deck(path.with_name(path.name.split(".")[0] + ".inp"))
    assert [case.deck.meaning() for case in datcom_io.read(path)] == meanings(deck)


def test_datcom_plus_is_read_and_reported():
    deck = datcom_io.read_deck(
        [
            "* The wing",
            "# and more",
            "DIM FT ! feet",
            "",
            "\t$FLTCON NMACH=1.0, ! one",
            "   MACH(1)=0.3, NALPHA=3.0, ALSCHD(1)=-2.0, 0.0, 2.0, NALT=1.0, ALT(1)=1000.0, "
            "STMACH=0.8, TSMACH=1.2$",
            "CASEID Wow! It flies",
        ]
    )
    assert deck[0].values("FLTCON", "ALSCHD") == [-2.0, 0.0, 2.0]
    assert deck[0].value("FLTCON", "TSMACH") == 1.2
    assert deck[0].caseid == "Wow! It flies"
    assert deck.comments == ((1, "The wing"), (2, "and more"), (3, "feet"), (5, "one"))
    assert [
        (finding.line, finding.severity, finding.text.split(":")[0]) for finding in deck.findings
    ] == [
        (1, "error", "comment"),
        (2, "error", "comment"),
        (3, "error", "comment"),
        (4, "warning", "blank line"),
        (5, "error", "tab"),
        (5, "error", "comment"),
        (6, "error", "102 columns"),
    ]
    assert datcom_io.check_deck(again(deck)) == [
        f for f in datcom_io.check_deck(again(deck)) if not f.text.startswith(("comment", "tab"))
    ]


def test_cases_and_what_follows_the_last():
    deck = datcom_io.read_deck(
        [" $BODY NX=1.0$", "SAVE", "NEXT CASE", " $OPTINS SREF=1.0$", "NEXT CASE", "DAMP"]
    )
    assert [list(case.namelists) for case in deck] == [["BODY"], ["BODY", "OPTINS"]]
    assert len(deck) == 2
    assert deck.findings == (
        (
            6,
            "warning",
            "cards after the last NEXT CASE without a namelist: the program does not run them",
        ),
    )


@pytest.mark.parametrize(
    ("lines", "found"), [([], "an empty file"), (["", "* NOTHING"], "no card")]
)
def test_a_file_without_cards_is_refused(lines, found):
    with pytest.raises(ParseError, match=f"found {found}; expected an input deck"):
        datcom_io.read_deck(lines)


def test_a_dos_file_with_its_marks(tmp_path):
    path = tmp_path / "dos.inp"
    path.write_bytes(b"\xef\xbb\xbfDIM M\r\n $BODY NX=1.0$\r\nCASEID \xe9t\xe9\r\n\x1a")
    deck = datcom_io.read_deck(path)
    assert (deck[0].dim, deck[0].caseid, deck.file) == ("M", "été", "dos.inp")
    datcom_io.write_deck(deck, path)
    assert datcom_io.read_deck(path)[0].caseid == "été"


def test_a_long_caseid_is_cut_as_the_program_cuts_it():
    deck = datcom_io.read_deck([" $BODY NX=1.0$", "CASEID " + "X" * 90])
    assert deck[0].caseid == "X" * 74
    assert deck[0].findings[0].text == "CASEID of 90 characters: the program keeps 74"


def test_gaps_and_long_lists_are_written_between_values_only():
    deck = datcom_io.read_deck(
        [
            " $BODY X(1)=1.0,X(3)=3.0,NX=20.0,",
            "   R(1)=" + ",".join(f"{i}.123456" for i in range(20)) + "$",
        ]
    )
    text = deck_text(deck, resolved=True)
    assert " $BODY X(1)=1.0,X(3)=3.0,NX=20.0," in text
    body = text.partition("$BODY ")[2].partition("$")[0]
    assert all(
        re.fullmatch(r"([A-Z]+(\(\d+\))?=)?[-+.\dE]+", word.strip()) for word in body.split(",")
    )
    assert meanings(again(deck)) == meanings(deck)


def test_what_no_card_can_hold_is_refused(tmp_path):
    items = [
        Namelist(1, "body", (NamelistAssignment(1, "X Y", 1, (float("nan"),)),)),
        Card(2, "CASEID", "A\nB"),
        Card(3, "CASEID", "C" * 75),
    ]
    path = tmp_path / "deck.inp"
    path.write_text("old")
    with pytest.raises(SchemaError) as caught:
        datcom_io.write_deck(make_deck(items), path)
    assert caught.value.problems == [
        "case 1: CASEID holds 'A\\nB'; a card holds printable characters of ISO 8859-1",
        "case 1: CASEID holds 75 characters; they do not fit on one card",
        "case 1: $body: 'body' is not a name; upper case letters and digits, at most 10",
        "case 1: $body: 'X Y' is not a name; upper case letters and digits, at most 10",
        "case 1: $body: X Y holds a number that is not finite; leave the place empty (None) "
        "when it is not given",
    ]
    assert path.read_text() == "old"


# any number that single precision distinguishes and any card
_NUMBERS = st.floats(min_value=-1e12, max_value=1e12, allow_nan=False).map(
    lambda x: float(format_namelist_value(x))
)
_TEXTS = (
    st.text(st.characters(min_codepoint=32, max_codepoint=126), min_size=1, max_size=74)
    .map(str.strip)
    .filter(bool)
)


@st.composite
def assignments(draw, name):
    variable = draw(st.sampled_from(sorted(VARIABLES[name])))
    size = VARIABLES[name][variable]
    start = draw(st.integers(1, abs(size)))
    values = draw(
        st.lists(
            st.booleans() if size < 0 else _NUMBERS, min_size=1, max_size=abs(size) - start + 1
        )
    )
    return NamelistAssignment(0, variable, start, tuple(values))


@st.composite
def namelists(draw):
    name = draw(st.sampled_from(sorted(VARIABLES)))
    return Namelist(0, name, tuple(draw(st.lists(assignments(name), max_size=6))))


_CARDS = st.one_of(
    st.sampled_from(["DAMP", "PART", "BUILD", "TRIM", "PLOT", "NAMELIST", "SAVE"]).map(
        lambda word: Card(0, word, "")
    ),
    st.sampled_from(
        ["DIM FT", "DIM M", "DIM CM", "DERIV DEG", "DERIV RAD", "DUMP CASE", "PRINT EXTRAP"]
    ).map(lambda text: Card(0, *text.split())),
    st.sampled_from(["W 4 2412", "H 6 66-415", "V S 3-50.0-2.5-50.0", "F 4 0010"]).map(
        lambda text: Card(0, "NACA", text)
    ),
    _TEXTS.map(lambda text: Card(0, "CASEID", text)),
)


@st.composite
def decks(draw):
    cases = []
    for _ in range(draw(st.integers(1, 4))):
        items = draw(st.lists(st.one_of(namelists(), _CARDS), min_size=1, max_size=8))
        cases.append(
            make_deck(
                [*items, Namelist(0, "FLTCON", ()), Card(0, "NEXT", "CASE")],
                cases[-1] if cases else None,
            )
        )
    return cases


@pytest.mark.nightly
@given(decks(), st.booleans())
@settings(max_examples=2 * settings.default.max_examples, deadline=None)
def test_any_deck_written_and_read_is_equal_in_meaning(cases, resolved):
    text = deck_text(cases, resolved=resolved)
    assert max(map(len, text.split("\n"))) <= 80
    found = datcom_io.read_deck(text.split("\n"))
    assert meanings(found) == meanings(cases)
    assert not any(case.findings for case in found)
    assert deck_text(found, resolved=resolved) == text


@st.composite
def untidy(draw):
    """Return a namelist and a text that writes it in an untidy way: blanks, breaks after commas,
    repeat counts, all ends.
    """
    item = draw(namelists())
    blank = st.sampled_from(["", "", " ", "  ", ",\n   ", ", \n "])
    words = []
    for assignment in item.assignments:
        index = f"({assignment.start})" if assignment.start > 1 or draw(st.booleans()) else ""
        values = list(map(format_namelist_value, assignment.values))
        if len(set(values)) == 1 and len(values) > 1:
            values = [f"{len(values)}*{values[0]}"]
        around = draw(st.sampled_from(["", " "]))
        words.append(f"{assignment.variable}{index}{around}={around}{values[0]}")
        words += values[1:]
    text = "".join(
        f"{word}{draw(blank.filter(lambda x: ',' in x)) if draw(st.booleans()) else ','}"
        for word in words
    )
    text = text.rstrip()
    end = draw(st.sampled_from(["$", " $", "$END", "\n $END"]))
    return (
        item,
        f" ${item.name} "
        f"{text if draw(st.booleans()) or not text.endswith(',') else text[:-1]}{end}",
    )


@pytest.mark.nightly
@given(untidy())
@settings(max_examples=2 * settings.default.max_examples, deadline=None)
def test_any_layout_of_a_namelist_is_read(pair):
    item, text = pair
    found = datcom_io.read_deck(text.split("\n"))
    assert found[0].meaning()["namelists"] == make_deck([item]).meaning()["namelists"]
    assert not any(finding.severity == "error" for finding in found[0].findings)


PLUS = """DIM FT
DAMP
PART
 $FLTCON NMACH=1.0,MACH(1)=0.2$
CASEID ----- Flaps -----
SAVE
NEXT CASE
 $ASYFLP STYPE=4.0$
CASEID ----- Ailerons -----
SAVE
NEXT CASE
 $SYMFLP FTYPE=1.0$
DAMP
CASEID ----- Total -----
NEXT CASE
 $FLTCON NMACH=1.0,MACH(1)=0.3$
CASEID another aircraft"""


def test_datcom_plus_repeats_damp_and_part_after_save(tmp_path):
    """The program itself forgets them: of a deck of three cases it would print the dynamic and
    auxiliary pages of the first only.
    """
    path = tmp_path / "jet.dcm"
    path.write_text(PLUS)
    deck = datcom_io.read_deck(path)
    assert [[word for word in ("DAMP", "PART") if case.has(word)] for case in deck] == [
        ["DAMP", "PART"]
    ] * 3 + [[]]
    assert [finding for finding in deck.findings if finding.severity == "note"] == [
        (
            8,
            "note",
            "DAMP and PART of the case before: DATCOM+ repeats it after SAVE, the program "
            "does not; write_deck writes it",
        ),
        (
            12,
            "note",
            "PART of the case before: DATCOM+ repeats it after SAVE, the program does not; "
            "write_deck writes it",
        ),
    ]
    written = again(deck)
    assert [case.meaning() for case in written] == [case.meaning() for case in deck]
    assert [sum(card.name in ("DAMP", "PART") for card in case.cards) for case in written] == [
        2,
        2,
        2,
        0,
    ]
    with_comment = datcom_io.read_deck(["* Comments make it a deck of DATCOM+", *PLUS.split("\n")])
    assert with_comment[2].has("PART")
    plain = datcom_io.read_deck(PLUS.split("\n"))
    assert [[word for word in ("DAMP", "PART") if case.has(word)] for case in plain] == [
        ["DAMP", "PART"],
        [],
        ["DAMP"],
        [],
    ]


def test_names_of_cards_in_comments_are_no_cards():
    lines = [
        "**********",
        "* CASEID of the flaps: SAVE",
        "**********",
        " $FLTCON NMACH=1.0,MACH(1)=0.2$  ! CASEID none",
        "#NEXT CASE",
        "CASEID ONE",
    ]
    (case,) = datcom_io.read_deck(lines)
    assert (case.caseid, [card.name for card in case.cards]) == ("ONE", ["CASEID"])


@pytest.mark.parametrize(
    "name", ["$REFQ SREF=0.0127", " $AXIBOD TNOSE=OGIVE", " $FINSET1 NPANEL=4."]
)
def test_a_deck_of_missile_datcom_is_named(name, tmp_path):
    """Its FLTCON is that of Digital DATCOM, its other namelists are not."""
    file = tmp_path / "for005.dat"
    file.write_text(f"CASEID ROCKET\n $FLTCON NMACH=1.,MACH=0.1$\n{name}$\nNEXT CASE\n")
    with pytest.raises(ParseError, match="a file of Missile DATCOM, another program"):
        datcom_io.read_deck(file)
