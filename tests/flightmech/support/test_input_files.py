"""Hostile files: each reader refuses them with one clear error, in a time that does not grow with
what they claim.
"""

import errno
import os
from pathlib import Path

import numpy as np
import pytest
import scipy.io

import aerodb
import datcom_io
import flighttest
from aerodb.estimators.reading import read_estimate
from aerodb.exchange.formats import recognise_format
from flightmech.errors import ParseError, SchemaError
from flightmech.support import input_files as texts
from flightmech.support import toml_text
from flightmech.support.array_files import mat_files as mat_file
from flightmech.support.file_kinds import file_kind
from flightmech.support.input_files import csv_rows, json_content, load_json, read_text
from flightmech.support.toml_files import read_toml
from flighttest.flight_programme.input_design.timetable import open_timetable
from flighttest.records.manoeuvre_table import read_manoeuvres

DEEP = 20_000
HOSTILE = {
    "nested arrays": ("a = " + "[" * DEEP + "]" * DEEP, "nested more than 100 deep"),
    "nested tables": ("a = " + "{a=" * DEEP + "1" + "}" * DEEP, "nested more than 100 deep"),
    "a little too deep": ("a = " + "[" * 101 + "]" * 101, "nested more than 100 deep"),
    "a long key": (".".join(["a"] * DEEP) + " = 1", "a key of more than 100 parts"),
    "a long key in quotes": (
        "x = {" + " . ".join(['"a"'] * DEEP) + " = 1}",
        "a key of more than 100 parts",
    ),
    "the name of a table": ("[" + ".".join(["a"] * DEEP) + "]", "a key of more than 100 parts"),
    "5000 digits": ("S = " + "9" * 5000, "an integer of thousands of digits, beyond the 64 bits"),
    "400 digits": (
        "[a]\nS = [1, -" + "9" * 400 + "]",
        "an integer of 1329 bits at a.S, beyond the 64 bits",
    ),
    "5000 hexadecimal digits": ("S = 0x" + "f" * 5000, "an integer of 20000 bits at S, beyond"),
    "a control character": (
        '[case]\nname = "a\\u001b[31m"',
        r"found the control character '\\x1b' at case.name; expected a TOML text",
    ),
    "one in a key": ('"a\\u009b" = 1', r"the control character '\\x9b' at the key"),
    "ISO 8859-1": (
        "name = 'x'\n# Flügel".encode("latin-1"),
        r"line 2: found the byte 0xfc, which is not valid UTF-8 \(ISO 8859-1 or",
    ),
    "UTF-16 without a mark": (
        "S = 1\n".encode("utf-16-le"),
        "zero bytes; .*UTF-16 without a byte-order mark",
    ),
}


@pytest.mark.slow
@pytest.mark.parametrize("kind", HOSTILE)
def test_hostile_toml(tmp_path, kind):
    content, word = HOSTILE[kind]
    file = tmp_path / "a.toml"
    file.write_bytes(content if isinstance(content, bytes) else content.encode())
    with pytest.raises(ParseError, match=word):
        read_toml(file)
    assert file_kind(file)  # and what it is can be found out


def test_toml_of_too_many_characters(tmp_path, monkeypatch):
    monkeypatch.setattr(toml_text, "MOST_CHARACTERS", 100)
    (tmp_path / "a.toml").write_text("".join(f"k{i} = 1\n" for i in range(100)))
    with pytest.raises(ParseError, match="found 790 characters, at most 100 are read"):
        read_toml(tmp_path / "a.toml")


@pytest.mark.parametrize("encoding", ["utf-8", "utf-8-sig", "utf-16", "utf-32"])
@pytest.mark.parametrize("end", ["\n", "\r\n", "\r"])
def test_toml_of_other_programs(tmp_path, encoding, end):
    file = tmp_path / "a.toml"
    file.write_bytes(
        "# Flügel\nS = 1.5\nv = [0.1, 0.2]\nt = '1.2.3'\n".replace("\n", end).encode(encoding)
    )
    assert read_toml(file) == {"S": 1.5, "v": [0.1, 0.2], "t": "1.2.3"}


def test_many_points_are_no_long_key(tmp_path):
    (tmp_path / "a.toml").write_text(f"v = [{', '.join(['0.5'] * 300)}]\nt = '{'.' * 300}'\n")
    assert len(read_toml(tmp_path / "a.toml")["v"]) == 300


READERS = [
    read_toml,
    file_kind,
    datcom_io.read,
    datcom_io.read_deck,
    datcom_io.split_deck,
    datcom_io.exchange.read_plot,
    datcom_io.exchange.read_for014,
    lambda path: datcom_io.exchange.read_datcom_plus_csv(path, deriv="DEG"),
    datcom_io.exchange.read_matlab,
    aerodb.open,
    aerodb.exchange.import_matlab,
    recognise_format,
    flighttest.read,
    flighttest.readers.read_names,
    read_manoeuvres,
    open_timetable,
]


@pytest.mark.skipif(not hasattr(os, "mkfifo"), reason="the system has no named pipes")
@pytest.mark.parametrize("reader", READERS)
def test_a_named_pipe_is_refused_and_not_waited_for(tmp_path, reader):
    os.mkfifo(tmp_path / "pipe")
    try:
        text = reader(tmp_path / "pipe")
    except ParseError as error:
        text = str(error)
    assert "a named pipe or a device" in text


@pytest.mark.skipif(not os.path.exists("/proc/self/status"), reason="the system has no /proc")
def test_a_file_of_the_kernel_is_refused_through_a_link_too(tmp_path):
    import click

    from flightmech.support.console import InputFile

    # a reader of /proc/kmsg waits without end; the kernel calls it a regular file
    link = tmp_path / "record.csv"
    link.symlink_to("/proc/self/status")
    with pytest.raises(ParseError, match="a named pipe or a device"):
        flighttest.read(link)
    with pytest.raises(click.BadParameter, match="is a named pipe or a device"):
        InputFile().convert(str(link), None, None)


@pytest.mark.skipif(not hasattr(os, "mkfifo"), reason="the system has no named pipes")
def test_a_named_pipe_on_the_command_line(tmp_path):
    import click

    from flightmech.support.console import InputFile

    os.mkfifo(tmp_path / "pipe")
    with pytest.raises(
        click.BadParameter, match="is a named pipe or a device; give a regular file"
    ):
        InputFile().convert(str(tmp_path / "pipe"), None, None)


def test_csv_rows_name_their_line():
    assert csv_rows('a, "b\nc"\n1,2\n', "f.csv") == [["a", "b\nc"], ["1", "2"]]
    with pytest.raises(ParseError, match=r"f.csv, line 8: found a text that is not a row of CSV"):
        csv_rows('a,b\n"' + "x" * 140_000, "f.csv", first=7)


def test_json_that_cannot_be_read():
    assert json_content('{"a": 1}', "f", "notes") == {"a": 1}
    for text in ("{", "[" * 100_000, "9" * 5000, None):
        with pytest.raises(ParseError, match="f: found notes that cannot be read"):
            json_content(text, "f", "notes")


def test_another_encoding_of_a_table(tmp_path):
    file = tmp_path / "m.csv"
    rows = "record;kind;control;start;end;note\nr;k;c;0,5;1,5;Böe, stark\n"
    for encoding in ("utf-8", "utf-8-sig", "utf-16", "cp1252"):
        file.write_bytes(rows.replace("\n", "\r").encode(encoding))
        table = read_manoeuvres(file)["r"]
        assert table.loc[0, ["start", "end", "note"]].tolist() == [0.5, 1.5, "Böe, stark"]
    file.write_text(rows.replace("Böe", "x" * 140_000))
    with pytest.raises(ParseError, match=r"m.csv, line 2: .*at most 131072 characters"):
        read_manoeuvres(file)


def test_damaged_utf_16_is_no_other_encoding(tmp_path):
    (tmp_path / "a").write_bytes("ab".encode("utf-16") + b"\0")
    with pytest.raises(
        ParseError, match="not valid UTF-16-LE; expected a table; save it with the encoding UTF-8"
    ):
        read_text(tmp_path / "a", "a table", texts.WESTERN)


def test_decks_and_listings_of_other_programs(tmp_path):
    deck = " $FLTCON NMACH=1.0,MACH(1)=0.3$\nCASEID ONE\n"
    for k, raw in enumerate(
        [
            deck.encode("utf-16"),
            deck.replace("\n", "\r").encode(),
            deck.replace("\n", "\r\n").encode("utf-8-sig"),
        ]
    ):
        (tmp_path / f"{k}.inp").write_bytes(raw)
        assert datcom_io.read_deck(tmp_path / f"{k}.inp")[0].caseid == "ONE"


def test_an_error_shows_a_part_of_very_many_problems():
    error = SchemaError("names", [f"problem {k}" for k in range(10_000)])
    assert len(error.problems) == 10_000
    assert str(error).startswith("names: 10000 problems\n  - problem 0\n")
    assert str(error).endswith("- problem 199\n  - and 9800 more")


@pytest.fixture
def harmful(tmp_path):
    """A MAT file with one byte changed, on which SciPy 1.17 ends Python with SIGSEGV."""
    time = np.arange(20) / 50
    content = {
        "t": time,
        "q": time,
        "s": {"a": np.array([1, 2], "i4"), "n": "text"},
        "c": np.array([[1, "x"]], object),
    }
    scipy.io.savemat(tmp_path / "a.mat", content)
    raw = bytearray((tmp_path / "a.mat").read_bytes())
    raw[841] = 32
    (tmp_path / "a.mat").write_bytes(raw)
    return tmp_path / "a.mat"


@pytest.mark.parametrize("reader", [flighttest.read, datcom_io.exchange.read_matlab])
def test_a_mat_file_that_brings_scipy_down(harmful, reader):
    with pytest.raises(ParseError, match=r"a.mat: found .*damaged"):
        reader(harmful)


def test_a_mat_file_without_end(tmp_path, monkeypatch):
    monkeypatch.setattr(mat_file, "_SECONDS", 0.0)
    with pytest.raises(
        ParseError,
        match=r"\(time limit: SciPy did not read it in 0 s\); expected a MAT file; copy or save "
        r"it again",
    ):
        mat_file.load_mat(b"MATLAB", "a.mat", "a MAT file")


def test_a_pattern_that_looks_through_a_file_system_is_refused(tmp_path, monkeypatch):
    """A project of others may name /**, or a folder whose link leads back to it."""
    (tmp_path / "a").mkdir()
    (tmp_path / "a" / "back").symlink_to("..")
    (tmp_path / "a" / "x.st").write_text("")
    monkeypatch.setattr(texts, "MOST_PLACES", 30)
    assert texts.match_files(f"{tmp_path}/a/*.st") == [f"{tmp_path}/a/x.st"]
    with pytest.raises(OSError, match="looks through more than 30 files and folders"):
        texts.match_files(f"{tmp_path}/**/*.st")
    (tmp_path / "a" / "back").unlink()
    assert texts.match_files(f"{tmp_path}/**/*.st") == [f"{tmp_path}/a/x.st"]


def test_a_file_that_is_too_large_is_refused_before_it_is_read(tmp_path):
    file = tmp_path / "large.txt"
    with file.open("w") as opened:
        opened.truncate(3000 << 20)  # no bytes on the disk
    with pytest.raises(ParseError, match="a file of 3000 MiB; expected a text of at most 2048 MiB"):
        read_text(file, "a text")
    with pytest.raises(ParseError, match=r"a file of 3000 MiB.*of at most 64 MiB; divide it"):
        read_estimate(file)


@pytest.mark.skipif(not hasattr(os, "mkfifo"), reason="no named pipes")
def test_a_pattern_leaves_no_pipe_and_no_broken_link_out(tmp_path):
    (tmp_path / "a.toml").write_text("")
    (tmp_path / "folder.toml").mkdir()
    pattern = f"{tmp_path}/*.toml"
    assert texts.match_files(pattern) == [f"{tmp_path}/a.toml"]
    os.mkfifo(tmp_path / "b.toml")
    with pytest.raises(ParseError, match=r"b\.toml.*a named pipe or a device"):
        texts.match_files(pattern)
    (tmp_path / "b.toml").unlink()
    (tmp_path / "b.toml").symlink_to("missing.toml")
    with pytest.raises(ParseError, match=r"b\.toml.*a link to a file that does not exist"):
        texts.match_files(pattern)
    (tmp_path / "b.toml").unlink()
    # as editors lock a file
    (tmp_path / ".#a.toml").symlink_to("user@host")
    assert texts.regular_files(sorted(tmp_path.iterdir()), "an input") == [tmp_path / "a.toml"]


def test_a_fault_of_the_disk_while_reading_names_the_file(tmp_path, monkeypatch):
    """The system gives a name for a fault while opening, but not for one while reading."""

    def fail(path):
        raise OSError(errno.EIO, os.strerror(errno.EIO))

    file = tmp_path / "record.csv"
    file.write_text("time\n0\n")
    monkeypatch.setattr(Path, "read_bytes", fail)
    with pytest.raises(OSError, match="Input/output error") as caught:
        read_text(file, "a table")
    assert caught.value.filename == str(file)


@pytest.mark.parametrize("text", ["9" * 5000, b'{"a": [-' + b"9" * 5000 + b"]}"])
def test_an_integer_of_thousands_of_digits_in_json(text):
    with pytest.raises(ValueError, match=r"^an integer of thousands of digits$"):
        load_json(text)
    with pytest.raises(ParseError, match=r"read \(ValueError: an integer of thousands of digits\)"):
        json_content(text, "a.nc", "a fit")
