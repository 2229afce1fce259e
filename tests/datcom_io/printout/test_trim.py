"""Trim pages; numbers typed from ../shared/data/datcom/ce500_trim and ce500_trim_ft, at the lines
named.
"""

import math

import numpy as np
import pytest

import datcom_io
from datcom_io.cells import ABSENT, BLANK, FILLED, NA, OK, SENTINEL, SUSPECT
from flightmech.errors import ParseError

DEG = math.pi / 180.0


def test_trim_with_the_elevator(corpus):
    found = corpus("ce500_trim")[0].to_datatree()["trim"]
    assert found["CL"].dims == ("condition", "alpha")
    assert dict(found.sizes) == {"condition": 4, "alpha": 20}
    assert found.attrs["surface"] == "tail"
    row = found.isel(condition=0, alpha=0)  # line 304
    printed = {
        "CL": -0.827,
        "CD": 0.052,
        "Cm": 0.2830,
        "dCL": 0.103,
        "dCLmax": 0.056,
        "dCDi": -2.98e-03,
        "dCDmin": 0.00337,
    }
    for name, value in printed.items():
        assert float(row[name]) == value
    assert float(row["delta_trim"]) == pytest.approx(8.1 * DEG, rel=1e-12)
    assert float(row["Ch_alpha"]) == pytest.approx(-4.871e-03 / DEG, rel=1e-12)
    assert float(row["Ch_delta"]) == pytest.approx(-7.535e-03 / DEG, rel=1e-12)
    assert found["Ch_alpha_flag"][0].values.tolist() == [OK] + [FILLED] * 19
    assert str(found["lines"][0].values) == "304-323"
    assert found["delta_trim"].attrs["units"] == "rad"


def test_rows_without_solution_are_not_numbers(corpus):
    """CM is NA at 18, 20 and 22 deg, lines 321-323; what the program prints behind it is zero
    deflection.
    """
    case = corpus("ce500_trim")[0]
    found = case.to_datatree()["trim"].isel(condition=0)
    assert found["Cm_flag"].values.tolist() == [OK] * 17 + [NA] * 3
    for name in ("delta_trim", "dCL", "dCLmax", "dCDi", "dCDmin", "Ch_delta"):
        assert found[name][17:].isnull().all()
        assert (found[f"{name}_flag"][17:] == NA).all()
        assert (
            found[f"{name}_flag"][:17] == (OK if name == "Ch_delta" else SUSPECT)
        ).all()  # D(CM) of later deflections is in it
    assert found["CL"][17:].values.tolist() == [1.774, 1.694, 1.253]
    _, table = next(case.tables("trim"))
    assert [table.text(17, k) for k in (3, 4, 7)] == [
        "NA",
        "-0.0",
        "1.97E-06",
    ]  # the listing keeps what is printed
    assert table.flags[17].tolist()[4:8] == [SUSPECT] * 4


def test_page_without_caseid_finds_its_condition(corpus):
    found = corpus("ce500_trim_ft")[0].to_datatree()["trim"]
    np.testing.assert_allclose(found["mach"], [0.25, 0.4])
    assert float(found["Cm"][1, 0]) == 0.2874  # line 454
    assert float(found["p_static"][0]) == pytest.approx(
        101325.0, rel=1e-4
    )  # printed with five digits, on the static page


def with_level_row(lines):
    """Return the listing with the row of equilibrium that follows a trim table, as the program's
    FORMAT writes it.
    """
    row = lines[312].replace(
        "       3.0    0.438     0.026    0.0133     0.4",
        "       3.4    0.474     0.028    0.0075     0.2",
    )
    return [*lines[:323], "", row, *lines[323:]]


def test_level_flight_behind_a_trim_table(corpus_lines):
    listing = datcom_io.read(with_level_row(corpus_lines("ce500_trim")))
    assert listing.unread == []
    ((_, table),) = listing[0].tables("trim_level")
    assert table.lines == (325,)
    found = listing[0].to_datatree()["trim"]
    assert found.sizes["alpha"] == 20
    assert float(found["alpha_level"][0]) == pytest.approx(3.4 * DEG, rel=1e-12)
    assert float(found["delta_trim_level"][0]) == pytest.approx(0.2 * DEG, rel=1e-12)
    assert [float(found[name][0]) for name in ("CL_level", "CD_level", "Cm_level")] == [
        0.474,
        0.028,
        0.0075,
    ]
    assert found["CL_level_flag"].values.tolist() == [OK, ABSENT, ABSENT, ABSENT]
    assert "dCDi_level" not in found  # never set by the program
    assert found["alpha_level"].attrs["long_name"] == "angle of attack in level flight"


def test_two_rows_behind_a_gap_are_no_level_flight(corpus_lines):
    lines = with_level_row(corpus_lines("ce500_trim"))
    listing = datcom_io.read([*lines[:325], lines[324], *lines[325:]])
    assert list(listing[0].tables("trim_level")) == []
    assert listing.unread == [325, 326]


STOP = "0*NOTE** TRIM RESULTS HAVE BEEN TERMINATED DUE TO LACK OF CONTROL MOMENT."


def test_trim_that_stops_early(corpus_lines):
    lines = corpus_lines("ce500_trim")
    listing = datcom_io.read([*lines[:313], STOP, *lines[323:]])
    found = listing[0].to_datatree()["trim"]
    assert (found["CL_flag"][0, :10] == OK).all()
    assert (found["CL_flag"][0, 10:] == ABSENT).all()
    with pytest.raises(
        ParseError,
        match=r"found 10 rows in the trim table; expected 20 rows \(NALPHA of the input cards\)",
    ):
        datcom_io.read([*lines[:313], *lines[323:]])


def test_trim_that_never_starts(corpus_lines):
    lines = corpus_lines("ce500_trim")
    listing = datcom_io.read([*lines[:303], STOP, *lines[326:]])
    assert listing.unread == []
    assert listing.unparsed == []
    assert listing[0].to_datatree()["trim"].sizes["condition"] == 4
    assert (listing[0].to_datatree()["trim"]["CL_flag"][0] == ABSENT).all()


def test_trim_with_the_stabilizer(corpus):
    listing = corpus("ce500_trim")
    found = listing[1].to_datatree()["trim_stabilizer"]
    assert dict(found.sizes) == {"condition": 4, "alpha": 20}
    row = found.isel(condition=0, alpha=0)  # lines 915 and 937
    printed = {
        "CD_tail": 0.012,
        "CL_tail": -0.190,
        "Cm_tail": 0.5258,
        "Ch_tail": 1.055e-03,
        "CD_tail_trim": 0.003,
        "CL_tail_trim": -0.022,
        "Cm_tail_trim": 0.0627,
        "Ch_tail_trim": 1.263e-04,
        "CD": 0.043,
        "CL": -0.721,
    }
    for name, value in printed.items():
        assert float(row[name]) == value
    assert float(row["i_tail"]) == pytest.approx(5.5 * DEG, rel=1e-12)
    assert [int((found["CL_flag"][k] == OK).sum()) for k in range(4)] == [
        17,
        15,
        17,
        15,
    ]  # stopped, with a note
    assert (found["CL_flag"][0, 17:] == ABSENT).all()
    assert str(found["lines"][0].values) == "915-931"
    assert str(found["lines_aircraft"][0].values) == "937-953"
    assert listing.unread == []


def test_leaked_zero_of_the_stabilizer_is_no_moment(corpus):
    case = corpus("ce500_trim")[1]
    found = case.to_datatree()["trim_stabilizer"].isel(condition=0)
    assert (
        found["Cm_tail_flag"].values.tolist() == [OK] * 3 + [SENTINEL] * 14 + [ABSENT] * 3
    )  # 0.0000 from line 918 on
    assert found["Cm_tail"][3:].isnull().all()
    assert "0.0000" in found["Cm_tail"].attrs["comment"]
    assert (found["Cm_tail_trim_flag"][:17] == OK).all()
    _, table = next(case.tables("trim_stabilizer"))
    assert (table.text(3, 3), table.flags[3, 3], table.values[3, 3]) == ("0.0000", OK, 0.0)


def test_stabilizer_rows_without_solution(corpus_lines):
    """The program prints four numbers in the first table and alpha alone in the second."""
    lines = list(corpus_lines("ce500_trim"))
    assert lines[930].startswith("   16.0    0.027    0.299    0.0000")
    lines[930] = lines[930][:35]
    assert lines[952].split() == ["16.0", "0.165", "1.599"]
    lines[952] = lines[952][:58]
    found = datcom_io.read(lines)[1].to_datatree()["trim_stabilizer"].isel(condition=0, alpha=16)
    assert float(found["CL_tail"]) == 0.299
    for name in ("Ch_tail", "i_tail", "CL_tail_trim", "CL"):
        assert int(found[f"{name}_flag"]) == BLANK
        assert math.isnan(found[name])


def test_level_flight_with_the_stabilizer(corpus_lines):
    """The row has a 0 in front, and lift stands below CD: the program names it first."""
    lines = list(corpus_lines("ce500_trim"))
    lines[953:953] = ["", f"0{'':52}{7.4:5.1f}   {0.879:6.3f}   {0.058:6.3f}"]
    listing = datcom_io.read(lines)
    assert listing.unread == []
    found = listing[1].to_datatree()["trim_stabilizer"]
    assert float(found["alpha_level"][0]) == pytest.approx(7.4 * DEG, rel=1e-12)
    assert (float(found["CL_level"][0]), float(found["CD_level"][0])) == (0.879, 0.058)


@pytest.mark.parametrize(
    ("line", "text", "found"),
    [
        (310, None, r"19 rows in the trim table"),
        (
            310,
            "        word   0.148     0.018    0.0591     1.7    0.021      0.012      "
            "1.85E-04   0.00070",
            "6 rows in the trim table",
        ),
        (925, "     NA    0.004    0.086    0.0000", None),
        (925, None, None),
    ],
)
def test_damaged_rows(corpus_lines, line, text, found):
    """A stabilizer table ends early by right, so a gap in it shows when its alphas are held against
    the cards, or as unread lines.
    """
    lines = corpus_lines("ce500_trim")
    lines = [*lines[: line - 1], *([] if text is None else [text]), *lines[line:]]
    if found:
        with pytest.raises(ParseError, match=found):
            datcom_io.read(lines)
        return
    listing = datcom_io.read(lines)
    if text:
        assert listing.unread == list(range(line, 932))
    else:
        with pytest.raises(ParseError, match="ALPHA = 6 deg; expected 4 deg as in the input cards"):
            listing.to_datatree()
