"""Listings with other line ends, encodings, columns and numbers."""

from pathlib import Path

import numpy as np
import pytest

import datcom_io

DATA = Path(__file__).parents[3] / "data" / "t37" / "datcom"


def test_crlf_and_a_last_line_without_end(elevator_lines, t37):
    listing = datcom_io.read(line + "\r\n" for line in elevator_lines[:-1])
    assert listing.file == "<text>"
    assert listing.cells().equals(t37("t37_elevator.out").cells())


@pytest.mark.parametrize("page_end", ["\f", ""])
def test_missing_control_column(elevator_lines, t37, page_end):
    printed = []
    for line in elevator_lines:
        control, text = line[:1], line[1:]
        printed += {"1": [page_end + text], "0": ["", text]}.get(control, [text])
    ours, wanted = datcom_io.read(printed), t37("t37_elevator.out")
    np.testing.assert_array_equal(ours.cells()["value"], wanted.cells()["value"])
    assert ours.unread == []
    assert ours[0].deck.namelists == wanted[0].deck.namelists


def test_numbers_without_leading_zero_or_exponent_letter(elevator_lines, t37):
    import re

    def rewrite(line):
        line = re.sub(r"(?<= )0\.(\d)", r" .\1", line)
        line = re.sub(r"(-)0\.(\d)", r" \1.\2", line)
        return re.sub(r"(\d)E([+-])(\d\d)", r"\g<1>\g<2>0\3", line)

    lines = [
        rewrite(line) if line.startswith(("   ", "0 0.")) and "=" not in line else line
        for line in elevator_lines
    ]
    assert lines != elevator_lines
    np.testing.assert_array_equal(
        datcom_io.read(lines).cells()["value"], t37("t37_elevator.out").cells()["value"]
    )


def test_a_message_between_a_table_and_its_page_end(elevator_lines, t37):
    at = (
        elevator_lines.index(
            next(line for line in elevator_lines if "CHARACTERISTICS OF HIGH LIFT" in line)
        )
        - 1
    )
    lines = [
        *elevator_lines[:at],
        " WARNING*** BODY ALONE DYNAMIC DERIVATIVE METHOD",
        " Return to main program from M02O02",
        "1",
        *elevator_lines[at:],
    ]
    listing = datcom_io.read(lines)
    assert listing.unread == []
    assert len(listing[0].messages) == len(t37("t37_elevator.out")[0].messages) + 1


def test_a_line_that_is_not_understood_is_listed(elevator_lines):
    lines = [*elevator_lines[:206], "   SOMETHING NEW 1.0", *elevator_lines[206:]]
    assert datcom_io.read(lines).unread == [207]


def text_of(name):
    return (DATA / name).read_text()


def same(listing, wanted):
    """Return whether two listings have the same cells, and nothing that was not understood."""
    ours, theirs = listing.cells(), wanted.cells()
    columns = [column for column in theirs if column not in ("page", "text")]
    return listing.unread == [] and ours[columns].equals(theirs[columns])


@pytest.mark.slow
@pytest.mark.parametrize(
    ("encode", "states"),
    [
        (lambda text: text.encode("utf-8-sig"), "mark of UTF-8"),
        (lambda text: text.encode("utf-16"), "UTF-16 of PowerShell"),
        (lambda text: ("\ufeff" + text).encode("utf-16-be"), "UTF-16, big end first"),
        (lambda text: text.replace("\n", "\r\n").encode() + b"\x1a", "DOS"),
        (lambda text: text.rstrip("\n").encode(), "no last line feed"),
        (
            lambda text: "\n".join(line + "   " for line in text.split("\n")).encode(),
            "blanks at the end",
        ),
        (
            lambda text: "\n".join(line.rstrip() for line in text.split("\n")).encode(),
            "no blanks at the end",
        ),
    ],
    ids=lambda item: item if isinstance(item, str) else "",
)
def test_the_same_text_in_other_files(tmp_path, t37, encode, states):
    path = tmp_path / "t37_elevator.out"
    path.write_bytes(encode(text_of("t37_elevator.out")))
    assert same(datcom_io.read(path), t37("t37_elevator.out"))


def test_tabs_in_place_of_blanks(t37, elevator_lines):
    """As `unexpand -a` writes them: eight columns that end in two blanks or more become a tab."""

    def unexpand(line):
        pieces = [line[i : i + 8] for i in range(0, len(line), 8)]
        return "".join(
            piece.rstrip(" ") + "\t" if len(piece) == 8 and piece.endswith("  ") else piece
            for piece in pieces
        )

    lines = [unexpand(line) for line in elevator_lines]
    assert sum("\t" in line for line in lines) > 500
    assert same(datcom_io.read(lines), t37("t37_elevator.out"))


def filtered(lines, page_end):
    """Return a listing as a printer filter leaves it: without column 1."""
    printed = []
    for line in lines:
        control, text = line[:1], line[1:]
        printed += {"1": [page_end + text], "0": ["", text]}.get(control, [text])
    return printed


@pytest.mark.parametrize("page_end", ["\f", ""])
def test_missing_control_column_in_several_runs(page_end):
    lines = text_of("t37_elevator_one_by_one.pdas.out").split("\n")
    wanted = datcom_io.read(lines)
    listing = datcom_io.read(filtered(lines, page_end))
    assert (listing.runs, listing.case_names, listing.unread) == (6, wanted.case_names, [])
    assert [case.deck.namelists for case in listing] == [case.deck.namelists for case in wanted]
    np.testing.assert_array_equal(listing.cells()["value"], wanted.cells()["value"])


def test_runs_with_and_without_control_column_in_one_file(elevator_lines, t37):
    listing = datcom_io.read(
        [
            *elevator_lines,
            *filtered(elevator_lines, "\f"),
            "\x1a" + elevator_lines[0],
            *elevator_lines[1:],
        ]
    )
    assert listing.runs == 3
    assert listing.unread == []
    wanted = t37("t37_elevator.out")[0].cells()
    for case in listing:
        assert case.cells()["text"].tolist() == wanted["text"].tolist()


def test_form_feeds_before_the_control_column(elevator_lines, t37):
    lines = ["\f" + line if line.startswith("1") else line for line in elevator_lines]
    assert same(datcom_io.read(lines), t37("t37_elevator.out"))


@pytest.mark.slow
@pytest.mark.parametrize(
    "caption",
    ["Aé\xff\x85 NDM ALPHA", "1", "0", "END OF JOB", "* $ &", "STATIC (2)", "FLIGHT CONDITION\xa0"],
)
def test_any_bytes_in_the_caption(tmp_path, t37, caption):
    path = tmp_path / "t37_elevator.out"
    path.write_bytes(
        text_of("t37_elevator.out").replace("T-37 OWN DECK ELEVATOR", caption).encode("latin-1")
    )
    listing = datcom_io.read(path)
    assert listing.case_names == [caption.strip()]
    assert same(listing, t37("t37_elevator.out"))


@pytest.mark.parametrize(
    "write",
    ["{0}-0{1}", "{0}e-{1}", "{0}D-{1}", "{0}d-{1}", "{0}E-0{1}"],
    ids=["none", "e", "D", "d", "three"],
)
def test_other_exponents_inside_a_two_way_table(elevator_lines, t37, write):
    import re

    lines, changed = list(elevator_lines), 0
    for k in range(289, 308):  # below the heading of D(CDI)
        lines[k], count = re.subn(
            r" (-?\d\.\d\d)E-(\d\d)",
            lambda found: write.format(found[1], found[2]).rjust(len(found[0])),
            lines[k],
        )
        changed += count
    assert changed > 150  # of 19 x 9 cells
    assert same(datcom_io.read(lines), t37("t37_elevator.out"))


def test_numbers_that_touch(elevator_lines):
    row = elevator_lines[187]  # line 188: CD 0.040 in columns 9-17, CL -0.613 in 18-26
    touching = row[:8] + "-1234.567" + "-1234.567" + row[26:]
    cells = datcom_io.read([*elevator_lines[:187], touching, *elevator_lines[188:]]).cells()
    assert cells[cells["line"] == 188]["value"].tolist()[:4] == [-8.0, -1234.567, -1234.567, 0.2047]


@pytest.mark.parametrize(
    "numbers",
    ["-1234.5678-123.456", "  12345.67890.1230", "  5.8000-02   0.10"],
    ids=["shifted", "longer", "exponent"],
)
def test_a_number_over_the_edge_of_its_columns_is_not_cut_in_two(elevator_lines, numbers):
    row = elevator_lines[187]
    with pytest.raises(datcom_io.DamagedListing, match="0 rows in the static table"):
        datcom_io.read([*elevator_lines[:187], row[:8] + numbers + row[26:], *elevator_lines[188:]])
