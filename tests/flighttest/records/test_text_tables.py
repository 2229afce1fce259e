"""CSV files typed by people: separators, decimal commas, empty lines, and the lines in errors."""

import math

import pytest

from flightmech.errors import ParseError, UnknownName
from flighttest.records.text_tables import read_text_table


def table_of(tmp_path, text):
    file = tmp_path / "sheet.csv"
    file.write_bytes(text.encode("cp1252"))
    return read_text_table(file, "a sheet")


def test_semicolons_go_with_decimal_commas(tmp_path):
    table = table_of(tmp_path, "item; mass ;note\nfuel;1,5;a, b\n")
    assert table.names == ["item", "mass", "note"]
    assert table.number(0, "mass") == 1.5
    assert table.text(0, "note") == "a, b"


def test_a_comma_in_a_number_is_refused_between_commas(tmp_path):
    table = table_of(tmp_path, 'item,mass\nfuel,"1,5"\n')
    with pytest.raises(ParseError, match="line 2: found '1,5' in column mass; expected a number"):
        table.number(0, "mass")


def test_rows_without_text_are_no_rows_and_count_as_lines(tmp_path):
    table = table_of(tmp_path, "a,b\n\n,,,\n1,2\n\nx,\n")
    assert table.rows == [["1", "2"], ["x", ""]]
    assert math.isnan(table.number(1, "b"))
    with pytest.raises(ParseError, match="line 6: found 'x' in column a"):
        table.number(1, "a")
    with pytest.raises(ParseError, match="line 6: "):
        table.with_rows([1]).number(0, "a")
    with pytest.raises(UnknownName, match="c"):
        table.text(0, "c")


@pytest.mark.parametrize("row", ["1", "1,2,3"])
def test_a_row_of_another_length_is_named(tmp_path, row):
    with pytest.raises(ParseError, match=r"line 3: found \d cells; expected 2"):
        table_of(tmp_path, f"a,b\n1,2\n{row}\n")


def test_a_file_of_windows_has_its_letters(tmp_path):
    assert table_of(tmp_path, "a,b\r\nFühler,2\r\n").text(0, "a") == "Fühler"


def test_an_empty_file_has_no_names(tmp_path):
    table = table_of(tmp_path, "")
    assert (table.names, table.rows) == ([], [])
