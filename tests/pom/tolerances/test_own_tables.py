"""Tolerance tables of the user: what is read, what is refused, what a case and a report keep."""

import csv
import io
from dataclasses import replace
from pathlib import Path

import pytest

from flightmech.errors import SchemaError
from pom.archive.statements import differences_from_table
from pom.cases.case import PomCase, read_case
from pom.cases.own_table import demand_use
from pom.judging.departures import case_departures
from pom.tolerances import rows
from pom.tolerances.own_tables import read_own_table

SHIPPED = Path(rows.__file__).with_name("tolerances.csv")
COMPANY = {"standard": "Company 7", "edition": "issue 3"}


@pytest.fixture
def write_table(tmp_path):
    """Write the rows of 2.c.10 with changed cells as a table; the first row gets the changes."""

    def write(of_first=(), of_all=(), columns=None, test="2.c.10"):
        found = [dict(row) | dict(of_all) for row in rows.rows_of_test(test)]
        found[0] |= dict(of_first)
        text = io.StringIO()
        writer = csv.DictWriter(text, columns or list(found[0]), extrasaction="ignore")
        writer.writeheader()
        writer.writerows(found)
        path = tmp_path / "own.csv"
        path.write_text(text.getvalue())
        return path

    return write


def test_the_shipped_table_is_a_valid_table():
    table = read_own_table(SHIPPED)
    assert table.rows == tuple(dict(row) for row in rows.tolerance_rows())


@pytest.mark.parametrize(
    ("change", "text"),
    [
        ({"upper": "3"}, "lower: -1.5 with upper 3; bands are symmetric"),
        ({"upper": "1,5"}, "upper: '1,5' is not a number"),
        ({"upper": "nan", "lower": "nan"}, "upper: nan; a half width is positive and finite"),
        ({"unit": "ft"}, "theta: unit 'ft' cannot be converted"),
        ({"quantity": "percent", "unit": "%"}, "percent_base: empty"),
        ({"quantity": "percent", "percent_base": "ref_peak"}, "a percentage has the unit %"),
        ({"measure": "tracing"}, "near it: trace"),
        ({"parameter": "pitch_angel"}, "near it: pitch_angle"),
        ({"rule": "greater_of"}, "rule: 'greater_of' with one width"),
        ({"alt_upper": "3"}, "alt_quantity is empty"),
        ({"provenance": "seen"}, "allowed are verified, partial, memory"),
        ({"condition": "groundspeed<40 apples"}, "condition: 'groundspeed<40 apples'"),
        ({"condition": "height<40ft"}, "a relation begins with speed"),
        ({"applies_from": "input start"}, "applies_from: 'input start'"),
        ({"measure": "curve"}, "the number selects the control of a sweep"),
        ({"group": ""}, "group: empty"),
        ({"parameter": "pitch_rate", "unit": "deg/s", "lower": "-2", "upper": "2"}, "the same row"),
    ],
)
def test_a_wrong_cell_is_named_with_its_line(write_table, change, text):
    with pytest.raises(SchemaError) as error:
        read_own_table(write_table(change))
    assert text in str(error.value)
    assert "line " in str(error.value)


def test_columns_and_the_form_of_the_file_are_checked(write_table, tmp_path):
    columns = [name for name in rows.tolerance_rows()[0] if name != "upper"]
    with pytest.raises(SchemaError, match="columns upper are missing"):
        read_own_table(write_table(columns=columns))
    path = write_table()
    path.write_text(path.read_text().replace(",", ";"))
    with pytest.raises(SchemaError, match="separate the cells by commas"):
        read_own_table(path)
    path = write_table()
    path.write_text(path.read_text().rstrip() + ",one more\n")
    with pytest.raises(SchemaError, match="another number of cells"):
        read_own_table(path)
    path.write_bytes("\N{DEGREE SIGN}".encode("latin-1"))
    with pytest.raises(SchemaError, match="not UTF-8"):
        read_own_table(path)


def test_a_case_takes_its_rows_from_the_table_of_its_standard(write_table, write_case):
    own = write_table({"upper": "1", "lower": "-1"}, COMPANY)
    keys = 'standard = "Company 7"\nedition = "issue 3"\ntolerances = "own.csv"\n'
    case = read_case(write_case(case=keys))
    assert case.criteria[0].band.text == "1 deg"
    assert str(own) in case.files()
    # a table with a name of its own departs from nothing
    assert case_departures(case) == ()
    # the report needs no file: all is kept with the case
    own.unlink()
    again = PomCase.from_dict(case.to_dict())
    assert list(differences_from_table(again)) == []
    assert again.table["tests"] == {"2.c.10": "Short period dynamics"}
    wider = replace(again.criteria[1], band=again.criteria[2].band)
    changed = replace(again, criteria=(again.criteria[0], wider, again.criteria[2]))
    assert "pitch_rate: band '0.1 g'" in next(differences_from_table(changed))


@pytest.mark.parametrize(("width", "departs"), [("9", True), ("1", False)])
def test_a_wider_row_under_a_shipped_name_is_a_departure(write_table, write_case, width, departs):
    table = read_own_table(write_table({"upper": width, "lower": f"-{width}"}))
    case = read_case(write_case(), table)
    texts = [remark.text for remark in case_departures(case)]
    assert any(f"pitch_angle {width} deg in own.csv, 1.5 deg" in text for text in texts) == departs


def test_a_table_that_no_case_uses_is_an_error(write_table, write_case):
    table = read_own_table(write_table({}, COMPANY))
    case = read_case(write_case(), table)
    assert case.tolerances == ""
    with pytest.raises(SchemaError, match="no case uses this table; it holds Company 7"):
        demand_use(table, [case.tolerances])


def test_a_case_states_what_number_and_edition_do_not(write_table, write_case):
    table = read_own_table(write_table({}, {**COMPANY, "test_id": "F.9"}, test="2.c.9"))
    keys = 'standard = "Company 7"\nedition = "issue 3"\nreference = "engineering"\n'
    with pytest.raises(SchemaError) as error:
        read_case(write_case("F.9", keys), table)
    assert "case.fraction: missing" in str(error.value)
    assert "case.mode_channel: missing" in str(error.value)
    keys += 'fraction = 0.2\nmode_channel = "V_cas"\n'
    case = read_case(write_case("F.9", keys, "[events]\ninput_end = 1.5\n"), table)
    assert {criterion.channel for criterion in case.criteria} == {"V_cas"}
