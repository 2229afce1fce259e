"""Numbers in this file were typed from the listings in data/t37/datcom, at the lines named."""

import math
from pathlib import Path

import numpy as np
import pytest

import datcom_io
from datcom_io.listing import Case, Listing
from datcom_io.reading.reader import place_of, read_place
from flightmech.errors import SchemaError, UnknownName

DATA = Path(__file__).parents[3] / "data" / "t37" / "datcom"

NAMES = [
    "aileron",
    "build",
    "clean",
    "elevator",
    "flaps",
    "ground",
    "ground_elevator",
    "ground_flap",
]


@pytest.fixture
def three():
    """Return a listing of three cases whose names hold colons, commas and numbers."""
    names = ("TOTAL: LIGHT SINGLE", "FLAPS: LIGHT SINGLE", "3 FLAPS 1")
    return Listing(
        "three.out", cases=[Case(number, 1, 1, name=name) for number, name in enumerate(names, 1)]
    )


def test_a_case_is_found_by_number_or_a_part_of_its_name(three):
    total, flaps, last = three.cases
    assert three["1"] is three["total"] is three["TOTAL: LIGHT SINGLE"] is total
    assert three["Flaps: "] is flaps
    assert three["3"] is three["FLAPS 1"] is last
    with pytest.raises(
        SchemaError,
        match="have 'flaps' in their name: 2 'FLAPS: LIGHT SINGLE', 3 '3 FLAPS 1'; give the number",
    ):
        three["flaps"]
    with pytest.raises(
        UnknownName, match=r"unknown case of three\.out '4'; allowed: .*; give its number from 1"
    ):
        three["4"]


def test_the_file_of_a_place_ends_before_a_colon(tmp_path):
    (tmp_path / "a.out").touch()
    (tmp_path / "a.out:b").touch()
    assert place_of("a.out", tmp_path) == (tmp_path / "a.out", "")
    assert place_of("a.out:TOTAL: x", tmp_path) == (tmp_path / "a.out", "TOTAL: x")
    assert place_of("a.out:b", tmp_path) == (tmp_path / "a.out:b", "")
    assert place_of("a.out:b:2", tmp_path) == (tmp_path / "a.out:b", "2")
    with pytest.raises(FileNotFoundError, match="write FILE, or FILE:CASE"):
        place_of("b.out:2", tmp_path)


def test_a_place_is_read(t37):
    place = f"{DATA / 't37_elevator.out'}:1"
    assert read_place(place).name == "T-37 OWN DECK ELEVATOR"
    assert len(read_place(DATA.as_posix() + "/t37_elevator.out")) == 1


def test_cases_are_found_by_name_and_number(t37):
    listing = t37("t37_elevator.out")
    assert listing.case_names == ["T-37 OWN DECK ELEVATOR"]
    assert listing["T-37 OWN DECK ELEVATOR"] is listing[0] is listing[-1]
    with pytest.raises(UnknownName, match="near it: T-37 OWN DECK ELEVATOR"):
        listing["T-37 ELEVATOR"]
    with pytest.raises(
        UnknownName, match=r"unknown case number of t37_elevator\.out '1'; allowed: 0"
    ):
        listing[1]


def test_deck_of_the_case(t37):
    deck = t37("t37_elevator.out")[0].deck
    assert deck.conditions() == [(0.15, 0.0), (0.2, 0.0), (0.3, 0.0), (0.4, 0.0), (0.5, 0.0)]
    assert deck.schedule("SYMFLP", "DELTA", "NDELTA") == [
        -25.0,
        -20.0,
        -15.0,
        -10.0,
        -5.0,
        0.0,
        5.0,
        10.0,
        15.0,
    ]
    assert [card.text for card in deck.cards if card.name == "NACA"] == [
        "W 4 2415",
        "H 4 0010",
        "V 4 0012",
    ]


def test_flight_condition_line(t37):
    page = t37("t37_elevator.out")[0].pages[3]
    assert page.kind == "static"
    assert page.configuration == "WING-BODY-VERTICAL TAIL-HORIZONTAL TAIL"
    assert (page.dim, page.per, page.power) == ("FT", "rad", "off")
    assert page.conditions.lines == (184,)
    printed = [
        0.15,
        0.0,
        167.45,
        2.1162e3,
        518.67,
        1.0602e6,
        182.0,
        5.47,
        33.83,
        9.88,
        0.0,
    ]  # line 184
    assert page.conditions.values[0].tolist() == printed


def test_static_table_with_its_blanks(t37):
    table = t37("t37_elevator.out")[0].pages[3].table("static")
    assert table.lines == tuple(range(188, 207))
    first = [
        -8.0,
        0.040,
        -0.613,
        0.2047,
        -0.612,
        -0.045,
        -0.334,
        5.797,
        -1.298,
        -4.177e-01,
        5.272e-02,
        -4.684e-02,
    ]  # line 188
    assert table.values[0].tolist() == first
    flags = [datcom_io.FLAGS[code] for code in table.flags[-1]]
    assert flags == [
        "ok",
        "ok",
        "ok",
        "NA",
        "ok",
        "ok",
        "NA",
        "ok",
        "NA",
        "blank",
        "blank",
        "ok",
    ]  # line 206
    assert table.text(18, 3) == "NA"


def test_control_tables(t37):
    case = t37("t37_elevator.out")[0]
    flaps = case.block("symflp")
    assert flaps["line"][0] == 275
    row = flaps.loc[
        0, ["DELTA", "D(CL)", "D(CM)", "D(CL MAX)", "D(CD MIN)", "(CH)A", "(CH)D"]
    ].tolist()
    assert row == [-25.0, -0.202, 0.4444, 0.120, 0.01167, -4.446e-03, -1.155e-02]  # line 275
    assert math.isnan(flaps["(CLA)D"][0])
    drag = case.block("dcdi")
    at = drag[(drag["line"] == 290) & (drag["DELTA"] == -5.0)]
    assert at["D(CDI)"].tolist() == [2.63e-03]  # line 290
    assert flaps.attrs["units"]["(CH)A"] == "1/deg"


def test_aileron_tables(t37):
    case = t37("t37_aileron.out")[0]
    roll = case.block("asyflp_roll")
    assert roll.loc[0, ["line", "DELTAL", "DELTAR", "(CL)ROLL"]].tolist() == [
        178,
        -20.0,
        20.0,
        -4.9445e-02,
    ]  # line 178
    yaw = case.block("asyflp_cn")
    assert yaw[(yaw["line"] == 156) & (yaw["(DELTAL-DELTAR)"] == -40.0)]["CN"].tolist() == [
        -3.577e-03
    ]  # touches the "=" in line 153


def test_block_carries_the_printed_units(t37):
    frame = t37("t37_elevator.out")[0].block("static")
    assert len(frame) == 5 * 19
    assert frame.attrs["units"]["CYB"] == "1/rad"
    assert frame.attrs["units"]["altitude"] == "ft"
    assert t37("t37_elevator.out")[0].block("asyflp_roll").empty
    with pytest.raises(UnknownName, match="unknown table kind 'statics'; near it: static"):
        t37("t37_elevator.out")[0].block("statics")


def test_every_line_of_the_shipped_listings_is_understood(t37):
    for name in NAMES:
        assert t37(f"t37_{name}.out").unread == []
        assert t37(f"t37_{name}.out").unparsed == []


@pytest.mark.slow
@pytest.mark.parametrize("name", NAMES)
def test_both_builds_of_the_program_agree(t37, name):
    ours, other = (t37(f"t37_{name}{end}").cells() for end in (".out", ".pdas.out"))
    for column in ("case", "page", "table", "column", "flag"):
        assert ours[column].tolist() == other[column].tolist()
    np.testing.assert_array_equal(ours["value"], other["value"])


def test_cells_hold_every_printed_cell(t37):
    cells = t37("t37_elevator.out").cells()
    cell = cells[(cells["line"] == 290) & (cells["delta"] == -25.0)].iloc[0]
    assert (cell["table"], cell["column"], cell["text"], cell["value"], cell["flag"]) == (
        "dcdi",
        "D(CDI)",
        "1.44E-02",
        1.44e-02,
        "ok",
    )
    assert (cell["case"], cell["mach"], cell["altitude"], cell["alpha"]) == (1, 0.15, 0.0, -8.0)
    assert "TAIL PLAIN TRAILING-EDGE FLAP CONFIGURATION" in cell["page"]
    rows = cells[cells["line"] == 206]
    assert rows["text"].tolist() == [
        "20.0",
        "0.250",
        "1.938",
        "NA",
        "1.906",
        "-0.427",
        "NA",
        "2.277E+00",
        "NA",
        "",
        "",
        "-1.256E-01",
    ]
    words = (DATA / "t37_elevator.out").read_text().split("\n")[205].split()
    assert [text for text in rows["text"] if text] == words


def test_several_runs_in_one_file(t37):
    listing = t37("t37_elevator_one_by_one.pdas.out")
    assert listing.runs == 6
    assert [case.run for case in listing] == [1, 2, 3, 4, 5, 6]
    base = "T-37 OWN DECK ELEVATOR, ONE RUN PER MACH NUMBER"
    assert listing.case_names == [base, *(f"{base} ({k})" for k in range(2, 7))]
    assert listing.unread == []


def test_equal_names_are_distinguished(elevator_lines):
    captions = ["A (2)", "A", "A"]
    lines = [
        line
        for caption in captions
        for line in (text.replace("T-37 OWN DECK ELEVATOR", caption) for text in elevator_lines)
    ]
    assert datcom_io.read(lines).case_names == ["A (2)", "A", "A (3)"]


def test_messages_of_the_program_and_of_the_reader(t37):
    messages = t37("t37_elevator.out").messages
    program = next(message for message in messages if message.origin == "program")
    assert (
        program.text
        == "WARNING*** BODY ALONE DYNAMIC DERIVATIVE METHOD VALID FOR NOSE CYLINDER ONLY TAIL "
        "EFFECTS IGNORED]"
    )
    reader = [message.text for message in messages if message.origin == "reader"]
    assert any(text.startswith("D(CM) of 5 conditions from one program run") for text in reader)
    assert any(text.startswith("5 Mach numbers in one case") for text in reader)
    one_by_one = [
        message.text
        for message in t37("t37_elevator_one_by_one.pdas.out").messages
        if "D(CM)" in message.text
    ]
    assert [text.split(",")[0] for text in one_by_one] == ["D(CM) of 8 deflections"] * 6
