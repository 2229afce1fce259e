"""Tests of numbers and files of the command line that no command can use."""

import click
import pytest
from click.testing import CliRunner

from flightmech.support.console import FileOrFolder, InputFile, NewFile, performed_by


@click.command("sum")
@click.argument("files", nargs=-1, type=InputFile())
@click.option("--more", type=InputFile(), multiple=True)
@click.option("--keys", type=InputFile(may_repeat=True), multiple=True)
@click.option("--folders", type=FileOrFolder(), multiple=True)
@click.option("--single", type=InputFile())
@click.option("--pair", type=float, nargs=2)
@click.option("--share", type=click.FloatRange(0.0, min_open=True))
@click.option("--errors", type=(str, float), multiple=True)
@click.option("-o", "--output", type=NewFile())
@click.option("--into", type=NewFile())
@click.option("--edited", type=NewFile(may_replace=True))
@click.option("--model", multiple=True)
@click.option("--folder", type=click.Path(file_okay=False))
@performed_by(f"{__name__}:count_files")
def sum_command() -> None:
    """Count files."""


def count_files(files, more, keys, pair, share, errors, **_) -> None:
    click.echo(f"{len(files)} {pair} {share} {errors} {len(more)} {len(keys)}")


@pytest.fixture
def run(tmp_path, monkeypatch):
    """Return a function that runs the command in a folder with two files and a link."""
    monkeypatch.chdir(tmp_path)
    for name in ("a.csv", "b.csv"):
        (tmp_path / name).write_text(name)
    (tmp_path / "link.csv").symlink_to("a.csv")
    return lambda words: CliRunner().invoke(sum_command, words.split())


@pytest.mark.parametrize(
    ("words", "text"),
    [
        ("--share nan", "'--share': nan is not a number to compute with; give a finite one"),
        ("--share inf", "inf is not a number"),
        ("--pair 1 -inf", "'--pair': -inf is not a number"),
        ("--errors wind 1 --errors mass nan", "'--errors': nan is not a number"),
        ("a.csv b.csv a.csv", "'a.csv' is given twice; give each file once"),
        ("a.csv link.csv", "'link.csv' is given twice"),
        ("--more a.csv --more a.csv", "'--more': 'a.csv' is given twice; give each file once"),
        ("a.csv --more b.csv --more link.csv", "'--more': 'link.csv' is given twice"),
        ("--more a.csv --more b.csv -o b.csv", "b.csv is the input b.csv, too; give another name"),
        ("a.csv --keys b.csv -o b.csv", "b.csv is the input b.csv, too; give another name"),
        ("a.csv --single b.csv -o b.csv", "b.csv is the input b.csv, too; give another name"),
        ("a.csv --edited a.csv", "a.csv is the input a.csv, too; give another name"),
        ("--model m=a.csv -o a.csv", "a.csv is the input a.csv, too; give another name"),
        ("--model a.csv:clean -o a.csv", "a.csv is the input a.csv, too; give another name"),
        ("a.csv -o link.csv", "link.csv is the input a.csv, too; give another name"),
        ("-o c.nc --into ./c.nc", "./c.nc is the output of --output, too; give another name"),
    ],
)
def test_a_value_that_no_command_can_use(run, words, text):
    result = run(words)
    assert result.exit_code == 2
    assert text in result.output


def test_values_that_a_command_can_use(run):
    result = run("a.csv b.csv -o c.nc --into d.nc --pair 0 1e308 --share 1e-300 --errors wind -1")
    assert result.output == "2 (0.0, 1e+308) 1e-300 (('wind', -1.0),) 0 0\n"


@pytest.mark.parametrize(
    "words",
    [
        "a.csv --single b.csv --edited b.csv",
        "--model m=none.csv -o none.csv",
        "a.csv --keys b.csv --keys b.csv --keys a.csv",
        "--folders . --folder .",
    ],
)
def test_files_that_may_be_given_twice(run, words):
    """A file may be edited in place and a key repeated; a folder holds inputs and results."""
    result = run(words)
    assert result.exit_code == 0, result.output
