"""Tests of numbers that a print holds twice: a changed digit, row, heading or card is seen."""

import re
from pathlib import Path

import pytest

import datcom_io

CLEAN = Path(__file__).parents[3] / "data" / "c182" / "datcom" / "clean.out"
ROW = "    2.0    0.022    0.302    0.1080   0.303    0.011    0.357    5.679E+00   -1.284E+00"


@pytest.fixture(scope="module")
def text() -> str:
    """Return an intact print of our own light aircraft, three Mach numbers."""
    whole = CLEAN.read_text()
    assert whole.count(ROW) == 1  # at Mach 0.1
    return whole


def read_changed(tmp_path: Path, text: str, old: str, new: str):
    """Return suspect static cells as (column, alpha), and the messages that name the cause."""
    assert old in text
    path = tmp_path / "changed.out"
    path.write_text(text.replace(old, new))
    listing = datcom_io.read(path)
    cells = listing.cells()
    suspect = cells[(cells["table"] == "static") & (cells["flag"] == "suspect")]
    messages = [
        message.text for message in listing.messages if "run the deck again" in message.text
    ]
    return suspect, messages


def test_an_intact_print_has_no_contradiction(tmp_path: Path, text: str) -> None:
    suspect, messages = read_changed(tmp_path, text, "C", "C")
    assert suspect.empty
    assert messages == []


@pytest.mark.parametrize(
    ("old", "new", "columns", "words"),
    [
        ("  0.302 ", "  0.802 ", ["CD", "CL", "CN", "CA"], "give CN 0.802 and CA -0.006"),
        ("  0.302 ", " -0.302 ", ["CD", "CL", "CN", "CA"], "CL -0.302 and CD 0.022"),
        ("  0.022 ", "  0.092 ", ["CD", "CL", "CN", "CA"], "CA 0.081"),
        ("  0.1080 ", " -0.1080 ", ["CM", "XCP"], "is 0.1082, and CM -0.108 is printed"),
        ("  0.1080 ", "  0.1180 ", ["CM", "XCP"], "XCP 0.357 times CN 0.303"),
        # the least changes that are seen: 0.3078 is 0.0046 over CN; the room of CM is 0.0015
        ("  0.302 ", "  0.307 ", ["CD", "CL", "CN", "CA"], "give CN 0.308"),
        ("  0.1080 ", "  0.1097 ", ["CM", "XCP"], "is 0.1082, and CM 0.1097 is printed"),
    ],
)
def test_a_changed_number_of_a_row(tmp_path, text, old, new, columns, words) -> None:
    suspect, messages = read_changed(tmp_path, text, ROW, ROW.replace(old, new))
    assert suspect["column"].tolist() == columns
    assert set(suspect["alpha"]) == {2.0}
    assert len(messages) == 1
    assert words in messages[0]


@pytest.mark.parametrize(("old", "new"), [("  0.302 ", "  0.305 "), ("  0.1080 ", "  0.1096 ")])
def test_a_change_within_the_rounding_is_not_seen(tmp_path, text, old, new) -> None:
    suspect, messages = read_changed(tmp_path, text, ROW, ROW.replace(old, new))
    assert suspect.empty
    assert messages == []


def test_the_rounding_of_an_angle_is_no_contradiction(tmp_path: Path, text: str) -> None:
    """CL 2.5976 and CD 0.4205 at 15.05 deg, printed as 15.1: CA is 0.0033 off."""
    row = "   15.1    0.420    2.598    0.1080   2.618   -0.268    0.041    5.679E+00   -1.284E+00"
    assert read_changed(tmp_path, text, ROW, row)[1] == []
    _, messages = read_changed(tmp_path, text, ROW, row.replace("-0.268", "-0.262"))
    assert len(messages) == 1
    assert "CA -0.271, and 2.618 and -0.262 are printed" in messages[0]


def test_a_supersonic_print(tmp_path: Path) -> None:
    """The tail of this aircraft is suspect; its forces and its heading are not."""
    whole = (CLEAN.parents[3] / "tests/datcom_io/listings/tail_pressure.out").read_text()
    assert read_changed(tmp_path, whole, "C", "C")[1] == []
    row = "    8.0    0.068    0.433   -0.0691   0.439    0.007   -0.158 "
    for old, new, words in (
        (row, row.replace("0.433", "0.533"), "CL 0.533 and CD 0.068 at alpha 8 deg give CN 0.537"),
        (row, row.replace("-0.0691", " 0.0691"), "is -0.0694, and CM 0.0691 is printed"),
        ("\n0 1.500 ", "\n0 2.000 ", "as they give Mach 1.500"),
        ("1.500    8000.00", "1.500    2000.00", "altitude 2000 has 79501 Pa and 275.15 K"),
    ):
        _, messages = read_changed(tmp_path, whole, old, new)
        assert any(words in message for message in messages), messages


def test_a_table_shifted_by_a_row(tmp_path: Path, text: str) -> None:
    """The angles stay, and the numbers of rows 2 and 3 deg change places."""
    after = text[text.index(ROW) :].splitlines()[1]
    exchanged = ROW[:7] + after[7 : len(ROW)]
    suspect, messages = read_changed(tmp_path, text, ROW, exchanged)
    assert set(suspect["column"]) == {"CD", "CL", "CN", "CA"}
    assert len(messages) == 1


def test_slopes_in_another_unit(tmp_path: Path, text: str) -> None:
    """Cards say per degree, the pages print per radian: CL changes by 1.17 from -6 to 6 deg."""
    suspect, messages = read_changed(tmp_path, text, "DERIV RAD", "DERIV DEG")
    assert {"CLA", "CMA", "CYB", "CNB", "CLB"} == set(suspect["column"])
    assert any(
        "CL changes by 1.171 over attached flow, and by its slopes by 67" in words
        for words in messages
    )


@pytest.mark.parametrize(
    ("old", "new", "words"),
    [
        ("\n0 0.150 ", "\n0 0.350 ", "as they give Mach 0.150"),
        ("     164.55 ", "     264.55 ", "Mach 0.15, velocity 80.635 m/s"),
        ("MACH(1)=0.1,0.15,0.2", "MACH(1)=0.1,0.16,0.2", "Mach 0.15 is not on the input cards"),
        # 3 % of the Mach number
        ("\n0 0.150 ", "\n0 0.155 ", "as they give Mach 0.150"),
        ("0.150    5000.00 ", "0.150    8000.00 ", "altitude 8000 has 75271 Pa and 272.31 K"),
        (
            "0.150    5000.00 ",
            "0.150    5100.00 ",
            "altitude 5100 is not on the input cards (5000)",
        ),
    ],
)
def test_a_heading_of_another_run(tmp_path: Path, text: str, old, new, words) -> None:
    suspect, messages = read_changed(tmp_path, text, old, new)
    assert {"CL", "CD", "CM", "CYB"} <= set(suspect["column"])
    assert any(words in message for message in messages)


@pytest.mark.parametrize(
    ("old", "new", "words"),
    [
        ("SREF=174.0", "SREF=16.17", "SREF is 16.17 on the input cards and 174 on the page"),
        ("CBARR=4.9", "CBARR=5.56", "CBARR is 5.56 on the input cards and 4.9 on the page"),
        ("XCG=7.6", "XCG=7.9", "XCG is 7.9 on the input cards and 7.6 on the page"),
        ("DIM FT", "DIM M ", "the page is in FT and card DIM of the case is M"),
    ],
)
def test_reference_quantities_of_other_cards(tmp_path: Path, text: str, old, new, words) -> None:
    (tmp_path / "changed.out").write_text(re.sub(re.escape(old), new, text))
    listing = datcom_io.read(tmp_path / "changed.out")
    assert any(words in message.text for message in listing.messages)
