import gzip
import tracemalloc
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

import flighttest
from flightmech.errors import ParseError, SchemaError, UnitError
from flighttest.records.readers.formats import csv_columns
from flighttest.records.readers.formats.csv_headings import own_names
from flighttest.records.readers.opening import recognise_recording

NAMES = '[air]\nalpha = { column = "alpha", unit = "deg" }\n'


def written(tmp_path, text, names=NAMES):
    (tmp_path / "names.toml").write_text(names)
    (tmp_path / "flight.txt").write_bytes(text if isinstance(text, bytes) else text.encode())
    return tmp_path / "flight.txt", tmp_path / "names.toml"


@pytest.mark.slow
@pytest.mark.parametrize(
    "text",
    [
        "time,alpha\n0,1\n0.1,2\n0.2,3\n",
        "time;alpha\n0;1\n0.1;2\n0.2;3\n",
        "time\talpha\r\n0\t1\r\n0.1\t2\r\n0.2\t3\r\n",
        "time alpha\n0 1\n0.1   2\n 0.2 3\n",
        '"time","alpha"\n0,1\n# a remark\n\n0.1,2\n0.2,3',
        "\ufefftime,alpha\n0,1\n0.1,2\n0.2,3\n",
    ],
    ids=["comma", "semicolon", "tab", "blanks", "quotes_and_remarks", "byte_order_mark"],
)
def test_ways_to_write_a_table(tmp_path, text):
    file, names = written(tmp_path, text)
    assert recognise_recording(file) == "csv"
    record = flighttest.read(file, names)
    np.testing.assert_allclose(np.degrees(record["air/alpha"].values), [1, 2, 3])
    np.testing.assert_allclose(record["air/time"].values, [0, 0.1, 0.2])


def test_times_of_day_run_over_midnight(tmp_path):
    file, names = written(
        tmp_path, "time,alpha\n23:59:59.8,1\n23:59:59.9,2\n00:00:00.0,3\n00:00:00.1,4\n"
    )
    record = flighttest.read(file, names)
    np.testing.assert_allclose(np.diff(record["air/time"].values), 0.1, atol=1e-9)
    assert record["air/time"].values[0] == pytest.approx(86399.8)
    assert list(flighttest.signals.flags(record)["kind"]) == ["wrap"]


def test_day_of_the_year_before_the_time(tmp_path):
    file, names = written(tmp_path, "time,alpha\n032:00:00:01,1\n032:00:00:02,2\n")
    np.testing.assert_allclose(
        flighttest.read(file, names)["air/time"].values, [31 * 86400 + 1, 31 * 86400 + 2]
    )


def test_dates_name_the_start(tmp_path):
    file, names = written(
        tmp_path, "time,alpha\n2018-03-12T10:00:00.5Z,1\n2018-03-12T10:00:01.5Z,2\n"
    )
    record = flighttest.read(file, names)
    np.testing.assert_allclose(record["air/time"].values, [0, 1])
    assert record.attrs["start"] == "2018-03-12T10:00:00.500000Z"


def test_clock_in_milliseconds(tmp_path):
    file, names = written(
        tmp_path,
        "tick,alpha\n1000,1\n1020,2\n1040,3\n",
        '[time]\ncolumn = "tick"\nunit = "ms"\n' + NAMES,
    )
    record = flighttest.read(file, names)
    np.testing.assert_allclose(record["air/time"].values, [1.0, 1.02, 1.04])
    assert record["air"].attrs["rate"] == pytest.approx(50.0)


def test_empty_cells_are_missing_samples(tmp_path):
    file, names = written(tmp_path, "time,alpha\n0,1\n0.1,\n0.2,nan\n0.3,4\n")
    record = flighttest.read(file, names)
    assert np.isnan(record["air/alpha"].values).tolist() == [False, True, True, False]
    assert flighttest.records.faults(record) == ["air: NaN samples: alpha 2 from 0.1 s"]


def test_line_of_a_fault_counts_remarks_and_blank_lines(tmp_path):
    file, names = written(tmp_path, "# head\ntime,alpha\n0,1\n\n# note\n0.1,1.2.3\n0.2,3\n")
    with pytest.raises(ParseError, match=r"line 6: found '1.2.3' in column 'alpha'"):
        flighttest.read(file, names)


def test_line_that_was_cut_off(tmp_path):
    file, names = written(tmp_path, "time,alpha,beta\n0,1,2\n0.1,1,2\n0.2,1")
    with pytest.raises(ParseError, match=r"line 4: found 2 cells; expected 3 cells.*cut off"):
        flighttest.read(file, names)


def test_line_with_more_cells_than_names(tmp_path):
    file, names = written(tmp_path, "time,alpha\n0,1\n0.1,1,2\n")
    with pytest.raises(ParseError, match="line 3: found 3 cells"):
        flighttest.read(file, names)


def test_decimal_commas(tmp_path):
    file, names = written(tmp_path, "time;alpha\n0,0;1,5\n0,1;1,625\n0,2;-,5e1\n0,3;1\n")
    record = flighttest.read(file, names)
    np.testing.assert_allclose(np.degrees(record["air/alpha"].values), [1.5, 1.625, -5.0, 1.0])
    np.testing.assert_allclose(record["air/time"].values, [0.0, 0.1, 0.2, 0.3])
    assert "decimal commas" in record.attrs["notes"]


@pytest.mark.parametrize(
    ("text", "cell"),
    [
        ("time;alpha\n0;1,234\n1;1,235\n", "'1,234'"),
        ("time;alpha\n0,0;1,5\n0,1;1.234,5\n", "'1.234,5'"),
        ("time;alpha\n0,0;1.5\n", "'1.5'"),
    ],
    ids=["perhaps_thousands", "thousands", "points_too"],
)
def test_commas_that_may_be_thousands_are_refused(tmp_path, text, cell):
    file, names = written(tmp_path, text)
    with pytest.raises(ParseError, match=rf"found {cell} in column 'alpha'"):
        flighttest.read(file, names)


@pytest.mark.slow
@pytest.mark.parametrize("end", ["\r", "\r\n", "\n"])
@pytest.mark.parametrize("encoding", ["utf-8-sig", "utf-16", "utf-32", "cp1252"])
def test_line_ends_and_encodings(tmp_path, end, encoding):
    text = "# Flügel\ntime;alpha;höhe\n0;1;5\n0.1;2;5\n0.2;3;5\n".replace("\n", end)
    file, names = written(
        tmp_path, text.encode(encoding), NAMES + '[sat]\nh = { column = "höhe", unit = "m" }\n'
    )
    record = flighttest.read(file, names)
    np.testing.assert_allclose(np.degrees(record["air/alpha"].values), [1, 2, 3])
    assert record["sat/h"].values[0] == 5.0
    noted = {"utf-8-sig": "[]", "cp1252": "Windows-1252", "utf-16": "UTF-16", "utf-32": "UTF-32"}
    assert noted[encoding] in record.attrs["notes"]


@pytest.mark.parametrize("damaged", ["-inf", "1e308", "-2e30"])
def test_infinite_samples_are_flagged_and_have_no_value(tmp_path, damaged):
    """Also those whose powers are infinite: derivatives of 1e308 ended in an error of SciPy."""
    lines = [f"{k / 10},{damaged if k == 5 else k}\n" for k in range(20)]
    file, names = written(tmp_path, "time,alpha\n" + "".join(lines))
    record = flighttest.read(file, names)
    assert np.flatnonzero(np.isnan(record["air/alpha"].values)).tolist() == [5]
    assert list(flighttest.signals.flags(record)["kind"]) == ["outside", "missing"]


def test_an_infinite_sample_is_not_called_the_fault_of_another_line(tmp_path):
    file, names = written(tmp_path, "time,alpha\n0,inf\n0.1,x1\n")
    with pytest.raises(ParseError, match="line 3: found 'x1'"):
        flighttest.read(file, names)


def test_cells_and_rows_without_end(tmp_path, monkeypatch):
    file, names = written(tmp_path, "time,alpha\n0,1\n0.1," + "x" * 140_000 + "\n")
    with pytest.raises(
        ParseError, match=r"line 3: .*at most 131072 characters; look for a quotation mark"
    ):
        flighttest.read(file, names)
    monkeypatch.setattr("flightmech.support.input_files.MOST_COLUMNS", 3)
    file, names = written(tmp_path, "time,alpha,p,q\n0,1,2,3\n")
    with pytest.raises(ParseError, match="line 1: found 4 cells; expected at most 3"):
        flighttest.read(file, names)


@pytest.mark.parametrize(
    ("text", "word"),
    [
        ("1,2\n3,4\n", "one line of column names"),
        ("time,alpha,alpha\n0,1,2\n1,1,2\n", "2 columns 'alpha' of different content"),
        (b"time,alpha\n" + b"0,1\n" * 2000 + bytes(3000), "line 2002: found zero bytes"),
        (
            gzip.compress(b"time,alpha\n" + b"0,1\n" * 9000, mtime=0)[:60],
            "cannot be decoded .*a whole .gz file",
        ),
        (b"time,alpha\n0,1\n" + bytes([0, 1, 2]), "one of the formats"),
    ],
)
def test_hostile_text(tmp_path, text, word):
    file, names = written(tmp_path, text)
    with pytest.raises(ParseError, match=word):
        flighttest.read(file, names)


def test_parts_parsed_in_parallel_are_the_whole(tmp_path, monkeypatch):
    rng = np.random.default_rng(1)
    time, alpha = np.arange(5000) / 50, rng.normal(0, 1, 5000)
    text = "time,alpha\n" + "".join(
        f"{t!r},{a!r}\n" for t, a in zip(time.tolist(), alpha.tolist(), strict=True)
    )
    monkeypatch.setattr(csv_columns, "_CHUNK", 20_000)
    monkeypatch.setattr(csv_columns.os, "cpu_count", lambda: 7)
    file, names = written(tmp_path, text)
    record = flighttest.read(file, names)
    np.testing.assert_array_equal(record["air/time"].values, time)
    np.testing.assert_allclose(record["air/alpha"].values, np.radians(alpha), rtol=1e-15)


def test_all_that_does_not_fit_the_file_at_once(tmp_path):
    names = (
        '[a]\nalpha = { column = "alpa", unit = "deg" }\nV = { column = "speed" }\nh = { '
        'column = "altitude", unit = "ft" }\n'
    )
    file, names = written(tmp_path, "time,alpha,speed,altitud\n0,1,2,3\n0.1,1,2,3\n", names)
    with pytest.raises(SchemaError) as caught:
        flighttest.read(file, names)
    assert [text.split(";")[0] for text in caught.value.problems] == [
        "unknown column 'alpa'",
        "column 'speed' has no unit in the file",
        "unknown column 'altitude'",
    ]
    assert "near it: alpha" in str(caught.value)
    assert "near it: altitud" in str(caught.value)


def test_one_unit_of_another_quantity(tmp_path):
    file, names = written(tmp_path, "time [s],V [deg]\n0,1\n1,2\n", '[a]\nV = "V"\n')
    with pytest.raises(UnitError, match="'deg' cannot be converted to 'm s-1'"):
        flighttest.read(file, names)


@pytest.mark.nightly
@pytest.mark.parametrize(
    ("year", "name"),
    [("2018", "20180312_1"), ("2019", "20190305_2_partial"), ("2020", "20200310_2")],
)
def test_sound_flights_carry_no_marks(year, name):
    """Parked, taxiing, in flight, a parabola and a landing: ordinary life of real channels is no
    fault.
    """
    root = Path(__file__).parents[3]
    file = root / ".." / "shared" / "data" / "flight" / "citation_phlab" / f"flight_{name}.csv.gz"
    if not file.exists():
        pytest.skip("needs the Citation flights of ../shared")
    record = flighttest.read(file, root / "tests" / "real" / "maps" / f"citation_{year}.toml")
    assert record["ahrs"].attrs["rate"] == pytest.approx(10.0, rel=1e-6)
    assert flighttest.records.faults(record) == []


@pytest.mark.nightly
@given(
    st.lists(
        st.tuples(st.floats(allow_infinity=False), st.floats(allow_infinity=False)), min_size=1
    ),
    st.sampled_from(",;\t "),
    st.sampled_from(".,"),
)
def test_numbers_are_read_to_the_last_bit(rows, separator, decimal):
    decimal = "." if separator == "," else decimal
    lines = [separator.join(map(repr, row)).replace(".", decimal) for row in rows]
    layout = csv_columns.Layout(["a", "b"], separator, decimal)
    columns = csv_columns.parse_columns("\n\n".join(lines).encode(), 0, layout, set())
    np.testing.assert_array_equal(np.column_stack([columns["a"], columns["b"]]), np.array(rows))


@pytest.mark.parametrize("cell", ["1e", "--1", "1.2.3", "1-2", "nan(1)", "x", "1_0", "0x1"])
def test_a_cell_that_is_not_a_number_is_refused(cell):
    layout = csv_columns.Layout(["a", "b"], ",", ".")
    assert csv_columns.parse_columns(f"1,2\n3,{cell}\n".encode(), 0, layout, set()) is None


def test_a_decimal_comma_between_blanks_is_not_a_separator():
    layout = csv_columns.Layout(["a", "b", "c"], " ", ".")
    assert csv_columns.parse_columns(b"0.0 0.0 0.0\n0.0 1,5\n", 0, layout, set()) is None


@pytest.mark.parametrize(("separator", "decimal"), [(",", "."), (";", ","), ("\t", ".")])
@pytest.mark.parametrize("blank", ["", " ", "  "])
def test_a_blank_cell_is_a_missing_value_wherever_it_stands(tmp_path, separator, decimal, blank):
    rows = [[blank, "0.0", "1.5"], ["2.0", "0.1", blank], [blank, "0.2", "3.5"]]
    lines = ["q [rad/s]|time [s]|r [rad/s]", *("|".join(row).replace(".", decimal) for row in rows)]
    file = tmp_path / "blank.csv"
    file.write_text("\n".join(lines).replace("|", separator) + "\n")
    leaf = flighttest.read(file)["data"]
    np.testing.assert_array_equal(leaf["q"].values, [np.nan, 2.0, np.nan])
    np.testing.assert_array_equal(leaf["r"].values, [1.5, np.nan, 3.5])


def test_20_000_equal_headings_are_numbered(tmp_path):
    """Each heading was looked for in all others: minutes."""
    head = "time," + ",".join(["a"] * 19_998)
    with pytest.raises(ParseError, match=r"below the names time, a\.1, a\.2"):
        flighttest.read(*written(tmp_path, f"{head}\n"))
    assert own_names(["a.2", "a", "a", "", "a"]) == (
        ["a.2", "a.1", "a.3", "column 4", "a.4"],
        {"a": ["a.1", "a.3", "a.4"]},
    )


@pytest.mark.parametrize("head", ["time,alpha", 'time,"alpha"'])
def test_lines_longer_than_the_heading_are_refused(tmp_path, recwarn, head):
    """With a remark or a quotation mark in the file pandas left out their last cells."""
    text = f"{head}\n# a remark\n0,1,7\n0.1,2,8\n"
    with pytest.raises(ParseError, match="line 3: found 3 cells; expected 2 cells"):
        flighttest.read(*written(tmp_path, text))
    assert [str(item.message) for item in recwarn] == []


def test_a_line_of_a_million_cells_is_refused_before_they_are_made(tmp_path):
    file, names = written(tmp_path, "time,alpha\n" + "1.25," * 1_000_000)
    tracemalloc.start()
    try:
        with pytest.raises(ParseError, match="line 2: found 1000001 cells; expected at most 20000"):
            flighttest.read(file, names)
        # text and bytes of 5 MB, some copies; the cells have 65 MB
        assert tracemalloc.get_traced_memory()[1] < 40e6
    finally:
        tracemalloc.stop()


@pytest.mark.parametrize(
    ("content", "words"),
    [
        ("time,alpha\n0,1\n0.1,2\n".encode("utf-16-le"), "UTF-16 without a byte-order mark; save"),
        ("time,alpha\n0,1\n0.1,2\n".encode("utf-16-be"), "UTF-16 without a byte-order mark; save"),
        (bytes(5000), "zero bytes, as of a recording that was not written"),
    ],
)
def test_what_an_unknown_text_is(tmp_path, content, words):
    with pytest.raises(ParseError, match=words):
        flighttest.read(*written(tmp_path, content))
