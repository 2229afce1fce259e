"""A faulty row of the table of manoeuvres is one problem, and the other rows are still checked."""

import pytest

from aeromatch.project.sections import RecordSelection
from aeromatch.workflow.windows import EVERY_MANOEUVRE, spans_of
from flightmech.errors import SchemaError
from flighttest.records.manoeuvre_table import read_manoeuvres, read_sound_manoeuvres

TABLE = """record,kind,control,start,end
cruise,3211,elevator,13.45,4.5
cruise,doublet,elevator,22.95,33.15
slow,doublet,rudder,54.5,651.5
"""


@pytest.fixture
def file(tmp_path):
    path = tmp_path / "manoeuvres.csv"
    path.write_text(TABLE)
    return path


def test_rows_without_a_fault_are_read(file):
    tables, faulty, problems = read_sound_manoeuvres(file)
    assert {name: len(table) for name, table in tables.items()} == {"cruise": 1, "slow": 1}
    assert faulty == {"cruise": {"3211", "3211 elevator"}}
    with pytest.raises(SchemaError) as caught:
        read_manoeuvres(file)
    assert problems == caught.value.problems
    assert "start 13.45 s and end 4.5 s" in problems[0]


def test_a_sound_table_has_neither_problems_nor_faulty_rows(file):
    file.write_text(TABLE.replace("13.45,4.5", "4.5,13.45"))
    tables, faulty, problems = read_sound_manoeuvres(file)
    assert (len(tables["cruise"]), faulty, problems) == (2, {}, [])


def test_a_table_without_its_columns_is_refused(file):
    file.write_text("record,kind\ncruise,doublet\n")
    with pytest.raises(SchemaError, match="no column 'start'"):
        read_sound_manoeuvres(file)


def test_the_manoeuvre_of_a_faulty_row_is_no_second_problem(file):
    tables, faulty, _ = read_sound_manoeuvres(file)
    names = ("3211 elevator", "doublet elevator", "pulse elevator")
    selection = RecordSelection(records=("cruise",), manoeuvres=names)
    problems: list[str] = []
    spans = spans_of("fit", [selection], tables, problems, faulty=faulty["cruise"])
    assert spans == {"cruise": [(22.95, 33.15)]}
    assert len(problems) == 1
    assert "'pulse elevator'" in problems[0]
    problems.clear()
    spans_of("fit", [selection], tables, problems, faulty=(EVERY_MANOEUVRE,))
    assert problems == []
