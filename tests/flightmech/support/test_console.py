import math
import sys
import warnings

import click
import pytest
from click.testing import CliRunner
from hypothesis import given
from hypothesis import strategies as st

from flightmech.support.command_line.table_layout import _text_width, table_lines
from flightmech.support.console import (
    LazyGroup,
    NewFile,
    print_remark,
    print_table,
    show_progress,
    to_json_types,
)


def test_a_heading_keeps_its_unit_and_lines_end_without_blanks(capsys):
    print_table(
        ["name", "start [s]"], [("a", 1), ("longer", None)], title="A title", right=["start [s]"]
    )
    assert capsys.readouterr().out.splitlines() == [
        "A title",
        "name    start [s]",
        "a               1",
        "longer",
    ]


def test_a_long_line_is_not_broken_for_a_program(capsys):
    print_table(["a", "b"], [("x", "word " * 100 + "end")])
    assert len(capsys.readouterr().out.splitlines()) == 2


def test_plain_makes_null_of_what_json_lacks():
    assert to_json_types({"a": math.nan, "b": (1, math.inf), "c": None}) == {
        "a": None,
        "b": [1, None],
        "c": None,
    }


@pytest.mark.parametrize(
    ("name", "code", "message"),
    [("new.nc", 0, ""), ("none/new.nc", 2, "no folder 'none' for the file; make it first")],
)
def test_the_folder_of_an_output_is_checked_first(name, code, message, tmp_path, monkeypatch):
    @click.command()
    @click.option("-o", "output", type=NewFile())
    def write(output):
        click.echo(output)

    monkeypatch.chdir(tmp_path)
    done = CliRunner().invoke(write, ["-o", name])
    assert done.exit_code == code
    assert message in done.output


def test_progress_is_printed_on_a_terminal_alone(capsys, monkeypatch):
    with show_progress("read"):
        pass
    assert capsys.readouterr() == ("", "")
    monkeypatch.setattr(sys.stderr, "isatty", lambda: True)
    monkeypatch.setattr(
        warnings, "showwarning", lambda message, *_: print(f"warning: {message}", file=sys.stderr)
    )
    with show_progress("read"):
        warnings.warn("late", UserWarning, stacklevel=1)
    out, err = capsys.readouterr()
    assert out == ""
    first, second = err.splitlines()  # a warning does not stand in the middle of the line
    assert first.startswith("  read ...  ")
    assert first.endswith(" s")
    assert second == "warning: late"


def test_progress_of_work_that_prints_has_a_line_of_its_own(capsys, monkeypatch):
    monkeypatch.setattr(sys.stderr, "isatty", lambda: True)
    with show_progress("replay", lines=True):
        assert capsys.readouterr().err == "  replay ...\n"
    assert capsys.readouterr().err == ""


def test_control_characters_of_a_name_are_printed_as_codes(capsys):
    print_table(["name"], [["q\x1b[31m\u202ex"]], title="a\x9bb\x07")
    print_remark("r\x08")
    printed = capsys.readouterr()
    assert printed.out == "a\\x9bb\\x07\nname\nq\\x1b[31m\\u202ex\n"
    assert printed.err == "r\\x08\n"


_CELLS = st.text("ab c1.-[/]\\~{}µ汉", max_size=12)


@pytest.mark.nightly
@given(st.lists(st.tuples(_CELLS, _CELLS, _CELLS), min_size=1), st.integers(1, 60))
def test_a_broken_table_holds_every_letter_inside_the_terminal(rows, width):
    lines = table_lines(rows, [False, True, False], width)
    letters = "".join(map(click.unstyle, lines)).replace(" ", "")
    assert sorted(letters) == sorted("".join(map("".join, rows)).replace(" ", ""))
    # the first column is whole, and no column is made narrower than eight places
    first = max(_text_width(row[0]) for row in rows)
    assert max(map(_text_width, map(click.unstyle, lines))) <= max(width, first + 2 * (2 + 8))


def test_letters_of_two_columns_and_marks_keep_a_table_aligned(capsys):
    rows = [("汉字", 1, "x"), ("e\u0301", 22, "y"), ("abcd", 333, "z")]
    print_table(["name", "no", ""], rows, right=["no"])
    assert capsys.readouterr().out.splitlines() == [
        "name   no",
        "汉字    1  x",
        "e\u0301      22  y",
        "abcd  333  z",
    ]


def test_lines_of_a_head_stand_at_its_foot(capsys):
    print_table(["a", "two\nlines"], [("x\ny", 1)])
    assert capsys.readouterr().out.splitlines() == ["   two", "a  lines", "x  1", "y"]


def test_only_a_table_wider_than_the_terminal_is_broken(capsys, monkeypatch):
    monkeypatch.setattr(sys.stdout, "isatty", lambda: True)
    monkeypatch.setenv("COLUMNS", "20")
    print_table(["a", "b"], [("x", "one two three")])
    assert [click.unstyle(line) for line in capsys.readouterr().out.splitlines()] == [
        "a  b",
        "x  one two three",
    ]
    print_table(["a", "b"], [("x", "one two three four five")])
    assert [click.unstyle(line) for line in capsys.readouterr().out.splitlines()] == [
        "a  b",
        "x  one two three",
        "   four five",
    ]


def test_a_group_imports_the_modules_of_its_verbs_when_they_are_called(monkeypatch):
    @click.group(
        cls=LazyGroup,
        package="aerodb.cli",
        elsewhere={"compare": "compare", "plot": "compare", "none": "none"},
    )
    def group():
        """Verbs of elsewhere."""

    @group.command()
    def here():
        click.echo("here")

    context = click.Context(group)
    assert group.list_commands(context) == ["here", "compare", "plot", "none"]
    assert (
        CliRunner().invoke(group, ["here"]).output == "here\n"
    )  # the module that is missing is not imported
    commands = [group.get_command(context, name) for name in ("plot", "compare")]
    assert [command.name for command in commands] == ["plot", "compare"]
    assert group.get_command(context, "land") is None
    with pytest.raises(ModuleNotFoundError, match=r"aerodb\.cli\.none"):
        group.get_command(context, "none")


def test_a_name_with_a_line_feed_imitates_no_message(capsys):
    """Names of an HDF5 file may hold line feeds; a message of two lines stays one of two lines."""
    name = "alpha\nerror: the file is sound"
    print_remark(f"error: two problems\n  - {name}\n  - q")
    assert capsys.readouterr().err.splitlines() == [
        "error: two problems",
        "  - alpha\\nerror: the file is sound",
        "  - q",
    ]
    print_table(["column"], [[name]])
    assert len(capsys.readouterr().out.splitlines()) == 2
