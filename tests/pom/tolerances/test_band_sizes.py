"""Tolerances many times as wide as the printed ones: a wrong unit, or a lost decimal point."""

import pytest

from flightmech.errors import AeromatchWarning
from pom.cases.case import read_case
from pom.cli.actions.tolerances import list_tolerances
from pom.judging.departures import case_departures, size_departures
from pom.tolerances import rows
from pom.tolerances.band_sizes import row_size_text

WIDE = "tolerance of pitch angle 1.5 rad, usual is 1.5 deg: 57.3 times as wide"


@pytest.fixture
def write_rows(tmp_path):
    """Write the rows of 2.c.10 as a table of a company, with other cells in the first row."""

    def write(**changes):
        found = [dict(row) | {"standard": "Company 7"} for row in rows.rows_of_test("2.c.10")]
        found[0] |= changes
        lines = [",".join(found[0])]
        for row in found:
            lines.append(",".join(f'"{cell}"' for cell in row.values()))
        path = tmp_path / "own.csv"
        path.write_text("\n".join(lines) + "\n")
        return path

    return write


def test_shipped_rows_have_the_usual_size():
    assert not [row for row in rows.tolerance_rows() if row_size_text(row, row["parameter"])]


@pytest.mark.parametrize(
    ("changes", "text"),
    [
        ({"unit": "rad"}, f"{WIDE}, the factor between deg and rad: check the unit"),
        ({"lower": "-18", "upper": "18"}, "12 times as wide; write the width with its unit"),
        ({"lower": "-0.1", "upper": "0.1"}, "0.0667 times as wide"),
    ],
)
def test_a_table_of_the_user_states_widths_of_another_size(write_rows, capsys, changes, text):
    with pytest.warns(AeromatchWarning, match="own.csv: Company 7.*2.c.10: ") as caught:
        list_tolerances((str(write_rows(**changes)),), None, None, False)
    assert text in str(caught[0].message)
    assert len(caught) == 1


def test_a_case_with_such_a_table_departs(write_rows, write_case):
    path = write_case(case='tolerances = "own.csv"\nstandard = "Company 7"')
    write_rows()
    assert not [item for item in case_departures(read_case(path)) if "times" in item.text]
    write_rows(unit="rad")
    case = read_case(path)
    assert [WIDE in item.text for item in case_departures(case)].count(True) == 1
    assert len(list(size_departures(case))) == 1


def test_a_width_of_the_case_file_without_its_unit_is_stated(write_case):
    case = read_case(write_case(more="[tolerance]\ntheta = 1.5"))
    assert WIDE in next(size_departures(case))
    assert not list(size_departures(read_case(write_case(more='[tolerance]\ntheta = "3 deg"'))))
