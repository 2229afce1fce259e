"""Namelist echo, dumps and extrapolation summary; numbers typed from the listing plot_dump_namelist
at the lines named.
"""

import pytest

import datcom_io
from flightmech.errors import ParseError

START = [
    "1          THE FOLLOWING IS A LIST OF ALL INPUT CARDS FOR THIS CASE.",
    "0",
    " CASEID X",
    " NEXT CASE",
]
END = ["0 INPUT DIMENSIONS ARE IN FT, SCALE FACTOR IS 1.0000", "1 END OF JOB."]


@pytest.fixture(scope="module")
def listing(corpus):
    return corpus("plot_dump_namelist")


@pytest.fixture(scope="module")
def cells(listing):
    return listing.cells()


def one(cells, **wanted):
    """Return text, value and flag of the only cell with these properties."""
    for name, item in wanted.items():
        cells = cells[cells[name] == item]
    ((text, value, flag),) = cells[["text", "value", "flag"]].itertuples(index=False)
    return text, value, flag


def test_kinds_and_counts(listing):
    counts = {}
    for page in listing.pages:
        for group in page.printed:
            if not hasattr(group, "layout"):
                counts.setdefault(group.name, []).append(len(group.values))
    assert sum(counts["namelist"]) == 1609  # the commas of lines 101 to 520
    assert counts["dump"] == [2398, 721, 3900, 707, 400] * 2  # the same arrays at both Mach numbers
    assert counts["extrapolation"] == [190, 179, 77]
    assert counts["note"] == [1]
    assert (listing.unread, listing.unparsed) == ([], [])


def test_namelist_echo(cells):
    echo = cells[cells["table"] == "namelist"]
    assert one(echo, column="FLTCON.NMACH") == ("2.000000", 2.0, "ok")
    assert one(echo, column="FLTCON.MACH(2)") == ("0.5000000", 0.5, "ok")
    assert one(echo, column="FLTCON.MACH(20)") == ("0.1000000E-29", 1e-30, "sentinel")
    assert one(echo, column="BODY.ZL(9)") == ("-0.4200000", -0.42, "ok")  # on a continuation line
    assert one(echo, column="BODY.S(12)")[1] == 0.1130973e-1
    text, value, flag = one(echo, column="FLTCON.HYPERS")
    assert (text, value != value, flag) == ("F", True, "ok")
    assert one(echo, column="SYNTHS.VERTUP")[0] == "T"
    assert one(echo, column="SYMFLP.DELTA(9)") == ("19.00000", 19.0, "ok")
    assert echo["column"].nunique() == len(echo)


def test_the_echo_reports_what_the_program_computed(listing):
    """S and P of the body are not in the cards: the program takes them from R."""
    values = {
        label: value
        for _, group in listing[0].values("namelist")
        for label, value in zip(group.labels, group.values)
    }
    assert "S" not in listing[0].deck.namelists["BODY"]
    assert values["BODY.S(2)"] == pytest.approx(3.14159265 * values["BODY.R(2)"] ** 2, rel=1e-6)


def test_scale_factor_behind_the_echo(cells):
    assert one(cells, table="note", column="SCALE FACTOR", line=521) == ("1.0000", 1.0, "ok")


def test_dump(listing, cells):
    dump = cells[cells["table"] == "dump"]
    assert one(dump, column="A(1)", line=587) == ("2.14465E+02", 214.465, "ok")
    assert one(dump, column="FLC(23)", line=1093) == ("-2.00000E+00", -2.0, "ok")
    assert one(dump, column="FLC(27)", line=1094)[2] == "sentinel"
    assert one(dump, column="BDIN(126)", line=1154) == ("3.28084E-30", 3.28084e-30, "sentinel")
    assert [page.kind for page in listing.pages].count("dump") == 10
    first = next(group for _, group in listing[0].values("dump"))
    arrays = {}
    for label in first.labels:
        arrays[label.partition("(")[0]] = arrays.get(label.partition("(")[0], 0) + 1
    assert (arrays["A"], arrays["B"], arrays["BD"], arrays["FACT"], arrays["WBT"]) == (
        195,
        49,
        762,
        182,
        156,
    )


def test_dump_without_heading():
    """Card DUMP A,B prints arrays between the pages; a name of four letters keeps its blanks."""
    lines = [
        " ",
        "     A(  1)= 2.14465E+02     A(  2)= 5.00000E-30     A(  3)=-2.14465E+02     A(  "
        "4)= 2.60432E+02     A(  5)=         NaN",
        "     A(  6)= 1.00000E+00",
        " ",
        "     F(  1)=************     F(  2)=-1.50000-001",
    ]
    case = datcom_io.read([*START, END[0], *lines, END[1]])[0]
    ((page, group),) = case.values("dump")
    assert page.kind == "dump"
    assert group.labels == ("A(1)", "A(2)", "A(3)", "A(4)", "A(5)", "A(6)", "F(1)", "F(2)")
    assert [datcom_io.FLAGS[code] for code in group.flags] == [
        "ok",
        "sentinel",
        "ok",
        "ok",
        "nan",
        "ok",
        "overflow",
        "ok",
    ]
    assert group.values[-1] == -0.15


def test_extrapolation_summary(cells):
    table = cells[cells["table"] == "extrapolation"]

    def row(line):
        return table.loc[table["line"] == line, ["column", "text"]].astype(str).values.tolist()

    assert row(4062) == [
        ["OVERLAY", "15"],
        ["FIGURE NUMBER", "4.1.3.1-5"],
        ["TYPE OF EXTRAPOLATION LOWER 1", "NOT REQD"],
        ["TYPE OF EXTRAPOLATION UPPER 1", "LAST VAL"],
    ]
    assert row(4063) == [
        ["SUBROUTINES 1", "TBFUNX"],
        ["SUBROUTINES 2", "CALCA0"],
        ["FIGURE LIMITS LOWER 1", "5.00E-01"],
        ["FIGURE LIMITS UPPER 1", "7.50E-01"],
    ]
    assert row(4064) == [
        ["FINAL RESULT", "1.0000E+00"],
        ["INDEPENDENT VARIABLES 1", "0.0000E+00"],
        ["** 1", "**"],
    ]
    assert row(4061) == [
        ["FINAL RESULT", "7.0000E-02"],
        ["INDEPENDENT VARIABLES 1", "3.6971E+00"],
        ["INDEPENDENT VARIABLES 2", "2.0000E-02"],
        ["INDEPENDENT VARIABLES 3", "1.5000E-01"],
    ]
    assert row(4096)[1] == ["FIGURE NUMBER", "CDHT DERIVATIVES"]
    assert one(table, line=4113, column="FIGURE NUMBER")[2] == "ok"
    assert one(table, line=4064, column="** 1")[2] == "ok"
    assert one(table, line=4098, column="INDEPENDENT VARIABLES 1") == ("-1.6570E+00", -1.657, "ok")


def test_marked_variables_lie_outside_of_their_chart(listing):
    """A marked variable is not between the limits of its look-up, an unmarked one is: the columns
    are cut where they belong.
    """
    judged = 0
    for _, group in listing[0].values("extrapolation"):
        limits, cells = {}, list(zip(group.labels, group.values, group.lines))
        marks = {(line, label[3:]) for label, _, line in cells if label.startswith("**")}
        for label, value, line in cells:
            if label.startswith("FIGURE LIMITS LOWER"):
                limits[label[-1]] = [value]
            elif label.startswith("FIGURE LIMITS UPPER"):
                limits[label[-1]].append(value)
            elif label.startswith("INDEPENDENT VARIABLES"):
                low, high = sorted(limits[label[-1]])
                assert ((line, label[-1]) in marks) == (not low <= value <= high)
                judged += 1
    assert judged > 60


def test_note_below_the_summary(listing):
    page = next(page for page in listing.pages if page.kind == "extrapolation")
    assert page.notes[0].text == (
        "*NOTE*   MESSAGES HAVE BEEN SORTED WITHIN EACH OVERLAY BY FIGURE NUMBER AND DO NOT "
        "NECESSARILY CORRESPOND "
        "TO THE PROGRAM EXECUTION SEQUENCE. ** DENOTES THE INDEPENDENT VARIABLE EXCEEDED IN CALL"
    )


def test_a_line_among_the_values_that_nobody_knows(corpus_lines):
    lines = list(corpus_lines("plot_dump_namelist"))
    places = [
        next(k for k, line in enumerate(lines) if words in line)
        for words in ("0TINF ", "   FLC( 26)=", "TBFUNX  CALCA0")
    ]
    for at in places:
        lines[at] = "  SOMETHING ELSE"
    listing = datcom_io.read(lines)
    unread = set(listing.unread)
    assert {at + 1 for at in places} <= unread
    labels = {
        label
        for name in ("namelist", "dump")
        for _, group in listing[0].values(name)
        for label in group.labels
    }
    assert {"FLTCON.ALT(1)", "OPTINS.SREF", "FLC(25)", "FLC(31)"} <= labels


def test_a_value_that_is_cut(corpus_lines):
    """A field of the echo that lost its comma is not read as a number."""
    lines = list(corpus_lines("plot_dump_namelist"))
    at = next(k for k, line in enumerate(lines) if line.startswith("0ALSCHD"))
    lines[at] = lines[at][:35]
    listing = datcom_io.read(lines)
    assert at + 1 in listing.unread
    (labels,) = {
        group.labels
        for _, group in listing[0].values("namelist")
        if group.labels[0] == "FLTCON.NMACH"
    }
    assert labels[-1] == "FLTCON.NALPHA"


def test_a_dump_at_the_end_of_a_cut_listing(corpus_lines):
    lines = corpus_lines("plot_dump_namelist")[:600]
    with pytest.raises(ParseError, match="the listing is cut"):
        datcom_io.read(lines)
    listing = datcom_io.read(lines, partial=True)
    assert [group.name for _, group in listing[0].values("dump")] == []
    assert sum(len(group.values) for _, group in listing[0].values("namelist")) == 1609
